"""A frame on a body of a tree, and the joint positions that put it somewhere: damped least squares within joint limits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from simspec.dynamics.oracle_tree import OracleTree
from simspec.world import frames
from simspec.world.kinematics import initial_state, layout, trees
from simspec.world.types import Body, Pose, World

REACHED = 1e-9
"""m and rad: a place is reached when the frame is no farther from it; engines' files hold poses to about 1e-12."""
ITERATIONS = 200
"""Steps of the solver; from the neighbouring point of a path it needs three to six, from afar some twenty."""
DAMPING = 1e-6, 1e-12, 1e6
"""λ² at the beginning, at least and at most (m², rad²): raised tenfold when a step makes it worse, lowered when it helps."""
LARGEST_TURN = 0.5
"""rad or m: no step of the solver moves a joint farther, so that it stays on the branch where it began."""
NUDGE = 0.02
"""rad or m: joints are moved so far, every other one the other way, to leave a pose in which no small motion leads nearer: a
stretched arm that should come back."""
POSTURE_STEPS = 20, 1e-7
"""Steps towards the posture of an arm with joints to spare, and the rad or m of a step that is not worth it."""
NEAR_SINGULAR = 1e-3, 1e-6, 60
"""A pose is nearly singular where a singular value of J is below this share of the largest; the m and rad within which a way
along such a direction is tried, and its most steps."""
SEARCHES = 40
"""Postures all over the limits from which a place that is not on a path is sought when the arm gets stuck on its way there."""


@dataclasses.dataclass(frozen=True)
class Solution:
    """Joint positions (of the whole tree), and how far the frame is off: m and rad. ``at_limit``: names of joints that stand
    at a limit."""

    positions: np.ndarray
    distance: float
    angle: float
    at_limit: tuple[str, ...] = ()

    @property
    def reached(self) -> bool:
        """Whether the frame is where it should be."""
        return self.distance <= REACHED and self.angle <= REACHED


class Tool:
    """A frame at ``pose`` on the body called ``body``, moved by the ``joints`` of these names: hinges and slides between it and
    its root. Positions are those of the body's whole tree (nq,), in the world's order of its bodies."""

    def __init__(self, world: World, body: str, pose: Pose, joints: Sequence[str]):
        self.bodies = tree_of(world, body)
        self._tree = tree = OracleTree(dataclasses.replace(world, bodies=self.bodies))
        self._pin, self._model, self._data = tree.pin, tree.model, tree.data
        index = [member.name for member in self.bodies].index(body)
        offset = tree.pin.SE3(np.array(frames.matrix(pose.quaternion)), np.array(pose.position))
        self._joint, self._placement = tree.body_joint[index], tree.body_placement[index] * offset
        parts = layout(self.bodies)
        place = {member.joint.name: row for row, member in enumerate(self.bodies)}
        self.joints = tuple(joints)
        rows = [place[name] for name in joints]
        self._q = np.array([parts.position[row].start for row in rows], dtype=int)
        self._v = np.array([parts.velocity[row].start for row in rows], dtype=int)
        limits = [self.bodies[row].joint.position_limits or (-np.inf, np.inf) for row in rows]
        self._low = np.array([low for low, _ in limits], dtype=float)
        self._high = np.array([high for _, high in limits], dtype=float)
        self._any = initial_state(dataclasses.replace(world, bodies=self.bodies))[0]
        self._ranks: dict[int, int] = {}

    def place(self, q: np.ndarray) -> Any:
        """The frame in the world (a Pinocchio SE3) at positions ``q`` of the tree."""
        self._pin.forwardKinematics(self._model, self._data, self._tree.spread(q)[0])
        return self._data.oMi[self._joint] * self._placement

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """J (6, joints): velocity and angular velocity of the frame in its own axes, for the tool's joints."""
        ours = self._tree.spread(q)[0]
        # of a tree with one coordinate Pinocchio gives a vector
        full = self._pin.computeJointJacobian(self._model, self._data, ours, self._joint).reshape(6, -1)
        jacobian: np.ndarray = (self._placement.toActionMatrixInverse() @ full)[:, self._tree.v_index[self._v]]
        return jacobian

    def solve(
        self,
        target: Any,
        start: np.ndarray,
        *,
        turning: bool = True,
        nominal: np.ndarray | None = None,
        far: bool = False,
    ) -> Solution:
        """Positions that put the frame at ``target`` (SE3), from ``start`` on: damped least squares (K. Levenberg, 1944).

        ``turning``: whether the orientation counts. Joints at a limit stay there as long as the step would push them on. An arm
        with joints to spare comes as near to the posture ``nominal`` (of the whole tree; default: ``start``) as the target
        allows. ``far``: whether the arm may go over to another branch to get there. Where the target cannot be reached the
        solution is as near as the solver came: see :attr:`Solution.reached`.
        """
        solution = self._descend(target, start, turning)
        for side in (NUDGE, -NUDGE):
            if not solution.reached:
                solution = min(solution, self._descend(target, self._nudged(start, side), turning), key=_farness)
        if far and not solution.reached:
            for posture in self._postures(start):
                other = self._descend(target, posture, turning)
                solution = min(solution, self._finished(target, other, turning), key=_farness)
                if solution.reached:
                    break
        solution = self._finished(target, solution, turning)
        if solution.reached and len(self.joints) > self._rank(turning):
            solution = self._towards(solution, start if nominal is None else nominal, target, turning)
        return solution

    def _nudged(self, q: np.ndarray, side: float) -> np.ndarray:
        moved = q.copy()
        moved[self._q] += side * (-1.0) ** np.arange(len(self._q))
        return moved

    def _postures(self, start: np.ndarray) -> Iterator[np.ndarray]:
        """Postures spread evenly over the limits (half a turn or half a metre where there is none), the same every time:
        the additive sequence of M. Roberts (2018), a generalisation of the golden ratio."""
        count = len(self._q)
        ratio = 2.0
        for _ in range(60):  # the root of x^(n+1) = x + 1
            ratio = (1.0 + ratio) ** (1.0 / (count + 1))
        low, high = np.maximum(self._low, -np.pi), np.minimum(self._high, np.pi)
        low, high = np.minimum(low, self._high), np.maximum(high, self._low)
        steps = ratio ** -np.arange(1.0, count + 1.0)
        for index in range(SEARCHES):
            posture = start.copy()
            posture[self._q] = low + (high - low) * ((0.5 + index * steps) % 1.0)
            yield posture

    def _descend(self, target: Any, start: np.ndarray, turning: bool) -> Solution:
        rows = 6 if turning else 3
        q, damping = start.copy(), DAMPING[0]
        q[self._q] = np.clip(q[self._q], self._low, self._high)
        error = self._error(q, target)
        size = float(np.linalg.norm(error[:rows]))
        for _ in range(ITERATIONS):
            if np.linalg.norm(error[:3]) <= REACHED / 10.0 and (
                not turning or np.linalg.norm(error[3:]) <= REACHED / 10.0
            ):
                break
            step = self._step(q, error[:rows], damping, rows)
            tried = q.copy()
            tried[self._q] = np.clip(q[self._q] + step, self._low, self._high)
            new_error = self._error(tried, target)
            new_size = float(np.linalg.norm(new_error[:rows]))
            if new_size < size:
                q, error, size = tried, new_error, new_size
                damping = max(DAMPING[1], damping / 10.0)
            elif damping >= DAMPING[2]:
                break
            else:
                damping *= 10.0
        return self._solution(q, error, turning)

    def _solution(self, q: np.ndarray, error: np.ndarray, turning: bool) -> Solution:
        edge = (q[self._q] <= self._low) | (q[self._q] >= self._high)
        names = tuple(name for name, there in zip(self.joints, edge, strict=True) if there)
        angle = float(np.linalg.norm(error[3:])) if turning else 0.0
        return Solution(q, float(np.linalg.norm(error[:3])), angle, names)

    def _finished(self, target: Any, solution: Solution, turning: bool) -> Solution:
        """The same or, where it is nearly at the target, what :meth:`_along_the_weak` makes of it."""
        if solution.reached or _farness(solution) > NEAR_SINGULAR[1]:
            return solution
        return min(solution, self._along_the_weak(target, solution, turning), key=_farness)

    def _along_the_weak(self, target: Any, solution: Solution, turning: bool) -> Solution:
        """On from a nearly singular pose, where what is left of the error lies along the direction that J hardly gives.

        With the singular value σ an error e takes a motion e/σ, which is large, and whose second order in the other directions
        is far larger than e: damped steps, each of which must bring the whole error down, come no farther. Here a step along
        that direction is judged after the others have been brought back: Newton's method on the curve of their solutions.
        """
        rows = 6 if turning else 3
        q, error = solution.positions, self._error(solution.positions, target)
        scale = 1.0
        for _ in range(NEAR_SINGULAR[2]):
            left, values, right = np.linalg.svd(self.jacobian(q)[:rows], full_matrices=False)
            if values[-1] == 0.0 or values[-1] > NEAR_SINGULAR[0] * values[0] or solution.reached:
                break
            along = float(left[:, -1] @ error[:rows]) / float(values[-1])
            tried = q.copy()
            tried[self._q] += scale * math.copysign(min(abs(along), LARGEST_TURN), along) * right[-1]
            tried, new_error = self._brought_back(target, tried, rows)
            if np.linalg.norm(new_error[:rows]) < np.linalg.norm(error[:rows]):
                q, error, scale = tried, new_error, min(1.0, 2.0 * scale)
                solution = self._solution(q, error, turning)
            else:
                scale /= 2.0
        return solution

    def _brought_back(self, target: Any, q: np.ndarray, rows: int) -> tuple[np.ndarray, np.ndarray]:
        """From ``q`` to where only the weakest direction of J is off, within the limits, and the error there."""
        for _ in range(4):  # each squares the error: 1e-1, 1e-2, 1e-4, 1e-8, 1e-16
            left, values, right = np.linalg.svd(self.jacobian(q)[:rows], full_matrices=False)
            step = right[:-1].T @ (left[:, :-1].T @ self._error(q, target)[:rows] / np.maximum(values[:-1], 1e-6))
            q = q.copy()
            q[self._q] = np.clip(q[self._q] + step, self._low, self._high)
        return q, self._error(q, target)

    def _rank(self, turning: bool) -> int:
        """How many directions the joints can move the frame in, at almost all postures."""
        rows = 6 if turning else 3
        if rows not in self._ranks:
            anywhere = list(self._postures(self._any))[1:4]
            self._ranks[rows] = max(int(np.linalg.matrix_rank(self.jacobian(q)[:rows], 1e-6)) for q in anywhere)
        return self._ranks[rows]

    def _towards(self, solution: Solution, nominal: np.ndarray, target: Any, turning: bool) -> Solution:
        """The solution of the same target that is nearest to ``nominal``: steps of the projected gradient, each followed by a
        way back to the target, halved where they do not help."""
        rank, scale = self._rank(turning), 1.0
        for _ in range(POSTURE_STEPS[0]):
            # directions beyond the rank move joints and leave the frame; those of a singular pose are not among them
            spare = np.linalg.svd(self.jacobian(solution.positions)[: 6 if turning else 3])[2][rank:]
            away = (nominal - solution.positions)[self._q]
            step = spare.T @ (spare @ away)
            if np.abs(step).max(initial=0.0) * scale <= POSTURE_STEPS[1]:
                break
            moved = solution.positions.copy()
            moved[self._q] += scale * step * min(1.0, LARGEST_TURN / float(np.abs(step).max()))
            tried = self._descend(target, moved, turning)
            if tried.reached and np.linalg.norm((nominal - tried.positions)[self._q]) < np.linalg.norm(away):
                solution = tried
            else:
                scale /= 2.0
        return solution

    def _error(self, q: np.ndarray, target: Any) -> np.ndarray:
        """Where the target is, seen from the frame: position (m), then rotation vector (rad)."""
        place = self.place(q)
        return np.concatenate(
            [
                place.rotation.T @ (target.translation - place.translation),
                self._pin.log3(place.rotation.T @ target.rotation),
            ]
        )

    def _step(self, q: np.ndarray, error: np.ndarray, damping: float, rows: int) -> np.ndarray:
        jacobian = self.jacobian(q)[:rows]
        at = q[self._q]
        free = np.ones(len(at), dtype=bool)
        while True:
            values = jacobian[:, free]
            step = np.zeros(len(at))
            step[free] = values.T @ np.linalg.solve(values @ values.T + damping * np.eye(rows), error)
            pushed = free & (((at <= self._low) & (step < 0.0)) | ((at >= self._high) & (step > 0.0)))
            if not pushed.any():
                break
            free &= ~pushed
        return step * min(1.0, LARGEST_TURN / max(float(np.abs(step).max(initial=0.0)), 1e-300))

    def efforts(self, q: np.ndarray, point: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Jᵀ F (joints,): the efforts on the tool's joints that press with ``force`` (N) at ``point`` (m), both in the frame's
        axes, at positions ``q``."""
        jacobian = self.jacobian(q)
        efforts: np.ndarray = jacobian[:3].T @ force + jacobian[3:].T @ np.cross(point, force)
        return efforts


def _farness(solution: Solution) -> float:
    """Which of two solutions is nearer; a radian counts as a metre."""
    return 0.0 if solution.reached else math.hypot(solution.distance, solution.angle)


def tree_of(world: World, body: str) -> tuple[Body, ...]:
    """The bodies of the tree that holds ``body``. Raises KeyError."""
    for bodies in trees(world).values():
        if any(member.name == body for member in bodies):
            return bodies
    raise KeyError(body)


def joints_to(bodies: Sequence[Body], body: str) -> list[Body]:
    """The bodies whose joints lie between the root and ``body``, the root's first."""
    by_name = {member.name: member for member in bodies}
    chain = []
    at: str | None = body
    while at is not None:
        chain.append(by_name[at])
        at = by_name[at].joint.parent
    return chain[::-1]
