"""Mass properties of solid shapes, and of bodies made of them; plain floats, the same bits on every machine.

Formulas: any table of moments of inertia of homogeneous solids; the capsule is a cylinder and two half balls, whose own
centres are 3/8 of the radius beyond the cylinder's ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from simspec.world import frames
from simspec.world.types import Inertial, Pose, Vector3

Inertia6 = tuple[float, float, float, float, float, float]


def volume(kind: str, size: Sequence[float]) -> float:
    """The volume (m³) of a shape of :data:`simspec.world.types.SHAPE_KINDS`; 0 for a plane."""
    if kind == "sphere":
        return 4.0 / 3.0 * math.pi * size[0] * size[0] * size[0]
    if kind == "box":
        return size[0] * size[1] * size[2]
    if kind == "cylinder":
        return math.pi * size[0] * size[0] * size[1]
    if kind == "capsule":
        return math.pi * size[0] * size[0] * size[1] + 4.0 / 3.0 * math.pi * size[0] * size[0] * size[0]
    if kind == "ellipsoid":
        return 4.0 / 3.0 * math.pi * size[0] * size[1] * size[2]
    if kind == "plane":
        return 0.0
    raise ValueError(f"no shape of kind {kind!r}")


def moments(kind: str, size: Sequence[float], mass: float) -> Vector3:
    """The principal moments (kg m²) of a solid shape of ``mass`` about its centre, about the shape's own x, y, z axes."""
    if kind == "sphere":
        moment = 0.4 * mass * size[0] * size[0]
        return (moment, moment, moment)
    if kind == "box":
        xx, yy, zz = (edge * edge for edge in size)
        return (mass * (yy + zz) / 12.0, mass * (xx + zz) / 12.0, mass * (xx + yy) / 12.0)
    if kind == "cylinder":
        radius, length = size
        across = mass * (3.0 * radius * radius + length * length) / 12.0
        return (across, across, 0.5 * mass * radius * radius)
    if kind == "capsule":
        radius, length = size
        # shares of the volume, divided by π r²: the cylinder has L, the two half balls together 4/3 r
        tube = mass * length / (length + 4.0 / 3.0 * radius)
        ends = mass - tube
        across = tube * (3.0 * radius * radius + length * length) / 12.0 + ends * (
            0.4 * radius * radius + 0.25 * length * length + 0.375 * length * radius
        )
        return (across, across, 0.5 * tube * radius * radius + 0.4 * ends * radius * radius)
    if kind == "ellipsoid":
        xx, yy, zz = (axis * axis for axis in size)
        return (mass * (yy + zz) / 5.0, mass * (xx + zz) / 5.0, mass * (xx + yy) / 5.0)
    raise ValueError(f"a shape of kind {kind!r} has no moments")


@dataclass(frozen=True, slots=True)
class Part:
    """A solid of a body: its mass, the pose of its centre and principal axes in the body frame, its moments there."""

    mass: float
    pose: Pose
    moments: Vector3


def part(kind: str, size: Sequence[float], pose: Pose, mass: float) -> Part:
    """A shape of ``mass`` at ``pose`` in the body frame."""
    return Part(mass, pose, moments(kind, size, mass))


def turned(principal: Vector3, turn: frames.Quaternion) -> Inertia6:
    """The tensor (xx, yy, zz, xy, xz, yz) in body axes of principal moments about axes turned by ``turn``."""
    return frames.turn_inertia(turn, (*principal, 0.0, 0.0, 0.0))


def combined(parts: Sequence[Part], mass: float | None = None) -> Inertial:
    """The mass properties of a body made of ``parts`` (at least one with mass): sums by the parallel-axis theorem.

    ``mass``: the total, where it is known better than as the sum of the parts' rounded masses.
    """
    # no sum(): from Python 3.12 on it compensates, and would give other last bits
    total, weighted = 0.0, (0.0, 0.0, 0.0)
    for one in parts:
        x, y, z = one.pose.position
        total += one.mass
        weighted = frames.add(weighted, (one.mass * x, one.mass * y, one.mass * z))
    if len(parts) == 1:
        centre = parts[0].pose.position
    else:
        centre = (weighted[0] / total, weighted[1] / total, weighted[2] / total)
    sums = [0.0] * 6
    for one in parts:
        x, y, z = frames.subtract(one.pose.position, centre)
        m = one.mass
        steiner = (m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y), -m * x * y, -m * x * z, -m * y * z)
        own = turned(one.moments, one.pose.quaternion)
        sums = [total_one + a + b for total_one, a, b in zip(sums, own, steiner, strict=True)]
    inertia: Inertia6 = tuple(value + 0.0 for value in sums)  # type: ignore[assignment] # −0 becomes 0
    return Inertial(total if mass is None else mass, centre, inertia)
