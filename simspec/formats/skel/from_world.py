"""What everybody who writes a world as .skel has in common: words, names, poses, coordinates."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Final

from simspec.world import frames
from simspec.world.kinematics import poses
from simspec.world.types import Joint, Pose, Quaternion, Vector3, World

JOINT_TYPES: Final[Mapping[str, str]] = {
    "fixed": "weld",
    "hinge": "revolute",
    "slide": "prismatic",
    "ball": "ball",
    "free": "free",
}
"""The name of each kind of joint in .skel."""

GEOMETRY: Final[Mapping[str, tuple[tuple[tuple[str, slice], ...], float]]] = {
    "sphere": ((("radius", slice(0, 1)),), 1.0),
    "box": ((("size", slice(0, 3)),), 1.0),
    "cylinder": ((("radius", slice(0, 1)), ("height", slice(1, 2))), 1.0),
    "capsule": ((("radius", slice(0, 1)), ("height", slice(1, 2))), 1.0),
    "ellipsoid": ((("size", slice(0, 3)),), 2.0),
}
"""For each kind of shape which part of its size goes into which element, and what it is multiplied with: an ellipsoid's size
are its diameters."""
KINDS: Final = ("plane", *GEOMETRY, "mesh")
"""The kinds of shapes that the language has."""
UNSCALED: Final = (1.0, 1.0, 1.0)
"""Of a mesh."""
PLANE: Final = (("normal", (0.0, 0.0, 1.0)), ("offset", (0.0,)))
RESERVED: Final = {"world": "world."}
"""A joint's parent ``world`` is the world; a body of that name gets one that no spec can give."""


def file_name(name: str) -> str:
    """The name of a body in the file."""
    return RESERVED.get(name, name)


def world_name(name: str) -> str:
    """The inverse of :func:`file_name`."""
    return {there: here for here, there in RESERVED.items()}.get(name, name)


def zero_poses(world: World) -> dict[str, Pose]:
    """Where the bodies stand in the world at zero configuration: a free root at its origin, unturned."""
    at_origin = dataclasses.replace(
        world,
        bodies=tuple(
            dataclasses.replace(body, joint=dataclasses.replace(body.joint, position=(0.0, 0.0, 0.0, *frames.IDENTITY)))
            if body.joint.kind == "free"
            else body
            for body in world.bodies
        ),
    )
    return poses(at_origin, at_zero=True)


def coordinates(
    joint: Joint, rotation_vector: Callable[[Quaternion], Vector3]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """A joint's initial position and velocity in the file's coordinates; of a free joint the rotation comes first."""
    if joint.kind == "ball":
        return rotation_vector(joint.position), joint.velocity  # type: ignore[arg-type]
    if joint.kind == "free":
        turn = rotation_vector(joint.position[3:7])  # type: ignore[arg-type]
        return (*turn, *joint.position[:3]), (*joint.velocity[3:], *joint.velocity[:3])
    return joint.position, joint.velocity
