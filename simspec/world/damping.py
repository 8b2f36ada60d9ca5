"""Damping of joints that is implicit in time (``physics.damping: implicit``).

A step of semi-implicit Euler whose damping acts at the velocity v′ at the end of the step is

    (M + dt D) v′ = M v + dt (τ − h),    q′ = q ⊕ dt v′,

with the bias force h, the efforts τ of all else, and the diagonal matrix D of the damping coefficients. Since M v =
(M + dt D) v − dt D v, this is the step of explicit damping with the armature increased by dt D:

    (M + dt D) v′ = (M + dt D) v + dt (τ − h − D v).

The two are one law, with contact, constraints and dry friction too: their impulses meet the matrix M + dt D. A world therefore
has implicit damping as explicit damping and armature, which every engine with both integrates, and the oracle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Container

from simspec.language.vocabulary import TREE_JOINTS
from simspec.world.types import Body, Joint, World

IMPLICIT = "implicit"


def implicitly_damped(world: World) -> tuple[Body, ...]:
    """The bodies of a world whose joints have implicit damping. That of free joints is explicit: few engines have armature of
    them."""
    if world.physics.damping != IMPLICIT:
        return ()
    return tuple(body for body in world.bodies if body.joint.damping and body.joint.kind in TREE_JOINTS)


def with_implicit_damping(world: World) -> World:
    """``world``, whose armature is as written, with dt × damping added to it where damping is implicit."""
    damped = {body.name for body in implicitly_damped(world)}
    return _with_joints(world, damped, lambda joint: _increased(joint, world.physics.timestep))


def without_implicit_damping(world: World) -> World:
    """The inverse of :func:`with_implicit_damping`: armature as written in the spec, for files of languages in which damping is
    implicit in time."""
    changed = {body.name for body in world.bodies if body.joint.written_armature is not None}
    return _with_joints(world, changed, _as_written)


def retimed(world: World, timestep: float, steps: int) -> World:
    """``world`` with another timestep (s) and number of steps: the armature of implicit damping follows it."""
    physics = dataclasses.replace(world.physics, timestep=timestep, steps=steps)
    return with_implicit_damping(dataclasses.replace(without_implicit_damping(world), physics=physics))


def armature_of_spec(joint: Joint) -> float:
    """The armature of a joint (kg m², kg) without that of implicit damping."""
    return joint.armature if joint.written_armature is None else joint.written_armature


def _with_joints(world: World, names: Container[str], change: Callable[[Joint], Joint]) -> World:
    bodies = tuple(
        dataclasses.replace(body, joint=change(body.joint)) if body.name in names else body for body in world.bodies
    )
    return dataclasses.replace(world, bodies=bodies) if bodies != world.bodies else world


def _increased(joint: Joint, timestep: float) -> Joint:
    return dataclasses.replace(
        joint, armature=joint.armature + timestep * joint.damping, written_armature=joint.armature
    )


def _as_written(joint: Joint) -> Joint:
    return dataclasses.replace(joint, armature=armature_of_spec(joint), written_armature=None)
