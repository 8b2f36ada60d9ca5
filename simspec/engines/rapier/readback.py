"""The model as Rapier stores it, in the world's frames and order.

Masses, joints, controllers, poses, shapes, gravity and the timestep are queried. Poses of massless bodies that are parts of
others, visual shapes, ratings of joints and the laws of materials are those that Rapier was built from; damping and springs are
those of the efforts that simspec applies.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from simspec.engines.kit.building import STATIC, range_of
from simspec.engines.kit.world_simulation import free_joint, pose_of_row, visual_shape
from simspec.engines.rapier.building import AXES
from simspec.engines.rapier.multibodies import (
    AXIS_OF,
    MASKS,
    UNLIMITED,
    MultibodyLink,
    effort_unit_of,
    inertia_unit_of,
    unit_of,
)
from simspec.engines.rapier.servos import servos
from simspec.engines.rapier.simulation import RapierSimulation
from simspec.engines.rapier.units import NAME, SCALE, inertia_of, pose_of, states_of
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, FreeJoint, parent_of
from simspec.world import frames
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, Inertial, Joint, PairContact, Pose, ReadBack, Shape, Surface

KINDS = {
    "BALL": "sphere",
    "CUBOID": "box",
    "CAPSULE": "capsule",
    "CYLINDER": "cylinder",
    "HALFSPACE": "plane",
    "CONVEX_POLYHEDRON": "mesh",
}
"""Rapier's names of types of shapes."""


def read_back(sim: RapierSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as Rapier stores it, and its present state."""
    sim.disarm()
    solid = {(shape.owner.row, shape.place): shape.number for shape in sim.walk.shapes}
    bodies = [
        Body(
            body.name,
            body.model,
            inertial(sim, row),
            joint,
            tuple(
                visual_shape(shape) if (row, place) not in solid else _shape(sim, solid[row, place])
                for place, shape in enumerate(body.shapes)
            ),
            gravity_scale=_gravity_scale(sim, row),
        )
        for row, (body, joint) in enumerate(zip(sim.document.bodies, joints(sim), strict=True))
    ]
    x, y, z = (value / SCALE for value in sim.world.gravity)
    timestep = float(sim.world.integration_parameters.dt)
    found = sim.model(bodies, (x, y, z), timestep, unreadable, laws=laws(sim))
    return dataclasses.replace(found, servos=servos(sim))


def inertial(sim: RapierSimulation, row: int) -> Inertial:
    """The mass properties of a body; nothing of a part of another body."""
    if not sim.is_separate(row):
        return NO_INERTIA
    body = sim.world.rigid_bodies[sim.built.bodies[row]]
    mass = body.mass_properties
    if not mass.mass:
        return NO_INERTIA
    m = inertia_of(body)
    x, y, z = (value / SCALE for value in mass.local_com)
    return Inertial(mass.mass, (x, y, z), (m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))


def joints(sim: RapierSimulation) -> list[Joint]:
    """The joint of every body."""
    q, v = sim.get_state()
    return [
        _joint(sim, row, q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist()) for row in range(len(sim.names))
    ]


def _joint(sim: RapierSimulation, row: int, position: list[float], velocity: list[float]) -> Joint:
    """The joint of a body, of what is a link by Rapier's own, else by the poses of Rapier's bodies."""
    placed, joint = sim.walk.bodies[row], sim.document.bodies[row].joint
    number = sim.built.multibodies.number.get(row)
    if number is None and isinstance(joint, FreeJoint):
        return free_joint(joint.name, position, velocity)
    if number is not None:
        return _of_link(sim, number, position, velocity)
    pose = placed.pose
    if not placed.moves:
        pose = _static_pose(sim, row)
        if placed.parent != STATIC:
            pose = frames.compose(frames.inverse(_static_pose(sim, placed.parent)), pose)
    else:  # parts of one body of Rapier
        pose = frames.compose(frames.inverse(sim.walk.bodies[placed.parent].pose), pose)
    return Joint(joint.name, joint.kind, parent_of(joint), pose)


def _static_pose(sim: RapierSimulation, row: int) -> Pose:
    return pose_of_row(states_of([sim.world.rigid_bodies[sim.built.bodies[row]]])[0])


def _of_link(sim: RapierSimulation, number: int, position: list[float], velocity: list[float]) -> Joint:
    link, built = sim.built.multibodies.links[number], sim.built.multibodies
    given, data = link.joint, sim.world.multibody_joints[built.joints[number]].data
    kind = kind_of_joint(sim.rapier, data)
    if isinstance(given, FreeJoint) and kind == "free":
        return free_joint(given.name, position, velocity)
    found = Joint(
        given.name, kind, parent_of(given), _origin(sim, link, data), position=tuple(position), velocity=tuple(velocity)
    )
    at, place = sim.v_places[link.placed.row], built.places[number] - built.starts[link.tree]
    multibody = sim.links.multibodies[link.tree]
    rotors = multibody.armature()
    if at.stop > at.start:
        damping, stiffness = sim.losses.damping[at.start], sim.losses.stiffness[at.start]
        if sim.native:
            damping = multibody.damping()[place] / inertia_unit_of(kind)
        found = dataclasses.replace(found, damping=float(damping), spring_stiffness=float(stiffness))
    if kind == "ball":
        return dataclasses.replace(found, armature=_same(rotors[place : place + 3], given.name) / inertia_unit_of(kind))
    if kind not in AXIS_OF or not isinstance(given, AxisJoint):
        return found
    axis = getattr(sim.rapier.JointAxis, AXIS_OF[kind])
    limits, motor = data.limits(axis), data.motor(axis)
    return dataclasses.replace(
        found,
        axis=frames.rotate(pose_of(data.local_frame2).quaternion, (1.0, 0.0, 0.0)),
        position_limits=None if limits is None else range_of(*(_end(end, kind) for end in (limits.min, limits.max))),
        velocity_limit=given.velocity_limit,
        effort_limit=given.effort_limit,
        dry_friction=0.0 if motor is None else motor.max_force / effort_unit_of(kind),
        armature=rotors[place] / inertia_unit_of(kind),
        spring_rest=float(sim.losses.rest[at.start]),
    )


def _same(values: Sequence[float], name: str) -> float:
    """The one armature about all axes of a ball joint."""
    first, *others = values
    if any(value != first for value in others):
        raise EngineError(NAME, f"joint {name!r} has different armatures about its axes")
    return first


def _end(value: float, kind: str) -> float:
    """A position limit (rad or m)."""
    return math.copysign(math.inf, value) if abs(value) >= 0.5 * UNLIMITED else value / unit_of(kind)


def kind_of_joint(rapier: Any, data: Any) -> str:
    """The kind of one of Rapier's joints by the axes that it locks."""
    locked = data.locked_axes.bits
    kinds = {getattr(rapier.JointAxesMask, mask).bits: kind for kind, mask in MASKS.items()}
    return {**kinds, 0: "free"}.get(locked, f"locked {locked:b}")


def _origin(sim: RapierSimulation, link: MultibodyLink, data: Any) -> Pose:
    """The pose of a link's frame, at the zero of its joint, in the frame of the body's parent."""
    pose = frames.compose(pose_of(data.local_frame1), frames.inverse(pose_of(data.local_frame2)))
    parent = link.placed.parent
    if parent == STATIC:
        return pose
    above = sim.walk.bodies[parent]
    at = link.part if above.moves else _static_pose(sim, parent)
    return frames.compose(frames.inverse(at), pose)


def _gravity_scale(sim: RapierSimulation, row: int) -> float:
    """The share of its weight that a body has; 1 of a part of another, which has none."""
    return float(sim.world.rigid_bodies[sim.built.bodies[row]].gravity_scale) if sim.is_separate(row) else 1.0


def _shape(sim: RapierSimulation, number: int) -> Shape:
    """A collision shape as Rapier stores it, with the visual part of the file."""
    solid, collider = sim.walk.shapes[number], sim.world.colliders[sim.built.colliders[number]]
    kind, pose = kind_of(collider), pose_of(collider.position_wrt_parent)
    if kind in AXES:
        pose = frames.compose(pose, frames.inverse(AXES[kind]))
    if solid.owner.moves:
        pose = frames.compose(frames.inverse(solid.owner.pose), pose)
    visual, size = visual_shape(solid.shape), size_of(collider, kind)
    return dataclasses.replace(visual, kind=kind, size=size, pose=pose, collision=True, surfaces=(Surface(),))


def kind_of(collider: Any) -> str:
    """The kind of a collider's shape by the world's name; Rapier's name of a kind that the world does not have."""
    name = str(collider.shape.shape_type).rpartition(".")[2]
    return KINDS.get(name, name)


def size_of(collider: Any, kind: str) -> tuple[float, ...]:
    """The size of a collider's shape as the world has it."""
    shape = collider.shape
    match kind:
        case "sphere":
            return (float(shape.as_ball().radius) / SCALE,)
        case "box":
            return tuple(2.0 * edge / SCALE for edge in shape.as_cuboid().half_extents)
        case "capsule" | "cylinder":
            round_shape = shape.as_capsule() if kind == "capsule" else shape.as_cylinder()
            return (float(round_shape.radius) / SCALE, 2.0 * float(round_shape.half_height) / SCALE)
        case "mesh":
            return tuple((shape.as_convex_polyhedron().points.astype(float) / SCALE).ravel().tolist())
    return ()


def laws(sim: RapierSimulation) -> tuple[PairContact, ...]:
    """The table of laws; the numbers of a uniform law are the means of those of the colliders, as Rapier combines them."""
    hook = sim.built.laws
    found = {pair: row for pair, row in hook.table.items() if pair[0] <= pair[1]}
    if hook.uniform is not None and hook.colliders:
        colliders = {
            name: sim.world.colliders[collider] for name, collider in zip(hook.materials, hook.colliders, strict=True)
        }
        for pair in found:
            if set(pair) <= set(colliders):
                entry, other = (colliders[name] for name in pair)
                friction, restitution = entry.friction + other.friction, entry.restitution + other.restitution
                found[pair] = (0.5 * friction, 0.5 * restitution, 0.0)
    return tuple(
        PairContact(name, other, friction, restitution, restitution_threshold=threshold)
        for (name, other), (friction, restitution, threshold) in sorted(found.items())
    )
