"""How far two convex hulls are apart: by their support functions, whatever their vertices and faces are called and counted.

The directions are 2,000 spread over the sphere, and those that tell most of the wanted hull: the normals of its faces, along
which no point of the other may reach further, and at each vertex one along which that vertex alone reaches as far. So no vertex
is moved unseen, however small the face that it moves.

Where every vertex of each hull is as near to one of the other as is tolerated, their support functions differ by no more along
any direction at all (the largest difference of the support functions of two convex sets is the largest distance of a point of
either from the other: Schneider, Convex Bodies, 1.8). Nothing else is asked of such hulls: where these have 20,000 vertices,
directions times vertices are 10⁹.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from simspec.world.hull import hull_of, mesh_vertices

DIRECTIONS = 2000
"""Spread over the sphere: 4.5° apart."""
AT_ONCE = 65_536
"""Products of a direction and a vertex that are looked at together: they stay in the processor's cache, and are too few for
a BLAS to share among threads, which on a busy machine wait for each other forty times as long as they work (measured)."""
KEPT = 64
"""Hulls whose directions are remembered."""

Array = NDArray[np.float64]


def hull_distance(wanted: tuple[float, ...], held: tuple[float, ...], tolerated: float = 0.0) -> float:
    """The largest difference of the support functions of two hulls (flat vertices, m) about one origin, as a share of the
    extent of the first; a bound of it, where that is ``tolerated`` at most."""
    bound = _bound(wanted, held) / extent(wanted)
    if bound <= tolerated:
        return bound
    directions, reach = _directions(wanted)
    return float(np.abs(_support(held, directions) - reach).max()) / extent(wanted)


def _bound(wanted: tuple[float, ...], held: tuple[float, ...]) -> float:
    """The largest distance (m) of a vertex of either hull from the nearest of the other; NaN where one has a place that is not
    finite."""
    if wanted == held:
        return 0.0
    from scipy.spatial import KDTree

    ours, theirs = mesh_vertices(wanted), mesh_vertices(held)
    if not (np.isfinite(ours).all() and np.isfinite(theirs).all()):
        return math.nan
    there, back = KDTree(theirs).query(ours)[0], KDTree(ours).query(theirs)[0]
    return float(max(there.max(), back.max()))


def extent(size: tuple[float, ...]) -> float:
    """The largest extent (m) of a hull along its frame's axes."""
    return float(np.ptp(mesh_vertices(size), axis=0).max())


def _support(size: tuple[float, ...], directions: Array) -> Array:
    vertices = mesh_vertices(size).T
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
    spread = _spread()
    # along the normal of a face its corners reach farthest, and along a sum of normals of faces at a vertex that vertex: the
    # rest needs no looking at, which would be most of what two hulls cost
    at_faces = np.einsum("fcx,fx->fc", hull.vertices[hull.triangles], hull.normals).max(axis=1)
    own = np.einsum("vx,vx->v", hull.vertices, at_vertices)
    directions = np.concatenate([spread, hull.normals, at_vertices])
    return directions, np.concatenate([_support(size, spread), at_faces, own])


def _spread() -> Array:
    """Unit vectors (n, 3) spread evenly over the sphere: a Fibonacci spiral."""
    index = np.arange(DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * index / DIRECTIONS
    turn = math.pi * (1.0 + math.sqrt(5.0)) * index
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
