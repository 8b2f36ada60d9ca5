"""Self-collision within the ranges of the joints: positions are sampled, places of all bodies computed at once for all of
them, and pairs of shapes compared along directions that prove them separate.

Two convex shapes overlap along a unit vector n by h₁(n) + h₂(−n) − d·n (``world/overlap.py``); every direction gives an upper
bound of the depth, and a direction along which it is small proves that they do not overlap. First each joint is moved alone
from the initial positions, then all at random (a fixed seed). The work is counted, not timed, so that the same model gives the
same findings on every machine.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.plausibility.findings import Grade, PlausibilityFinding, Sampling
from simspec.plausibility.parts import DIRECTIONS, Floats, Lump, carrying, lumps_of
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import rigid_groups, trees
from simspec.world.overlap import SPREAD
from simspec.world.rotations import exponential, matrices
from simspec.world.types import Body, FollowConstraint, Joint, World

ALONE: Final = 16
"""Positions of each joint that is moved alone: both limits and between them."""
RANDOM: Final = 256
"""Positions at which all joints are at random within their ranges."""
BLOCK: Final = 32
"""Positions that are looked at in one go."""
SEED: Final = 35
WORK: Final = 60_000_000
"""Products of a direction and a vertex that are computed at most: about a second of processor time."""
EACH: Final = 24
"""The cost of a direction for a shape without vertices, in products."""
LEAST_DEPTH: Final = 1e-3
"""m from which bodies count as overlapping."""
SHARE: Final = 0.05
"""The same as a share of the smaller inner radius."""
DEEPER: Final = 0.1
"""Share of a body's size by which it may go deeper into what carries it than it is initially."""
ROUNDS: Final = 6
"""Rounds of search around the best direction, in all spread directions, each in 0.6 of the reach of the last: from 14° to 1.1°.
Fewer directions, or a faster decrease, miss the best one: an overlap of 16 mm was found where there was a gap."""
MOST_BODIES: Final = 200
"""Bodies of one model that are moved; a larger one is left out."""


@dataclass
class PositionSamples:
    """Joint positions of one tree: ``values`` by joint (n,), for ball joints rotation matrices (n, 3, 3); ``moved``: the joint
    that is moved alone, for each position, "" where it is the initial one or all are."""

    values: dict[str, Floats]
    moved: list[str]

    def __len__(self) -> int:
        return len(self.moved)

    def part(self, start: int, end: int) -> PositionSamples:
        """Some of them."""
        return PositionSamples({name: value[start:end] for name, value in self.values.items()}, self.moved[start:end])


@dataclass
class Met:
    """A pair of bodies that overlap somewhere: the greatest ``depth`` (m) and its ``severity``, there the joint positions, and
    which joint alone leads there; ``alone``: the deepest of positions where one joint is moved."""

    depth: float = 0.0
    severity: float = 0.0
    positions: dict[str, float] = field(default_factory=dict)
    moved: str = ""
    count: int = 0


def sweep(world: World) -> tuple[list[PlausibilityFinding], Sampling]:
    """Findings of all trees, and how they were searched."""
    findings: list[PlausibilityFinding] = []
    left_out: dict[str, str] = {}
    looked, planned, joints, cut = 0, 0, 0, ""
    budget = WORK
    looped = _looped(world)
    for root, bodies in trees(world).items():
        movable = [body.joint for body in bodies if body.joint.kind in (*SCALAR_JOINTS, "ball")]
        if not movable:
            continue
        if len(bodies) > MOST_BODIES:
            left_out[root] = f"a model of {len(bodies)} bodies; up to {MOST_BODIES} are moved"
            continue
        leaders = _followers(world, bodies)
        ranges: dict[str, tuple[float, float]] = {}
        for joint in movable:
            if joint.name in looped:
                left_out[joint.name] = "a loop of bodies is closed beyond it"
            elif joint.name in leaders or joint.kind == "ball":
                continue
            elif (span := range_of(joint)) is None:
                left_out[joint.name] = "a slide without limits"
            elif span[1] > span[0]:
                ranges[joint.name] = span
        balls = [joint for joint in movable if joint.kind == "ball" and joint.name not in looped]
        if not ranges and not balls:
            continue
        joints += len(ranges) + len(balls)
        tree = SweptTree(world, bodies, leaders)
        samples = positions(movable, ranges, balls, leaders)
        planned += len(samples)
        done = tree.look(samples, budget)
        budget -= tree.work
        looked += done
        if done < len(samples):
            cut = "the work of comparing shapes reached its bound"
        findings += tree.findings(samples, done)
    return findings, Sampling(looked, planned, joints, left_out, cut)


def range_of(joint: Joint) -> tuple[float, float] | None:
    """The range (rad, m) of a hinge or a slide: its limits; of a hinge without, or with more than a turn, one turn. None: a
    slide that has no end."""
    limits = joint.position_limits
    start = joint.position[0]
    if joint.kind == "hinge":
        if limits is None or limits[1] - limits[0] > 2.0 * math.pi:
            return (start - math.pi, start + math.pi)
        return limits
    return limits


def positions(
    movable: Sequence[Joint],
    ranges: Mapping[str, tuple[float, float]],
    balls: Sequence[Joint],
    leaders: Mapping[str, FollowConstraint],
) -> PositionSamples:
    """The positions that are looked at: the initial one, each joint alone, then all at random."""
    count = 1 + ALONE * len(ranges) + RANDOM
    random = np.random.default_rng(SEED)
    values: dict[str, Floats] = {}
    moved = ["", *(name for name in ranges for _ in range(ALONE)), *([""] * RANDOM)]
    begin = 1
    for joint in movable:
        if joint.kind == "ball":
            turn = np.repeat(matrices(np.array(joint.position))[None], count, axis=0)
            if joint in balls:
                axis = random.standard_normal((RANDOM, 3))
                axis /= np.linalg.norm(axis, axis=1, keepdims=True)
                most = math.pi if joint.angle_limit is None else joint.angle_limit
                angle = most * np.cbrt(random.random((RANDOM, 1)))
                turn[-RANDOM:] = matrices(exponential(axis * angle))
            values[joint.name] = turn
            continue
        value = np.full(count, joint.position[0])
        if joint.name in ranges:
            low, high = ranges[joint.name]
            value[begin : begin + ALONE] = np.linspace(low, high, ALONE)
            value[-RANDOM:] = random.uniform(low, high, RANDOM)
            begin += ALONE
        values[joint.name] = value
    for name, follow in leaders.items():
        if follow.leader in values:
            values[name] = follow.ratio * values[follow.leader] + follow.offset
    return PositionSamples(values, moved)


def _followers(world: World, bodies: Sequence[Body]) -> dict[str, FollowConstraint]:
    """The couplings of a tree's joints by the joint that follows, each after that of its leader."""
    names = {body.joint.name for body in bodies}
    left = {
        constraint.joint: constraint
        for constraint in world.constraints
        if isinstance(constraint, FollowConstraint) and constraint.joint in names
    }
    found: dict[str, FollowConstraint] = {}
    while left:
        ready = [name for name, follow in left.items() if follow.leader not in left]
        if not ready:
            return found  # joints that follow each other: resolving refuses them
        for name in ready:
            found[name] = left.pop(name)
    return found


def _looped(world: World) -> frozenset[str]:
    """The joints between bodies that a constraint joins otherwise: their positions depend on each other."""
    parent = {body.name: body.joint.parent for body in world.bodies}
    joint = {body.name: body.joint.name for body in world.bodies}

    def above(name: str | None) -> list[str]:
        chain = []
        while name is not None:
            chain.append(name)
            name = parent[name]
        return chain

    looped: set[str] = set()
    for constraint in world.constraints:
        if not isinstance(constraint, FollowConstraint):
            looped |= {joint[name] for name in set(above(constraint.first)) ^ set(above(constraint.second))}
    return frozenset(looped)


class SweptTree:
    """One tree of bodies at many joint positions. ``work``: products computed so far."""

    def __init__(self, world: World, bodies: Sequence[Body], leaders: Mapping[str, FollowConstraint]):
        self.bodies = bodies
        self.work: int = 0
        self._leaders = leaders
        groups = rigid_groups(world)
        allowed = CollisionFilter(world)
        self._materials = allowed.may_materials_touch
        self._joint = {body.name: body.joint for body in bodies}
        self._solids: dict[str, list[Lump]] = {}
        for body in bodies:
            if kept := [lump for lump in lumps_of(world)[body.name] if lump.shape.collision]:
                self._solids[body.name] = kept
        self._neighbours = self._adjacent(world, groups)
        names = list(self._solids)
        self._pairs = [
            pair for pair in itertools.combinations(names, 2) if pair in self._neighbours or allowed.may_touch(*pair)
        ]
        self._compared: set[tuple[str, str]] = set()
        self._met: dict[tuple[str, str], Met] = {}
        self._initial: dict[tuple[str, str, int, int], float] = {}

    def _adjacent(self, world: World, groups: Mapping[str, str]) -> set[tuple[str, str]]:
        """Pairs of bodies with collision shapes of which one carries the other by one joint."""
        order = {name: index for index, name in enumerate(self._solids)}
        by_group: dict[str, list[str]] = {}
        for name in self._solids:
            by_group.setdefault(groups[name], []).append(name)
        pairs = set()
        for child, carrier in carrying(world).items():
            for entry in by_group.get(child, []):
                for other in by_group.get(carrier, []):
                    pairs.add((entry, other) if order[entry] < order[other] else (other, entry))
        return pairs

    def places(self, samples: PositionSamples) -> tuple[dict[str, Floats], dict[str, Floats]]:
        """Origins (n, 3) and rotations (n, 3, 3) of all bodies, in the frame of the tree's root."""
        count = len(samples)
        origin: dict[str, Floats] = {}
        turn: dict[str, Floats] = {}
        for body in self.bodies:
            joint = body.joint
            if joint.parent is None:
                at, by = np.zeros((count, 3)), np.repeat(np.eye(3)[None], count, axis=0)
                if joint.kind in ("free", "fixed"):
                    origin[body.name], turn[body.name] = at, by
                    continue
            else:
                at, by = origin[joint.parent], turn[joint.parent]
            at = at + by @ np.array(joint.origin.position)
            by = by @ matrices(np.array(joint.origin.quaternion))
            if joint.kind == "hinge":
                by = by @ _about(np.array(joint.axis), samples.values[joint.name])
            elif joint.kind == "slide":
                at = at + (by @ np.array(joint.axis)) * samples.values[joint.name][:, None]
            elif joint.kind == "ball":
                by = by @ samples.values[joint.name]
            origin[body.name], turn[body.name] = at, by
        return origin, turn

    def look(self, samples: PositionSamples, budget: int) -> int:
        """Compare all pairs at the positions in their order, in blocks, until the work is done or ``budget`` products are
        spent; gives the number of positions that were looked at."""
        starts: list[int] = [0, *range(1, len(samples), BLOCK)]
        for start in starts:
            if self.work >= budget:
                return start
            block = samples.part(start, start + BLOCK if start else 1)
            origin, turn = self.places(block)
            for pair in self._pairs:
                rows = self._concerned(pair, block) if start else np.arange(1)
                if len(rows):
                    self._compare(pair, block, origin, turn, rows)
        return len(samples)

    def _concerned(self, pair: tuple[str, str], block: PositionSamples) -> np.ndarray:
        """The positions of a block at which two bodies are elsewhere against each other than initially; of neighbours, whose
        joint alone matters, those at which it is moved alone."""
        between = self._between(*pair)
        moving = {*between, *(self._leaders[name].leader for name in between if name in self._leaders)}
        if pair not in self._neighbours:
            moving.add("")  # all at random
        return np.array([row for row, joint in enumerate(block.moved) if joint in moving], int)

    def _compare(
        self,
        pair: tuple[str, str],
        block: PositionSamples,
        origin: Mapping[str, Floats],
        turn: Mapping[str, Floats],
        rows: np.ndarray,
    ) -> None:
        first, second = pair
        initial = pair not in self._compared
        self._compared.add(pair)
        # the second body in the frame of the first
        by = np.swapaxes(turn[first][rows], 1, 2)
        at = (by @ (origin[second] - origin[first])[rows, :, None])[:, :, 0]
        by = by @ turn[second][rows]
        near = pair in self._neighbours
        depths: Floats = np.zeros(len(rows))
        severities: Floats = np.zeros(len(rows))
        for i, lump in enumerate(self._solids[first]):
            for k, other in enumerate(self._solids[second]):
                if not near and not self._materials(lump.shape.material, other.shape.material):
                    continue
                centre = at + by @ other.centre - lump.centre
                close = np.flatnonzero(np.einsum("ni,ni->n", centre, centre) < (lump.outer + other.outer) ** 2)
                if not len(close):
                    continue
                smaller = min(lump.inner, other.inner)
                limit = 0.0 if initial else self._limit(pair, i, k, smaller, near)
                axes = np.swapaxes(by[close] @ other.axes.T, 1, 2)
                depth = self._depths(lump, other, centre[close], axes, limit)
                if initial:
                    self._initial[first, second, i, k] = float(depth[0])
                    continue
                over = depth / limit
                better = over > severities[close]
                severities[close] = np.where(better, over, severities[close])
                depths[close] = np.where(better, depth, depths[close])
        if initial:
            return
        found = np.flatnonzero(severities > 1.0)
        if len(found):
            met = self._met.setdefault(pair, Met())
            met.count += len(found)
            best = int(found[severities[found].argmax()])
            moved = block.moved[rows[best]]
            # one joint that is moved alone says more than all at random
            if severities[best] > met.severity and (moved or not met.moved):
                met.depth, met.severity, met.moved = float(depths[best]), float(severities[best]), moved
                met.positions = {
                    name: float(block.values[name][rows[best]])
                    for name in self._between(first, second)
                    if block.values[name].ndim == 1
                }

    def _limit(self, pair: tuple[str, str], i: int, k: int, smaller: float, near: bool) -> float:
        """The depth (m) from which two shapes count as overlapping; of those that overlap initially as much deeper."""
        start = self._initial.get((*pair, i, k), 0.0)
        if near:
            child = pair[1] if self._joint[pair[1]].parent == pair[0] else pair[0]
            size = max(2.0 * solid.outer for solid in self._solids[child])
            return max(start, 0.0) + DEEPER * size
        return max(start, 0.0) + max(LEAST_DEPTH, SHARE * smaller)

    def _between(self, first: str, second: str) -> list[str]:
        """The joints that move on the way between two bodies, followers left out."""
        parent = {body.name: body.joint.parent for body in self.bodies}
        chains = []
        for name in (first, second):
            chain = []
            above: str | None = name
            while above is not None:
                chain.append(above)
                above = parent[above]
            chains.append(chain)
        names = set(chains[0]) ^ set(chains[1])
        return [
            body.joint.name
            for body in self.bodies
            if body.name in names and body.joint.kind in (*SCALAR_JOINTS, "ball")
        ]

    def _depths(self, lump: Lump, other: Lump, centre: Floats, axes: Floats, limit: float) -> Floats:
        """Depths (n,) of two shapes, the second at ``centre`` (n, 3) with ``axes`` (n, 3, 3; rows) in the first body's axes;
        0 or less where they are proved not to be deeper than ``limit`` (m)."""
        count = len(centre)
        away = np.linalg.norm(centre, axis=1, keepdims=True)
        line = np.where(away > 0.0, centre / np.where(away > 0.0, away, 1.0), np.array([1.0, 0.0, 0.0]))
        local_axes = np.repeat(np.concatenate([lump.axes, -lump.axes])[None], count, axis=0)
        likely = np.concatenate([local_axes, axes, -axes, line[:, None]], axis=1)
        boxed, _ = self._along(lump, other, centre, axes, likely, boxed=True)
        depth, best = np.zeros(count), np.zeros((count, 3))
        left = np.flatnonzero(boxed > limit)
        if len(left):
            depth[left], best[left] = self._along(lump, other, centre[left], axes[left], likely[left])
            left = left[depth[left] > limit]
        if len(left):
            edges = np.cross(lump.axes[None, :, None], axes[left][:, None]).reshape(len(left), 9, 3)
            size = np.linalg.norm(edges, axis=2, keepdims=True)
            edges = np.where(size > 1e-6, edges / np.where(size > 1e-6, size, 1.0), np.array([1.0, 0.0, 0.0]))
            spread = np.repeat(DIRECTIONS[None], len(left), axis=0)
            tried = np.concatenate([edges, -edges, spread], axis=1)
            self._improve(lump, other, centre, axes, depth, best, left, tried)
            left = left[depth[left] > limit]
        if len(left):
            reach = 0.25
            for _ in range(ROUNDS):
                around = best[left][:, None] + reach * SPREAD
                around /= np.linalg.norm(around, axis=2, keepdims=True)
                self._improve(lump, other, centre, axes, depth, best, left, around)
                left = left[depth[left] > limit]
                reach *= 0.6
        return np.where(depth > limit, depth, 0.0)

    def _improve(
        self,
        lump: Lump,
        other: Lump,
        centre: Floats,
        axes: Floats,
        depth: Floats,
        best: Floats,
        rows: np.ndarray,
        tried: Floats,
    ) -> None:
        """Replace ``depth`` and ``best`` at ``rows`` where the directions that are tried give less."""
        less, along = self._along(lump, other, centre[rows], axes[rows], tried)
        better = less < depth[rows]
        depth[rows] = np.where(better, less, depth[rows])
        best[rows] = np.where(better[:, None], along, best[rows])

    def _along(
        self, lump: Lump, other: Lump, centre: Floats, axes: Floats, directions: Floats, boxed: bool = False
    ) -> tuple[Floats, Floats]:
        """The least overlap (n,) along some directions (n, k, 3), and the direction; of bounding boxes where ``boxed``."""
        count, many, _ = directions.shape
        here = directions.reshape(-1, 3)
        there = -(directions @ np.swapaxes(axes, 1, 2)).reshape(-1, 3)
        if boxed:
            reach = lump.boxed(here @ lump.axes.T) + other.boxed(there)
            self.work += 2 * EACH * len(here)
        else:
            reach = lump.reach(here) + other.local(there)
            self.work += len(here) * (_cost(lump) + _cost(other))
        overlap = reach.reshape(count, many) - np.einsum("nki,ni->nk", directions, centre)
        best = overlap.argmin(axis=1)
        rows = np.arange(count)
        return overlap[rows, best], directions[rows, best]

    def findings(self, samples: PositionSamples, looked: int) -> Iterator[PlausibilityFinding]:
        """The findings at the first ``looked`` positions."""
        for (first, second), met in self._met.items():
            near = (first, second) in self._neighbours
            rule = "pass-through" if near else "self-collision"
            where = _where(met, self._joint)
            moved = f"{met.moved} alone" if met.moved else "all joints at random"
            message = f"{1e3 * met.depth:.3g} mm deep at {where} ({moved}); {met.count} of {looked} positions"
            path = f"bodies.{second}.joint.limits"
            element = f"{first} and {second}"
            yield PlausibilityFinding(
                rule, Grade.NOTE, element, message, met.depth, "m", met.severity, path, None, met.positions
            )


def _where(met: Met, joints: Mapping[str, Joint]) -> str:
    """Joint positions in words: that of the joint that is moved alone, else up to three."""
    kinds = {joint.name: joint.kind for joint in joints.values()}
    names = [met.moved] if met.moved in met.positions else list(met.positions)
    shown = [
        f"{name} = {math.degrees(met.positions[name]):.0f}°"
        if kinds[name] == "hinge"
        else f"{name} = {1e3 * met.positions[name]:.3g} mm"
        for name in names[:3]
    ]
    return ", ".join(shown) + (", ..." if len(names) > 3 else "")


def _cost(solid: Lump) -> int:
    return EACH if solid.points is None else len(solid.points)


def _about(axis: Floats, angles: Floats) -> Floats:
    """Rotation matrices (n, 3, 3) about a unit axis by angles (n,) in rad, by Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    turns: Floats = np.eye(3) + sine * skew + (1.0 - cosine) * (skew @ skew)
    return turns
