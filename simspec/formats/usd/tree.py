"""What a file of USD holds: prims within each other, each with its properties, in the order in which they are written."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Property:
    """An attribute or a relationship: its type (``double3``, ``rel``), its name, its value. Numbers of the types of single
    precision are rounded when they are written; a value of None is not written."""

    type: str
    name: str
    value: Any
    uniform: bool = False
    custom: bool = False


@dataclass(slots=True)
class Prim:
    """A prim: its name, its type ("" for none), the schemas that are applied to it, its properties, and what is in it."""

    name: str
    type: str = ""
    schemas: list[str] = field(default_factory=list)
    properties: list[Property] = field(default_factory=list)
    children: list[Prim] = field(default_factory=list)

    def apply(self, *schemas: str) -> None:
        """Apply schemas, each once."""
        self.schemas += [schema for schema in schemas if schema not in self.schemas]

    def say(self, type: str, name: str, value: Any) -> None:
        """Give an attribute of a schema a value."""
        self.properties.append(Property(type, name, value))

    def uniform(self, name: str, value: str) -> None:
        """Give a word that does not change in time."""
        self.properties.append(Property("token", name, value, uniform=True))

    def relate(self, name: str, targets: list[str]) -> None:
        """Give a relationship its targets."""
        self.properties.append(Property("rel", name, targets))

    def own(self, type: str, name: str, value: Any) -> None:
        """Say in an attribute of simspec's own what the schemas' attributes say in single precision, or not at all."""
        self.properties.append(Property(type, f"simspec:{name}", value, custom=True))


@dataclass(frozen=True, slots=True)
class Stage:
    """A whole file: its one outermost prim, and the name of the world."""

    name: str
    root: Prim
