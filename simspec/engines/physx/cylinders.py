"""Cylinders in PhysX, which has none: prisms of :data:`SIDES` sides along z.

Radii of a prism's corners and of the middles of its faces are as far outside the cylinder as they are inside.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

SIDES = 64
"""PhysX keeps all corners up to 96 sides (measured), and each side costs time."""
UNEVEN = 1e-5
"""Share of the radius and length by which a prism's corners may be off their places: roundings to singles."""


def corner_radius(sides: int) -> float:
    """The radius of the corners of a prism that stands for a cylinder of radius 1."""
    return 2.0 / (1.0 + math.cos(math.pi / sides))


def shortfall() -> float:
    """Share of the radius by which corners are outside the cylinder, and middles of faces inside."""
    return corner_radius(SIDES) - 1.0


def unit_prism() -> np.ndarray:
    """The corners (2 n, 3) of the prism for the cylinder of radius 1 and length 2."""
    angles = 2.0 * math.pi * np.arange(SIDES) / SIDES
    ring = corner_radius(SIDES) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = [np.column_stack([ring, np.full(SIDES, end)]) for end in (-1.0, 1.0)]
    return np.concatenate(ends).astype(np.float32)


def prism(physx: Any, radius: float, length: float, material: Any) -> Any:
    """A shape of PhysX for a cylinder; ``radius`` and ``length`` in PhysX's unit. A scaled hull is a cylinder for the
    read-back; other hulls have the scale 1."""
    scale = np.array([radius, radius, 0.5 * length], dtype=np.float32)
    return physx.PhysxCollisionShapeConvexMesh(unit_prism(), scale, material)


def is_scaled(shape: Any) -> bool:
    """Whether a hull has a scale, as those of cylinders have."""
    return bool((np.array(shape.scale, dtype=float) != 1.0).any())


def cylinder_size(shape: Any) -> tuple[float, float] | None:
    """Radius and length, in PhysX's unit, of the cylinder that a hull stands for; None of a hull that is no regular prism
    along z."""
    corners = np.array(shape.vertices, dtype=float) * np.array(shape.scale, dtype=float)
    half = float(np.abs(corners[:, 2]).max())
    radii, sides = np.linalg.norm(corners[:, :2], axis=1), len(corners) // 2
    radius = float(radii.mean())
    turns = np.sort(np.arctan2(corners[:, 1], corners[:, 0]) % (2.0 * math.pi))
    places = np.repeat(np.arange(sides), 2) * 2.0 * math.pi / sides
    off = np.abs((turns - places + math.pi) % (2.0 * math.pi) - math.pi)
    even = (
        len(corners) == 2 * sides >= 6
        and np.abs(radii - radius).max() <= UNEVEN * radius
        and np.abs(np.abs(corners[:, 2]) - half).max() <= UNEVEN * half
        and (corners[:, 2] > 0.0).sum() == sides
        and off.max() <= UNEVEN
    )
    return (radius / corner_radius(sides), 2.0 * half) if even else None
