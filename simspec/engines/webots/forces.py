"""Damping and springs of joints, which simspec gives to Webots before each step: its own are implicit, and rest at zero."""

from __future__ import annotations

import numpy as np

from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world.kinematics import layout_of
from simspec.world.rotations import logarithm
from simspec.world.types import World


class Forces:
    """−d q̇ − k (q − rest) of hinges and slides, −d ω − k log R of balls, in the child's axes."""

    def __init__(self, world: World):
        layout = layout_of(world)
        self._damping, self._stiffness, self._rest = np.zeros((3, layout.nv))
        self._balls: list[tuple[slice, slice]] = []
        scalar: list[tuple[int, int]] = []
        for body, at_q, at_v in zip(world.bodies, layout.position, layout.velocity, strict=True):
            joint = body.joint
            if joint.kind in SCALAR_JOINTS:
                scalar.append((at_q.start, at_v.start))
                self._rest[at_v] = joint.spring_rest
            elif joint.kind == "ball":
                self._balls.append((at_q, at_v))
            else:
                continue
            self._damping[at_v], self._stiffness[at_v] = joint.damping, joint.spring_stiffness
        self._scalar = np.array(scalar, dtype=np.intp).reshape(-1, 2)
        self.needed = bool(self._damping.any() or self._stiffness.any())

    def effort(self, q: np.ndarray, v: np.ndarray, given: np.ndarray | None) -> np.ndarray:
        """The effort (nv,) for one step, for one that is ``given``, None = zero."""
        total: np.ndarray = -self._damping * v if given is None else given - self._damping * v
        at_q, at_v = self._scalar.T
        total[at_v] -= self._stiffness[at_v] * (q[at_q] - self._rest[at_v])
        for ball_q, ball_v in self._balls:
            total[ball_v] -= self._stiffness[ball_v] * logarithm(q[ball_q])
        return total
