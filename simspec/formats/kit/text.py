"""Text of files: numbers that read back to the same double, JSON, templates, and OBJ files of meshes."""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Iterable, Iterator
from typing import Any, Final

from simspec import numerals
from simspec.files import resource_folder
from simspec.world.canonical import to_plain
from simspec.world.types import Shape, World


def number(value: float) -> str:
    """The shortest text that reads back to the same double; whole numbers without a point, no negative zero.

    Raises ValueError for NaN and infinity, which no format can carry.
    """
    if not math.isfinite(value):
        raise ValueError(f"{value} cannot be written")
    if value == 0.0:
        return "0"
    text = repr(float(value))
    return text[:-2] if text.endswith(".0") else text


def numbers(values: Any) -> str:
    """Several numbers, separated by one space."""
    return " ".join([number(value) for value in values])


def finite_numbers(text: str, count: int | None = None) -> tuple[float, ...]:
    """The numbers in ``text``, by white space. Raises ValueError where they are none, not finite, or not ``count``."""
    try:
        values = numerals.numbers(text)
    except numerals.NumeralError as error:
        what = "finite numbers" if str(error) == "not finite" else f"numbers{error.suffix}"
        raise ValueError(f"is {text[:60]!r}, should be {what}") from None
    if count is not None and len(values) != count:
        raise ValueError(f"has {len(values)} numbers, should have {count}")
    return values


_in_line: Final = json.JSONEncoder(allow_nan=False, ensure_ascii=False).encode
_STRUCTURED: Final = (dict, list, str)


def json_text(content: Any) -> str:
    """JSON as text: sorted keys, two spaces, lists of numbers on one line, newline at the end. (``json`` itself writes indented
    text in Python, and its lines on their own in C.) Raises ValueError where a number is not finite."""
    return _indented(to_plain(content), "\n") + "\n"


def _indented(value: Any, line: str) -> str:
    """Plain data as text; ``line``: the line break and the indentation of the closing bracket."""
    inner = line + "  "
    if isinstance(value, dict) and value:
        items = [f"{_key(key)}: {_indented(item, inner)}" for key, item in sorted(value.items())]
        return "{" + inner + ("," + inner).join(items) + line + "}"
    if isinstance(value, list) and any(isinstance(item, _STRUCTURED) for item in value):
        return "[" + inner + ("," + inner).join([_indented(item, inner) for item in value]) + line + "]"
    return _in_line(value)


def _key(key: Any) -> str:
    return _in_line(key if isinstance(key, str) else _in_line(key))


_ESCAPES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&#34;", "'": "&#39;"})
"""As the templates' own escaping."""


def attributes(pairs: Iterable[tuple[str, Any]]) -> str:
    """XML attributes, each behind a space: flags as ``true`` and ``false``, numbers, several numbers, and texts, escaped."""
    return "".join([f' {name}="{_attribute(value)}"' for name, value in pairs])


def _attribute(value: Any) -> str:
    if isinstance(value, str):
        return value.translate(_ESCAPES)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    return number(value) if isinstance(value, float) else numbers(value)


@functools.cache
def environment() -> Any:
    """The one Jinja2 environment: StrictUndefined, XML autoescaping, the filters ``number``, ``numbers`` and ``attributes``."""
    import jinja2
    from markupsafe import Markup

    found = jinja2.Environment(
        loader=jinja2.FileSystemLoader(resource_folder("templates")),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    # digits, signs, points and e need no escaping: marking them safe spares the escape of every number
    found.filters["number"] = lambda value: Markup(number(value))
    found.filters["numbers"] = lambda values: Markup(numbers(values))
    found.filters["attributes"] = lambda pairs: Markup(attributes(pairs))
    return found


# --- hulls and height fields as Wavefront OBJ with full doubles; those of equal numbers share a file ---

MESHES: Final = "meshes"
"""The folder of the files, next to those that name them."""
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
    from simspec.world.shapes import field_of

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
