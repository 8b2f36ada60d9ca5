"""PhysX's unit of length, its bounds, and its values in the world's types."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import numpy as np

from simspec.engines.kit.arrays import checked_singles
from simspec.world.rotations import matrices
from simspec.world.types import Pose

NAME = "physx"
SCALE = 512.0
"""PhysX's unit of length is 1/512 m. Slides slower than 0.01 units per second, and rest, have a square along the world's
axes in place of the cone: with the metre, pushes at 45° meet up to 1.41 times the friction (measured). A power of two
changes no digit."""
CONTACT_OFFSET = 3.75e-6
"""Distance (m) from a shape in which it has contacts. That of two shapes together must be less than 0.004 units, 7.8e-6
m, beyond which points have no friction; with 1.5e-6 contacts at rest come and go, and towers lean (measured)."""
LEAST = 1e-6
"""The smallest speed (m/s) that PhysX accepts, for zero."""
FASTEST, FASTEST_LINEAR = 1e6, 1e16
"""Bounds of speeds (rad/s, 1/512 m/s), by default 100 rad/s."""


def imported() -> Any:
    """SAPIEN, without the environment variables that it sets for its renderer."""
    before = dict(os.environ)
    import sapien

    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)
    return sapien


def lengths(values: Iterable[float], name: str) -> tuple[float, ...]:
    """Lengths (m, m/s, m/s²) in PhysX's unit."""
    return checked_singles(NAME, (SCALE * value for value in values), name)


def unit_of(quaternion: Any) -> np.ndarray:
    turn = np.array(quaternion, dtype=float)
    found: np.ndarray = turn / np.linalg.norm(turn)
    return found


def inertia_of(actor: Any) -> np.ndarray:
    """The inertia (3, 3) of an actor about its centre of mass, in its own axes."""
    turn = matrices(unit_of(actor.cmass_local_pose.q))
    found: np.ndarray = turn @ np.diag(np.array(actor.inertia, dtype=float)) @ turn.T
    return found / (SCALE * SCALE)


def pose_of(pose: Any) -> Pose:
    """One of SAPIEN's poses as the world's."""
    x, y, z = (np.array(pose.p, dtype=float) / SCALE).tolist()
    return Pose((x, y, z), tuple(unit_of(pose.q).tolist()))
