"""Where things are in a world: trees, rigid groups, poses at a configuration, the generalised coordinates.

Generalised coordinates, the same for the oracle and for every engine (q has the sizes of ``POSITION_SIZE``, v of
``VELOCITY_SIZE``, in the order of ``World.bodies``):

hinge, slide   angle or displacement; its rate
ball           quaternion w x y z of child in joint frame; angular velocity of the child relative to the parent, in the
               child's axes
free           position of the root body's **centre of mass** in the world, quaternion w x y z of the body frame;
               velocity of the centre of mass in world axes, angular velocity in the **body's** axes. Where the inertia of
               a rigid group is gathered on the root (``world/inertia.py``), the centre of mass of the group

A free body's position is integrated at its centre of mass because that is what all engines can be made to do; integrating
another point gives another discrete motion (measured in one of them: 2e-3 m after 2,000 steps of 1 ms).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np

from simspec.world import frames
from simspec.world.canonical import derived
from simspec.world.frames import quaternion, sorted_pair, vector3
from simspec.world.inertia import NO_INERTIA, lumped_inertial
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Body, Constraint, FollowConstraint, Inertial, Pose, World

# Bodies between the joints of a body that has several: without mass and shapes, they carry the next joint.
#
# A body with the joints `steer` and `spin` stands in the world as two: `wheel.steer`, which the first joint moves, and `wheel`,
# which the second one moves against it. No name in a spec has a point, so no other body is called so.

CARRYING: Final = ("hinge", "slide")
"""Joints that further ones of the same body may follow."""


def carrier_name(body: str, joint: str) -> str:
    """The name of what a joint moves that is not the last of its body's."""
    return f"{body}.{joint.rpartition('/')[2]}"


def is_carrier(name: str) -> bool:
    """Whether a body of this name stands between two joints of another."""
    return "." in name


def display_name(name: str, names: Container[str]) -> str:
    """The body that tables show for one of this name: the one whose joint it carries, where ``names`` has that."""
    owner = owner_of(name)
    return owner if owner in names else name


def owner_of(name: str) -> str:
    """The body of the spec that a body of this name belongs to: itself, or the one whose joint it carries."""
    return name.partition(".")[0]


def joined(bodies: Sequence[Body]) -> set[tuple[str, str]]:
    """The sorted pairs of bodies that joints join: each with its parent, and across the carriers between joints of one body."""
    parents: Mapping[str, str | None] = {body.name: body.joint.parent for body in bodies}
    pairs = set()
    for body in bodies:
        above = body.joint.parent
        if above is not None:
            pairs.add(sorted_pair(body.name, above))
        while above is not None and is_carrier(above):
            above = parents[above]
        if above is not None:
            pairs.add(sorted_pair(body.name, above))
    return pairs


@derived
def absorbed(world: World) -> Mapping[str, str]:
    """By the name of each carrier of :func:`carried` the body that it may be one with."""
    return MappingProxyType({carrier.name: body for body, row in carried(world).items() for carrier in row})


@derived
def carried(world: World) -> Mapping[str, tuple[Body, ...]]:
    """By the name of each body with several joints the carriers above it, the parent's side first: those that have nothing but
    their joint, so that they and the body may stand as one body with several joints."""
    known = {body.name: body for body in world.bodies}
    below: dict[str | None, int] = {}
    for body in world.bodies:
        below[body.joint.parent] = below.get(body.joint.parent, 0) + 1
    constraints = {
        end
        for constraint in world.constraints
        if not isinstance(constraint, FollowConstraint)
        for end in (constraint.first, constraint.second)
    }  # of carriers only in worlds that are made in Python
    rows: dict[str, tuple[Body, ...]] = {}
    for body in world.bodies:
        row: list[Body] = []
        above = body.joint.parent if body.joint.kind in (*CARRYING, "ball") else None
        while above is not None and is_carrier(above) and owner_of(above) == body.name:
            carrier = known[above]
            alone = below[above] == 1 and above not in constraints and not carrier.shapes
            if not alone or carrier.inertial != Inertial(0.0) or carrier.joint.kind not in CARRYING:
                break
            row.insert(0, carrier)
            above = carrier.joint.parent
        if row:
            rows[body.name] = tuple(row)
    return MappingProxyType(rows)


# Bodies that are nothing but frames: fixed to others, without mass and shapes, and carrying nothing but such bodies.


@derived
def bare_frames(world: World) -> frozenset[str]:
    """The names of the bodies of a world that are nothing but frames: where they are follows from the body that carries them,
    and nothing follows from them. The ends of constraints are none, since something acts there."""
    constraints = {
        end
        for constraint in world.constraints
        if not isinstance(constraint, FollowConstraint)
        for end in (constraint.first, constraint.second)
    }
    carrying: set[str] = set()
    bare: set[str] = set()
    for body in reversed(world.bodies):
        if _is_frame(body) and body.name not in constraints and body.name not in carrying:
            bare.add(body.name)
        elif body.joint.parent is not None:
            carrying.add(body.joint.parent)
    return frozenset(bare)


def _is_frame(body: Body) -> bool:
    fixed = body.joint.kind == "fixed" and body.joint.parent is not None
    return fixed and not body.shapes and body.inertial == NO_INERTIA and body.gravity_scale == 1.0


@dataclass(frozen=True, slots=True)
class Layout:
    """Where each body's joint has its coordinates: slices into q (nq,) and v (nv,), in the order of the bodies."""

    position: tuple[slice, ...]
    velocity: tuple[slice, ...]
    nq: int
    nv: int


def layout_of_kinds(kinds: Iterable[str]) -> Layout:
    """The coordinate layout of bodies with joints of these kinds."""
    position, velocity, nq, nv = [], [], 0, 0
    for kind in kinds:
        position.append(slice(nq, nq + POSITION_SIZE[kind]))
        velocity.append(slice(nv, nv + VELOCITY_SIZE[kind]))
        nq += POSITION_SIZE[kind]
        nv += VELOCITY_SIZE[kind]
    return Layout(tuple(position), tuple(velocity), nq, nv)


def layout(bodies: Sequence[Body]) -> Layout:
    """The coordinate layout of ``bodies``."""
    return layout_of_kinds(body.joint.kind for body in bodies)


@derived
def layout_of(world: World) -> Layout:
    """The coordinate layout of a world's bodies."""
    return layout(world.bodies)


def frictional_coordinates(world: World) -> np.ndarray:
    """The places in v (n,) of the hinges and slides with dry friction, their own or along a sum of their positions."""
    parts = layout_of(world).velocity
    summed = {joint for joint_sum in world.sums if joint_sum.dry_friction for joint, _ in joint_sum.joints}
    rough = [body.joint.dry_friction or body.joint.name in summed for body in world.bodies]
    return np.array([at.start for has_friction, at in zip(rough, parts, strict=True) if has_friction], int)


def initial_state(world: World) -> tuple[np.ndarray, np.ndarray]:
    """The world's initial (q, v) in generalised coordinates."""
    q: list[float] = []
    v: list[float] = []
    for body in world.bodies:
        joint = body.joint
        if joint.kind != "free":
            q.extend(joint.position)
            v.extend(joint.velocity)
            continue
        turn = quaternion(joint.position[3:7])
        lever = frames.rotate(turn, lumped_inertial(world, body).centre_of_mass)
        linear, angular = vector3(joint.velocity[:3]), vector3(joint.velocity[3:])
        q.extend(frames.add(vector3(joint.position[:3]), lever))
        q.extend(turn)
        v.extend(frames.add(linear, frames.cross(angular, lever)))
        v.extend(frames.rotate(frames.conjugate(turn), angular))
    return np.array(q), np.array(v)


def joint_displacement(body: Body, position: Sequence[float]) -> Pose:
    """The pose of the body frame in the joint frame at a joint position (free: x y z w x y z of the body frame)."""
    kind = body.joint.kind
    if kind == "fixed":
        return Pose()
    if kind == "hinge":
        return Pose(quaternion=frames.from_axis_angle(body.joint.axis, position[0]))
    if kind == "slide":
        x, y, z = body.joint.axis
        return Pose((x * position[0], y * position[0], z * position[0]))
    if kind == "ball":
        return Pose(quaternion=quaternion(position))
    return Pose(vector3(position[:3]), quaternion(position[3:7]))


def poses(world: World, at_zero: bool = False) -> dict[str, Pose]:
    """The pose of every body frame in the world, at the initial positions, or with all joints at zero.

    At zero, a free root stays at its initial pose (it has no other place of its own).
    """
    placed: dict[str, Pose] = {}
    for body in world.bodies:
        joint = body.joint
        start = joint.origin if joint.parent is None else frames.compose(placed[joint.parent], joint.origin)
        if at_zero and joint.kind != "free":
            placed[body.name] = start
        else:
            placed[body.name] = frames.compose(start, joint_displacement(body, joint.position))
    return placed


@derived
def rigid_groups(world: World) -> Mapping[str, str]:
    """For every body the name of its rigid group: the topmost body reached upwards through fixed joints, or "world" if
    that one is fixed to the world."""
    group: dict[str, str] = {}
    for body in world.bodies:
        joint = body.joint
        if joint.kind != "fixed":
            group[body.name] = body.name
        elif joint.parent is None:
            group[body.name] = "world"
        else:
            group[body.name] = group[joint.parent]
    return MappingProxyType(group)


def natively_driven(bodies: Sequence[Body], world: World) -> list[str]:
    """The names of those of ``bodies`` whose joint is driven by the engine's own controller."""
    driven = {joint for controller in world.controllers if controller.law == "native" for joint in controller.joints}
    return [body.name for body in bodies if body.joint.name in driven]


@derived
def trees(world: World) -> Mapping[str, tuple[Body, ...]]:
    """The bodies of each tree, by the name of its root body, in the world's order."""
    root: dict[str, str] = {}
    by_root: dict[str, list[Body]] = {}
    for body in world.bodies:
        root[body.name] = body.name if body.joint.parent is None else root[body.joint.parent]
        by_root.setdefault(root[body.name], []).append(body)
    return MappingProxyType({name: tuple(bodies) for name, bodies in by_root.items()})


@derived
def constrained_trees(world: World) -> tuple[tuple[Body, ...], ...]:
    """The bodies of the trees that move together: of one tree, or of several that constraints or sums of joint positions
    join; in the world's order."""
    owner = {body.joint.name: body.name for body in world.bodies}
    pairs = [
        (owner[constraint.joint], owner[constraint.leader])
        if isinstance(constraint, FollowConstraint)
        else (constraint.first, constraint.second)
        for constraint in world.constraints
    ]
    return _joined(world, [*pairs, *_summed(world)])


@derived
def sprung_trees(world: World) -> tuple[tuple[Body, ...], ...]:
    """The bodies of the trees that springs and dampers act on together: of one tree, or of several that sums join; in the
    world's order."""
    return _joined(world, _summed(world))


def _summed(world: World) -> list[tuple[str, str]]:
    """Pairs of bodies whose joints are in one sum, each with the first of it."""
    owner = {body.joint.name: body.name for body in world.bodies}
    return [
        (owner[joint_sum.joints[0][0]], owner[joint]) for joint_sum in world.sums for joint, _ in joint_sum.joints[1:]
    ]


def _joined(world: World, pairs: Iterable[tuple[str, str]]) -> tuple[tuple[Body, ...], ...]:
    """Trees joined by pairs of bodies that are in them."""
    tree = {body.name: root for root, bodies in trees(world).items() for body in bodies}
    group = {root: root for root in trees(world)}

    def top(root: str) -> str:
        while group[root] != root:
            root = group[root]
        return root

    for first, second in pairs:
        group[top(tree[second])] = top(tree[first])
    joined: dict[str, list[Body]] = {}
    for body in world.bodies:
        joined.setdefault(top(tree[body.name]), []).append(body)
    return tuple(tuple(bodies) for bodies in joined.values())


def within(world: World, bodies: Iterable[Body]) -> World:
    """The world with some of its bodies alone (whole trees), and the constraints and sums between them."""
    kept = tuple(bodies)
    names = {name for body in kept for name in (body.name, body.joint.name)}
    return replace(
        world,
        bodies=kept,
        constraints=tuple(
            constraint for constraint in world.constraints if all(name in names for name in members(constraint))
        ),
        sums=tuple(joint_sum for joint_sum in world.sums if all(joint in names for joint, _ in joint_sum.joints)),
    )


def members(constraint: Constraint) -> tuple[str, str]:
    """The two joints that a coupling is of, the follower first; else the two bodies that are held together."""
    if isinstance(constraint, FollowConstraint):
        return constraint.joint, constraint.leader
    return constraint.first, constraint.second


@derived
def free_rigid(world: World) -> frozenset[str]:
    """The root bodies of the trees that are one free rigid body: a free joint, and below it fixed ones alone."""
    return frozenset(
        name
        for name, (root, *others) in trees(world).items()
        if root.joint.kind == "free" and all(body.joint.kind == "fixed" for body in others)
    )


# Names of the generalised coordinates, one for every column of q and of v.
#
# A hinge or slide has its joint's name (``elbow``). A ball joint has a column for each component of its quaternion and of its
# angular velocity (``shoulder.qw``, ``shoulder.wx``). A free body has those of its centre of mass, its quaternion and its
# velocities, under the *body's* name (``base.x``, ``base.qw``, ``base.vx``, ``base.wx``). Their physical meaning is in the
# docstring of :mod:`simspec.world.kinematics`.

POSITION_COMPONENTS: Mapping[str, tuple[str, ...]] = {
    "fixed": (),
    "hinge": ("",),
    "slide": ("",),
    "ball": (".qw", ".qx", ".qy", ".qz"),
    "free": (".x", ".y", ".z", ".qw", ".qx", ".qy", ".qz"),
}
"""Suffixes of the name in q, by the joint's kind."""
VELOCITY_COMPONENTS: Mapping[str, tuple[str, ...]] = {
    "fixed": (),
    "hinge": ("",),
    "slide": ("",),
    "ball": (".wx", ".wy", ".wz"),
    "free": (".vx", ".vy", ".vz", ".wx", ".wy", ".wz"),
}
"""The same in v."""


@dataclass(frozen=True, slots=True)
class Coordinates:
    """The names of the columns of q (nq,) and v (nv,), and which columns belong to a name: those of a whole joint under the
    joint's name (of a free body also under the body's), and each column under its own."""

    q: tuple[str, ...]
    v: tuple[str, ...]
    q_columns: Mapping[str, slice]
    v_columns: Mapping[str, slice]

    def __repr__(self) -> str:
        return f"<Coordinates: {len(self.q)} positions, {len(self.v)} velocities>"


def coordinates(world: World) -> Coordinates:
    """The names of ``world``'s generalised coordinates."""
    where = layout_of(world)
    balls = {body.joint.name for body in world.bodies if body.joint.kind == "ball"}
    q: list[str] = []
    v: list[str] = []
    of_q: dict[str, slice] = {}
    of_v: dict[str, slice] = {}
    for body, position, velocity in zip(world.bodies, where.position, where.velocity, strict=True):
        joint = body.joint
        name = joint.name
        if joint.kind == "free":
            # no name of a spec has brackets: different from a ball joint that is called like the body
            name = body.name if body.name not in balls else f"{body.name}(free)"
        if joint.kind != "fixed":
            for known, part in ((of_q, position), (of_v, velocity)):
                known[name] = part
                known.setdefault(joint.name, part)
        q.extend(name + component for component in POSITION_COMPONENTS[joint.kind])
        v.extend(name + component for component in VELOCITY_COMPONENTS[joint.kind])
    of_q |= {name: slice(k, k + 1) for k, name in enumerate(q)}
    of_v |= {name: slice(k, k + 1) for k, name in enumerate(v)}
    return Coordinates(tuple(q), tuple(v), of_q, of_v)
