"""Which of a body's shapes go onto which of DART's body nodes: DART holds numbers per shape, but filters per body node.

Shapes of several materials stay on one node as long as all of them meet the same others. Where they do not (a copy of a
shape in another layer of the contact plan, a material that passes through another), the first stays on the body's own node,
and the others go onto nodes without mass, welded to it.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

from simspec.contact.plan import ContactPlan
from simspec.world.meeting import solid_shapes
from simspec.world.types import Body, World

Part = tuple[str, int]
"""A material and a layer."""


@dataclass(frozen=True, slots=True)
class Node:
    """One of DART's body nodes: ``body`` it belongs to, ``index`` among its nodes (0 = the body's own), and its parts."""

    body: str
    index: int
    parts: tuple[Part, ...]


class Nodes:
    """The nodes of a world's bodies, and which of them must not touch."""

    def __init__(self, world: World, plan: ContactPlan):
        self._layer_of = plan.layer_of
        self._passing = {(pair.first, pair.second) for pair in world.contact.pairs if not pair.collide}
        materials = {body.name: _materials(body) for body in world.bodies}
        present = sorted({name for names in materials.values() for name in names})
        self._parts = tuple((name, layer) for name in present for layer in plan.layers(name))
        split = functools.cache(lambda names: self._split([(name, at) for name in names for at in plan.layers(name)]))
        self.of: Mapping[str, tuple[Node, ...]] = {
            body: tuple(Node(body, index, parts) for index, parts in enumerate(split(names)))
            for body, names in materials.items()
        }

    def _meet(self, one: Part, other: Part) -> bool | None:
        """Whether two parts touch; None where it does not matter, as no two bodies of these materials ever meet."""
        pair = (min(one[0], other[0]), max(one[0], other[0]))
        if pair in self._passing:
            return False
        layer = self._layer_of.get(pair)
        return None if layer is None else one[1] == other[1] == layer

    def _split(self, parts: list[Part]) -> list[tuple[Part, ...]]:
        """Each part joins the first node whose parts meet and leave the same others as it does."""
        found: list[tuple[list[Part], dict[Part, bool]]] = []
        for part in parts:
            row = {other: met for other in self._parts if (met := self._meet(part, other)) is not None}
            for held, known in found:
                if all(known.get(other, met) == met for other, met in row.items()):
                    held.append(part)
                    known.update(row)
                    break
            else:
                found.append(([part], row))
        return [tuple(held) for held, _ in found] or [()]

    def layers(self) -> list[tuple[str, str, int | None]]:
        """For every pair of materials that meets, or passes through each other, the layer it meets in (None = none)."""
        present = {name for name, _ in self._parts}
        known: dict[tuple[str, str], int | None] = {**self._layer_of, **dict.fromkeys(self._passing, None)}
        return [(*pair, known[pair]) for pair in sorted(known) if present.issuperset(pair)]

    def classes(self) -> dict[tuple[Part, ...], list[Node]]:
        """The nodes that hold the same parts, and so touch the same others; only nodes with shapes."""
        found: dict[tuple[Part, ...], list[Node]] = {}
        for nodes in self.of.values():
            for node in nodes:
                if node.parts:
                    found.setdefault(node.parts, []).append(node)
        return dict(sorted(found.items()))

    def apart(self) -> list[tuple[tuple[Part, ...], tuple[Part, ...]]]:
        """The pairs of classes whose nodes must not touch."""
        names = list(self.classes())
        return [
            (one, other)
            for index, one in enumerate(names)
            for other in names[index:]
            if any(self._meet(a, b) is False for a in one for b in other)
        ]


def _materials(body: Body) -> tuple[str, ...]:
    return tuple(dict.fromkeys(shape.material for shape in solid_shapes(body)))


def class_name(parts: tuple[Part, ...]) -> str:
    """What a class of nodes is called in the sidecar."""
    return "+".join(f"{material}.{layer}" for material, layer in parts)
