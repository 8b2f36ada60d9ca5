"""Inventories of engines that store trees in arrays: a row for each link, joint, coordinate of velocity and shape."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from simspec.contact import ContactPlan
from simspec.engines.kit.building import Walk
from simspec.engines.kit.inventory import ArrayRows, FilterCarrier, Items, below, excluded_carriers, expected_separate
from simspec.formats.world import JsonBody
from simspec.world.contact_pairs import solid_shapes
from simspec.world.kinematics import trees
from simspec.world.types import Body, EngineValue, Shape, World


@dataclass(frozen=True)
class StoredRows:
    """The rows of a loaded world in the ``arrays`` of an engine, whose links and joints have the same numbers. ``links``: by
    body; ``starts``: by link the place of its first coordinate of velocity, and the end; ``shapes``: by unit.

    As the engine stores them, ``roots``: by body the first body of its tree; ``kinds``: by unit that of its shape; ``owners``:
    by unit its body. Bodies are rows of the document."""

    arrays: Any
    links: Sequence[int]
    starts: Sequence[int]
    shapes: Sequence[int]
    roots: Sequence[int] = ()
    kinds: Sequence[str] = ()
    owners: Sequence[int] = ()

    def link(self, row: int) -> ArrayRows:
        """Of the link and joint of a body."""
        return ArrayRows(self.arrays, self.links[row], self.links[row] + 1)

    def coordinates(self, row: int) -> ArrayRows:
        """Of the coordinates of velocity of a body's joint."""
        link = self.links[row]
        return ArrayRows(self.arrays, int(self.starts[link]), int(self.starts[link + 1]))

    def shape(self, unit: int) -> ArrayRows:
        """Of a unit."""
        return ArrayRows(self.arrays, self.shapes[unit], self.shapes[unit] + 1)


@dataclass(frozen=True)
class ArrayInventory:
    """The values of each link, of its joint, of its coordinates by kind of joint, and of each copy of a shape. ``surface``: the
    arrays of friction and restitution, which the laws of pairs leave open where shapes cannot touch."""

    body: Items[ArrayRows, Body]
    joint: Items[ArrayRows, Body]
    coordinates: Mapping[str, Items[ArrayRows, Body]]
    shape: Items[ArrayRows, Shape]
    surface: tuple[str, str]

    def read(self, walk: Walk, stored: StoredRows, excluded: Callable[[int, int], bool]) -> dict[str, EngineValue]:
        """The stored values by name. ``excluded``: whether two units never touch."""
        found: dict[str, EngineValue] = {}
        bodies = walk.document.bodies
        for row, body in enumerate(bodies):
            at, link = f"body.{body.name}", stored.link(row)
            found |= _labels(at, body) | {f"{at}.articulation": bodies[stored.roots[row]].name}
            found |= self.body.read(link, at) | self.joint.read(link, at)
            if body.joint.kind in self.coordinates:
                found |= self.coordinates[body.joint.kind].read(stored.coordinates(row), at)
        names = [f"{unit.of.shape.name}.{unit.copy.layer}" for unit in walk.units]
        for number, name in enumerate(names):
            rows = stored.shape(number)
            found |= self.shape.read(rows, f"unit.{name}") | {f"unit.{name}.{of}": rows.read(of) for of in self.surface}
            found[f"unit.{name}.kind"] = stored.kinds[number]
            found[f"unit.{name}.of"] = bodies[stored.owners[number]].name
        return found | excluded_carriers(names, excluded)

    def bare(self, kinds: Sequence[str], stored: StoredRows) -> dict[str, EngineValue]:
        """The engine's defaults: of links with joints of these ``kinds`` and a shape to which nothing was passed, without the
        values that only a finished model has (``part.name``)."""
        found: dict[str, EngineValue] = {}
        for row, kind in enumerate(kinds):
            of_joint = self.coordinates[kind].table if kind in self.coordinates else ()
            link, coordinates = stored.link(row), stored.coordinates(row)
            found |= {f"{kind}.{name}": link.read(name) for name in _plain((*self.joint.table, *self.body.table))}
            found |= {f"{kind}.{name}": coordinates.read(name) for name in _plain(of_joint)}
        return found | {f"shape.{name}": stored.shape(0).read(name) for name in _plain(self.shape.table)}

    def expect(self, world: World, plan: ContactPlan, bare: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
        """The values that follow from ``world``; ``bare`` are the engine's defaults."""
        found: dict[str, EngineValue] = {}
        carriers: list[FilterCarrier] = []
        roots = {body.name: root for root, bodies in trees(world).items() for body in bodies}
        for body in world.bodies:
            at, defaults = f"body.{body.name}", below(body.joint.kind, bare)
            found |= _labels(at, body) | {f"{at}.articulation": roots[body.name]}
            found |= self.body.expect(body, at, defaults) | self.joint.expect(body, at, defaults)
            if body.joint.kind in self.coordinates:
                found |= self.coordinates[body.joint.kind].expect(body, at, defaults)
            for shape in solid_shapes(body):
                for layer in plan.layers(shape.material):
                    name = f"{shape.name}.{layer}"
                    carriers.append(FilterCarrier(name, body.name, shape.material, layer))
                    found |= self.shape.expect(shape, f"unit.{name}", below("shape", bare))
                    found |= {f"unit.{name}.kind": shape.kind, f"unit.{name}.of": body.name}
                    numbers = plan.numbers[shape.material, layer]
                    values = (numbers.friction or 0.0, numbers.restitution or 0.0)
                    found |= {f"unit.{name}.{of}": value for of, value in zip(self.surface, values, strict=True)}
        return found | expected_separate(world, plan, carriers)


def _plain(names: Iterable[str]) -> list[str]:
    return [name for name in names if "." not in name]


def _labels(at: str, body: Body | JsonBody) -> dict[str, EngineValue]:
    """The names of a body's model, joint and shapes."""
    shapes = tuple(shape.name for shape in body.shapes)
    return {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.shapes": shapes}
