"""A .wbt document as text again, with other values in some of its fields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from simspec.formats.wbt.document import Document, Field, Node, Value
from simspec.formats.wbt.format import quoted

EXACT = 2.0**53
"""Whole numbers up to which doubles have all: fields of whole numbers stand without a point."""
Changes = Mapping[tuple[Node, str], Sequence[Value]]
"""Values of fields, by node and name."""


def text_of(document: Document, changes: Changes) -> str:
    """The text of ``document`` with ``changes``, of which no number is rounded. Raises ValueError for a change of a field that
    is not there."""
    for node, name in changes:
        node.field(name)
    return "\n".join([f"#VRML_SIM {document.version} utf8", *_lines(document.nodes, changes), ""])


def _lines(nodes: Sequence[Node], changes: Changes) -> Iterator[str]:
    stack: list[str | Node] = list(reversed(nodes))
    while stack:
        what = stack.pop()
        if isinstance(what, str):
            yield what
            continue
        label = f"DEF {what.label} " if what.label else ""
        inner: list[str | Node] = [f"{label}{what.kind} {{"]
        for field in what.fields:
            inner += _field(field, changes.get((what, field.name), field.values))
        stack += reversed([*inner[1:], "}"])
        yield str(inner[0])


def _field(field: Field, values: Sequence[Value]) -> list[str | Node]:
    nodes = [value for value in values if isinstance(value, Node)]
    words = [field.name, *(_word(value) for value in values if not isinstance(value, Node))]
    if not nodes:
        return [f"{field.name} [ {' '.join(words[1:])} ]" if field.listed else " ".join(words)]
    return [f"{field.name} [", *nodes, "]"] if field.listed else [field.name, *nodes]


def _word(value: Value) -> str:
    if value is None:
        return "NULL"
    if isinstance(value, bool):
        return "TRUE" if value else "FALSE"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < EXACT else repr(value)
    raise TypeError(f"{value!r} is no value of a field")
