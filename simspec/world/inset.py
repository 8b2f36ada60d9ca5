"""Convex hulls with all faces moved inwards: a ball around every point of one gives the hull again, but for its edges."""

from __future__ import annotations

import functools

import numpy as np

from simspec.world.hull import FlatError, corners, hull_of, size_of

LEAST = 1.5
"""Times the depth that every face must be away from the centre: below, hardly anything is left."""
DIGITS = 12
"""After the point (m): corners in which more than three faces meet come out once for each three."""


@functools.lru_cache(maxsize=1024)
def inset(size: tuple[float, ...], depth: float) -> tuple[float, ...]:
    """The hull (flat vertices, m) whose faces are ``depth`` (m) within those of the hull ``size``; with a ball of that radius
    around every point it has the same faces, and rounded edges. Raises FlatError where nothing, or hardly anything, is left,
    and OpenHullError as :func:`corners`."""
    from scipy.spatial import HalfspaceIntersection

    if not depth:
        return size
    faces = hull_of(size)
    if faces.offsets.min() <= LEAST * depth:
        raise FlatError(f"a face is {faces.offsets.min():g} m from the centre, should be more than {LEAST * depth:g} m")
    planes = np.column_stack([faces.normals, depth - faces.offsets])
    points = np.unique(np.round(HalfspaceIntersection(planes, np.zeros(3)).intersections, DIGITS), axis=0)
    return size_of(points[corners(points)])
