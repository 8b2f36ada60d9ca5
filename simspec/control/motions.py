"""Motions of kinematic bodies (:mod:`simspec.world.actions`) at work: as efforts on free roots, the same in every engine.

Runs in the engine's process, with numpy alone; the polynomials are made before, and cross over as arrays.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.control.reference import Piecewise, positions
from simspec.world.actions import Box, Fluid, Motion, Trajectory
from simspec.world.canonical import from_plain, to_plain
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import layout_of
from simspec.world.passive_forces import Drag
from simspec.world.rotations import conjugate, cross, exponential, logarithm, multiply, rotate
from simspec.world.types import Body, Contact, Record, World

Array = NDArray[np.float64]
PREFIX = "motion."
SHARES: Mapping[str, tuple[float, ...]] = {
    "linear": (1.0, 0.0),
    "cubic": (-2.0, 3.0, 0.0, 0.0),
    "quintic": (6.0, -15.0, 10.0, 0.0, 0.0, 0.0),
}
"""Share of an angle at the share of the time, by interpolation: coefficients, the highest power first."""


class Curve:
    """Where a kinematic body is."""

    def __init__(self, motion: Motion, place: Piecewise):
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


def curve(motion: Motion) -> Curve:
    """A motion to be asked for places; takes scipy where it is smooth."""
    return Curve(motion, _place(motion))


def _place(motion: Motion) -> Piecewise:
    return positions(Trajectory(("x", "y", "z"), motion.times, motion.positions, interpolation=motion.interpolation))


CHUNK = 1000
"""Steps whose places are made at once."""


class Prescribed:
    """The kinematic bodies of a world at work."""

    def __init__(self, world: World, curves: Sequence[Curve]):
        where = layout_of(world)
        rows = {body.name: row for row, body in enumerate(world.bodies)}
        self.nv = where.nv
        self._timestep = world.physics.timestep
        self._gravity = np.array(world.physics.gravity)
        self._bodies = []
        self._around: list[_Around | None] = []
        for motion, path in zip(world.motions, curves, strict=True):
            row = rows[motion.body]
            told = lumped_inertial(world, world.bodies[row])
            xx, yy, zz, xy, xz, yz = told.inertia
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            centre = np.array(told.centre_of_mass)
            self._bodies.append((where.position[row], where.velocity[row], told.mass, tensor, centre, path))
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
            own_q, own_v = q[at_q], v[at_v]
            wanted = (place + rotate(turn, centre) - own_q[:3]) / dt
            spin = logarithm(multiply(conjugate(own_q[3:]), turn)) / dt
            push = mass * ((wanted - own_v[:3]) / dt - self._gravity)
            twist = tensor @ ((spin - own_v[3:]) / dt) + cross(own_v[3:], tensor @ own_v[3:])
            effort[at_v] = np.concatenate([push, twist])
            if around is not None:
                effort[at_v] -= around.effort(own_q[3:], own_v)
        return effort


class _Around:
    """The fluid around a kinematic body, which an engine lets it feel as any other, and which its motion is not to show."""

    def __init__(self, box: Box, fluid: Fluid):
        self._axes, self._flow = np.array(box.quaternion), np.array(fluid.velocity)
        self._drag = Drag(box.edges, fluid)

    @classmethod
    def of(cls, body: Body, fluid: Fluid | None) -> _Around | None:
        """None where there is none."""
        return None if fluid is None or body.box is None else cls(body.box, fluid)

    def effort(self, turn: Array, v: Array) -> Array:
        """What the fluid does (6,) to a body that is turned by ``turn`` (4,) and has the velocity ``v`` (6,)."""
        flow = rotate(conjugate(multiply(turn, self._axes)), v[:3] - self._flow)
        force, torque = self._drag.of(flow[None], rotate(conjugate(self._axes), v[3:])[None])
        return np.concatenate([rotate(multiply(turn, self._axes), force[0]), rotate(self._axes, torque[0])])


# --- into the engine's process ------------------------------------------------------------------------------------------


def motions_to_request(world: World) -> tuple[dict[str, Any], dict[str, Array]]:
    """Parameters (JSON) and arrays that :func:`motions_from_request` reads; empty when no body of the world is kinematic."""
    if not world.motions:
        return {}, {}
    bodies = tuple(dataclasses.replace(body, shapes=()) for body in world.bodies)
    bare = World(world.name, bodies, Contact(), world.physics, Record(), motions=world.motions)
    arrays = {}
    for number, motion in enumerate(world.motions):
        place = _place(motion)
        for field in dataclasses.fields(Piecewise):
            arrays[f"{PREFIX}{number}.{field.name}"] = getattr(place, field.name)
    return {"motions": to_plain(bare)}, arrays


def motions_from_request(parameters: Mapping[str, Any], arrays: Mapping[str, Array]) -> Prescribed | None:
    """The kinematic bodies that a request asks for; None when it asks for none."""
    content = parameters.get("motions")
    if content is None:
        return None
    world: World = from_plain(World, content)
    curves = [
        Curve(motion, Piecewise(*(arrays[f"{PREFIX}{number}.{field.name}"] for field in dataclasses.fields(Piecewise))))
        for number, motion in enumerate(world.motions)
    ]
    return Prescribed(world, curves)
