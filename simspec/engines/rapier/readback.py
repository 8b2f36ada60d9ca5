"""What Rapier says it holds, in the world's frames and order.

Masses, poses, shapes, gravity and the timestep are asked of Rapier. Which joints there are, where bodies stand that are fixed
to one that moves (they are that body), what is only seen, and the laws of materials are told by what Rapier was made from.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.engines.rapier.building import AXES, SCALE
from simspec.engines.rapier.simulation import Simulation, held_tensor, pose_of
from simspec.formats.kit.contract import restore_frames
from simspec.formats.world.tree import FreeJoint, JsonBody, JsonShape, parent_of
from simspec.world import frames
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, Inertial, Joint, PairContact, Pose, ReadBack, Shape, Surface, Vector3

KINDS = {
    "BALL": "sphere",
    "CUBOID": "box",
    "CAPSULE": "capsule",
    "CYLINDER": "cylinder",
    "HALFSPACE": "plane",
    "CONVEX_POLYHEDRON": "mesh",
}
"""Rapier's names of types of shapes."""


def read_back(sim: Simulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as Rapier holds it, and its present state."""
    numbers: dict[int, list[int]] = {}
    for number, (row, _) in enumerate(sim.built.shapes):
        numbers.setdefault(row, []).append(number)
    q, v = sim.get_state()
    poses, _ = sim.file_frames()
    bodies = tuple(
        Body(
            told.name,
            told.model,
            inertial(sim, row),
            _joint(sim, row, told, poses, q, v),
            tuple(_shapes(sim, told, numbers.get(row, []))),
        )
        for row, told in enumerate(sim.document.bodies)
    )
    moved = zip(sim.names, sim.offsets.tolist(), strict=True)
    offsets: dict[str, Vector3] = {name: tuple(offset) for name, offset in moved if any(offset)}
    x, y, z = (value / SCALE for value in sim.world.gravity)
    return ReadBack(
        restore_frames(bodies, offsets),
        (x, y, z),
        float(sim.world.integration_parameters.dt),
        sim.document.friction_cone,
        dict(unreadable),
        laws=laws(sim),
    )


def inertial(sim: Simulation, row: int) -> Inertial:
    """The mass properties of a body; nothing of one that is a part of another."""
    if sim.built.carrier[row] not in (-1, row):
        return NO_INERTIA
    held = sim.world.rigid_bodies[sim.built.bodies[row]]
    mass = held.mass_properties
    if not mass.mass:
        return NO_INERTIA
    m = held_tensor(held)
    x, y, z = (value / SCALE for value in mass.local_com)
    return Inertial(mass.mass, (x, y, z), (m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))


def _joint(sim: Simulation, row: int, told: JsonBody, poses: np.ndarray, q: np.ndarray, v: np.ndarray) -> Joint:
    joint = told.joint
    if isinstance(joint, FreeJoint):
        number = sim.free.index(row)
        position, velocity = q[7 * number : 7 * number + 7].tolist(), v[6 * number : 6 * number + 6].tolist()
        angular = frames.rotate(tuple(position[3:]), tuple(velocity[3:]))
        return Joint(joint.name, "free", position=tuple(position), velocity=(*velocity[:3], *angular))
    name = parent_of(joint)
    own = _pose(poses[row])
    if name is not None:
        parent = sim.names.index(name)
        above, own = (
            (sim.built.local[parent], sim.built.local[row])
            if sim.built.carrier[row] >= 0
            else (_pose(poses[parent]), own)
        )
        own = frames.compose(frames.inverse(above), own)
    return Joint(joint.name, joint.kind, name, own)


def _pose(row: np.ndarray) -> Pose:
    return Pose(tuple(row[:3].tolist()), frames.normalise(tuple(row[3:].tolist())))


def _shapes(sim: Simulation, told: JsonBody, numbers: Sequence[int]) -> list[Shape]:
    """The collision shapes as Rapier has them, and what is only seen, which it does not have."""
    found, solid = [], iter(numbers)
    for shape in told.shapes:
        seen = Shape(shape.name, shape.kind, shape.size, shape.pose, collision=False, visual=shape.colour is not None)
        if shape.colour is not None:
            seen = dataclasses.replace(seen, colour=shape.colour)
        if shape.copies:
            held = _solid(sim, next(solid), shape)
            seen = dataclasses.replace(held, visual=seen.visual, colour=seen.colour)
        found.append(seen)
    return found


def _solid(sim: Simulation, number: int, told: JsonShape) -> Shape:
    collider = sim.world.colliders[sim.built.colliders[number]]
    kind = kind_of(collider)
    pose = _pose(pose_of(collider.position_wrt_parent))
    if kind in AXES:
        pose = frames.compose(pose, frames.inverse(AXES[kind]))
    row = sim.built.shapes[number][0]
    if sim.built.carrier[row] >= 0:
        pose = frames.compose(frames.inverse(sim.built.local[row]), pose)
    return Shape(told.name, kind, size_of(collider, kind), pose, visual=False, surfaces=(Surface(),))


def kind_of(collider: Any) -> str:
    """The kind of a collider's shape, as the world names it; Rapier's own name of one that the world does not have."""
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
        case "capsule":
            held = shape.as_capsule()
            return (float(held.radius) / SCALE, 2.0 * float(held.half_height) / SCALE)
        case "cylinder":
            held = shape.as_cylinder()
            return (float(held.radius) / SCALE, 2.0 * float(held.half_height) / SCALE)
        case "mesh":
            return tuple((shape.as_convex_polyhedron().points.astype(float) / SCALE).ravel().tolist())
    return ()


def laws(sim: Simulation) -> tuple[PairContact, ...]:
    """The table of laws. Where one holds for all, it is what Rapier combines the numbers of its colliders to."""
    held = sim.built.laws
    table = held.law_table()
    if held.uniform is not None and sim.built.colliders:
        numbers = {
            material: (collider.friction, collider.restitution)
            for material, handle in zip(held.materials, held.colliders, strict=True)
            for collider in (sim.world.colliders[handle],)
        }
        mean = {
            pair: tuple(0.5 * (a + b) for a, b in zip(*(numbers[name] for name in pair), strict=True))
            for pair in table
            if set(pair) <= set(numbers)
        }
        table = {pair: (*mean[pair], 0.0) if pair in mean else row for pair, row in table.items()}
    return tuple(
        PairContact(one, other, friction, restitution, restitution_threshold=threshold)
        for (one, other), (friction, restitution, threshold) in sorted(table.items())
    )
