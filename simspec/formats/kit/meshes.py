"""Convex hulls, and height fields, as files: Wavefront OBJ with full doubles, one object each. Those of the same numbers share
one file."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable, Iterator
from typing import Final

from simspec.formats.kit.text import environment, numbers
from simspec.world.shapes import field_of
from simspec.world.types import Shape, World

MESHES: Final = "meshes"
"""The folder of the files, beside those that name them."""
SUFFIX: Final = ".obj"
DIGITS: Final = 16
"""Hexadecimal digits of the name: 64 bits of the SHA-256 of the vertices."""

Vertices = tuple[float, ...]
"""Of a hull, flat: x y z (m) of each vertex."""


@functools.lru_cache(maxsize=4096)
def mesh_name(vertices: Vertices) -> str:
    """The name of a hull, by its vertices."""
    return hashlib.sha256(numbers(vertices).encode()).hexdigest()[:DIGITS]


def mesh_file(vertices: Vertices) -> str:
    """The file of a hull, relative to those that name it."""
    return f"{MESHES}/{mesh_name(vertices)}{SUFFIX}"


def mesh_files(hulls: Iterable[Vertices]) -> dict[str, str]:
    """The files of hulls as {relative path: text}."""
    return {mesh_file(vertices): mesh_text(vertices) for vertices in dict.fromkeys(hulls)}


FIELDS: Final = "fields"
"""The folder of the files of height fields."""


def field_file(size: tuple[float, ...]) -> str:
    """The file of a height field as a closed surface of triangles, relative to those that name it."""
    return f"{FIELDS}/{mesh_name(size)}{SUFFIX}"


def field_files(sizes: Iterable[tuple[float, ...]]) -> dict[str, str]:
    """The files of height fields as {relative path: text}."""
    return {field_file(size): _field_text(size) for size in dict.fromkeys(sizes)}


@functools.lru_cache(maxsize=64)
def _field_text(size: tuple[float, ...]) -> str:
    points, triangles = field_of(size).closed()
    rows = (triangles + 1).tolist()
    text: str = (
        environment()
        .get_template("obj/hull.obj.j2")
        .render(vertices=points.tolist(), faces=rows, what="The boundary of a height field")
    )
    return text


def hulls_of(world: World) -> Iterator[Vertices]:
    """The vertices of every mesh of a world, each distinct hull once, in its order."""
    shapes: Iterator[Shape] = (shape for body in world.bodies for shape in body.shapes)
    yield from dict.fromkeys(shape.size for shape in shapes if shape.kind == "mesh")


@functools.lru_cache(maxsize=256)
def mesh_text(vertices: Vertices) -> str:
    """A hull as OBJ: triangles, counterclockwise from outside. Raises FlatError for points that are no solid."""
    from simspec.world.hull import mesh_triangles

    triangles = (mesh_triangles(vertices) + 1).tolist()  # OBJ counts from 1
    points = [vertices[start : start + 3] for start in range(0, len(vertices), 3)]
    text: str = environment().get_template("obj/hull.obj.j2").render(vertices=points, faces=triangles)
    return text
