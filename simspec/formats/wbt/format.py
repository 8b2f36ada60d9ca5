"""The format ``wbt``: one file of VRML97, ``world.wbt``, without PROTO nodes.

Poses are a translation and a rotation as axis and angle, of a node in the one that it stands in, at the initial state.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final

from simspec.formats.kit.contract import Format
from simspec.formats.kit.text import environment
from simspec.formats.wbt.document import Document
from simspec.formats.wbt.fields import NODES, VERSION
from simspec.formats.wbt.tree import Node, World

WORLD: Final = "world.wbt"
DEEPEST: Final = 40
"""Levels that lines are indented by; what is deeper stands under them, since a chain of bodies is nested body in body."""


class Wbt(Format):
    """The .wbt language, without what the program that reads it makes of it."""

    NAME: ClassVar[str] = "wbt"

    def write(self, tree: World) -> dict[str, str]:
        """``world.wbt``, with every field of every node. Raises KeyError for nodes and fields that are not of ``fields.py``,
        and ValueError for numbers that are not finite and texts that no line can hold."""
        content = {"version": VERSION, "rows": list(_rows(tree.nodes))}
        return {WORLD: environment().get_template("wbt/world.wbt.j2").render(content)}

    def read(self, folder: Path) -> Document:
        """The document of ``world.wbt`` in ``folder``.

        Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no .wbt,
        or beyond a bound.
        """
        from simspec.formats.wbt.reading import read_document

        return read_document(folder / WORLD)


Row = Mapping[str, Any]


def _rows(nodes: Sequence[Node]) -> Iterator[Row]:
    """The lines of the file: nodes in one another as a stack, however deep they are."""
    stack: list[tuple[int, str, object]] = [(0, "", node) for node in reversed(nodes)]
    while stack:
        depth, before, what = stack.pop()
        if not isinstance(what, Node):  # a bracket that closes
            yield _row(depth, str(what))
            continue
        known = NODES[what.type]
        if strange := what.fields.keys() - known.keys():
            raise KeyError(f"{what.type} has no field {', '.join(sorted(strange))}")
        label = f"DEF {what.label} " if what.label else ""
        yield _row(depth, f"{before}{label}{what.type} {{")
        below: list[tuple[int, str, object]] = []
        for name, (kind, default) in known.items():
            value = what.fields.get(name, default)
            if kind == "SFNode" and value is not None:
                below.append((depth + 1, f"{name} ", value))
            elif kind == "MFNode" and value:
                below.append((depth + 1, "", f"{name} ["))
                below += [(depth + 2, "", node) for node in value]  # type: ignore[attr-defined]
                below.append((depth + 1, "", "]"))
            else:
                yield _plain(depth + 1, name, kind, value)
        stack.append((depth, "", "}"))
        stack += reversed(below)


def _row(depth: int, text: str, numbers: Sequence[float] = (), end: str = "") -> Row:
    from markupsafe import Markup

    return {"indent": "  " * min(depth, DEEPEST), "text": Markup(text), "numbers": numbers, "end": end}


def _plain(depth: int, name: str, kind: str, value: Any) -> Row:
    """A field that holds no node."""
    if value is None:
        return _row(depth, f"{name} NULL")
    if kind == "SFBool":
        return _row(depth, f"{name} {'TRUE' if value else 'FALSE'}")
    if kind == "SFString":
        return _row(depth, f"{name} {quoted(value)}")
    if kind == "MFString":
        return _row(depth, f"{name} [{' '.join(map(quoted, value))}]")
    if kind in ("SFFloat", "SFInt32"):
        return _row(depth, name, (value,))
    if not kind.startswith("MF"):
        return _row(depth, name, value)
    flat = value if kind == "MFFloat" else [number for row in value for number in row]
    return _row(depth, f"{name} [", flat, " ]") if flat else _row(depth, f"{name} []")


def quoted(text: str) -> str:
    """A text as the language has it. Raises ValueError for one of several lines."""
    if any(ord(letter) < 32 for letter in text):
        raise ValueError(f"{text[:60]!r} has letters that no text of a .wbt may have")
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
