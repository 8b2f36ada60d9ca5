"""Meshes of a stage as files, which a spec can name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from simspec.imports.draft import Draft
from simspec.imports.meshes import made_file
from simspec.imports.usd.shapes import Shape, refuse
from simspec.language.mesh import MOST_VERTICES
from simspec.meshes.files import MeshError
from simspec.meshes.load import load
from simspec.meshes.made import MeshOptions


def name_meshes(shapes: Sequence[Shape], draft: Draft) -> set[int]:
    """Write and name the meshes of shapes; the ``id`` of each shape that can be used."""
    meshes = [shape for shape in shapes if shape.obj]
    paths: list[Path] = []
    for shape in meshes:
        text, path = made_file(shape.obj, shape.prim.called())
        paths.append(path)
        draft.meshes[text] = path
        shape.data = {"mesh": {"file": text}}
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
