"""Joints that an engine's own controllers drive (law ``native``): what those are told, and what they cannot have; and the
gains of all driven joints, for files that have actuators."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from simspec.control.reference import Reference, reference
from simspec.world.actions import Controller
from simspec.world.types import World


class Servos(Protocol):
    """An engine's own controllers at work."""

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Where the joints should be and how fast, each (n,), for the next step; to be called before every step."""


def natives(world: World) -> tuple[Controller, ...]:
    """The controllers that are the engine's own."""
    return tuple(controller for controller in world.controllers if controller.law == "native")


@dataclass(frozen=True, slots=True)
class Drive:
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


def drives(world: World) -> tuple[Drive, ...]:
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
            found.append(Drive(name, kp, kd, limit, *start))
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
        own_rows = [rows[name] for name in self.joints]
        self.stiffness = np.array([controller.kp[index] for controller, index in own_rows], dtype=float)
        self.damping = np.array([controller.kd[index] for controller, index in own_rows], dtype=float)
        limits = [controller.effort_limits[index] for controller, index in own_rows]
        self.limit = np.array([np.inf if limit is None else limit for limit in limits], dtype=float)
        self._columns = np.array([reference.joints.index(name) for name in self.joints], dtype=int)
        self._position = reference.position
        self._timestep = world.physics.timestep

    def prepare(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q* and v* (count, n) at the beginning of ``count`` steps from step ``first`` on, and q* at their ends."""
        position, velocity = self._position.at((first + np.arange(count + 1)) * self._timestep, 1)
        return position[:-1, self._columns], velocity[:-1, self._columns], position[1:, self._columns]
