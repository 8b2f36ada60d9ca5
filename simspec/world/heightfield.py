"""Height fields: the one meaning of uneven ground in a world.

The size of a shape of kind ``heightfield`` is flat: rows, columns, the lengths along x and y (m), the ``base`` (m), and the
heights (m), row by row. The first row is at the least y, the first height of a row at the least x; the lowest height is 0, so
that the frame's origin is at the middle of the rectangle, at the level of the lowest point. Each cell is two triangles that
meet along the diagonal from (row, column) to (row + 1, column + 1); what is below them is solid down to z = −base.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Triangles = NDArray[np.int64]

HEAD = 5
"""Numbers of a size before its heights."""
FEWEST = 2
"""Rows, and columns, of the smallest field."""
KEPT = 64
"""Fields whose arrays are remembered."""


@dataclass(frozen=True)
class Field:
    """``heights`` (rows, columns) in m over a rectangle ``x`` × ``y`` (m), and how far (m) below zero it is solid."""

    x: float
    y: float
    base: float
    heights: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.heights.shape
        return rows, columns

    @functools.cached_property
    def points(self) -> Array:
        """The points of the surface (rows × columns, 3), row by row."""
        rows, columns = self.shape
        x, y = _even(self.x, columns), _even(self.y, rows)
        return np.stack([np.tile(x, rows), np.repeat(y, columns), self.heights.ravel()], axis=1)

    @functools.cached_property
    def triangles(self) -> Triangles:
        """The triangles of the surface (2 × cells, 3), indices of ``points``, anticlockwise as seen from above: of each cell
        the one at its least y, then the one at its greatest."""
        rows, columns = self.shape
        first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        low = np.stack([first, first + 1, first + columns + 1], axis=1)
        high = np.stack([first, first + columns + 1, first + columns], axis=1)
        return np.stack([low, high], axis=1).reshape(-1, 3)

    @functools.cached_property
    def normals(self) -> Array:
        """The upward unit normals (2 × cells, 3) of the triangles."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        across = np.cross(b - a, c - a)
        made: Array = across / np.linalg.norm(across, axis=1, keepdims=True)
        return made

    @functools.cached_property
    def span(self) -> float:
        """The height (m) of the highest point over the lowest."""
        return float(self.heights.max())

    @property
    def extent(self) -> float:
        """The largest extent (m) of its surface along x, y and z."""
        return max(self.x, self.y, self.span)

    def prism(self, triangle: int) -> Array:
        """The corners (6, 3) of the solid below one triangle: the triangle, then what is below its corners at the base."""
        top = self.points[self.triangles[triangle]]
        below = top.copy()
        below[:, 2] = -self.base
        return np.concatenate([top, below])

    def closed(self) -> tuple[Array, Triangles]:
        """The whole boundary: its points (n, 3), first those of the surface, then those of its rim at the base and the middle
        of the bottom; its triangles (m, 3), anticlockwise as seen from outside, those of the surface first."""
        rows, columns = self.shape
        rim = np.concatenate(
            [
                np.arange(columns),
                columns * np.arange(1, rows) + columns - 1,
                columns * rows - 1 - np.arange(1, columns),
                columns * np.arange(rows - 2, 0, -1),
            ]
        )
        feet = self.points[rim].copy()
        feet[:, 2] = -self.base
        middle = len(self.points) + len(rim)
        foot = len(self.points) + np.arange(len(rim))
        after, foot_after = np.roll(rim, -1), np.roll(foot, -1)
        walls = np.concatenate([np.stack([rim, foot, foot_after], axis=1), np.stack([rim, foot_after, after], axis=1)])
        bottom = np.stack([np.full(len(rim), middle), foot_after, foot], axis=1)
        points = np.concatenate([self.points, feet, [[0.0, 0.0, -self.base]]])
        return points, np.concatenate([self.triangles, walls, bottom])


def _even(length: float, count: int) -> Array:
    return length * (np.arange(count) / (count - 1) - 0.5)


@functools.lru_cache(maxsize=KEPT)
def _field_of(size: tuple[float, ...]) -> Field:
    rows, columns = int(size[0]), int(size[1])
    return Field(size[2], size[3], size[4], np.array(size[HEAD:], np.float64).reshape(rows, columns))


def field_of(size: Sequence[float]) -> Field:
    """The height field of a size: the same object for the same size."""
    return _field_of(tuple(size))


def size_of(x: float, y: float, base: float, heights: Array) -> tuple[float, ...]:
    """The size of a height field, from its ``heights`` (rows, columns), of which the lowest should be 0."""
    rows, columns = heights.shape
    return (float(rows), float(columns), float(x), float(y), float(base), *(heights + 0.0).ravel().tolist())


def fault_of(size: Sequence[float]) -> str | None:
    """What is wrong with the numbers of a size; None where nothing is."""
    if len(size) < HEAD:
        return f"has {len(size)} entries, should have rows, columns, x, y, base, and the heights"
    rows, columns, *lengths = size[:HEAD]
    if not all(math.isfinite(value) and value == int(value) and value >= FEWEST for value in (rows, columns)):
        return f"has {rows:g} rows and {columns:g} columns, should have at least {FEWEST} of each"
    if len(size) != HEAD + int(rows) * int(columns):
        return f"has {len(size) - HEAD} heights, should have {rows:g} × {columns:g}"
    if not all(math.isfinite(value) and value > 0.0 for value in lengths):
        return "has lengths and a base that are not all above zero"
    if not all(map(math.isfinite, size[HEAD:])):
        return "has heights that are not finite"
    return None


def inner_radius(size: Sequence[float]) -> float:
    """The radius (m) of a ball that has room below every triangle: within it as seen from above, and half the base."""
    field = field_of(size)
    rows, columns = field.shape
    along, across = field.x / (columns - 1), field.y / (rows - 1)
    return min(0.5 * (along + across - math.hypot(along, across)), 0.5 * field.base)


def outer_radius(size: Sequence[float]) -> float:
    """The radius (m) of the smallest sphere about its frame's origin that holds it."""
    field = field_of(size)
    corner = math.hypot(0.5 * field.x, 0.5 * field.y)
    highest = math.sqrt(float((field.points**2).sum(axis=1).max()))
    return max(math.hypot(corner, field.base), highest)


def volume(size: Sequence[float]) -> float:
    """The volume (m³) of what is solid: below each triangle the mean of its heights, over half a cell."""
    field = field_of(size)
    rows, columns = field.shape
    below = math.fsum(field.heights.ravel()[field.triangles].ravel().tolist()) / 3.0
    cell = field.x * field.y / ((rows - 1) * (columns - 1))
    return 0.5 * cell * below + field.x * field.y * field.base


def support(size: Sequence[float], local: Array) -> Array:
    """How far (m) (n,) it reaches along unit vectors (n, 3), as its convex hull does."""
    field = field_of(size)
    corners = np.array([(sx * field.x / 2.0, sy * field.y / 2.0, -field.base) for sx in (-1, 1) for sy in (-1, 1)])
    reach: Array = (local @ np.concatenate([field.points, corners]).T).max(axis=1)
    return reach
