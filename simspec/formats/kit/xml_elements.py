"""XML files as elements with their lines, for all readers of formats and all importers.

The parser is the standard library's expat. It follows nothing out of the file and ends in bounded time: no DOCTYPE (and so no
entities and no external files), and bounds on size, elements, depth, attributes and the length of a tag.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.parsers import expat

from simspec import numerals
from simspec.formats.kit.text import finite_numbers
from simspec.outputs.files import read_bytes

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
