"""The smallest shape of a world, and the heaviest body that can touch something: sizes that bound solver settings."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simspec.world.derived import derived
from simspec.world.kinematics import rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import World


@dataclass(frozen=True, slots=True)
class Thinnest:
    """A collision shape by its body, its place among the body's shapes, and its inner radius (m)."""

    body: str
    index: int
    inner: float


@derived
def thinnest(world: World) -> Thinnest | None:
    """The collision shape of the least inner radius; None where all have no end, or there are none."""
    shapes = [
        Thinnest(body.name, index, SHAPES[shape.kind].inner_radius(shape.size))
        for body in world.bodies
        for index, shape in enumerate(body.shapes)
        if shape.collision
    ]
    finite = [one for one in shapes if 0.0 < one.inner < math.inf]
    return min(finite, key=lambda one: one.inner, default=None)


@derived
def heaviest(world: World) -> tuple[str, float] | None:
    """The name and mass (kg) of the heaviest rigid body that moves and can touch something; None where there is none. Kinematic
    bodies, which no contact moves, are left out."""
    groups, kinematic = rigid_groups(world), {motion.body for motion in world.motions}
    masses: dict[str, float] = {}
    solid: set[str] = set()
    for body in world.bodies:
        group = groups[body.name]
        if group == "world" or group in kinematic:
            continue
        masses[group] = masses.get(group, 0.0) + body.inertial.mass
        if any(shape.collision for shape in body.shapes):
            solid.add(group)
    touching = [(mass, name) for name, mass in masses.items() if name in solid and mass]
    if not touching:
        return None
    mass, name = max(touching)
    return name, mass
