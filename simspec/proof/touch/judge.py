"""What an engine reports of the states in which shapes were brought together, held against the world's rules."""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from simspec.proof.checks import Check
from simspec.proof.touch.geometry import Solid, gap, transforms
from simspec.proof.touch.plan import Meetings, oracle_of
from simspec.proof.touch.scene import Pair
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.frames import sorted_pair
from simspec.world.hull import rounded_core
from simspec.world.types import World

MATRIX = "collision matrix"
SEEN = 9
"""Pairs of two kinds of shapes that an engine must report for each one that it overlooks: an error of a filter that leaves out
many is an error."""
SEEN_OF_ROUNDED = 0.05
"""Share of the radii by which rounded shapes must overlap: engines are exact to a tenth of that."""
TOLD = 6
"""Pairs named in one sentence; beyond them only their number is."""


class _Rules:
    """Whether two shapes may touch, by the world's rules."""

    def __init__(self, world: World, meetings: Meetings):
        self._filter = CollisionFilter(world)
        self._solids = meetings.solids
        self._names = [body.name for body in world.bodies]
        self._known: dict[tuple[object, ...], bool] = {}

    def allow(self, i: int, j: int) -> bool:
        first, other = self._solids[i], self._solids[j]
        key = (first.body, other.body, first.shape.material, other.shape.material)
        if key not in self._known:
            self._known[key] = self._filter.may_touch(
                self._names[first.body], self._names[other.body]
            ) and self._filter.may_materials_touch(first.shape.material, other.shape.material)
        return self._known[key]


def touch_checks(
    world: World,
    meetings: Meetings,
    units: Sequence[tuple[int, Sequence[str]]],
    touching: np.ndarray,
    overlooks: Container[tuple[str, str]] = (),
    rounding: Mapping[tuple[str, str], float] = MappingProxyType({}),
) -> list[Check]:
    """The collision matrix: of each pair of shapes that was brought together whether the engine reports it, as the world's
    rules say; that nothing else is reported in any state that they forbid; and that where an engine holds copies of a shape,
    two shapes meet by one pair of copies only: each pair of copies adds the forces of its own law.

    ``overlooks``: sorted pairs of kinds of shapes of which the engine is declared to miss some overlaps; a pair of such shapes
    that it never reports is told, and is no error of its filter while it reports ``SEEN`` times as many others of these kinds.
    ``rounding``: of the shapes (body, name) whose edges the engine rounds the radius (m); a pair that it never reports is told,
    and is no error, where only what is rounded away overlaps.
    ``units``: what the engine tells apart, each a body's index and the names of its shapes it may be; ``touching`` (n, 3):
    state and two units that touch in it.
    """
    rules, place = _Rules(world, meetings), {(s.body, s.name): s.number for s in meetings.solids}
    solids_of = [tuple(place[body, name] for name in names if (body, name) in place) for body, names in units]
    owners: dict[int, list[int]] = {}
    for unit, numbers in enumerate(solids_of):
        for number in dict.fromkeys(numbers):
            owners.setdefault(number, []).append(unit)
    copied = {number for number, some in owners.items() if len(some) > 1}
    wrong: dict[tuple[str, str], str] = {}
    reported: set[tuple[int, int, int]] = set()
    forbidden: dict[tuple[int, int], bool] = {}
    by: dict[tuple[int, int, int], tuple[int, int]] = {}
    for state, first, other in touching.tolist():
        reported.add((state, min(first, other), max(first, other)))
        if (first, other) not in forbidden:
            # once for two units: links have up to a hundred shapes each, and touch in most states
            product = itertools.product(solids_of[first], solids_of[other])
            forbidden[first, other] = first == other or not any(rules.allow(*sorted(pair)) for pair in product)
        if forbidden[first, other]:
            names = tuple("/".join(units[unit][1]) or f"a shape of body {units[unit][0]}" for unit in (first, other))
            wrong.setdefault((min(names), max(names)), "should not touch")
        if copied.isdisjoint(solids_of[first]) and copied.isdisjoint(solids_of[other]):
            continue
        for pair in itertools.product(solids_of[first], solids_of[other]):
            i, j = sorted(pair)
            if by.setdefault((state, i, j), (first, other)) != (first, other):
                wrong.setdefault(_names(meetings, (i, j)), "should touch once, not by several pairs of their copies")
    seen: dict[Pair, bool] = {}
    unclear: set[Pair] = set()
    for state, i, j, alone in meetings.tried.tolist():
        # of each report whether it distinguishes this shape from others of its body
        reports = [
            len(solids_of[first]) == len(solids_of[other]) == 1
            for first, other in itertools.product(owners.get(i, ()), owners.get(j, ()))
            if (state, min(first, other), max(first, other)) in reported
        ]
        if reports and not any(reports) and not alone and rules.allow(i, j):
            unclear.add((i, j))  # the link touches, by this shape or by another of it
            reports = []
        seen[i, j] = seen.get((i, j), False) or bool(reports)
    unclear = {pair for pair in unclear if not seen[pair]}
    missed = {pair for pair, touches in seen.items() if rules.allow(*pair) and not touches and pair not in unclear}
    overlooked = _overlooked(meetings, missed, {pair for pair, touches in seen.items() if touches}, overlooks)
    edges = _edges_only(world, meetings, missed - overlooked, rounding)
    for i, j in sorted(missed - overlooked - edges):
        wrong.setdefault(_names(meetings, (i, j)), "should touch")
    count = len(seen)
    detail = _told(
        meetings, sorted(unclear), sorted(overlooked), sorted(edges), sum(rules.allow(*pair) for pair in seen)
    )
    where = ""
    if wrong:
        names, what = next(iter(wrong.items()))
        where = f"shapes {names[0]}, {names[1]}"
        detail = f"{len(wrong)} pairs wrong; this one {what}; {detail}"
    if not count and not wrong:
        return []  # see ``plan.nothing_to_try``
    return [Check("L4", MATRIX, max(count, len(wrong)), 0.0, float(len(wrong)), where, detail)]


def _edges_only(
    world: World, meetings: Meetings, missed: set[Pair], rounding: Mapping[tuple[str, str], float]
) -> set[Pair]:
    """Those of the pairs that overlap in no state that was tried once the edges of their shapes are rounded."""

    def radius(solid: Solid) -> float:
        return rounding.get((world.bodies[solid.body].name, solid.name), 0.0)

    requested = {pair: [meetings.solids[number] for number in pair] for pair in missed}
    requested = {pair: solids for pair, solids in requested.items() if any(radius(solid) for solid in solids)}
    separate = dict.fromkeys(requested, True)
    for state, i, j, _ in meetings.tried.tolist() if requested else ():
        if not separate.get((i, j), False):
            continue
        poses = transforms(oracle_of(world).body_poses(meetings.q[state]))
        radii = [radius(solid) for solid in requested[i, j]]
        first, other = (_core(solid, value) for solid, value in zip(requested[i, j], radii, strict=True))
        between = gap(first, poses[first.body] @ first.pose, other, poses[other.body] @ other.pose).distance
        separate[i, j] = between > sum(radii) * (1.0 - SEEN_OF_ROUNDED)
    return {pair for pair, alone in separate.items() if alone}


def _core(solid: Solid, radius: float) -> Solid:
    if not radius:
        return solid
    size = rounded_core(solid.shape.kind, solid.shape.size, radius)
    return dataclasses.replace(solid, shape=dataclasses.replace(solid.shape, size=size))


def _overlooked(
    meetings: Meetings, missed: set[Pair], touching: set[Pair], overlooks: Container[tuple[str, str]]
) -> set[Pair]:
    """Those of the pairs that an engine never reported that are of kinds of which it overlooks some overlaps."""

    def kinds(pair: Pair) -> tuple[str, str]:
        return sorted_pair(*(meetings.solids[number].shape.kind for number in pair))

    met, not_met = (Counter(map(kinds, pairs)) for pairs in (touching, missed))
    return {pair for pair in missed if kinds(pair) in overlooks and met[kinds(pair)] >= SEEN * not_met[kinds(pair)]}


def _names(meetings: Meetings, pair: Pair) -> tuple[str, str]:
    first, other = (meetings.solids[number].name for number in pair)
    return (first, other)


def _list(meetings: Meetings, pairs: Sequence[Pair], count: int) -> str:
    """Some pairs by name, and how many more there are."""
    text = ", ".join(" – ".join(_names(meetings, pair)) for pair in pairs[:TOLD])
    more = count - min(len(pairs), TOLD)
    return f"{text} and {more} more" if text and more else text or f"{more} pairs"


def _told(
    meetings: Meetings, unclear: Sequence[Pair], overlooked: Sequence[Pair], edges: Sequence[Pair], touching: int
) -> str:
    """What was tried and what was not, by name and number."""
    tried = len({(i, j) for _, i, j, _ in meetings.tried.tolist()})
    parts: list[str] = [f"{touching} pairs of shapes touch, {tried - touching} do not"]
    separate: Iterable[tuple[str, Sequence[Pair], int]] = (
        ("the joints cannot bring together", meetings.apart, len(meetings.apart)),
        ("not tried, as they are too many", meetings.left, meetings.untried),
        ("reported only together with other shapes of the same bodies", unclear, len(unclear)),
        ("overlooked, of kinds of shapes of which the engine misses some overlaps", overlooked, len(overlooked)),
        ("overlap by edges alone, which the engine rounds", edges, len(edges)),
    )
    if meetings.rigid:
        parts.append(f"{meetings.rigid} are parts of one rigid body and apart")
    parts += [f"{count} {what}: {_list(meetings, pairs, count)}" for what, pairs, count in separate if count]
    return "; ".join(parts)
