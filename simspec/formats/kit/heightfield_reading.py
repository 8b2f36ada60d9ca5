"""From triangles back to the height field whose boundary they are; shares no code with what makes them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

EVEN: Final = 1e-6
"""Share of the extent by which points of a grid may be off: single precision keeps 6e-8 of it."""

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def field_of_triangles(corners: Array) -> tuple[float, ...]:
    """The size (``world/shapes.py``) of the height field whose whole boundary is these triangles (n, 3, 3), in any order,
    anticlockwise as seen from outside.

    Raises ValueError where they are no such boundary: a grid of points over an even rectangle about the origin, each cell split
    along the diagonal from its least to its greatest corner, upright walls, and a flat bottom.
    """
    if len(corners) < 2 or not np.isfinite(corners).all():
        raise ValueError("no closed surface of triangles at finite places")
    points, flat = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    triangles = flat.reshape(-1, 3).astype(np.int64)
    bottom = float(points[:, 2].min())
    low = points[:, 2] == bottom
    top = triangles[~low[triangles].any(axis=1)]
    used = np.unique(top)
    x, column = np.unique(points[used, 0], return_inverse=True)
    y, row = np.unique(points[used, 1], return_inverse=True)
    rows, columns = len(y), len(x)
    if rows < 2 or columns < 2 or len(used) != rows * columns:
        raise ValueError(f"{len(used)} points above the bottom, which are no grid")
    extent = float(np.ptp(points, axis=0).max())
    for along in (x, y):
        even = np.linspace(along[0], along[-1], len(along))
        if np.abs(along - even).max() > EVEN * extent or abs(along[0] + along[-1]) > EVEN * extent:
            raise ValueError("its points are not evenly about the origin")
    place = np.full(len(points), -1, np.int64)
    place[used] = row.ravel() * columns + column.ravel()
    _check_top(place[top], rows, columns)
    _check_rest(points, triangles, low, place, rows, columns)
    heights = np.empty(rows * columns)
    heights[place[used]] = points[used, 2]
    x_length, y_length = float(x[-1] - x[0]), float(y[-1] - y[0])
    return (float(rows), float(columns), x_length, y_length, -bottom, *heights.tolist())


def _check_top(top: Indices, rows: int, columns: int) -> None:
    """That each cell is two triangles along its diagonal; ``top``: of each triangle the places of its corners in the grid."""
    least = top.argmin(axis=1)[:, None]
    turned = np.take_along_axis(top, (least + np.arange(3)) % 3, axis=1)
    own = {tuple(corners) for corners in turned.tolist()}
    wanted = set()
    for row in range(rows - 1):
        for at in range(row * columns, row * columns + columns - 1):
            wanted |= {(at, at + 1, at + columns + 1), (at, at + columns + 1, at + columns)}
    if own != wanted or len(top) != len(wanted):
        raise ValueError("its cells are not all two triangles along the diagonal from the least x and y")


def _check_rest(
    points: Array, triangles: Indices, low: NDArray[np.bool_], place: Indices, rows: int, columns: int
) -> None:
    """That walls and bottom close it."""
    row, column = np.divmod(place, columns)
    rim = (place >= 0) & ((row == 0) | (row == rows - 1) | (column == 0) | (column == columns - 1))
    feet = {tuple(foot) for foot in points[low][:, :2].tolist()} - {(0.0, 0.0)}
    if feet - {tuple(point) for point in points[rim][:, :2].tolist()} or ((place < 0) & ~low).any():
        raise ValueError("its walls are not upright below its rim")
    count = len(points)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there, back = np.sort(edges[:, 0] * count + edges[:, 1]), np.sort(edges[:, 1] * count + edges[:, 0])
    if (np.diff(there) == 0).any() or not np.array_equal(there, back):
        raise ValueError("the surface is not closed, or its triangles are not all turned the same way")
