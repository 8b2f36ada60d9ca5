"""Where things are in a world: trees, rigid groups, poses at a configuration, the generalised coordinates.

Generalised coordinates, the same for the oracle and for every engine (q has the sizes of ``POSITION_SIZE``, v of
``VELOCITY_SIZE``, in the order of ``World.bodies``):

hinge, slide   angle or displacement; its rate
ball           quaternion w x y z of child in joint frame; angular velocity of the child relative to the parent, in the
               child's axes
free           position of the root body's **centre of mass** in the world, quaternion w x y z of the body frame;
               velocity of the centre of mass in world axes, angular velocity in the **body's** axes. Where the inertia of
               a rigid group is gathered on the root (``world/gathering.py``), the centre of mass of the group

A free body's position is integrated at its centre of mass because that is what all engines can be made to do; integrating
another point gives another discrete motion (measured in one of them: 2e-3 m after 2,000 steps of 1 ms).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from simspec.world import frames
from simspec.world.derived import derived
from simspec.world.gathering import lumped_inertial
from simspec.world.tuples import quaternion, vector3
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Body, Constraint, Follow, Pose, World


@dataclass(frozen=True, slots=True)
class Layout:
    """Where each body's joint has its coordinates: slices into q (nq,) and v (nv,), in the order of the bodies."""

    position: tuple[slice, ...]
    velocity: tuple[slice, ...]
    nq: int
    nv: int


def layout(bodies: Sequence[Body]) -> Layout:
    """The coordinate layout of ``bodies``."""
    position, velocity, nq, nv = [], [], 0, 0
    for body in bodies:
        kind = body.joint.kind
        position.append(slice(nq, nq + POSITION_SIZE[kind]))
        velocity.append(slice(nv, nv + VELOCITY_SIZE[kind]))
        nq += POSITION_SIZE[kind]
        nv += VELOCITY_SIZE[kind]
    return Layout(tuple(position), tuple(velocity), nq, nv)


@derived
def layout_of(world: World) -> Layout:
    """The coordinate layout of a world's bodies."""
    return layout(world.bodies)


def frictional_coordinates(world: World) -> np.ndarray:
    """The places in v (n,) of the hinges and slides with dry friction, their own or along a sum of their positions."""
    parts = layout_of(world).velocity
    summed = {joint for one in world.sums if one.dry_friction for joint, _ in one.joints}
    rough = [body.joint.dry_friction or body.joint.name in summed for body in world.bodies]
    return np.array([at.start for rubs, at in zip(rough, parts, strict=True) if rubs], int)


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
        if isinstance(constraint, Follow)
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
    return [(owner[one.joints[0][0]], owner[joint]) for one in world.sums for joint, _ in one.joints[1:]]


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
        constraints=tuple(held for held in world.constraints if all(name in names for name in members(held))),
        sums=tuple(one for one in world.sums if all(joint in names for joint, _ in one.joints)),
    )


def members(constraint: Constraint) -> tuple[str, str]:
    """The two joints that a coupling is of, the follower first; else the two bodies that are held together."""
    if isinstance(constraint, Follow):
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


class CollisionFilter:
    """Which bodies may touch, by the world's rules (see :class:`simspec.world.types.Contact`)."""

    def __init__(self, world: World):
        self._groups = rigid_groups(world)
        self._collision_group = {body.name: body.collision_group for body in world.bodies}
        self._ignored = set(world.contact.ignored_groups)
        self._excluded = set(world.contact.excluded_bodies)
        self._solid = {body.name for body in world.bodies if any(shape.collision for shape in body.shapes)}
        self._passing = {(pair.first, pair.second) for pair in world.contact.pairs if not pair.collide}
        self._materials = (
            {body.name: {shape.material for shape in body.shapes if shape.collision} for body in world.bodies}
            if self._passing
            else {}
        )

    def may_touch(self, first: str, second: str) -> bool:
        """Whether contact between the two bodies is allowed; False for a body with itself or without shapes."""
        if first == second or first not in self._solid or second not in self._solid:
            return False
        if self._groups[first] == self._groups[second]:
            return False
        if (min(first, second), max(first, second)) in self._excluded:
            return False
        group, other = self._collision_group[first], self._collision_group[second]
        if (min(group, other), max(group, other)) in self._ignored:
            return False
        return not self._passing or any(
            self.may_materials_touch(a, b) for a in self._materials[first] for b in self._materials[second]
        )

    def may_materials_touch(self, first: str, second: str) -> bool:
        """Whether shapes of the two materials collide at all."""
        return (min(first, second), max(first, second)) not in self._passing
