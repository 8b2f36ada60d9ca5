"""The kinds of shapes: one row for each, with all that follows from a kind and its size alone.

Sizes are those of ``Shape.size``, in metres, named by ``sizes``. Every kind but plane and height field is convex; its frame's
origin is its centre of mass. Volume and moments are plain floats, the same bits on every machine. Formulas: any table of
moments of inertia of homogeneous solids; the capsule is a cylinder and two half balls, whose own centres are 3/8 of the radius
beyond the cylinder's ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from simspec.world import heightfield, hull

Array = npt.NDArray[np.float64]
Size = Sequence[float]
Moments = tuple[float, float, float]


class Round(StrEnum):
    """The turns that change nothing of a shape."""

    EVERY = "every turn about its centre"
    AXIS = "every turn about its z axis"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class ShapeKind:
    """What all shapes of one kind have.

    sizes         what the numbers of a size are; () where there are none, and where they are ``points``
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
        """What is wrong with the count of a size's numbers; None where it is right."""
        if self.grid:
            return heightfield.fault_of(size)
        if not self.points:
            count = len(self.sizes)
            return None if len(size) == count else f"has {len(size)} entries, should have {count}"
        whole = len(size) % 3 == 0 and len(size) >= 3 * hull.FEWEST
        return None if whole else f"has {len(size)} entries, should have x y z of at least {hull.FEWEST} vertices"


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
    reach: Array = (local @ hull.vertices_of(size).T).max(axis=1)
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
        outer_radius=lambda size: math.sqrt(float((hull.vertices_of(size) ** 2).sum(axis=1).max())),
        support=_mesh_support,
        upside_down=False,
        points=True,
    ),
    "heightfield": ShapeKind(
        (),
        volume=heightfield.volume,
        moments=_no_moments,
        inner_radius=heightfield.inner_radius,
        outer_radius=heightfield.outer_radius,
        support=heightfield.support,
        upside_down=False,
        grid=True,
    ),
}
"""By the words of ``SHAPE_KINDS``. Of a box the sizes are full edge lengths, of an ellipsoid semi-axes; cylinder and capsule
stand along z, and a capsule's length is that of its cylindrical part; a plane is the x-y plane of its frame, solid below. A
mesh is a convex hull, whose centre of mass is its frame's origin and whose principal axes are its frame's."""
