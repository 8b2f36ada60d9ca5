"""Solid shapes with real geometry: signed distances by coal, and poses in which two shapes overlap clearly."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.world import frames
from simspec.world.hull import faces, vertices_of
from simspec.world.shapes import SHAPES
from simspec.world.types import Pose, Shape, World

DIP = 0.5
"""Share of the smaller shape's inner radius by which two shapes are made to overlap: far beyond margins, not so deep that
normals vanish. Sound detectors report all of 160 random poses of each two kinds of shapes at that depth; the worst miss up to
3 of 40 where a cylinder is one of them (measured), hence further poses (``place.POSES``)."""
ENOUGH = 0.2
"""The least such share that counts as an overlap: sound detectors still report it in every pose (measured)."""


@dataclass(frozen=True)
class Solid:
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

    @functools.cached_property
    def thing(self) -> Any:
        """coal's geometry."""
        return _thing(self.shape.kind, self.shape.size)

    @functools.cached_property
    def pose(self) -> np.ndarray:
        """Its pose (4, 4) in the body frame."""
        return transform(self.shape.pose)


def solids(world: World) -> tuple[Solid, ...]:
    """Every collision shape of a world, in its order."""
    solids_of_world: list[Solid] = []
    for index, body in enumerate(world.bodies):
        for shape in body.shapes:
            if shape.collision:
                part = (index, shape.material)
                kind = SHAPES[shape.kind]
                inner, outer = kind.inner_radius(shape.size), kind.outer_radius(shape.size)
                solids_of_world.append(Solid(len(solids_of_world), index, shape, part, inner, outer))
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
    vertices, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in vertices_of(size):
        vertices.append(vertex)
    for corners in faces(size).tolist():
        triangles.append(coal.Triangle(*corners))
    return coal.Convex(vertices, triangles)


@functools.cache
def _request() -> Any:
    request = _coal().DistanceRequest(True, 0.0, 0.0)
    request.enable_signed_distance = True
    return request


@dataclass(frozen=True, slots=True)
class Gap:
    """The signed distance of two shapes (m, negative: how deep they overlap), the unit normal from the first to the second,
    and the points of both that are nearest or deepest, in the world."""

    distance: float
    normal: np.ndarray
    first: np.ndarray
    second: np.ndarray


def gap(solid: Solid, at: np.ndarray, other: Solid, other_at: np.ndarray) -> Gap:
    """The gap between two shapes at poses (4, 4). Two planes are endlessly far apart: nothing can bring them together.

    What coal cannot tell (a distance that is no number) counts as apart: only an overlap that was seen is one.
    """
    nowhere = np.zeros(3)
    if solid.endless and other.endless:
        return Gap(math.inf, nowhere, nowhere, nowhere)
    coal = _coal()
    result = coal.DistanceResult()
    first, second = (coal.Transform3s(pose[:3, :3], pose[:3, 3]) for pose in (at, other_at))
    separation = coal.distance(solid.thing, first, other.thing, second, _request(), result)
    if not math.isfinite(separation):
        return Gap(math.inf, nowhere, nowhere, nowhere)
    return Gap(separation, result.normal, result.getNearestPoint1(), result.getNearestPoint2())


def wanted_depth(solid: Solid, other: Solid) -> tuple[float, float]:
    """How deep two shapes should overlap, and how deep at least (m)."""
    least = min(solid.inner, other.inner)
    return DIP * least, ENOUGH * least


def overlap(solid: Solid, at: np.ndarray, other: Solid, other_at: np.ndarray) -> bool:
    """Whether two shapes overlap clearly."""
    return gap(solid, at, other, other_at).distance <= -wanted_depth(solid, other)[1]
