"""Solid shapes with real geometry: signed distances by coal, and poses in which two shapes overlap clearly."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.world import frames
from simspec.world.hull import mesh_triangles, mesh_vertices
from simspec.world.shapes import SHAPES, field_of
from simspec.world.types import Pose, Shape, World

DIP = 0.5
"""Share of the smaller shape's inner radius by which two shapes are made to overlap: far beyond margins, not so deep that
normals vanish. Sound detectors report all of 160 random poses of each two kinds of shapes at that depth; the worst miss up to
3 of 40 where a cylinder is one of them (measured), hence further poses (``place.POSES``)."""
ENOUGH = 0.2
"""The least such share that counts as an overlap: sound detectors still report it in every pose (measured)."""


@dataclass(frozen=True)
class CollisionSolid:
    """One collision shape: its ``body``'s index in the world; ``part`` is equal for the shapes of one body and material.

    ``inner`` is the radius of the largest sphere about its centre inside it, ``outer`` of the smallest around it (m).
    """

    number: int
    body: int
    shape: Shape
    part: tuple[int, str]
    inner: float
    outer: float

    @property
    def name(self) -> str:
        return self.shape.name

    @property
    def endless(self) -> bool:
        """Whether it is a plane."""
        return SHAPES[self.shape.kind].endless

    @property
    def grid(self) -> bool:
        """Whether it is a height field."""
        return SHAPES[self.shape.kind].grid

    @property
    def is_static(self) -> bool:
        """Whether only bodies that cannot move have shapes of its kind."""
        return SHAPES[self.shape.kind].static

    @functools.cached_property
    def parts(self) -> Prisms:
        """Of a height field what is solid below each triangle."""
        return Prisms(self.shape.size)

    @functools.cached_property
    def thing(self) -> Any:
        """coal's geometry."""
        return _thing(self.shape.kind, self.shape.size)

    @functools.cached_property
    def pose(self) -> np.ndarray:
        """Its pose (4, 4) in the body frame."""
        return transform(self.shape.pose)


def solids(world: World) -> tuple[CollisionSolid, ...]:
    """Every collision shape of a world, in its order."""
    solids_of_world: list[CollisionSolid] = []
    for index, body in enumerate(world.bodies):
        for shape in body.shapes:
            if shape.collision:
                part = (index, shape.material)
                kind = SHAPES[shape.kind]
                inner, outer = kind.inner_radius(shape.size), kind.outer_radius(shape.size)
                solids_of_world.append(CollisionSolid(len(solids_of_world), index, shape, part, inner, outer))
    return tuple(solids_of_world)


def transform(pose: Pose) -> np.ndarray:
    """A pose as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = frames.matrix(pose.quaternion), pose.position
    return matrix


def transforms(poses: np.ndarray) -> np.ndarray:
    """Poses (n, 7) x y z w x y z as matrices (n, 4, 4)."""
    w, x, y, z = poses[:, 3:].T
    matrices = np.zeros((len(poses), 4, 4))
    matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 0, 2] = (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
    )
    matrices[:, 1, 0], matrices[:, 1, 1], matrices[:, 1, 2] = (
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
    )
    matrices[:, 2, 0], matrices[:, 2, 1], matrices[:, 2, 2] = (
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )
    matrices[:, :3, 3], matrices[:, 3, 3] = poses[:, :3], 1.0
    return matrices


# --- distances ----------------------------------------------------------------------------------------------------


@functools.cache
def _coal() -> Any:
    import coal

    return coal


def _thing(kind: str, size: tuple[float, ...]) -> Any:
    coal = _coal()
    makers: Mapping[str, Callable[..., Any]] = {
        "sphere": coal.Sphere,
        "box": coal.Box,
        "cylinder": coal.Cylinder,
        "capsule": coal.Capsule,
        "ellipsoid": coal.Ellipsoid,
        "plane": lambda: coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0),
        "mesh": lambda *size: _convex(coal, size),
    }
    return makers[kind](*size)


def _convex(coal: Any, size: tuple[float, ...]) -> Any:
    return _closed(coal, mesh_vertices(size), mesh_triangles(size).tolist())


def _closed(coal: Any, points: np.ndarray, sides: Iterable[Sequence[int]]) -> Any:
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in points:
        vertices.append(vertex)
    for corners in sides:
        triangles.append(coal.Triangle(*corners))
    return coal.Convex(vertices, triangles)


PRISM = ((0, 1, 2), (3, 5, 4), (0, 3, 4), (0, 4, 1), (1, 4, 5), (1, 5, 2), (2, 5, 3), (2, 3, 0))
"""The triangles of what is solid below a triangle, anticlockwise as seen from outside."""


class Prisms:
    """A height field as convex solids, one below each of its triangles; coal's geometries, each made on demand."""

    def __init__(self, size: tuple[float, ...]):
        self._field = field_of(size)
        corners = self._field.points[self._field.triangles]
        self._low, self._high = corners.min(axis=1), corners.max(axis=1)
        self._low[:, 2] = -self._field.base
        self._made: dict[int, Any] = {}

    def near(self, centre: np.ndarray, radius: float) -> Iterator[tuple[float, Any]]:
        """Every one, nearest first, with a bound (m): nothing within a sphere (in its frame) is nearer to it than this."""
        outside = np.maximum(np.maximum(self._low - centre, centre - self._high), 0.0)
        bounds = np.linalg.norm(outside, axis=1) - radius
        for index in np.argsort(bounds, kind="stable").tolist():
            if index not in self._made:
                self._made[index] = _closed(_coal(), self._field.prism(index), PRISM)
            yield float(bounds[index]), self._made[index]


@functools.cache
def _request() -> Any:
    request = _coal().DistanceRequest(True, 0.0, 0.0)
    request.enable_signed_distance = True
    return request


@dataclass(frozen=True, slots=True)
class ShapeGap:
    """The signed distance of two shapes (m, negative: how deep they overlap), the unit normal from the first to the second,
    and the points of both that are nearest or deepest, in the world."""

    distance: float
    normal: np.ndarray
    first: np.ndarray
    second: np.ndarray


NOWHERE = ShapeGap(math.inf, np.zeros(3), np.zeros(3), np.zeros(3))
"""The gap of shapes at infinite distance."""


def gap(solid: CollisionSolid, at: np.ndarray, other: CollisionSolid, other_at: np.ndarray) -> ShapeGap:
    """The gap between two shapes at poses (4, 4). Two planes, or two of what only bodies that cannot move have, are at
    infinite distance: nothing can bring them together.

    A distance that coal returns as NaN counts as no overlap.
    """
    if solid.is_static and other.is_static:
        return NOWHERE
    if solid.grid:
        return _to_field(solid, at, other, other_at)
    if other.grid:
        found = _to_field(other, other_at, solid, at)
        return ShapeGap(found.distance, -found.normal, found.second, found.first)
    return _between(solid.thing, at, other.thing, other_at)


def _between(thing: Any, at: np.ndarray, other: Any, other_at: np.ndarray) -> ShapeGap:
    coal = _coal()
    result = coal.DistanceResult()
    first, second = (coal.Transform3s(pose[:3, :3], pose[:3, 3]) for pose in (at, other_at))
    separation = coal.distance(thing, first, other, second, _request(), result)
    if not math.isfinite(separation):
        return NOWHERE
    return ShapeGap(separation, result.normal, result.getNearestPoint1(), result.getNearestPoint2())


def _to_field(field: CollisionSolid, at: np.ndarray, other: CollisionSolid, other_at: np.ndarray) -> ShapeGap:
    """The gap from a height field, which is that of the nearest of its prisms, or of the one that is overlapped most."""
    centre = at[:3, :3].T @ (other_at[:3, 3] - at[:3, 3])
    best = NOWHERE
    for bound, prism in field.parts.near(centre, other.outer):
        if bound >= best.distance:
            break
        found = _between(prism, at, other.thing, other_at)
        if found.distance < best.distance:
            best = found
    return best


def wanted_depth(solid: CollisionSolid, other: CollisionSolid) -> tuple[float, float]:
    """How deep two shapes should overlap, and how deep at least (m)."""
    least = min(solid.inner, other.inner)
    return DIP * least, ENOUGH * least


def overlap(solid: CollisionSolid, at: np.ndarray, other: CollisionSolid, other_at: np.ndarray) -> bool:
    """Whether two shapes overlap clearly."""
    return gap(solid, at, other, other_at).distance <= -wanted_depth(solid, other)[1]
