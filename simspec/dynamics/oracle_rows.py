"""The rows of constraints in the oracle: their Jacobian by Pinocchio's Jacobians of joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from simspec.world.constraints import ROWS
from simspec.world.types import Constraint, FollowConstraint, Vector3, WeldConstraint

Anchor = tuple[int, np.ndarray]
"""A point of a body: the Pinocchio joint that it moves with (0: none), and where it is in that joint's frame (3,)."""


def whole(jacobian: np.ndarray) -> np.ndarray:
    """(6, nv): of one coordinate Pinocchio gives a vector (measured)."""
    return jacobian.reshape(6, -1)


class ConstraintRows:
    """J (rows, nv) of ``constraints`` in the world's coordinates, which are ``columns`` of Pinocchio's.

    pin, model, data  Pinocchio, and its model of the tree
    joints            where in v each joint is, by name
    bodies            the Pinocchio joint of each body, and the placement of its frame there, by name
    """

    def __init__(
        self,
        pin: Any,
        model: Any,
        data: Any,
        columns: np.ndarray,
        constraints: Sequence[Constraint],
        joints: Mapping[str, slice],
        bodies: Mapping[str, tuple[int, Any]],
    ):
        self._pin, self._model, self._data, self._columns = pin, model, data, columns
        self._fixed = np.zeros((sum(ROWS[constraint.kind] for constraint in constraints), len(columns)))
        self._ends: list[tuple[int, int, Anchor, Anchor]] = []

        def anchor(body: str, point: Vector3) -> Anchor:
            joint, placement = bodies[body]
            return joint, placement.act(np.array(point))

        start = 0
        for constraint in constraints:
            end = start + ROWS[constraint.kind]
            if isinstance(constraint, FollowConstraint):
                self._fixed[start, joints[constraint.joint]] += 1.0
                self._fixed[start, joints[constraint.leader]] -= constraint.ratio
            else:
                points: tuple[Vector3, Vector3] = (
                    (constraint.pose.position, (0.0, 0.0, 0.0))
                    if isinstance(constraint, WeldConstraint)
                    else (constraint.first_point, constraint.second_point)
                )
                first, second = (
                    anchor(body, at) for body, at in zip((constraint.first, constraint.second), points, strict=True)
                )
                self._ends.append((start, end, first, second))
            start = end

    def at(self, q: np.ndarray) -> np.ndarray:
        """J at Pinocchio's positions ``q``."""
        rows = self._fixed.copy()
        if self._ends:
            self._pin.computeJointJacobians(self._model, self._data, q)
        for start, end, first, second in self._ends:
            rows[start:end] = self._twist(first, end - start) - self._twist(second, end - start)
        return rows

    def _twist(self, anchor: Anchor, count: int) -> np.ndarray:
        """(count, nv): velocity of a point of a body, then (6 rows) its angular velocity, in world axes, by the Jacobians
        computed last."""
        joint, place = anchor
        if not joint:
            return np.zeros((count, len(self._columns)))
        frame = self._pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobian = whole(self._pin.getJointJacobian(self._model, self._data, joint, frame))
        arm = self._data.oMi[joint].rotation @ place
        moved = jacobian[:3] - self._pin.skew(arm) @ jacobian[3:]
        turned: np.ndarray = (moved if count == 3 else np.concatenate([moved, jacobian[3:]]))[:, self._columns]
        return turned
