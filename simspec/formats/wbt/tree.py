"""What a .wbt file holds, in SI units: nodes with their fields, as :class:`simspec.formats.wbt.format.Wbt` writes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

Value = object
"""Of a field: flags, numbers, texts and nodes; None is NULL; a tuple the numbers of a vector, or what stands in a list."""


@dataclass(frozen=True, slots=True)
class Node:
    """A node of a type of ``fields.py``. Fields that are not given get the language's default, which is written too.
    ``label`` is the name after DEF; "" none."""

    type: str
    fields: Mapping[str, object] = field(default_factory=dict)
    label: str = ""


@dataclass(frozen=True, slots=True)
class World:
    """A whole file: its nodes in order, WorldInfo first."""

    nodes: tuple[Node, ...]
