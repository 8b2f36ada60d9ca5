"""Position limits of joints in Rapier: hard, inelastic stops within the step in which a joint reaches them.

Rapier stops a joint once it is beyond its limit: its velocity is then at least e (limit − q), with a rate e that follows from
the softness of the joint. So before each step the limit of a joint that may reach a stop, at the distance d, is set to q + δ,
with a rate e = −d / (δ dt): its velocity is then at least −d / dt, and the joint ends the step at the stop or before it
(measured: within round-off at 1 and 4 ms, docs/records/rapier-joints.md). A joint at its stop, or beyond it, has the true limit
and the error reduction of contact.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.engines.rapier.coordinates import LiveMultibodies
from simspec.engines.rapier.multibodies import AXIS_OF, STIFF, Multibodies, limit_softness, limits_in_units, unit_of

SUDDEN = 200.0
"""m/s or rad/s by which the velocity of a joint without a motor may change in a step in which it stops exactly; if it changes
by more, it may pass its limit by one step."""
GRADUAL = 1e3
"""m/s² or rad/s²: the same of a joint with a motor, whose target Rapier clips to the limits: they are therefore set only close
to a stop."""
GRAINS = 4.0
"""Spacings of single precision by which the limit of a joint with a motor is beyond its position."""


@dataclass(frozen=True, slots=True)
class LimitedJoint:
    """A limited joint: the place of its coordinate, its limits, and Rapier's unit of its position."""

    handle: Any
    axis: Any
    at: int
    low: float
    high: float
    unit: float
    motor: bool


def softness(rapier: Any, timestep: float, ratio: float) -> Any:
    """The softness of a joint with ω dt = ``STIFF`` and a rate of −``ratio`` / dt."""
    return rapier.SpringCoefficients(STIFF / (2.0 * math.pi * timestep), -0.5 * STIFF * (1.0 + 1.0 / ratio))


class JointStops:
    """The limited joints of a world."""

    def __init__(self, built: Multibodies):
        self._rapier = built.rapier
        self._stops: list[LimitedJoint] = []
        for number, link in enumerate(built.links):
            limits = getattr(link.joint, "position_limits", None)
            if limits is None:
                continue
            axis = getattr(built.rapier.JointAxis, AXIS_OF[link.kind])
            low, high = limits_in_units(link.kind, limits, link.joint.name)
            motor = bool(link.joint.dry_friction) or link.joint.servo is not None
            at, unit = built.places[number], unit_of(link.kind)
            self._stops.append(LimitedJoint(built.joints[number], axis, at, low, high, unit, motor))
        self._at = np.array([stop.at for stop in self._stops], dtype=np.intp)
        self._ends = np.array([(stop.low, stop.high) for stop in self._stops], dtype=float).reshape(-1, 2)
        self._units = np.array([stop.unit for stop in self._stops])
        self._motors = np.array([stop.motor for stop in self._stops], dtype=bool)

    def arm(self, live: LiveMultibodies) -> None:
        """Set the limits of the joints that may reach a stop in the next step."""
        if not self._stops:
            return
        timestep = float(live.world.integration_parameters.dt)
        q, v = live.positions()[self._at], np.abs(live.rates()[self._at])
        lower, upper = self._ends[:, 0], self._ends[:, 1]
        away = np.minimum(q - lower, upper - q)
        sudden = np.where(self._motors, timestep * GRADUAL, SUDDEN)
        near = away <= timestep * (2.0 * v + self._units * sudden)
        for number in np.flatnonzero(near).tolist():
            self._bound(live, self._stops[number], float(q[number]), timestep)
        armed = set(np.flatnonzero(near).tolist())
        self.disarm(live, live.armed - armed)
        live.armed = armed

    def disarm(self, live: LiveMultibodies, joints: Collection[int] | None = None) -> None:
        """Give joints (numbers, None: all whose limits are those of the next step) their true limits."""
        soft = limit_softness(self._rapier, float(live.world.integration_parameters.dt))
        for number in sorted(live.armed if joints is None else joints):
            self._set(live, self._stops[number], self._stops[number].low, self._stops[number].high, soft)
        if joints is None:
            live.armed = set()

    def _bound(self, live: LiveMultibodies, stop: LimitedJoint, q: float, timestep: float) -> None:
        lower = q - stop.low <= stop.high - q
        away = q - stop.low if lower else stop.high - q
        side = 1.0 if lower else -1.0
        grain = float(np.spacing(np.float32(abs(q)))) * GRAINS
        step = min(away, grain) if stop.motor else away
        bound = float(np.float32(q + side * step))
        if away > 0.0 and bound != q:
            ratio = away / abs(bound - q)
            self._set(live, stop, *self._range(stop, lower, bound), softness(self._rapier, timestep, ratio))
            return
        end = stop.low if lower else stop.high
        nearest = float(np.nextafter(np.float32(q), np.float32(side * math.inf)))
        bound = max(end, nearest) if lower else min(end, nearest)
        self._set(live, stop, *self._range(stop, lower, bound), limit_softness(self._rapier, timestep))

    @staticmethod
    def _range(stop: LimitedJoint, lower: bool, bound: float) -> tuple[float, float]:
        """Limits with ``bound`` in place of the one that is near."""
        return (bound, max(stop.high, bound)) if lower else (min(stop.low, bound), bound)

    @staticmethod
    def _set(live: LiveMultibodies, stop: LimitedJoint, low: float, high: float, soft: Any) -> None:
        data = live.world.multibody_joints[stop.handle].data
        data.set_limits(stop.axis, low, high)
        data.softness = soft
