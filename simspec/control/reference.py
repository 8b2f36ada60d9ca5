"""The trajectory as piecewise polynomials: made once from the world, evaluated with numpy alone wherever a law runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from simspec.world.actions import JointController, JointTrajectory
from simspec.world.types import World


@dataclass(frozen=True)
class Piecewise:
    """Polynomials between ``breaks`` (n + 1,), columns side by side; constant before the first and after the last break.

    ``coefficients`` (degree + 1, n, columns), highest power first, of t − breaks[i]. ``final`` (columns,): the value from the
    last break on; at a break the polynomial to its right counts.
    """

    breaks: np.ndarray
    coefficients: np.ndarray
    final: np.ndarray

    def at(self, times: np.ndarray, derivatives: int = 0) -> list[np.ndarray]:
        """Values and as many derivatives, each (times, columns), at ``times`` (s)."""
        first, last = self.breaks[0], self.breaks[-1]
        piece = np.clip(np.searchsorted(self.breaks, times, side="right") - 1, 0, len(self.breaks) - 2)
        inside = np.clip(times, first, last) - self.breaks[piece]
        ended, waiting = times >= last, times < first
        static = (ended | waiting)[:, None]
        power, values = self.coefficients, []
        for order in range(derivatives + 1):
            value = np.zeros((len(times), power.shape[2]))
            for row in power:
                value = value * inside[:, None] + row[piece]
            values.append(np.where(static, 0.0, value) if order else np.where(ended[:, None], self.final, value))
            degree = len(power) - 1
            power = power[:-1] * np.arange(degree, 0, -1)[:, None, None] if degree else np.zeros_like(power)
        return values


@dataclass(frozen=True)
class Reference:
    """The reference of the driven joints: positions (rad, m) and feed-forward efforts (N m, N), a column for each joint."""

    joints: tuple[str, ...]
    position: Piecewise
    effort: Piecewise


def driven_joints(world: World) -> tuple[str, ...]:
    """The joints that have a controller, in the order of the world's bodies."""
    driven = {joint for controller in world.controllers for joint in controller.joints}
    return tuple(body.joint.name for body in world.bodies if body.joint.name in driven)


def reference(world: World) -> Reference:
    """The reference of all driven joints; those without a column in the trajectory stay at their initial positions."""
    joints = driven_joints(world)
    start = {body.joint.name: body.joint.position for body in world.bodies}
    initial = np.array([start[name][0] for name in joints])
    trajectory = world.trajectory
    if trajectory is None:
        constant = _constant(initial)
        return Reference(joints, constant, _constant(np.zeros(len(joints))))
    place = {name: index for index, name in enumerate(joints)}
    columns = np.array([place[name] for name in trajectory.joints], dtype=int)
    position = _among(joints, columns, positions(trajectory), initial)
    return Reference(joints, position, _among(joints, columns, efforts(trajectory), np.zeros(len(joints))))


def positions(trajectory: JointTrajectory) -> Piecewise:
    """The positions of a trajectory, in its own columns (see :class:`simspec.world.actions.JointTrajectory`)."""
    times, values = np.array(trajectory.times), np.array(trajectory.positions)
    if len(times) == 1:
        return Piecewise(np.array([times[0], times[0] + 1.0]), values[None], values[-1])
    if trajectory.interpolation == "hold":
        return Piecewise(times, values[None, :-1], values[-1])
    if trajectory.interpolation == "linear":
        return _linear(times, values)
    return Piecewise(times, _smooth(trajectory, times, values), values[-1])


def _smooth(trajectory: JointTrajectory, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Coefficients of the cubic or quintic pieces."""
    from scipy.interpolate import BPoly, CubicSpline, PPoly, make_interp_spline

    quintic = trajectory.interpolation == "quintic"
    result: np.ndarray
    if not trajectory.velocities and not quintic:
        result = CubicSpline(times, values, bc_type="clamped").c
        return result
    if trajectory.velocities:
        derivatives = [values, np.array(trajectory.velocities)]
        if quintic:
            derivatives.append(np.array(trajectory.accelerations))
    else:
        rest = [(order, np.zeros(values.shape[1])) for order in (1, 2)]
        spline = make_interp_spline(times, values, k=5, bc_type=(rest, rest))
        derivatives = [values, spline(times, 1), spline(times, 2)]  # six numbers, of which each piece follows
    result = PPoly.from_bernstein_basis(BPoly.from_derivatives(times, np.stack(derivatives, axis=1))).c
    return result


def efforts(trajectory: JointTrajectory) -> Piecewise:
    """The feed-forward efforts of a trajectory, in its own columns; zero when it has none."""
    times = np.array(trajectory.times)
    if not trajectory.efforts:
        return _constant(np.zeros(len(trajectory.joints)))
    values = np.array(trajectory.efforts)
    if len(times) == 1:
        return Piecewise(np.array([times[0], times[0] + 1.0]), values[None], values[-1])
    if trajectory.interpolation == "hold":
        return Piecewise(times, values[None, :-1], values[-1])
    return _linear(times, values)


def _linear(times: np.ndarray, values: np.ndarray) -> Piecewise:
    slope = np.diff(values, axis=0) / np.diff(times)[:, None]
    return Piecewise(times, np.stack([slope, values[:-1]]), values[-1])


def _constant(value: np.ndarray) -> Piecewise:
    return Piecewise(np.array([0.0, 1.0]), value[None, None], value)


def _among(joints: tuple[str, ...], columns: np.ndarray, part: Piecewise, rest: np.ndarray) -> Piecewise:
    """``part`` spread over the columns of all driven joints, the others constant at ``rest``."""
    if not len(columns):
        return _constant(rest)
    if part.coefficients.shape[2] != len(columns):
        raise ValueError("a trajectory has a column for each of its joints")
    coefficients = np.zeros((*part.coefficients.shape[:2], len(joints)))
    coefficients[-1] = rest
    coefficients[:, :, columns] = part.coefficients
    final = rest.copy()
    final[columns] = part.final
    return Piecewise(part.breaks, coefficients, final)


# Joints that an engine's own controllers drive (law ``native``): their targets, their limits of support; and the
# gains of all driven joints, for files that have actuators.


class Servos(Protocol):
    """An engine's own controllers at work."""

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Where the joints should be and how fast, each (n,), for the next step; to be called before every step."""


def natives(world: World) -> tuple[JointController, ...]:
    """The controllers that are the engine's own."""
    return tuple(controller for controller in world.controllers if controller.law == "native")


@dataclass(frozen=True, slots=True)
class ActuatorDrive:
    """A driven joint as a file with actuators can say it: an effort of kp (position − q) + kd (velocity − v) + effort, within
    ± ``effort_limit`` (None: unlimited), in SI units.

    ``position``, ``velocity``, ``effort``: the reference and the feed-forward at time 0. A law without gains (computed torque)
    has kp = kd = 0.
    """

    joint: str
    kp: float
    kd: float
    effort_limit: float | None
    position: float
    velocity: float
    effort: float


def drives(world: World) -> tuple[ActuatorDrive, ...]:
    """The driven joints of a world, in the order of its controllers."""
    if not world.controllers:
        return ()
    aims = reference(world)
    (efforts,) = aims.effort.at(np.zeros(1))
    position, velocity = aims.position.at(np.zeros(1), 1)
    columns = {name: index for index, name in enumerate(aims.joints)}
    found = []
    for controller in world.controllers:
        none = (0.0,) * len(controller.joints)
        rows = zip(
            controller.joints, controller.kp or none, controller.kd or none, controller.effort_limits, strict=True
        )
        for name, kp, kd, limit in rows:
            column = columns[name]
            start = (float(row[0, column]) for row in (position, velocity, efforts))
            found.append(ActuatorDrive(name, kp, kd, limit, *start))
    return tuple(found)


def fed_forward(world: World) -> Iterator[tuple[str, str]]:
    """(controller, joint) of those natively driven joints for which the trajectory has feed-forward efforts.

    An engine's own controller takes none: it would lose them, or take them back.
    """
    trajectory = world.trajectory
    if trajectory is None or not trajectory.efforts:
        return
    fed = {
        name
        for name, column in zip(trajectory.joints, zip(*trajectory.efforts, strict=True), strict=True)
        if any(column)
    }
    for controller in natives(world):
        for name in controller.joints:
            if name in fed:
                yield controller.name, name


class Native:
    """The natively driven joints of a world: ``joints`` in the order of the world's bodies, with their gains."""

    def __init__(self, world: World, reference: Reference):
        rows = {
            name: (controller, index) for controller in natives(world) for index, name in enumerate(controller.joints)
        }
        self.bodies = [body.name for body in world.bodies if body.joint.name in rows]
        self.joints = [body.joint.name for body in world.bodies if body.joint.name in rows]
        local_rows = [rows[name] for name in self.joints]
        self.stiffness = np.array([controller.kp[index] for controller, index in local_rows], dtype=float)
        self.damping = np.array([controller.kd[index] for controller, index in local_rows], dtype=float)
        limits = [controller.effort_limits[index] for controller, index in local_rows]
        self.limit = np.array([np.inf if limit is None else limit for limit in limits], dtype=float)
        self._columns = np.array([reference.joints.index(name) for name in self.joints], dtype=int)
        self._position = reference.position
        self._timestep = world.physics.timestep

    def prepare(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q* and v* (count, n) at the beginning of ``count`` steps from step ``first`` on, and q* at their ends."""
        position, velocity = self._position.at((first + np.arange(count + 1)) * self._timestep, 1)
        return position[:-1, self._columns], velocity[:-1, self._columns], position[1:, self._columns]
