"""Defects of meshes, for every dialect whose files name OBJ files: what can be wrong with the file, and with who names it.

They are planted into the world "meshes" (``proof/selftest_worlds.py``), whose last body has two shapes of different hulls.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping
from typing import Final

from simspec.dialects.kit.defects import STEP, Files, Plant
from simspec.formats.kit.text import numbers

SUFFIX: Final = ".obj"

Rows = list[list[str]]
"""The lines of a file, by their words."""


def _meshes(files: Files) -> list[str]:
    """The names of the mesh files. Raises LookupError where there are not two."""
    names = sorted(name for name in files if name.endswith(SUFFIX))
    if len(names) < 2:
        raise LookupError(f"{len(names)} mesh files, not two or more")
    return names


def edited(change: Callable[[Rows], None]) -> Plant:
    """A defect in the lines of the first mesh file."""

    def plant(files: Files) -> dict[str, str]:
        name = _meshes(files)[0]
        rows = [line.split() for line in files[name].splitlines() if not line.startswith("#")]
        change(rows)
        return {**files, name: "".join(" ".join(row) + "\n" for row in rows)}

    return plant


def _moved(rows: Rows) -> None:
    vertex = next(row for row in rows if row[0] == "v")
    vertex[1] = str(float(vertex[1]) + STEP)


def _times(x: float, y: float, z: float) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for row in rows:
            if row[0] == "v":
                row[1:] = numbers(float(word) * by for word, by in zip(row[1:], (x, y, z), strict=True)).split()
            elif row[0] == "f" and x * y * z < 0.0:  # seen from outside again
                row[1:] = row[:0:-1]

    return change


def _exchanged(files: Files) -> dict[str, str]:
    first, second, *_ = _meshes(files)
    return {**files, first: files[second], second: files[first]}


def _without(files: Files) -> dict[str, str]:
    missing = _meshes(files)[0]
    return {name: text for name, text in files.items() if name != missing}


def reordered(file: str, name: str) -> Plant:
    """Two shapes of a body exchange their meshes: the last two that follow each other and differ. ``name``: a pattern of what
    names a mesh in ``file``, with the name as its group."""

    def plant(files: Files) -> dict[str, str]:
        text = files[file]
        one, other = [
            pair for pair in itertools.pairwise(re.finditer(name, text)) if pair[0].group(1) != pair[1].group(1)
        ][-1]
        (a, b), (c, d) = one.span(1), other.span(1)
        return {**files, file: text[:a] + other.group(1) + text[b:c] + one.group(1) + text[d:]}

    return plant


FILES: Final[Mapping[str, Plant]] = {
    "mesh, a vertex": edited(_moved),
    "mesh, scale": edited(_times(1.0 + STEP, 1.0 + STEP, 1.0 + STEP)),
    "mesh, mirrored": edited(_times(-1.0, 1.0, 1.0)),
    "mesh of another shape": _exchanged,
    "mesh missing": _without,
}
"""The defects of the files themselves."""
