"""An XML file as elements with their lines, read by a parser that follows nothing out of the file and ends in bounded time.

The standard library's expat, with what it would do for documents refused: no DOCTYPE (and so no entities and no external
files), and bounds on size, elements, depth, attributes, and the length of any one tag.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.parsers import expat

from simspec.outputs.reading import read_bytes

LARGEST_FILE: Final = 128 * 2**20
"""Bytes; the largest known file, of 10,000 bodies, has 20 MB."""
MOST_ELEMENTS: Final = 500_000
"""A world of 10,000 bodies has 50,000 to 300,000, by the language."""
MOST_DEPTH: Final = 100_000
"""Elements in one another: a chain of bodies nests each in its parent."""
MOST_ATTRIBUTES: Final = 256
"""Of one element; the richest of the languages read here have some fifty."""
LONGEST_TAG: Final = 16 * 2**20
"""Bytes between ``<`` and ``>``, and of the texts of one element: expat holds it whole before anybody is asked."""
CHUNK: Final = 2**20


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """One element, compared by identity. ``line`` counts from one. ``text`` is its character data. As XML defines it, comments,
    CDATA marks and references do not divide a text; child elements do: the texts before, between and after them are joined by
    one blank, each without white space at its ends."""

    tag: str
    line: int
    attributes: Mapping[str, str]
    children: tuple[Element, ...]
    text: str = ""

    def __repr__(self) -> str:
        return f"<{self.tag}> in line {self.line}"

    def all(self, tag: str) -> tuple[Element, ...]:
        """The children of this tag."""
        return tuple(child for child in self.children if child.tag == tag)

    def walk(self) -> Iterator[Element]:
        """This element and all below it, in the order of the file, however deep."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting.extend(reversed(element.children))


def read_xml(path: Path) -> Element:
    """The root element of an XML file: a regular file, UTF-8 or as its declaration says.

    Raises FileNotFoundError; SpecError where it cannot be read (no regular file, too large); ValueError, which names the file
    and the line, where it is not well-formed, declares a document type, or is beyond a bound.
    """
    return parse_xml(read_bytes(path, LARGEST_FILE), path.name)


def parse_xml(content: bytes, name: str) -> Element:
    """The root element of a text called ``name`` in errors; as :func:`read_xml`."""
    builder = _Builder(name)
    parser = builder.parser
    try:
        for start in range(0, max(len(content), 1), CHUNK):
            parser.Parse(content[start : start + CHUNK], start + CHUNK >= len(content))
            if start + CHUNK - parser.CurrentByteIndex > LONGEST_TAG + CHUNK:
                raise builder.refused(f"a tag of more than {LONGEST_TAG:,} bytes")
    except _RefusedError:
        raise
    except expat.ExpatError as error:
        raise ValueError(f"{name}:{error.lineno}: {expat.ErrorString(error.code)}") from None
    except (LookupError, ValueError) as error:  # an encoding that Python lacks, or that expat cannot take from it
        raise ValueError(f"{name}:1: {error}") from None
    assert builder.root is not None  # expat refuses a document without an element
    return builder.root


class _RefusedError(ValueError):
    """What is well-formed, and not read."""


class _Builder:
    """Collects elements as expat meets them."""

    def __init__(self, name: str):
        self._name = name
        self._open: list[tuple[str, int, dict[str, str], list[Element], list[str]]] = []
        self._pieces: list[str] = []
        """Of the text that is being read: expat divides it at the ends of chunks, at its buffer's size, at comments."""
        self._elements = 0
        self.root: Element | None = None
        self.parser = parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = self._doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text

    def refused(self, why: str) -> ValueError:
        """The error of what is not read, at the line that the parser is in."""
        return _RefusedError(f"{self._name}:{self.parser.CurrentLineNumber}: {why}")

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
        element = Element(tag, line, attributes, tuple(children), " ".join(texts))
        if self._open:
            self._open[-1][3].append(element)
        else:
            self.root = element

    def _text(self, piece: str) -> None:
        self._pieces.append(piece)

    def _end_text(self) -> None:
        """A tag ends the text before it."""
        if text := "".join(self._pieces).strip():
            self._open[-1][4].append(text)
        self._pieces.clear()
