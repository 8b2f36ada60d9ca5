"""Normalisations that every format needs before its template prints: templates hold no arithmetic.

All passes are deterministic to the last bit (plain floats, no LAPACK), so that the same world gives the same bytes on
every machine.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from simspec.world import frames
from simspec.world.inertia import lumped, lumped_gravity_scale
from simspec.world.types import Body, Pose, Quaternion, Vector3, World


def _vector(values: Sequence[float]) -> Vector3:
    x, y, z = values
    return (x, y, z)


def _quaternion(values: Sequence[float]) -> Quaternion:
    w, x, y, z = values
    return (w, x, y, z)


def gather(world: World) -> World:
    """The world with the inertia of rigid groups gathered on their topmost bodies where engines ask for it."""
    told = lumped(world)
    if not told:
        return world
    bodies = (
        dataclasses.replace(
            body, inertial=told.get(body.name, body.inertial), gravity_scale=lumped_gravity_scale(world, body)
        )
        for body in world.bodies
    )
    return dataclasses.replace(world, bodies=tuple(bodies))


def recentre_free_roots(world: World) -> tuple[World, dict[str, Vector3]]:
    """Put every free root's frame at its centre of mass, after gathering inertias (:func:`gather`).

    Returns the world with moved frames, and for each moved body the position of the new frame in the old one (its
    centre of mass). Axes stay parallel. Shapes, children and the initial state move along, so that the world is
    physically the same. Why: engines integrate the frame of a free root or its centre of mass; only when both are one
    point do all of them do the same (see ``world/kinematics.py``).
    """
    world = gather(world)
    offsets = {
        body.name: body.inertial.centre_of_mass
        for body in world.bodies
        if body.joint.kind == "free" and any(body.inertial.centre_of_mass)
    }
    if not offsets:
        return world, {}

    def moved(pose: Pose, offset: Vector3) -> Pose:
        return dataclasses.replace(pose, position=frames.subtract(pose.position, offset))

    bodies = []
    for body in world.bodies:
        joint = body.joint
        if joint.parent in offsets:
            body = dataclasses.replace(
                body, joint=dataclasses.replace(joint, origin=moved(joint.origin, offsets[joint.parent]))
            )
        if body.name in offsets:
            offset = offsets[body.name]
            lever = frames.rotate(_quaternion(joint.position[3:7]), offset)
            linear = frames.add(_vector(joint.velocity[:3]), frames.cross(_vector(joint.velocity[3:]), lever))
            body = dataclasses.replace(
                body,
                inertial=dataclasses.replace(body.inertial, centre_of_mass=(0.0, 0.0, 0.0)),
                shapes=tuple(dataclasses.replace(shape, pose=moved(shape.pose, offset)) for shape in body.shapes),
                joint=dataclasses.replace(
                    joint,
                    position=(*frames.add(_vector(joint.position[:3]), lever), *joint.position[3:7]),
                    velocity=(*linear, *joint.velocity[3:]),
                ),
            )
        bodies.append(body)
    return dataclasses.replace(world, bodies=tuple(bodies)), offsets


def restore_free_root(body: Body, offset: Vector3) -> Body:
    """Move a read-back body from the file's frame (at ``offset`` in the world's body frame) back to the world's frame."""
    return dataclasses.replace(
        body,
        inertial=dataclasses.replace(body.inertial, centre_of_mass=frames.add(body.inertial.centre_of_mass, offset)),
        shapes=tuple(
            dataclasses.replace(
                shape, pose=dataclasses.replace(shape.pose, position=frames.add(shape.pose.position, offset))
            )
            for shape in body.shapes
        ),
    )


def restore_frames(bodies: tuple[Body, ...], offsets: dict[str, Vector3]) -> tuple[Body, ...]:
    """Undo :func:`recentre_free_roots` on a read-back: bodies, their shapes, and the origins of their children.

    The initial state (``joint.position``, ``joint.velocity``) of free roots is moved back too where it is present.
    """
    restored = []
    for body in bodies:
        joint = body.joint
        if joint.parent in offsets:
            origin = dataclasses.replace(
                joint.origin, position=frames.add(joint.origin.position, offsets[joint.parent])
            )
            body = dataclasses.replace(body, joint=dataclasses.replace(joint, origin=origin))
        if body.name in offsets:
            body = restore_free_root(body, offsets[body.name])
            if joint.kind == "free" and joint.position:
                lever = frames.rotate(_quaternion(joint.position[3:7]), offsets[body.name])
                position = (*frames.subtract(_vector(joint.position[:3]), lever), *joint.position[3:7])
                velocity = joint.velocity
                if velocity:
                    linear = frames.subtract(_vector(velocity[:3]), frames.cross(_vector(velocity[3:]), lever))
                    velocity = (*linear, *velocity[3:])
                body = dataclasses.replace(body, joint=dataclasses.replace(joint, position=position, velocity=velocity))
        restored.append(body)
    return tuple(restored)


def tensor(moments: Vector3, turn: Quaternion) -> tuple[float, float, float, float, float, float]:
    """The inverse of :func:`simspec.world.inertia.principal_axes`: (xx, yy, zz, xy, xz, yz) from principal moments and their
    axes."""
    return frames.rotate_inertia(turn, (*moments, 0.0, 0.0, 0.0))
