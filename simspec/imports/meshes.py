"""Meshes that robot files name, or have within themselves: found or written, read once, and named in the spec."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from simspec.errors import Problem, SpecError
from simspec.imports.draft import plain
from simspec.imports.elements import Element
from simspec.imports.files import Files
from simspec.language.mesh import MOST_VERTICES, SUFFIXES
from simspec.language.words import clean_name
from simspec.meshes.files import MeshError
from simspec.meshes.load import load
from simspec.meshes.made import MadeMesh, MeshOptions
from simspec.outputs.entries import Entries
from simspec.outputs.writing import write_file

COLLADA: Final = ".dae"

FEWER: Final = 128
"""Vertices that a hull keeps of which a file has more than a spec may have: they leave 0.1 to 0.3 mm of
parts of 0.1 m, and take 2 to 4 s of computing once (measured); engines are fast with so few."""

BEGINNING: Final = b"# Made by simspec import"
ENTRIES: Final = Entries("stages", head=BEGINNING, largest=256 * 2**20, bound=512 * 2**20)
"""Where the user's cache has the meshes that files have within themselves, by the hash of their content."""


@dataclass(frozen=True)
class NamedMesh:
    """A mesh of a robot file: the text that names it, the file, and the factors along the axes."""

    text: str
    path: Path
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def data(self) -> dict[str, Any]:
        """The word ``mesh`` of a shape."""
        data: dict[str, Any] = {"file": self.text}
        if self.up is not None:
            data["up"] = self.up
        x, y, z = self.scale
        if not x == y == z:
            data["scale"] = [plain(value) for value in self.scale]
        elif x != 1.0:
            data["scale"] = plain(x)
        return data

    @property
    def up(self) -> str | None:
        """The word ``up``: robots are drawn with the axes that a COLLADA file has, whatever it says is up."""
        return "z" if self.path.suffix.lower() == COLLADA else None


def find_mesh(
    text: str, scale: tuple[float, float, float], element: Element, files: Files, beside: Path | None = None
) -> NamedMesh:
    """The mesh that a text in a file means; ``beside``: the folder that its path starts from, where that is another than the
    imported file's. Raises MissingFileError where there is no such file, SpecError for one that may
    not be read, is of no language of meshes, or has no volume."""
    if not text.lower().endswith(SUFFIXES):
        raise element.error("not a file of triangles that is read", text[:200], " ".join(SUFFIXES))
    if 0.0 in scale:
        raise element.error("a factor of 0 leaves no volume", " ".join(map(str, scale)), "numbers other than 0")
    return NamedMesh(text, files.find(text, element, beside), scale)


def read_meshes(meshes: Sequence[NamedMesh]) -> list[MadeMesh | MeshError]:
    """What is made of each, or why nothing is; it is remembered for the spec that names them."""
    return _made(meshes, None)


def reduced_meshes(meshes: Sequence[NamedMesh]) -> list[MadeMesh | MeshError]:
    """The same of meshes whose hulls have more vertices than a spec may have: :data:`FEWER` are kept."""
    return _made(meshes, FEWER)


def _made(meshes: Sequence[NamedMesh], most: int | None) -> list[MadeMesh | MeshError]:
    wanted = [(mesh.path, MeshOptions(up=mesh.up, scale=mesh.scale, max_vertices=most)) for mesh in meshes]
    made = load(wanted, MOST_VERTICES)
    return [made[one] for one in wanted]


def kept_vertices(mesh: MadeMesh) -> int | None:
    """The word `max_vertices` of a mesh that is reduced; None for one that is whole."""
    return FEWER if any(part.vertices > MOST_VERTICES for part in mesh.parts) else None


def made_file(obj: bytes, called: str) -> tuple[str, Path]:
    """A mesh that a file has within itself, as a file of the cache (else of the folder of temporary files): what a spec calls
    it, and the file. ``obj`` begins with :data:`BEGINNING`. Raises SpecError where it cannot be written."""
    place = ENTRIES.folder()
    folder = place if place is not None else Path(tempfile.gettempdir()) / f"simspec-{os.getuid()}" / ENTRIES.name
    digest = hashlib.sha256(obj).hexdigest()
    path = folder / f"{digest[:32]}.obj"
    try:
        write_file(path, obj.decode(), lambda content: content.startswith(BEGINNING), lasting=False)
    except (OSError, SpecError) as error:
        raise SpecError([Problem(f"a mesh of this file cannot be written to {path.parent}: {error}")]) from None
    return f"meshes/{clean_name(called)[:60]}_{digest[:8]}.obj", path
