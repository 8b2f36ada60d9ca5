"""Frames that PhysX stores with little round-off.

PhysX turns and normalises the frames of joints and of inertias in single precision, so that lengths of quaternions are up to
2e-7 off, and directions as much. Along a chain these errors add up, and act on every weight for the whole motion. Many frames
mean the same: a frame may turn about its joint's axis, and principal axes may be in any order. simspec takes the frame that
PhysX stores best, of those that it tries.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from simspec.world import frames
from simspec.world.types import Quaternion

TURNS = 97
"""Turns of a joint's frame that are tried."""
KEPT = 1024
"""Frames of which the answer is remembered: a state that is set builds a scene again."""
_HALF = math.sqrt(0.5)
ORDERS: tuple[tuple[tuple[int, int, int], Quaternion], ...] = (
    ((0, 1, 2), (1.0, 0.0, 0.0, 0.0)),
    ((1, 2, 0), (0.5, 0.5, 0.5, 0.5)),
    ((2, 0, 1), (0.5, -0.5, -0.5, -0.5)),
    ((1, 0, 2), (_HALF, 0.0, 0.0, _HALF)),
    ((0, 2, 1), (_HALF, _HALF, 0.0, 0.0)),
    ((2, 1, 0), (_HALF, 0.0, _HALF, 0.0)),
)
"""Orders of principal moments, with the turn of the axes; half turns change no rounding."""


@functools.lru_cache(maxsize=KEPT)
def principal_order(sapien: Any, axes: Quaternion) -> tuple[tuple[int, int, int], Quaternion]:
    """The order of principal moments, with their axes, whose rotation PhysX stores best."""
    link = sapien.physx.PhysxArticulationLinkComponent()

    def off(entry: tuple[tuple[int, int, int], Quaternion]) -> float:
        link.cmass_local_pose = sapien.Pose([0.0, 0.0, 0.0], entry[1])
        return _distance(link.cmass_local_pose, entry[1])

    return min(((order, frames.multiply(axes, turn)) for order, turn in ORDERS), key=off)


@functools.lru_cache(maxsize=KEPT)
def joint_turn(sapien: Any, above: Quaternion, below: Quaternion, origin: Quaternion, turn: Quaternion) -> Quaternion:
    """The rotation of a joint's frame that PhysX stores best in parent and child, of those that take x where ``turn`` takes it.
    ``origin``: of the joint in its parent; ``above`` and ``below``: axes of the inertias of parent and child."""
    parent = sapien.physx.PhysxArticulationLinkComponent()
    child = sapien.physx.PhysxArticulationLinkComponent(parent)
    for link, axes in ((parent, above), (child, below)):
        link.cmass_local_pose = sapien.Pose([0.0, 0.0, 0.0], axes)

    def off(tried: Quaternion) -> float:
        outer = frames.multiply(origin, tried)
        child.joint.pose_in_parent = sapien.Pose([0.0, 0.0, 0.0], outer)
        child.joint.pose_in_child = sapien.Pose([0.0, 0.0, 0.0], tried)
        return math.hypot(_distance(child.joint.pose_in_parent, outer), _distance(child.joint.pose_in_child, tried))

    return min(_turned(turn), key=off)


def _turned(turn: Quaternion) -> Iterable[Quaternion]:
    for number in range(TURNS):
        angle = 2.0 * math.pi * number / TURNS
        yield frames.multiply(turn, frames.from_axis_angle((1.0, 0.0, 0.0), angle))


def _distance(stored: Any, given: Quaternion) -> float:
    """Between two quaternions of either sign."""
    found, wanted = np.array(stored.q, dtype=float), np.array(given)
    return float(min(np.linalg.norm(found - wanted), np.linalg.norm(found + wanted)))
