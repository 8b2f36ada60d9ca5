"""Coulomb's law in MuJoCo: a short fixed point around its own solver (setting ``friction: coulomb``).

MuJoCo's contact problem is convex, and its friction cone therefore associated: a contact that slips at the speed v is also
separated at μ|v|. Its own way out is friction that takes back slip slowly, on a soft first layer, which makes slides right
and leaves out most of the friction of an impact, which lasts one step. De Saxcé's correction keeps both: lower each contact's
normal reference by μ|v|/dt, with the slip v *after* the step, and the optimum of the convex problem is Coulomb's law (de Saxcé
and Feng 1998, The bipotential method; Acary and Cadoux 2013). v is not known before the solve, so that a step is solved until
the correction that was put in is the one that comes out.

Facts marked *measured*: MuJoCo 4.0.1, 1 ms.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simspec.engines.mujoco.integrators import last_stage

# Equalities in MuJoCo to round-off: a few solves of a step, each with the reference that the last one missed by.
#
# MuJoCo's constraints are soft: with the largest impedance, 0.9999, a solve misses the reference acceleration by 1e-4 of it
# (measured: 3e-7 rad of a coupling in 2,000 steps of 1 ms). Adding what was missed to the reference, and solving again, misses
# 1e-4 of that (the method of multipliers): three solves are at round-off, in contact as well. The reference is the law of the
# world, J v⁺ = −φ/dt, without the term J̇ v that MuJoCo 4 has in a connect's (measured: 2.6e-3 rad in a four-bar).
#
# Facts marked *measured*: MuJoCo 4.0.1, 1 ms.

MOST_SOLVES = 6
"""Solves in a step; three are enough for what is not redundant."""
NEAR = 1e-15
"""Residual that may remain (m/s, rad/s); a step keeps dt times as much."""


class Equalities:
    """The equalities of one ``mjData``; between ``mj_step1`` and the integration of a step."""

    def __init__(self, mujoco: Any, model: Any, data: Any):
        self._mujoco, self._model, self._data = mujoco, model, data
        self._end = last_stage(mujoco, model)
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
            self._end(model, data)

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


MOST_FRICTION_SOLVES = 10
"""Solves in a step. A single sliding or landing body needs two or three; in a pile of 216 spheres 0.1 % of the steps of the
first 1.5 s are not converged after ten at μ = 0.3, 5 % at 0.5 and 35 % at 1 (measured: docs/records/contact.md)."""
RELATIVE = 0.001
"""Change of a correction, as a share of it, at which it is taken as found: a ball of μ = 1.5 that lands at 2 m/s and slips at
20 then leaves with its normal speed off by up to 1.5 % of the landing's."""
FALL = 0.1
"""The same, absolute: this share of a step's fall."""
NO_GRAVITY = 9.81
"""m/s²: the scale of a fall in worlds without gravity."""
ARRIVING = 20.0
"""Of ``FALL``: nothing rests that approaches faster than twice a step's fall."""
FIRST_GAIN, MOST_GAIN = 1.0, 4.0
"""A sliding contact finds its correction in one step of 1 + k μ² times what is off, with k how much more easily it is moved
along the surface than across (1 for what does not turn, 7/2 for a ball, 4 for the end of a rod). The first step takes k = 1,
and μ no larger than the first of these; the others are between 1 and 1 + k μ² with the second."""


class Coulomb:
    """Steps one ``mjData`` under Coulomb's law; the motion depends on the state and on MuJoCo's warm start alone."""

    def __init__(self, mujoco: Any, model: Any, data: Any, equalities: Equalities | None = None):
        self._mujoco, self._model, self._data = mujoco, model, data
        self._end = last_stage(mujoco, model)
        self._equalities = equalities
        self._dt = float(model.opt.timestep)
        self._near = FALL * self._dt * (float(np.linalg.norm(model.opt.gravity)) or NO_GRAVITY)
        self._rows_of = _Pyramid if mujoco.mj_isPyramidal(model) else _Cone
        # native hardness is MuJoCo's own contact, and stays it: the one whose impedance rises with depth
        impedance = np.concatenate([model.geom_solimp, model.pair_solimp])
        self._some_native = bool((impedance[:, 0] != impedance[:, 1]).any())
        rough = np.concatenate([model.geom_condim, model.pair_dim]) >= 3
        self._any_friction = bool(rough.any())
        self._key: tuple[bytes, ...] | None = None
        self._rows: _Cone | _Pyramid | None = None
        self._product = np.zeros(0)
        self.stepped = self.unsettled = 0
        self.worst = 0.0

    def advance(self, count: int) -> None:
        """``count`` steps under the efforts and actuator targets that the data holds."""
        if not self._any_friction and self._equalities is not None:
            self._equalities.advance(count)
            return
        if not self._any_friction:
            self._mujoco.mj_step(self._model, self._data, nstep=count)
            return
        for _ in range(count):
            self.step()

    def step(self) -> None:
        mujoco, model, data = self._mujoco, self._model, self._data
        mujoco.mj_step1(model, data)
        if self._equalities is not None:
            self._equalities.begin()
        rows = self._contact_rows()
        if rows is None and self._equalities is None:
            mujoco.mj_step2(model, data)
            return
        if rows is not None:
            rows.begin(data.efc_vel, data.efc_aref, self._dt)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        if rows is not None:
            self._solve(rows)
        else:
            self._constrain()
        mujoco.mj_checkAcc(model, data)
        self._end(model, data)

    def _constrain(self) -> None:
        """One solve of the step."""
        if self._equalities is not None:
            self._equalities.solve()
        else:
            self._mujoco.mj_fwdConstraint(self._model, self._data)

    def log(self) -> list[str]:
        """How often, and by how much, the correction was not found."""
        if not self.unsettled:
            return []
        return [
            f"friction: coulomb: of {self.stepped} steps with friction in contact {self.unsettled} ended unconverged after "
            f"{MOST_FRICTION_SOLVES} solves, with the normal speed of a contact off by up to {self.worst:.2g} m/s"
        ]

    def _contact_rows(self) -> _Cone | _Pyramid | None:
        """The rows of the contacts with friction; None without any. They are computed when contacts change."""
        contact = self._data.contact
        address = contact.efc_address
        if not address.size:
            return None
        dim, friction = contact.dim, contact.friction
        native = contact.solimp[:, :2] if self._some_native else _NOTHING
        key = (address.tobytes(), dim.tobytes(), friction.tobytes(), native.tobytes())
        if key != self._key:
            self._key = key
            actual = (dim >= 3) & (address >= 0)  # negative: asleep, or between bodies that cannot move
            if self._some_native:
                actual &= native[:, 0] == native[:, 1]
            self._rows = self._rows_of(address[actual], dim[actual], friction[actual]) if actual.any() else None
        return self._rows

    def _solve(self, rows: _Cone | _Pyramid) -> None:
        """The fixed point x = lift(x).

        Steps are each contact's own, by the secant of its last two, which finds what slides alone in three solves; every second
        one is Anderson's of depth one, over all contacts, for those that press on each other.
        """
        data, dt = self._data, self._dt
        reference, normal = data.efc_aref, rows.normal
        plain = reference[normal]
        self.stepped += 1
        if rows.rests(data.efc_vel, self._near):
            # one solve is enough, unless a force sets it in motion now. It is corrected by the slip before the step: without
            # that, creep separates the two sides of a clamp that jams, one loses contact, and the clamp falls
            reference[normal] = plain - rows.spread(rows.creep()) / dt
            self._constrain()
            found = self._lift(rows, data.qacc)
            if float(found @ found) <= self._near * self._near:
                return
            data.qacc_warmstart[:] = data.qacc
        else:
            found = self._lift(rows, data.qacc_warmstart)
        gain = rows.gain
        last: tuple[np.ndarray, np.ndarray] | None = None
        for solve in range(MOST_FRICTION_SOLVES):
            reference[normal] = plain - rows.spread(found) / dt
            self._constrain()
            # a contact that carries nothing has no friction to correct
            off = (self._lift(rows, data.qacc) - found) * rows.pressed(data.efc_force)
            if (np.abs(off) <= self._near + RELATIVE * found).all():
                return
            following = found + gain * off
            if last is not None:
                change, turn = found - last[0], off - last[1]
                moved = np.abs(turn) > np.abs(change) / rows.most
                gain = np.where(moved, np.clip(-change / np.where(moved, turn, 1.0), 1.0, rows.most), gain)
                length = float(turn @ turn)
                if solve % 2 or not length:
                    following = found + gain * off
                else:
                    following = found + rows.gain * off - float(turn @ off) / length * (change + rows.gain * turn)
            last = found, off
            found = np.maximum(following, 0.0)
            data.qacc_warmstart[:] = data.qacc
        self.unsettled += 1
        self.worst = max(self.worst, float(np.abs(off).max()))

    def _lift(self, rows: _Cone | _Pyramid, acceleration: np.ndarray) -> np.ndarray:
        """μ times the slip (m/s) that each contact has after a step with this acceleration."""
        if self._product.size != self._data.nefc:
            self._product = np.zeros(self._data.nefc)
        self._mujoco.mj_mulJacVec(self._model, self._data, self._product, acceleration)
        return rows.lift(self._product)


_NOTHING = np.zeros((0, 2))


def _gains(friction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first and the largest gain of contacts with these coefficients (n, 5)."""
    sliding = friction[:, 0]
    return 1.0 + np.minimum(sliding, FIRST_GAIN) ** 2, 1.0 + MOST_GAIN * sliding**2


class _Contacts:
    """The common part of both kinds of cone: rows of the normal direction, and the lift that friction must take back, μ times
    the slip (m/s)."""

    normal: np.ndarray
    _before: np.ndarray

    def rests(self, velocity: np.ndarray, near: float) -> bool:
        """Whether nothing slips, nor arrives: all μ|v| together below ``near`` (m/s), all approaches below ``ARRIVING`` times
        that. Sums of squares, which are a few times as quick as the largest."""
        slip, approach = self._before, velocity[self.normal]
        static = float(np.vdot(slip, slip)) < near * near
        return static and float(approach @ approach) < (ARRIVING * near) ** 2


class _Cone(_Contacts):
    """Rows of elliptic contacts: the normal one, then slip, spin and rolling, each with a coefficient of its own."""

    def __init__(self, address: np.ndarray, dim: np.ndarray, friction: np.ndarray):
        most = int(dim.max()) - 1
        places = np.arange(most)
        live = places < (dim - 1)[:, None]
        self.normal = address
        self._rows = np.where(live, address[:, None] + 1 + places, address[:, None])
        self._live = self._rows[live]
        self._friction = friction[:, :most] * live
        self.gain, self.most = _gains(friction)

    def begin(self, velocity: np.ndarray, reference: np.ndarray, dt: float) -> None:
        """Let friction take back all slip at once, as far as it reaches."""
        self._before = self._friction * velocity[self._rows]
        self._scaled = self._friction * dt
        reference[self._live] = velocity[self._live] / -dt

    def lift(self, product: np.ndarray) -> np.ndarray:
        slip = product[self._rows]
        slip *= self._scaled
        slip += self._before
        lifted: np.ndarray = np.sqrt(np.einsum("ij,ij->i", slip, slip))
        return lifted

    def creep(self) -> np.ndarray:
        """μ times the slip (m/s) before the step."""
        lifted: np.ndarray = np.sqrt(np.einsum("ij,ij->i", self._before, self._before))
        return lifted

    def pressed(self, force: np.ndarray) -> np.ndarray:
        pressed: np.ndarray = force[self.normal] > 0.0
        return pressed

    def spread(self, values: np.ndarray) -> np.ndarray:
        return values


class _Pyramid(_Contacts):
    """Rows of pyramidal contacts: two edges for each axis, normal plus and minus μ times the axis."""

    def __init__(self, address: np.ndarray, dim: np.ndarray, friction: np.ndarray):
        most = int(dim.max()) - 1
        places = np.arange(most)
        self._live = places < (dim - 1)[:, None]
        self._plus = np.where(self._live, address[:, None] + 2 * places, address[:, None])
        self._minus = np.where(self._live, self._plus + 1, address[:, None])
        self.normal = np.concatenate([self._plus[self._live], self._minus[self._live]])
        values = np.broadcast_to(np.arange(address.size)[:, None], self._live.shape)[self._live]
        self._contact_of_row = np.concatenate([values, values])
        self.gain, self.most = _gains(friction)

    def begin(self, velocity: np.ndarray, reference: np.ndarray, dt: float) -> None:
        plus, minus, live, self._dt = self._plus, self._minus, self._live, dt
        self._before = 0.5 * (velocity[plus] - velocity[minus])
        middle = 0.5 * (reference[plus] + reference[minus])
        reference[plus[live]] = (middle - self._before / dt)[live]
        reference[minus[live]] = (middle + self._before / dt)[live]

    def lift(self, product: np.ndarray) -> np.ndarray:
        slip = self._before + 0.5 * self._dt * (product[self._plus] - product[self._minus])
        lifted: np.ndarray = np.abs(slip).max(axis=1)
        return lifted

    def creep(self) -> np.ndarray:
        lifted: np.ndarray = np.abs(self._before).max(axis=1)
        return lifted

    def pressed(self, force: np.ndarray) -> np.ndarray:
        return np.bincount(self._contact_of_row, force[self.normal], self.gain.size) > 0.0

    def spread(self, values: np.ndarray) -> np.ndarray:
        spread: np.ndarray = values[self._contact_of_row]
        return spread
