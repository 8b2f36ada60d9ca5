"""Rapier's units, and its numbers and poses in those of the world. Facts marked *measured* in this package: rapier3d 0.36.1."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from simspec.engines.kit.arrays import checked_singles
from simspec.formats.world import JsonBody
from simspec.world.inertia import principal_axes
from simspec.world.rotations import matrices
from simspec.world.types import Pose, Quaternion, Vector3

NAME = "rapier"
SCALE = 1024.0
"""Rapier's unit of length is 1/1024 m. Its search for nearest points ends by thresholds in its unit: with the metre it
misses 12 % of the overlaps of a ball and a hull of 100 vertices, and stacks of boxes as hulls fall (measured;
docs/records/engine-costs.md). A power of two changes no digit of a number."""
SQUARE = SCALE * SCALE
"""Its unit of torque, inertia and energy in 1 N m, 1 kg m² and 1 J."""
NOTHING_ACROSS = 2.0**-27
"""Products of inertia below this share of the largest moment count as zero: an eighth of the last bit of single precision."""


def lengths(values: Iterable[float], name: str) -> tuple[float, ...]:
    """Lengths (m, m/s, m/s²) in Rapier's unit."""
    return checked_singles(NAME, (SCALE * value for value in values), name)


def isometry(rapier: Any, pose: Pose, name: str) -> Any:
    place = rapier.Vec3(*lengths(pose.position, name))
    return rapier.Isometry3(place, rapier.Rotation3(*pose.quaternion))


def principal(inertia: Sequence[float]) -> tuple[Vector3, Quaternion]:
    """Principal moments and the axes that they are about: the body's own where the tensor is diagonal but for round-off."""
    x, y, z, *across = inertia
    if max(map(abs, across)) <= NOTHING_ACROSS * max(x, y, z):
        across = [0.0, 0.0, 0.0]
    return principal_axes((x, y, z, *across))


def mass_properties(rapier: Any, body: JsonBody) -> Any:
    """Rapier's mass properties of a body."""
    moments, axes = principal(body.inertia)
    mass = checked_singles(NAME, (body.mass,), f"mass of {body.name}")[0]
    centre = lengths(body.centre_of_mass, f"centre of {body.name}")
    scaled = checked_singles(NAME, (SQUARE * moment for moment in moments), f"inertia of {body.name}")
    vector = rapier.Vec3
    return rapier.MassProperties(vector(*centre), mass, vector(*scaled), rapier.Rotation3(*axes))


def quaternion_of(rotation: Any) -> Quaternion:
    """w x y z of one of Rapier's rotations, of unit length in double precision."""
    x, y, z, w = rotation.to_tuple()
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length)


def turn_of(rotation: Any) -> np.ndarray:
    """The matrix (3, 3) of one of Rapier's rotations."""
    return matrices(np.array(quaternion_of(rotation)))


def pose_of(pose: Any) -> Pose:
    """One of Rapier's poses in m, its quaternion of unit length."""
    x, y, z = (value / SCALE for value in pose.translation)
    return Pose((x, y, z), quaternion_of(pose.rotation))


def inertia_of(body: Any) -> np.ndarray:
    """The inertia (3, 3, kg m²) of a body about its centre of mass, in its own axes."""
    mass = body.mass_properties
    turn = turn_of(mass.principal_inertia_local_frame)
    inertia: np.ndarray = turn @ np.diag(tuple(mass.principal_inertia)) @ turn.T
    return inertia / SQUARE


def states_of(bodies: Sequence[Any]) -> np.ndarray:
    """x y z w x y z of some bodies (n, 7) in m, their quaternions of unit length."""
    rows = [(*body.translation.to_tuple(), *body.rotation.to_tuple()) for body in bodies]
    poses = np.array(rows, dtype=float).reshape(-1, 7)[:, (0, 1, 2, 6, 3, 4, 5)]
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    poses[:, :3] /= SCALE
    return poses
