"""The filter in a .skel folder's sidecar, held against itself (proof level L0): every two shapes meet once at most.

A shape may be there several times, each copy on a node of its own (see ``dialects/dart/copies.py``). The sidecar names classes
of nodes by the materials and layers of their copies, and the pairs of classes that are apart.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from simspec.dialects.dart.sidecar import DartSidecar

Copies = tuple[str, ...]
"""Of one shape the class of each node that has a copy of it; "" for a node that no pair of classes concerns."""


def check_filter(sidecar: DartSidecar, nodes: set[str], fixed: set[str]) -> None:
    """Raise ValueError where copies of two shapes meet in more than one layer, or in another than that of their materials.

    ``nodes`` are the names of all nodes of the file, ``fixed`` the bodies that cannot move.
    Shapes of two bodies that never touch may meet in any number of layers; what is told of them has no effect.
    """
    classes, pairs = sidecar.filter.classes, sidecar.filter.apart
    unknown = sorted({node for held in classes.values() for node in held} - nodes)
    if unknown or {name for pair in pairs for name in pair} != set(classes):
        raise ValueError(f"the filter's classes do not fit the file: unknown nodes {unknown}")
    of = {node: name for name, held in classes.items() for node in held}
    apart = {frozenset(pair) for pair in pairs}
    layer_of = {frozenset((one, other)): layer for one, other, layer in sidecar.filter.layers}
    for one in classes:
        for other in classes:
            for (a, layer), (b, other_layer) in itertools.product(_parts(one), _parts(other)):
                pair = frozenset((a, b))
                meet = layer_of.get(pair, -1) == layer == other_layer
                if pair in layer_of and meet == (frozenset((one, other)) in apart):
                    raise ValueError(
                        f"{one} and {other} {'do not ' if meet else ''}touch, against the layers of {a}, {b}"
                    )
    for copies, other_copies in _meeting(sidecar, of, fixed):
        met = [(a, b) for a in copies for b in other_copies if frozenset((a, b)) not in apart]
        if len(met) > 1:
            raise ValueError(f"copies of the same two shapes meet {len(met)} times: {met}")


def _parts(name: str) -> list[tuple[str, int]]:
    """The materials and layers that the name of a class tells."""
    return [(part.rpartition(".")[0], int(part.rpartition(".")[2])) for part in name.split("+")]


def _meeting(sidecar: DartSidecar, of: Mapping[str, str], fixed: set[str]) -> set[tuple[Copies, Copies]]:
    """The pairs of shapes, by their copies, of which some body may touch some other. Two bodies of a kind are enough."""
    copies: dict[str, set[Copies]] = {}
    for shape in sidecar.shapes:
        if shape.surfaces:
            copies.setdefault(shape.body, set()).add(tuple(of.get(copy.node, "") for copy in shape.surfaces))
    if all(len(one) < 2 for held in copies.values() for one in held):
        return set()
    group = {name: key for key, names in sidecar.groups.items() for name in names}
    ignored = {frozenset(pair) for pair in sidecar.ignored_groups}
    excluded = {frozenset(pair) for pair in sidecar.excluded}
    special = {name for pair in excluded for name in pair}
    chosen: dict[tuple[Any, ...], list[str]] = {}
    for name, held in copies.items():
        key = (frozenset(held), group.get(name), name in fixed, name if name in special else "")
        alike = chosen.setdefault(key, [])
        if len(alike) < 2:
            alike.append(name)
    bodies = [name for names in chosen.values() for name in names]
    return {
        (a, b)
        for index, one in enumerate(bodies)
        for other in bodies[index + 1 :]
        if not (one in fixed and other in fixed)
        and frozenset((one, other)) not in excluded
        and (one not in group or other not in group or frozenset((group[one], group[other])) not in ignored)
        for a in copies[one]
        for b in copies[other]
    }
