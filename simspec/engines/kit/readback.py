"""Values of engines' APIs, in the types of the world: vectors, poses, inertias, limits, shapes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from simspec.world import frames
from simspec.world.types import Inertial, Pose, Shape, Vector3


def vector(values: Any) -> Vector3:
    """Three numbers, without negative zeros."""
    x, y, z = np.asarray(values, dtype=float).tolist()
    return (x + 0.0, y + 0.0, z + 0.0)


def pose_of(position: Any, rotation: np.ndarray) -> Pose:
    """A pose of a position and a rotation matrix (3, 3)."""
    return Pose(vector(position), frames.from_matrix(tuple(map(tuple, rotation.tolist()))))  # type: ignore[arg-type]


def inertial_of(mass: float, centre: Any, moments: np.ndarray) -> Inertial:
    """Mass properties with the moments (3, 3) about the centre of mass."""
    m = np.asarray(moments).tolist()
    return Inertial(float(mass), vector(centre), (m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2]))


def bound(value: float) -> float | None:
    """A limit, None where it is infinite."""
    return float(value) if math.isfinite(value) else None


def range_of(lower: float, upper: float) -> tuple[float, float] | None:
    """The limits of a position, None where both are infinite."""
    return (float(lower), float(upper)) if math.isfinite(lower) or math.isfinite(upper) else None


def alike(first: Shape, second: Shape) -> bool:
    return (first.kind, first.size, first.pose) == (second.kind, second.size, second.pose)


def merged(shapes: Iterable[Shape], same: Callable[[Shape, Shape], bool] = alike) -> list[Shape]:
    """Shapes of one name: those that are the ``same`` are one, with the surfaces of its copies and the colour of the visual."""
    kept: list[Shape] = []
    for shape in shapes:
        row = next((row for row, other in enumerate(kept) if same(other, shape)), None)
        if row is None:
            kept.append(shape)
            continue
        other = kept[row]
        kept[row] = dataclasses.replace(
            other,
            collision=other.collision or shape.collision,
            visual=other.visual or shape.visual,
            colour=(other if other.visual else shape).colour,
            surfaces=other.surfaces + shape.surfaces,
        )
    return kept
