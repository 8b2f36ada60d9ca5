"""Equalities in MuJoCo to round-off: a few solves of a step, each with the reference that the last one missed by.

MuJoCo's constraints are soft: with the largest impedance, 0.9999, a solve misses the reference acceleration by 1e-4 of it
(measured: 3e-7 rad of a coupling in 2,000 steps of 1 ms). Adding what was missed to the reference, and solving again, misses
1e-4 of that (the method of multipliers): three solves are at round-off, in contact as well. The reference is the law of the
world, J v⁺ = −φ/dt, without the term J̇ v that MuJoCo 4 has in a connect's (measured: 2.6e-3 rad in a four-bar).

Facts marked *measured*: MuJoCo 4.0.1, 1 ms.
"""

from __future__ import annotations

from typing import Any

import numpy as np

MOST_SOLVES = 6
"""Solves in a step; three are enough for what is not redundant."""
NEAR = 1e-15
"""What may be missed (m/s, rad/s), of which a step keeps dt times as much."""


class Equalities:
    """The equalities of one ``mjData``; between ``mj_step1`` and the integration of a step."""

    def __init__(self, mujoco: Any, model: Any, data: Any):
        self._mujoco, self._model, self._data = mujoco, model, data
        self._dt = float(model.opt.timestep)
        self._wanted = np.zeros(0)

    def advance(self, count: int) -> None:
        """``count`` steps under the efforts and actuator targets that the data holds."""
        mujoco, model, data = self._mujoco, self._model, self._data
        for _ in range(count):
            mujoco.mj_step1(model, data)
            self.begin()
            mujoco.mj_fwdActuation(model, data)
            mujoco.mj_fwdAcceleration(model, data)
            self.solve()
            mujoco.mj_checkAcc(model, data)
            mujoco.mj_Euler(model, data)

    def begin(self) -> None:
        """Take the reference of a step's equalities, whose rows come first, from the law."""
        data, dt = self._data, self._dt
        rows = slice(0, int(data.ne))
        self._wanted = -data.efc_vel[rows] / dt - data.efc_pos[rows] / (dt * dt)

    def solve(self) -> None:
        """``mj_fwdConstraint`` until the equalities have their reference accelerations."""
        mujoco, model, data = self._mujoco, self._model, self._data
        count = len(self._wanted)
        reference = data.efc_aref[:count]
        reference[:] = self._wanted
        made = np.zeros(data.nefc)
        for _ in range(MOST_SOLVES):
            mujoco.mj_fwdConstraint(model, data)
            if not count:
                return
            mujoco.mj_mulJacVec(model, data, made, data.qacc)
            missed = self._wanted - made[:count]
            if not np.abs(missed).max() * self._dt > NEAR:  # a state that is not finite is a result
                return
            reference += missed
            data.qacc_warmstart[:] = data.qacc
