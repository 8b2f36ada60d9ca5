"""Where bodies are at the beginning and how they move: what a .wbt says of jointed bodies in place of joint rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from simspec.world import frames
from simspec.world.gathering import rigid_members, summed
from simspec.world.kinematics import poses
from simspec.world.types import Body, Pose, Vector3, World

Twist = tuple[Vector3, Vector3]
"""Velocity of a point (m/s) and angular velocity (rad/s), in world axes."""
STILL: Twist = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def twists(world: World) -> dict[str, Twist]:
    """The twist of every body at its frame's origin, at the initial state."""
    placed = poses(world)
    found: dict[str, Twist] = {}
    for body in world.bodies:
        joint, here = body.joint, placed[body.name]
        linear, angular = STILL
        if joint.parent is not None:
            linear, angular = moved(found[joint.parent], placed[joint.parent].position, here.position)
        if joint.kind == "hinge":
            angular = frames.add(angular, _along(here, joint.axis, joint.velocity[0]))
        elif joint.kind == "slide":
            linear = frames.add(linear, _along(here, joint.axis, joint.velocity[0]))
        elif joint.kind == "ball":
            angular = frames.add(angular, frames.rotate(here.quaternion, _vector(joint.velocity)))
        elif joint.kind == "free":
            linear, angular = _vector(joint.velocity[:3]), _vector(joint.velocity[3:])
        found[body.name] = (linear, angular)
    return found


def centres(bodies: Sequence[Body]) -> Mapping[str, Vector3]:
    """Of the topmost body of each rigid group that moves the group's centre of mass in its frame (m), of which Webots' body has
    the velocity."""
    return {
        top: summed((body.inertial, pose) for body, pose in members).centre_of_mass
        for top, members in rigid_members(bodies).items()
    }


def moved(twist: Twist, from_point: Vector3, to_point: Vector3) -> Twist:
    """The same motion of a rigid body at another of its points."""
    linear, angular = twist
    return frames.add(linear, frames.cross(angular, frames.subtract(to_point, from_point))), angular


def _along(here: Pose, axis: Vector3, rate: float) -> Vector3:
    x, y, z = frames.rotate(here.quaternion, axis)
    return (x * rate, y * rate, z * rate)


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return (x, y, z)
