"""``simspec fmt``: a spec in the canonical layout, its comments kept, its meaning unchanged."""

from __future__ import annotations

import bisect
import itertools
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simspec.errors import Location, Problem, SpecError
from simspec.language.document import Document, build, events, read_text, scalar
from simspec.language.layout import Entry, Node, lines, node_of


def format_file(path: Path) -> tuple[str, str]:
    """A file's text as it is and as it should be. Raises SpecError where it is no YAML, or no spec could be in it."""
    text = read_text(path)
    return text, format_text(text, str(path))


def format_data(data: Any) -> str:
    """Plain data as text in the canonical layout."""
    return "\n".join(lines(node_of(data), [], [])) + "\n"


def format_text(text: str, file: str) -> str:
    """The text in the canonical layout. Raises SpecError where it is no YAML, or has what a spec must not have."""
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    document, reader = _read(text, file)
    if not isinstance(document.data, dict):
        document.problems.append(Problem("a spec is a mapping (key: value)", location=Location(file, 1, 1)))
    if document.problems or reader is None:
        raise SpecError(document.problems)
    result = "\n".join(lines(reader.root, reader.header, reader.footer)) + "\n"
    _check(document, reader, result, file)
    return result


def _read(text: str, file: str) -> tuple[Document, _Reader | None]:
    """The text's data, and its nodes; None where it has what a spec must not have, such as a list for a key."""
    stream = list(events(text, file))
    document = build(stream, file)
    return document, None if document.problems else _Reader(text, stream)


def _check(before: Document, reader: _Reader, result: str, file: str) -> None:
    """The promise of the layout: the same data, the same comments."""
    after, again = _read(result, file)
    same = again is not None and json.dumps(before.data, sort_keys=True) == json.dumps(after.data, sort_keys=True)
    if (
        not same
        or again is None
        or Counter(comment.text for comment in reader.comments) != Counter(comment.text for comment in again.comments)
    ):
        message = "this file cannot be formatted without changing its meaning; it is not changed"
        raise SpecError([Problem(message, location=Location(file, 1, 1), hint="simplify its quoting or comments")])


@dataclass
class _Comment:
    text: str
    line: int
    column: int
    index: int
    alone: bool


@dataclass
class _Placed:
    """An entry with its place in the text, in the order of the text; ``above`` is the entry that holds it."""

    entry: Entry
    index: int
    line: int
    column: int
    holder: _Placed | None
    item: bool


class _Reader:
    """Nodes with their comments, from text."""

    def __init__(self, text: str, stream: Sequence[Any]):
        self._text = text
        self._lines = text.split("\n")
        self._starts = [0, *itertools.accumulate(len(line) + 1 for line in self._lines)]
        self._placed: list[_Placed] = []
        self._spans: list[tuple[int, int]] = []
        self.root = self._build(stream)
        self.comments = self._find_comments()
        self.header: list[str] = []
        self.footer: list[str] = []
        self._attach()

    # --- nodes ---

    def _build(self, stream: Sequence[Any]) -> Node:
        root = Node("scalar")
        stack: list[tuple[Node, _Placed | None]] = []
        pending: tuple[str, str, Any] | None = None  # a key's text, its name, its mark
        for event in stream:
            kind = type(event).__name__
            if kind in ("MappingEndEvent", "SequenceEndEvent"):
                stack.pop()
                continue
            if kind not in ("ScalarEvent", "MappingStartEvent", "SequenceStartEvent"):
                continue
            node = self._node(event, kind)
            holder = stack[-1] if stack else None
            if holder is not None and holder[0].kind == "mapping" and pending is None:
                pending = (node.text, event.value, event.start_mark)
                continue
            placed = None
            if holder is None:
                root = node
            else:
                mark = pending[2] if pending else event.start_mark
                entry = Entry(node, *(pending[:2] if pending else (None, None)))
                holder[0].entries.append(entry)
                placed = _Placed(entry, mark.index, mark.line, mark.column, holder[1], pending is None)
                if placed.item and not holder[0].flow:
                    self._at_dash(placed)
                self._placed.append(placed)
                pending = None
            if kind != "ScalarEvent":
                stack.append((node, placed))
        return root

    def _line(self, index: int) -> int:
        return bisect.bisect_right(self._starts, index) - 1

    def _at_dash(self, placed: _Placed) -> None:
        """Move an item's place from its value to its dash."""
        dash = self._text.rfind("-", 0, placed.index)
        if dash >= 0:
            placed.index, placed.line = dash, self._line(dash)
            placed.column = dash - self._starts[placed.line]

    def _node(self, event: Any, kind: str) -> Node:
        if kind != "ScalarEvent":
            return Node("mapping" if kind == "MappingStartEvent" else "list", flow=bool(event.flow_style))
        start, end = event.start_mark.index, event.end_mark.index
        self._spans.append((start, end))
        text = self._text[start:end]
        plain = event.implicit[0]
        if event.style in ("|", ">"):
            text = "\n"
        elif "\n" in text:  # a scalar over several lines becomes one line
            text = json.dumps(event.value, ensure_ascii=False)
        return Node("scalar", text.strip() if plain else text, scalar(event.value) if plain else event.value)

    # --- comments ---

    def _find_comments(self) -> list[_Comment]:
        comments: list[_Comment] = []
        position = 0
        for start, end in [*sorted(self._spans), (len(self._text), len(self._text))]:
            while position < start:
                at = self._text.find("#", position, start)
                if at < 0:
                    break
                stop = self._text.find("\n", at)
                stop = len(self._text) if stop < 0 else stop
                line = self._line(at)
                begin = self._starts[line]
                before = self._text[begin:at]
                if not before or before[-1].isspace():
                    text = self._text[at:stop].rstrip()
                    alone = not before.strip()
                    comments.append(_Comment(text, line, at - begin, at, alone))
                    position = stop
                else:
                    position = at + 1
            position = max(position, end)
        return comments

    def _blank(self, line: int) -> bool:
        return line > 0 and not self._lines[line - 1].strip()

    def _attach(self) -> None:
        placed = self._placed
        places = [mark.index for mark in placed]
        first_of_line: set[int] = set()
        for comment in self.comments:
            if not comment.alone:
                self._beside(comment, bisect.bisect_left(places, comment.index))
                continue
            gap = [""] if self._blank(comment.line) else []
            position = bisect.bisect_left(places, comment.index)
            after = placed[position] if position < len(placed) else None
            before = placed[position - 1] if position else None
            if before is None:
                self.header += [*gap, comment.text]
            elif after is not None and comment.column <= after.column:
                after.entry.above += [*gap, comment.text]
            elif after is None and comment.column == 0:
                self.footer += [*gap, comment.text]
            else:
                while before.holder is not None and before.column > comment.column:
                    before = before.holder
                before.entry.below += [*gap, comment.text]
        for mark in placed:
            if mark.line not in first_of_line and self._blank(mark.line):
                if mark is placed[0]:
                    self.header.append("")
                else:
                    mark.entry.above.append("")
            first_of_line.add(mark.line)
        for mark in placed:
            # a value below its key can have a comment beside each; on one line the two would become one
            mark.entry.above += mark.entry.beside[:-1]
            del mark.entry.beside[:-1]

    def _beside(self, comment: _Comment, position: int) -> None:
        """Give a comment at the end of a line to the outermost thing that begins on the line; ``position``: of the first
        thing that begins after it."""
        first = position
        while first and self._placed[first - 1].line == comment.line:
            first -= 1
        for mark in self._placed[first:position]:
            node = mark.entry.node
            if mark.item and node.kind != "scalar" and not node.flow:
                continue  # the dash of a block: what stands on its line is its first key
            mark.entry.beside.append(comment.text)
            return
        (self._placed[position - 1].entry.beside if position else self.header).append(comment.text)
