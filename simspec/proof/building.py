"""Builders of small worlds: bodies whose model, joint and shapes have their name, laws of one material, and changed copies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from simspec.world import frames
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Pose, Shape, World

AT_REST = (0.0,) * 6
"""Velocity of a free body."""
MASSLESS, ORIGIN = Inertial(0.0), Pose()


def fixed(name: str, *shapes: Shape, origin: Pose = ORIGIN, inertial: Inertial = MASSLESS) -> Body:
    """A body that is fixed to the world."""
    return Body(name, name, inertial, Joint(f"{name}_joint", "fixed", origin=origin), shapes)


def free(
    name: str,
    position: tuple[float, ...],
    inertial: Inertial,
    *shapes: Shape,
    velocity: tuple[float, ...] = AT_REST,
    group: str = "default",
) -> Body:
    """A free body at ``position``: x y z, and w x y z unless it is not turned."""
    whole = position if len(position) == 7 else (*position, *frames.IDENTITY)
    return Body(name, name, inertial, Joint(f"{name}_joint", "free", position=whole, velocity=velocity), shapes, group)


def slab(name: str, size: tuple[float, float, float], material: str) -> Body:
    """A fixed box whose upper face is at z = 0."""
    return fixed(name, Shape(f"{name}_0", "box", size, Pose((0.0, 0.0, -size[2] / 2.0)), material))


def single_material(name: str, friction: float, restitution: float = 0.0, **law: Any) -> Contact:
    """The contact of one material; ``law``: more numbers of its pair, and of a contact (filters)."""
    filters = {key: law.pop(key) for key in ("ignored_groups", "excluded_bodies") if key in law}
    material = Material(name, friction, restitution)
    return Contact(materials=(material,), pairs=(PairContact(name, name, friction, restitution, **law),), **filters)


def with_joint(body: Body, **fields: Any) -> Body:
    """A body with other fields of its joint."""
    return replace(body, joint=replace(body.joint, **fields))


def with_shapes(body: Body, change: Callable[[Shape], Shape]) -> Body:
    return replace(body, shapes=tuple(map(change, body.shapes)))


def with_bodies(world: World, change: Callable[[Body], Body], **fields: Any) -> World:
    """A world with each body changed, and other fields."""
    return replace(world, bodies=tuple(map(change, world.bodies)), **fields)
