"""Contact probes of sliding friction: pushed in 24 directions, sliding to rest, and held below the limit.

Pushes and slides are measured of a square slider and of an oblong one. The square one's contact points are moved as easily
along x as along y, so that it shows the pair's number, and the cone's section, to a solver's last digit. The oblong one's
are three times as easily moved across as along, and it shows whether friction is against the slip all the same: a solver
that takes its two axes one by one has that right for the square slider alone.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from simspec.proof.contact.bodies import FLOOR_SIZE, box, floor
from simspec.proof.contact.law import project, slide
from simspec.proof.contact.probe import GRAVITY, Figure, Law, Motion, Phase, Probe, Trial
from simspec.world import frames
from simspec.world.tuples import vector3
from simspec.world.types import Body, Quaternion, Vector3

DIRECTIONS = tuple(15.0 * number for number in range(24))
"""Degrees from the x axis of the floor."""
SQUARE, OBLONG, MASS = (0.2, 0.2, 0.02), (0.4, 0.1, 0.02), 1.0
"""Of the sliders (m, kg): flat, so that a push at the centre hardly tilts the pressure on the faces' corners. Oblong: a unit
impulse at a corner moves it by 1.2/m along x and 3.9/m along y, near the most that a uniform box has (1 and 4)."""
SPACING = 4.0
"""m between sliders, at least; none slides half as far."""
WIDE = 50.0
"""Edge of the square slider over c, at least, where the pair has rolling friction. Each of a face's points may then carry a
moment of up to c times its force, and nothing says which does: the pressure is off its middle by up to c, in a direction
that a solver's order decides, and the slider turns. At an edge of 10 c a push was 1.2 % off by it, of 40 c 0.14 %, in a
solver run to the end."""
WEIGHT = MASS * GRAVITY

PUSH = 1.6
"""Push over the limit of friction. Far enough above it for the slip to be clear, and near enough for friction to matter."""
SETTLE = 0.05
"""s in which sliders come to rest on the floor, at least ten steps; the softest contact measured takes some 30 ms at 1 ms."""
PUSHED = 0.06
"""s of pushing, at least 40 steps; the second half counts, so that the first slip does not."""
SPEED_OFF = 1.0
"""m/s at most while pushed: under an associated friction law, sliders hop at higher speed."""
PUSH_TOLERANCE = 0.01
"""Of μ: what is promised at 1 ms; solvers of finite accuracy stay below."""
UNBRAKED = 0.1
"""Push over the weight where there is no friction."""
NO_FRICTION = 1e-6
"""Tangential over normal force where μ = 0: round-off of solvers."""

SLIDE_STEPS = 250
"""Steps in which a slide ends; with a speed of SLIDE_STEPS μ g dt, up to SLIDE_SPEED."""
SLIDE_SPEED = 1.0
"""m/s: what slides faster is measured over the same number of steps, which it does not come to rest in."""
STOP_TOLERANCE = 0.015
"""Of the distance: what is promised at 1 ms. One step more or less is 1/250 of the time and 1/62500 of the distance."""

CARRIED = 30.0
"""Degrees from the x axis of the floor in which its surface moves."""

HELD = 0.8
"""Push over the limit, along each direction's own boundary of the cone."""
HELD_STEPS = 300
CREEP = 1e-4
"""m/s at 80 % of the limit: a body that rests creeps less than a hair's width in a second; solvers that are not run to
the end reach 1e-3."""


def _subject(law: Law) -> str:
    return f"{law.pair.first}, {law.pair.second}"


def _direction(degrees: float) -> np.ndarray:
    return np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])


def _sliders(law: Law, size: Vector3, speeds: Mapping[float, float]) -> tuple[Body, ...]:
    """A floor, and a slider of this size (m) for each direction with its initial speed along it: larger where ``WIDE`` says
    so."""
    scale = max(1.0, WIDE * law.pair.rolling_friction / SQUARE[0])
    size = (scale * size[0], scale * size[1], size[2])
    spacing = SPACING + 2.0 * (scale - 1.0) * SQUARE[0]
    x, y, z = FLOOR_SIZE
    bodies: list[Body] = [floor(law, (max(x, 8.0 * spacing), max(y, 8.0 * spacing), z))]
    for index, (degrees, speed) in enumerate(speeds.items()):
        at = (spacing * (index % 6 - 2.5), spacing * (index // 6 - 1.5), size[2] / 2)
        along, across = (speed * _direction(degrees)).tolist()
        bodies.append(box(law, _name(degrees), size, MASS, at, (along, across, 0.0, 0.0, 0.0, 0.0)))
    return tuple(bodies)


def _at_angle(figure: Figure, wanted: Figure) -> Figure | None:
    """``wanted`` where it is of the same name, case and quantity as ``figure``, and of a direction that is probed."""
    same = (figure.probe, figure.case, figure.quantity) == (wanted.probe, wanted.case, wanted.quantity)
    probed = wanted.angle is None or any(
        math.isclose(math.degrees(wanted.angle), one, abs_tol=1e-6) for one in DIRECTIONS
    )
    return wanted if same and probed else None


def _name(degrees: float) -> str:
    return f"slider_{degrees:g}"


def _pushes(law: Law, strength: float) -> dict[float, np.ndarray]:
    """The force (2,) on each slider: ``strength`` times the limit."""
    return {degrees: strength * law.pair.friction * WEIGHT * _direction(degrees) for degrees in DIRECTIONS}


def _efforts(pushes: Mapping[float, np.ndarray]) -> dict[str, tuple[float, float, float, float, float, float]]:
    return {_name(degrees): (float(push[0]), float(push[1]), 0.0, 0.0, 0.0, 0.0) for degrees, push in pushes.items()}


class Push(Probe):
    """Sliders pushed beyond the limit of friction."""

    NAME = "push"
    MEANING = "friction force of a slider pushed in 24 directions at 1.6 times the limit, against the cone"
    SIZE = SQUARE

    def applies(self, law: Law) -> bool:
        return law.pair.collide

    def _steps(self, law: Law) -> tuple[int, int]:
        """Steps to settle and to push."""
        pushed = max(40, math.ceil(PUSHED / law.timestep))
        acceleration = (PUSH - 1.0 / math.sqrt(2.0)) * max(law.pair.friction, 0.05) * GRAVITY
        most = max(20, int(SPEED_OFF / acceleration / law.timestep))
        return max(10, math.ceil(SETTLE / law.timestep)), min(pushed, most)

    def _force(self, law: Law) -> dict[float, np.ndarray]:
        if law.pair.friction:
            return _pushes(law, PUSH)
        return {degrees: UNBRAKED * WEIGHT * _direction(degrees) for degrees in DIRECTIONS}

    def trials(self, law: Law) -> Sequence[Trial]:
        settle, pushed = self._steps(law)
        half = pushed // 2
        efforts = _efforts(self._force(law))
        phases = (Phase(settle, settle), Phase(pushed - half, pushed - half, efforts), Phase(half, half, efforts))
        return [Trial(_sliders(law, self.SIZE, dict.fromkeys(DIRECTIONS, 0.0)), phases)]

    def wanted(self, law: Law) -> Sequence[Figure]:
        return [self._wanted(law, 0.0)]

    def reference(self, law: Law, figure: Figure) -> Figure | None:
        return _at_angle(figure, self._wanted(law, figure.angle or 0.0))

    def _wanted(self, law: Law, angle: float) -> Figure:
        """The figure of the direction ``angle`` (rad)."""
        friction = law.pair.friction
        strength = PUSH * friction if friction else UNBRAKED
        size = float(np.linalg.norm(project(strength * _direction(math.degrees(angle)), friction, law.friction_cone)))
        tolerance = PUSH_TOLERANCE * friction if friction else NO_FRICTION
        numbers = (size, None, tolerance)
        without = 0.0 if friction else None
        case = f"{len(DIRECTIONS)} directions"
        return Figure(self.NAME, _subject(law), case, "friction", "", *numbers, angle=angle, without=without)

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        motion = motions[0]
        time = motion.time[-1] - motion.time[-2]
        rows, worst = [], None
        for degrees, push in self._force(law).items():
            velocity = motion.velocity[_name(degrees)]
            acceleration = (velocity[-1, :2] - velocity[-2, :2]) / time
            # over the weight, which is what the floor carries in the mean: what hops counts as it is
            measured = (push - MASS * acceleration) / WEIGHT
            expected = project(push / WEIGHT, law.pair.friction, law.friction_cone)
            rows.append((math.radians(degrees), float(measured[0]), float(measured[1])))
            off = float(np.linalg.norm(measured - expected))
            if worst is None or not off <= worst[0]:
                worst = (off, degrees, float(np.linalg.norm(expected)))
        if worst is None:
            raise ValueError("no direction was pushed")
        off, degrees, expected_size = worst
        friction = law.pair.friction
        tolerance = PUSH_TOLERANCE * friction if friction else NO_FRICTION
        # the vector's error as a number: how far from the required force, whichever way
        along = float(np.linalg.norm(next(row for row in rows if row[0] == math.radians(degrees))[1:]))
        sign = 1.0 if along >= expected_size else -1.0
        figure = Figure(
            self.NAME,
            _subject(law),
            f"{len(DIRECTIONS)} directions",
            "friction",
            "",
            expected_size,
            expected_size + sign * off,
            tolerance,
            points=tuple(rows),
            worst=f"{degrees:g}°",
            angle=math.radians(degrees),
        )
        return [figure]


class Stop(Probe):
    """Sliders with an initial speed."""

    NAME = "stop"
    MEANING = "distance of a slide in 24 directions, against the one-step law (elliptic: v²/2μg − v dt/2)"
    SIZE = SQUARE

    def applies(self, law: Law) -> bool:
        return law.pair.collide and law.pair.friction > 0.0

    def _speed(self, law: Law) -> float:
        return min(SLIDE_SPEED, SLIDE_STEPS * law.pair.friction * GRAVITY * law.timestep)

    def _steps(self, law: Law) -> int:
        # pyramids stop late along their edges; twice the time of a disc is enough for all
        needed = 2.0 * self._speed(law) / (law.pair.friction * GRAVITY * law.timestep) + 10
        return math.ceil(min(needed, 2.0 * SLIDE_STEPS))

    def trials(self, law: Law) -> Sequence[Trial]:
        steps = self._steps(law)
        return [Trial(_sliders(law, self.SIZE, dict.fromkeys(DIRECTIONS, self._speed(law))), (Phase(steps, steps),))]

    def wanted(self, law: Law) -> Sequence[Figure]:
        return [self._wanted(law, 0.0)]

    def reference(self, law: Law, figure: Figure) -> Figure | None:
        return _at_angle(figure, self._wanted(law, figure.angle or 0.0))

    def _wanted(self, law: Law, angle: float) -> Figure:
        """The figure of the direction ``angle`` (rad). Without friction it would go on at its speed, and be off by the way that
        it then is too far."""
        speed, steps, dt = self._speed(law), self._steps(law), law.timestep
        start = speed * _direction(math.degrees(angle))
        path, _ = slide(start, law.pair.friction, GRAVITY, dt, law.friction_cone, steps)
        expected = float(np.linalg.norm(path[-1]))
        without = expected + float(np.linalg.norm(start * steps * dt - path[-1]))
        case = f"from {speed:.3g} m/s, {len(DIRECTIONS)} directions"
        numbers = (expected, None, STOP_TOLERANCE * expected)
        return Figure(self.NAME, _subject(law), case, "distance", "m", *numbers, angle=angle, without=without)

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        speed, steps, dt = self._speed(law), self._steps(law), law.timestep
        worst: tuple[float, float, float, float] | None = None
        rows = []
        for degrees in DIRECTIONS:
            pose = motions[0].pose[_name(degrees)]
            way = pose[-1, :2] - pose[0, :2]
            path, _ = slide(speed * _direction(degrees), law.pair.friction, GRAVITY, dt, law.friction_cone, steps)
            expected = float(np.linalg.norm(path[-1]))
            off = float(np.linalg.norm(way - path[-1]))
            rows.append((math.radians(degrees), float(way[0]), float(way[1])))
            if worst is None or not off / expected <= worst[0]:
                sign = 1.0 if np.linalg.norm(way) >= expected else -1.0
                worst = (off / expected, degrees, expected, expected + sign * off)
        if worst is None:
            raise ValueError("nothing slid")
        _, degrees, expected, measured = worst
        case, at = f"from {speed:.3g} m/s, {len(DIRECTIONS)} directions", math.radians(degrees)
        numbers = (expected, measured, STOP_TOLERANCE * expected)
        return [Figure(self.NAME, _subject(law), case, "distance", "m", *numbers, worst=f"{degrees:g}°", angle=at)]


class Stick(Probe):
    """Sliders pushed below the limit of friction."""

    NAME = "stick"
    MEANING = "creep of a slider pushed in 24 directions at 0.8 times the limit, against none"

    def applies(self, law: Law) -> bool:
        return law.pair.collide and law.pair.friction > 0.0

    def _force(self, law: Law) -> dict[float, np.ndarray]:
        """0.8 of what the cone holds in each direction."""
        return {degrees: self._held(law, degrees) for degrees in DIRECTIONS}

    def _held(self, law: Law, degrees: float) -> np.ndarray:
        direction = _direction(degrees)
        if law.friction_cone == "elliptic":
            reach = 1.0
        elif law.friction_cone == "pyramid-inscribed":
            reach = 1.0 / float(np.abs(direction).sum())
        else:
            reach = 1.0 / float(np.abs(direction).max())
        held: np.ndarray = HELD * reach * law.pair.friction * WEIGHT * direction
        return held

    def wanted(self, law: Law) -> Sequence[Figure]:
        return [self._wanted(law, 0.0)]

    def reference(self, law: Law, figure: Figure) -> Figure | None:
        return _at_angle(figure, self._wanted(law, figure.angle or 0.0))

    def _wanted(self, law: Law, angle: float) -> Figure:
        """The figure of the direction ``angle`` (rad); ``without``: the mean speed of the steps that count, if nothing held."""
        pushed = float(np.linalg.norm(self._held(law, math.degrees(angle)))) / MASS
        without = pushed * law.timestep * (HELD_STEPS - HELD_STEPS // 3 / 2.0)
        case = f"{len(DIRECTIONS)} directions"
        return Figure(self.NAME, _subject(law), case, "creep", "m/s", 0.0, None, CREEP, angle=angle, without=without)

    def trials(self, law: Law) -> Sequence[Trial]:
        settle = max(10, math.ceil(SETTLE / law.timestep))
        efforts = _efforts(self._force(law))
        last = HELD_STEPS // 3
        phases = (
            Phase(settle, settle),
            Phase(HELD_STEPS - last, HELD_STEPS - last, efforts),
            Phase(last, last, efforts),
        )
        return [Trial(_sliders(law, SQUARE, dict.fromkeys(DIRECTIONS, 0.0)), phases)]

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        motion = motions[0]
        time = motion.time[-1] - motion.time[-2]
        creep = {}
        for degrees in DIRECTIONS:
            pose = motion.pose[_name(degrees)]
            creep[degrees] = float(np.linalg.norm(pose[-1, :2] - pose[-2, :2])) / time
        worst = max(creep, key=lambda degrees: math.inf if math.isnan(creep[degrees]) else creep[degrees])
        case, at = f"{len(DIRECTIONS)} directions", math.radians(worst)
        numbers = (0.0, creep[worst], CREEP)
        return [Figure(self.NAME, _subject(law), case, "creep", "m/s", *numbers, worst=f"{worst:g}°", angle=at)]


class Carry(Stop):
    """A slider that is put down on a surface that moves, at the speed of the slides: by what its own is off, so is this one."""

    NAME = "carry"
    MEANING = (
        "how far a moving surface carries a slider that is put down at rest, against the one-step law in its frame"
    )

    def applies(self, law: Law) -> bool:
        return super().applies(law) and any(law.belt)

    def trials(self, law: Law) -> Sequence[Trial]:
        carrying = floor(law)
        (shape,) = carrying.shapes
        share = self._speed(law) / float(np.linalg.norm(law.belt))
        told = vector3(share * value for value in (law.belt if law.belt_told is None else law.belt_told))
        moving = dataclasses.replace(shape, surface_velocity=(*frames.rotate(_onto(law.belt), told), 0.0, 0.0, 0.0))
        steps = self._steps(law)
        slider = box(law, _name(0.0), SQUARE, MASS, (0.0, 0.0, SQUARE[2] / 2))
        return [Trial((dataclasses.replace(carrying, shapes=(moving,)), slider), (Phase(steps, steps),))]

    def _wanted(self, law: Law, angle: float) -> Figure:
        speed, steps, dt = self._speed(law), self._steps(law), law.timestep
        belt = speed * _direction(CARRIED)
        slipped, _ = slide(-belt, law.pair.friction, GRAVITY, dt, law.friction_cone, steps)
        size = float(np.linalg.norm(belt * steps * dt + slipped[-1]))
        numbers = (size, None, STOP_TOLERANCE * float(np.linalg.norm(slipped[-1])))
        case = f"by a surface at {speed:.3g} m/s"
        return Figure(self.NAME, _subject(law), case, "distance", "m", *numbers, without=0.0)

    def figures(self, law: Law, motions: Sequence[Motion]) -> Sequence[Figure]:
        speed, steps, dt = self._speed(law), self._steps(law), law.timestep
        belt = speed * _direction(CARRIED)
        slipped, _ = slide(-belt, law.pair.friction, GRAVITY, dt, law.friction_cone, steps)
        pose = motions[0].pose[_name(0.0)]
        way, expected = pose[-1, :2] - pose[0, :2], belt * steps * dt + slipped[-1]
        size, off = float(np.linalg.norm(expected)), float(np.linalg.norm(way - expected))
        sign = 1.0 if np.linalg.norm(way) >= size else -1.0
        numbers = (size, size + sign * off, STOP_TOLERANCE * float(np.linalg.norm(slipped[-1])))
        return [Figure(self.NAME, _subject(law), f"by a surface at {speed:.3g} m/s", "distance", "m", *numbers)]


def _onto(belt: Vector3) -> Quaternion:
    """A rotation that takes the direction of a velocity to the one in which the floor carries."""
    along, (x, y) = np.array(belt) / np.linalg.norm(belt), _direction(CARRIED)
    axis = np.cross(along, (x, y, 0.0))
    sine, cosine = float(np.linalg.norm(axis)), float(along @ (x, y, 0.0))
    about = vector3(axis / sine) if sine > 1e-9 else (0.0, 0.0, 1.0)
    return frames.from_axis_angle(about, math.atan2(sine, cosine))


class PushOblong(Push):
    """Oblong sliders pushed beyond the limit of friction."""

    NAME = "push-oblong"
    MEANING = "friction force of an oblong slider pushed in 24 directions at 1.6 times the limit, against the cone"
    SIZE = OBLONG

    def applies(self, law: Law) -> bool:
        return super().applies(law) and law.pair.friction > 0.0


class StopOblong(Stop):
    """Oblong sliders with an initial speed."""

    NAME = "stop-oblong"
    MEANING = "where an oblong slider ends that slides in 24 directions, against the one-step law"
    SIZE = OBLONG


PROBES: Mapping[str, Probe] = {
    probe.NAME: probe for probe in (Push(), PushOblong(), Stop(), StopOblong(), Stick(), Carry())
}
