"""Mass properties as PhysX has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.engines.physx.building import SCALE
from simspec.world.rotations import matrices
from simspec.world.types import Pose

SMALL = 1e-9
"""Share of a body's own moment, as a torque: by such a torque its speed is so small that no gyroscopic term is seen."""


def unit_of(quaternion: Any) -> np.ndarray:
    turn = np.array(quaternion, dtype=float)
    found: np.ndarray = turn / np.linalg.norm(turn)
    return found


def held_tensor(actor: Any) -> np.ndarray:
    """The inertia (3, 3) of an actor about its centre of mass, in its own axes."""
    turn = matrices(unit_of(actor.cmass_local_pose.q))
    found: np.ndarray = turn @ np.diag(np.array(actor.inertia, dtype=float)) @ turn.T
    return found / (SCALE * SCALE)


def pose_of(pose: Any) -> Pose:
    """One of SAPIEN's poses as the world's."""
    x, y, z = (np.array(pose.p, dtype=float) / SCALE).tolist()
    return Pose((x, y, z), tuple(unit_of(pose.q).tolist()))


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
