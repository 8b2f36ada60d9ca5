"""Convex hulls with fewer vertices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.world.hull import corners
from simspec.world.solid import Points

EQUAL = 1e-9
"""Share of the extent within which two distances are the same, so that of a symmetric solid's vertices the first in the file is
taken, not the one that round-off favours."""


def reduced(vertices: Points, most: int) -> tuple[Points, float]:
    """At most ``most`` of the vertices (n, 3) of a hull, in their order, and the largest distance (m) of the hull from theirs.

    Greedy, by the support function: a tetrahedron of far vertices first, and then again and again the vertex that lies furthest
    beyond a face, which is where the support functions of the two hulls differ most along a face's normal.
    """
    if len(vertices) <= most:
        return vertices, 0.0
    from scipy.spatial import ConvexHull

    extent = float(np.ptp(vertices, axis=0).max())
    chosen = _tetrahedron(vertices, extent)
    hull = ConvexHull(vertices[chosen], incremental=True)
    try:
        while len(chosen) < most:
            beyond = _beyond(hull, vertices)
            furthest = float(beyond.max())
            if furthest <= EQUAL * extent:
                break
            index = int(np.flatnonzero(beyond >= furthest - EQUAL * extent)[0])
            chosen.append(index)
            hull.add_points(vertices[index][None])
    finally:
        hull.close()
    kept = vertices[np.sort(np.array(chosen))]
    kept = kept[corners(kept)]  # what was a corner of few need not be one of many
    return kept, _distance(vertices, kept)


def _tetrahedron(vertices: Points, extent: float) -> list[int]:
    """Four vertices far apart: the least along x, the furthest from it, from their line, from their plane."""

    def first(distances: NDArray[np.float64]) -> int:
        return int(np.flatnonzero(distances >= distances.max() - EQUAL * extent)[0])

    one = first(-vertices[:, 0])
    away = vertices - vertices[one]
    two = first(np.sqrt((away**2).sum(axis=1)))
    along = away[two] / np.sqrt((away[two] ** 2).sum())
    across = away - (away * along).sum(axis=1)[:, None] * along
    three = first(np.sqrt((across**2).sum(axis=1)))
    normal = np.cross(along, across[three])
    normal /= np.sqrt((normal**2).sum())
    four = first(np.abs((away * normal).sum(axis=1)))
    return [one, two, three, four]


def _beyond(hull: Any, vertices: Points) -> NDArray[np.float64]:
    """How far (n,) each vertex lies beyond the face that it is furthest beyond."""
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    furthest = np.full(len(vertices), -np.inf)
    step = max(1, 4_000_000 // len(vertices))
    for start in range(0, len(normals), step):
        part = slice(start, start + step)
        furthest = np.maximum(furthest, (vertices @ normals[part].T + offsets[part]).max(axis=1))
    return furthest


def _distance(vertices: Points, kept: Points) -> float:
    """The largest distance of ``vertices`` from the hull of ``kept``."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(kept)
    outside = _beyond(hull, vertices) > 0.0
    a, b, c = (kept[hull.simplices[:, k]] for k in range(3))
    worst = 0.0
    for point in vertices[outside]:
        worst = max(worst, float(np.sqrt(_square_to_triangles(point, a, b, c).min())))
    return worst


def _square_to_triangles(point: Points, a: Points, b: Points, c: Points) -> NDArray[np.float64]:
    """Squares of the distances (m,) of a point from triangles: from the plane where its foot is inside, else from the edges."""
    normal = np.cross(b - a, c - a)
    square = (normal**2).sum(axis=1)
    safe = np.where(square > 0.0, square, 1.0)
    inside = square > 0.0
    nearest = np.full(len(a), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        inside &= (np.cross(edge, point - start) * normal).sum(axis=1) >= 0.0
        length = (edge**2).sum(axis=1)
        share = np.clip(((point - start) * edge).sum(axis=1) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
        nearest = np.minimum(nearest, ((start + share[:, None] * edge - point) ** 2).sum(axis=1))
    height = ((point - a) * normal).sum(axis=1) ** 2 / safe
    return np.where(inside, height, nearest)
