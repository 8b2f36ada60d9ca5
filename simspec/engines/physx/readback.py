"""What PhysX says it holds, in the world's frames and order.

Masses, poses, shapes, their numbers, gravity and the timestep are asked of PhysX. Which joints there are, where bodies stand
that are fixed to one that moves (they are that actor), and what is only seen are told by what PhysX was made from.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.engines.physx.building import AXES, NAME, SCALE, held_tensor, pose_of
from simspec.engines.physx.simulation import Simulation
from simspec.errors import EngineError
from simspec.formats.kit.contract import restore_frames
from simspec.formats.world.tree import FreeJoint, JsonBody, JsonShape, parent_of
from simspec.world import frames
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, Inertial, Joint, Pose, ReadBack, Shape, Surface, Vector3

PREFIX = "PhysxCollisionShape"
KINDS = {"Sphere": "sphere", "Box": "box", "Capsule": "capsule", "Plane": "plane", "ConvexMesh": "mesh"}
"""SAPIEN's names of types of shapes."""


def read_back(sim: Simulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as PhysX holds it, and its present state."""
    copies: dict[tuple[int, str], list[int]] = {}
    for number, unit in enumerate(sim.built.units):
        copies.setdefault((unit.body, unit.shape.name), []).append(number)
    q, v = sim.get_state()
    poses, _ = sim.file_frames()
    bodies = tuple(
        Body(
            told.name,
            told.model,
            inertial(sim, row),
            _joint(sim, row, told, poses, q, v),
            tuple(_shape(sim, row, shape, copies.get((row, shape.name), [])) for shape in told.shapes),
        )
        for row, told in enumerate(sim.document.bodies)
    )
    moved = zip(sim.names, sim.offsets.tolist(), strict=True)
    offsets: dict[str, Vector3] = {name: tuple(offset) for name, offset in moved if any(offset)}
    x, y, z = sim.gravity.tolist()
    timestep = float(sim.built.system.timestep)
    return ReadBack(restore_frames(bodies, offsets), (x, y, z), timestep, sim.document.friction_cone, dict(unreadable))


def inertial(sim: Simulation, row: int) -> Inertial:
    """The mass properties of a body; nothing of one that cannot move, or is a part of another."""
    if sim.built.carrier[row] != row:
        return NO_INERTIA
    held = sim.built.actors[row]
    m, (x, y, z) = held_tensor(held), (np.array(held.cmass_local_pose.p, dtype=float) / SCALE).tolist()
    return Inertial(held.mass, (x, y, z), (m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))


def _joint(sim: Simulation, row: int, told: JsonBody, poses: np.ndarray, q: np.ndarray, v: np.ndarray) -> Joint:
    joint = told.joint
    if isinstance(joint, FreeJoint):
        number = sim.number[row]
        position, velocity = q[7 * number : 7 * number + 7].tolist(), v[6 * number : 6 * number + 6].tolist()
        angular = frames.rotate(tuple(position[3:]), tuple(velocity[3:]))
        return Joint(joint.name, "free", position=tuple(position), velocity=(*velocity[:3], *angular))
    name = parent_of(joint)
    own = _pose(poses[row])
    if name is not None:
        parent = sim.names.index(name)
        above = _pose(poses[parent])
        if sim.built.carrier[row] >= 0:
            above, own = sim.built.local[parent], sim.built.local[row]
        own = frames.compose(frames.inverse(above), own)
    return Joint(joint.name, joint.kind, name, own)


def _pose(row: np.ndarray) -> Pose:
    return Pose(tuple(row[:3].tolist()), frames.normalise(tuple(row[3:].tolist())))


def _shape(sim: Simulation, row: int, told: JsonShape, numbers: Sequence[int]) -> Shape:
    """A collision shape as PhysX has it, and what is only seen, which it does not have."""
    seen = Shape(told.name, told.kind, told.size, told.pose, collision=False, visual=told.colour is not None)
    if told.colour is not None:
        seen = dataclasses.replace(seen, colour=told.colour)
    if not numbers:
        return seen
    held = [sim.built.shapes[number] for number in numbers]
    like = [(kind_of(one), size_of(one), pose_of(one.local_pose)) for one in held]
    if any(one != like[0] for one in like):
        raise EngineError(NAME, f"holds copies of {told.name!r} that differ")
    kind, size, pose = like[0]
    if kind in AXES:
        pose = frames.compose(pose, frames.inverse(AXES[kind]))
    if sim.built.carrier[row] >= 0:
        pose = frames.compose(frames.inverse(sim.built.local[row]), pose)
    surfaces = tuple(Surface(surface_of(one)[0], restitution=surface_of(one)[1]) for one in held)
    return dataclasses.replace(seen, kind=kind, size=size, pose=pose, collision=True, surfaces=surfaces)


def surface_of(shape: Any) -> tuple[float, float]:
    """Sliding friction and restitution of a shape."""
    held = shape.physical_material
    return held.dynamic_friction, held.restitution


def kind_of(shape: Any) -> str:
    """The kind of a shape, as the world names it; SAPIEN's own name of one that the world does not have."""
    name = type(shape).__name__.removeprefix(PREFIX)
    return KINDS.get(name, name)


def size_of(shape: Any) -> tuple[float, ...]:
    """The size of a shape as the world has it."""
    match kind_of(shape):
        case "sphere":
            return (float(shape.radius) / SCALE,)
        case "box":
            x, y, z = (2.0 * float(half) / SCALE for half in shape.half_size)
            return (x, y, z)
        case "capsule":
            return (float(shape.radius) / SCALE, 2.0 * float(shape.half_length) / SCALE)
        case "mesh":
            return tuple((np.array(shape.vertices, dtype=float) * shape.scale / SCALE).ravel().tolist())
    return ()
