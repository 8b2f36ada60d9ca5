"""States in which every pair of solid shapes overlaps that can be brought together, as far as a bound of effort goes."""

from __future__ import annotations

import functools
import itertools
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.proof.touch.geometry import Solid, gap, overlap
from simspec.proof.touch.mechanisms import JointPairs
from simspec.proof.touch.scene import POSES, SEVERAL, Overlaps, Pair, Rounds, Scene, States, easy, frame_at
from simspec.world.canonical import derived
from simspec.world.kinematics import trees
from simspec.world.types import World

# Pairs of shapes that one free tree decides: its root is put where the two overlap.

STATES = 400
"""Most states in which free trees are brought to others: each costs an engine one collision detection of the whole world."""
EFFORT = 100_000
"""Most bodies times such states: what setting them costs an engine."""
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

    def bring_together(self, states: States) -> None:
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
        """Every pair of bodies that the world names, and every shape with one of each class of others: what an engine's mask
        can tell apart is the group, the material, and whether something moves."""
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
        """All pairs, by how far apart they stand in the list: neighbours first."""
        count = len(self._scene.solids)
        for step in range(1, count):
            for i in range(count - step):
                if self._scene.placeable(i, i + step):
                    yield i, i + step

    # --- where ----------------------------------------------------------------------------------------------------

    def _write(self, states: States) -> None:
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
        self, mover: Solid, host: Solid, frame: np.ndarray | None, place: int, pose: int
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

    def _place(self, solid: Solid, frame: np.ndarray | None) -> np.ndarray:
        in_root = self._scene.in_root[solid.number]
        place: np.ndarray = in_root if frame is None else frame @ in_root
        return place

    def _alone(self, mover: Solid, root: np.ndarray, host: Solid, frame: np.ndarray | None) -> bool:
        """Whether no other shapes of the same bodies and materials overlap."""
        parts = self._scene.parts
        return all(
            (solid is mover and other is host)
            or gap(solid, self._place(solid, root), other, self._place(other, frame)).distance > 0.0
            for solid, other in itertools.product(parts[mover.part], parts[host.part])
        )


def _base(first: Solid, other: Solid) -> Solid:
    """The shape on whose surface the other one is put: a plane, or the larger."""
    return max(first, other, key=lambda solid: (solid.outer, -solid.number))


@dataclass(frozen=True)
class Meetings:
    """What an engine is asked, and what of it.

    q        states (k, nq)
    tried    (n, 4): state, two shapes' numbers (the smaller first) that overlap clearly in it, and whether no other shapes of
             the same bodies and materials do
    rigid    how many pairs are parts of one rigid body and do not overlap
    apart    pairs that the joints cannot bring together, as far as was found
    untried  how many pairs were left out, since more states would have gone beyond the bounds of effort; ``left``: some of them
    """

    q: np.ndarray
    tried: np.ndarray
    solids: tuple[Solid, ...] = ()
    rigid: int = 0
    apart: tuple[Pair, ...] = ()
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
    """The oracle of a world, made once for all that a proof asks of it."""
    return Oracle(world)


def plan(world: World, oracle: Oracle) -> Meetings:
    """States that bring the pairs of solid shapes of ``world`` together."""
    scene, states = Scene(world, oracle), States()
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
        tuple(joints.apart),
        free.untried + joints.untried,
        (*free.left, *joints.left),
    )


def _as_built(scene: Scene, states: States) -> int:
    """One state in which nothing is brought together: what overlaps by its build alone must not touch.

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
