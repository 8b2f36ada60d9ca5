"""Convex hulls: the one meaning of a mesh in a world.

The size of a shape of kind ``mesh`` is the vertices of a convex hull, flat x y z, in the shape's frame; its faces follow from
them here. Qhull (by scipy, imported where it is called) works in double precision without random numbers: the same points give
the same hull.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.world import frames
from simspec.world.solid import Points, Solid, Triangles, solid
from simspec.world.types import Pose

FEWEST = 4
"""Vertices of the smallest solid."""
CENTRED = 1e-14
"""Share of the largest coordinate up to which a centre of mass is at the origin: what simspec has written is read as it is."""
KEPT = 1024
"""Hulls whose faces and figures are remembered."""


class HullError(ValueError):
    """Points of which no hull can be made."""


class FlatError(HullError):
    """Points that no solid has as its corners: fewer than four, or all in one plane."""


class OpenHullError(HullError):
    """Points so near to each other that their hull's triangles make no closed surface."""


@dataclass(frozen=True)
class Hull:
    """A convex hull: its ``vertices`` (n, 3), the ``triangles`` (m, 3) of their indices, anticlockwise as seen from outside,
    with outward unit ``normals`` (m, 3) and distances ``offsets`` (m,) of their planes from the origin; what it encloses."""

    vertices: Points
    triangles: Triangles
    normals: Points
    offsets: NDArray[np.float64]
    solid: Solid


def vertices_of(size: Sequence[float]) -> Points:
    """The vertices (n, 3) of a mesh, from its size."""
    return np.array(size, np.float64).reshape(-1, 3)


def size_of(vertices: Points) -> tuple[float, ...]:
    """The size of a mesh, from its vertices (n, 3)."""
    return tuple((vertices + 0.0).ravel().tolist())  # −0 becomes 0


def corners(points: Points) -> NDArray[np.int64]:
    """Which of ``points`` (n, 3) are the vertices of their convex hull: sorted indices, of equal points the first. Points
    within a face or an edge are none; all that are chosen are vertices of a closed surface of triangles. Raises HullError."""
    chosen = _distinct(points)
    while True:
        made = _qhull(points[chosen])
        used: NDArray[np.int64] = np.unique(made.simplices)
        if len(used) == len(chosen) and len(made.simplices) == closed_triangles(len(used)):
            return chosen
        if len(used) == len(chosen):
            raise OpenHullError(
                f"{len(used)} corners have no closed surface of triangles: some are too near to each other"
            )
        chosen = chosen[
            used
        ]  # round-off decides over a corner that is nearly in a plane: looked at again without the others


def closed_triangles(vertices: int) -> int:
    """The number of triangles of a closed surface, a sphere by its counts, with so many vertices."""
    return 2 * vertices - 4


def hull(vertices: Points) -> Hull:
    """The convex hull of ``vertices``, all of which should be corners. Raises FlatError."""
    made = _qhull(vertices)
    triangles, order = _wound(vertices, made)
    planes = made.equations[order]  # of slivers those of the face that they are part of
    return Hull(vertices, triangles, planes[:, :3], -planes[:, 3], solid(vertices, triangles))


def hull_of(size: Sequence[float]) -> Hull:
    """The hull of a mesh of this size: the same object for the same size. Raises FlatError."""
    return _hull_of(tuple(size))


@functools.lru_cache(maxsize=KEPT)
def _hull_of(size: tuple[float, ...]) -> Hull:
    return hull(vertices_of(size))


def faces(size: Sequence[float]) -> Triangles:
    """The triangles (m, 3) of a mesh of this size, indices of its vertices, anticlockwise as seen from outside, in a fixed
    order. Raises FlatError."""
    return hull_of(size).triangles


def centred(vertices: Points) -> tuple[Pose, Points]:
    """The frame of a hull (its centre of mass and principal axes) in the frame of its ``vertices``, and these in that frame.
    Vertices that are in that frame already, but for round-off, stay as they are. Raises FlatError."""
    frame = hull(vertices).solid.frame
    turned = frame.quaternion != frames.IDENTITY
    if not turned and np.abs(frame.position).max() <= CENTRED * np.abs(vertices).max():
        return Pose(), vertices
    return frame, _seen_from(frame, vertices)


def _seen_from(frame: Pose, points: Points) -> Points:
    """Points (n, 3) in a frame; products element by element, for the same bits on every machine."""
    rows = frames.matrix(frame.quaternion)
    x, y, z = (points - np.array(frame.position)).T
    return np.stack([rows[0][k] * x + rows[1][k] * y + rows[2][k] * z for k in range(3)], axis=1)


def _distinct(points: Points) -> NDArray[np.int64]:
    _, first = np.unique(points + 0.0, axis=0, return_index=True)
    distinct: NDArray[np.int64] = np.sort(first)
    return distinct


def _qhull(points: Points) -> Any:
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < FEWEST or not np.isfinite(points).all():
        raise FlatError(f"a solid has at least {FEWEST} corners at finite places")
    try:
        return ConvexHull(points)
    except QhullError:
        raise FlatError("all points are in one plane, or nearly so") from None


def _wound(vertices: Points, made: Any) -> tuple[Triangles, NDArray[np.int64]]:
    """Qhull's triangles, each turned so that its first index is the least and it is wound outwards, sorted; and which of
    Qhull's each is. Neighbours are wound alike: of a sliver alone, round-off would decide."""
    triangles = made.simplices.astype(np.int64)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    outwards = (np.cross(b - a, c - a) * made.equations[:, :3]).sum(axis=1)
    start = int(np.argmax(np.abs(outwards)))
    rows: list[list[int]] = triangles.tolist()
    if outwards[start] < 0.0:
        rows[start].reverse()
    neighbours: list[list[int]] = made.neighbors.tolist()
    waiting, done = [start], {start}
    while waiting:
        own = waiting.pop()
        p, q, r = rows[own]
        edges = {(p, q), (q, r), (r, p)}
        for other in neighbours[own]:
            if other in done:
                continue
            i, j, k = rows[other]
            if edges & {(i, j), (j, k), (k, i)}:
                rows[other].reverse()
            done.add(other)
            waiting.append(other)
    turned = [[*row[(at := row.index(min(row))) :], *row[:at]] for row in rows]
    order = sorted(range(len(turned)), key=turned.__getitem__)
    return np.array([turned[index] for index in order], np.int64), np.array(order, np.int64)
