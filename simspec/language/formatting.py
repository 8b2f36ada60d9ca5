"""``simspec fmt``: a spec in the canonical layout (keys in the language's order, two spaces, short values on one line), its
comments kept, its meaning unchanged."""

from __future__ import annotations

import bisect
import itertools
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from simspec.errors import Location, Problem, SpecError
from simspec.language import problems
from simspec.language.document import Document, build, events, read_text, scalar
from simspec.language.models import File
from simspec.language.strict import Strict
from simspec.language.sweep import FiguresFile, StudyFile

WIDTH = 120
"""Columns that a line may have; a list or mapping that does not fit is written over several lines."""

BLOCK_FIELDS = frozenset(
    (
        *("contact", "materials", "pairs", "groups", "exclude", "bodies", "joint", "shapes", "poses", "constraints"),
        *(
            "frames",
            "states",
            "actuators",
            "commands",
            "motion",
            "models",
            "positions",
            "velocities",
            "model",
            "control",
        ),
        *("expect", "engines", "grasps", "open", "closed", "forces", "trajectory", "points", "program"),
        *("sweep", "over", "together", "cases", "at_timestep"),
    )
)
"""Fields that are always written over several lines, one entry each."""
BLOCK_ITEMS = frozenset(("bodies", "models", "control", "engines", "expect"))
"""Fields whose items are, too."""

OTHER_FILES: Mapping[str, type[Strict]] = {"simspec_study": StudyFile, "simspec_figures": FiguresFile}
"""Files that are no specs, by the key of their version."""

_PLAIN = re.compile(r"(?:-?\$|[A-Za-z0-9_./])[A-Za-z0-9_./ ^*°²³µ%·()+×−$-]*")
_IN_FLOW = re.compile(r"[\[\]{},]|: |\s#")


@dataclass
class CommentedNode:
    """A value: a scalar with its text, or a mapping or list with its entries. ``value`` is a scalar's value where the text
    must be chosen anew (many lines, or a place where it does not fit as it was written)."""

    kind: str
    text: str = ""
    value: Any = None
    entries: list[CommentedEntry] = field(default_factory=list)
    flow: bool = False


@dataclass
class CommentedEntry:
    """A key with its value, or an item of a list; comments above it, at the end of its line, and below its content. "" among
    the comments is an empty line."""

    node: CommentedNode
    key: str | None = None
    name: str | None = None
    above: list[str] = field(default_factory=list)
    trailing: list[str] = field(default_factory=list)
    below: list[str] = field(default_factory=list)


def node_of(data: Any) -> CommentedNode:
    """The node of plain data."""
    if isinstance(data, Mapping):
        entries = [CommentedEntry(node_of(value), scalar_text(str(key)), str(key)) for key, value in data.items()]
        return CommentedNode("mapping", entries=entries)
    if isinstance(data, (list, tuple)):
        return CommentedNode("list", entries=[CommentedEntry(node_of(item)) for item in data])
    return CommentedNode("scalar", scalar_text(data), data)


def scalar_text(value: Any) -> str:
    """YAML text that reads back as ``value``."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, float):
        text = repr(value)
        # readers of YAML 1.1 take 1e-07 for a text; 1.0e-07 is a number to all
        return re.sub(r"^(-?\d+)e", r"\1.0e", text)
    if isinstance(value, int):
        return str(value)
    text = str(value)
    if _PLAIN.fullmatch(text) and scalar(text) == text and text == text.strip():
        return text
    return json.dumps(text, ensure_ascii=False)


def lines(root: CommentedNode, header: list[str], footer: list[str]) -> list[str]:
    """The whole document."""
    text_lines = [*header]
    if root.kind == "mapping" and root.entries:
        text_lines += _block(root, _model_of(root), 0)
    else:
        text_lines.append(_inline(root))
    return _tidy([*text_lines, *footer])


def _model_of(root: CommentedNode) -> type[Strict]:
    """The model of a document, by its version's key; a spec's where it has none."""
    names = {entry.name for entry in root.entries}
    return next((model for key, model in OTHER_FILES.items() if key in names), File)


def _tidy(lines: list[str]) -> list[str]:
    """No empty lines at either end, never two in a row."""
    tidy: list[str] = []
    for line in lines:
        if line or (tidy and tidy[-1]):
            tidy.append(line)
    while tidy and not tidy[-1]:
        tidy.pop()
    return tidy


def _ordered(node: CommentedNode, kind: Any) -> list[CommentedEntry]:
    words = problems.keys(kind)
    if node.kind != "mapping" or not words:
        return node.entries
    return sorted(node.entries, key=lambda entry: words.index(entry.name) if entry.name in words else len(words))


def _block(node: CommentedNode, kind: Any, indent: int, field_name: str | None = None) -> list[str]:
    lines: list[str] = []
    space = " " * indent
    for index, entry in enumerate(_ordered(node, kind)):
        step: Any = entry.name if node.kind == "mapping" else 0
        below = problems.child(kind, step) if step is not None else None
        inner = entry.name if problems.is_model(kind) else None
        above = entry.above
        if index == 0:
            above = above[next((at for at, line in enumerate(above) if line), len(above)) :]
        lines += [f"{space}{line}" if line else "" for line in above]
        head = f"{space}{entry.key}:" if node.kind == "mapping" else f"{space}-"
        lines += _entry(entry, head, below, indent, inner, field_name)
        lines += [f"{space}{line}" if line else "" for line in entry.below]
    return lines


def _entry(
    entry: CommentedEntry, head: str, kind: Any, indent: int, inner: str | None, field_name: str | None
) -> list[str]:
    node = entry.node
    alongside = f"  {' '.join(entry.trailing)}" if entry.trailing else ""
    if node.kind == "scalar":
        return _scalar(node, head, alongside, indent)
    item_of = field_name if inner is None else None
    text = _flow(node, kind, inner, item_of)
    if text is not None and len(head) + 1 + len(text) <= WIDTH:
        return [f"{head} {text}{alongside}"]
    block = _block(node, kind, indent + 2, inner)
    if head.endswith("-") and not (entry.trailing or block[0].lstrip().startswith("#")):
        # the item's first key stands on the line of the dash
        return [f"{head} {block[0].lstrip()}", *block[1:]]
    return [f"{head}{alongside}", *block]


def _scalar(node: CommentedNode, head: str, text: str, indent: int) -> list[str]:
    if "\n" not in node.text:
        return [f"{head} {node.text}{text}".rstrip()]
    value = str(node.value)
    body = value.rstrip("\n")
    plain = body and not body[0].isspace() and all(line == line.rstrip() for line in body.split("\n"))
    if not plain or not all(line.isprintable() for line in body.split("\n")):
        return [f"{head} {json.dumps(value, ensure_ascii=False)}{text}"]
    chomp = {0: "-", 1: ""}.get(len(value) - len(body), "+")
    space = " " * (indent + 2)
    ends = [""] * max(0, len(value) - len(body) - 1)
    return [f"{head} |{chomp}{text}", *(f"{space}{line}" if line else "" for line in body.split("\n")), *ends]


def _flow(node: CommentedNode, kind: Any, name: str | None, item_of: str | None) -> str | None:
    """The value on one line, or None where it must not be: it is a block by the layout, or has comments in it."""
    if node.entries and (name in BLOCK_FIELDS or item_of in BLOCK_ITEMS):
        return None
    parts = []
    for entry in _ordered(node, kind):
        if any(entry.above) or entry.trailing or entry.below:
            return None
        below = problems.child(kind, entry.name if node.kind == "mapping" and entry.name is not None else 0)
        inner = entry.name if problems.is_model(kind) else None
        if entry.node.kind == "scalar":
            if "\n" in entry.node.text:
                return None
            text = _inline(entry.node)
        else:
            inner_text = _flow(entry.node, below, inner, name if inner is None else None)
            if inner_text is None:
                return None
            text = inner_text
        parts.append(f"{entry.key}: {text}" if node.kind == "mapping" else text)
    return f"{{{', '.join(parts)}}}" if node.kind == "mapping" else f"[{', '.join(parts)}]"


def _inline(node: CommentedNode) -> str:
    """A scalar as it may stand inside brackets."""
    if node.kind != "scalar":
        return "{}" if node.kind == "mapping" else "[]"
    if node.text and (node.text[0] in "\"'" or not _IN_FLOW.search(node.text)):
        return node.text
    return scalar_text(node.value)


def comments(root: CommentedNode) -> Iterator[str]:
    """Every comment below a node."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        for entry in node.entries:
            yield from (line for line in (*entry.above, *entry.trailing, *entry.below) if line)
            waiting.append(entry.node)


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
        document.problems.append(
            Problem("a spec is a mapping (key: value)", location=Location(file, 1, 1), code="S104")
        )
    if document.problems or reader is None:
        raise SpecError(document.problems)
    result = "\n".join(lines(reader.root, reader.header, reader.footer)) + "\n"
    _check(document, reader, result, file)
    return result


def _read(text: str, file: str) -> tuple[Document, _CommentReader | None]:
    """The text's data, and its nodes; None where it has what a spec must not have, such as a list for a key."""
    stream = list(events(text, file))
    document = build(stream, file)
    return document, None if document.problems else _CommentReader(text, stream)


def _check(before: Document, reader: _CommentReader, result: str, file: str) -> None:
    """The promise of the layout: the same data, the same comments."""
    after, again = _read(result, file)
    same = again is not None and json.dumps(before.data, sort_keys=True) == json.dumps(after.data, sort_keys=True)
    comments_of = [Counter(comment.text for comment in read.comments) for read in (reader, again) if read is not None]
    if not same or comments_of[0] != comments_of[-1]:
        message = "this file cannot be formatted without changing its meaning; it is not changed"
        raise SpecError(
            [Problem(message, location=Location(file, 1, 1), hint="simplify its quoting or comments", code="C105")]
        )


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

    entry: CommentedEntry
    index: int
    line: int
    column: int
    holder: _Placed | None
    item: bool


class _CommentReader:
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

    def _build(self, stream: Sequence[Any]) -> CommentedNode:
        root = CommentedNode("scalar")
        stack: list[tuple[CommentedNode, _Placed | None]] = []
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
                entry = CommentedEntry(node, *(pending[:2] if pending else (None, None)))
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

    def _node(self, event: Any, kind: str) -> CommentedNode:
        if kind != "ScalarEvent":
            return CommentedNode("mapping" if kind == "MappingStartEvent" else "list", flow=bool(event.flow_style))
        start, end = event.start_mark.index, event.end_mark.index
        self._spans.append((start, end))
        text = self._text[start:end]
        plain = event.implicit[0]
        if event.style in ("|", ">"):
            text = "\n"
        elif "\n" in text:  # a scalar over several lines becomes one line
            text = json.dumps(event.value, ensure_ascii=False)
        return CommentedNode("scalar", text.strip() if plain else text, scalar(event.value) if plain else event.value)

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
                self._add_trailing(comment, bisect.bisect_left(places, comment.index))
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
            # a value below its key can have a comment on each line; on one line the two would become one
            mark.entry.above += mark.entry.trailing[:-1]
            del mark.entry.trailing[:-1]

    def _add_trailing(self, comment: _Comment, position: int) -> None:
        """Give a comment at the end of a line to the outermost thing that begins on the line; ``position``: of the first
        thing that begins after it."""
        first = position
        while first and self._placed[first - 1].line == comment.line:
            first -= 1
        for mark in self._placed[first:position]:
            node = mark.entry.node
            if mark.item and node.kind != "scalar" and not node.flow:
                continue  # the dash of a block: its first key stands on its line
            mark.entry.trailing.append(comment.text)
            return
        (self._placed[position - 1].entry.trailing if position else self.header).append(comment.text)
