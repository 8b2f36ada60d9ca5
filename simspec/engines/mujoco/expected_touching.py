"""Which shapes a loaded ``mjModel`` must let touch: masks and exclusions, from the world.

It shares no code with what writes them (``formats/mjcf/filter.py``).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from simspec.world.kinematics import rigid_groups
from simspec.world.types import World

CLASSES_OF_MASKS = 30
"""Classes of shapes beside the common one that a mask's bits tell apart."""
Kinds = frozenset[tuple[str, str]]
"""Kinds of solid shapes: collision group and material."""


class Touching:
    """What keeps shapes of a world apart in MuJoCo."""

    def __init__(self, world: World):
        self.world = world
        self.groups = rigid_groups(world)
        self.solid = {body.name: [shape for shape in body.shapes if shape.collision] for body in world.bodies}

    @functools.cached_property
    def _classes(self) -> dict[Kinds, list[tuple[str, str]]]:
        """Kinds of solid shapes, (collision group, material), by the kinds that they do not touch."""
        kinds = sorted({(b.collision_group, s.material) for b in self.world.bodies for s in self.solid[b.name]})
        passing = {frozenset((pair.first, pair.second)) for pair in self.world.contact.pairs if not pair.collide}
        ignored = {frozenset(groups) for groups in self.world.contact.ignored_groups}
        found: dict[Kinds, list[tuple[str, str]]] = {}
        for kind in kinds:
            apart = frozenset(
                other
                for other in kinds
                if frozenset((kind[0], other[0])) in ignored or frozenset((kind[1], other[1])) in passing
            )
            found.setdefault(apart, []).append(kind)
        return found

    def by_bodies(self) -> bool:
        """Whether masks have too few bits, and bodies are excluded pair by pair."""
        return sum(bool(apart) for apart in self._classes) > CLASSES_OF_MASKS

    def masks(self) -> dict[str, Any]:
        """Classes of shapes by their masks: members, and the classes that they touch."""
        names: dict[Any, list[str]] = {}
        row = {kind: apart for apart, kinds in self._classes.items() for kind in kinds}
        by_bodies = self.by_bodies()
        for body in self.world.bodies:
            for shape in body.shapes:
                kind = (body.collision_group, shape.material)
                own = None if not shape.collision else frozenset() if by_bodies else row[kind]
                names.setdefault(own, []).append(shape.name)
        first = {own: min(some) for own, some in names.items()}
        found: dict[str, Any] = {}
        for own, some in names.items():
            apart = own or frozenset()
            touches = (
                ()
                if own is None
                else (
                    name
                    for other, name in first.items()
                    if other is not None and not self._keeps_apart(apart, other, row)
                )
            )
            found[f"masks.{first[own]}.members"] = tuple(sorted(some))
            found[f"masks.{first[own]}.touches"] = tuple(sorted(touches))
        return found

    @staticmethod
    def _keeps_apart(apart: Kinds, other: Kinds, row: Mapping[tuple[str, str], Kinds]) -> bool:
        return any(kind in apart for kind, own in row.items() if own == other)

    def excluded(self) -> set[tuple[str, str]]:
        """Pairs of solid bodies: named by the world, of one rigid moving group, or kept apart where masks cannot."""
        bodies = [body for body in self.world.bodies if self.solid[body.name]]
        names = {body.name for body in bodies}
        found = {pair for pair in self.world.contact.excluded_bodies if set(pair) <= names}
        rigid: dict[str, list[str]] = {}
        for body in bodies:
            if self.groups[body.name] != "world":
                rigid.setdefault(self.groups[body.name], []).append(body.name)
        for members in rigid.values():
            found |= {(a, b) for a in members for b in members if a < b}
        if self.by_bodies():
            row = {kind: apart for apart, kinds in self._classes.items() for kind in kinds}
            kinds = {body.name: {(body.collision_group, s.material) for s in self.solid[body.name]} for body in bodies}
            found |= {
                (a, b) for a in names for b in names if a < b and all(k in row[j] for j in kinds[a] for k in kinds[b])
            }
        return found
