"""Whether triangles enclose a solid, and which."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simspec.world.hull import Points, Solid, Triangles, solid


@dataclass(frozen=True)
class Enclosed:
    """The solid that a closed surface bounds (None: it is not closed, for the reason ``why``), and of how many separate closed
    surfaces it is made."""

    solid: Solid | None
    why: str = ""
    surfaces: int = 1


def merged(vertices: Points, triangles: Triangles) -> tuple[Points, Triangles]:
    """The same with each place once, in the order of the file, without places that no triangle has and triangles of which two
    corners are at one place. Places
    are merged where they are equal to the last bit: what is nearly so is a gap, which is the file's to close."""
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
    """What merged triangles enclose."""
    if len(triangles) < 4:
        return Enclosed(None, "it has fewer than 4 faces")
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    count = len(vertices)
    there = np.sort(edges[:, 0] * count + edges[:, 1])
    back = np.sort(edges[:, 1] * count + edges[:, 0])
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
