"""Contact probes of what is carried by a body that accelerates, and of what spins as it slides.

carrier     A box lies on a slab that speeds up, or on one that turns, at half the acceleration that friction allows: it stays
            where it lies. A law of friction that takes slip back at a rate instead of within the step lets it drift, at its
            acceleration over that rate, whatever the timestep.
slide-spin  A ball with an eccentric centre of mass, and a tripod, slide with spin. Normal forces follow from the levers of
            friction, and friction from the slip of each point; the truth is the equation of motion of the sliding body
            (Newton and Euler).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from simspec.proof.contact.bodies import box, cluster, floor
from simspec.proof.contact.friction import SETTLE
from simspec.proof.contact.impact import subject
from simspec.proof.contact.law import nearest
from simspec.proof.contact.leaning import HELD_SPEED, HELD_WAY
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial
from simspec.world import frames
from simspec.world.types import Body, Vector3

SHARE = 0.5
"""Acceleration of a carrier over the largest that friction transmits."""
CARRIED_TIME, CARRIED_STEPS = 0.3, 40
"""The longer of the two (s, steps)."""
SLAB, SLAB_MASS = (3.0, 3.0, 0.4), 1000.0
"""Of carriers (m, kg): so heavy that what they carry tilts them by less than 1e-4 rad."""
EDGE, MASS = 0.2, 1.0
"""Of what is carried (m, kg): flat, half as high."""
OUT = 1.0
"""m from a turning carrier's axis."""
SPACING = 10.0

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
RADIUS = 0.1
"""Of the balls that slide (m)."""
SLIDERS: Mapping[str, tuple[Vector3, ...]] = {
    "eccentric ball": ((0.03, 0.0, 0.01),),
    "tripod": ((0.3, 0.0, 0.0), (-0.15, 0.26, 0.0), (-0.15, -0.26, 0.0)),
}
"""Centres of the balls, from the centre of mass (m); see :func:`centres` for a tripod's height."""
HEIGHT, TIPS = 0.2, 0.1
"""m: of a tripod's centre of mass above the floor, and at most that over μ; it would tip over two feet from 0.15/μ on."""
INERTIA: Mapping[str, float] = {"eccentric ball": 0.006, "tripod": 0.05}
"""kg m² about every axis."""


class Carrier(Probe):
    """Boxes that lie on slabs that accelerate."""

    NAME = "carrier"
    MEANING = (
        "how far a box slips on a carrier that accelerates at half the limit of friction, along a line and turning"
    )
    CASES = ("speeds up", "turns")

    def applies(self, law: Law) -> bool:
        return law.pair.collide and law.pair.friction > 0.0 and law.pair.hardness.kind == "common" and law.reach.carries

    def _acceleration(self, law: Law) -> float:
        return SHARE * law.pair.friction * GRAVITY

    def _bodies(self, law: Law) -> Iterator[Body]:
        turn = math.sqrt(self._acceleration(law) / OUT)
        height = SLAB[2] / 2.0 + EDGE / 4.0
        states = {
            "speeds up": ((0.0,) * 6, (0.0,) * 6, 0.0),
            "turns": ((0.0, 0.0, 0.0, 0.0, 0.0, turn), (0.0, turn * OUT, 0.0, 0.0, 0.0, turn), OUT),
        }
        for number, case in enumerate(self.CASES):
            carrier, carried, out = states[case]
            x = SPACING * number
            slab, load = f"slab_{number}", f"load_{number}"
            yield box(law, slab, SLAB, SLAB_MASS, (x, 0.0, 0.0), carrier, material=law.pair.first, group=slab)
            yield box(law, load, (EDGE, EDGE, EDGE / 2.0), MASS, (x + out, 0.0, height), carried, group=load)

    def trials(self, law: Law) -> Sequence[Trial]:
        settle = max(10, math.ceil(SETTLE / law.timestep))
        steps = self._steps(law)
        weight = (SLAB_MASS + MASS) * GRAVITY
        held = (0.0, 0.0, weight, 0.0, 0.0, 0.0)
        pushed = ((SLAB_MASS + MASS) * self._acceleration(law), 0.0, weight, 0.0, 0.0, 0.0)
        phases = (
            Phase(settle, settle, {"slab_0": held, "slab_1": held}),
            Phase(steps, steps, {"slab_0": pushed, "slab_1": held}),
        )
        meets = tuple((f"load_{number}", f"slab_{number}") for number in range(len(self.CASES)))
        return [Trial(tuple(self._bodies(law)), phases, meets)]

    def _steps(self, law: Law) -> int:
        return max(CARRIED_STEPS, math.ceil(CARRIED_TIME / law.timestep))

    def wanted(self, law: Law) -> Sequence[Figure]:
        """Without friction the box stays where it is in the world, or goes on along its tangent."""
        time, acceleration = self._steps(law) * law.timestep, self._acceleration(law)
        turn = math.sqrt(acceleration / OUT)
        # a point that turns goes along the tangent for a step: it moves outwards by ω² r dt/2 in a second, or not at all
        # where friction is a spring to where the body lies
        outwards = acceleration * law.timestep / 2.0 * time
        straight = OUT * complex(1.0, turn * time) * complex(math.cos(turn * time), -math.sin(turn * time))
        named = {case: (self.NAME, subject(law), f"a carrier that {case}", "slip", "m") for case in self.CASES}
        held = HELD_WAY + HELD_SPEED * time
        return [
            Figure(*named["speeds up"], 0.0, None, held, without=0.5 * acceleration * time**2),
            Figure(*named["turns"], outwards, None, outwards + held, without=abs(straight - OUT)),
        ]

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        slips = []
        for number in range(len(self.CASES)):
            places = [_seen(motions[0], f"slab_{number}", f"load_{number}", at) for at in (-2, -1)]
            slips.append(float(np.linalg.norm(places[1] - places[0])))
        return [replace(figure, measured=slip) for figure, slip in zip(self.wanted(law), slips, strict=True)]


def _seen(motion: Motion, carrier: str, carried: str, at: int) -> np.ndarray:
    """Where a body's frame is in another's (3,), in m."""
    below, above = motion.pose[carrier][at], motion.pose[carried][at]
    found: np.ndarray = np.array(frames.matrix(tuple(below[3:].tolist()))).T @ (above[:3] - below[:3])
    return found


class Slide(Probe):
    """Bodies on one and on three balls that slide with spin."""

    NAME = "slide-spin"
    MEANING = "velocity and spin of an eccentric ball and a tripod after a slide, against their equation of motion"

    def applies(self, law: Law) -> bool:
        """Torsional and rolling friction are moments that the equation has no place for."""
        return (
            law.pair.collide
            and law.pair.friction > 0.0
            and law.pair.hardness.kind == "common"
            and not law.pair.torsional_friction
            and not law.pair.rolling_friction
        )

    def trials(self, law: Law) -> Sequence[Trial]:
        bodies: list[Body] = [floor(law)]
        for number, slider in enumerate(SLIDERS):
            places = centres(law, slider)
            velocity, spin = start(law)
            at = (SPACING * number, 0.0, RADIUS - places[0][2])
            balls = {str(index): place for index, place in enumerate(places)}
            state = (*velocity.tolist(), *spin.tolist())
            name = slider.replace(" ", "_")
            bodies.append(cluster(law, name, balls, RADIUS, MASS, INERTIA[slider], at, velocity=state))
        return [Trial(tuple(bodies), (Phase(steps(law)),))]

    def wanted(self, law: Law) -> Sequence[Figure]:
        figures = []
        for slider in SLIDERS:
            tolerance = max(SLIDE_TOLERANCE, SLIDE_STEPS_OFF / steps(law))
            for quantity, unit, first, last in zip(
                ("velocity", "spin"), ("m/s", "rad/s"), start(law), slid(law, slider), strict=True
            ):
                size = float(np.linalg.norm(last - first))
                named = (self.NAME, subject(law), slider, f"change of {quantity}", unit)
                figures.append(Figure(*named, size, None, tolerance * size, without=0.0))
        return figures

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        values = []
        for slider in SLIDERS:
            state = motions[0].velocity[slider.replace(" ", "_")][steps(law)]
            for first, last, seen in zip(start(law), slid(law, slider), (state[:3], state[3:]), strict=True):
                size, off = float(np.linalg.norm(last - first)), float(np.linalg.norm(seen - last))
                values.append(size + math.copysign(off, float(np.linalg.norm(seen - first)) - size))
        return [replace(figure, measured=value) for figure, value in zip(self.wanted(law), values, strict=True)]


def centres(law: Law, slider: str) -> list[Vector3]:
    """Centres of a slider's balls, from its centre of mass (m)."""
    raised = RADIUS - min(HEIGHT, TIPS / law.pair.friction) if slider == "tripod" else 0.0
    return [(x, y, z + raised) for x, y, z in SLIDERS[slider]]


def start(law: Law) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (3,) of the centre of mass and spin (3,) at the start of a slide."""
    speed = min(FASTEST, SLIDE_STEPS * law.timestep * law.pair.friction * GRAVITY / SLOWED)
    return np.array([0.8 * speed, 0.6 * speed, 0.0]), np.array([0.0, 0.0, SPIN * speed / ARM])


def steps(law: Law) -> int:
    """Steps after which a slide is measured."""
    speed = float(np.linalg.norm(start(law)[0]))
    return max(1, round(SLOWED * speed / (law.pair.friction * GRAVITY) / law.timestep))


def slid(law: Law, slider: str) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (3,) of the centre of mass and spin (3,) of a body of balls at the end of a slide.

    Unknown are the normal forces N_i alone: friction is d_i N_i, d_i the section of the cone of size μ opposite to the slip of
    the point, and no ball's centre accelerates along the vertical: g + Σ N (…)/m + (α × c)_z + (ω × (ω × c))_z = 0.
    """
    pair = replace(law.pair, first="", second="", restitution=0.0, restitution_threshold=0.0)
    return _slid(Law(pair, law.friction_cone, law.timestep), slider)


@lru_cache(maxsize=64)
def _slid(law: Law, slider: str) -> tuple[np.ndarray, np.ndarray]:
    arms, inertia = np.array(centres(law, slider)), INERTIA[slider]
    velocity, spin = start(law)
    dt = law.timestep / FINER
    for _ in range(FINER * steps(law)):
        x, y, z = arms.T
        low = z - RADIUS
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


def _opposed(along: Sequence[float], across: Sequence[float], law: Law) -> np.ndarray:
    """Friction (n, 2) of points that slide at these velocities (m/s), per newton of their normal forces."""
    friction, cone = law.pair.friction, law.friction_cone
    found = []
    for x, y in zip(along, across, strict=True):
        far = -FAR * friction / math.hypot(x, y)
        found.append(nearest(far * x, far * y, friction, cone))
    return np.array(found)


PROBES: Mapping[str, Probe] = {probe.NAME: probe for probe in (Carrier(), Slide())}
