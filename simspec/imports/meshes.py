"""Meshes that robot files name: found, read once to see whether they can be, and named in the spec."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from simspec.imports.draft import plain
from simspec.imports.elements import Element
from simspec.imports.files import Files
from simspec.language.mesh import MOST_VERTICES, SUFFIXES
from simspec.meshes.files import MeshError
from simspec.meshes.load import load
from simspec.meshes.made import MadeMesh, MeshOptions

COLLADA: Final = ".dae"

FEWER: Final = 128
"""Vertices that a hull keeps of which a file has more than a spec may have: they leave 0.1 to 0.3 mm of
parts of 0.1 m, and take 2 to 4 s of computing once (measured); engines are fast with so few."""


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
