"""Constraints outside the tree as PyBullet's own: gears between joints, points and frames of two links.

Facts marked *measured*: pybullet 3.2.7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from simspec.engines.pybullet.trees import turn_of
from simspec.errors import EngineError
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world import frames
from simspec.world.kinematics import trees
from simspec.world.rotations import to_xyzw_of
from simspec.world.types import (
    ConnectConstraint,
    Constraint,
    FollowConstraint,
    Pose,
    Quaternion,
    Vector3,
    WeldConstraint,
    World,
)

if TYPE_CHECKING:
    from simspec.engines.pybullet.simulation import PybulletSimulation


STRONG = 1e9
"""The largest force of a constraint (N, N m), of which none may be felt."""
WHOLE = 1.0
"""Share of a violation that is taken back in each step: the law of constraints."""
AXIS = (1.0, 0.0, 0.0)
"""PyBullet requires one and makes no use of it."""


@dataclass(frozen=True)
class StoredConstraint:
    """A constraint that PyBullet was given, by its number."""

    name: str
    number: int
    kind: str


def same_error_reduction(world: World) -> Refinement | None:
    """Not supported where a loop would share its error reduction with limits."""
    limited = next((body.name for body in world.bodies if body.joint.position_limits is not None), None)
    if limited is None:
        return None
    return unsupported_if(
        "PyBullet has one error reduction for loops, which need 1, and position limits: the joint of "
        f"{limited!r} would rebound from its limits at its speed of arrival"
    )


def loops_supported(world: World) -> Refinement | None:
    """Not supported where PyBullet holds no loop, or has limits that a loop would share its error reduction with."""
    return _fixed_below_a_ball(world) or same_error_reduction(world)


def _fixed_below_a_ball(world: World) -> Refinement | None:
    """Measured: a loop whose end is fixed to the root of a tree, where that root is on a ball joint, is not felt at all; one
    whose end is the root itself, or below a further joint, is."""
    by_name = {body.name: body for body in world.bodies}
    for constraint in world.constraints:
        if isinstance(constraint, FollowConstraint):
            continue
        for name in (constraint.first, constraint.second):
            above, joint = by_name[name], by_name[name].joint
            while above.joint.kind == "fixed" and above.joint.parent is not None:
                above = by_name[above.joint.parent]
            if joint.kind == "fixed" and above.joint.kind == "ball" and above.joint.parent is None:
                return unsupported_if(
                    f"PyBullet ignores the loop {constraint.name!r}: {name!r} is fixed to {above.name!r}, the root of "
                    "its tree, which is on a ball joint to the world"
                )
    return None


def in_same_tree(world: World) -> Refinement | None:
    """Not supported where a joint follows one of another tree. Measured: the leader's position is then that of the joint of its
    number in the follower's own tree, and the two part by 0.1 rad in 20 steps."""
    tree = {body.joint.name: root for root, bodies in trees(world).items() for body in bodies}
    for constraint in world.constraints:
        if isinstance(constraint, FollowConstraint) and tree[constraint.joint] != tree[constraint.leader]:
            return unsupported_if(
                f"PyBullet's gears read the leader's position from the follower's tree, and {constraint.leader!r} and "
                f"{constraint.joint!r} are in different trees"
            )
    return None


def hold(
    sim: PybulletSimulation, constraints: Sequence[Constraint], anchors: Mapping[str, Vector3] = MappingProxyType({})
) -> tuple[StoredConstraint, ...]:
    """Create the constraints in PyBullet; :func:`read_constraints` reads them back. ``anchors``: by the name of a weld the
    point at which it acts (``world/constraints.py``), by default the origin of the second body's frame."""
    p = sim.bullet
    joints = _joints(sim)
    actual = []
    for constraint in constraints:
        if isinstance(constraint, FollowConstraint):
            ends = [joints.get(name) for name in (constraint.joint, constraint.leader)]
            if None in ends:
                raise EngineError("pybullet", f"the constraint {constraint.name!r} names a joint that is not there")
            (uid, link), (lead_uid, lead_link) = (end for end in ends if end is not None)
            number = p.createConstraint(uid, link, lead_uid, lead_link, p.JOINT_GEAR, AXIS, (0.0,) * 3, (0.0,) * 3)
            p.changeConstraint(
                number,
                gearRatio=-constraint.ratio,
                relativePositionTarget=constraint.offset,
                erp=WHOLE,
                maxForce=STRONG,
            )
        else:
            number = _joined(sim, constraint, anchors.get(constraint.name, (0.0, 0.0, 0.0)))
        actual.append(StoredConstraint(constraint.name, number, constraint.kind))
    return tuple(actual)


def _joints(sim: PybulletSimulation) -> dict[str, tuple[int, int]]:
    """(tree, link) of every joint, by its name."""
    return {
        name: (tree.uid, link.link)
        for tree, instance in zip(sim.trees, sim.sidecar.instances, strict=True)
        for link, name in zip(tree.links, instance.joints, strict=True)
    }


def _joined(sim: PybulletSimulation, constraint: ConnectConstraint | WeldConstraint, anchor: Vector3) -> int:
    p = sim.bullet
    links = {link.index: (tree.uid, link.link) for tree in sim.trees for link in tree.links}
    first, second = (sim.place[name] for name in (constraint.first, constraint.second))
    if isinstance(constraint, ConnectConstraint):
        kind, places = p.JOINT_POINT2POINT, (Pose(constraint.first_point), Pose(constraint.second_point))
    else:
        at = Pose(anchor)
        kind, places = p.JOINT_FIXED, (frames.compose(constraint.pose, at), at)
    near, far = (
        frames.compose(frames.inverse(inertial_frame(sim, index)), place)
        for index, place in zip((first, second), places, strict=True)
    )
    number: int = p.createConstraint(
        *links[first],
        *links[second],
        kind,
        AXIS,
        near.position,
        far.position,
        to_xyzw_of(near.quaternion),
        to_xyzw_of(far.quaternion),
    )
    p.changeConstraint(number, erp=WHOLE, maxForce=STRONG)
    return number


def inertial_frame(sim: PybulletSimulation, index: int) -> Pose:
    """Where PyBullet has the inertial frame of a body, in the world's frame of it."""
    offset: Vector3 = tuple(sim.offsets[index].tolist())
    centre: Vector3 = tuple(sim.centre[index].tolist())
    turn: Quaternion = tuple(sim.turn[index].tolist())
    return Pose(frames.add(offset, centre), turn)


def read_constraints(sim: PybulletSimulation) -> tuple[Constraint, ...]:
    """The constraints as PyBullet gives them back."""
    p = sim.bullet
    joint_of = {place: name for name, place in _joints(sim).items()}
    body_of = {(tree.uid, link.link): link.index for tree in sim.trees for link in tree.links}
    names = {p.JOINT_GEAR: "follow", p.JOINT_POINT2POINT: "connect", p.JOINT_FIXED: "weld"}
    found: list[Constraint] = []
    for actual in sim.stored_constraints:
        info: tuple[Any, ...] = p.getConstraintInfo(actual.number)
        entry, other, kind = (info[0], info[1]), (info[2], info[3]), names.get(info[4], str(info[4]))
        if kind == "follow":
            found.append(FollowConstraint(actual.name, joint_of[entry], joint_of[other], -info[11], info[13]))
            continue
        first, second = body_of[entry], body_of[other]
        near, far = (
            frames.compose(inertial_frame(sim, index), Pose(tuple(info[at]), turn_of(info[at + 2])))
            for index, at in ((first, 6), (second, 7))
        )
        if kind == "connect":
            found.append(
                ConnectConstraint(actual.name, sim.names[first], sim.names[second], near.position, far.position)
            )
        elif kind == "weld":
            place = frames.compose(near, frames.inverse(far))
            found.append(WeldConstraint(actual.name, sim.names[first], sim.names[second], place))
        else:
            raise EngineError("pybullet", f"holds the constraint {actual.name!r} as {kind}, unknown here")
    return tuple(sorted(found, key=lambda constraint: constraint.name))
