"""Which of a body's shapes go onto which of DART's body nodes: DART holds numbers per shape, but filters per body node.

Shapes of several materials stay on one node as long as all of them meet the same others. Where they do not (a copy of a
shape in another layer of the contact plan, a material that passes through another), the first stays on the body's own node,
and the others go onto nodes without mass, welded to it.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from simspec.contact import ContactPlan
from simspec.dialects.dart.sidecar import DartSidecar
from simspec.errors import Problem
from simspec.support.declarations import acceptance
from simspec.world.contact_pairs import meeting_kinds, solid_shapes
from simspec.world.types import Body, World

Part = tuple[str, int]
"""A material and a layer."""


@dataclass(frozen=True, slots=True)
class DartNode:
    """One of DART's body nodes: ``body`` it belongs to, ``index`` among its nodes (0 = the body's own), and its parts."""

    body: str
    index: int
    parts: tuple[Part, ...]


class DartNodePlan:
    """The nodes of a world's bodies, and which of them must not touch."""

    def __init__(self, world: World, plan: ContactPlan):
        self._layer_of = plan.layer_of
        self._passing = {(pair.first, pair.second) for pair in world.contact.pairs if not pair.collide}
        materials = {body.name: _materials(body) for body in world.bodies}
        present = sorted({name for names in materials.values() for name in names})
        self._parts = tuple((name, layer) for name in present for layer in plan.layers(name))
        split = functools.cache(lambda names: self._split([(name, at) for name in names for at in plan.layers(name)]))
        self.of: Mapping[str, tuple[DartNode, ...]] = {
            body: tuple(DartNode(body, index, parts) for index, parts in enumerate(split(names)))
            for body, names in materials.items()
        }

    def _meet(self, part: Part, other: Part) -> bool | None:
        """Whether two parts touch; None where it does not matter, as no two bodies of these materials ever meet."""
        pair = (min(part[0], other[0]), max(part[0], other[0]))
        if pair in self._passing:
            return False
        layer = self._layer_of.get(pair)
        return None if layer is None else part[1] == other[1] == layer

    def _split(self, parts: list[Part]) -> list[tuple[Part, ...]]:
        """Each part joins the first node whose parts meet and leave the same others as it does."""
        found: list[tuple[list[Part], dict[Part, bool]]] = []
        for part in parts:
            row = {other: met for other in self._parts if (met := self._meet(part, other)) is not None}
            for actual, known in found:
                if all(known.get(other, met) == met for other, met in row.items()):
                    actual.append(part)
                    known.update(row)
                    break
            else:
                found.append(([part], row))
        return [tuple(actual) for actual, _ in found] or [()]

    def layers(self) -> list[tuple[str, str, int | None]]:
        """For every pair of materials that meets, or passes through each other, the layer it meets in (None = none)."""
        present = {name for name, _ in self._parts}
        known: dict[tuple[str, str], int | None] = {**self._layer_of, **dict.fromkeys(self._passing, None)}
        return [(*pair, known[pair]) for pair in sorted(known) if present.issuperset(pair)]

    def classes(self) -> dict[tuple[Part, ...], list[DartNode]]:
        """The nodes that hold the same parts, and so touch the same others; only nodes with shapes."""
        found: dict[tuple[Part, ...], list[DartNode]] = {}
        for nodes in self.of.values():
            for node in nodes:
                if node.parts:
                    found.setdefault(node.parts, []).append(node)
        return dict(sorted(found.items()))

    def excluded_pairs(self) -> list[tuple[tuple[Part, ...], tuple[Part, ...]]]:
        """The pairs of classes whose nodes must not touch."""
        names = list(self.classes())
        return [
            (name, other)
            for index, name in enumerate(names)
            for other in names[index:]
            if any(self._meet(a, b) is False for a in name for b in other)
        ]


def _materials(body: Body) -> tuple[str, ...]:
    return tuple(dict.fromkeys(shape.material for shape in solid_shapes(body)))


def class_name(parts: tuple[Part, ...]) -> str:
    """The name of a class of nodes in the sidecar."""
    return "+".join(f"{material}.{layer}" for material, layer in parts)


# Which of DART's collision detectors is sound for which shapes.
#
# *Measured* with dartpy 6.20.0: 40 random poses of each pair of shapes at an overlap of 1 mm (missed, wrong depth, wrong
# normal), and bodies of about 0.2 m let down on a fixed plane, box, or flat end of a cylinder, in three to four poses (how
# deep their lowest point came to lie after 4 s). All detectors lose a flat face where they give it one contact instead of
# three or four. Sound means contacts to 0.06 mm, and no body that goes in deeper than one step's way of its impact, which
# DART takes back at 1 mm/s. A pair that stands in neither table of a detector has not been measured: it is refused unless it
# is accepted by name.

Pairs = Mapping[tuple[str, str], str]

_SINGLE = "one contact for a flat face or a long side: it sinks by"
_ROUNDED = "edges and corners are rounded by a tenth of the smallest half-size"
"""Bullet's margin, in pairs without a way of their own: a cylinder on its edge at 45° is found (√2 − 1) margins late
(measured to 1e-11 m, ``tests/engines/dart/test_contact.py``)."""
_NO_CAPSULE = "capsules are taken for spheres of 0.1 m"
_HULL = "hulls come to rest up to"
_TWO_HULLS = "an overlap of 1 mm of two meshes is reported as 69 mm or none, and a stack of three collapses"

UNSOUND: Mapping[str, Pairs] = {
    "dart": {
        ("box", "plane"): f"{_SINGLE} 170 mm",
        ("capsule", "plane"): f"{_SINGLE} 53 mm",
        ("cylinder", "plane"): f"{_SINGLE} 97 mm",
        ("ellipsoid", "plane"): "1.6 mm too deep",
        ("box", "cylinder"): f"9 of 40 contacts missed; {_SINGLE} 97 mm",
        ("capsule", "cylinder"): f"{_SINGLE} 53 mm",
        ("cylinder", "cylinder"): f"5 of 40 contacts missed; {_SINGLE} 52 mm",
        ("ellipsoid", "sphere"): "36 of 40 contacts missed",
        ("box", "ellipsoid"): "18 of 40 contacts missed",
        ("capsule", "ellipsoid"): "33 of 40 contacts missed",
        ("cylinder", "ellipsoid"): "33 of 40 contacts missed",
        ("ellipsoid", "ellipsoid"): "38 of 40 contacts missed",
        **dict.fromkeys((("box", "mesh"), ("mesh", "plane"), ("mesh", "sphere")), f"{_HULL} 20 mm deep"),
        ("capsule", "mesh"): f"{_HULL} 20 mm deep",
        ("cylinder", "mesh"): f"46 of 1000 contacts of 1 mm missed; {_HULL} 20 mm deep",
        ("ellipsoid", "mesh"): "27 of 100 contacts of 1 mm missed",
        ("mesh", "mesh"): _TWO_HULLS,
    },
    "ode": {
        ("box", "capsule"): f"{_SINGLE} 53 mm",
        ("capsule", "cylinder"): f"on a flat end {_SINGLE} 36 mm",
        ("cylinder", "cylinder"): f"lying on a flat end {_SINGLE} 46 mm; standing on it is sound",
        **dict.fromkeys(
            (
                ("ellipsoid", "plane"),
                ("ellipsoid", "sphere"),
                ("box", "ellipsoid"),
                ("capsule", "ellipsoid"),
                ("cylinder", "ellipsoid"),
                ("ellipsoid", "ellipsoid"),
            ),
            "ellipsoids are taken for spheres of 0.01 m",
        ),
        ("box", "mesh"): f"{_HULL} 0.7 mm deep",
        ("capsule", "mesh"): f"63 of 1000 contacts of 1 mm missed; {_HULL} 0.7 mm deep",
        ("cylinder", "mesh"): f"4 of 1000 contacts of 10 mm missed; {_HULL} 0.7 mm deep",
        ("ellipsoid", "mesh"): "ellipsoids are taken for spheres of 0.01 m",
        **dict.fromkeys((("mesh", "plane"), ("mesh", "sphere")), f"{_HULL} 0.7 mm deep"),
        ("mesh", "mesh"): _TWO_HULLS,
    },
    "fcl": {
        ("box", "plane"): f"{_SINGLE} 68 mm",
        ("cylinder", "plane"): f"{_SINGLE} 96 mm",
        ("box", "cylinder"): f"{_SINGLE} 144 mm",
        ("cylinder", "cylinder"): f"{_SINGLE} 46 mm",
        **dict.fromkeys(
            (
                ("capsule", "plane"),
                ("capsule", "sphere"),
                ("box", "capsule"),
                ("capsule", "capsule"),
                ("capsule", "cylinder"),
                ("capsule", "ellipsoid"),
            ),
            _NO_CAPSULE,
        ),
        ("capsule", "mesh"): _NO_CAPSULE,
        **dict.fromkeys(
            (("box", "mesh"), ("cylinder", "mesh"), ("ellipsoid", "mesh"), ("mesh", "plane"), ("mesh", "sphere")),
            f"{_HULL} 15 mm deep",
        ),
        ("mesh", "mesh"): _TWO_HULLS,
    },
    "bullet": {
        ("box", "sphere"): f"{_ROUNDED}: 31 of 100 contacts of 1 mm missed",
        ("cylinder", "sphere"): f"{_ROUNDED}: 20 of 100 contacts of 1 mm missed",
        ("box", "capsule"): f"{_ROUNDED}: 13 of 40 contacts of 1 mm missed",
        ("box", "cylinder"): f"{_ROUNDED}: 35 of 40 contacts of 1 mm missed at 0.2 m",
        ("cylinder", "plane"): f"{_ROUNDED}: one of 0.2 m comes 4 mm too deep on its edge",
        ("capsule", "cylinder"): f"{_ROUNDED}: 10 of 40 contacts of 1 mm missed",
        ("cylinder", "cylinder"): f"{_ROUNDED}: 16 of 40 contacts of 1 mm missed at 0.2 m",
        ("ellipsoid", "sphere"): "34 of 40 contacts missed",
        **dict.fromkeys(
            (
                ("ellipsoid", "plane"),
                ("box", "ellipsoid"),
                ("capsule", "ellipsoid"),
                ("cylinder", "ellipsoid"),
                ("ellipsoid", "ellipsoid"),
            ),
            "10 to 17 mm too deep",
        ),
        ("box", "mesh"): f"{_ROUNDED}: 80 of 100 contacts of 1 mm missed; {_HULL} 10 mm deep",
        ("cylinder", "mesh"): f"{_ROUNDED}: 80 of 100 contacts of 1 mm missed; {_HULL} 10 mm deep",
        ("ellipsoid", "mesh"): "gaps of 1 mm are taken for contacts",
        **dict.fromkeys((("capsule", "mesh"), ("mesh", "plane"), ("mesh", "sphere")), f"{_HULL} 10 mm deep"),
        ("mesh", "mesh"): _TWO_HULLS,
    },
}
"""Of each detector the pairs of shapes that it gets wrong, and how."""

REFUSED: frozenset[tuple[str, str]] = frozenset({("mesh", "mesh")})
"""Pairs that no detector supports even approximately: they are refused even where the kind is accepted."""

SOUND: Mapping[str, tuple[tuple[str, str], ...]] = {
    "dart": (
        *(("box", "box"), ("box", "capsule"), ("box", "sphere")),
        *(("capsule", "capsule"), ("capsule", "sphere")),
        ("cylinder", "sphere"),
        ("plane", "sphere"),
        ("sphere", "sphere"),
    ),
    "ode": (
        *(("box", "box"), ("box", "cylinder"), ("box", "plane"), ("box", "sphere")),
        *(("capsule", "capsule"), ("capsule", "plane"), ("capsule", "sphere")),
        *(("cylinder", "plane"), ("cylinder", "sphere")),
        ("plane", "sphere"),
        ("sphere", "sphere"),
    ),
    "fcl": (
        *(("box", "box"), ("box", "ellipsoid"), ("box", "sphere")),
        *(("cylinder", "ellipsoid"), ("cylinder", "sphere")),
        *(("ellipsoid", "ellipsoid"), ("ellipsoid", "plane"), ("ellipsoid", "sphere")),
        ("plane", "sphere"),
        ("sphere", "sphere"),
    ),
    "bullet": (
        *(("box", "box"), ("box", "plane")),
        *(("capsule", "capsule"), ("capsule", "plane"), ("capsule", "sphere")),
        ("plane", "sphere"),
        ("sphere", "sphere"),
    ),
}
"""Of each detector the pairs of shapes that it was measured to get right, but for what ``OVERLOOKED`` says. Planes never meet
planes: bodies with a plane do not move."""

_NOT_MEASURED = "this pair has not been measured with it (tools/detectors.py)"

OVERLOOKED: Mapping[str, Pairs] = {
    "ode": {
        (
            "box",
            "cylinder",
        ): "of 100 random contacts of 0.1 to 10 mm it overlooks 2 or 3, all of an edge of the box with the rim",
        ("capsule", "capsule"): "of 1000 random contacts of 1 to 10 mm it overlooks 2 or 3",
    },
}
"""Of each detector the pairs that it gets right but for some contacts that it does not see, and how many: measured
(docs/records/dart-detectors.md, ``tools/detectors.py``), and said where a world has them. They need not be accepted:
of what DART has nothing is better for these pairs, since ``dart`` misses more and ``fcl`` has one contact for a face."""

ORDER = ("dart", "ode", "fcl")
"""In which order sound detectors are tried; ``dart`` has the exact contacts of spheres and boxes. ``bullet`` has nothing
that is more exact: it is used where it is requested, as cheaper."""

LESSER_EVIL = ("ode", "dart", "fcl")
"""The order among detectors that get equally many pairs wrong: ``ode`` loses flat faces of capsules, but no contact."""

TINY_FRICTION = 1e-3
"""DART takes a friction coefficient up to this for none (measured: 0.0009 gave no deceleration, 0.002 gave 0.0020)."""


def flaws(detector: str, pairs: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """Of some sorted pairs of kinds of shapes those that the detector is not known to get right, with the reason, sorted."""
    wrong, sound = UNSOUND[detector], SOUND[detector]
    return {pair: wrong.get(pair, _NOT_MEASURED) for pair in sorted(pairs) if pair in wrong or pair not in sound}


def choose(world: World, engine: str) -> str:
    """The detector that gets the fewest pairs of shapes wrong that may touch, first of all pairs that are not accepted."""
    kinds, accepted = meeting_kinds(world), _accepted(world, engine)

    def evil(detector: str) -> tuple[int, int, int]:
        wrong = flaws(detector, kinds)
        order = LESSER_EVIL if wrong else ORDER
        return sum(accepted.isdisjoint(pair) for pair in wrong), len(wrong), order.index(detector)

    return min(ORDER, key=evil)


def _accepted(world: World, engine: str) -> set[str]:
    """The kinds of shapes whose contact may be approximate."""
    prefix = "shape."
    return {name.removeprefix(prefix) for name in world.options(engine).accept if name.startswith(prefix)}


def detector_of(world: World, engine: str, setting: str) -> str:
    """The setting ``collision_detector``, with ``auto`` resolved by the collision shapes that may touch."""
    return choose(world, engine) if setting == "auto" else setting


def accepted_contact(world: World, detector: str, engine: str, kind: str) -> str | None:
    """The detector's errors in contact of a kind of shapes that the spec accepts; None if it has none."""
    if kind not in _accepted(world, engine):
        return None
    wrong = flaws(detector, (pair for pair in meeting_kinds(world) if kind in pair))
    text = "; ".join(f"{name} and {other}: {flaw}" for (name, other), flaw in wrong.items())
    return f"with its collision detector {detector}, {text}" if wrong else None


def overlooked(world: World, setting: str, engine: str, kind: str) -> str | None:
    """Contacts of a kind of shapes that may touch in this world and that the detector in use overlooks; None if there are none.

    ``setting``: as for :func:`detector_of`. A pair is reported for one of its kinds, the rarer one.
    """
    pairs = {pair for table in OVERLOOKED.values() for pair in table if _rarer(pair) == kind}
    there = {shape.kind for body in world.bodies for shape in solid_shapes(body)}
    if not any(set(pair) <= there for pair in pairs):
        return None
    detector = detector_of(world, engine, setting)
    found = sorted(pairs & set(OVERLOOKED.get(detector, {})) & meeting_kinds(world))
    text = "; ".join(f"{name} and {other}: {OVERLOOKED[detector][name, other]}" for name, other in found)
    return f"here its collision detector {detector} has {text}" if found else None


def _rarer(pair: tuple[str, str]) -> str:
    """The kind to name: boxes, planes and spheres are in every world."""
    return next((kind for kind in pair if kind not in ("box", "plane", "sphere")), pair[0])


def problems(world: World, detector: str, engine: str) -> list[Problem]:
    """The detector's errors in this world, except for pairs of which one kind is accepted by name."""
    accepted = _accepted(world, engine)
    found = []
    for pair, flaw in flaws(detector, meeting_kinds(world)).items():
        if pair in REFUSED:
            found.append(_unsupported(world, pair, flaw, engine))
        elif accepted.isdisjoint(pair):
            kind = _rarer(pair)
            found.append(
                Problem(
                    f"{engine} supports contact between {pair[0]} and {pair[1]} only approximately, with its collision "
                    f"detector {detector}: {flaw}",
                    _first(world, kind),
                    found=f"shapes of kinds {pair[0]} and {pair[1]} that may touch",
                    hint=f"{acceptance(engine, f'shape.{kind}')}; or use other shapes",
                    code="E104",
                )
            )
    return found


def _unsupported(world: World, pair: tuple[str, str], flaw: str, engine: str) -> Problem:
    name, other = pair
    return Problem(
        f"{engine} does not support contact between {name} and {other}: {flaw}",
        _first(world, name),
        found=f"shapes of kinds {name} and {other} that may touch",
        hint="separate them by collision groups or contact.exclude, use other shapes, or run without this engine",
        code="E104",
    )


def _first(world: World, kind: str) -> str:
    """The place of the first collision shape of a kind."""
    return next(
        f"bodies.{body.name}.shapes.{index}"
        for body in world.bodies
        for index, shape in enumerate(body.shapes)
        if shape.collision and shape.kind == kind
    )


# The filter in a .skel folder's sidecar, held against itself (proof level L0): every two shapes meet once at most.
#
# A shape may be there several times, each copy on a node of its own (see ``dialects/dart/copies.py``). The sidecar names
# classes of nodes by the materials and layers of their copies, and the pairs of classes that are excluded.

Copies = tuple[str, ...]
"""Of one shape the class of each node that has a copy of it; "" for a node that no pair of classes concerns."""


def check_filter(sidecar: DartSidecar, nodes: set[str], fixed: set[str]) -> None:
    """Raise ValueError where copies of two shapes meet in more than one layer, or in another than that of their materials.

    ``nodes`` are the names of all nodes of the file, ``fixed`` the bodies that cannot move.
    Shapes of two bodies that never touch may meet in any number of layers; filters between them have no effect.
    """
    classes, pairs = sidecar.filter.classes, sidecar.filter.excluded
    unknown = sorted({node for class_ in classes.values() for node in class_} - nodes)
    if unknown or {name for pair in pairs for name in pair} != set(classes):
        raise ValueError(f"the filter's classes do not fit the file: unknown nodes {unknown}")
    of = {node: name for name, class_ in classes.items() for node in class_}
    separate = {frozenset(pair) for pair in pairs}
    layer_of = {frozenset((name, other)): layer for name, other, layer in sidecar.filter.layers}
    for entry in classes:
        for other in classes:
            for (a, layer), (b, other_layer) in itertools.product(_parts(entry), _parts(other)):
                pair = frozenset((a, b))
                meet = layer_of.get(pair, -1) == layer == other_layer
                if pair in layer_of and meet == (frozenset((entry, other)) in separate):
                    raise ValueError(
                        f"{entry} and {other} {'do not ' if meet else ''}touch, against the layers of {a}, {b}"
                    )
    for copies, other_copies in _meeting(sidecar, of, fixed):
        met = [(a, b) for a in copies for b in other_copies if frozenset((a, b)) not in separate]
        if len(met) > 1:
            raise ValueError(f"copies of the same two shapes meet {len(met)} times: {met}")


def _parts(name: str) -> list[tuple[str, int]]:
    """The materials and layers in the name of a class."""
    return [(part.rpartition(".")[0], int(part.rpartition(".")[2])) for part in name.split("+")]


def _meeting(sidecar: DartSidecar, of: Mapping[str, str], fixed: set[str]) -> set[tuple[Copies, Copies]]:
    """The pairs of shapes, by their copies, of which some body may touch some other. Two bodies of a kind are enough."""
    copies: dict[str, set[Copies]] = {}
    for shape in sidecar.shapes:
        if shape.surfaces:
            copies.setdefault(shape.body, set()).add(tuple(of.get(copy.node, "") for copy in shape.surfaces))
    if all(len(entry) < 2 for copy in copies.values() for entry in copy):
        return set()
    group = {name: key for key, names in sidecar.groups.items() for name in names}
    ignored = {frozenset(pair) for pair in sidecar.ignored_groups}
    excluded = {frozenset(pair) for pair in sidecar.excluded}
    special = {name for pair in excluded for name in pair}
    chosen: dict[tuple[Any, ...], list[str]] = {}
    for name, actual in copies.items():
        key = (frozenset(actual), group.get(name), name in fixed, name if name in special else "")
        alike = chosen.setdefault(key, [])
        if len(alike) < 2:
            alike.append(name)
    bodies = [name for names in chosen.values() for name in names]
    return {
        (a, b)
        for index, body in enumerate(bodies)
        for other in bodies[index + 1 :]
        if not (body in fixed and other in fixed)
        and frozenset((body, other)) not in excluded
        and (body not in group or other not in group or frozenset((group[body], group[other])) not in ignored)
        for a in copies[body]
        for b in copies[other]
    }
