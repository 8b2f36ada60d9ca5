"""From meshes and height fields of an MJCF document back to those of a world; shares no code with what writes them."""

from __future__ import annotations

from typing import Final

from simspec.formats.mjcf.reading import MjcfDocument, MjcfItem

IN_MESH: Final = {"name", "file", "inertia"}
"""The attributes of a mesh. Others would scale, move or cut it."""
MESH_FOLDERS: Final = {"meshdir", "assetdir", "strippath"}
"""Attributes of the compiler that change which file a name means."""
IN_FIELD: Final = {"name", "nrow", "ncol", "size", "elevation"}
"""The attributes of a height field."""
MOST_POINTS: Final = 1_000_000
"""Points of one height field that are read."""


Sizes = dict[str, tuple[float, ...]]
"""Sizes of shapes by the names of what they are."""


def read_assets(document: MjcfDocument) -> tuple[Sizes, Sizes]:
    """The meshes and the height fields of a document. Raises ValueError for what is not read."""
    if document.section("asset") and (moved := MESH_FOLDERS & document.compiler.own.keys()):
        raise document.compiler.refused(f"{min(moved)} is not read")
    meshes, fields, files = Sizes(), Sizes(), set[str]()
    for item in document.section("asset"):
        if item.tag == "hfield":
            name, size = _height_field(item)
            if fields.setdefault(name, size) is not size:
                raise item.refused("a second height field of its name")
            continue
        if item.tag != "mesh" or item.values.keys() != IN_MESH or item.element.children:
            raise item.refused(f"is not read, but for meshes that have {', '.join(sorted(IN_MESH))} and nothing else")
        name, file = item.text("name"), item.text("file")
        if name in meshes or file not in document.meshes:
            raise item.refused(f"a second mesh of its name, or without its file {file[:60]!r}")
        if item.text("inertia") != "convex":
            raise item.refused("inertia should be convex")
        meshes[name] = document.meshes[file]
        files.add(file)
    if unused := document.meshes.keys() - files:
        raise ValueError(f"{document.file}: no mesh has the files {sorted(unused)}")
    return meshes, fields


def _height_field(item: MjcfItem) -> tuple[str, tuple[float, ...]]:
    """The name and the size (``world/shapes.py``) of a height field. Raises ValueError where its elevations are not what
    every reader leaves as it is: shares from 0 to 1, or 0 throughout."""
    if item.values.keys() != IN_FIELD or item.element.children:
        raise item.refused(f"is not read, but with {', '.join(sorted(IN_FIELD))} and nothing else")
    rows, columns = (item.number(name) for name in ("nrow", "ncol"))
    if not all(2.0 <= count <= MOST_POINTS and count == int(count) for count in (rows, columns)):
        raise item.refused(f"{rows:g} rows and {columns:g} columns")
    if rows * columns > MOST_POINTS:
        raise item.refused(f"{rows:g} × {columns:g} points, more than the {MOST_POINTS:,} that are read")
    half_x, half_y, top, base = item.numbers("size", 4)
    shares = item.numbers("elevation", int(rows * columns))
    if min(shares) != 0.0 or max(shares) not in (0.0, 1.0):
        raise item.refused(f"its elevations are from {min(shares):g} to {max(shares):g}, should be from 0 to 1")
    wide = int(columns)
    northward = [shares[wide * row : wide * (row + 1)] for row in reversed(range(int(rows)))]
    heights = (top * share for row in northward for share in row)
    return item.text("name"), (rows, columns, 2.0 * half_x, 2.0 * half_y, base, *heights)
