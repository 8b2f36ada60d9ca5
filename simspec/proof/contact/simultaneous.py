"""Contact probes of impacts that touch several places at once: one ball on two, a ball against a row, a box on one edge.

The law is that of every single contact (see ``world.types.Hardness``): in the step of the impact each contact separates at e
times the speed at which it approached, and one that did not approach stays closed or opens. The impulses solve one linear
system, P along the normal and T along the surface, with T = μ P where it slips (Newton's law of restitution with Coulomb's of
friction; Brach 1991, Mechanical Impact Dynamics, ch. 6). Without friction the law never adds energy; with friction it adds some
percent at e = 1 (Kane and Levinson 1985, Dynamics). A solver that restores one contact after the other adds 12.5 % where one
ball hits two (measured, docs/concepts/proof.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.proof.contact.normal import RESTITUTION_TOLERANCE
from simspec.proof.contact.oblique import ABOVE_THRESHOLD, GRAZES, impact_begins, impact_ends
from simspec.proof.contact.probe import (
    GRAVITY,
    Phase,
    Probe,
    ProbeFigure,
    ProbeLaw,
    ProbeTrial,
    TrialMotion,
    furthest,
    signed_size,
)
from simspec.proof.contact.worlds import STEPS_BEFORE, ball, box, flight, floor
from simspec.world import frames
from simspec.world.frames import sorted_pair, vector3
from simspec.world.types import Body

APPROACH = 2.0
"""m/s: as in ``oblique``."""
PHASES = (0.3, 0.7, GRAZES)
"""Shares of a step after which the bodies meet."""
RADIUS, MASS = 0.1, 1.0
WAYS = 100.0
"""Radius over the way of one step, at least: it keeps the lever of a contact within half a percent."""
TILT = math.radians(30.0)
"""Of the box that lands on one edge."""
EDGE = (2.0, 1.0, 1.0)
"""Edges of that box, in units of ``WIDTH``: the one that lands is along y."""
WIDTH = 0.2
STEPS_AFTER = 8
"""Steps from the one that arrives on."""
SPACING = 6.0
"""Radii between groups."""
VELOCITY_TOLERANCE, LONG = 0.04, 0.016
"""Of a change of velocity, as in ``oblique``: levers and e are each off by about one percent. In steps above the second (s) in
proportion to them: gravity acts in the step of the impact (at 20 ms four engines are off by 4.1 %, alike)."""
OPENING = math.radians(30.0)
"""Between the vertical and the lines of centres of one ball on two of its size that touch."""


def impulses(
    mobility: np.ndarray, approach: float, slip: float, friction: float, restitution: float
) -> tuple[float, float]:
    """The impulses (P, T) of one contact, or of each of several that are alike.

    ``mobility`` (2, 2): the change of the separation speed and the loss of slip by a unit impulse along the normal, and by one
    against the slip; ``approach`` and ``slip`` (m/s) before. T stops the slip if |T| ≤ μ P, and is μ P against it otherwise.
    """
    wanted = (1.0 + restitution) * approach
    normal, along = (float(value) for value in np.linalg.solve(mobility, [wanted, slip]))
    if abs(along) <= friction * normal:
        return normal, along
    share = math.copysign(friction, along)
    normal = wanted / float(mobility[0, 0] + share * mobility[0, 1])
    return normal, share * normal


@dataclass(frozen=True)
class _BodyGroup:
    """Bodies that meet: names, share of a step after which they do, and place in the grid."""

    names: tuple[str, ...]
    phase: float
    number: int


class _Together(Probe):
    """Change of velocity of each body, and energy after over energy before."""

    TEXT: str
    ROLES: tuple[str, ...]
    """Names of the bodies of a group, without its number."""
    MEETS: tuple[tuple[int, int], ...] = ()
    """Which of them meet each other."""
    STANDS = False
    """Whether the bodies meet the floor."""

    def applies(self, law: ProbeLaw) -> bool:
        """Rolling friction is a moment that the impulses have no place for."""
        return law.is_rigid and not law.pair.rolling_friction and self.reached(law)

    def reached(self, law: ProbeLaw) -> bool:
        """Whether bodies of the two materials can meet so."""
        return law.reach.gathers

    def approach(self, law: ProbeLaw) -> float:
        return max(APPROACH, ABOVE_THRESHOLD * law.pair.restitution_threshold)

    def radius(self, law: ProbeLaw) -> float:
        return max(RADIUS, WAYS * self.approach(law) * law.timestep)

    def before(self, law: ProbeLaw, phase: float) -> float:
        """Seconds until bodies meet."""
        return (STEPS_BEFORE + phase) * law.timestep

    def groups(self) -> list[_BodyGroup]:
        return [
            _BodyGroup(tuple(f"{role}_{number}" for role in self.ROLES), phase, number)
            for number, phase in enumerate(PHASES)
        ]

    def bodies(self, law: ProbeLaw, group: _BodyGroup) -> Iterator[Body]:
        raise NotImplementedError

    def changes(self, law: ProbeLaw, group: _BodyGroup) -> Mapping[str, np.ndarray]:
        """Change (3,) of each body's velocity (m/s), by the law."""
        raise NotImplementedError

    def energy(self, law: ProbeLaw) -> float:
        """Kinetic energy after over before, by the law."""
        raise NotImplementedError

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        groups = self.groups()
        bodies = [
            *([floor(law)] if self.STANDS else []),
            *(body for group in groups for body in self.bodies(law, group)),
        ]
        meets = [(group.names[index], group.names[other]) for group in groups for index, other in self.MEETS]
        named = tuple(sorted_pair(f"{name}_group", f"{other}_group") for name, other in meets)
        return [ProbeTrial(tuple(bodies), (Phase(STEPS_BEFORE + STEPS_AFTER),), named)]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        """Of each body, and the energy; without the impact nothing changes."""
        share = VELOCITY_TOLERANCE * max(1.0, law.timestep / LONG)
        tolerance = share * (1.0 + law.pair.restitution) * self.approach(law)
        roles = {_role(name): change for name, change in self.changes(law, self.groups()[0]).items()}
        figures = [
            self.figure(
                law,
                f"{self.TEXT}: {role}",
                "change of velocity",
                "m/s",
                float(np.linalg.norm(change)),
                tolerance,
                without=0.0,
            )
            for role, change in roles.items()
        ]
        energy = self.energy(law)
        # a step's gravity, of which engines differ by one, changes the square of the speed
        tolerance = RESTITUTION_TOLERANCE + 2.0 * GRAVITY * law.timestep / self.approach(law)
        named = {"probe": f"{self.NAME}-energy", "without": None if energy >= 1.0 else 1.0}
        return [*figures, self.figure(law, self.TEXT, "energy after, over before", "", energy, tolerance, **named)]

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[Mapping[str, Any]]:
        motion, bodies = motions[0], {body.name: body for body in self.trials(law)[0].bodies}
        sizes: dict[str, dict[_BodyGroup, float]] = {}
        energies: dict[_BodyGroup, float] = {}
        for group in self.groups():
            begin, end = self._span(law, group, motion)
            fallen = np.array([0.0, 0.0, GRAVITY * law.timestep])
            before = {name: motion.velocity[name][begin] for name in group.names}
            after = {name: np.array(motion.velocity[name][end]) for name in group.names}
            for name, expected in self.changes(law, group).items():
                # one step of a body that lands leaves gravity no time
                after[name][:3] += fallen * (end - begin - self.STANDS)
                size = signed_size(after[name][:3] - before[name][:3], expected)
                role = sizes.setdefault(_role(name), {})
                known = role.get(group)
                role[group] = (
                    size if known is None else furthest({known: known, size: size}, float(np.linalg.norm(expected)))
                )
            # as a falling observer sees it, where the bodies do not meet the floor
            falling = fallen * (0.0 if self.STANDS else begin)
            start, stop = (
                sum(_kinetic(bodies[name], states[name], falling, motion.pose[name][at]) for name in group.names)
                for states, at in ((before, begin), (after, end))
            )
            energies[group] = stop / start
        readings = []
        for figure, values in zip(self.wanted(law), [*sizes.values(), energies], strict=True):
            worst = furthest(values, figure.expected)
            readings.append({"measured": values[worst], "worst": f"{worst.phase:g} of a step"})
        return readings

    def _span(self, law: ProbeLaw, group: _BodyGroup, motion: TrialMotion) -> tuple[int, int]:
        """Numbers of the last step before the impact and of the first after it, of all bodies of the group."""
        begins, ends = [], []
        for name in group.names:
            velocity = motion.velocity[name][:, :3] + np.outer(motion.time, (0.0, 0.0, GRAVITY))
            begin = impact_begins(velocity, law.timestep)
            along = velocity[begin + 1] - velocity[begin]
            begins.append(begin)
            speed = velocity @ along / float(np.linalg.norm(along))
            # more than the weight of bodies that stay in touch can add
            ends.append(impact_ends(speed, begin, 2.0 * GRAVITY * law.timestep))
        return min(begins), max(ends)


def _role(name: str) -> str:
    return name.rsplit("_", 1)[0].replace("left", "struck").replace("right", "struck")


def _kinetic(body: Body, velocity: np.ndarray, falling: np.ndarray, pose: np.ndarray) -> float:
    """J, of a body whose frame is its principal one; ``falling`` (3,), in m/s, is added to its velocity."""
    turn = np.array(frames.matrix(tuple(pose[3:7].tolist())))
    spin = turn.T @ velocity[3:]
    moments = np.array(body.inertial.inertia[:3])
    linear = velocity[:3] + falling
    return float(body.inertial.mass * linear @ linear + moments @ spin**2) / 2.0


class Strike(_Together):
    """One ball on two that lie side by side."""

    NAME = "strike"
    TEXT = "one ball on two"
    ROLES, MEETS = ("striker", "left", "right"), ((0, 1), (0, 2))

    def bodies(self, law: ProbeLaw, group: _BodyGroup) -> Iterator[Body]:
        radius = self.radius(law)
        y = SPACING * radius * group.number
        height = 2.0 * radius * math.cos(OPENING) + self.approach(law) * self.before(law, group.phase)
        down = (0.0, 0.0, -self.approach(law), 0.0, 0.0, 0.0)
        striker, left, right = group.names
        yield ball(
            law, striker, radius, MASS, (0.0, y, height), down, material=law.pair.first, group=f"{striker}_group"
        )
        yield ball(law, left, radius, MASS, (-radius, y, 0.0), group=f"{left}_group")
        yield ball(law, right, radius, MASS, (radius, y, 0.0), group=f"{right}_group")

    def _impulses(self, law: ProbeLaw) -> tuple[float, float]:
        c, s = math.cos(OPENING), math.sin(OPENING)
        mobility = np.array([[1.0 + 2.0 * c * c, 2.0 * c * s], [2.0 * c * s, 3.5 + 2.0 * s * s]]) / MASS
        speed = self.approach(law)
        return impulses(mobility, speed * c, speed * s, law.pair.friction, law.pair.restitution)

    def changes(self, law: ProbeLaw, group: _BodyGroup) -> Mapping[str, np.ndarray]:
        c, s = math.cos(OPENING), math.sin(OPENING)
        normal, along = self._impulses(law)
        found = {group.names[0]: np.array([0.0, 0.0, 2.0 * (normal * c + along * s) / MASS])}
        for name, side in zip(group.names[1:], (-1.0, 1.0), strict=True):
            found[name] = np.array([side * (normal * s - along * c), 0.0, -normal * c - along * s]) / MASS
        return found

    def energy(self, law: ProbeLaw) -> float:
        _, along = self._impulses(law)
        changes = self.changes(law, self.groups()[0])
        speed = self.approach(law)
        striker, left, _ = changes.values()
        spin = 2.5 * along * along / MASS  # of each struck ball: T² r² / I
        return float((striker[2] - speed) ** 2 * MASS + 2.0 * (left @ left * MASS + spin)) / (MASS * speed * speed)


class BallRow(_Together):
    """A ball against two that touch, in line."""

    NAME = "row"
    TEXT = "a ball against a row of two"
    ROLES, MEETS = ("first", "second", "third"), ((0, 1), (1, 2))

    def bodies(self, law: ProbeLaw, group: _BodyGroup) -> Iterator[Body]:
        radius, speed = self.radius(law), self.approach(law)
        y = SPACING * radius * group.number
        start = -2.0 * radius - speed * self.before(law, group.phase)
        first, second, third = group.names
        yield ball(law, first, radius, MASS, (start, y, 0.0), (speed, *(0.0,) * 5), group=f"{first}_group")
        yield ball(law, second, radius, MASS, (0.0, y, 0.0), material=law.pair.first, group=f"{second}_group")
        yield ball(law, third, radius, MASS, (2.0 * radius, y, 0.0), group=f"{third}_group")

    def changes(self, law: ProbeLaw, group: _BodyGroup) -> Mapping[str, np.ndarray]:
        share = (1.0 + law.pair.restitution) * self.approach(law) / 3.0
        return {
            name: np.array([size * share, 0.0, 0.0]) for name, size in zip(group.names, (-2.0, 1.0, 1.0), strict=True)
        }

    def energy(self, law: ProbeLaw) -> float:
        e = law.pair.restitution
        return ((1.0 - 2.0 * e) ** 2 + 2.0 * (1.0 + e) ** 2) / 9.0


class Edge(_Together):
    """A box that lands on the two corners of one edge."""

    NAME = "edge"
    TEXT = "a box on one edge"
    ROLES = ("box",)
    STANDS = True

    def reached(self, law: ProbeLaw) -> bool:
        return law.reach.corners

    def _size(self, law: ProbeLaw) -> np.ndarray:
        return np.array(EDGE) * max(WIDTH, WAYS * self.approach(law) * law.timestep)

    def _lever(self, law: ProbeLaw) -> tuple[float, float]:
        """From the centre of mass to the edge that lands: x, z (m)."""
        half = self._size(law) / 2.0
        # turned about y by TILT: the corner (x, z) = (half, -half) is the lowest
        c, s = math.cos(TILT), math.sin(TILT)
        return float(c * half[0] - s * half[2]), float(-s * half[0] - c * half[2])

    def bodies(self, law: ProbeLaw, group: _BodyGroup) -> Iterator[Body]:
        start, way = flight(law, self.approach(law), group.phase)
        size = self._size(law)
        place = (3.0 * float(size[0]) * group.number, 0.0, -self._lever(law)[1] + way)
        down = (0.0, 0.0, -start, 0.0, 0.0, 0.0)
        turn = frames.from_axis_angle((0.0, 1.0, 0.0), TILT)
        yield box(law, group.names[0], vector3(size), MASS, place, down, turn)

    def _after(self, law: ProbeLaw) -> tuple[float, float, float]:
        """Impulses P and T, and the moment of inertia about y."""
        x, z = self._lever(law)
        size = self._size(law)
        inertia = MASS / 12.0 * float(size[0] ** 2 + size[2] ** 2)
        # an impulse (T, P) at (x, z) turns by (z T − x P)/I about y, and moves the edge along x by z, along z by −x
        mobility = np.array(
            [[1.0 / MASS + x * x / inertia, -x * z / inertia], [-x * z / inertia, 1.0 / MASS + z * z / inertia]]
        )
        normal, along = impulses(mobility, self.approach(law), 0.0, law.pair.friction, law.pair.restitution)
        return normal, along, inertia

    def changes(self, law: ProbeLaw, group: _BodyGroup) -> Mapping[str, np.ndarray]:
        normal, along, _ = self._after(law)
        return {group.names[0]: np.array([along, 0.0, normal]) / MASS}

    def energy(self, law: ProbeLaw) -> float:
        normal, along, inertia = self._after(law)
        x, z = self._lever(law)
        speed = self.approach(law)
        spin = (z * along - x * normal) / inertia
        motion = MASS * ((along / MASS) ** 2 + (normal / MASS - speed) ** 2) + inertia * spin * spin
        return motion / (MASS * speed * speed)
