"""Pairs of shapes that joints decide: those of one tree, and of trees that stand where they are."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from simspec.dynamics.states import random_states
from simspec.proof.touch.geometry import Solid, transforms, wanted_depth
from simspec.proof.touch.place import POSES, easy
from simspec.proof.touch.scene import Pair, Scene, States
from simspec.proof.touch.search import Mechanism, Reach, nearest
from simspec.world.shapes import SHAPES, Round

LOOKS = 60_000
"""Most signed distances looked at in one plan, some 70 µs each."""
SEARCHED = 20_000
"""Most pairs that are looked at one by one."""
SAMPLES = 48
STARTS = 5
"""Seeded states in which all shapes are looked at, and in how many of them a search begins: for each pair those in which it is
nearest. The initial state comes before them."""
SHAKES = 12
"""Starts near an overlap, for pairs whose searches all ended in the same place: a detector that misses a pose of a box and a
cylinder misses those next to it as well (measured: 13 of 123 of one detector, 6 of them in two places)."""
SHAKE = 0.3
"""rad or m of the largest of these steps; others are a quarter and a ninth of it."""
DEEPER = (0.5, 3.0, 0.5, 2.0, 1.0)
"""Of the usual depth, in turn, that is then aimed at."""
SHAKING_SEED = 20_213
UNLIKE = 0.03
"""Two poses of one shape against another are different from this angle (rad) on, or share of the smaller one's inner radius."""


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
        self._alike: list[tuple[Pair, np.ndarray, list[np.ndarray]]] = []
        """Pairs of which too few different overlaps were found, one of their states, and the poses of those that were."""

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
        generator = np.random.default_rng(SHAKING_SEED)
        for pair, q, placed in self._alike:
            self._shake(states, pair, q, placed, generator)

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
        count, first, placed = 0, None, list[np.ndarray]()
        for start in starts:
            q = self._overlap(mechanism, mechanism.ours(start), solid, other, names)
            if q is None:
                continue
            self._keep(states, mechanism, trees, pair, q)
            count += 1
            first = q if first is None else first
            pose = mechanism.relative(q, solid, other, names)
            if all(_unlike(pose, known, solid, other) for known in placed):
                placed.append(pose)
            if count == wanted:
                break
        if first is not None and len(placed) < wanted:
            self._alike.append((pair, first, placed))
        return count > 0

    def _overlap(
        self,
        mechanism: Mechanism,
        start: np.ndarray,
        solid: Solid,
        other: Solid,
        names: tuple[str, str],
        deeper_by: float = 1.0,
    ) -> np.ndarray | None:
        """A state of Pinocchio's near ``start`` in which two shapes overlap clearly; None where none is found."""
        _, q, looks = mechanism.descend(start, solid, other, names, deeper_by)
        self._looks -= looks
        deep = -mechanism.between(q, solid, other, names).distance
        return q if mechanism.holds(q) and deep >= wanted_depth(solid, other)[1] else None

    def _shake(
        self, states: States, pair: Pair, q: np.ndarray, placed: list[np.ndarray], generator: np.random.Generator
    ) -> None:
        """Search around an overlap for ones in other poses, until there are ``POSES``."""
        scene = self._scene
        solid, other = (scene.solids[number] for number in pair)
        names = (scene.names[pair[0]], scene.names[pair[1]])
        trees = tuple(sorted({scene.tree[pair[0]], scene.tree[pair[1]]}))
        mechanism = self._mechanism(trees)
        for shake in range(SHAKES):
            if len(placed) >= POSES or self._looks <= 0:
                return
            start = mechanism.shaken(q, SHAKE / (1 + shake % 3) ** 2, generator)
            near = self._overlap(mechanism, start, solid, other, names, DEEPER[shake % len(DEEPER)])
            if near is None:
                continue
            pose = mechanism.relative(near, solid, other, names)
            if all(_unlike(pose, known, solid, other) for known in placed):
                placed.append(pose)
                self._keep(states, mechanism, trees, pair, near)

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


def _unlike(pose: np.ndarray, known: np.ndarray, solid: Solid, other: Solid) -> bool:
    """Whether two poses (4, 4) of the second of two shapes in the first one's frame are different, but for turns that change
    nothing of one of them."""
    ways = ((pose, known, other), (np.linalg.inv(pose), np.linalg.inv(known), solid))
    return all(_differ(one, two, moved, UNLIKE * min(solid.inner, other.inner)) for one, two, moved in ways)


def _differ(pose: np.ndarray, known: np.ndarray, moved: Solid, far: float) -> bool:
    kind = SHAPES[moved.shape.kind]
    away = float(np.linalg.norm(pose[:3, 3] - known[:3, 3]))
    axes = slice(0 if kind.round is Round.NONE else 2, 3 if kind.round is not Round.EVERY else 0)
    # ‖R − S‖ of two rotations is 2 √2 |sin(angle/2)|
    turned = float(np.linalg.norm(pose[:3, axes] - known[:3, axes]))
    return turned > UNLIKE or away > far
