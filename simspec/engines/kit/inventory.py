"""Inventories: every value that an engine stores besides the fields of the read-back, by name, and the value it must have.

Each name stands once, in a table of :class:`Items` in the engine's ``inventory.py``, with two value functions: ``read`` queries
the engine, ``expect`` derives the value from the world. The proof compares the two: they share no code with each other, and
``expect`` runs in a process without the engine::

    JOINT = Items[EngineJoint, Body]({
        "damping": (lambda joint: joint.getDamping(), lambda body: body.joint.damping),
        "enabled": (lambda joint: joint.isEnabled(), True),        # the same for every world
        "limit": (lambda joint: joint.getLimit(), limit_of),       # None: the element has no such value
    })
    BODY = Items[EngineBody, Body].named(getattr, {"gravity_scale": 1.0, "ccd_enabled": NEUTRAL})

    JOINT.read(joint, "joint.elbow"), JOINT.expect(body, "joint.elbow")   # {"joint.elbow.damping": ...}
"""

from __future__ import annotations

import hashlib
import inspect
import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Generic, NamedTuple, Self, TypeVar

import numpy as np

from simspec.contact import ContactPlan
from simspec.dialects.kit.sidecar import SIDECAR_SCHEMA
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import format_of
from simspec.engines.kit.settings import pair_settings, written_settings
from simspec.world.canonical import sha256
from simspec.world.kinematics import rigid_groups
from simspec.world.types import EngineValue, World

Element = TypeVar("Element")
"""An element of an engine: a body, a joint, the simulation."""
Source = TypeVar("Source")
"""The part of a world from which the values of an element follow."""


class Neutral:
    """The type of :data:`NEUTRAL`."""


NEUTRAL: Final = Neutral()
"""The expectation that a value is the engine's default, read from an element to which simspec passed nothing."""
Read = Callable[[Element], EngineValue | None]
Expect = Callable[[Source], EngineValue | None] | EngineValue | Neutral


class Items(Generic[Element, Source]):
    """The values of one kind of element: by name how to read it from the engine, and how to derive it from the world."""

    def __init__(self, table: Mapping[str, tuple[Read[Element], Expect[Source]]]):
        self.table = table

    @classmethod
    def named(cls, read: Callable[[Element, str], Any], expect: Mapping[str, Expect[Source]]) -> Self:
        """Items that are all read alike, by their names: ``read`` is given the element and the name."""

        def reader(name: str) -> Read[Element]:
            return lambda element: read(element, name)

        return cls({name: (reader(name), expected) for name, expected in expect.items()})

    def __or__(self, other: Items[Element, Source]) -> Items[Element, Source]:
        return Items({**self.table, **other.table})

    def read(self, element: Element, prefix: str = "") -> dict[str, EngineValue]:
        """The engine's values, each as ``prefix.NAME``."""
        return self._named(prefix, {name: read(element) for name, (read, _) in self.table.items()})

    def expect(
        self, source: Source, prefix: str = "", neutral: Mapping[str, EngineValue] | None = None
    ) -> dict[str, EngineValue]:
        """The values that follow from the world, under the same names; ``neutral`` gives the engine's defaults by NAME."""
        found: dict[str, EngineValue | None] = {}
        for name, (_, expected) in self.table.items():
            if isinstance(expected, Neutral):
                found[name] = None if neutral is None else neutral.get(name)
            else:
                found[name] = expected(source) if callable(expected) else expected
        return self._named(prefix, found)

    @staticmethod
    def _named(prefix: str, values: Mapping[str, EngineValue | None]) -> dict[str, EngineValue]:
        start = f"{prefix}." if prefix else ""
        return {f"{start}{name}": value for name, value in values.items() if value is not None}


def below(prefix: str, values: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
    """The values whose names begin with ``prefix.``, without that."""
    start = f"{prefix}."
    return {name.removeprefix(start): value for name, value in values.items() if name.startswith(start)}


class ArrayRows(NamedTuple):
    """The rows of one element, from ``start`` to before ``stop``, in an engine's arrays of all elements of a kind."""

    arrays: Any
    start: int
    stop: int

    def read(self, name: str) -> EngineValue:
        """The numbers of the element in an array, which may be in a part (``part.name``): one, or a tuple."""
        values: Any = self.arrays
        for part in name.split("."):
            values = getattr(values, part)
        rows = values.numpy() if hasattr(values, "numpy") else values
        found = tuple(finite(x) for row in rows[self.start : self.stop] for x in np.ravel(row).tolist())
        return found[0] if len(found) == 1 else found


MOST_NAMED = 8
"""A set is written as its names up to this many, beyond as their number and a digest."""


@dataclass(frozen=True, slots=True)
class FilterCarrier:
    """A unit of an engine's collision filter: its name, and the body, material and layer of the shapes that it carries."""

    name: str
    body: str
    material: str
    layer: int


def named_set(names: Iterable[str]) -> str:
    """The names, sorted, with spaces between; of many their number and a digest."""
    return listed(sorted(names))


def listed(names: Sequence[str]) -> str:
    """The names in their order, with spaces between; of many their number and a digest."""
    if len(names) <= MOST_NAMED:
        return " ".join(names)
    return f"{len(names)} in all, {hashlib.sha256(chr(0).join(names).encode()).hexdigest()[:16]}"


LARGEST = 1e308
"""In place of infinity, which JSON does not have."""


def finite(value: float) -> float:
    """A number with :data:`LARGEST` in place of infinity."""
    return max(-LARGEST, min(LARGEST, float(value)))


def stored(value: Any) -> EngineValue:
    """A value as inventories have it: a finite number, ``none`` for None, others as they are."""
    found: EngineValue = "none" if value is None else finite(value) if isinstance(value, float) else value
    return found


def arguments(function: Callable[..., Any], without: Collection[str]) -> dict[str, EngineValue]:
    """The defaults of the arguments of ``function`` that have one, by name, but for those in ``without``."""
    found = {name: argument.default for name, argument in inspect.signature(function).parameters.items()}
    return {
        name: stored(value)
        for name, value in found.items()
        if value is not inspect.Parameter.empty and name not in without
    }


def excluded_carriers(names: Sequence[str], filtered: Callable[[int, int], bool]) -> dict[str, EngineValue]:
    """For every carrier, as ``apart.NAME``, the others that the engine keeps from touching it: ``filtered`` is the engine's
    answer for the places of two names."""
    excluded: dict[str, list[str]] = {name: [] for name in names}
    for (row, first), (column, second) in itertools.combinations(enumerate(names), 2):
        if filtered(row, column):
            excluded[first].append(second)
            excluded[second].append(first)
    return {f"apart.{name}": named_set(others) for name, others in excluded.items()}


def expected_separate(world: World, plan: ContactPlan, carriers: Iterable[FilterCarrier]) -> dict[str, EngineValue]:
    """For every carrier, as ``apart.NAME``, the others that must not touch it: of its own rigid group, or both still, of groups
    that ignore each other, of bodies that the world names, of materials that pass through each other, of other layers."""
    carriers = list(carriers)
    groups = rigid_groups(world)
    collision_group = {body.name: body.collision_group for body in world.bodies}
    ignored = set(world.contact.ignored_groups)
    kinds: dict[tuple[bool, str, str, int], set[str]] = {}
    kind_of: dict[str, tuple[bool, str, str, int]] = {}
    of_body: dict[str, set[str]] = {}
    of_group: dict[str, set[str]] = {}
    for item in carriers:
        kind = (groups[item.body] == "world", collision_group[item.body], item.material, item.layer)
        kind_of[item.name] = kind
        kinds.setdefault(kind, set()).add(item.name)
        of_body.setdefault(item.body, set()).add(item.name)
        of_group.setdefault(groups[item.body], set()).add(item.name)

    def meet(entry: tuple[bool, str, str, int], other: tuple[bool, str, str, int]) -> bool:
        pair = (min(entry[1], other[1]), max(entry[1], other[1]))
        return not (entry[0] and other[0]) and pair not in ignored and plan.meet(entry[2:], other[2:])

    by_kind = {
        kind: frozenset(name for other, actual in kinds.items() if not meet(kind, other) for name in actual)
        for kind in kinds
    }
    named = _named_partners(world, of_body)
    return {
        f"apart.{carrier.name}": named_set(
            (by_kind[kind_of[carrier.name]] | named.get(carrier.body, set()) | of_group[groups[carrier.body]])
            - {carrier.name}
        )
        for carrier in carriers
    }


def _named_partners(world: World, of_body: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """For each body that the world excludes from touching another the carriers of those."""
    found: dict[str, set[str]] = {}
    for name, other in world.contact.excluded_bodies:
        found.setdefault(name, set()).update(of_body.get(other, ()))
        found.setdefault(other, set()).update(of_body.get(name, ()))
    return found


# Labels of a sidecar and its settings: as an engine's process received them, and as the world requests them.

LABELS = ("schema", "dialect", "format", "engine", "world", "friction_cone")


WORLD_LABEL = "sidecar.world"
"""The hash of the world that files are made of, among those labels."""


def sidecar_labels(sidecar: Mapping[str, Any]) -> dict[str, EngineValue]:
    """The labels and settings of a sidecar, by the names that inventories give them."""
    labels: dict[str, EngineValue] = {f"sidecar.{name}": sidecar[name] for name in LABELS}
    for pair in sidecar.get("pair_settings", ()):
        first, second = pair["between"]
        labels |= _of_pair((first, second), pair["settings"])
    return labels | {f"settings.{name}": value for name, value in sidecar["settings"].items()}


def expected_labels(engine: type[Engine], world: World) -> dict[str, EngineValue]:
    """The expected result of :func:`sidecar_labels` for ``world``."""
    values: tuple[str | int, ...] = (
        SIDECAR_SCHEMA,
        engine.DIALECT,
        format_of(engine),
        engine.NAME,
        sha256(world),
        world.contact.friction_cone,
    )
    labels: dict[str, EngineValue] = {}
    for name, value in zip(LABELS, values, strict=True):
        labels[f"sidecar.{name}"] = value
    for pair, settings in pair_settings(engine, world).items():
        labels |= _of_pair(pair, settings)
    return labels | {f"settings.{name}": value for name, value in written_settings(engine, world).items()}


def _of_pair(pair: tuple[str, str], settings: Mapping[str, Any]) -> dict[str, EngineValue]:
    return {f"pair_settings.{pair[0]}.{pair[1]}.{name}": value for name, value in settings.items()}
