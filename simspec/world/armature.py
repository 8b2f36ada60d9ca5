"""Armature as mass and inertia, for engines that have no field for it.

The armature of a free joint has the kinetic energy ½ a |v|² + ½ b |ω|², with the velocity v of the body's centre of mass and
its angular velocity ω, both absolute. That is the energy of a mass a at the centre of mass and of the isotropic tensor b 1.
The tensor adds no bias force, since ω × b ω = 0. The mass adds its weight alone, which ``gravity_scale`` takes away. Mass
matrix, bias force and potential are the same, and impulses of contact and constraints meet the same mass matrix.

That of a ball joint is ½ a |ω|² of the angular velocity relative to the parent. Where the parent cannot move, this is the
isotropic tensor a 1 of the child. Where it moves, the energy contains the product of two angular velocities, which no tensor of
single bodies has.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from simspec.world.canonical import derived
from simspec.world.inertia import gathered, lumped, lumped_gravity_scale, lumped_inertial
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, Inertial, Joint, World


def as_inertia(world: World, only_differences: bool = False) -> World:
    """``world`` with the armature of free joints, and of balls whose parents cannot move, as mass and inertia of their bodies.

    ``only_differences``: of free joints the difference of their two numbers alone, for languages that have a single number for
    both, and nothing of balls.
    """
    changed = _changed(world, only_differences)
    return world if changed is None else changed


def weightless(world: World, received: World) -> tuple[str, ...]:
    """The names of the bodies to which :func:`as_inertia`, which made ``received`` of ``world``, added mass without weight."""
    pairs = zip(world.bodies, received.bodies, strict=True)
    return tuple(
        body.name
        for body, other in pairs
        if other.joint != body.joint and other.gravity_scale != lumped_gravity_scale(world, body)
    )


@derived
def _changed(world: World, only_differences: bool) -> World | None:
    added = dict(_added(world, only_differences))
    if not added:
        return None
    if any(name in lumped(world) for name in added):  # else the group's centre of mass would move
        world = gathered(world)
    bodies = tuple(
        _heavier(world, body, *added[body.name], only_differences) if body.name in added else body
        for body in world.bodies
    )
    return dataclasses.replace(world, bodies=bodies)


def _added(world: World, only_differences: bool) -> Iterator[tuple[str, tuple[float, float]]]:
    """By name of a body the mass (kg) and the moment about every axis (kg m²) to add."""
    groups = rigid_groups(world)
    for body in world.bodies:
        joint, mass, moment = body.joint, 0.0, 0.0
        if joint.kind == "free":
            least = _common(joint) if only_differences else 0.0
            mass, moment = joint.armature - least, joint.angular_armature - least
        elif joint.kind == "ball" and not only_differences and lumped_inertial(world, body).mass:
            moment = joint.armature if joint.parent is None or groups[joint.parent] == "world" else 0.0
        if mass or moment:
            yield body.name, (mass, moment)


def _common(joint: Joint) -> float:
    return min(joint.armature, joint.angular_armature)


def _heavier(world: World, body: Body, mass: float, moment: float, only_differences: bool) -> Body:
    before, scale = body.inertial, body.gravity_scale
    xx, yy, zz, xy, xz, yz = before.inertia
    moments = (xx + moment, yy + moment, zz + moment, xy, xz, yz)
    inertial = Inertial(before.mass + mass, before.centre_of_mass, moments)
    if mass and any(world.physics.gravity):
        scale *= before.mass / inertial.mass
    left = _common(body.joint) if only_differences else 0.0
    joint = dataclasses.replace(body.joint, armature=left, angular_armature=left, written_armature=None)
    return dataclasses.replace(body, inertial=inertial, gravity_scale=scale, joint=joint)
