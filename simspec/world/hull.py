"""Convex hulls: the meaning of a mesh in a world, the solid that it encloses, and hulls with all faces moved inwards.

The size of a shape of kind ``mesh`` is the vertices of a convex hull, flat x y z, in the shape's frame; its faces follow from
them here. Qhull (by scipy, imported where it is called) works in double precision without random numbers: the same points give
the same hull.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.world import frames
from simspec.world.types import Pose, Vector3

# Volume, centre of mass and inertia of what a closed surface of triangles encloses, and its principal axes.
#
# Formulas: the integrals of 1, x and x xᵀ over the tetrahedra between a point and each triangle. Sums are correctly rounded
# (``math.fsum``) and products are numpy's element by element, so that the bits are the same on every machine and whatever the
# order of the triangles.

Points = NDArray[np.float64]
Triangles = NDArray[np.int64]
Row3 = list[float]

DIAGONAL = 1e-14
"""Share of the trace below which a product of inertia is round-off: a cube's axes are its own then, not those of the noise."""
SWEEPS = 30
"""Sweeps of Jacobi's method, which needs five for any 3 x 3 matrix."""


@dataclass(frozen=True, slots=True)
class HullSolid:
    """The enclosed solid, at density 1: its volume (m³; negative where triangles are wound inwards), and the frame in its
    centre of mass along its principal axes, with the principal moments (m⁵) about them."""

    volume: float
    frame: Pose
    moments: Vector3


def solid(points: Points, triangles: Triangles) -> HullSolid:
    """The solid within a closed surface: ``points`` (n, 3) in m, ``triangles`` (m, 3) of their indices, anticlockwise as seen
    from outside. Raises ValueError where the volume is zero, or no number."""
    origin = 0.5 * (points.min(axis=0) + points.max(axis=0))  # near all of them, so that no digits cancel
    corners = (points - origin)[triangles]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (corners[:, k].T for k in range(3))
    six_fold = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    volume = math.fsum(six_fold) / 6.0
    if not math.isfinite(volume) or volume == 0.0:
        raise ValueError("the triangles enclose no volume")
    sx, sy, sz = ax + bx + cx, ay + by + cy, az + bz + cz
    centre = tuple(math.fsum(six_fold * s) / 24.0 / volume for s in (sx, sy, sz))

    def second(i: int, j: int) -> float:
        """∫ x_i x_j about the centre of mass."""
        first_i, first_j = corners[:, 0, i], corners[:, 0, j]
        others = corners[:, 1, i] * corners[:, 1, j] + corners[:, 2, i] * corners[:, 2, j]
        sums = (sx, sy, sz)[i] * (sx, sy, sz)[j]
        about_origin = math.fsum(six_fold * (first_i * first_j + others + sums)) / 120.0
        return about_origin - volume * centre[i] * centre[j]

    xx, yy, zz, xy, xz, yz = (second(i, j) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    tensor = [[yy + zz, -xy, -xz], [-xy, xx + zz, -yz], [-xz, -yz, xx + yy]]
    moments, axes = principal(tensor)
    x, y, z = (float(origin[k]) + centre[k] for k in range(3))
    return HullSolid(volume, Pose((x, y, z), frames.from_matrix(axes)), moments)


def principal(tensor: list[Row3]) -> tuple[Vector3, frames.Matrix3]:
    """Principal moments of a symmetric tensor, and the rotation matrix whose columns are their axes: those nearest to x, y, z,
    and exactly these where the tensor is diagonal but for round-off. Jacobi's method, in plain floats."""
    a = [list(row) for row in tensor]
    turn = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    small = DIAGONAL * (abs(a[0][0]) + abs(a[1][1]) + abs(a[2][2]))
    for _ in range(SWEEPS):
        if max(abs(a[0][1]), abs(a[0][2]), abs(a[1][2])) <= small:
            break
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if abs(a[p][q]) <= 1e-3 * small:
                continue
            ratio = (a[q][q] - a[p][p]) / (2.0 * a[p][q])
            tangent = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(ratio * ratio + 1.0))
            cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
            sine = tangent * cosine
            for row in (*a, *turn):
                row[p], row[q] = cosine * row[p] - sine * row[q], sine * row[p] + cosine * row[q]
            a[p], a[q] = (
                [cosine * x - sine * y for x, y in zip(a[p], a[q], strict=True)],
                [sine * x + cosine * y for x, y in zip(a[p], a[q], strict=True)],
            )
    columns = ((turn[0][0], turn[0][1], turn[0][2]), (turn[1][0], turn[1][1], turn[1][2]))
    last = frames.cross(columns[0], columns[1])  # rows of a rotation: the third is the product of the others
    return (a[0][0], a[1][1], a[2][2]), (*columns, last)


# Convex hulls: the one meaning of a mesh in a world.
#
# The size of a shape of kind ``mesh`` is the vertices of a convex hull, flat x y z, in the shape's frame; its faces follow from
# them here. Qhull (by scipy, imported where it is called) works in double precision without random numbers: the same points
# give the same hull.

FEWEST_VERTICES = 4
"""Vertices of the smallest solid."""
CENTRED = 1e-14
"""Share of the largest coordinate up to which a centre of mass is at the origin: a file that simspec has written is read
unchanged."""
CACHED_HULLS = 1024
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
    with outward unit ``normals`` (m, 3) and distances ``offsets`` (m,) of their planes from the origin; its volume."""

    vertices: Points
    triangles: Triangles
    normals: Points
    offsets: NDArray[np.float64]
    solid: HullSolid


def mesh_vertices(size: Sequence[float]) -> Points:
    """The vertices (n, 3) of a mesh, from its size."""
    return np.array(size, np.float64).reshape(-1, 3)


def mesh_size(vertices: Points) -> tuple[float, ...]:
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


@functools.lru_cache(maxsize=CACHED_HULLS)
def _hull_of(size: tuple[float, ...]) -> Hull:
    return hull(mesh_vertices(size))


def mesh_triangles(size: Sequence[float]) -> Triangles:
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

    if len(points) < FEWEST_VERTICES or not np.isfinite(points).all():
        raise FlatError(f"a solid has at least {FEWEST_VERTICES} corners at finite places")
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
        orientation = waiting.pop()
        p, q, r = rows[orientation]
        edges = {(p, q), (q, r), (r, p)}
        for other in neighbours[orientation]:
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


# Convex hulls with all faces moved inwards: a ball around every point of one gives the hull again, but for its edges.

LEAST_CLEARANCE = 1.5
"""Times the depth that every face must be away from the centre: below, hardly anything is left."""
SLACK_OF_HALVES = 5.1e-5
"""m: by so much less than the margin a half of a box or cylinder may be: 1.9 mm are within a probe's tolerance, 1.5 mm not."""
FLAT_CORE = 1e-9
"""m: the thickness of a core that has none."""
CORNER_DIGITS = 12
"""After the point (m): corners in which more than three faces meet come out once for each three."""


def inset(size: tuple[float, ...], depth: float) -> tuple[float, ...]:
    """The hull (flat vertices, m) whose faces are ``depth`` (m) within those of the hull ``size``; with a ball of that radius
    around every point it has the same faces, and rounded edges. Raises FlatError where nothing, or hardly anything, is left,
    and OpenHullError as :func:`corners`."""
    if not depth:
        return size
    faces = hull_of(size)
    if faces.offsets.min() <= LEAST_CLEARANCE * depth:
        raise FlatError(
            f"a face is {faces.offsets.min():g} m from the centre, should be more than {LEAST_CLEARANCE * depth:g} m"
        )
    return _moved(size, depth)


def hull_within_margin(size: tuple[float, ...], margin: float) -> tuple[float, ...]:
    """The hull that is passed to an engine which keeps a ``margin`` (m) around its points: :func:`inset` by that, or where the
    hull is too thin for it by what leaves a third of its least half, so that its faces are :func:`margin_excess` of where
    they should be.
    Raises OpenHullError as :func:`corners`."""
    return _moved(size, _depth(size, margin)) if margin else size


def margin_excess(size: tuple[float, ...], margin: float) -> float:
    """How far (m) the faces of :func:`hull_within_margin`, with its margin, are outside of those of the hull; 0 where it is
    thick."""
    return margin - _depth(size, margin) if margin else 0.0


def thickened(kind: str, size: tuple[float, ...], margin: float) -> tuple[float, ...]:
    """The size of a box or cylinder where no half of one is below a ``margin`` (m) that an engine keeps within it; a size that
    is below by less than ``THINNEST`` stays."""
    least = margin - SLACK_OF_HALVES
    if kind == "box":
        return tuple(edge if edge / 2.0 >= least else 2.0 * margin for edge in size)
    radius, length = size
    return (radius if radius >= least else margin, length if length / 2.0 >= least else 2.0 * margin)


def rounded_core(kind: str, size: tuple[float, ...], margin: float) -> tuple[float, ...]:
    """The core that a ball of radius ``margin`` (m) surrounds in an engine that keeps such a margin: the hull, box or cylinder
    whose edges it rounds."""
    if kind == "mesh":
        return hull_within_margin(size, margin)
    if kind == "box":
        return tuple(max(edge - 2.0 * margin, FLAT_CORE) for edge in thickened(kind, size, margin))
    radius, length = thickened(kind, size, margin)
    return (max(radius - margin, FLAT_CORE), max(length - 2.0 * margin, FLAT_CORE))


def _depth(size: tuple[float, ...], margin: float) -> float:
    return min(margin, float(hull_of(size).offsets.min()) / LEAST_CLEARANCE)


@functools.lru_cache(maxsize=1024)
def _moved(size: tuple[float, ...], depth: float) -> tuple[float, ...]:
    from scipy.spatial import HalfspaceIntersection

    faces = hull_of(size)
    planes = np.column_stack([faces.normals, depth - faces.offsets])
    points = np.unique(np.round(HalfspaceIntersection(planes, np.zeros(3)).intersections, CORNER_DIGITS), axis=0)
    return mesh_size(points[corners(points)])
