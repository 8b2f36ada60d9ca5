"""Contact probes of impacts that touch several places at once: one ball on two, a ball against a row, a box on one edge.

The law is that of every single contact (see ``world.types.Hardness``): in the step of the impact each contact separates at e
times the speed at which it approached, and one that did not approach stays closed or opens. The impulses solve one linear
system, P along the normal and T along the surface, with T = μ P where it slips (Newton's law of restitution with Coulomb's of
friction; Brach 1991, Mechanical Impact Dynamics, ch. 6). Without friction the law never adds energy; with friction it adds some
percent at e = 1 (Kane and Levinson 1985, Dynamics). A solver that restores one contact after the other adds 12.5 % where one
ball hits two (measured, docs/proof.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from simspec.proof.contact.bodies import ball, box, floor
from simspec.proof.contact.impact import RESTITUTION_TOLERANCE, TURNED, subject
from simspec.proof.contact.oblique import ABOVE_THRESHOLD, GRAZES, impact_begins
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial
from simspec.world import frames
from simspec.world.tuples import sorted_pair, vector3
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
STEPS_BEFORE, STEPS_AFTER = 2, 8
"""Whole steps of flight before the one that arrives, and steps from there on."""
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
class _Group:
    """Bodies that meet: names, share of a step after which they do, and place in the grid."""

    names: tuple[str, ...]
    phase: float
    number: int

    def group(self, index: int) -> str:
        return f"{self.names[index]}_group"


class _Together(Probe):
    """What the three have in common: change of velocity of each body, and energy after over energy before."""

    TEXT: str
    STANDS = False
    """Whether the bodies meet what is fixed."""

    def applies(self, law: Law) -> bool:
        """Rolling friction is a moment that the impulses have no place for."""
        rigid = law.pair.collide and law.pair.hardness.kind == "common" and not law.pair.rolling_friction
        return rigid and self.reached(law)

    def reached(self, law: Law) -> bool:
        """Whether bodies of the two materials can meet so."""
        return law.reach.gathers

    def approach(self, law: Law) -> float:
        return max(APPROACH, ABOVE_THRESHOLD * law.pair.restitution_threshold)

    def radius(self, law: Law) -> float:
        return max(RADIUS, WAYS * self.approach(law) * law.timestep)

    def before(self, law: Law, phase: float) -> float:
        """Seconds until bodies meet."""
        return (STEPS_BEFORE + phase) * law.timestep

    def groups(self) -> list[_Group]:
        raise NotImplementedError

    def bodies(self, law: Law, group: _Group) -> Iterator[Body]:
        raise NotImplementedError

    def meets(self, group: _Group) -> tuple[tuple[str, str], ...]:
        return ()

    def changes(self, law: Law, group: _Group) -> Mapping[str, np.ndarray]:
        """Change (3,) of each body's velocity (m/s), by the law."""
        raise NotImplementedError

    def energy(self, law: Law) -> float:
        """Kinetic energy after over before, by the law."""
        raise NotImplementedError

    def fixed(self, law: Law) -> list[Body]:
        return []

    def trials(self, law: Law) -> Sequence[Trial]:
        groups = self.groups()
        bodies = [*self.fixed(law), *(body for group in groups for body in self.bodies(law, group))]
        meets = tuple(sorted_pair(*pair) for group in groups for pair in self.meets(group))
        return [Trial(tuple(bodies), (Phase(STEPS_BEFORE + STEPS_AFTER),), meets)]

    def wanted(self, law: Law) -> Sequence[Figure]:
        """Of each body, and the energy; without the impact nothing changes."""
        figures = []
        share = VELOCITY_TOLERANCE * max(1.0, law.timestep / LONG)
        tolerance = share * (1.0 + law.pair.restitution) * self.approach(law)
        roles = {_role(name): change for name, change in self.changes(law, self.groups()[0]).items()}
        for role, change in roles.items():
            named = (self.NAME, subject(law), f"{self.TEXT}: {role}", "change of velocity", "m/s")
            figures.append(Figure(*named, float(np.linalg.norm(change)), None, tolerance, without=0.0))
        share = self.energy(law)
        named = (f"{self.NAME}-energy", subject(law), self.TEXT, "energy after, over before", "")
        # a step's gravity, of which engines differ by one, changes the square of the speed
        tolerance = RESTITUTION_TOLERANCE + 2.0 * GRAVITY * law.timestep / self.approach(law)
        return [*figures, Figure(*named, share, None, tolerance, without=None if share >= 1.0 else 1.0)]

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        motion, bodies = motions[0], {body.name: body for body in self.trials(law)[0].bodies}
        seen: dict[str, list[tuple[float, _Group]]] = {}
        energies = []
        for group in self.groups():
            begin, end = self._span(law, group, motion)
            fallen = np.array([0.0, 0.0, GRAVITY * law.timestep])
            before = {name: motion.velocity[name][begin] for name in group.names}
            after = {name: np.array(motion.velocity[name][end]) for name in group.names}
            for name, expected in self.changes(law, group).items():
                # one step of what lands leaves gravity no time
                after[name][:3] += fallen * (end - begin - self.STANDS)
                change = after[name][:3] - before[name][:3]
                off, size = float(np.linalg.norm(change - expected)), float(np.linalg.norm(expected))
                signed = size + math.copysign(off, float(np.linalg.norm(change)) - size)
                seen.setdefault(_role(name), []).append((signed, group))
            # as seen by what falls freely, where nothing stands
            falling = fallen * (0.0 if self.STANDS else begin)
            start, stop = (
                sum(_kinetic(bodies[name], states[name], falling, motion.pose[name][at]) for name in group.names)
                for states, at in ((before, begin), (after, end))
            )
            energies.append((stop / start, group))
        figures = []
        for figure in self.wanted(law):
            values = seen.get(figure.case.removeprefix(f"{self.TEXT}: "), energies)
            measured, group = max(values, key=lambda entry: _distance(entry[0], figure.expected))
            figures.append(replace(figure, measured=measured, worst=f"{group.phase:g} of a step"))
        return figures

    def _span(self, law: Law, group: _Group, motion: Motion) -> tuple[int, int]:
        """Numbers of the last step before the impact and of the first after it, of all bodies of the group."""
        begins, ends = [], []
        for name in group.names:
            velocity = motion.velocity[name][:, :3] + np.outer(motion.time, (0.0, 0.0, GRAVITY))
            begin = impact_begins(velocity, law.timestep)
            along = velocity[begin + 1] - velocity[begin]
            begins.append(begin)
            ends.append(_ends(velocity @ along / float(np.linalg.norm(along)), begin, law.timestep))
        return min(begins), max(ends)


def _role(name: str) -> str:
    return name.rsplit("_", 1)[0].replace("left", "struck").replace("right", "struck")


def _distance(value: float, expected: float) -> float:
    return math.inf if math.isnan(value) else abs(value - expected)


def _ends(speed: np.ndarray, begin: int, timestep: float) -> int:
    """The first step after an impact, from the speeds (n,) along it: it goes on while steps add more than ``TURNED`` of what
    the first step added, and more than the weight of what stays in touch can."""
    change = np.diff(speed)
    end = begin + 1
    while end < len(change) and change[end] > TURNED * change[begin] + 2.0 * GRAVITY * timestep:
        end += 1
    return end


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
    MEANING = "velocities and energy after one ball has hit two at once, against the law of all contacts together"
    TEXT = "one ball on two"

    def groups(self) -> list[_Group]:
        return [
            _Group((f"striker_{number}", f"left_{number}", f"right_{number}"), phase, number)
            for number, phase in enumerate(PHASES)
        ]

    def meets(self, group: _Group) -> tuple[tuple[str, str], ...]:
        return ((group.group(0), group.group(1)), (group.group(0), group.group(2)))

    def bodies(self, law: Law, group: _Group) -> Iterator[Body]:
        radius = self.radius(law)
        y = SPACING * radius * group.number
        height = 2.0 * radius * math.cos(OPENING) + self.approach(law) * self.before(law, group.phase)
        down = (0.0, 0.0, -self.approach(law), 0.0, 0.0, 0.0)
        striker, left, right = group.names
        yield ball(law, striker, radius, MASS, (0.0, y, height), down, material=law.pair.first, group=group.group(0))
        yield ball(law, left, radius, MASS, (-radius, y, 0.0), group=group.group(1))
        yield ball(law, right, radius, MASS, (radius, y, 0.0), group=group.group(2))

    def _impulses(self, law: Law) -> tuple[float, float]:
        c, s = math.cos(OPENING), math.sin(OPENING)
        mobility = np.array([[1.0 + 2.0 * c * c, 2.0 * c * s], [2.0 * c * s, 3.5 + 2.0 * s * s]]) / MASS
        speed = self.approach(law)
        return impulses(mobility, speed * c, speed * s, law.pair.friction, law.pair.restitution)

    def changes(self, law: Law, group: _Group) -> Mapping[str, np.ndarray]:
        c, s = math.cos(OPENING), math.sin(OPENING)
        normal, along = self._impulses(law)
        found = {group.names[0]: np.array([0.0, 0.0, 2.0 * (normal * c + along * s) / MASS])}
        for name, side in zip(group.names[1:], (-1.0, 1.0), strict=True):
            found[name] = np.array([side * (normal * s - along * c), 0.0, -normal * c - along * s]) / MASS
        return found

    def energy(self, law: Law) -> float:
        _, along = self._impulses(law)
        changes = self.changes(law, self.groups()[0])
        speed = self.approach(law)
        striker, left, _ = changes.values()
        spin = 2.5 * along * along / MASS  # of each struck ball: T² r² / I
        return float((striker[2] - speed) ** 2 * MASS + 2.0 * (left @ left * MASS + spin)) / (MASS * speed * speed)


class Row(_Together):
    """A ball against two that touch, in line."""

    NAME = "row"
    MEANING = (
        "velocities and energy after a ball has hit a row of two that touch, against the law of all contacts together"
    )
    TEXT = "a ball against a row of two"

    def groups(self) -> list[_Group]:
        return [
            _Group((f"first_{number}", f"second_{number}", f"third_{number}"), phase, number)
            for number, phase in enumerate(PHASES)
        ]

    def meets(self, group: _Group) -> tuple[tuple[str, str], ...]:
        return ((group.group(0), group.group(1)), (group.group(1), group.group(2)))

    def bodies(self, law: Law, group: _Group) -> Iterator[Body]:
        radius, speed = self.radius(law), self.approach(law)
        y = SPACING * radius * group.number
        start = -2.0 * radius - speed * self.before(law, group.phase)
        first, second, third = group.names
        yield ball(law, first, radius, MASS, (start, y, 0.0), (speed, *(0.0,) * 5), group=group.group(0))
        yield ball(law, second, radius, MASS, (0.0, y, 0.0), material=law.pair.first, group=group.group(1))
        yield ball(law, third, radius, MASS, (2.0 * radius, y, 0.0), group=group.group(2))

    def changes(self, law: Law, group: _Group) -> Mapping[str, np.ndarray]:
        share = (1.0 + law.pair.restitution) * self.approach(law) / 3.0
        return {
            name: np.array([size * share, 0.0, 0.0]) for name, size in zip(group.names, (-2.0, 1.0, 1.0), strict=True)
        }

    def energy(self, law: Law) -> float:
        e = law.pair.restitution
        return ((1.0 - 2.0 * e) ** 2 + 2.0 * (1.0 + e) ** 2) / 9.0


class Edge(_Together):
    """A box that lands on the two corners of one edge."""

    NAME = "edge"
    MEANING = "velocity and energy after a box has landed on two corners, against the law of both together"
    TEXT = "a box on one edge"
    STANDS = True

    def reached(self, law: Law) -> bool:
        return law.reach.corners

    def groups(self) -> list[_Group]:
        return [_Group((f"box_{number}",), phase, number) for number, phase in enumerate(PHASES)]

    def fixed(self, law: Law) -> list[Body]:
        return [floor(law)]

    def _size(self, law: Law) -> np.ndarray:
        return np.array(EDGE) * max(WIDTH, WAYS * self.approach(law) * law.timestep)

    def _lever(self, law: Law) -> tuple[float, float]:
        """From the centre of mass to the edge that lands: x, z (m)."""
        half = self._size(law) / 2.0
        # turned about y by TILT: the corner (x, z) = (half, -half) is the lowest
        c, s = math.cos(TILT), math.sin(TILT)
        return float(c * half[0] - s * half[2]), float(-s * half[0] - c * half[2])

    def bodies(self, law: Law, group: _Group) -> Iterator[Body]:
        dt, approach = law.timestep, self.approach(law)
        start = approach - (STEPS_BEFORE + 1) * GRAVITY * dt
        flown = sum(start + GRAVITY * dt * step for step in range(1, STEPS_BEFORE + 1)) + group.phase * approach
        size = self._size(law)
        place = (3.0 * float(size[0]) * group.number, 0.0, -self._lever(law)[1] + flown * dt)
        down = (0.0, 0.0, -start, 0.0, 0.0, 0.0)
        turn = frames.from_axis_angle((0.0, 1.0, 0.0), TILT)
        yield box(law, group.names[0], vector3(size), MASS, place, down, turn)

    def _after(self, law: Law) -> tuple[float, float, float]:
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

    def changes(self, law: Law, group: _Group) -> Mapping[str, np.ndarray]:
        normal, along, _ = self._after(law)
        return {group.names[0]: np.array([along, 0.0, normal]) / MASS}

    def energy(self, law: Law) -> float:
        normal, along, inertia = self._after(law)
        x, z = self._lever(law)
        speed = self.approach(law)
        spin = (z * along - x * normal) / inertia
        motion = MASS * ((along / MASS) ** 2 + (normal / MASS - speed) ** 2) + inertia * spin * spin
        return motion / (MASS * speed * speed)


PROBES: Mapping[str, Probe] = {probe.NAME: probe for probe in (Strike(), Row(), Edge())}
