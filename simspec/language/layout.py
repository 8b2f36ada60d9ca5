"""The one canonical layout of a spec's YAML: keys in the language's order, two spaces, short things on one line."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from simspec.language import walk
from simspec.language.document import scalar
from simspec.language.models import File
from simspec.language.strict import Strict
from simspec.language.study import FiguresFile, StudyFile

WIDTH = 120
"""Columns that a line may have; a list or mapping that does not fit is written over several lines."""

BLOCK_FIELDS = frozenset(
    (
        *("contact", "materials", "pairs", "groups", "exclude", "bodies", "joint", "shapes", "poses"),
        "constraints",
        "frames",
        "states",
        *("actuators", "commands"),
        "motion",
        *("models", "positions", "velocities", "model", "control", "expect", "engines"),
        *("grasps", "open", "closed", "forces", "trajectory", "points", "program"),
        *("sweep", "over", "together", "cases", "at_timestep"),
    )
)
"""Fields that are always written over several lines, one entry each."""
BLOCK_ITEMS = frozenset(("bodies", "models", "control", "engines", "expect"))
"""Fields whose items are, too."""

OTHER_FILES: Mapping[str, type[Strict]] = {"simspec_study": StudyFile, "simspec_figures": FiguresFile}
"""Files that are no specs, by the key of their version."""

_PLAIN = re.compile(r"[A-Za-z0-9_./][A-Za-z0-9_./ ^*°²³µ%·()+×−-]*")
_IN_FLOW = re.compile(r"[\[\]{},]|: |\s#")


@dataclass
class Node:
    """A value: a scalar with its text, or a mapping or list with its entries. ``value`` is a scalar's value where the text
    must be chosen anew (many lines, or a place where it does not fit as it was written)."""

    kind: str
    text: str = ""
    value: Any = None
    entries: list[Entry] = field(default_factory=list)
    flow: bool = False


@dataclass
class Entry:
    """A key with its value, or an item of a list; comments above it, beside it, and below what is in it. "" among the
    comments is an empty line."""

    node: Node
    key: str | None = None
    name: str | None = None
    above: list[str] = field(default_factory=list)
    beside: list[str] = field(default_factory=list)
    below: list[str] = field(default_factory=list)


def node_of(data: Any) -> Node:
    """The node of plain data."""
    if isinstance(data, Mapping):
        entries = [Entry(node_of(value), scalar_text(str(key)), str(key)) for key, value in data.items()]
        return Node("mapping", entries=entries)
    if isinstance(data, (list, tuple)):
        return Node("list", entries=[Entry(node_of(item)) for item in data])
    return Node("scalar", scalar_text(data), data)


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


def lines(root: Node, header: list[str], footer: list[str]) -> list[str]:
    """The whole document."""
    text_lines = [*header]
    if root.kind == "mapping" and root.entries:
        text_lines += _block(root, _model_of(root), 0)
    else:
        text_lines.append(_inline(root))
    return _tidy([*text_lines, *footer])


def _model_of(root: Node) -> type[Strict]:
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


def _ordered(node: Node, kind: Any) -> list[Entry]:
    words = walk.keys(kind)
    if node.kind != "mapping" or not words:
        return node.entries
    return sorted(node.entries, key=lambda entry: words.index(entry.name) if entry.name in words else len(words))


def _block(node: Node, kind: Any, indent: int, field_name: str | None = None) -> list[str]:
    lines: list[str] = []
    space = " " * indent
    for index, entry in enumerate(_ordered(node, kind)):
        step: Any = entry.name if node.kind == "mapping" else 0
        below = walk.child(kind, step) if step is not None else None
        inner = entry.name if walk.is_model(kind) else None
        above = entry.above
        if index == 0:
            above = above[next((at for at, line in enumerate(above) if line), len(above)) :]
        lines += [f"{space}{line}" if line else "" for line in above]
        head = f"{space}{entry.key}:" if node.kind == "mapping" else f"{space}-"
        lines += _entry(entry, head, below, indent, inner, field_name)
        lines += [f"{space}{line}" if line else "" for line in entry.below]
    return lines


def _entry(entry: Entry, head: str, kind: Any, indent: int, inner: str | None, field_name: str | None) -> list[str]:
    node = entry.node
    beside = f"  {' '.join(entry.beside)}" if entry.beside else ""
    if node.kind == "scalar":
        return _scalar(node, head, beside, indent)
    item_of = field_name if inner is None else None
    text = _flow(node, kind, inner, item_of)
    if text is not None and len(head) + 1 + len(text) <= WIDTH:
        return [f"{head} {text}{beside}"]
    block = _block(node, kind, indent + 2, inner)
    if head.endswith("-") and not (entry.beside or block[0].lstrip().startswith("#")):
        # the item's first key stands on the line of the dash
        return [f"{head} {block[0].lstrip()}", *block[1:]]
    return [f"{head}{beside}", *block]


def _scalar(node: Node, head: str, beside: str, indent: int) -> list[str]:
    if "\n" not in node.text:
        return [f"{head} {node.text}{beside}".rstrip()]
    value = str(node.value)
    body = value.rstrip("\n")
    plain = body and not body[0].isspace() and all(line == line.rstrip() for line in body.split("\n"))
    if not plain or not all(line.isprintable() for line in body.split("\n")):
        return [f"{head} {json.dumps(value, ensure_ascii=False)}{beside}"]
    chomp = {0: "-", 1: ""}.get(len(value) - len(body), "+")
    space = " " * (indent + 2)
    ends = [""] * max(0, len(value) - len(body) - 1)
    return [f"{head} |{chomp}{beside}", *(f"{space}{line}" if line else "" for line in body.split("\n")), *ends]


def _flow(node: Node, kind: Any, name: str | None, item_of: str | None) -> str | None:
    """The value on one line, or None where it must not be: it is a block by the layout, or has comments in it."""
    if node.entries and (name in BLOCK_FIELDS or item_of in BLOCK_ITEMS):
        return None
    parts = []
    for entry in _ordered(node, kind):
        if any(entry.above) or entry.beside or entry.below:
            return None
        below = walk.child(kind, entry.name if node.kind == "mapping" and entry.name is not None else 0)
        inner = entry.name if walk.is_model(kind) else None
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


def _inline(node: Node) -> str:
    """A scalar as it may stand inside brackets."""
    if node.kind != "scalar":
        return "{}" if node.kind == "mapping" else "[]"
    if node.text and (node.text[0] in "\"'" or not _IN_FLOW.search(node.text)):
        return node.text
    return scalar_text(node.value)


def comments(root: Node) -> Iterator[str]:
    """Every comment below a node."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        for entry in node.entries:
            yield from (line for line in (*entry.above, *entry.beside, *entry.below) if line)
            waiting.append(entry.node)
