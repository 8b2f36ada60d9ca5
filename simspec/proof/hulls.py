"""How far two convex hulls are apart: by their support functions, whatever their vertices and faces are called and counted.

The directions are 2,000 spread over the sphere, and those that tell most of the wanted hull: the normals of its faces, along
which no point of the other may reach further, and at each vertex one along which that vertex alone reaches as far. So no vertex
is moved unseen, however small the face that it moves.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from simspec.world.hull import hull_of, vertices_of

DIRECTIONS = 2000
"""Spread over the sphere: 4.5° apart."""
AT_ONCE = 65_536
"""Products of a direction and a vertex that are looked at together: they stay in the processor's cache, and are too few for
a BLAS to share among threads, which on a busy machine wait for each other forty times as long as they work (measured)."""
KEPT = 64
"""Hulls whose directions are remembered."""

Array = NDArray[np.float64]


def hull_distance(wanted: tuple[float, ...], held: tuple[float, ...]) -> float:
    """The largest difference of the support functions of two hulls (flat vertices, m) about one origin, as a share of the
    extent of the first."""
    directions, reach = _directions(wanted)
    return float(np.abs(_support(held, directions) - reach).max()) / extent(wanted)


def extent(size: tuple[float, ...]) -> float:
    """The largest extent (m) of a hull along its frame's axes."""
    return float(np.ptp(vertices_of(size), axis=0).max())


def _support(size: tuple[float, ...], directions: Array) -> Array:
    vertices = vertices_of(size).T
    step = max(1, AT_ONCE // vertices.shape[1])
    parts = (directions[start : start + step] @ vertices for start in range(0, len(directions), step))
    reach: Array = np.concatenate([part.max(axis=1) for part in parts])
    return reach


@functools.lru_cache(maxsize=KEPT)
def _directions(size: tuple[float, ...]) -> tuple[Array, Array]:
    """The unit vectors (n, 3) along which others are held against a hull, and how far (m) (n,) it reaches along each."""
    hull = hull_of(size)
    at_vertices = np.zeros_like(hull.vertices)
    for corner in range(3):
        np.add.at(at_vertices, hull.triangles[:, corner], hull.normals)
    at_vertices /= np.linalg.norm(at_vertices, axis=1, keepdims=True)
    directions = np.concatenate([_spread(), hull.normals, at_vertices])
    return directions, _support(size, directions)


def _spread() -> Array:
    """Unit vectors (n, 3) spread evenly over the sphere: a Fibonacci spiral."""
    index = np.arange(DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * index / DIRECTIONS
    turn = math.pi * (1.0 + math.sqrt(5.0)) * index
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
