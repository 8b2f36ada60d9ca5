"""What was read of a .wbt file: nodes and fields as they stand there, each with its line, and nothing left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Union

Value = Union[bool, float, str, None, "Node"]
"""NULL is None."""


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """A field of a node; ``listed`` whether its values stand in brackets."""

    name: str
    line: int
    values: tuple[Value, ...]
    listed: bool

    def __repr__(self) -> str:
        return f"<{self.name} in line {self.line}>"


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A node, compared by identity; ``kind`` is its type, ``label`` its name after DEF, "" without one."""

    file: str
    kind: str
    label: str
    line: int
    fields: tuple[Field, ...]

    def __repr__(self) -> str:
        return f"<{self.kind} {self.label} in line {self.line}>"

    def refused(self, why: str, line: int | None = None) -> ValueError:
        """The error of something that is wrong with it, with file, line, type and label."""
        named = f"{self.kind} {self.label}".strip()
        return ValueError(f"{self.file}:{self.line if line is None else line}: {named[:200]}: {why}")

    def field(self, name: str) -> Field:
        """A field. Raises ValueError where it is missing: what the file does not say, a program would choose."""
        for field in self.fields:
            if field.name == name:
                return field
        raise self.refused(f"has no {name}")

    def _single(self, name: str, allowed: type | tuple[type, ...], told: str) -> Value:
        field = self.field(name)
        if field.listed or len(field.values) != 1 or not isinstance(field.values[0], allowed):
            raise self.refused(f"{name} should be {told}", field.line)
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

    def node(self, name: str) -> Node | None:
        """The node of a field; None where it is NULL."""
        return self._single(name, (Node, type(None)), "a node or NULL")  # type: ignore[return-value]

    def numbers(self, name: str, count: int) -> tuple[float, ...]:
        """The numbers of a vector or a list."""
        field = self.field(name)
        values = tuple(value for value in field.values if isinstance(value, float))
        if len(values) != len(field.values) or len(values) != count:
            found = len(values) if len(values) == len(field.values) else "other values than"
            raise self.refused(f"{name} has {found} numbers, should have {count}", field.line)
        return values

    def nodes(self, name: str) -> tuple[Node, ...]:
        """The nodes of a list."""
        field = self.field(name)
        nodes = tuple(value for value in field.values if isinstance(value, Node))
        if len(nodes) != len(field.values) or not field.listed:
            raise self.refused(f"{name} should be a list of nodes", field.line)
        return nodes

    def walk(self) -> Iterator[Node]:
        """This node and all below it, in the order of the file, however deep."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            inner = [value for field in node.fields for value in field.values if isinstance(value, Node)]
            waiting.extend(reversed(inner))


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """A whole file: ``version`` the second word of it, ``nodes`` those that stand in no other."""

    file: str
    version: str
    nodes: tuple[Node, ...]

    def walk(self) -> Iterator[Node]:
        """Every node, in the order of the file."""
        for node in self.nodes:
            yield from node.walk()

    def only(self, kind: str) -> Node:
        """The one node of a type that stands in no other. Raises ValueError where there is none, or more."""
        found = [node for node in self.nodes if node.kind == kind]
        if len(found) != 1:
            raise ValueError(f"{self.file}: has {len(found)} {kind} nodes, should have one")
        return found[0]
