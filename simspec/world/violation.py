"""How far constraints outside the tree are from holding, and how that changes as the bodies move.

φ (rows,) and its Jacobian J (rows, nv), φ̇ = J v, in simspec's generalised coordinates (``world/kinematics.py``):

follow    φ = q of the joint − ratio × q of its leader − offset
connect   φ = the first body's point − the second's, in world axes
weld      the same for the origin of the second body's frame, then the rotation vector, in world axes, from where the second
          body is to where the first holds it
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simspec.world.gathering import told_inertial
from simspec.world.kinematics import layout
from simspec.world.rotations import conjugate, logarithm, multiply, rotate
from simspec.world.types import Body, Connect, Constraint, Follow, Weld, World

Array = NDArray[np.float64]
ROWS = {"follow": 1, "connect": 3, "weld": 6}
"""Rows of each kind of constraint."""


class Violation:
    """φ and J of some constraints of some bodies, parents before children."""

    def __init__(self, bodies: Sequence[Body], constraints: Sequence[Constraint]):
        self.constraints = tuple(constraints)
        self._bodies = tuple(bodies)
        self._world = World("", self._bodies)
        self._layout = layout(self._bodies)
        self.nv = self._layout.nv
        self._row = {body.name: row for row, body in enumerate(self._bodies)}
        self._joint = {body.joint.name: row for row, body in enumerate(self._bodies)}
        self.count = sum(ROWS[constraint.kind] for constraint in self.constraints)
        self._above = [self._path(row) for row in range(len(self._bodies))]

    def _path(self, row: int) -> list[int]:
        """The bodies whose joints move a body, itself first."""
        path = []
        at: int | None = row
        while at is not None:
            joint = self._bodies[at].joint
            if joint.kind != "fixed":
                path.append(at)
            at = None if joint.parent is None else self._row[joint.parent]
        return path

    def of(self, q: Array, poses: Array) -> Array:
        """φ (rows,) at positions ``q`` (nq,), where bodies are at ``poses`` (bodies, 7) x y z w x y z."""
        parts = []
        for constraint in self.constraints:
            if isinstance(constraint, Follow):
                own, lead = (q[self._layout.position[self._joint[name]]] for name in self._coupled(constraint))
                parts.append(own - constraint.ratio * lead - constraint.offset)
                continue
            first, second = (poses[self._row[name]] for name in (constraint.first, constraint.second))
            points = self._points(constraint, first, second)
            parts.append(points[0] - points[1])
            if isinstance(constraint, Weld):
                wanted = multiply(first[3:], np.array(constraint.pose.quaternion))
                parts.append(logarithm(multiply(wanted, conjugate(second[3:]))))
        return np.concatenate([np.zeros(0), *parts])

    def jacobian(self, poses: Array) -> Array:
        """J (rows, nv) where bodies are at ``poses`` (bodies, 7)."""
        full = np.zeros((self.count, self.nv))
        start = 0
        for constraint in self.constraints:
            rows = full[start : start + ROWS[constraint.kind]]
            start += ROWS[constraint.kind]
            if isinstance(constraint, Follow):
                own, lead = (self._layout.velocity[self._joint[name]] for name in self._coupled(constraint))
                rows[:, own] += 1.0
                rows[:, lead] -= constraint.ratio
                continue
            first, second = (self._row[name] for name in (constraint.first, constraint.second))
            points = self._points(constraint, poses[first], poses[second])
            for body, point, sign in ((first, points[0], 1.0), (second, points[1], -1.0)):
                self._add(rows, body, point, sign, poses)
        return full

    @staticmethod
    def _coupled(follow: Follow) -> tuple[str, str]:
        return follow.joint, follow.leader

    @staticmethod
    def _points(constraint: Connect | Weld, first: Array, second: Array) -> tuple[Array, Array]:
        """The two points that should be one, in the world."""
        if isinstance(constraint, Weld):
            return first[:3] + rotate(first[3:], np.array(constraint.pose.position)), second[:3]
        at = first[:3] + rotate(first[3:], np.array(constraint.first_point))
        return at, second[:3] + rotate(second[3:], np.array(constraint.second_point))

    def _add(self, rows: Array, body: int, point: Array, sign: float, poses: Array) -> None:
        """Add the velocity of a body's ``point`` (in the world), and its angular velocity where there are rows for it."""
        for above in self._above[body]:
            joint, place = self._bodies[above].joint, self._layout.velocity[above]
            at, turn = poses[above, :3], poses[above, 3:]
            if joint.kind == "slide":
                rows[:3, place] += sign * rotate(turn, np.array(joint.axis))[:, None]
                continue
            if joint.kind == "free":
                at = at + rotate(turn, np.array(told_inertial(self._world, self._bodies[above]).centre_of_mass))
                rows[:3, place.start : place.start + 3] += sign * np.eye(3)
                place = slice(place.start + 3, place.stop)
            axes = np.array([joint.axis]) if joint.kind == "hinge" else np.eye(3)
            world_axes = rotate(turn[None], axes)
            rows[:3, place] += sign * np.cross(world_axes, point - at).T
            if len(rows) == ROWS["weld"]:
                rows[3:, place] += sign * world_axes.T


def impulse(mass: Array, jacobian: Array, velocity: Array, violation: Array, timestep: float) -> Array:
    """What the law J v⁺ = −φ/dt adds to a velocity (nv,): −M⁻¹ Jᵀ λ, with J M⁻¹ Jᵀ λ = J v + φ/dt. Rows that say the same twice
    count once: of λ the smallest."""
    moved = np.linalg.solve(mass, jacobian.T)
    return -moved @ multipliers(jacobian @ moved, jacobian @ velocity + violation / timestep)


def multipliers(mobility: Array, wanted: Array) -> Array:
    """λ (rows,) with A λ = ``wanted``, the smallest where A = J M⁻¹ Jᵀ (rows, rows) has no inverse."""
    scale = np.sqrt(np.maximum(np.diag(mobility), 1e-300))
    inverse = np.linalg.pinv(mobility / np.outer(scale, scale), rcond=RANK, hermitian=True)
    return (inverse @ (wanted / scale)) / scale


RANK = 1e-10
"""Of the largest eigenvalue: rows are scaled to the same mobility, and a share below this says nothing that others do not."""
