"""Mass properties of bodies made of solid shapes (``world/shapes.py``); plain floats, the same bits on every machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from simspec.world import frames
from simspec.world.shapes import SHAPES
from simspec.world.types import Inertial, Pose, Quaternion, Vector3

Inertia6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Part:
    """A solid of a body: its mass, the pose of its centre and principal axes in the body frame, its moments there."""

    mass: float
    pose: Pose
    moments: Vector3


def part(kind: str, size: Sequence[float], pose: Pose, mass: float) -> Part:
    """A shape of ``mass`` at ``pose`` in the body frame."""
    return Part(mass, pose, SHAPES[kind].moments(size, mass))


def turned(principal: Vector3, turn: Quaternion) -> Inertia6:
    """The tensor (xx, yy, zz, xy, xz, yz) in body axes of principal moments about axes turned by ``turn``."""
    return frames.rotate_inertia(turn, (*principal, 0.0, 0.0, 0.0))


def combined(parts: Sequence[Part], mass: float | None = None) -> Inertial:
    """The mass properties of a body made of ``parts`` (at least one with mass): sums by the parallel-axis theorem.

    ``mass``: the total, where it is known better than as the sum of the parts' rounded masses.
    """
    # no sum(): from Python 3.12 on it compensates, and would give other last bits
    total, weighted = 0.0, (0.0, 0.0, 0.0)
    for part in parts:
        x, y, z = part.pose.position
        total += part.mass
        weighted = frames.add(weighted, (part.mass * x, part.mass * y, part.mass * z))
    if len(parts) == 1:
        centre = parts[0].pose.position
    else:
        centre = (weighted[0] / total, weighted[1] / total, weighted[2] / total)
    sums = [0.0] * 6
    for part in parts:
        x, y, z = frames.subtract(part.pose.position, centre)
        m = part.mass
        steiner = (m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y), -m * x * y, -m * x * z, -m * y * z)
        own = turned(part.moments, part.pose.quaternion)
        sums = [total_one + a + b for total_one, a, b in zip(sums, own, steiner, strict=True)]
    inertia: Inertia6 = tuple(value + 0.0 for value in sums)  # type: ignore[assignment] # −0 becomes 0
    return Inertial(total if mass is None else mass, centre, inertia)
