"""Defects of height fields: in the file of the surface, and in what names it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from simspec.dialects.kit.defects import STEP, Files, Plant
from simspec.formats.kit.meshes import FIELDS
from simspec.formats.kit.text import number

Rows = list[list[str]]
"""The lines of a file, by their words."""


def _field(files: Files) -> str:
    """The name of the one file of a height field. Raises LookupError where there is not one."""
    names = [name for name in files if name.startswith(f"{FIELDS}/")]
    if len(names) != 1:
        raise LookupError(f"{len(names)} height fields, not one")
    return names[0]


def _edited(change: Callable[[Rows, Rows], None]) -> Plant:
    """A defect in the file; ``change`` gets its vertices and its triangles."""

    def plant(files: Files) -> dict[str, str]:
        name = _field(files)
        rows = [line.split() for line in files[name].splitlines() if not line.startswith("#")]
        change([row for row in rows if row[0] == "v"], [row for row in rows if row[0] == "f"])
        return {**files, name: "".join(" ".join(row) + "\n" for row in rows)}

    return plant


def _raised(vertices: Rows, triangles: Rows) -> None:
    lowest = min(float(row[3]) for row in vertices)
    inner = next(row for row in vertices[5:] if float(row[3]) > lowest)
    inner[3] = number(float(inner[3]) + STEP)


def _longer(vertices: Rows, triangles: Rows) -> None:
    for row in vertices:
        row[1] = number(float(row[1]) * (1.0 + STEP))


def _thicker(vertices: Rows, triangles: Rows) -> None:
    lowest = min(float(row[3]) for row in vertices)
    for row in vertices:
        if float(row[3]) == lowest:
            row[3] = number(lowest * (1.0 + STEP))


def _mirrored(vertices: Rows, triangles: Rows) -> None:
    for row in vertices:
        row[1] = number(-float(row[1]) + 0.0)
    for row in triangles:
        row[1:] = row[:0:-1]


def _missing(files: Files) -> dict[str, str]:
    missing = _field(files)
    return {name: text for name, text in files.items() if name != missing}


GROUND_DEFECTS: Final[Mapping[str, Plant]] = {
    "height field, a height": _edited(_raised),
    "height field, length": _edited(_longer),
    "height field, base": _edited(_thicker),
    "height field, mirrored": _edited(_mirrored),
    "height field missing": _missing,
}
