"""Contact probes of friction that changes the normal force: a rod on a wall, a clamp on a post, and a pile of balls.

In the probes of one slider (``friction``) the normal force is the weight, whatever friction does. Here it follows from
friction itself, so that a solver that bounds friction by the normal forces of the frictionless problem drops what must stand.
All contact points are those of balls, which every engine finds exactly.

rod    Two balls on a light rod, one on the floor, one at a wall of the same material, at an angle θ. With N₂ = μ N₁ and
       N₁ + μ N₂ = m g the moment about the centre vanishes at the least friction that holds the rod.
clamp  Two balls of one body at opposite faces of a post, at a height h from each other, the centre of mass at a distance d,
under a moment
       T. Without slip N h = m g d + T; where it slips N (h − 2 μ d) = T, so that friction multiplies the frictionless force
       T/h. It holds from T = m g (h / 2 μ − d) on.
jam    A clamp with a gain 2 μ d / h above 1: N (h − 2 μ d) = T has no solution for a moment T > 0, so that it stands under
       every moment, at N h = m g d + T. The smaller T, the less of N is left in the frictionless problem, N = T / h, from which
       solvers that sweep over contacts begin. At T = 0 standing and falling both solve the equations: nothing is measured.
pile   A ball on two or three others: it stands up to the angle φ from the vertical between centres with tan(φ/2) = μ, for
       which the moments about each lower ball's centre demand equal friction above and below.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.proof.contact.friction import PUSH_TOLERANCE
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
)
from simspec.proof.contact.worlds import ball, cluster, fixed_box, floor
from simspec.world import frames
from simspec.world.frames import vector3
from simspec.world.types import Body

STANDS, SLIPS = (1.1, 1.7), (0.6, 0.9)
"""Friction over the least friction that holds: near the threshold and well away from it, to both sides."""
STANDING_WAY = 2e-4
"""m: twice the depth that rigid contact may have at rest (``impact.REST_DEPTH``), since a body settles on two contacts."""
STANDING_SPEED = 1e-4
"""m/s: the creep below the limit of friction that sliders may have (``friction.CREEP``)."""
STANDING_TIME, STANDING_STEPS = 0.3, 40
"""The longer of the two (s, steps). A rod at 0.9 of the threshold moves by centimetres in this time."""
SLIPPED, SLIPPED_SHARE = 0.1, 0.4
"""The lesser of the two (m, share of the way that the equation of motion holds for): how far a body slips before it is
measured. Far over the settling of any contact, and short of a change of regime."""
SLIP_TIME = 1.0
"""s: in which the slowest slip is measured at the latest."""
SLIP_TOLERANCE = 0.03
"""Of the way, at least: the promise at 1 ms. Near the threshold it is what ``friction.PUSH_TOLERANCE`` of friction changes
(a tenth of the way of a pile at 0.9 of the threshold)."""
TURNS = {"elliptic": (0.0, 35.0), "pyramid-inscribed": (0.0, 90.0), "pyramid-circumscribed": (0.0, 90.0)}
"""Directions (degrees) of the plane of motion, by cone: along a pyramid's axes the law is the same in all engines."""
TOUCH = 1e-6
"""m: overlap of all contacts at the start, so that none opens for the first step."""
SPACING = 8.0
"""m between bodies that do not meet."""
WALL = (0.2, 1.0, 4.0)
"""m: thickness, width and height of walls."""


@dataclass(frozen=True)
class LeaningCase:
    """One body or pile: its name, direction (degrees), friction over the least that holds, and place in the grid."""

    name: str
    turn: float
    ratio: float
    number: int

    @property
    def stands(self) -> bool:
        return self.ratio > 1.0

    @property
    def centre(self) -> np.ndarray:
        return np.array([SPACING * (self.number % 4), SPACING * (self.number // 4), 0.0])

    def place(self, x: float, z: float) -> tuple[float, float, float]:
        """A point of the plane of motion, in world axes (m)."""
        return vector3((self.centre + np.array([*x * direction(self.turn), z])).tolist())

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        return frames.from_axis_angle((0.0, 0.0, 1.0), math.radians(self.turn))


class _Leaning(Probe):
    """The common part of the three: cases that stand are held to rest, cases that slip to their equation of motion."""

    def applies(self, law: ProbeLaw) -> bool:
        """Rolling friction is a moment that the closed forms have no place for."""
        return (
            law.is_rigid
            and law.pair.friction > 0.0
            and not law.pair.rolling_friction
            and law.reach.leans
            and bool(self.cases(law))
        )

    def angle(self, friction: float) -> float | None:
        """The angle at which this friction is the least that holds; None where there is none in the range that is probed."""
        raise NotImplementedError

    def bodies(self, law: ProbeLaw, case: LeaningCase) -> Iterator[Body]:
        raise NotImplementedError

    def effort(self, law: ProbeLaw, case: LeaningCase) -> Mapping[str, tuple[float, ...]]:
        return {}

    def meets(self, law: ProbeLaw) -> tuple[tuple[str, str], ...]:
        return ()

    def slip(self, law: ProbeLaw, case: LeaningCase, steps: int, friction: float) -> np.ndarray:
        """The way (steps + 1,), in m, of the body that is measured where it slips with this friction."""
        raise NotImplementedError

    def way(self, case: LeaningCase, motion: TrialMotion) -> np.ndarray:
        """The same of a motion (n,): how far the body has fallen, unless a probe says otherwise."""
        height = motion.pose[case.name][:, 2]
        way: np.ndarray = height[0] - height
        return way

    def cases(self, law: ProbeLaw) -> list[LeaningCase]:
        found = [
            (turn, ratio)
            for turn in TURNS[law.friction_cone]
            for ratio in (*STANDS, *SLIPS)
            if self.angle(law.pair.friction / ratio) is not None
        ]
        return [LeaningCase(f"{self.NAME}_{number}", turn, ratio, number) for number, (turn, ratio) in enumerate(found)]

    def steps(self, law: ProbeLaw) -> int:
        """Long enough for the slowest slip to be ``SLIPPED``, and for what stands to be seen standing."""
        least = law.steps(STANDING_TIME, STANDING_STEPS)
        slipping = [case for case in self.cases(law) if not case.stands and case.turn == 0.0]
        return max([least, *(self._until(law, case) for case in slipping)])

    def _until(self, law: ProbeLaw, case: LeaningCase) -> int:
        """The step at which a slip is measured."""
        way = self.slip(law, case, math.ceil(SLIP_TIME / law.timestep), law.pair.friction)
        return int(np.argmax(way >= min(SLIPPED, SLIPPED_SHARE * way[-1])))

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        cases = self.cases(law)
        bodies = [floor(law), *(body for case in cases for body in self.bodies(law, case))]
        effort = {name: values for case in cases for name, values in self.effort(law, case).items()}
        phase = Phase(self.steps(law), effort=effort)  # type: ignore[arg-type]
        return [ProbeTrial(tuple(bodies), (phase,), self.meets(law))]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        """One figure of all that stand, and one of each ratio that slips; without friction all of them fall."""
        cases = {case.ratio: case for case in reversed(self.cases(law))}
        figures = []
        standing = [case for case in cases.values() if case.stands]
        if standing:
            steps = self.steps(law)
            falls = max(float(self.slip(law, case, steps, 0.0)[-1]) for case in standing)
            figures.append(self.figure(law, "stands", "way", "m", 0.0, standing_way(law, steps), without=falls))
        for ratio, case in sorted(cases.items()):
            if case.stands:
                continue
            step = self._until(law, case)
            low, expected, high, falls = (
                float(self.slip(law, case, step, share * law.pair.friction)[-1])
                for share in (1.0 - PUSH_TOLERANCE, 1.0, 1.0 + PUSH_TOLERANCE, 0.0)
            )
            tolerance = max(SLIP_TOLERANCE * expected, abs(high - low) / 2.0)
            # a name of its own: a declared deviation of a body that slips does not count for one that stands
            named = {"probe": f"{self.NAME}-slips", "without": falls}
            figures.append(self.figure(law, _text(ratio), "way", "m", expected, tolerance, **named))
        return figures

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[Mapping[str, Any]]:
        readings = []
        for figure in self.wanted(law):
            ways = {}
            for case in self.cases(law):
                way = self.way(case, motions[0])
                if figure.expected == 0.0 and case.stands:
                    ways[case] = float(np.abs(way).max())
                elif figure.case == _text(case.ratio):
                    ways[case] = float(way[self._until(law, case)])
            worst = furthest(ways, figure.expected)
            text = f"{worst.turn:g}°" if figure.expected else f"{worst.ratio:g} × the least friction, {worst.turn:g}°"
            readings.append({"measured": ways[worst], "worst": text})
        return readings


def _text(ratio: float) -> str:
    return f"at {ratio:g} × the least friction"


def standing_way(law: ProbeLaw, steps: int) -> float:
    """m: how far a body that must stand may move in so many steps."""
    return STANDING_WAY + STANDING_SPEED * steps * law.timestep


def _stepped(
    acceleration: Callable[[float, float], float],
    start: float,
    timestep: float,
    steps: int,
    bounds: tuple[float, float],
) -> np.ndarray:
    """Values (steps + 1,) of one coordinate from rest, by semi-implicit Euler, the method of all engines; it stays where it
    leaves ``bounds``, beyond which the equation does not hold."""
    values = np.full(steps + 1, start)
    speed = 0.0
    for step in range(steps):
        speed += timestep * acceleration(values[step], speed)
        values[step + 1 :] = values[step] + timestep * speed
        if not bounds[0] < values[step + 1] < bounds[1]:
            break
    return values


class Rod(_Leaning):
    """How far a rod that leans on a wall moves, at four ratios of its friction to the least that holds it."""

    NAME = "rod"
    LENGTH, RADIUS, MASS = 1.0, 0.05, 1.0
    INERTIA = MASS * LENGTH**2 / 12.0
    """kg m², about every axis through the centre; the rod turns about the one across its plane alone."""
    ANGLES = (math.radians(10.0), math.radians(80.0))
    """Between rod and floor."""

    def _least(self, angle: float) -> float:
        """The least friction that holds the rod at this angle to the floor: the root of the moment about its centre,
        −(L/2) c (1 − μ²) + μ L s + μ r (1 + μ) = 0."""
        c, s = self.LENGTH / 2.0 * math.cos(angle), self.LENGTH / 2.0 * math.sin(angle)
        square, linear = c + self.RADIUS, 2.0 * s + self.RADIUS
        return (-linear + math.sqrt(linear * linear + 4.0 * square * c)) / (2.0 * square)

    def angle(self, friction: float) -> float | None:
        low, high = self.ANGLES
        if friction >= self._least(low):
            return low
        if friction <= self._least(high):
            return None
        for _ in range(60):
            middle = (low + high) / 2.0
            low, high = (middle, high) if self._least(middle) > friction else (low, middle)
        return (low + high) / 2.0

    def cases(self, law: ProbeLaw) -> list[LeaningCase]:
        """A slip needs its own threshold: at the flattest angle the least friction may be below the case's."""
        return [
            case
            for case in super().cases(law)
            if case.stands or law.pair.friction / case.ratio < self._least(self.ANGLES[0])
        ]

    def _angle(self, law: ProbeLaw, case: LeaningCase) -> float:
        found = self.angle(law.pair.friction / case.ratio)
        if found is None:
            raise ValueError("a case has an angle")
        return found

    def bodies(self, law: ProbeLaw, case: LeaningCase) -> Iterator[Body]:
        angle, half = self._angle(law, case), self.LENGTH / 2.0
        c, s = half * math.cos(angle), half * math.sin(angle)
        ends = {"foot": (-c, 0.0, -s), "top": (c, 0.0, s)}
        at = case.place(-c, self.RADIUS - TOUCH + s)
        yield cluster(law, case.name, ends, self.RADIUS, self.MASS, self.INERTIA, at, case.quaternion)
        wall = case.place(self.RADIUS - TOUCH + WALL[0] / 2.0, WALL[2] / 2.0)
        yield fixed_box(f"{case.name}_wall", WALL, wall, law.pair.first, case.quaternion)

    def slip(self, law: ProbeLaw, case: LeaningCase, steps: int, friction: float) -> np.ndarray:
        start = self._angle(law, case)

        def acceleration(angle: float, speed: float) -> float:
            return rod_acceleration(angle, speed, friction, self.LENGTH, self.RADIUS, self.MASS, self.INERTIA)

        bounds = (math.radians(3.0), math.pi / 2.0)
        angles = _stepped(acceleration, start, law.timestep, steps, bounds)
        found: np.ndarray = self.LENGTH / 2.0 * (np.cos(angles) - math.cos(start))
        return found

    def way(self, case: LeaningCase, motion: TrialMotion) -> np.ndarray:
        pose = motion.pose[case.name]
        moved = pose[:, :3] - pose[0, :3]
        way: np.ndarray = np.linalg.norm(moved, axis=1) if case.stands else -moved[:, :2] @ direction(case.turn)
        return way


def rod_acceleration(
    angle: float, speed: float, friction: float, length: float, radius: float, mass: float, inertia: float
) -> float:
    """Angular acceleration (rad/s²) of a rod that slips down between floor and wall, both of this friction.

    With the ends' balls of this radius, c and s the half rod's horizontal and vertical extent:
    m ẍ = μ N₁ − N₂,  m z̈ = N₁ + μ N₂ − m g,  I θ̈ = N₁ (μ (s + r) − c) + N₂ (s + μ (c + r)),  x = −c(θ), z = s(θ).
    """
    c, s = length / 2.0 * math.cos(angle), length / 2.0 * math.sin(angle)
    equations = np.array(
        [
            [mass * s, -friction, 1.0],
            [mass * c, -1.0, -friction],
            [inertia, c - friction * (s + radius), -(s + friction * (c + radius))],
        ]
    )
    sides = np.array([-mass * c * speed**2, mass * s * speed**2 - mass * GRAVITY, 0.0])
    return float(np.linalg.solve(equations, sides)[0])


class Clamp(_Leaning):
    """How far a clamp slips down a post, where friction multiplies the force that weight and moment press it on with."""

    NAME = "clamp"
    RADIUS, MASS, POST = 0.05, 1.0, 0.2
    INERTIA = 1.0
    HEIGHT = 0.4
    """m between the two balls."""
    GAIN = 0.6
    """2 μ d / h: friction multiplies the frictionless normal force by 1 / (1 − GAIN) where the clamp slips. From 1 on it would
    jam under any moment, and fall without one: two solutions."""
    FURTHEST = 2.0
    """m from the post to the centre of mass, at most; the gain of a law of little friction is smaller."""

    def distance(self, friction: float, case: LeaningCase) -> float:
        return min(self.GAIN * self.HEIGHT / (2.0 * friction), self.FURTHEST)

    def angle(self, friction: float) -> float | None:
        return 0.0

    def moment(self, law: ProbeLaw, case: LeaningCase) -> float:
        """N m: at ratio 1 friction just carries the weight."""
        friction = law.pair.friction
        least = GRAVITY * self.MASS * (self.HEIGHT / (2.0 * friction) - self.distance(friction, case))
        return case.ratio * least

    def bodies(self, law: ProbeLaw, case: LeaningCase) -> Iterator[Body]:
        out, half = self.distance(law.pair.friction, case), self.HEIGHT / 2.0
        reach = self.POST / 2.0 + self.RADIUS - TOUCH
        ends = {"far": (-out - reach, 0.0, half), "near": (-out + reach, 0.0, -half)}
        height = 3.0
        yield cluster(
            law, case.name, ends, self.RADIUS, self.MASS, self.INERTIA, case.place(out, height), case.quaternion
        )
        size = (self.POST, 1.0, 2.0 * height)
        yield fixed_box(f"{case.name}_post", size, case.place(0.0, height), law.pair.first, case.quaternion)

    def effort(self, law: ProbeLaw, case: LeaningCase) -> Mapping[str, tuple[float, ...]]:
        return {case.name: (0.0, 0.0, 0.0, 0.0, self.moment(law, case), 0.0)}

    def slip(self, law: ProbeLaw, case: LeaningCase, steps: int, friction: float) -> np.ndarray:
        normal = self.moment(law, case) / (self.HEIGHT - 2.0 * friction * self.distance(law.pair.friction, case))
        fall = GRAVITY - 2.0 * friction * normal / self.MASS
        return _stepped(lambda way, speed: fall, 0.0, law.timestep, steps, (-math.inf, math.inf))


class Jam(Clamp):
    """How far a clamp moves that jams, since slip would need a negative normal force; under its weight times its height."""

    NAME = "jam"
    HEIGHT = 0.1
    MOMENT = 1.0
    """Over the weight times ``HEIGHT``: without friction the post would bear this many weights on each side."""
    LEAST_FRICTION = 0.04
    """Below it the centre of mass would be more than 2 m off the post."""

    def applies(self, law: ProbeLaw) -> bool:
        return super().applies(law) and law.reach.jams and law.pair.friction >= self.LEAST_FRICTION

    def cases(self, law: ProbeLaw) -> list[LeaningCase]:
        return [case for case in super().cases(law) if case.stands]

    def distance(self, friction: float, case: LeaningCase) -> float:
        """That at which the gain is the case's ratio."""
        return case.ratio * self.HEIGHT / (2.0 * friction)

    def moment(self, law: ProbeLaw, case: LeaningCase) -> float:
        return self.MOMENT * GRAVITY * self.MASS * self.HEIGHT


class LightJam(Jam):
    """The same under a hundredth of the moment: friction makes nearly all of the normal force."""

    NAME = "jam-light"
    MOMENT = 0.01


class Pile(_Leaning):
    """How far a ball on two others (elliptic cone: three) moves, at four ratios of friction to the least that holds them."""

    NAME = "pile"
    RADIUS, MASS = 0.1, 1.0
    WIDEST = math.radians(70.0)
    """Of the angle between the vertical and the line of centres."""

    def applies(self, law: ProbeLaw) -> bool:
        return super().applies(law) and law.reach.gathers

    def _below(self, law: ProbeLaw) -> int:
        return 3 if law.friction_cone == "elliptic" else 2

    def angle(self, friction: float) -> float | None:
        return min(2.0 * math.atan(friction), self.WIDEST)

    def cases(self, law: ProbeLaw) -> list[LeaningCase]:
        widest = math.tan(self.WIDEST / 2.0)
        return [case for case in super().cases(law) if case.stands or law.pair.friction / case.ratio < widest]

    def _start(self, law: ProbeLaw, case: LeaningCase) -> float:
        return min(2.0 * math.atan(law.pair.friction / case.ratio), self.WIDEST)

    def bodies(self, law: ProbeLaw, case: LeaningCase) -> Iterator[Body]:
        angle, count = self._start(law, case), self._below(law)
        between = 2.0 * self.RADIUS - TOUCH
        out, up = between * math.sin(angle), between * math.cos(angle)
        for number, name in enumerate([f"{case.name}_{number}" for number in range(self._below(law))]):
            bearing = math.radians(case.turn) + 2.0 * math.pi * number / count
            at = case.centre + np.array([out * math.cos(bearing), out * math.sin(bearing), self.RADIUS - TOUCH])
            yield ball(law, name, self.RADIUS, self.MASS, tuple(at.tolist()), group=f"{case.name}_below")
        top = case.place(0.0, self.RADIUS - TOUCH + up)
        material, group = law.pair.first, f"{case.name}_top"
        yield ball(law, case.name, self.RADIUS, self.MASS, top, material=material, group=group)

    def meets(self, law: ProbeLaw) -> tuple[tuple[str, str], ...]:
        return tuple((f"{case.name}_below", f"{case.name}_top") for case in self.cases(law))

    def slip(self, law: ProbeLaw, case: LeaningCase, steps: int, friction: float) -> np.ndarray:
        start, below = self._start(law, case), self._below(law)

        def acceleration(angle: float, speed: float) -> float:
            return pile_acceleration(angle, speed, friction, below, self.RADIUS, self.MASS)

        angles = _stepped(acceleration, start, law.timestep, steps, (0.0, math.radians(85.0)))
        found: np.ndarray = 2.0 * self.RADIUS * (math.cos(start) - np.cos(angles))
        return found


def pile_acceleration(angle: float, speed: float, friction: float, below: int, radius: float, mass: float) -> float:
    """Angular acceleration (rad/s²) of the lines of centres of a pile whose upper ball slips on the lower ones, which roll.

    N the normal force between an upper and a lower ball, φ the angle to the vertical, all balls solid and alike:
    (7/5) m s̈ = N (sin φ − μ cos φ − μ),  m z̈ = −m g + n N (cos φ + μ sin φ),  s = 2 r sin φ,  z = 2 r cos φ.
    """
    c, s = math.cos(angle), math.sin(angle)
    equations = np.array(
        [
            [1.4 * mass * 2.0 * radius * c, -(s - friction * c - friction)],
            [-mass * 2.0 * radius * s, -below * (c + friction * s)],
        ]
    )
    sides = np.array([1.4 * mass * 2.0 * radius * s * speed**2, mass * 2.0 * radius * c * speed**2 - mass * GRAVITY])
    return float(np.linalg.solve(equations, sides)[0])
