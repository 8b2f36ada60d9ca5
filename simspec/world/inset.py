"""Convex hulls with all faces moved inwards: a ball around every point of one gives the hull again, but for its edges."""

from __future__ import annotations

import functools

import numpy as np

from simspec.world.hull import FlatError, corners, hull_of, size_of

LEAST = 1.5
"""Times the depth that every face must be away from the centre: below, hardly anything is left."""
THINNEST = 5.1e-5
"""m: by so much less than the margin a half of a box or cylinder may be: 1.9 mm are within a probe's tolerance, 1.5 mm not."""
FLAT = 1e-9
"""m: the thickness of a core that has none."""
DIGITS = 12
"""After the point (m): corners in which more than three faces meet come out once for each three."""


def inset(size: tuple[float, ...], depth: float) -> tuple[float, ...]:
    """The hull (flat vertices, m) whose faces are ``depth`` (m) within those of the hull ``size``; with a ball of that radius
    around every point it has the same faces, and rounded edges. Raises FlatError where nothing, or hardly anything, is left,
    and OpenHullError as :func:`corners`."""
    if not depth:
        return size
    faces = hull_of(size)
    if faces.offsets.min() <= LEAST * depth:
        raise FlatError(f"a face is {faces.offsets.min():g} m from the centre, should be more than {LEAST * depth:g} m")
    return _moved(size, depth)


def within(size: tuple[float, ...], margin: float) -> tuple[float, ...]:
    """The hull that is told to an engine which keeps a ``margin`` (m) around its points: :func:`inset` by that, or where the
    hull is too thin for it by what leaves a third of its least half, so that its faces are :func:`outside` of where they should
    be.
    Raises OpenHullError as :func:`corners`."""
    return _moved(size, _depth(size, margin)) if margin else size


def outside(size: tuple[float, ...], margin: float) -> float:
    """How far (m) the faces of :func:`within`, with its margin, are outside of those of the hull; 0 where it is thick."""
    return margin - _depth(size, margin) if margin else 0.0


def thickened(kind: str, size: tuple[float, ...], margin: float) -> tuple[float, ...]:
    """The size of a box or cylinder where no half of one is below a ``margin`` (m) that an engine keeps within it; what is
    below by less than ``THINNEST`` stays."""
    least = margin - THINNEST
    if kind == "box":
        return tuple(edge if edge / 2.0 >= least else 2.0 * margin for edge in size)
    radius, length = size
    return (radius if radius >= least else margin, length if length / 2.0 >= least else 2.0 * margin)


def core(kind: str, size: tuple[float, ...], margin: float) -> tuple[float, ...]:
    """What a ball of radius ``margin`` (m) is around in an engine that keeps such a margin: the hull, box or cylinder whose
    edges it rounds."""
    if kind == "mesh":
        return within(size, margin)
    if kind == "box":
        return tuple(max(edge - 2.0 * margin, FLAT) for edge in thickened(kind, size, margin))
    radius, length = thickened(kind, size, margin)
    return (max(radius - margin, FLAT), max(length - 2.0 * margin, FLAT))


def _depth(size: tuple[float, ...], margin: float) -> float:
    return min(margin, float(hull_of(size).offsets.min()) / LEAST)


@functools.lru_cache(maxsize=1024)
def _moved(size: tuple[float, ...], depth: float) -> tuple[float, ...]:
    from scipy.spatial import HalfspaceIntersection

    faces = hull_of(size)
    planes = np.column_stack([faces.normals, depth - faces.offsets])
    points = np.unique(np.round(HalfspaceIntersection(planes, np.zeros(3)).intersections, DIGITS), axis=0)
    return size_of(points[corners(points)])
