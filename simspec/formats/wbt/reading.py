"""From a .wbt file to a document: VRML97 as far as worlds without PROTO use it, by a reader that follows nothing out of a file
and ends in bounded time, memory and nesting. It knows no node and no field: callers interpret them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Union

from simspec.outputs.files import read_bytes

Value = Union[bool, float, str, None, "WbtNode"]
"""NULL is None."""


@dataclass(frozen=True, slots=True, eq=False)
class WbtField:
    """A field of a node; ``listed`` whether its values stand in brackets."""

    name: str
    line: int
    values: tuple[Value, ...]
    listed: bool

    def __repr__(self) -> str:
        return f"<{self.name} in line {self.line}>"


@dataclass(frozen=True, slots=True, eq=False)
class WbtNode:
    """A node, compared by identity; ``kind`` is its type, ``label`` its name after DEF, "" without one."""

    file: str
    kind: str
    label: str
    line: int
    fields: tuple[WbtField, ...]

    def __repr__(self) -> str:
        return f"<{self.kind} {self.label} in line {self.line}>"

    def refused(self, why: str, line: int | None = None) -> ValueError:
        """The error of something that is wrong with it, with file, line, type and label."""
        named = f"{self.kind} {self.label}".strip()
        return ValueError(f"{self.file}:{self.line if line is None else line}: {named[:200]}: {why}")

    def field(self, name: str) -> WbtField:
        """A field. Raises ValueError where it is missing: a program would choose a default."""
        for item in self.fields:
            if item.name == name:
                return item
        raise self.refused(f"has no {name}")

    def _single(self, name: str, allowed: type | tuple[type, ...], wanted: str) -> Value:
        field = self.field(name)
        if field.listed or len(field.values) != 1 or not isinstance(field.values[0], allowed):
            raise self.refused(f"{name} should be {wanted}", field.line)
        return field.values[0]

    def number(self, name: str) -> float:
        """The one number of a field. Raises ValueError, as all that follow, where it is something else."""
        return self._single(name, float, "a number")  # type: ignore[return-value]

    def text(self, name: str) -> str:
        """The text of a field."""
        return self._single(name, str, "a text")  # type: ignore[return-value]

    def flag(self, name: str) -> bool:
        """The flag of a field."""
        return self._single(name, bool, "TRUE or FALSE")  # type: ignore[return-value]

    def node(self, name: str) -> WbtNode | None:
        """The node of a field; None where it is NULL."""
        return self._single(name, (WbtNode, type(None)), "a node or NULL")  # type: ignore[return-value]

    def numbers(self, name: str, count: int) -> tuple[float, ...]:
        """The numbers of a vector or a list."""
        field = self.field(name)
        values = tuple(value for value in field.values if isinstance(value, float))
        if len(values) != len(field.values) or len(values) != count:
            found = len(values) if len(values) == len(field.values) else "other values than"
            raise self.refused(f"{name} has {found} numbers, should have {count}", field.line)
        return values

    def nodes(self, name: str) -> tuple[WbtNode, ...]:
        """The nodes of a list."""
        field = self.field(name)
        nodes = tuple(value for value in field.values if isinstance(value, WbtNode))
        if len(nodes) != len(field.values) or not field.listed:
            raise self.refused(f"{name} should be a list of nodes", field.line)
        return nodes

    def walk(self) -> Iterator[WbtNode]:
        """This node and all below it, in the order of the file, however deep."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            inner = [value for field in node.fields for value in field.values if isinstance(value, WbtNode)]
            waiting.extend(reversed(inner))


@dataclass(frozen=True, slots=True, eq=False)
class WbtDocument:
    """A whole file: ``version`` the second word of it, ``nodes`` those that stand in no other."""

    file: str
    version: str
    nodes: tuple[WbtNode, ...]

    def walk(self) -> Iterator[WbtNode]:
        """Every node, in the order of the file."""
        for node in self.nodes:
            yield from node.walk()

    def only(self, kind: str) -> WbtNode:
        """The one node of a type that stands in no other. Raises ValueError where there is none, or more."""
        found = [node for node in self.nodes if node.kind == kind]
        if len(found) != 1:
            raise ValueError(f"{self.file}: has {len(found)} {kind} nodes, should have one")
        return found[0]


LARGEST_FILE: Final = 64 * 2**20
"""Bytes; a world of 2,000 bodies has 12 MB, with every field written."""
MOST_NODES: Final = 500_000
"""A body has some ten."""
MOST_DEPTH: Final = 20_000
"""Nodes and lists in one another: a chain of bodies nests each in its parent, four deep."""
MOST_VALUES: Final = 4_000_000
"""Numbers, texts and flags of a file: each takes some 50 bytes of memory."""
HEADER: Final = re.compile(r"#VRML_SIM (R[0-9]{4}[a-z]) utf8[ \t]*\r?(?:\n|\Z)")
TOKEN: Final = re.compile(r'[\s,]+|#[^\n]*|("(?:[^"\\]|\\.)*")|([\[\]{}])|([^\s,\[\]{}"#]+)', re.DOTALL)
NUMBER: Final = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
WORD: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
CONSTANTS: Final = {"TRUE": True, "FALSE": False, "NULL": None}
NOT_READ: Final = {
    "PROTO": "defines a node",
    "EXTERNPROTO": "takes a node from another file",
    "IMPORTABLE": "takes a node from another file",
    "USE": "repeats a node",
    "IS": "is of a PROTO",
    "ROUTE": "joins fields",
    "Script": "runs a program",
}
"""Words of the language that this reader refuses, each with what it does."""


def read_document(path: Path) -> WbtDocument:
    """The document of a .wbt file. Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file
    and line, where it is no .wbt, or beyond a bound."""
    content = read_bytes(path, LARGEST_FILE)
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ValueError(f"{path.name}:{line}: is not UTF-8: {error.reason}") from None
    return parse(text, path.name)


def parse(text: str, name: str) -> WbtDocument:
    """The document of a text called ``name`` in errors; as :func:`read_document`."""
    header = HEADER.match(text)
    if header is None:
        raise ValueError(f"{name}:1: should begin with '#VRML_SIM R2023b utf8'")
    return WbtDocument(name, header[1], _Parser(name).nodes(_tokens(text, name, header.end())))


@dataclass(slots=True)
class Token:
    """``kind``: text, bracket or word."""

    kind: str
    text: str
    line: int


def _tokens(text: str, name: str, start: int) -> Iterator[Token]:
    place, line = start, 1 + text.count("\n", 0, start)
    while place < len(text):
        found = TOKEN.match(text, place)
        if found is None:
            raise ValueError(f"{name}:{line}: a text that does not end")
        if found.lastindex is not None:
            yield Token(("", "text", "bracket", "word")[found.lastindex], found[0], line)
        line += text.count("\n", place, found.end())
        place = found.end()


@dataclass(slots=True)
class _Open:
    """A node whose end is not read yet, and the field in it that is being read."""

    type: str
    label: str
    line: int
    fields: dict[str, WbtField] = field(default_factory=dict)
    name: str = ""
    at: int = 0
    values: list[Value] = field(default_factory=list)
    listed: bool = False


class _Parser:
    def __init__(self, name: str):
        self._name = name
        self._stack: list[_Open] = []
        self._found: list[WbtNode] = []
        self._count = self._values = 0

    def refused(self, line: int, why: str) -> ValueError:
        return ValueError(f"{self._name}:{line}: {why}")

    def nodes(self, tokens: Iterator[Token]) -> tuple[WbtNode, ...]:
        """All nodes that stand in no other."""
        last = 1
        for token in tokens:
            last = token.line
            self._take(token, tokens)
        if self._stack:
            entry = self._stack[-1]
            raise self.refused(last, f"{entry.type[:60]} of line {entry.line} does not end")
        return tuple(self._found)

    def _take(self, token: Token, tokens: Iterator[Token]) -> None:
        top = self._stack[-1] if self._stack else None
        if top is None:
            self._begin(token, tokens)
        elif not top.name:
            self._between(top, token)
        elif token.kind == "word" and NUMBER.fullmatch(token.text):
            self._number(top, token)
        elif top.values and not top.listed:  # the numbers of a vector are at their end
            self._end_field(top)
            self._between(top, token)
        elif token.text == "[" and not top.listed:
            top.listed = True
        elif token.text == "]" and top.listed:
            self._end_field(top)
        elif token.kind == "text":
            self._value(top, token, re.sub(r"\\(.)", r"\1", token.text[1:-1], flags=re.DOTALL))
        elif token.text in CONSTANTS:
            self._value(top, token, CONSTANTS[token.text])
        else:
            self._begin(token, tokens)

    def _between(self, top: _Open, token: Token) -> None:
        """Between the fields of a node."""
        if token.text == "}":
            self._close(top)
        elif token.kind != "word" or not WORD.fullmatch(token.text):
            raise self.refused(token.line, f"{token.text[:60]!r} stands where a field of {top.type[:60]} should be")
        elif token.text in NOT_READ:
            raise self._not_read(token)
        elif token.text in top.fields:
            raise self.refused(token.line, f"{top.type[:60]} has the field {token.text[:60]} twice")
        else:
            top.name, top.at, top.values, top.listed = token.text, token.line, [], False

    def _number(self, top: _Open, token: Token) -> None:
        value = float(token.text)
        if not math.isfinite(value):
            raise self.refused(token.line, f"{top.name[:60]} has {token.text[:60]}, which is not finite")
        self._room(token)
        top.values.append(value)

    def _value(self, top: _Open, token: Token, value: Value) -> None:
        """A text, a flag or NULL."""
        self._room(token)
        top.values.append(value)
        if not top.listed:
            self._end_field(top)

    def _room(self, token: Token) -> None:
        self._values += 1
        if self._values > MOST_VALUES:
            raise self.refused(token.line, f"more than {MOST_VALUES:,} values")

    def _end_field(self, top: _Open) -> None:
        top.fields[top.name] = WbtField(top.name, top.at, tuple(top.values), top.listed)
        top.name, top.values, top.listed = "", [], False

    def _begin(self, token: Token, tokens: Iterator[Token]) -> None:
        """A node, from DEF or its type on."""
        line, label = token.line, ""
        if token.text == "DEF":
            label = self._word(next(tokens, None), line, "a name after DEF")
            token = next(tokens, Token("word", "", line))
        if token.text in NOT_READ:
            raise self._not_read(token)
        kind = self._word(token, line, "a value or a node")
        brace = next(tokens, None)
        if brace is None or brace.text != "{" or brace.kind != "bracket":
            raise self.refused(line, f"{kind[:60]!r} is no value and no node: no {{ after it")
        self._count += 1
        if self._count > MOST_NODES:
            raise self.refused(line, f"more than {MOST_NODES:,} nodes")
        if len(self._stack) >= MOST_DEPTH:
            raise self.refused(line, f"more than {MOST_DEPTH:,} nodes in one another")
        self._stack.append(_Open(kind, label, line))

    def _word(self, token: Token | None, line: int, what: str) -> str:
        if token is None or token.kind != "word" or not WORD.fullmatch(token.text):
            raise self.refused(line, f"{'the end' if token is None else repr(token.text[:60])}, should be {what}")
        return token.text

    def _not_read(self, token: Token) -> ValueError:
        return self.refused(token.line, f"{token.text} {NOT_READ[token.text]}, which is not read here")

    def _close(self, top: _Open) -> None:
        node = WbtNode(self._name, top.type, top.label, top.line, tuple(top.fields.values()))
        self._stack.pop()
        if not self._stack:
            self._found.append(node)
            return
        above = self._stack[-1]
        above.values.append(node)
        if not above.listed:
            self._end_field(above)
