"""Contact probes of oblique impacts: friction in the one step in which a body hits another (see ``proof/contact/probe.py``).

Balls and flat boxes land on a floor with a speed along it, and balls of unequal mass hit each other off-centre, all without
spin. The loss of speed along the surface in an impact follows from Coulomb's law for impulses (Routh 1905, Dynamics of
a System of Rigid Bodies, ch. IV; Brach 1991, Mechanical Impact Dynamics, ch. 6). With the normal impulse m (1 + e) v, m the
reduced mass and v the speed of approach, friction stops the slip u if it can, and opposes it by μ times the normal impulse if
it cannot:

    change of u  =  the projection of  s u  onto the cone's section of size  μ (1 + e) v

with s = 1 for a body that does not turn, and s = 2/7 for solid balls, whose point of contact is moved by their spin too. The
balls' spins change by 5/2 of that over their radius. A flat box does not turn: its corners arrive together, and share the
impulse.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simspec.proof.contact.normal import RESTITUTION_TOLERANCE, TURNED
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
    project,
    signed_size,
)
from simspec.proof.contact.worlds import STEPS_BEFORE, ball, box, flight, floor
from simspec.world.types import Body, Vector3

APPROACH = 2.0
"""m/s along the normal: a step's fall is half a percent of it at 1 ms, and all engines bounce at it."""
FASTEST = 40.0
"""m/s along the surface at most; beyond, the approach is slower (μ above 1.9 at e = 1)."""
ABOVE_THRESHOLD = 2.0
"""Approach over the threshold speed of restitution, at least."""
REGIMES = {"slips": 1.6, "grips": 0.6}
"""Friction that would stop the slip, over what there is: clearly above one and below."""
TOLERANCE = 0.04
"""Of the change of speed: the promise at 1 ms. The lever of a contact amid an overlap of up to one step's way is up to 1 %
short, taking back the overlap adds up to 1 % to the normal impulse, and e may be 0.03 off (see ``impact``)."""
ARRIVAL = 0.02
"""By what share the expected change may differ from that of a planned arrival, in addition to gravity's part (see
``slack``)."""
SHARE = {"box": 1.0, "ball": 2.0 / 7.0}
"""s: the share of the slip that friction must take from the bodies' velocity to stop it."""
SOLID = 2.5
"""Of a solid ball, over its radius: change of spin over change of velocity."""

GRAZES = 0.002
"""Share of a step after which a body arrives whose step begins just before the contact: 4 µm at 1 ms. An engine that makes
contacts at a distance acts before the bodies touch, and may leave out friction then (measured)."""
LANDINGS = ((0.0, 0.1), (35.0, 0.4), (90.0, 0.7), (200.0, 0.9), (290.0, GRAZES))
"""Direction (degrees from the floor's x axis), and share of a step after which the body arrives."""
MEETINGS = {
    "elliptic": (((1.0, 0.0, 0.0), 0.0, 0.3), ((0.8, 0.36, 0.48), 35.0, 0.7)),
    "pyramid-inscribed": (((1.0, 0.0, 0.0), 0.0, 0.3), ((1.0, 0.0, 0.0), 90.0, 0.7)),
    "pyramid-circumscribed": (((1.0, 0.0, 0.0), 0.0, 0.3), ((1.0, 0.0, 0.0), 90.0, 0.7)),
}
"""By cone: direction from the first ball's centre to the second's as they touch, direction of the slip (degrees), share of a
step. A pyramid's axes are the engine's own: along them alone the law is the same in all engines."""
MASSES = (1.0, 3.0)
"""kg: of the ball of the first material, and of the second's."""
DRIFT = np.array([0.3, -0.2, 0.1])
"""m/s: velocity of both balls' common centre of mass, which must not matter."""
RADIUS, THICKNESS, WIDTH, MASS = 0.1, 0.02, 0.2, 1.0
"""m, kg: of what lands, at least."""
WAYS = 50.0
"""Radius over the way of one step, at least: it keeps the lever within 1 % at any timestep."""
THICK_WAYS = 4.0
"""The same of a box's thickness, so that its centre stays above the floor."""
STEPS_AFTER = 8
"""Steps from the one that arrives on."""
SPACING = 6.0
"""Radii between bodies, in addition to the ways that they go: those of a world do not meet but as they are meant to."""
STRIKER, STRUCK = "striker", "struck"
"""Collision groups of the balls that hit each other."""


@dataclass(frozen=True)
class _Case:
    """One body that lands, or two balls that hit each other: names of the bodies, and what they do."""

    bodies: tuple[str, ...]
    shape: str
    regime: str
    degrees: float
    phase: float
    normal: Vector3 = (0.0, 0.0, -1.0)


@dataclass(frozen=True)
class _Hit:
    """The readings of a case: vectors along the surface (2,), in m/s, as the law has them and as measured (``spin``: of balls),
    and the ratio of separation to approach."""

    expected: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray | None
    ratio: float


class Oblique(Probe):
    """Speed and spin that oblique impacts take and give, of balls and flat boxes that land and of balls that hit each other
    off-centre, against Coulomb's law for impulses."""

    NAME = "oblique"
    SEPARATION = "oblique-separation"
    """The name of the figures along the normal: friction must not change how bodies part."""

    def applies(self, law: ProbeLaw) -> bool:
        return law.is_rigid and law.pair.friction > 0.0

    def approach(self, law: ProbeLaw) -> float:
        """Speed (m/s) along the normal."""
        fastest = self._demand(law, 1.0, "slips", "ball")
        return max(
            APPROACH * min(1.0, FASTEST / (APPROACH * fastest)), ABOVE_THRESHOLD * law.pair.restitution_threshold
        )

    def _demand(self, law: ProbeLaw, approach: float, regime: str, shape: str) -> float:
        """Speed (m/s) along the surface of a regime."""
        return REGIMES[regime] * law.pair.friction * (1.0 + law.pair.restitution) * approach / SHARE[shape]

    def shapes(self, law: ProbeLaw) -> tuple[str, ...]:
        """Rolling friction is a torque that spin meets, which the closed form of balls has no place for."""
        return ("box",) if law.pair.rolling_friction else ("box", "ball")

    def landings(self, law: ProbeLaw) -> list[_Case]:
        return [
            _Case((f"{shape}_{regime}_{index}",), shape, regime, *landing)
            for shape in self.shapes(law)
            for regime in REGIMES
            for index, landing in enumerate(LANDINGS)
        ]

    def meetings(self, law: ProbeLaw) -> list[_Case]:
        if "ball" not in self.shapes(law):
            return []
        return [
            _Case((f"one_{regime}_{index}", f"other_{regime}_{index}"), "ball", regime, degrees, phase, normal)
            for regime in REGIMES
            for index, (normal, degrees, phase) in enumerate(MEETINGS[law.friction_cone])
        ]

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        phases = (Phase(STEPS_BEFORE + STEPS_AFTER),)
        landing = [floor(law), *(self._landing(law, case, index) for index, case in enumerate(self.landings(law)))]
        trials = [ProbeTrial(tuple(landing), phases)]
        if meetings := self.meetings(law):
            balls = [ball for index, case in enumerate(meetings) for ball in self._meeting(law, case, index)]
            trials.append(ProbeTrial(tuple(balls), phases, meets=((STRIKER, STRUCK),)))
        return trials

    def _landing(self, law: ProbeLaw, case: _Case, index: int) -> Body:
        dt, approach = law.timestep, self.approach(law)
        speed = self._demand(law, approach, case.regime, case.shape)
        start, way = flight(law, approach, case.phase)
        along = speed * direction(case.degrees)
        velocity = (float(along[0]), float(along[1]), -start, 0.0, 0.0, 0.0)
        spacing = SPACING * self.radius(law, approach) + self._ways(law)
        x, y = spacing * (index % 4), spacing * (index // 4)
        (name,) = case.bodies
        if case.shape == "ball":
            radius = self.radius(law, approach)
            return ball(law, name, radius, MASS, (x, y, radius + way), velocity)
        size = max(1.0, THICK_WAYS * approach * dt / THICKNESS)
        height = size * THICKNESS
        return box(law, name, (size * WIDTH, size * WIDTH, height), MASS, (x, y, height / 2 + way), velocity)

    def radius(self, law: ProbeLaw, speed: float) -> float:
        """Of a ball (m) that comes at this speed."""
        return max(RADIUS, WAYS * speed * law.timestep)

    def _ways(self, law: ProbeLaw) -> float:
        """How far (m) two separating bodies can go in a trial."""
        return 2.0 * FASTEST * law.timestep * (STEPS_BEFORE + STEPS_AFTER)

    def _meeting(self, law: ProbeLaw, case: _Case, index: int) -> Iterator[Body]:
        approach = self.approach(law)
        normal, axes = _frame(case.normal)
        slip = self._demand(law, approach, case.regime, case.shape) * direction(case.degrees) @ axes
        relative = approach * normal + slip  # of the first, seen from the second
        radius = self.radius(law, math.hypot(approach, float(np.linalg.norm(slip))))
        separate = -2.0 * radius * normal - relative * law.timestep * (STEPS_BEFORE + case.phase)
        spacing = SPACING * self.radius(law, FASTEST + approach) + self._ways(law)
        centre = np.array([0.0, index * spacing, 0.0])
        shares = (MASSES[1] / sum(MASSES), -MASSES[0] / sum(MASSES))
        for name, material, mass, share, group in zip(
            case.bodies, (law.pair.first, law.pair.second), MASSES, shares, (STRIKER, STRUCK), strict=True
        ):
            place, velocity = centre + share * separate, DRIFT + share * relative
            static = (*velocity.tolist(), 0.0, 0.0, 0.0)
            yield ball(law, name, radius, mass, tuple(place.tolist()), static, material=material, group=group)

    def slack(self, law: ProbeLaw) -> float:
        """Gravity acts as long as an impact lasts, and balls meet along the line that their ways give."""
        return ARRIVAL + GRAVITY * law.timestep * (STEPS_BEFORE + STEPS_AFTER + 1) / self.approach(law)

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        e = law.pair.restitution
        figures = []
        for text, cases in self.groups(law).items():
            size, at = self._change(law, cases[0]), math.radians(cases[0].degrees)
            # spin as the velocity that it gives, so that both are in one unit
            for quantity in ("velocity", "spin")[: 1 if cases[0].shape == "box" else 2]:
                named = (text, f"change of {quantity}", "m/s")
                figures.append(self.figure(law, *named, size, TOLERANCE * size, angle=at, without=0.0))
            ratio = {"probe": self.SEPARATION, "angle": at, "without": 0.0 if e else None}
            figures.append(self.figure(law, text, "ratio", "", e, RESTITUTION_TOLERANCE, **ratio))
        return figures

    def groups(self, law: ProbeLaw) -> dict[str, list[_Case]]:
        groups: dict[str, list[_Case]] = {}
        for case in [*self.landings(law), *self.meetings(law)]:
            groups.setdefault(_group(case), []).append(case)
        return groups

    def reference(self, law: ProbeLaw, figure: ProbeFigure) -> ProbeFigure | None:
        """Under a pyramid the expected change depends on the direction that came out worst."""
        found = super().reference(law, figure)
        if found is None or figure.probe != self.NAME:
            return found
        degrees = math.nan if figure.angle is None else math.degrees(figure.angle)
        cases = self.groups(law)[figure.case]
        same = [case for case in cases if math.isclose(case.degrees, degrees, abs_tol=1e-6)]
        if not same:
            return None
        size = self._change(law, same[0])
        return replace(found, expected=size, tolerance=TOLERANCE * size)

    def _change(self, law: ProbeLaw, case: _Case) -> float:
        """The change of speed (m/s) of a case that arrives exactly as it is meant to."""
        approach = self.approach(law)
        slip = SHARE[case.shape] * self._demand(law, approach, case.regime, case.shape) * direction(case.degrees)
        most = law.pair.friction * (1.0 + law.pair.restitution) * approach
        return float(np.linalg.norm(project(slip, most, law.friction_cone)))

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[Mapping[str, Any]]:
        """Of each quantity the case that is furthest off."""
        readings: list[Mapping[str, Any]] = []
        for cases in self.groups(law).values():
            hits = {case: (self._landed if len(case.bodies) == 1 else self._met)(law, case, motions) for case in cases}
            for quantity in ("velocity", "spin")[: 1 if cases[0].shape == "box" else 2]:
                pairs = {case: (getattr(hit, quantity), hit.expected) for case, hit in hits.items()}
                off = {
                    case: float(np.linalg.norm(measured - expected) / np.linalg.norm(expected))
                    for case, (measured, expected) in pairs.items()
                }
                worst = furthest(off)
                size = float(np.linalg.norm(hits[worst].expected))
                numbers = {"measured": signed_size(*pairs[worst]), "expected": size, "tolerance": TOLERANCE * size}
                readings.append(numbers | _of(worst))
            worst = furthest({case: hit.ratio for case, hit in hits.items()}, law.pair.restitution)
            readings.append({"measured": hits[worst].ratio} | _of(worst))
        return readings

    def _landed(self, law: ProbeLaw, case: _Case, motions: Sequence[TrialMotion]) -> _Hit:
        velocity = motions[0].velocity[case.bodies[0]]
        approach = self.approach(law)
        begin = impact_begins(velocity[:, :3], law.timestep)
        end = impact_ends(velocity[:, 2], begin)
        fallen = GRAVITY * law.timestep
        fall = -float(velocity[begin, 2])
        normal = (1.0 + law.pair.restitution) * fall + fallen * (end - begin)
        expected = project(SHARE[case.shape] * velocity[begin, :2], law.pair.friction * normal, law.friction_cone)
        spin = None
        if case.shape == "ball":
            turned = velocity[end, 3:] - velocity[begin, 3:]
            spin = self.radius(law, approach) / SOLID * np.array([turned[1], -turned[0]])  # ω = (5/2r) z × change
        ratio = float(velocity[end, 2] + fallen * (end - begin - 1)) / fall  # one step leaves gravity no time
        return _Hit(expected, velocity[begin, :2] - velocity[end, :2], spin, ratio)

    def _met(self, law: ProbeLaw, case: _Case, motions: Sequence[TrialMotion]) -> _Hit:
        motion = motions[1]
        striker, other = (motion.velocity[name] for name in case.bodies)
        relative = striker[:, :3] - other[:, :3]
        begin = impact_begins(relative, law.timestep)
        separate = motion.pose[case.bodies[1]][begin, :3] - motion.pose[case.bodies[0]][begin, :3]
        normal, axes = _frame(tuple((separate / np.linalg.norm(separate)).tolist()))
        end = impact_ends(-relative @ normal, begin)
        approach = float(relative[begin] @ normal)
        size = law.pair.friction * (1.0 + law.pair.restitution) * approach
        expected = project(SHARE["ball"] * axes @ relative[begin], size, law.friction_cone)
        reduced = MASSES[0] * MASSES[1] / sum(MASSES)
        radius = self.radius(
            law, math.hypot(self.approach(law), self._demand(law, self.approach(law), case.regime, "ball"))
        )
        velocities, spins = [], []
        # m Δv = ∓ J and (2/5) m r Δω = −n × J: the impulse from either ball, over the reduced mass
        for body, mass, sign in ((striker, MASSES[0], -1.0), (other, MASSES[1], 1.0)):
            change = body[end] - body[begin]
            fallen = np.array([0.0, 0.0, GRAVITY * law.timestep * (end - begin)])
            velocities.append(sign * mass / reduced * axes @ (change[:3] + fallen))
            spins.append(mass / reduced * radius / SOLID * axes @ np.cross(normal, change[3:]))
        far = [
            max(some, key=lambda measured: float(np.linalg.norm(measured - expected))) for some in (velocities, spins)
        ]
        return _Hit(expected, far[0], far[1], -float(relative[end] @ normal) / approach)


def _of(case: _Case) -> dict[str, Any]:
    return {"worst": f"{case.degrees:g}°", "angle": math.radians(case.degrees)}


def _group(case: _Case) -> str:
    what = f"a {case.shape} on the floor" if len(case.bodies) == 1 else "a ball on a ball of three times its mass"
    return f"{what} that {case.regime}"


def impact_begins(velocity: np.ndarray, timestep: float) -> int:
    """The last step before an impact, from velocities (n, 3) at every step: the first that changes by more than steps' falls
    and ``TURNED`` of the largest change."""
    sizes = np.nan_to_num(np.linalg.norm(np.diff(velocity, axis=0), axis=1), nan=math.inf)
    return int(np.argmax(sizes > TURNED * sizes.max() + 2.0 * GRAVITY * timestep))


def impact_ends(speed: np.ndarray, begin: int, least: float = 0.0) -> int:
    """The first step after an impact, from the speeds (n,) along its normal: it goes on while steps add more than ``TURNED`` of
    the first step's change, and ``least`` (m/s)."""
    change = np.diff(speed)
    end = begin + 1
    while end < len(change) and change[end] > TURNED * change[begin] + least:
        end += 1
    return end


def _frame(normal: Vector3) -> tuple[np.ndarray, np.ndarray]:
    """The unit normal (3,), and two axes (2, 3) across it, the first horizontal."""
    unit = np.array(normal) / math.sqrt(sum(part * part for part in normal))
    first = np.cross([0.0, 0.0, 1.0], unit)
    first /= np.linalg.norm(first)
    return unit, np.array([first, np.cross(unit, first)])
