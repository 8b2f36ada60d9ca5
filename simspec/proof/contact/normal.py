"""Contact probes along the normal: how bodies bounce, rest, leave an overlap, and sink into a stated compliance."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simspec.proof.contact.probe import GRAVITY, Phase, Probe, ProbeFigure, ProbeLaw, ProbeTrial, TrialMotion, furthest
from simspec.proof.contact.worlds import STEPS_BEFORE, ball, box, flight, floor, solid
from simspec.world import frames
from simspec.world.types import Quaternion

RESTITUTION_SPEEDS = (1.0, 2.0, 5.0)
"""Approach speeds (m/s): where bouncing matters, and where every engine bounces (one does not below e v = 0.1 m/s)."""
BELOW_THRESHOLD = 0.5
"""Share of the threshold speed at which nothing may bounce."""
THRESHOLD = "threshold"
"""Probe name of the figures at speeds near the threshold, below and at twice of it."""
STEP_PHASES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of a step after which the ball reaches the floor: an engine that looks once a step finds it as deep as that."""
RESTITUTION_TOLERANCE = 0.05
"""The promise for the ratio at 1 ms. It is also what taking back the overlap can add (at most β = 0.01, since the
overlap is at most one step's way) and what a step's gravity can (g dt / v = 0.01), several times over."""
STEPS_AFTER = 12
"""Steps from the one that arrives on: a rigid contact is over after one."""

TURNED = 0.01
"""Share of the approach speed that a step of contact adds at least: as much as β alone can."""

ERROR_REDUCTION = 0.01
"""β of the common hardness (see ``world.types.Hardness``)."""
OVERLAPS = (1e-5, 5e-5)
"""Initial overlaps (m): of rest and build, and small enough for engines that limit the speed of recovery (measured:
to 1 mm/s) to have the law. Below ``OVERLAPS_FROM`` (s) they are less, in proportion to the timestep, for the same speeds."""
OVERLAPS_FROM = 5e-4
OVERLAP_SHARE = 0.02
"""Of the expected speed: the part that a solver of finite accuracy may miss, ten times what any core engine does."""
OVERLAP_GRAVITY = 2e-3
"""Of one step's gravity: soft contacts reach 0.999 of the reference, and gravity is part of what they stop."""

REST_DEPTH = 1e-4
"""m: the promise for rigid contact; engines' own soft defaults lie 0.1 to 0.4 mm deep."""
REST_SPEED = 1e-4
"""m/s up or down at rest: a hundredth of what gravity adds in 1 ms; a body that jitters in its contact is above it."""
REST_HOP = 0.8
"""The largest restitution e of which a hop at rest is allowed for, up to (1 + e)/(1 − e) g dt: see :func:`hop`."""
REST_TIME, REST_STEPS = 0.5, 800
"""The longer of the two (s, steps): after 800 steps β has taken back 0.9997 of the overlap of an impact."""
DROP_HEIGHT = 2e-3
"""m: arrives at 0.2 m/s, and leaves an overlap of up to 0.2 m/s times the timestep to take back."""
DROP_RESTITUTION = 0.5
"""Largest restitution for which bodies are dropped too: livelier ones would still be bouncing when they are looked at."""
CUBE, CUBE_MASS = 0.1, 1.0
SPHERE, SPHERE_MASS = 0.1, 10.0
"""Edge (m) and mass (kg); radius and mass."""


class Restitution(Probe):
    """Separation over approach speed of balls that arrive at a floor, at several speeds and phases in one world, against e."""

    NAME = "restitution"

    def applies(self, law: ProbeLaw) -> bool:
        """A compliant contact has no restitution of its own (see ``compliance``), and a native one says nothing."""
        return law.is_rigid

    def speeds(self, law: ProbeLaw) -> dict[float, float]:
        """The ratio that is expected, by approach speed."""
        threshold = law.pair.restitution_threshold
        expected = {speed: law.pair.restitution for speed in RESTITUTION_SPEEDS if speed > threshold}
        if threshold and law.pair.restitution:
            expected[BELOW_THRESHOLD * threshold] = 0.0
            expected.setdefault(2.0 * threshold, law.pair.restitution)
        return dict(sorted(expected.items()))

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        bodies = [floor(law)]
        for row, speed in enumerate(self.speeds(law)):
            # large enough for the ball's centre to stay above the floor wherever in the step it arrives
            radius = max(0.1, 4.0 * speed * law.timestep)
            for column, phase in enumerate(STEP_PHASES):
                start, way = flight(law, speed, phase)
                place = (3.0 * column, 3.0 * row, radius + way)
                bodies.append(ball(law, f"ball_{row}_{column}", radius, 1.0, place, (0.0, 0.0, -start, 0.0, 0.0, 0.0)))
        return [ProbeTrial(tuple(bodies), (Phase(STEPS_BEFORE + STEPS_AFTER),))]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        """Below the threshold an engine without one bounces as it does above; such engines declare a deviation for these
        figures alone."""
        e = law.pair.restitution
        figures = []
        for speed, expected in self.speeds(law).items():
            name = self.NAME if speed in RESTITUTION_SPEEDS else THRESHOLD
            figure = self.figure(law, "", "ratio", "", expected, RESTITUTION_TOLERANCE, probe=name)
            case = f"arriving at {speed:g} m/s, {len(STEP_PHASES)} phases"
            figures.append(replace(figure, case=case, without=(0.0 if expected else e) if e else None))
        return figures

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[Mapping[str, Any]]:
        readings = []
        for row, expected in enumerate(self.speeds(law).values()):
            speeds = {phase: motions[0].velocity[f"ball_{row}_{n}"][:, 2] for n, phase in enumerate(STEP_PHASES)}
            ratios = {phase: bounce_ratio(speed, law.timestep) for phase, speed in speeds.items()}
            worst = furthest(ratios, expected)
            readings.append(
                {"measured": ratios[worst], "points": tuple(ratios.items()), "worst": f"{worst:g} of a step"}
            )
        return readings


def bounce_ratio(speed: np.ndarray, timestep: float) -> float:
    """Separation over approach speed of one impact, from the upward speeds (n,) at every step.

    The approach is the fastest fall; from there on the contact turns the ball, until a step adds less than ``TURNED`` of
    the approach to its speed. One step leaves gravity no time; of several, what it took in between is given back to what then
    flies. Of what lies it has taken nothing: the contact bears it.
    """
    lowest = int(np.argmin(speed))
    if speed[lowest] >= 0.0 or lowest + 1 >= len(speed):
        return math.nan
    changes = np.diff(speed[lowest + 1 :])
    turned = np.flatnonzero(changes < -TURNED * speed[lowest])
    if not len(turned):
        return math.nan
    # the first of these steps may be one of contact yet
    flies = (changes[turned[0] : turned[0] + 2] < -0.5 * GRAVITY * timestep).any()
    lost = GRAVITY * timestep * turned[0] if flies else 0.0
    return float((speed[lowest + 1 + turned[0]] + lost) / -speed[lowest])


class Rest(Probe):
    """How deep a cube and a ball lie in the floor, and how fast they still move: put down, and dropped from a small height."""

    NAME = "rest"
    STEADY = "steady"
    """The name of the figures of speed, so that a declared deviation in depth is none in speed."""

    def applies(self, law: ProbeLaw) -> bool:
        return law.is_rigid

    def cases(self, law: ProbeLaw) -> dict[str, float]:
        """Initial gap (m) by case."""
        return {"put down": 0.0} | ({"dropped": DROP_HEIGHT} if law.pair.restitution <= DROP_RESTITUTION else {})

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        bodies = [floor(law)]
        for column, gap in enumerate(self.cases(law).values()):
            at = 3.0 * column
            bodies.append(box(law, f"cube_{column}", (CUBE, CUBE, CUBE), CUBE_MASS, (at, 0.0, CUBE / 2 + gap)))
            bodies.append(ball(law, f"ball_{column}", SPHERE, SPHERE_MASS, (at, 3.0, SPHERE + gap)))
        steps = law.steps(REST_TIME, REST_STEPS)
        seen = steps // 4
        return [ProbeTrial(tuple(bodies), (Phase(steps - seen, every=max(1, steps - seen)), Phase(seen)))]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        """Without a floor everything falls as long as the trial lasts."""
        seconds = law.steps(REST_TIME, REST_STEPS) * law.timestep
        fallen, falls, moves = 0.5 * GRAVITY * seconds**2, GRAVITY * seconds, REST_SPEED + hop(law)
        figures = []
        for case in (f"{shape} {case}" for case in self.cases(law) for shape in ("cube", "ball")):
            figures.append(self.figure(law, case, "depth", "m", 0.0, REST_DEPTH, without=fallen))
            figures.append(self.figure(law, case, "speed", "m/s", 0.0, moves, probe=self.STEADY, without=falls))
        return figures

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float]:
        readings = []
        for name in (f"{shape}_{column}" for column in range(len(self.cases(law))) for shape in ("cube", "ball")):
            depth = np.array([-lowest_point(name.partition("_")[0], pose) for pose in motions[0].pose[name][2:]])
            readings.append(float(depth[int(np.argmax(np.abs(depth)))]))
            readings.append(float(np.abs(motions[0].velocity[name][2:, 2]).max()))
        return readings


def hop(law: ProbeLaw) -> float:
    """The speed (m/s) up to which a body at rest hops under a law with restitution.

    Some engines multiply a step's speed after gravity was added. In units of g dt: a body that leaves with u stays in
    the air for up to ⌈2u⌉ steps and comes down with less than u + 1; the next step's fall makes the approach a < u + 2, and
    u = e a. So a < 2/(1 − e), and what is seen, a − 1, stays below (1 + e)/(1 − e). Measured, whatever the
    friction and the timestep: 0.87 of 1.86 at e = 0.3, 1.43 of 2.33 at 0.4, 4.0 of 9 at 0.8. No threshold speed is above it
    at every timestep.
    """
    e = min(law.pair.restitution, REST_HOP)
    return (1.0 + e) / (1.0 - e) * GRAVITY * law.timestep if e else 0.0


def lowest_point(shape: str, pose: np.ndarray) -> float:
    """Height of the lowest point of a probe's cube or ball at a pose (7,)."""
    if shape == "ball":
        return float(pose[2]) - SPHERE
    upright = np.array(frames.matrix(tuple(pose[3:7])))[2]
    return float(pose[2] - np.abs(upright).sum() * CUBE / 2)


class OverlapRecovery(Probe):
    """The speed at which balls that begin inside the floor leave it after one step, against β overlap / dt."""

    NAME = "overlap"

    def applies(self, law: ProbeLaw) -> bool:
        """With restitution, e times one step's gravity comes on top in engines that add gravity first, and drowns it."""
        return law.is_rigid and not law.pair.restitution

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        balls = (
            ball(law, f"ball_{column}", SPHERE, 1.0, (3.0 * column, 0.0, SPHERE - overlap))
            for column, overlap in enumerate(overlaps(law))
        )
        return [ProbeTrial((floor(law), *balls), (Phase(1),))]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        speeds = {
            f"overlap {overlap * 1e6:g} µm": ERROR_REDUCTION * overlap / law.timestep for overlap in overlaps(law)
        }
        least = OVERLAP_GRAVITY * GRAVITY * law.timestep
        return [
            self.figure(law, case, "speed", "m/s", speed, OVERLAP_SHARE * speed + least, without=0.0)
            for case, speed in speeds.items()
        ]

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float]:
        return [float(motions[0].velocity[f"ball_{column}"][1, 2]) for column in range(len(OVERLAPS))]


def overlaps(law: ProbeLaw) -> tuple[float, ...]:
    """m: how deep each ball is in the floor."""
    return tuple(overlap * min(1.0, law.timestep / OVERLAPS_FROM) for overlap in OVERLAPS)


# --- compliance ---------------------------------------------------------------------------------------------------

LARGEST_REST_DEPTH = 0.02
"""m: an upward force takes as much of the weight off that the ball sinks in no further."""
ARRIVAL, ARRIVAL_DAMPED = 3.0, 2.0
"""Speed of the arriving ball, in rest depths times natural frequency, or, if that is more, times the faster decay: it goes in
deeper than it will rest (from 1 rest depth times the faster decay on), and comes back."""
RESOLVED = 0.05
"""Natural frequency and damping rate times the timestep that a ball on a stiffness is made heavy enough for."""
SINKS_PER_RADIUS = 0.25
"""Largest sink over the ball's radius, so that the contact stays one point."""
SETTLED = 10.0
"""Time constants of the slower decay after which the resting ball is looked at."""
MOST_STEPS = 6000
DIP_STEPS = 1.0
"""Steps' way at the speed of arrival: when in a step contact begins, and whether the force is that of the step's beginning
or of its end."""
REST_DEPTH_SHARE = 0.01
"""Relative tolerance of the depth at rest, which does not depend on the timestep."""


@dataclass(frozen=True)
class Oscillator:
    """d̈ = ``load`` − ``damping`` ḋ − ``stiffness`` d, of the depth d (m) of a ball: all per mass."""

    stiffness: float
    damping: float
    load: float

    @property
    def frequency(self) -> float:
        """Natural frequency (rad/s)."""
        return math.sqrt(self.stiffness)

    @property
    def rest(self) -> float:
        """Depth at rest (m)."""
        return self.load / self.stiffness

    @property
    def decay(self) -> float:
        """Rate (1/s) of the slower decay."""
        spread = self.damping**2 / 4.0 - self.stiffness
        return self.damping / 2.0 - (math.sqrt(spread) if spread > 0.0 else 0.0)

    @property
    def arrival(self) -> float:
        """The speed (m/s) of the arriving ball."""
        faster = self.damping - self.decay
        return self.rest * max(ARRIVAL * self.frequency, ARRIVAL_DAMPED * faster)

    def deepest(self) -> tuple[float, float]:
        """When (s) and how deep (m) the ball that arrives at the surface is deepest.

        d = d₀ + A exp(s₁ t) + B exp(s₂ t) with s² + b s + κ = 0, up to the first t > 0 with ḋ = 0. Until then the contact
        pushes, so that it makes no difference that it never pulls.
        """
        speed = self.arrival
        root = cmath.sqrt(self.damping**2 / 4.0 - self.stiffness)
        if abs(root) < 1e-6 * self.frequency:  # the two solutions fall together; the difference vanishes as its square
            root = complex(1e-6 * self.frequency)
        fast, slow = -self.damping / 2.0 + root, -self.damping / 2.0 - root
        a = (speed + self.rest * slow) / (fast - slow)
        b = -self.rest - a
        time = cmath.log(-b * slow / (a * fast)) / (fast - slow)
        if root.imag:
            half = math.pi / abs(root.imag)
            time = complex(time.real % half)
        depth = self.rest + a * cmath.exp(fast * time) + b * cmath.exp(slow * time)
        return time.real, depth.real


class Compliance(Probe):
    """The depth of a ball at rest, and the deepest point of one that arrives, against the damped oscillator."""

    NAME = "compliance"

    def applies(self, law: ProbeLaw) -> bool:
        return law.pair.collide and law.pair.hardness.kind in ("time-constant", "stiffness")

    def _case(self, law: ProbeLaw) -> tuple[float, Oscillator]:
        """The ball's mass and its oscillator."""
        hardness, dt = law.pair.hardness, law.timestep
        if hardness.kind == "time-constant":
            mass = 1.0
            stiffness = 1.0 / (hardness.time_constant * hardness.damping_ratio) ** 2
            damping = 2.0 / hardness.time_constant
        else:
            mass = max(1.0, hardness.stiffness * (dt / RESOLVED) ** 2, hardness.damping * dt / RESOLVED)
            stiffness, damping = hardness.stiffness / mass, hardness.damping / mass
        return mass, Oscillator(stiffness, damping, min(GRAVITY, LARGEST_REST_DEPTH * stiffness))

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        mass, oscillator = self._case(law)
        time, depth = oscillator.deepest()
        radius, falling = max(0.1, depth / SINKS_PER_RADIUS), (0.0, 0.0, -oscillator.arrival, 0.0, 0.0, 0.0)
        resting = ball(law, "resting", radius, mass, (0.0, 0.0, radius - oscillator.rest))
        arriving = ball(law, "arriving", radius, mass, (10.0 * radius, 0.0, radius), falling)
        lift = mass * (GRAVITY - oscillator.load)
        effort = dict.fromkeys(("resting", "arriving"), (0.0, 0.0, lift, 0.0, 0.0, 0.0)) if lift else {}
        dip = math.ceil(1.5 * time / law.timestep) + 3
        rest = max(1, self._settling(law, oscillator) - dip)
        phases = (Phase(dip, effort=effort), Phase(rest, every=rest, effort=effort))
        return [ProbeTrial((floor(law), resting, arriving), phases)]

    def _settling(self, law: ProbeLaw, oscillator: Oscillator) -> int:
        """Steps until a body lies at rest."""
        return min(MOST_STEPS, math.ceil(SETTLED / max(oscillator.decay, 1e-12) / law.timestep))

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        """A rigid contact lets nothing in."""
        _, oscillator = self._case(law)
        arrival, (_, deepest) = oscillator.arrival, oscillator.deepest()
        resting = (oscillator.rest, REST_DEPTH_SHARE * oscillator.rest)
        case, arriving = f"arriving at {arrival:.3g} m/s, deepest", (deepest, DIP_STEPS * arrival * law.timestep)
        return [
            self.figure(law, "ball at rest", "depth", "m", *resting, without=0.0),
            self.figure(law, case, "depth", "m", *arriving, without=0.0),
        ]

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float]:
        radius = max(0.1, self._case(law)[1].deepest()[1] / SINKS_PER_RADIUS)
        resting, arriving = (motions[0].pose[name][:, 2] for name in ("resting", "arriving"))
        return [float(radius - resting[-1]), float(radius - np.min(arriving[:-1]))]  # the last is after the rest


@dataclass(frozen=True)
class _Lying:
    """A body that lies on the floor: its shape, turn, height (m) of its centre, and how many points bear it."""

    kind: str
    size: tuple[float, ...]
    turn: Quaternion
    height: float
    points: int


_ACROSS = frames.from_axis_angle((0.0, 1.0, 0.0), math.pi / 2.0)
LYING: Mapping[str, _Lying] = {
    "lying capsule": _Lying("capsule", (0.1, 0.4), _ACROSS, 0.1, 2),
    "lying cylinder": _Lying("cylinder", (0.1, 0.4), _ACROSS, 0.1, 2),
    "standing cylinder": _Lying("cylinder", (0.1, 0.2), frames.IDENTITY, 0.1, 4),
    "box": _Lying("box", (0.2, 0.2, 0.2), frames.IDENTITY, 0.1, 4),
}
"""By case. A stiffness is that of a point: bodies lie on the corners of a face, the ends of a line, four points of a circle."""
SHAPE_SHARE = 0.03
"""Relative tolerance of the depth."""


class ComplianceByShape(Compliance):
    """The depth at rest of each kind of shape that the scenario has, against its weight over n k of its n points."""

    NAME = "compliance-shape"

    def lying(self, law: ProbeLaw) -> dict[str, _Lying]:
        return {case: body for case, body in LYING.items() if body.kind in law.reach.kinds}

    def applies(self, law: ProbeLaw) -> bool:
        return law.pair.collide and law.pair.hardness.kind == "stiffness" and bool(self.lying(law))

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        mass, oscillator = self._case(law)
        bodies = [floor(law)]
        for number, (case, body) in enumerate(self.lying(law).items()):
            at = (4.0 * number, 0.0, body.height - oscillator.rest / body.points)
            bodies.append(solid(law, case.replace(" ", "_"), body.kind, body.size, mass, at, body.turn))
        lift = (0.0, 0.0, mass * (GRAVITY - oscillator.load), 0.0, 0.0, 0.0)
        steps = max(1, self._settling(law, oscillator))
        phase = Phase(steps, every=steps, effort={body.name: lift for body in bodies[1:]})
        return [ProbeTrial(tuple(bodies), (phase,))]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        """Without a spring there is no depth."""
        rest = self._case(law)[1].rest
        depths = {case: rest / body.points for case, body in self.lying(law).items()}
        return [
            self.figure(law, case, "depth", "m", depth, SHAPE_SHARE * depth, without=0.0)
            for case, depth in depths.items()
        ]

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[float]:
        ends = {case: motions[0].pose[case.replace(" ", "_")][-1] for case in self.lying(law)}
        return [body.height - float(ends[case][2]) for case, body in self.lying(law).items()]
