"""States in which every pair of solid shapes overlaps that can be brought together, as far as a bound of effort goes."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.proof.checks import Check
from simspec.proof.touch.geometry import CollisionSolid, gap, overlap, transforms
from simspec.proof.touch.mechanisms import JointPairs
from simspec.proof.touch.scene import POSES, SEVERAL, Overlaps, Pair, Rounds, Scene, TouchStates, easy, frame_at
from simspec.world.canonical import derived
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.frames import sorted_pair
from simspec.world.hull import rounded_core
from simspec.world.kinematics import trees
from simspec.world.types import World

# Pairs of shapes that one free tree decides: its root is put where the two overlap.

STATES = 400
"""Most states in which free trees are brought to others: each costs an engine one collision detection of the whole world."""
EFFORT = 100_000
"""Most bodies times such states: the cost of setting them in an engine."""
CROWD = 400
"""Most pairs brought together in one state."""
REFUSED = 50
"""After this many pairs per state that no state had room for, no others are looked at."""
ATTEMPTS = 6
"""Places tried to have two shapes overlap without others of their bodies."""

Visit = tuple[int, int, int, int]
"""One shape brought to another: numbers of the mover and of the host, the place on it, the pose."""


class FreePairs:
    """The pairs that free trees decide, and the states that bring them together.

    ``untried``: how many pairs were left out; ``left``: some of them.
    """

    def __init__(self, scene: Scene):
        self._scene = scene
        self._overlaps = Overlaps(scene.spacing)
        self._most = max(1, min(STATES, EFFORT // len(scene.world.bodies)))
        self._rounds = Rounds(self._most, CROWD)
        self._visits: dict[int, list[Visit]] = {}
        self.untried = 0
        self.left: list[Pair] = []

    def bring_together(self, states: TouchStates) -> None:
        """First the pairs that show every shape against every class of others and every pair the world names, then all others,
        then further poses of those that a detector may miss."""
        met: set[Pair] = set()
        refused: dict[Pair, None] = {}
        total = self._count()
        for pair in itertools.chain(self._needed(), self._all()):
            if len(met) >= total or len(refused) > REFUSED * self._most:
                break
            if pair in met or pair in refused:
                continue
            if self._bring(pair, 0):
                met.add(pair)
            else:
                refused[pair] = None
        self.untried = total - len(met)
        self.left = list(itertools.islice(refused, 100))
        for pose in range(1, POSES):
            for pair in sorted(met):
                if not easy(*(self._scene.solids[number] for number in pair)) and self._scene.may_touch(*pair):
                    self._bring(pair, pose)
        self._write(states)

    # --- which pairs, and when ------------------------------------------------------------------------------------

    def _bring(self, pair: Pair, pose: int) -> bool:
        """Put a pair into the first state that has room for it."""
        scene, options = self._scene, []
        for mover, host in (pair, pair[::-1]):
            if scene.free[scene.tree[mover]]:
                state = self._rounds.room(scene.tree[mover], scene.tree[host], host)
                if state is not None:
                    options.append((state, mover, host))
        if not options:
            return False
        state, mover, host = min(options)
        base = _base(scene.solids[mover], scene.solids[host])
        places = self._overlaps.places(base) if base.number == host else SEVERAL
        place = self._rounds.put(state, scene.tree[mover], scene.tree[host], host, places)
        self._visits.setdefault(state, []).append((mover, host, place, pose))
        return True

    def _count(self) -> int:
        """How many pairs of shapes there are of which one is in a free tree without the other."""
        scene = self._scene
        per_tree = Counter(scene.tree)
        fixed = sum(count for tree, count in per_tree.items() if not scene.free[tree])
        free = [count for tree, count in per_tree.items() if scene.free[tree]]
        total = math.comb(len(scene.solids), 2) - math.comb(fixed, 2)
        return total - sum(math.comb(count, 2) for count in free)

    def _needed(self) -> Iterator[Pair]:
        """Every pair of bodies that the world names, and every shape with one of each class of others: an engine's mask
        distinguishes the group, the material, and whether something moves."""
        scene = self._scene
        by_body: dict[str, list[int]] = {}
        for number, name in enumerate(scene.names):
            by_body.setdefault(name, []).append(number)
        for first, other in scene.world.contact.excluded_bodies:
            for i, j in itertools.product(by_body.get(first, ()), by_body.get(other, ())):
                if scene.placeable(i, j):
                    yield min(i, j), max(i, j)
        named = {name for pair in scene.world.contact.ignored_groups for name in pair}
        classes: dict[tuple[object, ...], list[int]] = {}
        for solid in scene.solids:
            group = scene.world.bodies[solid.body].collision_group
            key = (group if group in named else "", solid.shape.material, scene.group[solid.number] == "world")
            classes.setdefault(key, []).append(solid.number)
        for members in classes.values():
            for i in range(len(scene.solids)):
                others = (members[(i + 1 + step) % len(members)] for step in range(len(members)))
                partner = next((j for j in itertools.islice(others, 64) if i != j and scene.placeable(i, j)), None)
                if partner is not None:
                    yield min(i, partner), max(i, partner)

    def _all(self) -> Iterator[Pair]:
        """All pairs, by their distance in the list: neighbours first."""
        count = len(self._scene.solids)
        for step in range(1, count):
            for i in range(count - step):
                if self._scene.placeable(i, i + step):
                    yield i, i + step

    # --- where ----------------------------------------------------------------------------------------------------

    def _write(self, states: TouchStates) -> None:
        """Make the states; a pair without a clear overlap after all is left untried."""
        scene = self._scene
        for number in sorted(self._visits):
            q, along = scene.parked.copy(), 0.0
            hosts: dict[int, np.ndarray] = {}
            state = states.add(q)
            for mover, host, place, pose in self._visits[number]:
                tree = scene.tree[host]
                if scene.free[tree] and tree not in hosts:
                    along += scene.extent[tree] + scene.spacing
                    hosts[tree] = frame_at(along, scene.far, scene.far)
                    scene.put_root(q, tree, hosts[tree])
                    along += scene.extent[tree] + scene.spacing
                root, alone = self._meet(scene.solids[mover], scene.solids[host], hosts.get(tree), place, pose)
                key = (min(mover, host), max(mover, host))
                if root is not None:
                    scene.put_root(q, scene.tree[mover], root)
                    states.tried.append((state, *key, alone))
                elif pose == 0:
                    self.untried += 1
                    self.left.append(key)

    def _meet(
        self, mover: CollisionSolid, host: CollisionSolid, frame: np.ndarray | None, place: int, pose: int
    ) -> tuple[np.ndarray | None, bool]:
        """Where to put the mover's root frame (4, 4) so that its shape overlaps the host's, whose root's frame is ``frame``
        (None: where it stands), by itself if there is such a place; and whether it is by itself."""
        scene = self._scene
        there = self._place(host, frame)
        base = _base(mover, host)
        several = len(scene.parts[mover.part]) * len(scene.parts[host.part]) > 1
        first = None
        for attempt in range(ATTEMPTS if several else 1):
            relative = self._overlaps.relative(base, mover if base is host else host, place + attempt, pose)
            if relative is None:
                continue
            at = there @ (relative if base is host else np.linalg.inv(relative))
            root = at @ scene.from_shape[mover.number]
            if not several or self._alone(mover, root, host, frame):
                return root, True
            first = root if first is None else first
        return first, False

    def _place(self, solid: CollisionSolid, frame: np.ndarray | None) -> np.ndarray:
        in_root = self._scene.in_root[solid.number]
        place: np.ndarray = in_root if frame is None else frame @ in_root
        return place

    def _alone(self, mover: CollisionSolid, root: np.ndarray, host: CollisionSolid, frame: np.ndarray | None) -> bool:
        """Whether no other shapes of the same bodies and materials overlap."""
        parts = self._scene.parts
        return all(
            (solid is mover and other is host)
            or gap(solid, self._place(solid, root), other, self._place(other, frame)).distance > 0.0
            for solid, other in itertools.product(parts[mover.part], parts[host.part])
        )


def _base(first: CollisionSolid, other: CollisionSolid) -> CollisionSolid:
    """The shape on whose surface the other one is put: a plane, or the larger."""
    return max(first, other, key=lambda solid: (solid.outer, -solid.number))


@dataclass(frozen=True)
class Meetings:
    """States in which an engine's collision detection is queried, and the pairs that overlap in them.

    q        states (k, nq)
    tried    (n, 4): state, two shapes' numbers (the smaller first) that overlap clearly in it, and whether no other shapes of
             the same bodies and materials do
    rigid    how many pairs are parts of one rigid body and do not overlap
    separate pairs that the joints cannot bring together, as far as was found
    untried  how many pairs were left out, since more states would have gone beyond the bounds of effort; ``left``: some of them
    """

    q: np.ndarray
    tried: np.ndarray
    solids: tuple[CollisionSolid, ...] = ()
    rigid: int = 0
    separate: tuple[Pair, ...] = ()
    untried: int = 0
    left: tuple[Pair, ...] = ()

    @property
    def pairs(self) -> int:
        """How many pairs of solid shapes of two bodies there are."""
        per_body = Counter(solid.body for solid in self.solids)
        return math.comb(len(self.solids), 2) - sum(math.comb(count, 2) for count in per_body.values())


def nothing(oracle: Oracle) -> Meetings:
    """No states at all."""
    return Meetings(np.zeros((0, oracle.nq)), np.zeros((0, 4), np.int64))


@functools.lru_cache(maxsize=8)
def nothing_to_try(world: World) -> str:
    """Why no two solid shapes of a world can be brought together; "" where some can."""
    solid = [body for body in world.bodies if any(shape.collision for shape in body.shapes)]
    if len(solid) < 2:
        return "there are no two bodies with collision shapes"
    carrying = {root: bodies[0].joint.kind for root, bodies in trees(world).items() if any(b in solid for b in bodies)}
    if len(carrying) > 1 and "free" in carrying.values():
        return ""
    planned = meetings_of(world)
    return (
        "" if len(planned.tried) else f"the joints bring no two of {planned.pairs} pairs of collision shapes together"
    )


@derived
def meetings_of(world: World) -> Meetings:
    """The plan of a world, made once: a proof probes engines with it, and says by it what a world does not have. Its arrays are
    shared: they are not to be changed."""
    return plan(world, oracle_of(world))


@derived
def oracle_of(world: World) -> Oracle:
    """The oracle of a world, made once for all uses in a proof."""
    return Oracle(world)


def plan(world: World, oracle: Oracle) -> Meetings:
    """States that bring the pairs of solid shapes of ``world`` together."""
    scene, states = Scene(world, oracle), TouchStates()
    if len(scene.solids) < 2:
        return Meetings(np.zeros((0, oracle.nq)), np.zeros((0, 4), np.int64), scene.solids)
    rigid = _as_built(scene, states)
    free, joints = FreePairs(scene), JointPairs(scene)
    free.bring_together(states)
    joints.bring_together(states)
    return Meetings(
        np.array(states.q).reshape(len(states.q), oracle.nq),
        np.array(states.tried, dtype=np.int64).reshape(-1, 4),
        scene.solids,
        rigid,
        tuple(joints.separate),
        free.untried + joints.untried,
        (*free.left, *joints.left),
    )


def _as_built(scene: Scene, states: TouchStates) -> int:
    """One state in which nothing is brought together: shapes that overlap by construction must not touch.

    Returns how many pairs of one rigid body do not overlap.
    """
    state = states.add(scene.parked)
    members: dict[str, list[int]] = {}
    for number, group in enumerate(scene.group):
        members.setdefault(group, []).append(number)
    outer = np.array([solid.outer for solid in scene.solids])
    body = np.array([solid.body for solid in scene.solids])
    centres = scene.at[:, :3, 3]
    separate = 0
    for numbers in members.values():
        indices = np.array(numbers)
        for place, i in enumerate(numbers[:-1]):
            others = indices[place + 1 :]
            others = others[body[others] != body[i]]
            near = others[np.linalg.norm(centres[others] - centres[i], axis=1) < outer[others] + outer[i]]
            met = [j for j in near.tolist() if overlap(scene.solids[i], scene.at[i], scene.solids[j], scene.at[j])]
            states.tried.extend((state, i, j, True) for j in met)
            separate += len(others) - len(met)
    return separate


# The engine's reports on the states in which shapes were brought together, compared with the world's rules.

MATRIX = "collision matrix"
SEEN = 9
"""Pairs of two kinds of shapes that an engine must report for each one that it overlooks: an error of a filter that leaves out
many is an error."""
SEEN_OF_ROUNDED = 0.05
"""Share of the radii by which rounded shapes must overlap: engines are exact to a tenth of that."""
NAMED = 6
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
    that it never reports is named, and is no error of its filter while it reports ``SEEN`` times as many others of these kinds.
    ``rounding``: of the shapes (body, name) whose edges the engine rounds the radius (m); a pair that it never reports is
    named, and is no error, where only the rounded edges overlap. ``units``: the shapes that the engine distinguishes, each a
    body's index and the names of its shapes it may be; ``touching`` (n, 3): state and two units that touch in it.
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
    detail = _summary(
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

    def radius(solid: CollisionSolid) -> float:
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


def _core(solid: CollisionSolid, radius: float) -> CollisionSolid:
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
    text = ", ".join(" – ".join(_names(meetings, pair)) for pair in pairs[:NAMED])
    more = count - min(len(pairs), NAMED)
    return f"{text} and {more} more" if text and more else text or f"{more} pairs"


def _summary(
    meetings: Meetings, unclear: Sequence[Pair], overlooked: Sequence[Pair], edges: Sequence[Pair], touching: int
) -> str:
    """The pairs that were tried and those that were not, by name and number."""
    tried = len({(i, j) for _, i, j, _ in meetings.tried.tolist()})
    parts: list[str] = [f"{touching} pairs of shapes touch, {tried - touching} do not"]
    separate: Iterable[tuple[str, Sequence[Pair], int]] = (
        ("the joints cannot bring together", meetings.separate, len(meetings.separate)),
        ("not tried, as they are too many", meetings.left, meetings.untried),
        ("reported only together with other shapes of the same bodies", unclear, len(unclear)),
        ("overlooked, of kinds of shapes of which the engine misses some overlaps", overlooked, len(overlooked)),
        ("overlap by edges alone, which the engine rounds", edges, len(edges)),
    )
    if meetings.rigid:
        parts.append(f"{meetings.rigid} are in one rigid body and separate")
    parts += [f"{count} {what}: {_list(meetings, pairs, count)}" for what, pairs, count in separate if count]
    return "; ".join(parts)
