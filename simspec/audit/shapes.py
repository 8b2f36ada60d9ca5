"""Collision shapes of a body in a file and in an engine: matched by what they are like, since few engines keep names."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from simspec.audit.findings import Severity, What
from simspec.engines.kit.foreign import AXES, MESH, directions
from simspec.proof.distances import unlikeness
from simspec.world import frames
from simspec.world.types import Body, Shape

if TYPE_CHECKING:
    from simspec.audit.compare import Comparison

SAME: Final = 1e-5
"""m, of sizes and places of shapes: engines keep vertices of meshes, and some shapes, in single precision."""
MESH_SHARE: Final = 2e-4
"""Share of a mesh's extent by which an engine may round its vertices."""


def compare_shapes(comparison: Comparison, body: Body, said: Sequence[Shape], held: Sequence[Shape]) -> None:
    """Add findings about the shapes of a body."""
    solid = [shape for shape in said if shape.collision]
    left = [shape for shape in held if shape.collision]
    if not comparison.knows_meshes:
        left = [shape for shape in left if shape.kind != MESH]  # the file's own were not read
    for shape in solid:
        if not comparison.compares(body, "shapes"):
            return
        near = min(left, key=lambda other: _apart(shape, other), default=None)
        if near is None:
            comparison.add(What.DROPPED, Severity.PHYSICS, body, "shapes", _told(shape), None)
            continue
        left.remove(near)
        apart = _apart(shape, near)
        if apart > _tolerance(shape):
            size = None if math.isinf(apart) else apart
            comparison.add(What.CHANGED, Severity.PHYSICS, body, "shapes", _told(shape), _told(near), "", size)
    for shape in left:
        comparison.add(What.ADDED, Severity.PHYSICS, body, "shapes", None, _told(shape))
    seen, held_seen = (sum(shape.visual for shape in shapes) for shapes in (said, held))
    if seen and not held_seen:
        comparison.add(What.DROPPED, Severity.APPEARANCE, body, "shapes", f"{seen} that are seen", "none")


def _tolerance(shape: Shape) -> float:
    return max(SAME, MESH_SHARE * _extent(shape)) if shape.kind == MESH else SAME


def _extent(shape: Shape) -> float:
    points = np.array(shape.size, dtype=float).reshape(-1, 3)
    return float((points.max(axis=0) - points.min(axis=0)).max()) if len(points) else 0.0


def _apart(shape: Shape, other: Shape) -> float:
    """How far two shapes are apart (m, rad); infinite where they are of different kinds."""
    if shape.kind != other.kind:
        return math.inf
    if shape.kind == MESH:
        return _meshes_apart(shape, other)
    return unlikeness(shape, other) - (0.0 if shape.name == other.name else 1e-6)


def _meshes_apart(shape: Shape, other: Shape) -> float:
    """The largest difference of the support functions, in the axes of the engine's shape; nan-free. ``shape.size`` are
    vertices, ``other.size`` is a support function (``engines/kit/foreign.py``)."""
    if not other.size or not shape.size:
        return math.inf
    place = frames.compose(frames.inverse(other.pose), shape.pose)
    points = np.array(shape.size, dtype=float).reshape(-1, 3) @ np.array(frames.matrix(place.quaternion)).T
    points = points + np.array(place.position)
    count = AXES if len(other.size) == AXES else len(directions())
    reach = (points @ directions()[:count].T).max(axis=0)
    return float(np.abs(reach - np.array(other.size[:count])).max())


def _told(shape: Shape) -> str:
    if shape.kind == MESH:
        return "mesh"
    return " ".join([shape.kind, *(f"{value:.5g}" for value in shape.size)])
