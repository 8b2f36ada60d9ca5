"""Meshes of SDF: found beside the file that names them, named in the spec, and read once to see whether they can be."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from simspec.errors import Problem, SpecError
from simspec.imports.elements import Element
from simspec.imports.files import Files
from simspec.imports.meshes import BEGINNING, NamedMesh, find_mesh, made_file
from simspec.imports.packages import MissingFileError
from simspec.imports.sdf.values import lost, vector_of
from simspec.language.foreign import Fate, Repair, Severity
from simspec.language.mesh import PIECES
from simspec.language.mesh import SUFFIXES as MESHES
from simspec.world.types import Vector3

MISSING: Final = "missing-meshes"
RULES: Final[Mapping[str, str]] = {
    MISSING: "collision meshes that are not there, or cannot be read, are left out",
}
NO_PART: Final = "a part of a file is not supported: all that is in it is one mesh"
DECOMPOSED: Final = "convex_decomposition"
OPTIMIZATIONS: Final = ("", "convex_hull", DECOMPOSED)


@dataclass
class Meshes:
    """The meshes of one import. ``repair``: rules that are applied."""

    files: Files
    repair: tuple[str, ...]
    named: dict[str, Path] = field(default_factory=dict)
    """Every file, by the text that the spec names it by."""
    made: set[str] = field(default_factory=set)
    """Those of them that the file has within itself."""
    repairs: list[Repair] = field(default_factory=list)

    def write(self, corners: Sequence[Vector3], faces: Sequence[Sequence[int]], called: str) -> NamedMesh:
        """The mesh of a solid that the file says by its corners (m) and faces, which are counted from 0. Raises SpecError."""
        lines = [BEGINNING.decode(), *(f"v {x!r} {y!r} {z!r}" for x, y, z in corners)]
        lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
        text, path = made_file(("\n".join(lines) + "\n").encode(), called)
        self.named[text] = path
        self.made.add(text)
        return NamedMesh(text, path)

    def read(self, shape: Element, kind: Element, folder: Path) -> tuple[dict[str, Any], NamedMesh] | None:
        """The word of a mesh; None for one that is left out, which is said. ``folder``: of the file that names it. Raises
        SpecError."""
        uri = kind.child("uri")
        if uri is None or not uri.text:
            raise kind.error("<mesh> has no <uri>")
        scale = vector_of(kind, "scale", (1.0, 1.0, 1.0))
        as_pieces = self._pieces(shape, kind)
        try:
            for part in kind.look("submesh"):
                raise part.error(NO_PART, hint="save the part as a file of its own")
            mesh = self._find(uri, scale, folder)
        except SpecError as error:
            known = isinstance(error, MissingFileError) or shape.tag == "visual"
            if not known and uri.text.lower().endswith(MESHES):
                raise
            self.without(shape, error.problems[0])
            return None
        mesh = replace(mesh, text=self._called(mesh))
        return ({"mesh": {**mesh.data(), "as": PIECES} if as_pieces else mesh.data()}, mesh)

    def _find(self, uri: Element, scale: Vector3, folder: Path) -> NamedMesh:
        """The mesh of a URI. A path from the root of all files that leads nowhere is one from the file's folder, as readers
        have it. Raises SpecError."""
        try:
            return find_mesh(uri.text, scale, uri, self.files, folder)
        except SpecError:
            beside = uri.text.lstrip("/")
            if beside == uri.text or not (folder / beside).is_file():
                raise
        mesh = find_mesh(beside, scale, uri, self.files, folder)
        uri.set_aside(None, Fate.CARRIED, "beside the file: there is no such path from the root", Severity.INFORMATION)
        return mesh

    def _pieces(self, shape: Element, kind: Element) -> bool:
        """Whether a collision is to be decomposed into convex pieces."""
        how = kind.word("optimization", "") or ""
        if how not in OPTIMIZATIONS:
            raise kind.error("not a way to simplify a mesh", found=how[:80], allowed=", ".join(OPTIMIZATIONS[1:]))
        for child in kind.look(DECOMPOSED):
            reason = "how many pieces there are, and how they are found, is not in the language"
            lost(child, reason, Severity.INFORMATION)
        return how == DECOMPOSED and shape.tag == "collision"

    def _called(self, mesh: NamedMesh) -> str:
        """What the spec calls a file: the file's own text, unless another file of this import has that."""
        if self.named.get(mesh.text, mesh.path) != mesh.path:
            mesh = replace(mesh, text=Path(os.path.relpath(mesh.path, self.files.path.resolve().parent)).as_posix())
        self.named[mesh.text] = mesh.path
        return mesh.text

    def without(self, shape: Element, why: Problem) -> None:
        """Leave a mesh out: one that is only seen, or by the rule. Raises SpecError for another."""
        found = f": {why.found}" if why.found else ""
        if shape.tag == "visual":
            lost(shape, f"{why.message}{found}", Severity.APPEARANCE, why.hint or "")
            return
        if MISSING not in self.repair:
            rule = f"simspec import --repair {MISSING}: {RULES[MISSING]}"
            raise SpecError([replace(why, hint="; ".join(filter(None, [why.hint, rule])))])
        lost(shape, f"left out by the rule {MISSING}: {why.message}{found}")
        self.repairs.append(Repair(MISSING, shape.location, f"a mesh is left out: {why.message}{found}"))
