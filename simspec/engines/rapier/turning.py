"""How bodies turn in Rapier, and what its steps lack of it.

Rapier has an implicit gyroscopic torque, where simspec's law of motion has −ω × Iω as it is before a step. And its turn is the
unit quaternion along q + ½ ω q dt, which lags by (|ω| dt)³ / 12 (measured from 2 to 1,000 rad/s). These are computed body by
body in numbers of Python: numpy takes ten times as long for three of them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from simspec.engines.rapier.units import SCALE, SQUARE
from simspec.world import frames
from simspec.world.rotations import exponential_of, matrices, multiply_of, unit
from simspec.world.types import Quaternion, Vector3

SLOW = 1e-3
"""rad, |ω| dt up to which Rapier's own turn is left: it lags by 8e-11 rad then, a thousandth of a rounding."""


def quaternion_of(rotation: Any) -> Quaternion:
    """w x y z of one of Rapier's rotations, of unit length in double precision."""
    x, y, z, w = rotation.to_tuple()
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length)


def turn_of(rotation: Any) -> np.ndarray:
    """The matrix (3, 3) of one of Rapier's rotations."""
    return matrices(np.array(quaternion_of(rotation)))


def pose_of(pose: Any) -> np.ndarray:
    """x y z w x y z of one of Rapier's poses (m), its quaternion of unit length."""
    turn = pose.rotation
    return np.array((*(value / SCALE for value in pose.translation), *unit(np.array((turn.w, turn.i, turn.j, turn.k)))))


def held_tensor(body: Any) -> np.ndarray:
    """The inertia (3, 3, kg m²) of a body about its centre of mass, in its own axes."""
    held = body.mass_properties
    turn = turn_of(held.principal_inertia_local_frame)
    found: np.ndarray = turn @ np.diag(tuple(held.principal_inertia)) @ turn.T
    return found / SQUARE


def tensor_of(inertia: np.ndarray) -> frames.Matrix3 | None:
    """A tensor in numbers of Python; None of one that is the same about every axis, of which nothing gyroscopic comes."""
    if np.array_equal(inertia, inertia[0, 0] * np.eye(3)):
        return None
    one, two, three = inertia.tolist()
    return (tuple(one), tuple(two), tuple(three))


def gyroscopic(body: Any, inertia: frames.Matrix3) -> Vector3 | None:
    """−ω × Iω of a body as it is, in world axes; None of one that does not turn."""
    x, y, z = body.angvel.to_tuple()
    if not (x or y or z):
        return None
    across, along, up = frames.matrix(quaternion_of(body.rotation))
    own = (
        across[0] * x + along[0] * y + up[0] * z,
        across[1] * x + along[1] * y + up[1] * z,
        across[2] * x + along[2] * y + up[2] * z,
    )
    momentum = (frames.dot(inertia[0], own), frames.dot(inertia[1], own), frames.dot(inertia[2], own))
    torque = frames.cross(momentum, own)
    return (frames.dot(across, torque), frames.dot(along, torque), frames.dot(up, torque))


def turned_on(rotation: Any, spin: Any, timestep: float) -> Quaternion:
    """The rotation that a body has after a step with the velocity ``spin``, of that which Rapier gave it: the rest of its turn
    is about the same axis."""
    angle = timestep * spin.norm()
    share = (angle - 2.0 * math.atan(0.5 * angle)) / angle * timestep
    rest = exponential_of((share * spin.x, share * spin.y, share * spin.z))
    return multiply_of(rest, (rotation.w, rotation.i, rotation.j, rotation.k))
