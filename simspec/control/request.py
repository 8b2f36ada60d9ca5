"""Actions that cross into an engine's process: forces on bodies, motions of kinematic bodies, control laws. With
numpy alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simspec.control.law import Control
from simspec.control.reference import Piecewise, Reference, positions, reference
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world.actions import Fluid, Force, InertiaBox, JointTrajectory, KinematicMotion
from simspec.world.canonical import from_plain, to_plain
from simspec.world.constraints import Drag
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import layout_of
from simspec.world.rotations import conjugate, cross, exponential, logarithm, matrices, multiply, rotate
from simspec.world.types import Body, Contact, RecordOptions, World

# Forces and torques on bodies (:mod:`simspec.world.actions`) at work: as generalised efforts Jᵀ F, the same in every engine.
#
# Runs in the engine's process, with numpy alone. J follows from the poses of the engine itself.

Array = NDArray[np.float64]
WHOLE = 1e-9
"""Steps, relative to their number: a time that is that near to the end of a step is the end of it, as far as decimals say."""


class _Mover(NamedTuple):
    """A joint on the way from the world to a body: the row of the body that it moves, its place in v, and what it is."""

    row: int
    place: slice
    kind: str
    axis: Array
    centre: Array
    """Of a free root the point that its position is of, in the body's frame (m)."""


@dataclass(frozen=True)
class _Acting:
    """One force, in steps, and the joints that feel it."""

    row: int
    first: float
    last: float
    force: Array
    torque: Array
    at: Array
    movers: tuple[_Mover, ...]

    def share(self, step: int) -> float:
        """The share of a step during which it acts."""
        return min(1.0, max(0.0, min(step + 1.0, self.last) - max(float(step), self.first)))


class AppliedForces:
    """The forces of a world at work."""

    def __init__(self, world: World):
        self.nv = layout_of(world).nv
        self._acting = [_acting(world, force) for force in world.forces]

    def acts(self, step: int) -> bool:
        """Whether any force acts in a step."""
        return any(acting.share(step) > 0.0 for acting in self._acting)

    def stretches(self, first: int, count: int) -> Iterator[tuple[int, int, bool]]:
        """``count`` steps from ``first`` on in pieces (first step, steps, whether forces act): those without a force together,
        those with one each alone, since its effort follows the body's motion."""
        step, end = first, first + count
        while step < end:
            acts = self.acts(step)
            begins = [int(acting.first) for acting in self._acting if acting.first > step]
            after = step + 1 if acts else max(step + 1, min([end, *begins]))
            yield step, after - step, acts
            step = after

    def effort(self, step: int, poses: Array) -> Array:
        """The effort (nv,) of a step, where bodies are at ``poses`` (bodies, 7) x y z w x y z in the world."""
        effort = np.zeros(self.nv)
        for acting in self._acting:
            share = acting.share(step)
            if not share:
                continue
            force, torque = share * acting.force, share * acting.torque
            (turn,) = matrices(poses[acting.row, None, 3:])
            point = poses[acting.row, :3] + turn @ acting.at
            for mover in acting.movers:
                (local,) = matrices(poses[mover.row, None, 3:])
                if mover.kind == "slide":
                    effort[mover.place] += local @ mover.axis @ force
                    continue
                moment = torque + np.cross(point - poses[mover.row, :3] - local @ mover.centre, force)
                if mover.kind == "free":
                    effort[mover.place] += np.concatenate([force, moment @ local])
                elif mover.kind == "ball":
                    effort[mover.place] += moment @ local
                else:
                    effort[mover.place] += local @ mover.axis @ moment
        return effort


def in_steps(time: float, timestep: float) -> float:
    """A time in steps; a whole number where it is one but for the rounding of decimals."""
    steps = time / timestep
    whole = round(steps)
    return float(whole) if abs(steps - whole) <= WHOLE * max(1.0, steps) else steps


def _acting(world: World, force: Force) -> _Acting:
    places = layout_of(world).velocity
    rows = {body.name: row for row, body in enumerate(world.bodies)}
    movers = []
    row: int | None = rows[force.body]
    while row is not None:
        body = world.bodies[row]
        kind = body.joint.kind
        if kind != "fixed":
            centre = lumped_inertial(world, body).centre_of_mass if kind == "free" else (0.0, 0.0, 0.0)
            axis = body.joint.axis if kind in SCALAR_JOINTS else (0.0, 0.0, 0.0)
            movers.append(_Mover(row, places[row], kind, np.array(axis), np.array(centre)))
        row = None if body.joint.parent is None else rows[body.joint.parent]
    timestep = world.physics.timestep
    last = np.inf if force.until is None else in_steps(force.until, timestep)
    first = in_steps(force.start, timestep)
    push, torque, at = (np.array(values) for values in (force.force, force.torque, force.at))
    return _Acting(rows[force.body], first, last, push, torque, at, tuple(movers))


# --- into the engine's process ------------------------------------------------------------------------------------------


def forces_to_request(world: World) -> dict[str, Any]:
    """Parameters (JSON) that :func:`forces_from_request` reads; empty when the world has no forces."""
    if not world.forces:
        return {}
    bodies = tuple(replace(body, shapes=()) for body in world.bodies)
    bare = World(world.name, bodies, Contact(), world.physics, RecordOptions(), forces=world.forces)
    return {"forces": to_plain(bare)}


def forces_from_request(parameters: Mapping[str, Any]) -> AppliedForces | None:
    """The forces of a request; None when it has none."""
    content = parameters.get("forces")
    return None if content is None else AppliedForces(from_plain(World, content))


def brought_forward(forces: Sequence[Force], timestep: float, first: int, most: int) -> tuple[Force, ...]:
    """The forces moved by whole steps so that the earliest begins in step ``first``, each ``most`` steps long at most, and none
    begins later than ``most`` steps after the earliest."""
    begins = [in_steps(force.start, timestep) for force in forces]
    moved = []
    for force, begin in zip(forces, begins, strict=True):
        start = first + min(int(begin) - int(min(begins)), most) + begin - int(begin)
        length = np.inf if force.until is None else in_steps(force.until, timestep) - begin
        until = start + min(length, float(most))
        moved.append(replace(force, start=start * timestep, until=until * timestep))
    return tuple(moved)


# Motions of kinematic bodies (:mod:`simspec.world.actions`) at work: as efforts on free roots, the same in every engine.
#
# Runs in the engine's process, with numpy alone; the polynomials are made before, and cross over as arrays.

MOTION_PREFIX = "motion."
SHARES: Mapping[str, tuple[float, ...]] = {
    "linear": (1.0, 0.0),
    "cubic": (-2.0, 3.0, 0.0, 0.0),
    "quintic": (6.0, -15.0, 10.0, 0.0, 0.0, 0.0),
}
"""Share of an angle at the share of the time, by interpolation: coefficients, the highest power first."""


class PoseCurve:
    """Where a kinematic body is."""

    def __init__(self, motion: KinematicMotion, place: Piecewise):
        self._place = place
        self._times = np.array(motion.times)
        turns = np.array(motion.quaternions)
        self._turns, self._share = turns, SHARES[motion.interpolation]
        self._angles = logarithm(multiply(conjugate(turns[:-1]), turns[1:])) if len(turns) > 1 else np.zeros((1, 3))

    def at(self, times: NDArray[Any]) -> tuple[Array, Array]:
        """Positions (n, 3) and quaternions (n, 4) of the body's frame at some times (s)."""
        (place,) = self._place.at(times)
        if len(self._times) == 1:
            return place, np.tile(self._turns[0], (len(times), 1))
        row = np.clip(np.searchsorted(self._times, times, side="right") - 1, 0, len(self._times) - 2)
        begin, end = self._times[row], self._times[row + 1]
        share = np.polyval(np.array(self._share), np.clip((times - begin) / (end - begin), 0.0, 1.0))
        return place, multiply(self._turns[row], exponential(share[:, None] * self._angles[row]))


def curve(motion: KinematicMotion) -> PoseCurve:
    """A motion that gives places; needs scipy where it is smooth."""
    return PoseCurve(motion, _place(motion))


def _place(motion: KinematicMotion) -> Piecewise:
    return positions(
        JointTrajectory(("x", "y", "z"), motion.times, motion.positions, interpolation=motion.interpolation)
    )


CHUNK = 1000
"""Steps whose places are made at once."""


class Prescribed:
    """The kinematic bodies of a world at work."""

    def __init__(self, world: World, curves: Sequence[PoseCurve]):
        where = layout_of(world)
        rows = {body.name: row for row, body in enumerate(world.bodies)}
        self.nv = where.nv
        self._timestep = world.physics.timestep
        self._gravity = np.array(world.physics.gravity)
        self._bodies = []
        self._around: list[_Around | None] = []
        for motion, path in zip(world.motions, curves, strict=True):
            row = rows[motion.body]
            inertial = lumped_inertial(world, world.bodies[row])
            xx, yy, zz, xy, xz, yz = inertial.inertia
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            centre = np.array(inertial.centre_of_mass)
            self._bodies.append((where.position[row], where.velocity[row], inertial.mass, tensor, centre, path))
            self._around.append(_Around.of(world.bodies[row], world.physics.fluid))
        self._first, self._ahead = 0, list[tuple[Array, Array]]()

    def effort(self, step: int, q: Array, v: Array) -> Array:
        """The effort (nv,) of a step from the state (q (nq,), v (nv,)) before it."""
        if not self._first <= step < self._first + CHUNK or not self._ahead:
            times = (step + 1 + np.arange(CHUNK)) * self._timestep
            self._first, self._ahead = step, [path.at(times) for *_, path in self._bodies]
        dt, effort = self._timestep, np.zeros(self.nv)
        parts = zip(self._bodies, self._ahead, self._around, strict=True)
        for (at_q, at_v, mass, tensor, centre, _), (places, turns), around in parts:
            place, turn = places[step - self._first], turns[step - self._first]
            local_q, local_v = q[at_q], v[at_v]
            wanted = (place + rotate(turn, centre) - local_q[:3]) / dt
            spin = logarithm(multiply(conjugate(local_q[3:]), turn)) / dt
            push = mass * ((wanted - local_v[:3]) / dt - self._gravity)
            twist = tensor @ ((spin - local_v[3:]) / dt) + cross(local_v[3:], tensor @ local_v[3:])
            effort[at_v] = np.concatenate([push, twist])
            if around is not None:
                effort[at_v] -= around.effort(local_q[3:], local_v)
        return effort


class _Around:
    """The fluid around a kinematic body, which an engine lets it feel as any other, and which its motion is not to show."""

    def __init__(self, box: InertiaBox, fluid: Fluid):
        self._axes, self._flow = np.array(box.quaternion), np.array(fluid.velocity)
        self._drag = Drag(box.edges, fluid)

    @classmethod
    def of(cls, body: Body, fluid: Fluid | None) -> _Around | None:
        """None where there is none."""
        return None if fluid is None or body.box is None else cls(body.box, fluid)

    def effort(self, turn: Array, v: Array) -> Array:
        """The force and torque (6,) of the fluid on a body that is turned by ``turn`` (4,) and has the velocity ``v`` (6,)."""
        flow = rotate(conjugate(multiply(turn, self._axes)), v[:3] - self._flow)
        force, torque = self._drag.of(flow[None], rotate(conjugate(self._axes), v[3:])[None])
        return np.concatenate([rotate(multiply(turn, self._axes), force[0]), rotate(self._axes, torque[0])])


# --- into the engine's process ------------------------------------------------------------------------------------------


def motions_to_request(world: World) -> tuple[dict[str, Any], dict[str, Array]]:
    """Parameters (JSON) and arrays that :func:`motions_from_request` reads; empty when no body of the world is kinematic."""
    if not world.motions:
        return {}, {}
    bodies = tuple(dataclasses.replace(body, shapes=()) for body in world.bodies)
    bare = World(world.name, bodies, Contact(), world.physics, RecordOptions(), motions=world.motions)
    arrays = {}
    for number, motion in enumerate(world.motions):
        place = _place(motion)
        for field in dataclasses.fields(Piecewise):
            arrays[f"{MOTION_PREFIX}{number}.{field.name}"] = getattr(place, field.name)
    return {"motions": to_plain(bare)}, arrays


def motions_from_request(parameters: Mapping[str, Any], arrays: Mapping[str, Array]) -> Prescribed | None:
    """The kinematic bodies of a request; None when it has none."""
    content = parameters.get("motions")
    if content is None:
        return None
    world: World = from_plain(World, content)
    curves = [
        PoseCurve(
            motion,
            Piecewise(*(arrays[f"{MOTION_PREFIX}{number}.{field.name}"] for field in dataclasses.fields(Piecewise))),
        )
        for number, motion in enumerate(world.motions)
    ]
    return Prescribed(world, curves)


# The inputs of control laws, as plain data and arrays, for the engine's process, and their reader there.

CONTROL_PREFIX = "control."


def to_request(world: World) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Parameters (JSON) and arrays that :func:`from_request`, ``forces_from_request`` and ``motions_from_request`` read;
    empty when the world has no controllers, no forces and no kinematic bodies.

    The polynomials are made here, so that the engine's environment needs no library for them, and all engines have the same.
    """
    forces, (motions, arrays) = forces_to_request(world), motions_to_request(world)
    given = {**forces, **motions}
    if not world.controllers:
        return given, arrays
    bare = dataclasses.replace(
        world,
        contact=Contact(),
        record=RecordOptions(),
        expectations=(),
        engines=(),
        trajectory=None,
        forces=(),
        motions=(),
    )
    targets = reference(world)
    for name, part in (("position", targets.position), ("effort", targets.effort)):
        for field in dataclasses.fields(Piecewise):
            arrays[f"{CONTROL_PREFIX}{name}.{field.name}"] = getattr(part, field.name)
    return {**given, "control": {"world": to_plain(bare), "joints": list(targets.joints)}}, arrays


def from_request(parameters: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Control | None:
    """The control of a request; None when it has none. Raises ControlError."""
    content = parameters.get("control")
    if content is None:
        return None
    parts = [
        Piecewise(*(arrays[f"{CONTROL_PREFIX}{name}.{field.name}"] for field in dataclasses.fields(Piecewise)))
        for name in ("position", "effort")
    ]
    return Control(from_plain(World, content["world"]), Reference(tuple(content["joints"]), *parts))
