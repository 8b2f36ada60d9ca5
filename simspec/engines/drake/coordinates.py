"""Between the generalised coordinates of ``world/kinematics.py`` and Drake's state, for all joints of a kind at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.engines.drake.building import DrakeBuild
from simspec.world.rotations import conjugate, exponential, matrices, multiply, rotate, unit

# Drake: free q = [w x y z, p], v = [ω in the world; velocity of the frame's origin in the world]; ball (BallRpyJoint) v = ω in
# the axes of the frame that it stands on. A ball's coordinates stay zero and its rotation is the pose of that frame: Drake
# throws at a pitch of 90° (measured); so its v is in the child's axes.

TINY = 1e-300
"""Added to angles that are divided by: no other angle changes by it."""


class DrakeCoordinates:
    """Where each joint has its numbers in q (nq,) and v (nv,), and in Drake's x = [q; v]; and the rotations of ball joints."""

    def __init__(self, built: DrakeBuild, q_places: Sequence[slice], v_places: Sequence[slice]):
        self._built, self.positions = built, built.plant.num_positions()
        self.nq, self.nv = (places[-1].stop if places else 0 for places in (q_places, v_places))
        scalar: list[tuple[int, ...]] = []
        free: list[tuple[int, ...]] = []
        ball: list[tuple[int, ...]] = []
        for placed, body, joint in zip(built.walk.bodies, built.bodies, built.joints, strict=True):
            kind, row = placed.body.joint.kind, placed.row
            place = (row, q_places[row].start, v_places[row].start)
            if kind == "free":
                free.append((*place, body.floating_positions_start(), body.floating_velocities_start_in_v()))
            elif kind != "fixed":
                rows = ball if kind == "ball" else scalar
                rows.append((*place, joint.position_start(), joint.velocity_start()))
        table = np.array(scalar, dtype=np.intp).reshape(-1, 5)
        self.q, self.v, self.drake_q, self.drake_v = table[:, 1], table[:, 2], table[:, 3], table[:, 4]
        self.free, self.free_q, self.free_v, self.free_drake_q, self.free_drake_v = _wide(free, (7, 6, 7, 6))
        self._free_turns = self.free_drake_q[:, :4]
        self.ball, self.ball_q, self.ball_v, _, self.ball_drake_v = _wide(ball, (4, 3, 3, 3))
        self.turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(ball), 1))
        self._ball_drake_q = np.array([row[3] for row in ball], dtype=np.intp)[:, None] + np.arange(3)
        self._frames = [built.turns[index] for index in self.ball.tolist()]

    def state(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(q, v) of Drake's state and the present rotations of the balls."""
        values, rate = x[: self.positions], x[self.positions :]
        q, v = np.zeros(self.nq), np.zeros(self.nv)
        q[self.q], v[self.v] = values[self.drake_q], rate[self.drake_v]
        if len(self.free):
            place, motion = values[self.free_drake_q], rate[self.free_drake_v]
            turns = unit(place[:, :4])
            q[self.free_q] = np.concatenate([place[:, 4:], turns], axis=1)
            v[self.free_v] = np.concatenate([motion[:, 3:], rotate(conjugate(turns), motion[:, :3])], axis=1)
        if len(self.ball):
            q[self.ball_q], v[self.ball_v] = unit(self.turns), rate[self.ball_drake_v]
        return q, v

    def drake_state(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Drake's state for (q, v), but for the rotations of the balls, which are set."""
        values, rate = np.zeros(self.positions), np.zeros(self.nv)
        values[self.drake_q], rate[self.drake_v] = q[self.q], v[self.v]
        if len(self.free):
            place, motion = q[self.free_q], v[self.free_v]
            turns, spin = unit(place[:, 3:]), motion[:, 3:]
            values[self.free_drake_q] = np.concatenate([turns, place[:, :3]], axis=1)
            rate[self.free_drake_v] = np.concatenate([rotate(turns, spin), motion[:, :3]], axis=1)
        if len(self.ball):
            self.turns, rate[self.ball_drake_v] = unit(q[self.ball_q]), v[self.ball_v]
        return np.concatenate([values, rate])

    def effort(self, x: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """A generalised effort (nv,) in Drake's coordinates."""
        found = np.zeros(self.nv)
        found[self.drake_v] = effort[self.v]
        if len(self.free):
            given, turns = effort[self.free_v], unit(x[self.free_drake_q][:, :4])
            found[self.free_drake_v] = np.concatenate([rotate(turns, given[:, 3:]), given[:, :3]], axis=1)
        if len(self.ball):
            found[self.ball_drake_v] = effort[self.ball_v]
        return found

    def effort_back(self, x: np.ndarray, given: np.ndarray) -> np.ndarray:
        """The inverse of :meth:`effort`; for several efforts at once as the columns of (nv, n)."""
        found = np.zeros_like(given)
        found[self.v] = given[self.drake_v]
        for places, local, turn in zip(self.free_v, self.free_drake_v, self.matrices(x), strict=True):
            found[places[:3]], found[places[3:]] = given[local[3:]], turn.T @ given[local[:3]]
        if len(self.ball):
            found[self.ball_v] = given[self.ball_drake_v]
        return found

    def matrices(self, x: np.ndarray) -> np.ndarray:
        """Rotations (n, 3, 3) of the free bodies."""
        turns = unit(x[self.free_drake_q][:, :4]) if len(self.free) else np.zeros((0, 4))
        return matrices(turns)

    def straight(self, *values: np.ndarray) -> list[np.ndarray]:
        """Numbers of hinges, slides and balls, each (nv,), in Drake's coordinates; zero for free bodies."""
        ordered = []
        for value in values:
            zeros = np.zeros(self.nv)
            zeros[self.drake_v], zeros[self.ball_drake_v] = value[self.v], value[self.ball_v]
            ordered.append(zeros)
        return ordered

    def turned(self, before: np.ndarray, after: np.ndarray, timestep: float) -> np.ndarray:
        """The state after a step with its rotations made anew, R' = exp(dt ω) R with the new ω; those of the balls are kept,
        for :meth:`write_turns`. Drake's own are off by 1e-5 (measured).

        Of a free body Drake makes q' = q + d with d = dt/2 (0, ω) q, to the last bit (measured). exp(dt ω) q is q cos|d| +
        d sin|d|/|d|, so that d is all that is needed, and nothing where no body turns. Products of quaternions made the steps
        of 216 free bodies half as long again.
        """
        x = after.copy()
        if len(self.free):
            q = before.take(self._free_turns)
            d = after.take(self._free_turns)
            d -= q
            if d.any():
                half_angle = np.sqrt(np.add.reduce(d * d, 1))
                half_angle += TINY
                d *= (np.tan(half_angle) / half_angle)[:, None]
                d += q
                d /= np.sqrt(np.add.reduce(d * d, 1))[:, None]
                x[self._free_turns] = d
        if len(self.ball):
            x[self._ball_drake_q] = 0.0
            rate = x[self.positions :][self.ball_drake_v]
            self.turns = unit(multiply(self.turns, exponential(timestep * rate)))
        return x

    def swing(self, x: np.ndarray) -> np.ndarray:
        """Rotations (balls, 4) of the balls' coordinates, roll, pitch and yaw, which are zero between steps."""
        roll, pitch, yaw = (
            exponential(axis * angle[:, None]) for axis, angle in zip(np.eye(3), x[self._ball_drake_q].T, strict=True)
        )
        return multiply(multiply(yaw, pitch), roll)

    def settled(self, after: np.ndarray) -> np.ndarray:
        """The state after a step of Drake's, whose rotations are kept as they are; those of the balls are moved to the frames
        that they stand on, for :meth:`write_turns`."""
        if not len(self.ball):
            return after
        x, rates = after.copy(), self.positions + self.ball_drake_v
        swing = self.swing(x)
        self.turns = unit(multiply(self.turns, swing))
        x[self._ball_drake_q] = 0.0
        x[rates] = rotate(conjugate(swing), x[rates])
        return x

    def write_turns(self, context: Any) -> None:
        """Put the rotations of the balls into the context."""
        drake = self._built.drake
        for frame, turn in zip(self._frames, self.turns, strict=True):
            frame.SetPoseInParentFrame(context, drake.transform((0.0, 0.0, 0.0), turn))


def _wide(rows: Sequence[Sequence[int]], sizes: Sequence[int]) -> tuple[np.ndarray, ...]:
    """The bodies of some rows, and their places as arrays (rows, size)."""
    table = np.array(rows, dtype=np.intp).reshape(-1, 5)
    return (table[:, 0], *(table[:, 1 + k : 2 + k] + np.arange(size) for k, size in enumerate(sizes)))
