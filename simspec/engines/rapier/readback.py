"""The model as Rapier stores it, in the world's frames and order.

Masses, poses, shapes, gravity and the timestep are queried. The joints, the poses of bodies that are parts of others, visual
shapes and the laws of materials are those that Rapier was built from.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from simspec.engines.kit.world_simulation import visual_shape
from simspec.engines.rapier.building import AXES, SCALE
from simspec.engines.rapier.simulation import Simulation, inertia_of, pose_of
from simspec.world import frames
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, Inertial, PairContact, ReadBack, Shape, Surface

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
    """The model as Rapier stores it, and its present state."""
    solid = {(one.owner.row, one.place): one.number for one in sim.walk.shapes}
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
        )
        for row, (body, joint) in enumerate(zip(sim.document.bodies, sim.joints(), strict=True))
    ]
    x, y, z = (value / SCALE for value in sim.world.gravity)
    timestep = float(sim.world.integration_parameters.dt)
    return sim.model(bodies, (x, y, z), timestep, unreadable, laws=laws(sim))


def inertial(sim: Simulation, row: int) -> Inertial:
    """The mass properties of a body; nothing of a part of another body."""
    if sim.walk.bodies[row].carrier not in (-1, row):
        return NO_INERTIA
    body = sim.world.rigid_bodies[sim.built.bodies[row]]
    mass = body.mass_properties
    if not mass.mass:
        return NO_INERTIA
    m = inertia_of(body)
    x, y, z = (value / SCALE for value in mass.local_com)
    return Inertial(mass.mass, (x, y, z), (m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))


def _shape(sim: Simulation, number: int) -> Shape:
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


def laws(sim: Simulation) -> tuple[PairContact, ...]:
    """The table of laws; the numbers of a uniform law are the means of those of the colliders, as Rapier combines them."""
    hook = sim.built.laws
    found = {pair: row for pair, row in hook.table.items() if pair[0] <= pair[1]}
    if hook.uniform is not None and hook.colliders:
        colliders = {name: sim.world.colliders[one] for name, one in zip(hook.materials, hook.colliders, strict=True)}
        for pair in found:
            if set(pair) <= set(colliders):
                one, other = (colliders[name] for name in pair)
                friction, restitution = one.friction + other.friction, one.restitution + other.restitution
                found[pair] = (0.5 * friction, 0.5 * restitution, 0.0)
    return tuple(
        PairContact(one, other, friction, restitution, restitution_threshold=threshold)
        for (one, other), (friction, restitution, threshold) in sorted(found.items())
    )
