"""Volume, centre of mass and inertia of what a closed surface of triangles encloses, and its principal axes.

Formulas: the integrals of 1, x and x xᵀ over the tetrahedra between a point and each triangle. Sums are correctly rounded
(``math.fsum``) and products are numpy's element by element, so that the bits are the same on every machine and whatever the
order of the triangles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.world import frames
from simspec.world.types import Pose, Vector3

Points = NDArray[np.float64]
Triangles = NDArray[np.int64]
Row3 = list[float]

DIAGONAL = 1e-14
"""Share of the trace below which a product of inertia is round-off: a cube's axes are its own then, not those of the noise."""
SWEEPS = 30
"""Sweeps of Jacobi's method, which needs five for any 3 x 3 matrix."""


@dataclass(frozen=True, slots=True)
class Solid:
    """What is enclosed, at density 1: its volume (m³; negative where triangles are wound inwards), and the frame in its centre
    of mass along its principal axes, with the principal moments (m⁵) about them."""

    volume: float
    frame: Pose
    moments: Vector3


def solid(points: Points, triangles: Triangles) -> Solid:
    """The solid within a closed surface: ``points`` (n, 3) in m, ``triangles`` (m, 3) of their indices, anticlockwise as seen
    from outside. Raises ValueError where the volume is zero, or no number."""
    origin = 0.5 * (points.min(axis=0) + points.max(axis=0))  # near all of them, so that no digits cancel
    corners = (points - origin)[triangles]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (corners[:, k].T for k in range(3))
    six_fold = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    volume = math.fsum(six_fold) / 6.0
    if not math.isfinite(volume) or volume == 0.0:
        raise ValueError("the triangles enclose no volume")
    sx, sy, sz = ax + bx + cx, ay + by + cy, az + bz + cz
    centre = tuple(math.fsum(six_fold * s) / 24.0 / volume for s in (sx, sy, sz))

    def second(i: int, j: int) -> float:
        """∫ x_i x_j about the centre of mass."""
        first_i, first_j = corners[:, 0, i], corners[:, 0, j]
        others = corners[:, 1, i] * corners[:, 1, j] + corners[:, 2, i] * corners[:, 2, j]
        sums = (sx, sy, sz)[i] * (sx, sy, sz)[j]
        about_origin = math.fsum(six_fold * (first_i * first_j + others + sums)) / 120.0
        return about_origin - volume * centre[i] * centre[j]

    xx, yy, zz, xy, xz, yz = (second(i, j) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    tensor = [[yy + zz, -xy, -xz], [-xy, xx + zz, -yz], [-xz, -yz, xx + yy]]
    moments, axes = principal(tensor)
    x, y, z = (float(origin[k]) + centre[k] for k in range(3))
    return Solid(volume, Pose((x, y, z), frames.from_matrix(axes)), moments)


def principal(tensor: list[Row3]) -> tuple[Vector3, frames.Matrix3]:
    """Principal moments of a symmetric tensor, and the rotation matrix whose columns are their axes: those nearest to x, y, z,
    and exactly these where the tensor is diagonal but for round-off. Jacobi's method, in plain floats."""
    a = [list(row) for row in tensor]
    turn = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    small = DIAGONAL * (abs(a[0][0]) + abs(a[1][1]) + abs(a[2][2]))
    for _ in range(SWEEPS):
        if max(abs(a[0][1]), abs(a[0][2]), abs(a[1][2])) <= small:
            break
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if abs(a[p][q]) <= 1e-3 * small:
                continue
            ratio = (a[q][q] - a[p][p]) / (2.0 * a[p][q])
            tangent = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
            cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
            sine = tangent * cosine
            for row in (*a, *turn):
                row[p], row[q] = cosine * row[p] - sine * row[q], sine * row[p] + cosine * row[q]
            a[p], a[q] = (
                [cosine * x - sine * y for x, y in zip(a[p], a[q], strict=True)],
                [sine * x + cosine * y for x, y in zip(a[p], a[q], strict=True)],
            )
    columns = ((turn[0][0], turn[0][1], turn[0][2]), (turn[1][0], turn[1][1], turn[1][2]))
    last = frames.cross(columns[0], columns[1])  # rows of a rotation: the third is the product of the others
    return (a[0][0], a[1][1], a[2][2]), (*columns, last)
