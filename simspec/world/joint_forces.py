"""Damping and springs of joints as efforts of the state, explicit in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from simspec.language.vocabulary import SCALAR_JOINTS, TREE_JOINTS
from simspec.world.kinematics import layout_of
from simspec.world.rotations import logarithm
from simspec.world.types import Body, World

Array = NDArray[np.float64]


class JointForces:
    """−d q̇ − k (q − rest) of hinges and slides, −d ω − k log R of balls, of ``bodies`` in the order of their coordinates.
    The damping of free bodies is not among them: engines are given it beside (``dialects/kit/passive.py``)."""

    def __init__(self, bodies: Sequence[Body]):
        layout = layout_of(World("", tuple(bodies)))
        self._damping, self._stiffness, self._rest = np.zeros((3, layout.nv))
        self._balls: list[tuple[slice, slice]] = []
        scalar: list[tuple[int, int]] = []
        for body, at_q, at_v in zip(bodies, layout.position, layout.velocity, strict=True):
            joint = body.joint
            if joint.kind in TREE_JOINTS:
                self._damping[at_v], self._stiffness[at_v] = joint.damping, joint.spring_stiffness
            if joint.kind in SCALAR_JOINTS:
                scalar.append((at_q.start, at_v.start))
                self._rest[at_v] = joint.spring_rest
            elif joint.kind == "ball":
                self._balls.append((at_q, at_v))
        at = np.array(scalar, dtype=np.intp).reshape(-1, 2)
        self._scalar_q, self._scalar_v = at[:, 0], at[:, 1]
        self.needed = bool(self._damping.any() or self._stiffness.any())
        """Whether any joint has any."""

    def effort(self, q: Array, v: Array) -> Array:
        """The effort (nv,) at the state ``q`` (nq,), ``v`` (nv,)."""
        found: Array = -self._damping * v
        at = self._scalar_v
        found[at] -= self._stiffness[at] * (q[self._scalar_q] - self._rest[at])
        for at_q, at_v in self._balls:
            found[at_v] -= self._stiffness[at_v] * logarithm(q[at_q])
        return found
