"""The model as PhysX stores it, in the world's frames and order.

Masses, poses, shapes and their numbers, controllers, gravity and the timestep are queried. The joints, the poses of bodies that
are parts of others, and visual shapes are those that PhysX was built from.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.engines.kit.building import ShapeUnit
from simspec.engines.kit.world_simulation import visual_shape
from simspec.engines.physx.building import AXES
from simspec.engines.physx.cylinders import cylinder_size, is_scaled
from simspec.engines.physx.jointed import joints
from simspec.engines.physx.servos import servos
from simspec.engines.physx.simulation import PhysxSimulation
from simspec.engines.physx.units import NAME, SCALE, inertia_of, pose_of
from simspec.errors import EngineError
from simspec.world import frames
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, Inertial, ReadBack, Shape, Surface

PREFIX = "PhysxCollisionShape"
KINDS = {"Sphere": "sphere", "Box": "box", "Capsule": "capsule", "Plane": "plane", "ConvexMesh": "mesh"}
"""SAPIEN's names of types of shapes."""


def read_back(sim: PhysxSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as PhysX stores it, and its present state."""
    copies: dict[tuple[int, int], list[ShapeUnit]] = {}
    for unit in sim.walk.units:
        copies.setdefault((unit.of.owner.row, unit.of.place), []).append(unit)
    bodies = []
    for row, (body, joint) in enumerate(zip(sim.document.bodies, joints(sim), strict=True)):
        shapes = tuple(
            _shape(sim, copies[row, place]) if (row, place) in copies else visual_shape(shape)
            for place, shape in enumerate(body.shapes)
        )
        bodies.append(Body(body.name, body.model, inertial(sim, row), joint, shapes))
    x, y, z = sim.gravity.tolist()
    found = sim.model(bodies, (x, y, z), float(sim.built.system.timestep), unreadable)
    return dataclasses.replace(found, servos=servos(sim))


def inertial(sim: PhysxSimulation, row: int) -> Inertial:
    """The mass properties of a body; nothing of a static body or a part of another."""
    if not sim.walk.bodies[row].moves or sim.built.homes.of[row].row != row or not sim.document.bodies[row].mass:
        return NO_INERTIA
    actor = sim.built.actors[row]
    m, (x, y, z) = inertia_of(actor), (np.array(actor.cmass_local_pose.p, dtype=float) / SCALE).tolist()
    return Inertial(actor.mass, (x, y, z), (m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))


def _shape(sim: PhysxSimulation, units: Sequence[ShapeUnit]) -> Shape:
    """A collision shape as PhysX stores its copies, with the visual part of the file."""
    solid, copies = units[0].of, [sim.built.shapes[unit.number] for unit in units]
    forms = [(kind_of(copy), size_of(copy), pose_of(copy.local_pose)) for copy in copies]
    if any(form != forms[0] for form in forms):
        raise EngineError(NAME, f"holds copies of {solid.shape.name!r} that differ")
    kind, size, pose = forms[0]
    if kind in AXES:
        pose = frames.compose(pose, frames.inverse(AXES[kind]))
    pose = frames.compose(frames.inverse(sim.built.homes.of[solid.owner.row].pose), pose)
    materials = [copy.physical_material for copy in copies]
    surfaces = tuple(Surface(material.dynamic_friction, restitution=material.restitution) for material in materials)
    visual = visual_shape(solid.shape)
    return dataclasses.replace(visual, kind=kind, size=size, pose=pose, collision=True, surfaces=surfaces)


def kind_of(shape: Any) -> str:
    """The kind of a shape by the world's name; SAPIEN's name of a kind that the world does not have."""
    name = type(shape).__name__.removeprefix(PREFIX)
    kind = KINDS.get(name, name)
    return "cylinder" if kind == "mesh" and is_scaled(shape) and cylinder_size(shape) else kind


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
        case "cylinder":
            return tuple(part / SCALE for part in cylinder_size(shape) or ())
        case "mesh":
            return tuple((np.array(shape.vertices, dtype=float) * shape.scale / SCALE).ravel().tolist())
    return ()
