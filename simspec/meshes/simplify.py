"""Surfaces of fewer triangles: vertices in one cell of a grid become one, at the place that is nearest to their planes.

After P. Lindstrom, Out-of-Core Simplification of Large Polygonal Models, SIGGRAPH 2000: the vertex of a cell has the least sum
of squared distances from the planes of the triangles there, weighted by their areas. For pictures only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simspec.world.hull import Points, Triangles

FLAT = 1e-3
"""Share of the largest eigenvalue of a cell's planes below which they leave a direction open."""
FINEST = 512
"""Cells along the longest side."""
ROUNDS = 9
"""Halvings of the number of cells: until it is exact."""

Indices = NDArray[np.int64]


def simplified(vertices: Points, triangles: Triangles, most: int) -> tuple[Points, Triangles, Indices]:
    """At most ``most`` triangles (or as few as a grid of two cells leaves) that look alike: vertices, triangles, and the index
    that each of these had."""
    if len(triangles) <= most:
        return vertices, triangles, np.arange(len(triangles))
    low, high = 2, FINEST
    best = _kept(vertices, triangles, low)
    for _ in range(ROUNDS):
        middle = (low + high) // 2
        if middle == low:
            break
        cells, kept = _kept(vertices, triangles, middle)
        if len(kept) <= most:
            low, best = middle, (cells, kept)
        else:
            high = middle
    cells, kept = best
    places = _places(vertices, triangles, cells)
    return places, cells[triangles[kept]], kept


def _kept(vertices: Points, triangles: Triangles, along: int) -> tuple[Indices, Indices]:
    """The cell (numbered without gaps) of each vertex in a grid of so many cells along the longest side, and the triangles
    whose corners are in three cells, each three once."""
    low = vertices.min(axis=0)
    size = float(np.ptp(vertices, axis=0).max()) / along or 1.0
    places = np.minimum(((vertices - low) / size).astype(np.int64), along - 1)
    _, cells = np.unique(places @ np.array([1, along, along * along]), return_inverse=True)
    cells = cells.reshape(-1)
    corners = cells[triangles]
    a, b, c = corners.T
    whole = np.flatnonzero((a != b) & (b != c) & (c != a))
    if not len(whole):
        return cells, whole
    turned = corners[whole]
    first = np.argmin(turned, axis=1)
    turned = turned[np.arange(len(turned))[:, None], (first[:, None] + np.arange(3)) % 3]
    _, once = np.unique(turned, axis=0, return_index=True)
    return cells, whole[np.sort(once)]


def _places(vertices: Points, triangles: Triangles, cells: Indices) -> Points:
    """The vertex of each cell."""
    count = int(cells.max()) + 1
    share = np.maximum(np.bincount(cells, minlength=count), 1)
    centre = np.stack([np.bincount(cells, vertices[:, k], count) for k in range(3)], axis=1) / share[:, None]
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)  # as long as twice the area
    planes, distances = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for corner in range(3):
        cell = cells[triangles[:, corner]]
        offset = np.einsum("ni,ni->n", normal, a - centre[cell])
        np.add.at(planes, cell, normal[:, :, None] * normal[:, None, :])
        np.add.at(distances, cell, normal * offset[:, None])
    values, axes = np.linalg.eigh(planes)
    largest = np.maximum(values[:, -1:], np.finfo(float).tiny)
    inverse = np.where(values > FLAT * largest, 1.0 / np.where(values > FLAT * largest, values, 1.0), 0.0)
    moved = np.einsum("nij,nj,nkj,nk->ni", axes, inverse, axes, distances)
    reach = _reach(vertices, cells, centre, count)
    long = np.linalg.norm(moved, axis=1, keepdims=True)
    made: Points = centre + moved * np.minimum(1.0, reach[:, None] / np.maximum(long, np.finfo(float).tiny))
    return made


def _reach(vertices: Points, cells: Indices, centre: Points, count: int) -> NDArray[np.float64]:
    """The distance of the furthest vertex of each cell from its centre."""
    far = np.zeros(count)
    np.maximum.at(far, cells, np.linalg.norm(vertices - centre[cells], axis=1))
    return far
