"""Pairs of shapes that joints decide: those of one tree, and of trees that stand where they are."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from simspec.dynamics.states import random_states
from simspec.proof.touch.geometry import transforms, wanted_depth
from simspec.proof.touch.place import POSES, easy
from simspec.proof.touch.scene import Pair, Scene, States
from simspec.proof.touch.search import Mechanism, Reach, nearest

LOOKS = 60_000
"""Most signed distances looked at in one plan, some 70 µs each."""
SEARCHED = 20_000
"""Most pairs that are looked at one by one."""
SAMPLES = 48
STARTS = 5
"""Seeded states in which all shapes are looked at, and in how many of them a search begins: for each pair those in which it is
nearest. The initial state comes before them."""


class JointPairs:
    """The pairs that joints decide, and the states that bring them together.

    ``apart``: pairs that no state was found for; ``untried``: how many were left out; ``left``: some of them.
    """

    def __init__(self, scene: Scene):
        self._scene = scene
        self._mechanisms: dict[tuple[int, ...], Mechanism] = {}
        self._looks = LOOKS
        self._taken: dict[int, int] = {}
        self._made: list[int] = []
        self.apart: list[Pair] = []
        self.untried = 0
        self.left: list[Pair] = []

    def bring_together(self, states: States) -> None:
        """Search for a state of each pair, for several where a detector may miss one: named pairs first, then what seeded
        states bring nearest."""
        scene = self._scene
        pairs = sorted(
            self._all(), key=lambda pair: (not scene.named(*pair), scene.tree[pair[0]] != scene.tree[pair[1]])
        )
        self.left = pairs[SEARCHED : SEARCHED + 100]
        self.untried = max(0, len(pairs) - SEARCHED)
        pairs = pairs[:SEARCHED]
        if not pairs:
            return
        reach = Reach(scene.world, scene.poses)
        pairs_left = []
        for pair in pairs:
            (solid, at), (other, other_at) = ((scene.solids[k], scene.at[k][:3, 3]) for k in pair)
            if (solid.endless and other.endless) or reach.apart(solid, at, other, other_at):
                self.apart.append(pair)
            else:
                pairs_left.append(pair)
        if not pairs_left:
            return
        samples = random_states(scene.world, SAMPLES)[0]
        poses = [scene.solid_poses(transforms(scene.oracle.body_poses(q))) for q in samples]
        solids = scene.solids
        starts, least = nearest(poses, [solids[i] for i, _ in pairs_left], [solids[j] for _, j in pairs_left], STARTS)
        ranks = [
            (not scene.named(*pair), gap > 0.0, gap, number)
            for number, (pair, gap) in enumerate(zip(pairs_left, least.tolist(), strict=True))
        ]
        for *_, number in sorted(ranks):
            pair, order = pairs_left[number], starts[number]
            if self._looks <= 0:
                self.untried += 1
                self.left.append(pair)
            elif not self._search(states, pair, [scene.q, *samples[order]]):
                self.apart.append(pair)

    def _all(self) -> Iterator[Pair]:
        """Pairs of one free tree, and of all trees that are not free; not those of one rigid body."""
        scene = self._scene
        pools: dict[int, list[int]] = {}
        for number, tree in enumerate(scene.tree):
            pools.setdefault(tree if scene.free[tree] else -1, []).append(number)
        for numbers in pools.values():
            for i, j in itertools.combinations(numbers, 2):
                if scene.group[i] != scene.group[j]:
                    yield i, j

    def _search(self, states: States, pair: Pair, starts: list[np.ndarray]) -> bool:
        """Descend from every start until there are states enough; whether there is one."""
        scene = self._scene
        solid, other = (scene.solids[number] for number in pair)
        names = (scene.names[pair[0]], scene.names[pair[1]])
        trees = tuple(sorted({scene.tree[pair[0]], scene.tree[pair[1]]}))
        mechanism = self._mechanism(trees)
        wanted = POSES if scene.may_touch(*pair) and not easy(solid, other) else 1
        count = 0
        for start in starts:
            _, q, looks = mechanism.descend(mechanism.ours(start), solid, other, names)
            self._looks -= looks
            deep = -mechanism.between(q, solid, other, names).distance
            if not mechanism.holds(q) or deep < wanted_depth(solid, other)[1]:
                continue
            self._keep(states, mechanism, trees, pair, q)
            count += 1
            if count == wanted:
                break
        return count > 0

    def _mechanism(self, trees: tuple[int, ...]) -> Mechanism:
        if trees not in self._mechanisms:
            scene = self._scene
            self._mechanisms[trees] = Mechanism(scene.world, [scene.roots[tree] for tree in trees])
        return self._mechanisms[trees]

    def _keep(self, states: States, mechanism: Mechanism, trees: tuple[int, ...], pair: Pair, q: np.ndarray) -> None:
        """Write a found state into the first one in which these trees have nothing to do yet."""
        scene = self._scene
        taken = 0
        for tree in trees:
            taken |= self._taken.get(tree, 0)
        at = ((taken + 1) & ~taken).bit_length() - 1
        for tree in trees:
            self._taken[tree] = self._taken.get(tree, 0) | 1 << at
        if at == len(self._made):
            self._made.append(states.add(scene.parked.copy()))
        state = self._made[at]
        mechanism.write(q, states.q[state])
        for tree in trees:
            if scene.free[tree]:
                scene.put_root(states.q[state], tree, scene.parking[tree])
        states.tried.append((state, *pair, self._alone(mechanism, pair, q)))

    def _alone(self, mechanism: Mechanism, pair: Pair, q: np.ndarray) -> bool:
        """Whether no other shapes of the same bodies and materials overlap."""
        scene = self._scene
        solid, other = (scene.solids[number] for number in pair)
        return all(
            (a is solid and b is other)
            or mechanism.between(q, a, b, (scene.names[a.number], scene.names[b.number])).distance > 0.0
            for a, b in itertools.product(scene.parts[solid.part], scene.parts[other.part])
        )
