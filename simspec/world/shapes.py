"""The kinds of shapes: one row for each, with all that follows from a kind and its size alone.

Sizes are those of ``Shape.size``, in metres, named by ``sizes``. Every kind but plane and height field is convex; its frame's
origin is its centre of mass. Volume and moments are plain floats, the same bits on every machine. Formulas: any table of
moments of inertia of homogeneous solids; the capsule is a cylinder and two half balls, whose own centres are 3/8 of the radius
beyond the cylinder's ends.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from simspec.world import hull

# Height fields: the one meaning of uneven ground in a world.
#
# The size of a shape of kind ``heightfield`` is flat: rows, columns, the lengths along x and y (m), the ``base`` (m), and the
# heights (m), row by row. The first row is at the least y, the first height of a row at the least x; the lowest height is 0, so
# that the frame's origin is at the middle of the rectangle, at the level of the lowest point. Each cell is two triangles that
# meet along the diagonal from (row, column) to (row + 1, column + 1); the space below them is solid down to z = −base.

Array = NDArray[np.float64]
Triangles = NDArray[np.int64]

HEIGHTFIELD_HEAD = 5
"""Numbers of a size before its heights."""
FEWEST_ROWS = 2
"""Rows, and columns, of the smallest field."""
CACHED_FIELDS = 64
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
        x, y = _evenly_spaced(self.x, columns), _evenly_spaced(self.y, rows)
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


def _evenly_spaced(length: float, count: int) -> Array:
    return length * (np.arange(count) / (count - 1) - 0.5)


@functools.lru_cache(maxsize=CACHED_FIELDS)
def _field_of(size: tuple[float, ...]) -> Field:
    rows, columns = int(size[0]), int(size[1])
    return Field(size[2], size[3], size[4], np.array(size[HEIGHTFIELD_HEAD:], np.float64).reshape(rows, columns))


def field_of(size: Sequence[float]) -> Field:
    """The height field of a size: the same object for the same size."""
    return _field_of(tuple(size))


def heightfield_size(x: float, y: float, base: float, heights: Array) -> tuple[float, ...]:
    """The size of a height field, from its ``heights`` (rows, columns), of which the lowest should be 0."""
    rows, columns = heights.shape
    return (float(rows), float(columns), float(x), float(y), float(base), *(heights + 0.0).ravel().tolist())


def heightfield_fault(size: Sequence[float]) -> str | None:
    """The fault in the numbers of a size; None where there is none."""
    if len(size) < HEIGHTFIELD_HEAD:
        return f"has {len(size)} entries, should have rows, columns, x, y, base, and the heights"
    rows, columns, *lengths = size[:HEIGHTFIELD_HEAD]
    if not all(math.isfinite(value) and value == int(value) and value >= FEWEST_ROWS for value in (rows, columns)):
        return f"has {rows:g} rows and {columns:g} columns, should have at least {FEWEST_ROWS} of each"
    if len(size) != HEIGHTFIELD_HEAD + int(rows) * int(columns):
        return f"has {len(size) - HEIGHTFIELD_HEAD} heights, should have {rows:g} × {columns:g}"
    if not all(math.isfinite(value) and value > 0.0 for value in lengths):
        return "has lengths and a base that are not all above zero"
    if not all(map(math.isfinite, size[HEIGHTFIELD_HEAD:])):
        return "has heights that are not finite"
    return None


def heightfield_inner_radius(size: Sequence[float]) -> float:
    """The radius (m) of a ball that has room below every triangle: within it as seen from above, and half the base."""
    field = field_of(size)
    rows, columns = field.shape
    along, across = field.x / (columns - 1), field.y / (rows - 1)
    return min(0.5 * (along + across - math.hypot(along, across)), 0.5 * field.base)


def heightfield_outer_radius(size: Sequence[float]) -> float:
    """The radius (m) of the smallest sphere about its frame's origin that holds it."""
    field = field_of(size)
    corner = math.hypot(0.5 * field.x, 0.5 * field.y)
    highest = math.sqrt(float((field.points**2).sum(axis=1).max()))
    return max(math.hypot(corner, field.base), highest)


def heightfield_volume(size: Sequence[float]) -> float:
    """The volume (m³) of what is solid: below each triangle the mean of its heights, over half a cell."""
    field = field_of(size)
    rows, columns = field.shape
    below = math.fsum(field.heights.ravel()[field.triangles].ravel().tolist()) / 3.0
    cell = field.x * field.y / ((rows - 1) * (columns - 1))
    return 0.5 * cell * below + field.x * field.y * field.base


def heightfield_support(size: Sequence[float], local: Array) -> Array:
    """How far (m) (n,) it reaches along unit vectors (n, 3), as its convex hull does."""
    field = field_of(size)
    corners = np.array([(sx * field.x / 2.0, sy * field.y / 2.0, -field.base) for sx in (-1, 1) for sy in (-1, 1)])
    reach: Array = (local @ np.concatenate([field.points, corners]).T).max(axis=1)
    return reach


Size = Sequence[float]
Moments = tuple[float, float, float]


class Round(StrEnum):
    """The turns that change nothing of a shape."""

    EVERY = "every turn about its centre"
    AXIS = "every turn about its z axis"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class ShapeKind:
    """Properties of all shapes of a kind.

    sizes         the meaning of the numbers of a size; () where there are none, and where they are ``points``
    volume        (size) -> m³; 0 for a plane
    moments       (size, mass) -> principal moments (kg m²) about the centre and the shape's own x, y, z axes
    inner_radius  (size) -> radius (m) of the largest sphere about the centre inside it
    outer_radius  (size) -> radius (m) of the smallest sphere about the centre that holds it
    support       (size, unit vectors (n, 3) in the shape's frame) -> how far (m) (n,) it reaches along each from its centre
    round         the turns that change nothing
    upside_down   whether turning it upside down (z to −z) changes nothing
    endless       whether it has no end: an infinite plane, solid below
    points        whether a size is the vertices of a convex hull, x y z of one after the other
    grid          whether a size is a grid of heights (``world/heightfield.py``), which is not convex; ``support`` is that of
                  its hull, ``inner_radius`` that of a ball with room below each of its triangles
    """

    sizes: tuple[str, ...]
    volume: Callable[[Size], float]
    moments: Callable[[Size, float], Moments]
    inner_radius: Callable[[Size], float]
    outer_radius: Callable[[Size], float]
    support: Callable[[Size, Array], Array]
    round: Round = Round.NONE
    upside_down: bool = True
    endless: bool = False
    points: bool = False
    grid: bool = False

    @property
    def static(self) -> bool:
        """Whether only bodies that cannot move have it; it has no mass."""
        return self.endless or self.grid

    def wrong_size(self, size: Size) -> str | None:
        """The fault in the count of a size's numbers; None where it is right."""
        if self.grid:
            return heightfield_fault(size)
        if not self.points:
            count = len(self.sizes)
            return None if len(size) == count else f"has {len(size)} entries, should have {count}"
        whole = len(size) % 3 == 0 and len(size) >= 3 * hull.FEWEST_VERTICES
        return (
            None if whole else f"has {len(size)} entries, should have x y z of at least {hull.FEWEST_VERTICES} vertices"
        )


# --- moments --------------------------------------------------------------------------------------------------


def _sphere_moments(size: Size, mass: float) -> Moments:
    moment = 0.4 * mass * size[0] * size[0]
    return (moment, moment, moment)


def _box_moments(size: Size, mass: float) -> Moments:
    xx, yy, zz = (edge * edge for edge in size)
    return (mass * (yy + zz) / 12.0, mass * (xx + zz) / 12.0, mass * (xx + yy) / 12.0)


def _cylinder_moments(size: Size, mass: float) -> Moments:
    radius, length = size
    across = mass * (3.0 * radius * radius + length * length) / 12.0
    return (across, across, 0.5 * mass * radius * radius)


def _capsule_moments(size: Size, mass: float) -> Moments:
    radius, length = size
    # shares of the volume, divided by π r²: the cylinder has L, the two half balls together 4/3 r
    tube = mass * length / (length + 4.0 / 3.0 * radius)
    ends = mass - tube
    across = tube * (3.0 * radius * radius + length * length) / 12.0 + ends * (
        0.4 * radius * radius + 0.25 * length * length + 0.375 * length * radius
    )
    return (across, across, 0.5 * tube * radius * radius + 0.4 * ends * radius * radius)


def _ellipsoid_moments(size: Size, mass: float) -> Moments:
    xx, yy, zz = (axis * axis for axis in size)
    return (mass * (yy + zz) / 5.0, mass * (xx + zz) / 5.0, mass * (xx + yy) / 5.0)


def _mesh_moments(size: Size, mass: float) -> Moments:
    solid = hull.hull_of(size).solid
    xx, yy, zz = (mass * moment / solid.volume for moment in solid.moments)
    return (xx, yy, zz)


def _no_moments(size: Size, mass: float) -> Moments:
    raise ValueError("a plane has no moments, nor has a height field")


# --- support functions ----------------------------------------------------------------------------------------


def _sphere_support(size: Size, local: Array) -> Array:
    return np.full(len(local), size[0])


def _box_support(size: Size, local: Array) -> Array:
    reach: Array = np.abs(local) @ (0.5 * np.array(size))
    return reach


def _cylinder_support(size: Size, local: Array) -> Array:
    reach: Array = np.abs(local[:, 2]) * 0.5 * size[1] + size[0] * np.hypot(local[:, 0], local[:, 1])
    return reach


def _capsule_support(size: Size, local: Array) -> Array:
    reach: Array = np.abs(local[:, 2]) * 0.5 * size[1] + size[0]
    return reach


def _ellipsoid_support(size: Size, local: Array) -> Array:
    reach: Array = np.linalg.norm(local * np.array(size), axis=1)
    return reach


def _mesh_support(size: Size, local: Array) -> Array:
    reach: Array = (local @ hull.mesh_vertices(size).T).max(axis=1)
    return reach


def _no_support(size: Size, local: Array) -> Array:
    raise ValueError("a plane has no support function")


# --- the table ------------------------------------------------------------------------------------------------

SHAPES: Mapping[str, ShapeKind] = {
    "sphere": ShapeKind(
        ("radius",),
        volume=lambda size: 4.0 / 3.0 * math.pi * size[0] * size[0] * size[0],
        moments=_sphere_moments,
        inner_radius=lambda size: size[0],
        outer_radius=lambda size: size[0],
        support=_sphere_support,
        round=Round.EVERY,
    ),
    "box": ShapeKind(
        ("x", "y", "z"),
        volume=lambda size: size[0] * size[1] * size[2],
        moments=_box_moments,
        inner_radius=lambda size: 0.5 * min(size),
        outer_radius=lambda size: 0.5 * math.hypot(*size),
        support=_box_support,
    ),
    "cylinder": ShapeKind(
        ("radius", "length"),
        volume=lambda size: math.pi * size[0] * size[0] * size[1],
        moments=_cylinder_moments,
        inner_radius=lambda size: min(size[0], 0.5 * size[1]),
        outer_radius=lambda size: math.hypot(size[0], 0.5 * size[1]),
        support=_cylinder_support,
        round=Round.AXIS,
    ),
    "capsule": ShapeKind(
        ("radius", "length"),
        volume=lambda size: (math.pi * size[0] * size[0] * size[1] + 4.0 / 3.0 * math.pi * size[0] * size[0] * size[0]),
        moments=_capsule_moments,
        inner_radius=lambda size: size[0],
        outer_radius=lambda size: size[0] + 0.5 * size[1],
        support=_capsule_support,
        round=Round.AXIS,
    ),
    "ellipsoid": ShapeKind(
        ("x", "y", "z"),
        volume=lambda size: 4.0 / 3.0 * math.pi * size[0] * size[1] * size[2],
        moments=_ellipsoid_moments,
        inner_radius=min,
        outer_radius=max,
        support=_ellipsoid_support,
    ),
    "plane": ShapeKind(
        (),
        volume=lambda size: 0.0,
        moments=_no_moments,
        inner_radius=lambda size: math.inf,
        outer_radius=lambda size: math.inf,
        support=_no_support,
        round=Round.AXIS,
        upside_down=False,
        endless=True,
    ),
    "mesh": ShapeKind(
        (),
        volume=lambda size: hull.hull_of(size).solid.volume,
        moments=_mesh_moments,
        inner_radius=lambda size: float(hull.hull_of(size).offsets.min()),
        outer_radius=lambda size: math.sqrt(float((hull.mesh_vertices(size) ** 2).sum(axis=1).max())),
        support=_mesh_support,
        upside_down=False,
        points=True,
    ),
    "heightfield": ShapeKind(
        (),
        volume=heightfield_volume,
        moments=_no_moments,
        inner_radius=heightfield_inner_radius,
        outer_radius=heightfield_outer_radius,
        support=heightfield_support,
        upside_down=False,
        grid=True,
    ),
}
"""By the words of ``SHAPE_KINDS``. Of a box the sizes are full edge lengths, of an ellipsoid semi-axes; cylinder and capsule
stand along z, and a capsule's length is that of its cylindrical part; a plane is the x-y plane of its frame, solid below. A
mesh is a convex hull, whose centre of mass is its frame's origin and whose principal axes are its frame's."""
