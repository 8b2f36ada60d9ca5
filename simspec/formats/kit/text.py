"""Text of files: numbers that read back to the same double, JSON, templates, OBJ files of meshes; and XML files as elements."""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

from simspec import numerals
from simspec.files import resource_folder
from simspec.outputs.files import read_bytes
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


# XML files as elements with their lines, for all readers of formats and all importers. The parser is the standard library's
# expat. It follows nothing out of the file and ends in bounded time: no DOCTYPE (and so no entities and no external files), and
# bounds on size, elements, depth, attributes and the length of a tag.

LARGEST_FILE: Final = 128 * 2**20
"""Bytes; the largest known file, of 10,000 bodies, has 20 MB."""
MOST_ELEMENTS: Final = 500_000
"""A world of 10,000 bodies has 50,000 to 300,000, by the language."""
MOST_DEPTH: Final = 100_000
"""Elements in one another: a chain of bodies nests each in its parent."""
MOST_ATTRIBUTES: Final = 256
"""Of one element; the richest of the languages read here have some fifty."""
LONGEST_TAG: Final = 16 * 2**20
"""Bytes between ``<`` and ``>``, and of the texts of one element: expat holds it whole before it calls a handler."""
CHUNK: Final = 2**20


class XmlError(ValueError):
    """A text is not well-formed, or beyond a bound, at ``line`` and ``column`` (from 1); ``why`` is without the place."""

    def __init__(self, name: str, line: int, why: str, column: int = 1):
        super().__init__(f"{name}:{line}: {why}")
        self.line, self.column, self.why = line, column, why


@dataclass(frozen=True, slots=True, eq=False)
class XmlElement:
    """An element, compared by identity. ``line`` (from 1): where it begins. As XML defines it, comments, CDATA marks and
    references do not divide ``text``; child elements do: the texts before, between and after them are joined by a blank,
    each without white space at its ends. Methods raise ValueError with file and line."""

    tag: str
    line: int
    attributes: Mapping[str, str]
    children: tuple[XmlElement, ...]
    text: str = ""
    file: str = ""

    def __repr__(self) -> str:
        return f"<{self.tag}> in line {self.line}"

    def error(self, why: str) -> ValueError:
        """The error of something that is wrong here."""
        return ValueError(f"{self.file}:{self.line}: {why}")

    def refused(self, why: str) -> ValueError:
        """The same, with tag and name."""
        name = self.attributes.get("name")
        return self.error(f"<{self.tag}>: {why}" if name is None else f"<{self.tag}> {name[:200]!r}: {why}")

    def walk(self) -> Iterator[XmlElement]:
        """This element and all below it, in the order of the file, however deep."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting.extend(reversed(element.children))

    # --- children ---

    def all(self, tag: str) -> tuple[XmlElement, ...]:
        """The children of this tag."""
        return tuple(child for child in self.children if child.tag == tag)

    def child(self, tag: str) -> XmlElement | None:
        """The first child of this tag."""
        return next((child for child in self.children if child.tag == tag), None)

    def find(self, tag: str) -> XmlElement | None:
        """The only child of this tag. Raises ValueError where there are several."""
        elements = self.all(tag)
        if len(elements) > 1:
            raise self.refused(f"has {len(elements)} <{tag}>, should have one")
        return elements[0] if elements else None

    def need(self, tag: str) -> XmlElement:
        """The first child of this tag. Raises ValueError where there is none."""
        if (found := self.child(tag)) is None:
            raise self.error(f"<{self.tag}> has no <{tag}>")
        return found

    def text_of(self, tag: str) -> str | None:
        """The text of the only child of this tag."""
        found = self.find(tag)
        return None if found is None else found.text

    def numbers_of(self, tag: str, count: int | None = None) -> tuple[float, ...] | None:
        """The finite numbers of the only child of this tag. Raises ValueError for others, or not ``count``."""
        found = self.find(tag)
        if found is None:
            return None
        try:
            return finite_numbers(found.text, count)
        except ValueError as error:
            raise found.refused(str(error)) from None

    def number_of(self, tag: str) -> float | None:
        """The number of the only child of this tag."""
        values = self.numbers_of(tag, 1)
        return None if values is None else values[0]

    def flag_of(self, tag: str) -> bool | None:
        """Whether the only child of this tag is true. Raises ValueError for other words than true and false."""
        text = self.text_of(tag)
        if text not in ("true", "false", None):
            raise self.refused(f"<{tag}> is {text[:60]!r}, should be true or false")
        return None if text is None else text == "true"

    # --- attributes ---

    def word(self, name: str) -> str:
        """The text of an attribute. Raises ValueError where there is none."""
        if name not in self.attributes:
            raise self.error(f"<{self.tag}> has no attribute {name!r}")
        return self.attributes[name]

    def numbers(self, name: str, count: int) -> tuple[float, ...] | None:
        """``count`` finite numbers of an attribute; None where there is no such attribute. Raises ValueError for others."""
        if (text := self.attributes.get(name)) is None:
            return None
        try:
            return numerals.numbers(text, count)
        except numerals.NumeralError:
            what = "a finite number" if count == 1 else f"{count} finite numbers"
            raise self.error(f"{name}={text[:60]!r} of <{self.tag}>, should be {what}") from None

    def number(self, name: str) -> float | None:
        """A finite number of an attribute; None where there is no such attribute."""
        values = self.numbers(name, 1)
        return None if values is None else values[0]

    def need_number(self, name: str) -> float:
        """A finite number of an attribute. Raises ValueError where there is none."""
        self.word(name)
        return self.number(name) or 0.0


def read_xml(path: Path) -> XmlElement:
    """The root element of an XML file: a regular file, UTF-8 or as its declaration says.

    Raises FileNotFoundError; SpecError where it cannot be read (no regular file, too large); ValueError, which names the file
    and the line, where it is not well-formed, declares a document type, or is beyond a bound.
    """
    return parse_xml(read_bytes(path, LARGEST_FILE), path.name)


def parse_xml(content: bytes, name: str, encoding: str | None = None, space: str | None = None) -> XmlElement:
    """The root element of a text called ``name`` in errors; as :func:`read_xml`. ``encoding``: in place of the declared one;
    ``space``: the characters that are white space around texts (None: those of Unicode)."""
    builder = _ElementBuilder(name, encoding, space)
    parser = builder.parser
    try:
        for start in range(0, max(len(content), 1), CHUNK):
            parser.Parse(content[start : start + CHUNK], start + CHUNK >= len(content))
            if start + CHUNK - parser.CurrentByteIndex > LONGEST_TAG + CHUNK:
                raise builder.refused(f"a tag of more than {LONGEST_TAG:,} bytes")
    except XmlError:
        raise
    except expat.ExpatError as error:
        raise XmlError(
            name, error.lineno, expat.ErrorString(error.code) + builder.innermost(), error.offset + 1
        ) from None
    except (LookupError, ValueError) as error:  # an encoding that Python lacks, or that expat cannot take from it
        raise XmlError(name, 1, str(error)) from None
    assert builder.root is not None  # expat refuses a document without an element
    return builder.root


class _ElementBuilder:
    """Collects elements as expat meets them."""

    def __init__(self, name: str, encoding: str | None, space: str | None):
        self._name, self._space = name, space
        self._open: list[tuple[str, int, dict[str, str], list[XmlElement], list[str]]] = []
        self._pieces: list[str] = []
        """Of the text that is being read: expat divides it at the ends of chunks, at its buffer's size, at comments."""
        self._elements = 0
        self.root: XmlElement | None = None
        self.parser = parser = expat.ParserCreate(encoding)
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = self._doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text

    def refused(self, why: str) -> XmlError:
        """The error of what is not read, at the line that the parser is in."""
        return XmlError(self._name, self.parser.CurrentLineNumber, why)

    def innermost(self) -> str:
        """The innermost element that has not ended, as the end of a message."""
        return f" in <{self._open[-1][0][:60]}> of line {self._open[-1][1]}" if self._open else ""

    def _doctype(self, *_: object) -> None:
        raise self.refused("a document type, which may define entities, is not read")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._end_text()
        self._elements += 1
        if self._elements > MOST_ELEMENTS:
            raise self.refused(f"more than {MOST_ELEMENTS:,} elements")
        if len(self._open) >= MOST_DEPTH:
            raise self.refused(f"more than {MOST_DEPTH:,} elements in one another")
        if len(attributes) > MOST_ATTRIBUTES:
            raise self.refused(f"<{tag[:60]}> has more than {MOST_ATTRIBUTES} attributes")
        self._open.append((tag, self.parser.CurrentLineNumber, attributes, [], []))

    def _end(self, _: str) -> None:
        self._end_text()
        tag, line, attributes, children, texts = self._open.pop()
        element = XmlElement(tag, line, attributes, tuple(children), " ".join(texts), self._name)
        if self._open:
            self._open[-1][3].append(element)
        else:
            self.root = element

    def _text(self, piece: str) -> None:
        self._pieces.append(piece)

    def _end_text(self) -> None:
        """A tag ends the text before it."""
        if text := "".join(self._pieces).strip(self._space):
            self._open[-1][4].append(text)
        self._pieces.clear()
