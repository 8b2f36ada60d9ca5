"""Contact of a compiled model as materials, groups and excluded pairs of a spec.

A geom's surface is all that its contact follows from: friction, the number of its directions, priority, and the bits of its
filter. Geoms of equal surfaces share a material. The law of every two is computed as the file's language has it, and is written
where the spec's rule (the larger of two values) gives another.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Final, NamedTuple

from simspec.imports.mjcf.compiled import CompiledMjcf, MjcfFeatures

SEPARATE_GAP: Final = 4
"""The first version of the compiler in which a gap is beyond the margin, without a force (measured: not 3.8.0, but 4.0.1)."""
MOST_MATERIALS: Final = 300
"""Materials of a spec."""
MOST_SURFACES: Final = 2000
"""Different surfaces that may touch something: every two of them are held against each other."""
SOLREF: Final = (0.02, 1.0)
SOLIMP: Final = (0.9, 0.95, 0.001, 0.5, 2.0)
"""The default softness."""
SLIDING, TORSIONAL, ROLLING = 3, 4, 6
"""Directions of friction from which on each kind acts."""
CONES: Final = {0: "pyramid-inscribed", 1: "elliptic"}
"""Friction cones by their number."""


class MjcfSurface(NamedTuple):
    """All that the contact of a geom follows from. ``owner``: its number from 1 on where a pair of the file names it, or
    another geom of its body that the filter keeps apart from the second one's body; else 0."""

    contype: int
    conaffinity: int
    directions: int
    priority: int
    friction: tuple[float, float, float]
    owner: int = 0


class MjcfLaw(NamedTuple):
    """Contact of two surfaces."""

    friction: float
    torsional_friction: float
    rolling_friction: float


def meets(first: MjcfSurface, second: MjcfSurface) -> bool:
    """Whether the bits of two surfaces let them touch."""
    return bool(first.contype & second.conaffinity or second.contype & first.conaffinity)


def combined(first: MjcfSurface, second: MjcfSurface) -> MjcfLaw:
    """The law of two surfaces: the one of higher priority decides; else the larger values, and the more directions."""
    if first.priority != second.priority:
        first = second = max(first, second, key=lambda surface: surface.priority)
    directions = max(first.directions, second.directions)
    sliding, torsional, rolling = (max(pair) for pair in zip(first.friction, second.friction, strict=True))
    return _law(directions, sliding, torsional, rolling)


def _owners(first: MjcfSurface, second: MjcfSurface) -> tuple[int, int]:
    return (min(first.owner, second.owner), max(first.owner, second.owner))


def _law(directions: int, sliding: float, torsional: float, rolling: float) -> MjcfLaw:
    return MjcfLaw(
        sliding if directions >= SLIDING else 0.0,
        torsional if directions >= TORSIONAL else 0.0,
        rolling if directions >= ROLLING else 0.0,
    )


@dataclass
class MjcfSurfaces:
    """The surfaces of a model, and what a spec says of them."""

    model: CompiledMjcf
    features: MjcfFeatures
    materials: dict[MjcfSurface, str] = field(default_factory=dict)
    _of: dict[int, MjcfSurface] = field(default_factory=dict)
    """The surface of each geom that may touch something."""
    _pairs_of: dict[tuple[int, int], MjcfLaw] = field(default_factory=dict)
    """Laws that the file gives to two geoms, by their smaller and larger number from 1 on."""
    _margins_of: dict[tuple[int, int], float] = field(default_factory=dict)
    """Where contact of two such geoms begins (m), where that is not the sum of their margins."""
    _separated: set[tuple[int, int]] = field(default_factory=set)
    """Bodies that the filter separates, by their smaller and larger number, of which the file lets two geoms touch."""
    touching_joined: dict[tuple[int, int], None] = field(default_factory=dict)
    """Bodies and those that they are joined to and may touch, by their numbers."""
    groups: dict[int, str] = field(default_factory=dict)
    """The collision group of bodies that are in another than the default one, by their number."""

    def __post_init__(self) -> None:
        model = self.model
        if not model.disabled("contact", "constraint"):
            self._read_pairs()
            paired = {geom - 1 for pair in self._pairs_of for geom in pair}
            parted = {body for pair in self._separated for body in pair}
            surfaces = {
                number: self._surface(number, number in paired or int(model["geom_bodyid"][number]) in parted)
                for number in range(model.numbers["ngeom"])
            }
            # most geoms that touch nothing have no bits: they are not held against each other
            solid = {entry for entry in surfaces.values() if entry.owner or entry.contype or entry.conaffinity}
            if len(solid) > MOST_SURFACES:
                found, allowed = f"{len(solid):,}", f"{MOST_SURFACES:,}"
                hint = "give geoms that touch alike the same friction, condim, contype, conaffinity and priority"
                raise model.root.error("too many different surfaces of contact", found, allowed, hint, code="I105")
            touching = {entry for entry in solid if any(self.meets(entry, other) for other in solid)}
            self._of = {number: surface for number, surface in surfaces.items() if surface in touching}
        self._grouped = self._groups(set(self._of.values()))
        names: dict[tuple[Any, ...], str] = {}
        for surface in self._of.values():
            # bits that groups say make no other materials
            key = surface if self._grouped is None else surface[2:]
            name = "surface" if not names else f"surface_{len(names) + 1}"
            self.materials.setdefault(surface, names.setdefault(key, name))
        if len(names) > MOST_MATERIALS:
            for number in self._of:
                self.features.add("contact.materials", model.part("geom", number).element)
            first = next(iter(self.materials.values()))
            self.materials = dict.fromkeys(self.materials, first)
        self._features()

    def _surface(self, number: int, alone: bool) -> MjcfSurface:
        model = self.model
        sliding, torsional, rolling = (float(value) for value in model["geom_friction"][number])
        words = ("contype", "conaffinity", "condim", "priority")
        contype, conaffinity, directions, priority = (int(model[f"geom_{word}"][number]) for word in words)
        owner = number + 1 if alone else 0
        return MjcfSurface(contype, conaffinity, directions, priority, (sliding, torsional, rolling), owner)

    def _read_pairs(self) -> None:
        """Laws of two geoms, as far as two bodies have them that may touch."""
        model = self.model
        weld = model["body_weldid"]
        for number, part in model.parts["pair"].items():
            first, second = sorted(int(model[f"pair_geom{which}"][number]) for which in (1, 2))
            index, two = (int(model["geom_bodyid"][geom]) for geom in (first, second))
            if weld[index] == weld[two] == 0:
                continue  # neither moves
            both = (min(index, two), max(index, two))
            sliding, other, torsional, rolling, rolling_other = map(float, model["pair_friction"][number])
            even = sliding == other and rolling == rolling_other
            if weld[index] == weld[two] or not even:
                self.features.add("contact.pair" if even else "contact.uneven", part.element)
                continue
            if self._filters(index, two):
                self._separated.add(both)
                if self._parted(index, two):
                    self._touch(index, two)
            margin = self._felt("pair", number)
            if margin < 0.0:
                self.features.add("pair.margin", part.element)
            elif model["pair_gap"][number]:
                self.features.add("pair.gap", part.element)
            if (*model["pair_solref"][number], *model["pair_solimp"][number]) != (*SOLREF, *SOLIMP):
                self.features.add("contact.softness", part.element)
            directions = int(model["pair_dim"][number])
            self._pairs_of[first + 1, second + 1] = _law(directions, sliding, torsional, rolling)
            if margin != self.margin(first) + self.margin(second):
                self._margins_of[first + 1, second + 1] = max(0.0, margin)

    def _stated(self, first: MjcfSurface, second: MjcfSurface) -> MjcfLaw | None:
        return self._pairs_of.get(_owners(first, second))

    def meets(self, first: MjcfSurface, second: MjcfSurface) -> bool:
        """Whether two surfaces touch: where the file gives them a law, or where their bits let them and the filter does not
        separate their bodies."""
        if self._stated(first, second) is not None:
            return True
        if self._separated and first.owner and second.owner:
            index, two = sorted(int(self.model["geom_bodyid"][surface.owner - 1]) for surface in (first, second))
            if (index, two) in self._separated:
                return False
        return meets(first, second)

    def _parted(self, index: int, other: int) -> bool:
        """Whether the spec separates two bodies because one is the other's parent; the world is no parent."""
        parent = self.model["body_parentid"]
        return bool((index and int(parent[other]) == index) or (other and int(parent[index]) == other))

    def law(self, first: MjcfSurface, second: MjcfSurface) -> MjcfLaw:
        """The law of two surfaces: the file's owner for them, or what both combine to."""
        return self._stated(first, second) or combined(first, second)

    def material(self, geom: int) -> str | None:
        """The material of a geom; None where it touches nothing."""
        surface = self._of.get(geom)
        return None if surface is None else self.materials[surface]

    def _felt(self, kind: str, number: int) -> float:
        """Where contact begins (m): at the margin; before version 4 of the compiler at the margin less the gap."""
        margin, gap = (float(self.model[f"{kind}_{word}"][number]) for word in ("margin", "gap"))
        return margin - gap if self.model.major < SEPARATE_GAP else margin

    def margin(self, geom: int) -> float:
        """The margin (m) of a geom."""
        return max(0.0, self._felt("geom", geom))

    def looped(self, index: int, two: int) -> None:
        """Two bodies, by their numbers, that a loop joins: where the file lets shapes of them touch, the spec says it."""
        weld, both = self.model["body_weldid"], (min(index, two), max(index, two))
        if weld[index] == weld[two] or (self._filters(index, two) and both not in self._separated):
            return
        sides = [self._of_body.get(body, set()) for body in (index, two)]
        if any(self.meets(first, second) for first in sides[0] for second in sides[1]):
            self._touch(index, two)

    def _filters(self, index: int, two: int) -> bool:
        """Whether the file separates two bodies, independently of the bits of their geoms: by name, or as joined ones."""
        model = self.model
        weld, parent = model["body_weldid"], model["body_parentid"]
        above = weld[parent[weld[index]]] == weld[two] != 0 or weld[parent[weld[two]]] == weld[index] != 0
        if above and not model.disabled("filterparent"):
            return True
        return (index, two) in self._excludes or (two, index) in self._excludes

    @functools.cached_property
    def _excludes(self) -> frozenset[tuple[int, int]]:
        return frozenset(divmod(int(signature), 1 << 16) for signature in self.model["exclude_signature"])

    @functools.cached_property
    def _of_body(self) -> dict[int, set[MjcfSurface]]:
        solid: dict[int, set[MjcfSurface]] = {}
        for geom, surface in self._of.items():
            solid.setdefault(int(self.model["geom_bodyid"][geom]), set()).add(surface)
        return solid

    def _touch(self, index: int, two: int) -> None:
        parent = self.model["body_parentid"]
        pair = (two, index) if int(parent[two]) == index else (index, two)
        if pair not in self.touching_joined and pair[::-1] not in self.touching_joined:
            self.touching_joined[pair] = None

    def _features(self) -> None:
        model = self.model
        for number in self._of:
            element = model.part("geom", number).element
            if self._felt("geom", number) < 0.0:
                self.features.add("geom.margin", element)
            elif model["geom_gap"][number]:
                self.features.add("geom.gap", element)
            softness = (*model["geom_solref"][number], *model["geom_solimp"][number])
            if softness != (*SOLREF, *SOLIMP):
                self.features.add("contact.softness", element)
            adhesion = model.get("geom_adhesion")
            if adhesion is not None and adhesion[number].any():
                self.features.add("geom.adhesion", element)
        if self._of and model.enabled("override"):
            self.features.add("contact.override", model.root)

    def contact(self, names: dict[int, str], alone: bool) -> dict[str, Any]:
        """``contact`` of the spec; ``names``: those of bodies by their number; ``alone``: it is a model file, whose scenario
        says how materials combine."""
        contact = self._of_all()
        pairs = self._pairs()
        if self._grouped is None:
            pairs += self._filtered()
        elif self._grouped:
            contact["groups"] = self._grouped
        if pairs:
            contact["pairs"] = pairs
        excluded = self._excluded(names)
        if excluded:
            contact["exclude"] = excluded
        if alone:
            said = [contact.pop(word, None) for word in ("friction_cone", "combine")]
            if any(said):
                self.features.add("contact.scenario", self.model.root)
        return contact

    def _of_all(self) -> dict[str, Any]:
        contact: dict[str, Any] = {}
        if self.model.options["cone_stated"]:
            contact["friction_cone"] = CONES[int(self.model.options["cone"])]
        if self.materials:
            contact["materials"] = {name: self._material(surface) for surface, name in self.materials.items()}
        if len(self.materials) > 1 and len(set(self.materials.values())) > 1:
            contact["combine"] = "max"
        return contact

    @staticmethod
    def _material(surface: MjcfSurface) -> dict[str, float]:
        law = combined(surface, surface)
        return {name: value for name, value in law._asdict().items() if value}

    def _pairs(self) -> list[dict[str, Any]]:
        """Laws that the larger of two values does not give."""
        pairs: dict[tuple[str, str], dict[str, Any]] = {}
        for (first, name), (second, other) in combinations(self.materials.items(), 2):
            if name == other or not self.meets(first, second):
                continue
            wanted, entry, two = self.law(first, second), combined(first, first), combined(second, second)
            differing = {
                key: value
                for key, value in wanted._asdict().items()
                if value != max(getattr(entry, key), getattr(two, key))
            }
            if _owners(first, second) in self._margins_of:
                differing["margin"] = self._margins_of[_owners(first, second)]
            if differing:
                pairs.setdefault((min(name, other), max(name, other)), {"between": [name, other], **differing})
        return list(pairs.values())

    def _groups(self, surfaces: set[MjcfSurface]) -> dict[str, Any] | None:
        """Collision groups that say what the bits do; None where the shapes of one body differ in theirs, or a pair of the file
        lets shapes touch that their bits separate."""
        stated = (
            not meets(surface, other) and self._stated(surface, other) for surface, other in combinations(surfaces, 2)
        )
        if self._separated or any(stated):
            return None
        if all(
            self.meets(surface, other)
            for surface in surfaces
            for other in surfaces
            if surface is not other or not surface.owner
        ):
            return {}
        bits: dict[int, tuple[int, int]] = {}
        for geom, surface in self._of.items():
            body = int(self.model["geom_bodyid"][geom])
            if bits.setdefault(body, surface[:2]) != surface[:2]:
                return None
        kinds: dict[tuple[int, int], str] = {}
        for body, bit_pair in sorted(bits.items()):
            self.groups[body] = kinds.setdefault(bit_pair, f"group_{len(kinds) + 1}")
        groups: dict[str, Any] = {}
        for (contype, conaffinity), name in kinds.items():
            ignored = [other for (index, two), other in kinds.items() if not (contype & two or index & conaffinity)]
            groups[name] = {"ignores": ignored}
        return groups

    def _filtered(self) -> list[dict[str, Any]]:
        items = list(self.materials.items())
        return [
            {"between": [name, other], "collide": False}
            for index, (first, name) in enumerate(items)
            for second, other in items[index:]
            if not self.meets(first, second)
        ]

    def _excluded(self, names: dict[int, str]) -> list[list[str]]:
        """Pairs of bodies that do not touch, and are not joined to one another."""
        model = self.model
        solid = self._of_body
        weld, parent = model["body_weldid"], model["body_parentid"]
        pairs = {(min(pair), max(pair)) for pair in self._excludes}
        members: dict[int, list[int]] = {}
        for body in solid:
            members.setdefault(int(weld[body]), []).append(body)
        for group, bodies in members.items():
            above = int(weld[parent[group]])
            if not group:
                continue
            if above and not self.model.disabled("filterparent"):
                for index in bodies:
                    pairs |= {(min(index, other), max(index, other)) for other in members.get(above, ())}
            elif (
                int(parent[group]) in solid
                and (min(group, int(parent[group])), max(group, int(parent[group]))) not in pairs
            ):
                self._joined(group, int(parent[group]), solid)
        return [
            [names[index], names[other]]
            for index, other in sorted(pairs)
            if index in solid and other in solid and index in names and other in names
            if index != other and not self._parted(index, other) and (index, other) not in self._separated
            if weld[index] != weld[other]
        ]

    def _joined(self, body: int, parent: int, solid: dict[int, set[MjcfSurface]]) -> None:
        if (
            parent
            and body in solid
            and any(self.meets(entry, other) for entry in solid[body] for other in solid[parent])
        ):
            self._touch(body, parent)
