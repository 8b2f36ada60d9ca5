"""Contact probes of friction of bodies that turn: balls that spin about the normal, balls that roll, and bodies that
slide with spin (an eccentric ball and a tripod). Of the latter normal forces follow from the levers of friction, and friction
from the slip of each point; the truth is the equation of motion of the sliding body (Newton and Euler)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from simspec.proof.contact.probe import (
    GRAVITY,
    Phase,
    Probe,
    ProbeFigure,
    ProbeLaw,
    ProbeTrial,
    TrialMotion,
    direction,
    furthest,
    nearest,
    signed_size,
)
from simspec.proof.contact.worlds import ball, cluster, floor
from simspec.world.types import Body, Vector3

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
SLIDE_STEPS, FASTEST = 100, 2.5
"""Steps in which friction takes ``SLOWED`` of the speed, and the largest speed (m/s), at which the steps are fewer."""
SLOWED = 0.4
SPIN, ARM = 0.7, 0.3
"""Speed by spin, over that of the slide, at this distance (m) from the centre of mass: no point of contact is near rest."""
FAR = 1e3
"""Of the friction: a point as far as this lies outside every cone, and its nearest on the cone is what opposes it."""
FINER = 20
"""Steps of the equation of motion in one of the world's: at the world's own it is 50 % off where slip crosses a pyramid's axis
(16 ms, μ 1.2), at these 1 %."""
SLIDE_TOLERANCE, SLIDE_STEPS_OFF = 0.03, 2.0
"""Of the change of velocity, and in steps' shares of it, the larger: the direction of slip and the lever of the normal force
are those of a step's beginning or of its end."""
SLIDER_RADIUS, SLIDER_SPACING = 0.1, 10.0
"""Of the balls that slide, and between sliders (m)."""
SLIDERS: Mapping[str, tuple[Vector3, ...]] = {
    "eccentric ball": ((0.03, 0.0, 0.01),),
    "tripod": ((0.3, 0.0, 0.0), (-0.15, 0.26, 0.0), (-0.15, -0.26, 0.0)),
}
"""Centres of the balls, from the centre of mass (m); see :func:`centres` for a tripod's height."""
HEIGHT, TIPS = 0.2, 0.1
"""m: of a tripod's centre of mass above the floor, and at most that over μ; it would tip over two feet from 0.15/μ on."""
INERTIA: Mapping[str, float] = {"eccentric ball": 0.006, "tripod": 0.05}
"""kg m² about every axis."""


class _Slowing(Probe):
    """Balls that friction slows down to rest: the worst deceleration, and the worst speed that is left at twice the time."""

    SPEED: tuple[str, str]
    """Name and unit of the speed."""

    def deceleration(self, law: ProbeLaw) -> float:
        raise NotImplementedError

    def speeds(self, law: ProbeLaw, motion: TrialMotion) -> Mapping[str, np.ndarray]:
        """Speeds (n,) by case."""
        raise NotImplementedError

    def initial(self, law: ProbeLaw) -> float:
        return self.deceleration(law) * steps_of(law) * law.timestep

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        """Their cases name the ball that came out worst, once they are measured."""
        expected, initial, (speed, unit) = self.deceleration(law), self.initial(law), self.SPEED
        slowing = f"{unit.removesuffix('/s')}/s²"
        return [
            self.figure(law, "", "deceleration", slowing, expected, DECELERATION_SHARE * expected, without=0.0),
            self.figure(law, "", speed, unit, 0.0, REST_SHARE * initial, without=initial),
        ]

    def reference(self, law: ProbeLaw, figure: ProbeFigure) -> ProbeFigure | None:
        named = (figure.probe, figure.quantity)
        return next((figure for figure in self.wanted(law) if (figure.probe, figure.quantity) == named), None)

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[Mapping[str, Any]]:
        speeds = self.speeds(law, motions[0])
        decelerations = {case: deceleration(speed, law.timestep) for case, speed in speeds.items()}
        left = {case: float(speed[-1]) for case, speed in speeds.items()}
        slowing, moving = furthest(decelerations, self.deceleration(law)), furthest(left)
        # of the engine's own initial speed
        tolerance = REST_SHARE * next(iter(speeds.values()))[0]
        return [
            {"measured": decelerations[slowing], "case": f"{slowing}, worst of {len(speeds)}"},
            {"measured": left[moving], "case": f"{moving}, at twice the time to rest", "tolerance": tolerance},
        ]


class Torsional(_Slowing):
    """Spin-down of balls about the normal on the spot, in both senses, against c N / I."""

    NAME = "torsional"
    SPEED = ("spin", "rad/s")

    def applies(self, law: ProbeLaw) -> bool:
        """See ``LARGEST_MOMENT``."""
        return law.pair.collide and 0.0 < law.pair.torsional_friction <= LARGEST_MOMENT

    def _radius(self, law: ProbeLaw) -> float:
        turned = law.pair.torsional_friction * GRAVITY * steps_of(law) * law.timestep**2
        return max(RADIUS, math.sqrt(turned / (BALL_INERTIA * LARGEST_TURN)))

    def deceleration(self, law: ProbeLaw) -> float:
        return law.pair.torsional_friction * GRAVITY / (BALL_INERTIA * self._radius(law) ** 2)

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        radius, bodies = self._radius(law), [floor(law)]
        for column, (name, sign) in enumerate(SPINS.items()):
            velocity = (0.0, 0.0, 0.0, 0.0, 0.0, sign * self.initial(law))
            bodies.append(ball(law, name, radius, MASS, (30.0 * radius * column, 0.0, radius), velocity))
        return [ProbeTrial(tuple(bodies), (Phase(2 * steps_of(law)),))]

    def speeds(self, law: ProbeLaw, motion: TrialMotion) -> Mapping[str, np.ndarray]:
        return {name: sign * motion.velocity[name][:, 5] for name, sign in SPINS.items()}


class Rolling(_Slowing):
    """Deceleration of balls that roll without slipping in several directions, against (5/7) g c / r."""

    NAME = "rolling"
    SPEED = ("speed", "m/s")

    def applies(self, law: ProbeLaw) -> bool:
        """Without sliding friction nothing rolls; see ``LARGEST_RADIUS``."""
        friction, rolling = law.pair.friction, law.pair.rolling_friction
        return law.pair.collide and rolling > 0.0 and friction > 0.0 and self._radius(law) <= LARGEST_RADIUS

    def _radius(self, law: ProbeLaw) -> float:
        return max(RADIUS, SLENDERNESS * law.pair.rolling_friction / law.pair.friction)

    def deceleration(self, law: ProbeLaw) -> float:
        return law.pair.rolling_friction * GRAVITY / (self._radius(law) * (1.0 + BALL_INERTIA))

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        radius, speed, bodies = self._radius(law), self.initial(law), [floor(law)]
        for row, angle in enumerate(DIRECTIONS):
            (along, across), turn = direction(angle).tolist(), speed / radius
            velocity = (speed * along, speed * across, 0.0, -turn * across, turn * along, 0.0)
            bodies.append(ball(law, f"ball_{row}", radius, MASS, (0.0, 5.0 * radius * row, radius), velocity))
        return [ProbeTrial(tuple(bodies), (Phase(2 * steps_of(law)),))]

    def speeds(self, law: ProbeLaw, motion: TrialMotion) -> Mapping[str, np.ndarray]:
        return {
            f"rolling at {angle:g}°": motion.velocity[f"ball_{row}"][:, :2] @ direction(angle)
            for row, angle in enumerate(DIRECTIONS)
        }


def steps_of(law: ProbeLaw) -> int:
    """Steps in which a ball comes to rest."""
    return law.steps(TIME, STEPS)


def deceleration(speed: np.ndarray, timestep: float) -> float:
    """Mean deceleration in the measured part of the speeds (n,) at every step, which end at twice the time to rest."""
    start, end = (int(share * (len(speed) - 1) / 2) for share in MEASURED)
    return float((speed[start] - speed[end]) / ((end - start) * timestep))


class Slide(Probe):
    """Velocity and spin of an eccentric ball and a tripod after a slide with spin, against their equation of motion."""

    NAME = "slide-spin"

    def applies(self, law: ProbeLaw) -> bool:
        """Torsional and rolling friction are moments that the equation has no place for."""
        return (
            law.is_rigid
            and law.pair.friction > 0.0
            and not law.pair.torsional_friction
            and not law.pair.rolling_friction
        )

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        bodies: list[Body] = [floor(law)]
        for number, slider in enumerate(SLIDERS):
            places = centres(law, slider)
            velocity, spin = start(law)
            at = (SLIDER_SPACING * number, 0.0, SLIDER_RADIUS - places[0][2])
            balls = {str(index): place for index, place in enumerate(places)}
            state = (*velocity.tolist(), *spin.tolist())
            name = slider.replace(" ", "_")
            bodies.append(cluster(law, name, balls, SLIDER_RADIUS, MASS, INERTIA[slider], at, velocity=state))
        return [ProbeTrial(tuple(bodies), (Phase(slide_steps(law)),))]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        figures = []
        for slider in SLIDERS:
            tolerance = max(SLIDE_TOLERANCE, SLIDE_STEPS_OFF / slide_steps(law))
            for quantity, unit, first, last in zip(
                ("velocity", "spin"), ("m/s", "rad/s"), start(law), slid(law, slider), strict=True
            ):
                size = float(np.linalg.norm(last - first))
                named = (slider, f"change of {quantity}", unit)
                figures.append(self.figure(law, *named, size, tolerance * size, without=0.0))
        return figures

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float]:
        readings = []
        for slider in SLIDERS:
            state = motions[0].velocity[slider.replace(" ", "_")][slide_steps(law)]
            for first, last, seen in zip(start(law), slid(law, slider), (state[:3], state[3:]), strict=True):
                readings.append(signed_size(seen - first, last - first))
        return readings


def centres(law: ProbeLaw, slider: str) -> list[Vector3]:
    """Centres of a slider's balls, from its centre of mass (m)."""
    raised = SLIDER_RADIUS - min(HEIGHT, TIPS / law.pair.friction) if slider == "tripod" else 0.0
    return [(x, y, z + raised) for x, y, z in SLIDERS[slider]]


def start(law: ProbeLaw) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (3,) of the centre of mass and spin (3,) at the start of a slide."""
    speed = min(FASTEST, SLIDE_STEPS * law.timestep * law.pair.friction * GRAVITY / SLOWED)
    return np.array([0.8 * speed, 0.6 * speed, 0.0]), np.array([0.0, 0.0, SPIN * speed / ARM])


def slide_steps(law: ProbeLaw) -> int:
    """Steps after which a slide is measured."""
    speed = float(np.linalg.norm(start(law)[0]))
    return max(1, round(SLOWED * speed / (law.pair.friction * GRAVITY) / law.timestep))


def slid(law: ProbeLaw, slider: str) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (3,) of the centre of mass and spin (3,) of a body of balls at the end of a slide.

    Unknown are the normal forces N_i alone: friction is d_i N_i, d_i the section of the cone of size μ opposite to the slip of
    the point, and no ball's centre accelerates along the vertical: g + Σ N (…)/m + (α × c)_z + (ω × (ω × c))_z = 0.
    """
    pair = replace(law.pair, first="", second="", restitution=0.0, restitution_threshold=0.0)
    return _slid(ProbeLaw(pair, law.friction_cone, law.timestep), slider)


@lru_cache(maxsize=64)
def _slid(law: ProbeLaw, slider: str) -> tuple[np.ndarray, np.ndarray]:
    arms, inertia = np.array(centres(law, slider)), INERTIA[slider]
    velocity, spin = start(law)
    dt = law.timestep / FINER
    for _ in range(FINER * slide_steps(law)):
        x, y, z = arms.T
        low = z - SLIDER_RADIUS
        (vx, vy, _), (wx, wy, wz) = velocity.tolist(), spin.tolist()
        forces = _opposed((vx + wy * low - wz * y).tolist(), (vy + wz * x - wx * low).tolist(), law)
        along, across = forces[:, 0], forces[:, 1]
        turning = np.array([y - low * across, low * along - x, x * across - y * along]) / inertia
        rises = 1.0 / MASS + np.outer(y, turning[0]) - np.outer(x, turning[1])
        falls = GRAVITY - wz * (arms @ spin) + z * float(spin @ spin)
        normal = np.linalg.solve(rises, falls)
        velocity[:2] += dt / MASS * (normal @ forces)
        velocity[2] += dt * (float(normal.sum()) / MASS - GRAVITY)
        spin += dt * (turning @ normal)
        arms = arms @ _turn(dt * spin).T
    velocity.flags.writeable = spin.flags.writeable = False
    return velocity, spin


def _turn(vector: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) of a rotation vector (rad), by Rodrigues' formula."""
    x, y, z = vector.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / angle
    turn: np.ndarray = np.eye(3) + math.sin(angle) * across + (1.0 - math.cos(angle)) * (across @ across)
    return turn


def _opposed(along: Sequence[float], across: Sequence[float], law: ProbeLaw) -> np.ndarray:
    """Friction (n, 2) of points that slide at these velocities (m/s), per newton of their normal forces."""
    friction, cone = law.pair.friction, law.friction_cone
    found = []
    for x, y in zip(along, across, strict=True):
        far = -FAR * friction / math.hypot(x, y)
        found.append(nearest(far * x, far * y, friction, cone))
    return np.array(found)
