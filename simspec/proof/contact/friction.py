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

from simspec.proof.contact.probe import (
    GRAVITY,
    Phase,
    Probe,
    ProbeFigure,
    ProbeLaw,
    ProbeTrial,
    TrialMotion,
    cone_norm,
    direction,
    furthest,
    project,
    signed_size,
    slide,
)
from simspec.proof.contact.worlds import FLOOR_SIZE, box, floor
from simspec.world import frames
from simspec.world.frames import vector3
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
"""Of μ: the promise at 1 ms; solvers of finite accuracy stay below."""
UNBRAKED = 0.1
"""Push over the weight where there is no friction."""
NO_FRICTION = 1e-6
"""Tangential over normal force where μ = 0: round-off of solvers."""

SLIDE_STEPS = 250
"""Steps in which a slide ends; with a speed of SLIDE_STEPS μ g dt, up to SLIDE_SPEED."""
SLIDE_SPEED = 1.0
"""m/s: a faster slide is measured over the same number of steps, which it does not come to rest in."""
STOP_TOLERANCE = 0.015
"""Of the distance: the promise at 1 ms. One step more or less is 1/250 of the time and 1/62500 of the distance."""

CARRIED = 30.0
"""Degrees from the x axis of the floor in which its surface moves."""

STICK_PUSH = 0.8
"""Push over the limit, along each direction's own boundary of the cone."""
STICK_STEPS = 300
CREEP = 1e-4
"""m/s at 80 % of the limit: a body that rests creeps less than a hair's width in a second; solvers that are not run to
the end reach 1e-3."""


Vectors = dict[float, tuple[np.ndarray, np.ndarray]]
"""By direction (degrees): the measured vector (2,) and the expected one."""


def _name(degrees: float) -> str:
    return f"slider_{degrees:g}"


class _Sliders(Probe):
    """Sliders in 24 directions: one figure, of the direction that is furthest off."""

    SIZE: Vector3 = SQUARE
    RELATIVE = False
    """Whether directions are compared by their relative error."""

    def vectors(self, law: ProbeLaw, motion: TrialMotion) -> Vectors:
        raise NotImplementedError

    def at(self, law: ProbeLaw, angle: float) -> ProbeFigure:
        """The figure of the direction ``angle`` (rad)."""
        raise NotImplementedError

    def applies(self, law: ProbeLaw) -> bool:
        return law.pair.collide and law.pair.friction > 0.0

    def bodies(self, law: ProbeLaw, speed: float = 0.0) -> tuple[Body, ...]:
        """A floor, and a slider for each direction with this initial speed along it: larger where ``WIDE`` says so."""
        scale = max(1.0, WIDE * law.pair.rolling_friction / SQUARE[0])
        size = (scale * self.SIZE[0], scale * self.SIZE[1], self.SIZE[2])
        spacing = SPACING + 2.0 * (scale - 1.0) * SQUARE[0]
        x, y, z = FLOOR_SIZE
        bodies: list[Body] = [floor(law, (max(x, 8.0 * spacing), max(y, 8.0 * spacing), z))]
        for index, degrees in enumerate(DIRECTIONS):
            at = (spacing * (index % 6 - 2.5), spacing * (index // 6 - 1.5), size[2] / 2)
            along, across = (speed * direction(degrees)).tolist()
            bodies.append(box(law, _name(degrees), size, MASS, at, (along, across, 0.0, 0.0, 0.0, 0.0)))
        return tuple(bodies)

    def pushed(self, law: ProbeLaw, forces: Mapping[float, np.ndarray], steps: int, last: int) -> Sequence[ProbeTrial]:
        """Sliders that come to rest and are pushed by these forces (2,), seen before the ``last`` of the steps and after."""
        settle = law.steps(SETTLE, 10)
        efforts = {_name(key): (float(force[0]), float(force[1]), 0.0, 0.0, 0.0, 0.0) for key, force in forces.items()}
        phases = (Phase(settle, settle), Phase(steps - last, steps - last, efforts), Phase(last, last, efforts))
        return [ProbeTrial(self.bodies(law), phases)]

    def wanted(self, law: ProbeLaw) -> Sequence[ProbeFigure]:
        return [self.at(law, 0.0)]

    def reference(self, law: ProbeLaw, figure: ProbeFigure) -> ProbeFigure | None:
        wanted = self.at(law, figure.angle or 0.0)
        same = (figure.probe, figure.case, figure.quantity) == (wanted.probe, wanted.case, wanted.quantity)
        probed = wanted.angle is None or any(
            math.isclose(math.degrees(wanted.angle), degrees, abs_tol=1e-6) for degrees in DIRECTIONS
        )
        return wanted if same and probed else None

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[ProbeFigure]:
        vectors = self.vectors(law, motions[0])
        errors = {
            degrees: float(np.linalg.norm(measured - expected) / (np.linalg.norm(expected) if self.RELATIVE else 1.0))
            for degrees, (measured, expected) in vectors.items()
        }
        worst = furthest(errors)
        points = tuple((math.radians(key), float(vector[0]), float(vector[1])) for key, (vector, _) in vectors.items())
        figure = self.at(law, math.radians(worst))
        return [dataclasses.replace(figure, measured=signed_size(*vectors[worst]), worst=f"{worst:g}°", points=points)]


class Push(_Sliders):
    """Friction force of sliders pushed in 24 directions at 1.6 times the limit, against the cone."""

    NAME = "push"

    def applies(self, law: ProbeLaw) -> bool:
        return law.pair.collide

    def _force(self, law: ProbeLaw, degrees: float) -> np.ndarray:
        """The push (2,), in N."""
        force: np.ndarray = (PUSH * law.pair.friction or UNBRAKED) * WEIGHT * direction(degrees)
        return force

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        acceleration = (PUSH - 1.0 / math.sqrt(2.0)) * max(law.pair.friction, 0.05) * GRAVITY
        most = max(20, int(SPEED_OFF / acceleration / law.timestep))
        steps = min(law.steps(PUSHED, 40), most)
        return self.pushed(law, {degrees: self._force(law, degrees) for degrees in DIRECTIONS}, steps, steps // 2)

    def at(self, law: ProbeLaw, angle: float) -> ProbeFigure:
        friction = law.pair.friction
        expected = project(self._force(law, math.degrees(angle)) / WEIGHT, friction, law.friction_cone)
        tolerance, without = (PUSH_TOLERANCE * friction, 0.0) if friction else (NO_FRICTION, None)
        size, case = float(np.linalg.norm(expected)), f"{len(DIRECTIONS)} directions"
        return self.figure(law, case, "friction", "", size, tolerance, angle=angle, without=without)

    def vectors(self, law: ProbeLaw, motion: TrialMotion) -> Vectors:
        time = motion.time[-1] - motion.time[-2]
        found = {}
        for degrees in DIRECTIONS:
            velocity, push = motion.velocity[_name(degrees)], self._force(law, degrees)
            acceleration = (velocity[-1, :2] - velocity[-2, :2]) / time
            # over the weight, which the floor carries in the mean: a slider that hops counts as it is
            measured = (push - MASS * acceleration) / WEIGHT
            found[degrees] = (measured, project(push / WEIGHT, law.pair.friction, law.friction_cone))
        return found


class Stop(_Sliders):
    """Distance of a slide in 24 directions, against the one-step law (elliptic: v²/2μg − v dt/2)."""

    NAME = "stop"
    RELATIVE = True

    def speed(self, law: ProbeLaw) -> float:
        return min(SLIDE_SPEED, SLIDE_STEPS * law.pair.friction * GRAVITY * law.timestep)

    def steps(self, law: ProbeLaw) -> int:
        # pyramids stop late along their edges; twice the time of a disc is enough for all
        needed = 2.0 * self.speed(law) / (law.pair.friction * GRAVITY * law.timestep) + 10
        return math.ceil(min(needed, 2.0 * SLIDE_STEPS))

    def slipped(self, law: ProbeLaw, degrees: float, sign: float = 1.0) -> np.ndarray:
        """The way (2,), in m, of a slide in this direction (``sign`` -1: against it)."""
        path, _ = slide(sign * self.speed(law) * direction(degrees), law, self.steps(law))
        end: np.ndarray = path[-1]
        return end

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        steps = self.steps(law)
        return [ProbeTrial(self.bodies(law, self.speed(law)), (Phase(steps, steps),))]

    def at(self, law: ProbeLaw, angle: float) -> ProbeFigure:
        """Without friction it would go on at its speed, and be off by the way that it then is too far."""
        degrees, speed = math.degrees(angle), self.speed(law)
        way = self.slipped(law, degrees)
        expected = float(np.linalg.norm(way))
        free = speed * direction(degrees) * self.steps(law) * law.timestep
        without = expected + float(np.linalg.norm(free - way))
        case, tolerance = f"from {speed:.3g} m/s, {len(DIRECTIONS)} directions", STOP_TOLERANCE * expected
        return self.figure(law, case, "distance", "m", expected, tolerance, angle=angle, without=without)

    def vectors(self, law: ProbeLaw, motion: TrialMotion) -> Vectors:
        poses = {degrees: motion.pose[_name(degrees)] for degrees in DIRECTIONS}
        return {key: (pose[-1, :2] - pose[0, :2], self.slipped(law, key)) for key, pose in poses.items()}


class Stick(_Sliders):
    """Creep of sliders pushed in 24 directions at 0.8 times the limit, against none."""

    NAME = "stick"

    def _force(self, law: ProbeLaw, degrees: float) -> np.ndarray:
        """0.8 of the force (2,), in N, that the cone holds in a direction."""
        along = direction(degrees)
        reach = 1.0 if law.friction_cone == "elliptic" else 1.0 / cone_norm(along, law.friction_cone)
        force: np.ndarray = STICK_PUSH * reach * law.pair.friction * WEIGHT * along
        return force

    def at(self, law: ProbeLaw, angle: float) -> ProbeFigure:
        """``without``: the mean speed of the steps that count, if nothing held."""
        push = float(np.linalg.norm(self._force(law, math.degrees(angle)))) / MASS
        without = push * law.timestep * (STICK_STEPS - STICK_STEPS // 3 / 2.0)
        case = f"{len(DIRECTIONS)} directions"
        return self.figure(law, case, "creep", "m/s", 0.0, CREEP, angle=angle, without=without)

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        forces = {degrees: self._force(law, degrees) for degrees in DIRECTIONS}
        return self.pushed(law, forces, STICK_STEPS, STICK_STEPS // 3)

    def vectors(self, law: ProbeLaw, motion: TrialMotion) -> Vectors:
        time = motion.time[-1] - motion.time[-2]
        poses = {degrees: motion.pose[_name(degrees)] for degrees in DIRECTIONS}
        return {key: ((pose[-1, :2] - pose[-2, :2]) / time, np.zeros(2)) for key, pose in poses.items()}


class Carry(Stop):
    """How far a moving surface carries a slider that is put down at rest, against the one-step law in the surface's frame."""

    NAME = "carry"

    def applies(self, law: ProbeLaw) -> bool:
        return super().applies(law) and any(law.belt)

    def trials(self, law: ProbeLaw) -> Sequence[ProbeTrial]:
        carrying = floor(law)
        (shape,) = carrying.shapes
        share = self.speed(law) / float(np.linalg.norm(law.belt))
        written = vector3(share * value for value in (law.belt if law.belt_written is None else law.belt_written))
        moving = dataclasses.replace(shape, surface_velocity=(*frames.rotate(_onto(law.belt), written), 0.0, 0.0, 0.0))
        steps = self.steps(law)
        slider = box(law, _name(0.0), SQUARE, MASS, (0.0, 0.0, SQUARE[2] / 2))
        return [ProbeTrial((dataclasses.replace(carrying, shapes=(moving,)), slider), (Phase(steps, steps),))]

    def _way(self, law: ProbeLaw) -> np.ndarray:
        belt = self.speed(law) * direction(CARRIED)
        way: np.ndarray = belt * self.steps(law) * law.timestep + self.slipped(law, CARRIED, -1.0)
        return way

    def at(self, law: ProbeLaw, angle: float) -> ProbeFigure:
        size, slipped = (float(np.linalg.norm(way)) for way in (self._way(law), self.slipped(law, CARRIED, -1.0)))
        case = f"by a surface at {self.speed(law):.3g} m/s"
        return self.figure(law, case, "distance", "m", size, STOP_TOLERANCE * slipped, without=0.0)

    def readings(self, law: ProbeLaw, motions: Sequence[TrialMotion]) -> Sequence[ProbeFigure]:
        pose = motions[0].pose[_name(0.0)]
        measured = signed_size(pose[-1, :2] - pose[0, :2], self._way(law))
        return [dataclasses.replace(self.at(law, 0.0), measured=measured)]


def _onto(belt: Vector3) -> Quaternion:
    """A rotation that takes the direction of a velocity to the one in which the floor carries."""
    along, (x, y) = np.array(belt) / np.linalg.norm(belt), direction(CARRIED)
    axis = np.cross(along, (x, y, 0.0))
    sine, cosine = float(np.linalg.norm(axis)), float(along @ (x, y, 0.0))
    about = vector3(axis / sine) if sine > 1e-9 else (0.0, 0.0, 1.0)
    return frames.from_axis_angle(about, math.atan2(sine, cosine))


class PushOblong(Push):
    """:class:`Push` of oblong sliders."""

    NAME = "push-oblong"
    SIZE = OBLONG

    def applies(self, law: ProbeLaw) -> bool:
        return super().applies(law) and law.pair.friction > 0.0


class StopOblong(Stop):
    """:class:`Stop` of oblong sliders."""

    NAME = "stop-oblong"
    SIZE = OBLONG
