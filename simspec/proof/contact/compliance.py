"""Contact probe of a stated compliance: how far a ball sinks in, at rest and when it arrives."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial, by_name
from simspec.proof.contact.worlds import ball, floor, solid
from simspec.world import frames
from simspec.world.types import Body, Quaternion

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
    """A ball at rest on the law, and one that arrives at the surface."""

    NAME = "compliance"
    MEANING = "depth of a ball at rest, and deepest point of one that arrives, against the damped oscillator"

    def applies(self, law: Law) -> bool:
        return law.pair.collide and law.pair.hardness.kind in ("time-constant", "stiffness")

    def _case(self, law: Law) -> tuple[float, Oscillator]:
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

    def trials(self, law: Law) -> Sequence[Trial]:
        mass, oscillator = self._case(law)
        arrival = oscillator.arrival
        time, depth = oscillator.deepest()
        radius = max(0.1, depth / SINKS_PER_RADIUS)
        bodies: tuple[Body, ...] = (
            floor(law),
            ball(law, "resting", radius, mass, (0.0, 0.0, radius - oscillator.rest)),
            ball(law, "arriving", radius, mass, (10.0 * radius, 0.0, radius), (0.0, 0.0, -arrival, 0.0, 0.0, 0.0)),
        )
        lift = mass * (GRAVITY - oscillator.load)
        effort = dict.fromkeys(("resting", "arriving"), (0.0, 0.0, lift, 0.0, 0.0, 0.0)) if lift else {}
        dip = math.ceil(1.5 * time / law.timestep) + 3
        rest = math.ceil(SETTLED / max(oscillator.decay, 1e-12) / law.timestep)
        rest = max(1, min(MOST_STEPS, rest) - dip)
        return [Trial(bodies, (Phase(dip, effort=effort), Phase(rest, every=rest, effort=effort)))]

    def wanted(self, law: Law) -> Sequence[Figure]:
        """A rigid contact lets nothing in."""
        _, oscillator = self._case(law)
        arrival = oscillator.arrival
        _, deepest = oscillator.deepest()
        cases: list[tuple[str, float, float]] = [
            ("ball at rest", oscillator.rest, REST_DEPTH_SHARE * oscillator.rest),
            (f"arriving at {arrival:.3g} m/s, deepest", deepest, DIP_STEPS * arrival * law.timestep),
        ]
        return [self.figure(law, case, "depth", "m", *numbers, without=0.0) for case, *numbers in cases]

    def readings(self, law: Law, motions: Sequence[Motion]) -> Sequence[float]:
        _, oscillator = self._case(law)
        _, deepest = oscillator.deepest()
        radius = max(0.1, deepest / SINKS_PER_RADIUS)
        heights = {name: motions[0].pose[name][:, 2] for name in ("resting", "arriving")}
        seen = heights["arriving"][:-1]  # the last is after the rest
        return [float(radius - heights["resting"][-1]), float(radius - np.min(seen))]


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
    """Bodies of the scenario's kinds of shapes at rest."""

    NAME = "compliance-shape"
    MEANING = "depth at rest of each kind of shape that the scenario has, against its weight over n k of its n points"

    def lying(self, law: Law) -> dict[str, _Lying]:
        return {case: body for case, body in LYING.items() if body.kind in law.reach.kinds}

    def applies(self, law: Law) -> bool:
        return law.pair.collide and law.pair.hardness.kind == "stiffness" and bool(self.lying(law))

    def trials(self, law: Law) -> Sequence[Trial]:
        mass, oscillator = self._case(law)
        bodies: list[Body] = [floor(law)]
        efforts = {}
        for number, (case, body) in enumerate(self.lying(law).items()):
            name, depth = case.replace(" ", "_"), oscillator.rest / body.points
            lies = solid(law, name, body.kind, body.size, mass, (4.0 * number, 0.0, body.height - depth), body.turn)
            bodies.append(lies)
            efforts[name] = (0.0, 0.0, mass * (GRAVITY - oscillator.load), 0.0, 0.0, 0.0)
        rest = math.ceil(SETTLED / max(oscillator.decay, 1e-12) / law.timestep)
        steps = max(1, min(MOST_STEPS, rest))
        return [Trial(tuple(bodies), (Phase(steps, every=steps, effort=efforts),))]

    def wanted(self, law: Law) -> Sequence[Figure]:
        """Without a spring there is no depth."""
        _, oscillator = self._case(law)
        depths = {case: oscillator.rest / body.points for case, body in self.lying(law).items()}
        return [
            self.figure(law, case, "depth", "m", depth, SHAPE_SHARE * depth, without=0.0)
            for case, depth in depths.items()
        ]

    def readings(self, law: Law, motions: Sequence[Motion]) -> Sequence[float]:
        return [
            body.height - float(motions[0].pose[case.replace(" ", "_")][-1, 2])
            for case, body in self.lying(law).items()
        ]


PROBES: Mapping[str, Probe] = by_name((Compliance(), ComplianceByShape()))
