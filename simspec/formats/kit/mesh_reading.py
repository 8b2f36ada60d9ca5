"""Files of convex hulls as they stand: Wavefront OBJ, read by neither the writer nor an engine, and held to be what a hull is.

Read are comments, ``o``, ``v`` and triangles of ``f``; everything else is refused: readers differ in what they make of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from simspec.errors import SpecError
from simspec.outputs.files import files_below, read_bytes

# --- height fields, from the triangles of their boundary ---

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
    across, along = points[used, 0], points[used, 1]
    x, column = np.unique(across, return_inverse=True)
    y, row = np.unique(along, return_inverse=True)
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
    local = {tuple(corners) for corners in turned.tolist()}
    wanted = set()
    for row in range(rows - 1):
        for at in range(row * columns, row * columns + columns - 1):
            wanted |= {(at, at + 1, at + columns + 1), (at, at + columns + 1, at + columns)}
    if local != wanted or len(top) != len(wanted):
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
    spots = np.unique(points[:, :2], axis=0, return_inverse=True)[1].ravel()
    walls = np.sort(spots[triangles[low[triangles].any(axis=1) & ~low[triangles].all(axis=1)]], axis=1)
    if (np.diff(walls, axis=1) != 0).all(axis=1).any():
        raise ValueError("its walls are not upright below its rim")
    count = len(points)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    begin, end = edges[:, 0], edges[:, 1]
    there, back = np.sort(begin * count + end), np.sort(end * count + begin)
    if (np.diff(there) == 0).any() or not np.array_equal(there, back):
        raise ValueError("the surface is not closed, or its triangles are not all turned the same way")


SUFFIX: Final = ".obj"
LARGEST_FILE: Final = 16 * 2**20
"""Bytes of one file; that of 100,000 vertices has 12 million."""
LARGEST_FIELD: Final = 64 * 2**20
"""Bytes of the file of a height field; that of 262,144 heights has 35 million."""
MOST_VERTICES: Final = 80_000
"""Of one hull: four times as many as a spec's may have, since that of the same faces moved inwards has so many corners where no
four planes meet in a point."""
BENT: Final = 1e-9
"""Share of a hull's extent by which a vertex may stand out of the plane of the adjacent triangle."""
ROUND_OFF: Final = 1e-14
"""Of a product of two edges, relative to the extent squared: it decides over the plane of a sliver."""


def read_meshes(folder: Path, fields: str = "") -> dict[str, tuple[float, ...]]:
    """The vertices (flat, m) of every OBJ file below a folder, by its path relative to it; of those below ``fields`` the sizes
    of the height fields that they are.

    Raises ValueError, which names file and line, where one is no closed convex surface with its faces counterclockwise from
    outside.
    """
    try:
        names = [name for name in files_below(folder) if name.endswith(SUFFIX)]
    except SpecError as error:
        raise ValueError(str(error)) from None
    return {
        name: read_field(folder, name)
        if fields and name.startswith(f"{fields}/")
        else tuple(read_triangles(folder, name)[0].ravel().tolist())
        for name in names
    }


def read_field(folder: Path, name: str) -> tuple[float, ...]:
    """The size of the height field that is the surface in one OBJ file of a folder. Raises as :func:`read_triangles`."""
    try:
        vertices, faces = _parsed(read_bytes(folder / name, LARGEST_FIELD, folder), name)
    except SpecError as error:
        raise ValueError(str(error)) from None
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise ValueError(f"{name}: a triangle has a vertex that does not exist")
    try:
        return field_of_triangles(vertices[faces])
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def read_triangles(folder: Path, name: str) -> tuple[Array, Indices]:
    """The vertices (n, 3) of one OBJ file of a folder, and its triangles (m, 3), indices of these. Raises FileNotFoundError,
    and ValueError as :func:`read_meshes`."""
    try:
        return triangles(read_bytes(folder / name, LARGEST_FILE, folder), name)
    except SpecError as error:
        raise ValueError(str(error)) from None


def triangles(content: bytes, file: str) -> tuple[Array, Indices]:
    """The same of the file's content; ``file``: its name in errors."""
    vertices, faces = _parsed(content, file)
    fault = _fault(vertices, faces)
    if fault:
        raise ValueError(f"{file}: {fault}")
    return vertices, faces


def _parsed(content: bytes, file: str) -> tuple[Array, Indices]:
    try:
        lines = content.decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise ValueError(f"{file}: not ASCII at byte {error.start}") from None
    objects = 0
    rows: Mapping[str, list[list[str]]] = {"v": [], "f": []}
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if words[0] == "o":
            objects += 1
        elif words[0] in rows and len(words) == 4 and "_" not in line:  # numpy reads 1_000
            rows[words[0]].append(words[1:])
        else:
            raise ValueError(f"{file}:{number}: {line[:60]!r} is no vertex of three numbers and no triangle")
    if objects != 1:
        raise ValueError(f"{file}: {objects} objects, should be one")
    try:
        vertices = np.array(rows["v"], dtype=float).reshape(-1, 3)
        faces = np.array(rows["f"], dtype=np.int64).reshape(-1, 3) - 1
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{file}: {error}") from None
    return vertices, faces


def _fault(vertices: Array, faces: Indices) -> str:
    """The fault of a hull; "" none."""
    count = len(vertices)
    if not 4 <= count <= MOST_VERTICES:
        return f"{count} vertices, should be 4 to {MOST_VERTICES:,}"
    if not np.isfinite(vertices).all():
        return "a vertex is not finite"
    if len(faces) != 2 * count - 4:
        return f"{len(faces)} triangles of {count} vertices, a closed surface has {2 * count - 4}"
    if faces.min() < 0 or faces.max() >= count or len(np.unique(faces)) != count:
        return "triangles do not use exactly the vertices that there are"
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    begin, end = edges[:, 0], edges[:, 1]
    there, back = begin * count + end, end * count + begin
    order, order_back = np.argsort(there), np.argsort(back)
    if (np.diff(there[order]) == 0).any() or not np.array_equal(there[order], back[order_back]):
        return "the surface is not closed, or its triangles are not all turned the same way"
    beyond = np.empty(len(edges), dtype=np.int64)  # of each triangle's edges the corner of the triangle across
    beyond[order] = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])[order_back]
    if _bent(vertices, faces, beyond.reshape(3, -1)):
        return "the surface is not convex, or its triangles are not counterclockwise from outside"
    return ""


def _bent(vertices: Array, faces: Indices, beyond: Indices) -> bool:
    """Whether a closed surface bends inwards at some edge. One that does at none, and is a sphere by its counts, is convex."""
    extent = float(np.ptp(vertices, axis=0).max())
    first, second, third = (vertices[faces[:, corner]] for corner in range(3))
    normals = np.cross(second - first, third - first)
    allowed = extent * (BENT * np.linalg.norm(normals, axis=1) + ROUND_OFF * extent * extent)
    return any((np.sum(normals * (vertices[across] - first), axis=1) > allowed).any() for across in beyond)
