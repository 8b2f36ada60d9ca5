"""The format ``mjcf``: one XML file, ``model.xml``."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from simspec.formats.kit.contract import Format
from simspec.formats.kit.mesh_reading import read_meshes
from simspec.formats.kit.meshes import mesh_files
from simspec.formats.kit.plain import Plain, losses
from simspec.formats.kit.text import environment
from simspec.formats.mjcf.document import Document
from simspec.formats.mjcf.plain import SUPPORT, model_and_losses
from simspec.formats.mjcf.reading import read_document
from simspec.formats.mjcf.tree import Body, Model
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.support.declarations import Table
from simspec.world import types
from simspec.world.types import World

MODEL: Final = "model.xml"
DEEPEST_INDENT: Final = 24
"""Levels that are indented; deeper ones stay there, so that a chain's text grows with its length, not its square."""


class Mjcf(Format):
    """The MJCF language, without what any one program makes of it."""

    NAME: ClassVar[str] = "mjcf"
    SUPPORT: ClassVar[Table] = SUPPORT
    RANGED: ClassVar[tuple[str, ...]] = SCALAR_JOINTS

    def write(self, tree: Any) -> dict[str, str]:
        """``model.xml`` of a Model (``tree.py``), and the files of its meshes. Raises ValueError for numbers that are not
        finite, and for bodies that are not listed depth first."""
        if not isinstance(tree, Model):
            raise TypeError(f"{type(tree).__name__} is not a Model of MJCF")
        flags = tuple((name, "enable" if on else "disable") for name, on in tree.flags)
        template = environment().get_template("mjcf/model.xml.j2")
        text = template.render(model=tree, flags=flags, events=_events(tree.bodies))
        return {MODEL: text, **mesh_files(mesh.vertices for mesh in tree.meshes)}

    def plain(self, world: World) -> Plain:
        """``model.xml`` in the language's own words. Raises UnsupportedError for joints that the language refuses."""
        model, more = model_and_losses(world)
        return Plain(self.write(model), losses(world, SUPPORT, more))

    def parts(self, world: World, files: Mapping[str, str]) -> Mapping[str, tuple[types.Body, ...]]:
        """``model.xml``."""
        return {MODEL: world.bodies}

    def read(self, folder: Path) -> Document:
        """The document of ``model.xml`` in ``folder``, with the files of meshes below it; files that it includes are not read.

        Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no MJCF,
        or a mesh is no convex hull.
        """
        return dataclasses.replace(read_document(folder / MODEL), meshes=read_meshes(folder))


def _events(bodies: tuple[Body, ...]) -> Iterator[tuple[str, Body | None]]:
    """Opening and closing of bodies, in the order of the file: (indent, body), or (indent, None) to close."""
    indents = [" " * (4 + 2 * depth) for depth in range(DEEPEST_INDENT)]
    if not bodies:
        return
    following = [body.depth for body in bodies[1:]] + [0]
    if bodies[0].depth != 0:
        raise ValueError(f"the body {bodies[0].name!r} is the first and stands in another")
    for body, after in zip(bodies, following, strict=True):
        if not 0 <= after <= body.depth + 1:
            raise ValueError(f"what follows the body {body.name!r} stands in {after} bodies, of which one is not there")
        yield indents[min(body.depth, DEEPEST_INDENT - 1)], body
        for level in range(body.depth, after - 1, -1):
            yield indents[min(level, DEEPEST_INDENT - 1)], None
