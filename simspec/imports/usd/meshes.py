"""Meshes of a stage as files, which a spec can name: in the user's cache, by the hash of their content."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from simspec.errors import Problem, SpecError
from simspec.imports.draft import Draft
from simspec.imports.usd.shapes import Shape, refuse
from simspec.language.mesh import MOST_VERTICES
from simspec.language.words import clean_name
from simspec.meshes.files import MeshError
from simspec.meshes.load import load
from simspec.meshes.made import MeshOptions
from simspec.outputs.entries import Entries
from simspec.outputs.writing import write_file

BEGINNING: Final = b"# Made by simspec import"
ENTRIES: Final = Entries("stages", head=BEGINNING, largest=256 * 2**20, bound=512 * 2**20)
"""Where the user's cache is."""


def folder() -> Path:
    """Where the files are: in the cache, else in the folder of temporary files."""
    place = ENTRIES.folder()
    return place if place is not None else Path(tempfile.gettempdir()) / f"simspec-{os.getuid()}" / ENTRIES.name


def name_meshes(shapes: Sequence[Shape], draft: Draft) -> set[int]:
    """Write and name the meshes of shapes; the ``id`` of each shape that can be used."""
    meshes = [shape for shape in shapes if shape.obj]
    paths: list[Path] = []
    for shape in meshes:
        digest = hashlib.sha256(shape.obj).hexdigest()
        path = folder() / f"{digest[:32]}.obj"
        try:
            write_file(path, shape.obj.decode(), lambda content: content.startswith(BEGINNING), lasting=False)
        except (OSError, SpecError) as error:
            raise SpecError([Problem(f"a mesh of this stage cannot be written to {path.parent}: {error}")]) from None
        paths.append(path)
        text = f"meshes/{clean_name(shape.prim.called())[:60]}_{digest[:8]}.obj"
        draft.meshes[text] = path
        shape.data = {**shape.data, "mesh": {"file": text, **shape.data["mesh"]}}
    made = load([(path, MeshOptions()) for path in paths], MOST_VERTICES)
    usable = {id(shape) for shape in shapes if shape.data}
    for shape, path in zip(meshes, paths, strict=True):
        result = made[path, MeshOptions()]
        if isinstance(result, MeshError):
            draft.meshes.pop(shape.data["mesh"]["file"], None)
            refuse(shape, draft, str(result))
            usable.discard(id(shape))
        elif result.enclosed is None:
            shape.data["mesh"]["mass_from"] = "hull"
    return usable
