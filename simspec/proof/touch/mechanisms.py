"""Pairs of shapes that joints decide: those of one tree, and of trees that stand where they are."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from simspec.dynamics.oracle import random_states
from simspec.dynamics.oracle_tree import OracleTree
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.proof.touch.geometry import CollisionSolid, ShapeGap, gap, transforms, wanted_depth
from simspec.proof.touch.scene import POSES, Pair, Scene, TouchStates, easy
from simspec.world.kinematics import layout_of, trees
from simspec.world.shapes import SHAPES, Round
from simspec.world.types import World

# Joint positions at which two shapes of mechanisms overlap, found by descent on their signed distance within the limits.

STEPS = 25
"""Steps of one descent; most overlaps are found in under ten."""
TURN = 0.7
"""The largest turn of a joint in one step (rad)."""
FLAT = 1e-9
"""Squared slope (m²/rad²) below which a distance does not fall any more."""
HALVINGS = 5


class Mechanism:
    """Some trees of the world as one Pinocchio model, and the distances of their shapes as functions of its coordinates."""

    def __init__(self, world: World, roots: Sequence[str]):
        known, places = (
            trees(world),
            dict(zip((b.name for b in world.bodies), layout_of(world).position, strict=True)),
        )
        bodies = tuple(body for root in roots for body in known[root])
        self.tree = OracleTree(dataclasses.replace(world, bodies=bodies))
        self._pin, self._model, self._data = self.tree.pin, self.tree.model, self.tree.data
        # where the coordinates of these trees' bodies stand in the world's q
        self._places = np.concatenate([np.zeros(0, int), *(np.r_[places[body.name]] for body in bodies)]).astype(int)
        names = [body.name for body in bodies]
        self._joint = dict(zip(names, self.tree.body_joint, strict=True))
        self._placement = {
            name: placement.homogeneous for name, placement in zip(names, self.tree.body_placement, strict=True)
        }
        self._columns = [
            np.concatenate(
                [
                    np.zeros(0, int),
                    *(
                        np.arange(self._model.idx_vs[k], self._model.idx_vs[k] + self._model.nvs[k])
                        for k in self._model.supports[joint]
                        if k
                    ),
                ]
            ).astype(int)
            for joint in range(self._model.njoints)
        ]
        self.low, self.high = np.full(self._model.nq, -math.inf), np.full(self._model.nq, math.inf)
        self._single: list[tuple[int, int]] = []  # places in q and v of hinges and slides
        self._turns = np.ones(self._model.nv, dtype=bool)
        for body, at, at_v in zip(bodies, self.tree.layout.position, self.tree.layout.velocity, strict=True):
            joint = body.joint
            if joint.kind in SCALAR_JOINTS:
                k, v = int(self.tree.q_index[at][0]), int(self.tree.v_index[at_v][0])
                self._single.append((k, v))
                self._turns[v] = joint.kind == "hinge"
                if joint.position_limits is not None:
                    self.low[k], self.high[k] = joint.position_limits

    def ours(self, q: np.ndarray) -> np.ndarray:
        """Pinocchio's coordinates of a state (nq,) of the world."""
        return self.tree.spread(q[self._places])[0]

    def write(self, q: np.ndarray, into: np.ndarray) -> None:
        """Write Pinocchio's coordinates ``q`` of these trees into a state (nq,) of the world."""
        into[self._places] = q[self.tree.q_index]

    def _pose(self, solid: CollisionSolid, name: str) -> np.ndarray:
        pose: np.ndarray = self._data.oMi[self._joint[name]].homogeneous @ self._placement[name] @ solid.pose
        return pose

    def between(self, q: np.ndarray, solid: CollisionSolid, other: CollisionSolid, names: tuple[str, str]) -> ShapeGap:
        """The gap of two shapes of the bodies ``names`` in a state of Pinocchio's."""
        self._pin.forwardKinematics(self._model, self._data, q)
        return gap(solid, self._pose(solid, names[0]), other, self._pose(other, names[1]))

    def relative(
        self, q: np.ndarray, solid: CollisionSolid, other: CollisionSolid, names: tuple[str, str]
    ) -> np.ndarray:
        """The pose (4, 4) of the second of two shapes in the first one's frame."""
        self._pin.forwardKinematics(self._model, self._data, q)
        pose: np.ndarray = np.linalg.inv(self._pose(solid, names[0])) @ self._pose(other, names[1])
        return pose

    def shaken(self, q: np.ndarray, extent: float, generator: np.random.Generator) -> np.ndarray:
        """A state within the limits that is off by up to ``extent`` (rad, m) in every direction in which joints move."""
        step = generator.uniform(-extent, extent, self._model.nv)
        return self._clipped(self._pin.integrate(self._model, q, step))

    def look(
        self, q: np.ndarray, solid: CollisionSolid, other: CollisionSolid, names: tuple[str, str]
    ) -> tuple[float, np.ndarray]:
        """The signed distance of two shapes, and its slope (nv,): the motion of a point of the second along the normal, less
        that of the first's."""
        self._pin.computeJointJacobians(self._model, self._data, q)
        between = gap(solid, self._pose(solid, names[0]), other, self._pose(other, names[1]))
        slope = np.zeros(self._model.nv)
        jacobian = np.reshape(self._data.J, (6, -1))  # of one coordinate Pinocchio gives a vector
        for name, point, sign in zip(names, (between.first, between.second), (-1.0, 1.0), strict=True):
            columns = self._columns[self._joint[name]]
            spin = jacobian[3:, columns]
            slope[columns] += sign * (between.normal @ jacobian[:3, columns] + _cross(point, between.normal) @ spin)
        return between.distance, slope

    def descend(
        self,
        q: np.ndarray,
        solid: CollisionSolid,
        other: CollisionSolid,
        names: tuple[str, str],
        deeper_by: float = 1.0,
    ) -> tuple[float, np.ndarray, int]:
        """From a state of Pinocchio's down to an overlap ``deeper_by`` times as deep as usual, or as far as distances fall:
        the distance, the state, and how often was looked."""
        wanted = deeper_by * wanted_depth(solid, other)[0]
        q = self._clipped(q)
        distance, slope = self.look(q, solid, other, names)
        looks = 1
        for _ in range(STEPS):
            if distance <= -wanted or not math.isfinite(distance):
                break
            free = self._inward(q, slope)
            steep = float(free @ free)
            if steep < FLAT:
                break
            step = free * (-(distance + 1.1 * wanted) / steep)
            widest = float(np.abs(step[self._turns]).max(initial=0.0))
            step *= min(1.0, TURN / widest) if widest else 1.0
            for _ in range(HALVINGS):
                trial = self._clipped(self._pin.integrate(self._model, q, step))
                deeper, trial_slope = self.look(trial, solid, other, names)
                looks += 1
                if deeper < distance:
                    break
                step = step / 2.0
            else:
                break
            fell, q, distance, slope = distance - deeper, trial, deeper, trial_slope
            if fell < 1e-4 * wanted:
                break
        return distance, q, looks

    def _clipped(self, q: np.ndarray) -> np.ndarray:
        clipped: np.ndarray = np.clip(q, self.low, self.high)
        return clipped

    def _inward(self, q: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """The slope without the joints that stand at a limit and would be driven beyond it."""
        free = slope.copy()
        for k, v in self._single:
            if (q[k] <= self.low[k] and slope[v] > 0.0) or (q[k] >= self.high[k] and slope[v] < 0.0):
                free[v] = 0.0
        return free

    def holds(self, q: np.ndarray) -> bool:
        """Whether a state is one within the limits."""
        return bool(np.isfinite(q).all() and (q >= self.low).all() and (q <= self.high).all())


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The cross product of two vectors (3,); numpy's takes ten times as long for one pair, half the time of a search."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


class MechanismReach:
    """Which shapes of mechanisms the lengths of their links separate at all joint positions."""

    def __init__(self, world: World, poses: np.ndarray):
        """``poses`` (bodies, 4, 4) in some state: hinges and balls stand where their bodies' frames are."""
        self._poses = poses
        index = {body.name: number for number, body in enumerate(world.bodies)}
        self._above: list[tuple[int, ...]] = []
        for body in world.bodies:
            above = self._above[index[body.joint.parent]] if body.joint.parent is not None else ()
            number = index[body.name]
            self._above.append((*above, number) if body.joint.kind != "fixed" else above)
        self._slides = {number for number, body in enumerate(world.bodies) if body.joint.kind == "slide"}

    def separate(self, solid: CollisionSolid, at: np.ndarray, other: CollisionSolid, other_at: np.ndarray) -> bool:
        """Whether the polygon from centre to centre over the hinges between can't close. Slides change lengths: False.
        ``at`` and ``other_at``: where the centres (3,) are in that state."""
        first, second = self._above[solid.body], self._above[other.body]
        shared = sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], zip(first, second, strict=False)))
        between = [*reversed(first[shared:]), *second[shared:]]
        if not self._slides.isdisjoint(between) or math.isinf(solid.outer + other.outer):
            return False
        points = [at, *(self._poses[number][:3, 3] for number in between), other_at]
        lengths = [float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(points)]
        longest = max(lengths)
        return longest - (sum(lengths) - longest) > solid.outer + other.outer


def nearest(
    sampled: Sequence[np.ndarray], firsts: Sequence[CollisionSolid], seconds: Sequence[CollisionSolid], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """For each pair of shapes the numbers (pairs, count) of the samples in which their bounding spheres are nearest, nearest
    first, and that least gap (pairs,) in m.

    ``sampled``: of every sample the poses (solids, 4, 4) of all shapes.
    """
    gaps = np.empty((len(sampled), len(firsts)))
    i, j = (np.array([solid.number for solid in some], dtype=int) for some in (firsts, seconds))
    radii = np.array([0.0 if math.isinf(a.outer) else a.outer for a in firsts])
    radii += np.array([0.0 if math.isinf(b.outer) else b.outer for b in seconds])
    flat = np.array([a.endless - b.endless for a, b in zip(firsts, seconds, strict=True)])
    for row, poses in zip(gaps, sampled, strict=True):
        separate = poses[j, :3, 3] - poses[i, :3, 3]
        height = np.einsum("nk,nk->n", np.where(flat[:, None] > 0, poses[i, :3, 2], -poses[j, :3, 2]), separate)
        row[:] = np.where(flat != 0, height, np.linalg.norm(separate, axis=1)) - radii
    order = np.argsort(gaps, axis=0, kind="stable")[:count]
    return order.T, gaps.min(axis=0, initial=np.inf)


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

    ``separate``: pairs that no state was found for; ``untried``: how many were left out; ``left``: some of them.
    """

    def __init__(self, scene: Scene):
        self._scene = scene
        self._mechanisms: dict[tuple[int, ...], Mechanism] = {}
        self._looks = LOOKS
        self._taken: dict[int, int] = {}
        self._made: list[int] = []
        self.separate: list[Pair] = []
        self.untried = 0
        self.left: list[Pair] = []
        self._alike: list[tuple[Pair, np.ndarray, list[np.ndarray]]] = []
        """Pairs of which too few different overlaps were found, one of their states, and the poses of those that were."""

    def bring_together(self, states: TouchStates) -> None:
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
        reach = MechanismReach(scene.world, scene.poses)
        pairs_left = []
        for pair in pairs:
            (solid, at), (other, other_at) = ((scene.solids[k], scene.at[k][:3, 3]) for k in pair)
            if (solid.endless and other.endless) or reach.separate(solid, at, other, other_at):
                self.separate.append(pair)
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
                self.separate.append(pair)
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

    def _search(self, states: TouchStates, pair: Pair, starts: list[np.ndarray]) -> bool:
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
        solid: CollisionSolid,
        other: CollisionSolid,
        names: tuple[str, str],
        deeper_by: float = 1.0,
    ) -> np.ndarray | None:
        """A state of Pinocchio's near ``start`` in which two shapes overlap clearly; None where none is found."""
        _, q, looks = mechanism.descend(start, solid, other, names, deeper_by)
        self._looks -= looks
        deep = -mechanism.between(q, solid, other, names).distance
        return q if mechanism.holds(q) and deep >= wanted_depth(solid, other)[1] else None

    def _shake(
        self, states: TouchStates, pair: Pair, q: np.ndarray, placed: list[np.ndarray], generator: np.random.Generator
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

    def _keep(
        self, states: TouchStates, mechanism: Mechanism, trees: tuple[int, ...], pair: Pair, q: np.ndarray
    ) -> None:
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


def _unlike(pose: np.ndarray, known: np.ndarray, solid: CollisionSolid, other: CollisionSolid) -> bool:
    """Whether two poses (4, 4) of the second of two shapes in the first one's frame are different, but for turns that change
    nothing of one of them."""
    ways = ((pose, known, other), (np.linalg.inv(pose), np.linalg.inv(known), solid))
    return all(_differ(values, two, moved, UNLIKE * min(solid.inner, other.inner)) for values, two, moved in ways)


def _differ(pose: np.ndarray, known: np.ndarray, moved: CollisionSolid, far: float) -> bool:
    kind = SHAPES[moved.shape.kind]
    away = float(np.linalg.norm(pose[:3, 3] - known[:3, 3]))
    axes = slice(0 if kind.round is Round.NONE else 2, 3 if kind.round is not Round.EVERY else 0)
    # ‖R − S‖ of two rotations is 2 √2 |sin(angle/2)|
    turned = float(np.linalg.norm(pose[:3, axes] - known[:3, axes]))
    return turned > UNLIKE or away > far
