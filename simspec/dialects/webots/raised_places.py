"""Where a node of a .wbt stands, and what is known of a body before its joint's rate is."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simspec.formats.wbt.document import Node
from simspec.world import frames
from simspec.world.types import Inertial, Joint, Pose, Quaternion, Vector3


@dataclass(slots=True)
class Found:
    """A body as its nodes have it: ``place`` in the node around it and ``pose`` in the world, at the initial state; ``moves``
    whether it can, ``top`` the name of the topmost body of its rigid group."""

    node: Node
    name: str
    model: str
    joint: Joint
    inertial: Inertial
    place: Pose
    pose: Pose
    moves: bool
    top: str


def pose_of(node: Node) -> Pose:
    """Where a node stands in the one around it."""
    *axis, angle = node.numbers("rotation", 4)
    if angle == 0.0 and axis != [0.0, 0.0, 1.0]:
        raise node.refused("a rotation by nothing should be 0 0 1 0")
    length = math.hypot(*axis)
    if abs(length - 1.0) > 1e-9:
        raise node.refused("the axis of its rotation should be of length 1")
    x, y, z = (part / length for part in axis)
    return Pose(vector(node, "translation"), about((x, y, z), angle))


def about(axis: Vector3, angle: float) -> Quaternion:
    """The rotation by an angle (rad) about a unit axis."""
    sine = math.sin(angle / 2.0)
    return frames.normalise((math.cos(angle / 2.0), axis[0] * sine, axis[1] * sine, axis[2] * sine))


def vector(node: Node, name: str) -> Vector3:
    x, y, z = node.numbers(name, 3)
    return (x, y, z)


def unit(node: Node, name: str) -> Vector3:
    x, y, z = vector(node, name)
    length = math.hypot(x, y, z)
    if abs(length - 1.0) > 1e-9:
        raise node.refused(f"{name} should be of length 1")
    return (x / length, y / length, z / length)
