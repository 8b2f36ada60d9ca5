"""Joint positions at which two shapes of mechanisms overlap, found by descent on their signed distance within the limits."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np

from simspec.dynamics.oracle_tree import Tree
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.proof.touch.geometry import Gap, Solid, gap, wanted_depth
from simspec.world.kinematics import layout_of, trees
from simspec.world.types import World

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
        self.tree = Tree(dataclasses.replace(world, bodies=bodies))
        self._pin, self._model, self._data = self.tree.pin, self.tree.model, self.tree.data
        # where the coordinates of these trees' bodies stand in the world's q
        self._places = np.concatenate([np.zeros(0, int), *(np.r_[places[body.name]] for body in bodies)]).astype(int)
        names = [body.name for body in bodies]
        self._joint = dict(zip(names, self.tree.body_joint, strict=True))
        self._placement = {
            name: placement.homogeneous for name, placement in zip(names, self.tree.body_placement, strict=True)
        }
        self._columns = [
            np.concatenate([np.zeros(0, int), *(self._range(k) for k in self._model.supports[joint] if k)]).astype(int)
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

    def _range(self, joint: int) -> np.ndarray:
        return np.arange(self._model.idx_vs[joint], self._model.idx_vs[joint] + self._model.nvs[joint])

    def ours(self, q: np.ndarray) -> np.ndarray:
        """Pinocchio's coordinates of a state (nq,) of the world."""
        return self.tree.spread(q[self._places])[0]

    def write(self, q: np.ndarray, into: np.ndarray) -> None:
        """Write Pinocchio's coordinates ``q`` of these trees into a state (nq,) of the world."""
        into[self._places] = q[self.tree.q_index]

    def _pose(self, solid: Solid, name: str) -> np.ndarray:
        pose: np.ndarray = self._data.oMi[self._joint[name]].homogeneous @ self._placement[name] @ solid.pose
        return pose

    def between(self, q: np.ndarray, solid: Solid, other: Solid, names: tuple[str, str]) -> Gap:
        """The gap of two shapes of the bodies ``names`` in a state of Pinocchio's."""
        self._pin.forwardKinematics(self._model, self._data, q)
        return gap(solid, self._pose(solid, names[0]), other, self._pose(other, names[1]))

    def relative(self, q: np.ndarray, solid: Solid, other: Solid, names: tuple[str, str]) -> np.ndarray:
        """The pose (4, 4) of the second of two shapes in the first one's frame."""
        self._pin.forwardKinematics(self._model, self._data, q)
        pose: np.ndarray = np.linalg.inv(self._pose(solid, names[0])) @ self._pose(other, names[1])
        return pose

    def shaken(self, q: np.ndarray, extent: float, generator: np.random.Generator) -> np.ndarray:
        """A state within the limits that is off by up to ``extent`` (rad, m) in every direction in which joints move."""
        step = generator.uniform(-extent, extent, self._model.nv)
        return self._clipped(self._pin.integrate(self._model, q, step))

    def look(self, q: np.ndarray, solid: Solid, other: Solid, names: tuple[str, str]) -> tuple[float, np.ndarray]:
        """The signed distance of two shapes, and its slope (nv,): what moves a point of the second along the normal, less
        what moves the first's."""
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
        self, q: np.ndarray, solid: Solid, other: Solid, names: tuple[str, str], deeper_by: float = 1.0
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


class Reach:
    """Which shapes of mechanisms the lengths of their links keep apart for ever, whatever the joints do."""

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

    def apart(self, solid: Solid, at: np.ndarray, other: Solid, other_at: np.ndarray) -> bool:
        """Whether the polygon from centre to centre over the hinges between can't close. Slides change lengths: not told.
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
    sampled: Sequence[np.ndarray], firsts: Sequence[Solid], seconds: Sequence[Solid], count: int
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
        apart = poses[j, :3, 3] - poses[i, :3, 3]
        height = np.einsum("nk,nk->n", np.where(flat[:, None] > 0, poses[i, :3, 2], -poses[j, :3, 2]), apart)
        row[:] = np.where(flat != 0, height, np.linalg.norm(apart, axis=1)) - radii
    order = np.argsort(gaps, axis=0, kind="stable")[:count]
    return order.T, gaps.min(axis=0, initial=np.inf)
