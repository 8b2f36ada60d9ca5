"""YAML text to plain data, with the line and column of every key and value.

A spec is data: no tags, no anchors and aliases (a few lines of them can stand for gigabytes; ``use:`` and ``array:`` are
the language's own ways to repeat), one document, texts as keys. Numbers and words are read by the rules of YAML 1.2. The
events of the parser are taken as a stream, so that nesting without end is noticed before it is built.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Required, TypedDict, Unpack

from simspec.errors import Location, Problem, SpecError
from simspec.files import NotReadableError, open_regular

if TYPE_CHECKING:
    from ruamel.yaml.error import MarkedYAMLError

MOST_EVENTS = 100_000
"""Keys, values, and beginnings and ends of mappings and lists of one file: two seconds' worth of reading. The largest spec of
the library, a robot with a program of moves, has 4,000."""
LARGEST_FILE = 10_000_000
"""Bytes; a spec of 10,000 written-out bodies has 4 MB."""
DEEPEST = 40
"""Levels of nesting; the language itself needs 9."""

Key = str | int
"""A step of a path: a key of a mapping, an index of a list."""


class Details(TypedDict, total=False):
    """The parts of a problem besides its message (see :class:`simspec.errors.Problem`); ``key``: it is about the key at its
    path, not the value."""

    code: Required[str]
    key: bool
    found: str | None
    allowed: str | None
    hint: str | None


INVALID = object()
"""Stands for a value that has been reported already: later readers of the data must not report it again."""

Path_ = tuple[Key, ...]

_INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")
_CONSTANTS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_MOST_DIGITS = 400


@dataclass(slots=True)
class Mark:
    """Where a value begins (line and column from 1), where its keys stand, and the marks of what is in it."""

    line: int
    column: int
    keys: dict[str, tuple[int, int]] | None = None
    items: dict[Key, Mark] | None = None
    file: str | None = None
    """Set where a value comes from another place than the rest of the document (an override)."""


@dataclass
class Document:
    """Plain data (dicts, lists, texts, numbers, booleans, None), its marks (None for data made in Python), and the
    problems that were met on the way."""

    file: str
    data: Any
    mark: Mark | None = None
    problems: list[Problem] = field(default_factory=list)
    references: dict[tuple[Key, ...], str] = field(default_factory=dict)
    """References to parameters as they are written, by the paths of the quantities that stand in their places."""

    def locate(self, path: Sequence[Key], key: bool = False) -> Location | None:
        """The place of ``path``, or of its nearest ancestor that exists; ``key``: of its key rather than its value."""
        mark = self.mark
        if mark is None:
            return None
        file, place = self.file, (mark.line, mark.column)
        for index, step in enumerate(path):
            file = mark.file or file
            if mark.items is None or step not in mark.items:
                break
            holder, mark = mark, mark.items[step]
            last = index == len(path) - 1
            # a mapping or a list is shown at its key: a block of them begins a line below
            at_key = holder.keys is not None and (mark.items is not None or (key and last))
            place = holder.keys[str(step)] if at_key and holder.keys else (mark.line, mark.column)
            if mark.file:
                file, place = mark.file, (mark.line, mark.column)
        return Location(file, *place)

    def at(self, *path: Key) -> Any:
        """The plain data at a path of keys; None where there is none."""
        data = self.data
        for step in path:
            data = data.get(step) if isinstance(data, Mapping) else None
        return data

    def problem(self, path: Sequence[Key], message: str, **more: Unpack[Details]) -> Problem:
        """A problem at ``path``."""
        place = self.locate(path, more.get("key", False))
        found, allowed, hint = more.get("found"), more.get("allowed"), more.get("hint")
        if found is not None and tuple(path) in self.references:
            found = f"{found}, from {self.references[tuple(path)]!r}"
        return Problem(message, dotted(path), place, found, allowed, hint, code=more["code"])


def mapping(data: Any) -> Mapping[Any, Any]:
    """Plain data that should be a mapping; empty for anything else."""
    return data if isinstance(data, Mapping) else {}


def listed(data: Any) -> Sequence[Any]:
    """Plain data that should be a list; empty for anything else."""
    return data if isinstance(data, (list, tuple)) else ()


def dotted(path: Sequence[Key]) -> str:
    """``bodies.ball.shapes.0``."""
    return ".".join(str(step) for step in path)


def read(path: Path, shown: str | None = None) -> Document:
    """Read a file; ``shown`` is what messages call it. Raises SpecError when it cannot be read, or is no YAML at all."""
    file = shown or str(path)
    return parse(read_text(path, file), file)


def read_text(path: Path, shown: str | None = None) -> str:
    """A file's text. Raises SpecError when it cannot be read, is too large, or is not UTF-8."""
    file = shown or str(path)
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            found, allowed = f"{size / 1e6:.1f} MB", f"{LARGEST_FILE / 1e6:g} MB"
            hint = "write repeated bodies once, with array:"
            raise SpecError(
                [Problem(f"{file}: the file is too large", found=found, allowed=allowed, hint=hint, code="S108")]
            )
        with os.fdopen(open_regular(path, LARGEST_FILE, links=True), "rb") as stream:  # a link to a spec is a spec
            content = stream.read(LARGEST_FILE + 1)
    except NotReadableError as error:
        raise SpecError([Problem(f"{file}: cannot be read: {error}", code="S108")]) from None
    except OSError as error:
        raise SpecError([Problem(f"{file}: cannot be read: {error.strerror}", code="S108")]) from None
    if len(content) > LARGEST_FILE:
        raise SpecError([Problem(f"{file}: longer than {LARGEST_FILE / 1e6:g} MB, or not a regular file", code="S108")])
    return decode(content, file)


def decode(content: bytes, file: str) -> str:
    """Bytes of a file as text. Raises SpecError with line, column and byte offset where they are not UTF-8."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        column = error.start - (content.rfind(b"\n", 0, error.start) + 1) + 1
        message, found = f"not UTF-8 at byte {error.start}", f"the byte 0x{content[error.start]:02x}"
        place = Location(file, line, column)
        problem = Problem(message, "", place, found, "UTF-8 text", "save the file as UTF-8", code="S108")
        raise SpecError([problem]) from None


def parse(text: str, file: str) -> Document:
    """Parse YAML text. Raises SpecError where it is no YAML; other problems are in the document's ``problems``."""
    return build(events(text, file), file)


def build(stream: Iterable[Any], file: str) -> Document:
    """The document of a parser's events."""
    builder = _DocumentBuilder(file)
    for event in stream:
        builder.take(event)
    data, mark = builder.result
    return Document(file, data, mark or Mark(1, 1), builder.problems)  # an empty file has a beginning too


def _indentation(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _written(line: str) -> bool:
    """Whether a line has more than blanks and a comment."""
    return bool(line.strip(" ")) and line.lstrip(" ")[0] != "#"


def _too_deep(lines: list[str], index: int) -> tuple[str, str] | None:
    """The words for a key that is indented below a line whose value is complete; None where the line above is none such."""
    above = next((number for number in range(index - 1, -1, -1) if _written(lines[number])), None)
    if above is None or index >= len(lines) or lines[above].rstrip(" ").endswith(":"):
        return None
    here, there = _indentation(lines[index]), _indentation(lines[above])
    if here <= there or ": " not in lines[above]:
        return None
    return (
        f"this line is indented by {here} spaces, line {above + 1} above it, which is complete, by {there}",
        f"indent it by {there} spaces",
    )


def _left_of(lines: list[str], column: int) -> int | None:
    """The last line above that is indented by less than ``column``: the key that began the block of its neighbours."""
    left = (index for index in range(len(lines) - 1, -1, -1) if _written(lines[index]))
    return next((index for index in left if _indentation(lines[index]) < column), None)


def _yaml_words(error: MarkedYAMLError, text: str) -> tuple[str, str | None]:
    """The parser's error in the words of who writes a file, and the way out; the parser's words where these are not known."""
    context, problem, mark = error.context or "", error.problem or "", error.problem_mark
    if "'\\t'" in problem:
        return "a tab in the indentation", "indent with spaces, never with tabs"
    if problem.startswith("mapping values are not allowed"):
        if mark is not None and (words := _too_deep(text.splitlines(), mark.line)) is not None:
            return words
        return "a second colon in a line", 'put the key on a line of its own, or the text in quotes: "a: b"'
    if "quoted scalar" in context and error.context_mark is not None:
        return f"the quote that begins in line {error.context_mark.line + 1} does not end", None
    if "flow" in context and error.context_mark is not None:
        start = error.context_mark
        bracket = "".join(text.splitlines()[start.line : start.line + 1])[start.column : start.column + 1]
        closing = {"{": "}", "[": "]"}.get(bracket)
        if closing is None:
            return " ".join((context, problem)), None
        return (
            f"the {bracket} of line {start.line + 1} is not closed",
            f"a comma or {closing} is missing before this place",
        )
    if "block" in context and "expected <block end>" in problem and mark is not None:
        lines = text.splitlines()[: mark.line]
        columns = sorted({_indentation(line) for line in lines if _written(line)})
        if mark.column not in columns:
            known = ", ".join(str(column) for column in columns)
            return (
                f"this line is indented by {mark.column} spaces, the lines above by {known}",
                "align it with its neighbours",
            )
        if (above := _left_of(lines, mark.column)) is not None:
            key, column = lines[above].strip(" ").split(":")[0], _indentation(lines[above])
            return (
                f"this line is indented by {mark.column} spaces, the block before it in line {above + 1} by {column}",
                f"indent line {above + 1}, {key}, and its block by {mark.column} spaces, or this line by {column}",
            )
    if problem.startswith("could not find expected ':'") and error.context_mark is not None:
        line = error.context_mark.line
        return f"line {line + 1} has no colon after its key", "write KEY: VALUE, or KEY: above a block"
    return " ".join(part for part in (context, problem) if part), None


def events(text: str, file: str) -> Iterator[Any]:
    """The parser's events. Raises a located SpecError for text that is not YAML."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError
    from ruamel.yaml.reader import ReaderError

    count = depth = 0
    try:
        for event in YAML(typ="safe", pure=True).parse(text):
            count += 1
            if count > MOST_EVENTS:
                break
            depth += _deeper(event)
            if depth > DEEPEST + 1:  # the builder of the data has reported it one level before, with its path
                break
            yield event
    except ReaderError as error:
        before = text[: error.position]
        place = Location(file, before.count("\n") + 1, error.position - (before.rfind("\n") + 1) + 1)
        code_point = error.character if isinstance(error.character, int) else ord(error.character)
        message = f"a character that YAML does not allow: U+{code_point:04X}"
        raise SpecError([Problem(message, location=place, code="S105")]) from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = Location(file, mark.line + 1, mark.column + 1) if mark else Location(file, 1, 1)
        message, hint = _yaml_words(error, text)
        raise SpecError([Problem(f"not YAML: {message}", location=place, hint=hint, code="S105")]) from None
    except YAMLError as error:
        raise SpecError([Problem(f"not YAML: {error}", location=Location(file, 1, 1), code="S105")]) from None
    if depth <= DEEPEST + 1 and count <= MOST_EVENTS:
        return
    place = Location(file, event.start_mark.line + 1, event.start_mark.column + 1)
    if depth > DEEPEST + 1:
        raise SpecError([Problem(f"nested deeper than {DEEPEST} levels", location=place, code="S109")])
    else:
        hint = "write repeated bodies once, with array:; put long trajectories into a CSV file"
        message = "the file has too many keys and values, counted from its beginning to here"
        raise SpecError([Problem(message, location=place, allowed=f"{MOST_EVENTS:,}", hint=hint, code="S109")])


def _deeper(event: Any) -> int:
    """By how much the event opens or closes a mapping or a list. The parser takes 2 ms for each level that is never closed."""
    from ruamel.yaml.events import CollectionEndEvent, CollectionStartEvent

    return isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)


def event_count(data: Any) -> int:
    """How many events plain data has as a text, with those of the beginning and the end of it."""
    count, waiting = 4, [data]
    while waiting:
        value = waiting.pop()
        if isinstance(value, Mapping):
            count += 2 + len(value)
            waiting.extend(value.values())
        elif isinstance(value, (list, tuple)):
            count += 2
            waiting.extend(value)
        else:
            count += 1
    return count


def scalar(text: str) -> Any:
    """The value of a plain scalar by YAML 1.2's core schema; not finite numbers are INVALID."""
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if not (text[0].isdigit() or text[0] in "-+."):
        return text
    if _INT.fullmatch(text):
        return int(text, 0 if text[:2] in ("0o", "0x") else 10) if len(text) <= _MOST_DIGITS else INVALID
    if _FLOAT.fullmatch(text):
        value = float(text)
        return value if value - value == 0.0 else INVALID
    return INVALID if _NOT_FINITE.fullmatch(text) else text


class _DocumentBuilder:
    """Data and marks from events, one at a time, without recursion."""

    def __init__(self, file: str):
        self.file = file
        self.problems: list[Problem] = []
        self.result: tuple[Any, Mark | None] = (None, None)
        self._stack: list[list[Any]] = []  # frames: container, mark, pending key (mapping) or None, key's place
        self._documents = 0

    def take(self, event: Any) -> None:
        kind = type(event).__name__
        if kind == "ScalarEvent":
            self._scalar(event)
        elif kind in ("MappingStartEvent", "SequenceStartEvent"):
            self._start(event, {} if kind == "MappingStartEvent" else [])
        elif kind in ("MappingEndEvent", "SequenceEndEvent"):
            container, mark, *_ = self._stack.pop()
            self._put(container, mark)
        elif kind == "AliasEvent":
            self._report(
                event, "aliases are not allowed in a spec", found=f"*{event.anchor}", hint=_REPEAT, code="S107"
            )
            self._put(INVALID, self._mark(event))
        elif kind == "DocumentStartEvent":
            self._documents += 1
            if self._documents > 1:
                raise SpecError(
                    [self._problem(event, "only one YAML document per file", found="a second one (---)", code="S107")]
                )

    def _mark(self, event: Any) -> Mark:
        return Mark(event.start_mark.line + 1, event.start_mark.column + 1)

    def _problem(self, event: Any, message: str, **more: Unpack[Details]) -> Problem:
        mark = event.start_mark
        found, allowed, hint = more.get("found"), more.get("allowed"), more.get("hint")
        place = Location(self.file, mark.line + 1, mark.column + 1)
        return Problem(message, dotted(self._path()), place, found, allowed, hint, code=more["code"])

    def _report(self, event: Any, message: str, **more: Unpack[Details]) -> None:
        self.problems.append(self._problem(event, message, **more))

    def _path(self) -> Path_:
        steps: list[Key] = []
        for container, _, key, _ in self._stack:
            if isinstance(container, list):
                steps.append(len(container))
            elif key is not None:
                steps.append(key)
        return tuple(steps)

    def _check_node(self, event: Any) -> bool:
        """Report anchors and tags; whether the node's value may be used."""
        if event.anchor is not None:
            self._report(
                event, "anchors are not allowed in a spec", found=f"&{event.anchor}", hint=_REPEAT, code="S107"
            )
        if event.tag is not None:
            self._report(
                event, "tags are not allowed in a spec", found=str(event.tag), hint="write the value alone", code="S107"
            )
            return False
        return True

    def _start(self, event: Any, container: Any) -> None:
        self._check_node(event)
        if len(self._stack) >= DEEPEST:
            raise SpecError([self._problem(event, f"nested deeper than {DEEPEST} levels", code="S109")])
        mark = self._mark(event)
        mark.items, mark.keys = {}, {} if isinstance(container, dict) else None
        if self._stack and isinstance(self._stack[-1][0], dict) and self._stack[-1][2] is None:
            noun = "mapping" if isinstance(container, dict) else "list"
            self._report(event, "a key must be a string", found=f"a {noun} as a key", code="S107")
        self._stack.append([container, mark, None, None])

    def _scalar(self, event: Any) -> None:
        usable = self._check_node(event)
        if event.style == '"' and any("\ud800" <= character <= "\udfff" for character in event.value):
            # the reader leaves an escaped pair (\ud83d\ude00) as two halves, and half a pair is no character
            try:
                event.value = event.value.encode("utf-16", "surrogatepass").decode("utf-16")
            except UnicodeDecodeError:
                self._report(
                    event, "an unpaired surrogate is not a character", allowed="the character itself", code="S107"
                )
                event.value, usable = "", False
        frame = self._stack[-1] if self._stack else None
        if frame is not None and isinstance(frame[0], dict) and frame[2] is None:
            frame[2], frame[3] = event.value, (event.start_mark.line + 1, event.start_mark.column + 1)
            if event.value in frame[1].keys:
                line, column = frame[1].keys[event.value]
                self._report(
                    event, f"the key {event.value!r} is duplicated", found=f"first at {line}:{column}", code="S106"
                )
            return
        value: Any = event.value
        if not usable:
            value = INVALID
        elif event.implicit[0]:
            value = scalar(value)
            if value is INVALID:
                self._report(
                    event, "numbers must be finite", found=event.value[:80], allowed="a finite number", code="S203"
                )
        self._put(value, self._mark(event))

    def _put(self, value: Any, mark: Mark) -> None:
        if not self._stack:
            self.result = (value, mark)
            return
        frame = self._stack[-1]
        container, holder, key, place = frame
        if isinstance(container, list):
            holder.items[len(container)] = mark
            container.append(value)
        elif key is None:  # a mapping or a list was the key; reported when it began
            frame[2], frame[3] = "?", (mark.line, mark.column)
        else:
            if key not in container:
                container[key], holder.items[key], holder.keys[key] = value, mark, place
            frame[2] = None


_REPEAT = "repeat bodies with array:, and models with use:"
