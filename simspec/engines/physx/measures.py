"""Mass matrices of PhysX's bodies by unit efforts, and their states in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.engines.physx.units import NAME, SCALE, unit_of
from simspec.errors import EngineError
from simspec.world.rotations import matrices

SMALL = 1e-9
"""Torque that measures a mass matrix, as a share of the body's moment: it leaves no gyroscopic term."""


def mass_matrices(
    system: Any, bodies: Sequence[tuple[Any, Any]], poses: Sequence[Any], moments: np.ndarray
) -> np.ndarray:
    """The mass matrices (n, 6, 6) of ``bodies`` (entity, actor) of a scene without contact, at these poses: the inverse of what
    unit efforts give. ``moments`` (n,): about as large as their moments of inertia."""
    timestep = float(system.timestep)
    turns = [matrices(unit_of(pose.q)) for pose in poses]
    inverse = np.zeros((len(bodies), 6, 6))
    for column in range(6):
        for (entity, actor), pose, turn, moment in zip(bodies, poses, turns, moments, strict=True):
            entity.pose = pose
            actor.disable_gravity = True
            actor.linear_velocity = actor.angular_velocity = (0.0, 0.0, 0.0)
            force, torque = np.zeros(3), np.zeros(3)
            if column < 3:
                force[column] = SCALE
            else:
                torque = turn[:, column - 3] * (SMALL * moment * SCALE * SCALE)
            actor.add_force_torque(force, torque)
        system.step()
        for number, (_, actor) in enumerate(bodies):
            size = 1.0 if column < 3 else SMALL * moments[number]
            speed = np.array(actor.linear_velocity, dtype=float) / SCALE
            spin = turns[number].T @ np.array(actor.angular_velocity, dtype=float)
            inverse[number, :3, column] = speed / (size * timestep)
            inverse[number, 3:, column] = spin / (size * timestep)
    masses = np.linalg.inv(inverse)
    found: np.ndarray = 0.5 * (masses + masses.transpose(0, 2, 1))
    return found


NUMBERS = 13
"""Single-precision numbers of each packed body: quaternion, position, velocity, angular velocity (measured, not documented)."""
OF_COORDINATES = 4
"""Those of each coordinate of articulations, after all bodies and the roots of articulations."""


class PackedActors:
    """The states of ``actors``, all dynamic actors of a system, in one call of ``PhysxCpuSystem.pack``: of 216 bodies in
    14 µs, not 1.2 ms. In addition the system has so many ``articulations`` with so many ``coordinates``. Raises EngineError
    where the system has other actors, or packs other values than theirs."""

    def __init__(self, system: Any, actors: Sequence[Any], articulations: int = 0, coordinates: int = 0):
        self._system = system
        numbers = {actor: number for number, actor in enumerate(system.rigid_dynamic_components)}
        self._count = len(actors)
        self._order = np.array([numbers.get(actor, -1) for actor in actors], dtype=np.int64)
        if len(numbers) != self._count or (self._order < 0).any():
            raise EngineError(NAME, f"has {len(numbers)} bodies that move, not {self._count}")
        self._size = NUMBERS * (self._count + articulations) + OF_COORDINATES * coordinates
        poses, speeds = self.read()
        for pose, speed, actor in zip(poses, speeds, actors, strict=True):
            at = actor.entity.pose
            state = (*at.p, *at.q, *actor.linear_velocity, *actor.angular_velocity)
            if not np.array_equal((*pose, *speed), np.array(state, dtype=float)):
                raise EngineError(NAME, "packs states in another way than SAPIEN 3.0.3")

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Poses (n, 7), position before quaternion, and velocities (n, 6) in world axes, in PhysX's unit."""
        packed = np.frombuffer(self._system.pack(), dtype=np.float32)
        if packed.size != self._size:
            raise EngineError(NAME, f"packs {packed.size} numbers, not {self._size}")
        rows = packed[: NUMBERS * self._count].reshape(-1, NUMBERS)[self._order].astype(float)
        return rows[:, [4, 5, 6, 0, 1, 2, 3]], rows[:, 7:]
