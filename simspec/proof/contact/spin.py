"""Contact probes of friction moments: a ball that spins about the normal, and one that rolls."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from simspec.proof.contact.bodies import ball, floor
from simspec.proof.contact.impact import subject
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial
from simspec.world.types import Body

RADIUS, MASS = 0.1, 1.0
"""Of the balls (m, kg), where the law does not want larger ones."""
STEPS, TIME = 300, 0.15
"""In the longer of the two (steps, s) a ball is slowed down to rest: one step more or less, as a probe's resolution, is 0.3 %,
and where friction takes slip back at a rate of 100/s, its fading is over within the last 7 %."""
MEASURED = (0.1, 0.6)
"""Shares of these steps between which the deceleration is taken: after the contact has settled, and before the last tenth
of the speed, where engines whose friction takes slip back by a rate fade out instead of stopping."""
DECELERATION_SHARE = 0.02
"""Of the expected deceleration. The best engines keep to 0.1 %, a soft elliptic cone to 0.5 % in spin; both moments
share one cone with the sliding force there, which costs a rolling ball up to 0.5 % at SLENDERNESS."""
REST_SHARE = 1e-3
"""Of the initial speed, what may be left at twice the time to rest."""
SLENDERNESS = 10.0
"""Least ratio of the ball's radius to c/μ: a ball that rolls to rest needs the sliding friction (5/7) c/r, here at most
1/14 of what there is."""
LARGEST_RADIUS = 2.0
"""m: laws whose balls would have to be larger (c above 0.2 μ m) are not measured by rolling."""
LARGEST_MOMENT = 0.2
"""m: laws with a larger c are not measured by spin. No contact face is as large, and the balls would be tens of metres."""
BALL_INERTIA = 0.4
"""I / (m r²) of a solid ball."""
LARGEST_TURN = 0.005
"""rad in a step: the fastest spin. Large moments get a larger ball for it: at 0.5 rad in a step balls leave the spot in one
engine, and lose 6 to 40 % of the moment (measured, c of 0.02 to 1 m)."""
SPINS = {"left": 1.0, "right": -1.0}
DIRECTIONS = (0.0, 35.0, 90.0, 180.0)
"""Degrees from the x axis: along the axes, which some engines' friction directions follow, and off them."""


class Torsional(Probe):
    """Balls that spin about the vertical axis on the spot, in both senses."""

    NAME = "torsional"
    MEANING = "spin-down of a ball about the normal, against c N / I"

    def applies(self, law: Law) -> bool:
        """See ``LARGEST_MOMENT``."""
        return law.pair.collide and 0.0 < law.pair.torsional_friction <= LARGEST_MOMENT

    def _radius(self, law: Law) -> float:
        turned = law.pair.torsional_friction * GRAVITY * steps_of(law) * law.timestep**2
        return max(RADIUS, math.sqrt(turned / (BALL_INERTIA * LARGEST_TURN)))

    def _deceleration(self, law: Law) -> float:
        return law.pair.torsional_friction * GRAVITY / (BALL_INERTIA * self._radius(law) ** 2)

    def trials(self, law: Law) -> Sequence[Trial]:
        radius, speed = self._radius(law), self._deceleration(law) * steps_of(law) * law.timestep
        bodies: list[Body] = [floor(law)]
        for column, (name, sign) in enumerate(SPINS.items()):
            velocity = (0.0, 0.0, 0.0, 0.0, 0.0, sign * speed)
            at = (30.0 * radius * column, 0.0, radius)
            bodies.append(ball(law, name, radius, MASS, at, velocity))
        return [Trial(tuple(bodies), (Phase(2 * steps_of(law)),))]

    def wanted(self, law: Law) -> Sequence[Figure]:
        expected = self._deceleration(law)
        return _wanted(self.NAME, law, expected, expected * steps_of(law) * law.timestep, "spin", "rad/s")

    def reference(self, law: Law, figure: Figure) -> Figure | None:
        return _of_quantity(self.wanted(law), figure)

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        expected = self._deceleration(law)
        spins = {name: sign * motions[0].velocity[name][:, 5] for name, sign in SPINS.items()}
        return _deceleration_figures(self.NAME, law, spins, expected, "spin", "rad/s")


class Rolling(Probe):
    """Balls that roll without slipping, in several directions."""

    NAME = "rolling"
    MEANING = "deceleration of a ball that rolls without slipping, against (5/7) g c / r"

    def applies(self, law: Law) -> bool:
        """Without sliding friction nothing rolls; see ``LARGEST_RADIUS``."""
        pair = law.pair
        return (
            pair.collide and pair.rolling_friction > 0.0 and pair.friction > 0.0 and self._radius(law) <= LARGEST_RADIUS
        )

    def _radius(self, law: Law) -> float:
        return max(RADIUS, SLENDERNESS * law.pair.rolling_friction / law.pair.friction)

    def _deceleration(self, law: Law) -> float:
        return law.pair.rolling_friction * GRAVITY / (self._radius(law) * (1.0 + BALL_INERTIA))

    def trials(self, law: Law) -> Sequence[Trial]:
        radius = self._radius(law)
        speed = self._deceleration(law) * steps_of(law) * law.timestep
        bodies: list[Body] = [floor(law)]
        for row, angle in enumerate(DIRECTIONS):
            along, across = math.cos(math.radians(angle)), math.sin(math.radians(angle))
            turn = speed / radius
            velocity = (speed * along, speed * across, 0.0, -turn * across, turn * along, 0.0)
            bodies.append(ball(law, f"ball_{row}", radius, MASS, (0.0, 5.0 * radius * row, radius), velocity))
        return [Trial(tuple(bodies), (Phase(2 * steps_of(law)),))]

    def wanted(self, law: Law) -> Sequence[Figure]:
        expected = self._deceleration(law)
        return _wanted(self.NAME, law, expected, expected * steps_of(law) * law.timestep, "speed", "m/s")

    def reference(self, law: Law, figure: Figure) -> Figure | None:
        return _of_quantity(self.wanted(law), figure)

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        speeds = {}
        for row, angle in enumerate(DIRECTIONS):
            along = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
            speeds[f"rolling at {angle:g}°"] = motions[0].velocity[f"ball_{row}"][:, :2] @ along
        return _deceleration_figures(self.NAME, law, speeds, self._deceleration(law), "speed", "m/s")


def steps_of(law: Law) -> int:
    """Steps in which a ball comes to rest."""
    return max(STEPS, math.ceil(TIME / law.timestep))


def _wanted(probe: str, law: Law, expected: float, initial: float, quantity: str, unit: str) -> list[Figure]:
    """What must be measured of balls with the speed ``initial``; their cases name the ball that came out worst."""
    slowing = (f"{unit.removesuffix('/s')}/s²", expected, None, DECELERATION_SHARE * expected)
    left = (unit, 0.0, None, REST_SHARE * initial)
    return [
        Figure(probe, subject(law), "", "deceleration", *slowing, without=0.0),
        Figure(probe, subject(law), "", quantity, *left, without=initial),
    ]


def _of_quantity(wanted: Sequence[Figure], figure: Figure) -> Figure | None:
    named = (figure.probe, figure.quantity)
    return next((one for one in wanted if (one.probe, one.quantity) == named), None)


def _deceleration_figures(
    probe: str, law: Law, speeds: Mapping[str, np.ndarray], expected: float, quantity: str, unit: str
) -> list[Figure]:
    """The worst deceleration, and the worst speed left, of several balls' speeds (n,)."""
    decelerations = {case: deceleration(speed, law.timestep) for case, speed in speeds.items()}
    left = {case: float(speed[-1]) for case, speed in speeds.items()}
    slowing = max(decelerations, key=lambda case: _off(decelerations[case], expected))
    moving = max(left, key=lambda case: _off(left[case], 0.0))
    initial = next(iter(speeds.values()))[0]
    return [
        Figure(
            probe,
            subject(law),
            f"{slowing}, worst of {len(speeds)}",
            "deceleration",
            f"{unit.removesuffix('/s')}/s²",
            expected,
            decelerations[slowing],
            DECELERATION_SHARE * expected,
        ),
        Figure(
            probe, subject(law), f"{moving}, at twice the time to rest", quantity, unit, 0.0, left[moving],
            REST_SHARE * initial,
        ),
    ]  # fmt: skip


def _off(measured: float, expected: float) -> float:
    return math.inf if math.isnan(measured) else abs(measured - expected)


def deceleration(speed: np.ndarray, timestep: float) -> float:
    """Mean deceleration in the measured part of the speeds (n,) at every step, which end at twice the time to rest."""
    start, end = (int(share * (len(speed) - 1) / 2) for share in MEASURED)
    return float((speed[start] - speed[end]) / ((end - start) * timestep))


PROBES: Mapping[str, Probe] = {probe.NAME: probe for probe in (Torsional(), Rolling())}
