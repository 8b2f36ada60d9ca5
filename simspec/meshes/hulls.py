"""Convex hulls with fewer vertices."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from simspec.meshes.reading import MeshError, split
from simspec.world.hull import HullSolid, Points, Triangles, corners, solid

EQUAL = 1e-9
"""Share of the extent within which two distances are the same, so that of a symmetric solid's vertices the first in the file is
taken, not the one that round-off favours."""


ROUND_OFF = 1e-12
"""Share by which a distance from one triangle may differ where it is computed with others."""


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
    beyond = _Beyond(vertices)
    try:
        while len(chosen) < most:
            beyond.update(hull.equations)
            furthest = float(beyond.most.max())
            if furthest <= EQUAL * extent:
                break
            index = int(np.flatnonzero(beyond.most >= furthest - EQUAL * extent)[0])
            chosen.append(index)
            hull.add_points(vertices[index][None])
    finally:
        hull.close()
    kept = vertices[np.sort(np.array(chosen))]
    kept = kept[corners(kept)]  # a corner of few vertices need not be one of many
    return kept, _distance(vertices, kept)


def _tetrahedron(vertices: Points, extent: float) -> list[int]:
    """Four distant vertices: the least along x, the furthest from it, from their line, from their plane."""

    def first(distances: NDArray[np.float64]) -> int:
        return int(np.flatnonzero(distances >= distances.max() - EQUAL * extent)[0])

    index = first(-vertices[:, 0])
    away = vertices - vertices[index]
    two = first(np.sqrt((away**2).sum(axis=1)))
    along = away[two] / np.sqrt((away[two] ** 2).sum())
    across = away - (away * along).sum(axis=1)[:, None] * along
    three = first(np.sqrt((across**2).sum(axis=1)))
    normal = np.cross(along, across[three])
    normal /= np.sqrt((normal**2).sum())
    four = first(np.abs((away * normal).sum(axis=1)))
    return [index, two, three, four]


class _Beyond:
    """How far each vertex lies beyond the face that it is furthest beyond, of a hull that grows: only faces that are new, and
    vertices whose face is gone, are looked at again."""

    def __init__(self, vertices: Points):
        self._vertices = vertices
        self._faces: dict[bytes, int] = {}
        self._count = 0
        self.most: NDArray[np.float64] = np.full(len(vertices), -np.inf)
        """The distances (n,)."""
        self._of: NDArray[np.int64] = np.full(len(vertices), -1)
        """The number of the face of each."""

    def update(self, equations: NDArray[np.float64]) -> None:
        """Take the faces (m, 4) that the hull has now: normals, and offsets from the origin."""
        keys = [row.tobytes() for row in equations]
        known, self._faces = self._faces, {}
        for key in keys:
            number = known.get(key)
            if number is None:
                number, self._count = self._count, self._count + 1
            self._faces[key] = number
        numbers = np.array([self._faces[key] for key in keys])
        is_new = np.array([key not in known for key in keys])
        lost = ~np.isin(self._of, numbers)
        self.most[lost] = -np.inf
        self._look(np.flatnonzero(lost), equations[~is_new], numbers[~is_new])
        self._look(np.arange(len(self._vertices)), equations[is_new], numbers[is_new])

    def _look(self, rows: NDArray[np.int64], equations: NDArray[np.float64], numbers: NDArray[np.int64]) -> None:
        """Compare vertices with faces."""
        if not len(rows) or not len(equations):
            return
        beyond, best = _furthest(self._vertices[rows], equations)
        further = beyond > self.most[rows]
        self.most[rows[further]] = beyond[further]
        self._of[rows[further]] = numbers[best[further]]


def _furthest(vertices: Points, equations: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """How far (n,) each vertex lies beyond the face that it is furthest beyond, and that face's place in ``equations``."""
    most = np.full(len(vertices), -np.inf)
    best = np.zeros(len(vertices), np.int64)
    step = max(1, 4_000_000 // max(1, len(vertices)))
    for start in range(0, len(equations), step):
        part = equations[start : start + step]
        distances = vertices @ part[:, :3].T + part[:, 3]
        at = distances.argmax(axis=1)
        values = distances[np.arange(len(vertices)), at]
        further = values > most
        most[further], best[further] = values[further], at[further] + start
    return most, best


def _distance(vertices: Points, kept: Points) -> float:
    """The largest distance of ``vertices`` from the hull of ``kept``."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(kept)
    beyond, best = _furthest(vertices, hull.equations)
    outside = beyond > 0.0
    points, faces = vertices[outside], hull.simplices[best[outside]]
    # no vertex is further from the hull than from the face that it is furthest beyond: few need to be compared with all
    bound = np.sqrt(_square_to_triangles(points, kept[faces[:, 0]], kept[faces[:, 1]], kept[faces[:, 2]]))
    a, b, c = (kept[hull.simplices[:, k]] for k in range(3))
    worst = 0.0
    for index in np.argsort(-bound, kind="stable"):
        if bound[index] * (1.0 + ROUND_OFF) <= worst:
            break
        worst = max(worst, float(np.sqrt(_square_to_triangles(points[index], a, b, c).min())))
    return worst


def _square_to_triangles(point: Points, a: Points, b: Points, c: Points) -> NDArray[np.float64]:
    """Squares of the distances (m,) of a point from triangles, or of as many points from one each: from the plane where its
    foot is inside, else from the edges."""
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


# Whether triangles enclose a solid, and which.


@dataclass(frozen=True)
class Enclosed:
    """The solid that a closed surface bounds (None: it is not closed, for the reason ``why``), and of how many separate closed
    surfaces it is made."""

    solid: HullSolid | None
    why: str = ""
    surfaces: int = 1


def merged(vertices: Points, triangles: Triangles) -> tuple[Points, Triangles]:
    """The same with each place once, in the order of the file, without places that no triangle has and triangles of which two
    corners are at one place. Places
    are merged where they are equal to the last bit: nearly equal vertices are a gap, a defect of the file."""
    _, first, number = np.unique(vertices + 0.0, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    faces = rank[number.reshape(-1)][triangles]
    a, b, c = faces.T
    whole = (a != b) & (b != c) & (c != a)
    used, faces = np.unique(faces[whole], return_inverse=True)
    return vertices[first[order][used]] + 0.0, faces.reshape(-1, 3)


def enclosed(vertices: Points, triangles: Triangles) -> Enclosed:
    """The solid that merged triangles enclose."""
    if len(triangles) < 4:
        return Enclosed(None, "it has fewer than 4 faces")
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    count = len(vertices)
    begin, end = edges[:, 0], edges[:, 1]
    there = np.sort(begin * count + end)
    back = np.sort(end * count + begin)
    low, high = edges.min(axis=1), edges.max(axis=1)
    _, times = np.unique(low * count + high, return_counts=True)
    if (times == 1).any():
        return Enclosed(None, f"it has {int((times == 1).sum()):,} open edges")
    if not np.array_equal(there, back) or (np.diff(there) == 0).any():
        if (times > 2).any():
            return Enclosed(None, f"{int((times > 2).sum()):,} of its edges have more than two faces")
        return Enclosed(None, "its faces are wound inconsistently")
    try:
        made = solid(vertices, triangles)
    except ValueError:
        return Enclosed(None, "it encloses no volume")
    if made.volume < 0.0:
        return Enclosed(None, "its faces are wound inwards")
    if min(made.moments) <= 0.0:
        return Enclosed(None, "its parts cancel each other: some of them are wound inwards")
    return Enclosed(made, surfaces=_pieces(count, edges))


def _pieces(count: int, edges: np.ndarray) -> int:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    joined = coo_array((np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), shape=(count, count))
    number, labels = connected_components(joined, directed=False)
    del number
    return len(np.unique(labels[edges[:, 0]]))


# Approximate convex decomposition: CoACD, in the process that reads files too.

SECONDS = 120.0
"""Processor time: a profile of 20 triangles takes 2 s on a quiet machine, a robot's link of 26,000 more than three minutes."""
INSTALL = "pip install 'simspec-physics[convex]'"


def convex_pieces(vertices: Points, triangles: Triangles) -> list[Points]:
    """The corners (n, 3) of convex pieces that together are nearly the solid within triangles. Raises MeshError."""
    if find_spec("coacd") is None:
        raise MeshError(f"`as: pieces` needs CoACD, which is not installed: {INSTALL}")
    return split(vertices, triangles, SECONDS)
