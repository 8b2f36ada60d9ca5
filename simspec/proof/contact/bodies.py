"""The bodies of contact probes: a floor of a pair's first material, and free balls and boxes of its second."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from simspec.proof.contact.probe import FLOOR, Law
from simspec.world import frames
from simspec.world.shapes import SHAPES
from simspec.world.tuples import vector6
from simspec.world.types import Body, Inertial, Joint, Pose, Quaternion, Shape, Vector3

FLOOR_SIZE = (400.0, 400.0, 2.0)
"""m. A box, not a plane: on one engine's planes boxes tumble, and another's gives one contact for a face."""
STATIONARY = (0.0,) * 6
"""Velocity: linear of the body's frame, then angular, both in world axes."""


def floor(law: Law, size: Vector3 = FLOOR_SIZE) -> Body:
    """A fixed box whose upper face is at z = 0."""
    shape = Shape(f"{FLOOR}_0", "box", size, Pose((0.0, 0.0, -size[2] / 2)), law.pair.first)
    return Body(FLOOR, FLOOR, Inertial(0.0), Joint(f"{FLOOR}_joint", "fixed"), (shape,))


def plane(law: Law) -> Body:
    """A fixed plane at z = 0."""
    shape = Shape(f"{FLOOR}_0", "plane", (), Pose(), law.pair.first)
    return Body(FLOOR, FLOOR, Inertial(0.0), Joint(f"{FLOOR}_joint", "fixed"), (shape,))


def fixed_box(name: str, size: Vector3, at: Vector3, material: str, turn: Quaternion = frames.IDENTITY) -> Body:
    """A fixed box with its centre at ``at``."""
    shape = Shape(f"{name}_0", "box", size, Pose(at, turn), material)
    return Body(name, name, Inertial(0.0), Joint(f"{name}_joint", "fixed"), (shape,))


def cluster(
    law: Law,
    name: str,
    balls: Mapping[str, Vector3],
    radius: float,
    mass: float,
    inertia: float,
    at: Vector3,
    turn: Quaternion = frames.IDENTITY,
    velocity: tuple[float, ...] = STATIONARY,
) -> Body:
    """A free body of several balls of one radius (m), by name the places of their centres in its frame; its centre of mass at
    ``at``, and one moment of inertia (kg m²) about every axis."""
    shapes = tuple(
        Shape(f"{name}_{part}", "sphere", (radius,), Pose(place), law.pair.second) for part, place in balls.items()
    )
    body = _free(name, Inertial(mass, inertia=(inertia,) * 3 + (0.0,) * 3), shapes[0], at, turn, velocity)
    return dataclasses.replace(body, shapes=shapes)


def ball(
    law: Law,
    name: str,
    radius: float,
    mass: float,
    at: Vector3,
    velocity: tuple[float, ...] = STATIONARY,
    inertia: float | None = None,
    material: str | None = None,
    group: str = "default",
) -> Body:
    """A free ball with its centre at ``at``; ``inertia`` (kg m²) about every axis, by default a solid ball's. ``material`` by
    default the pair's second; ``group``: see :class:`Trial`."""
    own = 0.4 * mass * radius * radius if inertia is None else inertia
    shape = Shape(f"{name}_0", "sphere", (radius,), Pose(), material or law.pair.second)
    body = _free(name, Inertial(mass, inertia=(own, own, own, 0.0, 0.0, 0.0)), shape, at, frames.IDENTITY, velocity)
    return dataclasses.replace(body, collision_group=group)


def box(
    law: Law,
    name: str,
    size: Vector3,
    mass: float,
    at: Vector3,
    velocity: tuple[float, ...] = STATIONARY,
    turn: Quaternion = frames.IDENTITY,
    material: str | None = None,
    group: str = "default",
) -> Body:
    """A free box of uniform density with its centre at ``at``; ``material`` and ``group`` as of :func:`ball`."""
    x, y, z = (edge * edge for edge in size)
    moments = (mass / 12.0 * (y + z), mass / 12.0 * (x + z), mass / 12.0 * (x + y))
    shape = Shape(f"{name}_0", "box", size, Pose(), material or law.pair.second)
    body = _free(name, Inertial(mass, inertia=(*moments, 0.0, 0.0, 0.0)), shape, at, turn, velocity)
    return dataclasses.replace(body, collision_group=group)


def solid(
    law: Law,
    name: str,
    kind: str,
    size: tuple[float, ...],
    mass: float,
    at: Vector3,
    turn: Quaternion = frames.IDENTITY,
) -> Body:
    """A free body of uniform density of a kind of shape, with its centre at ``at``."""
    moments = SHAPES[kind].moments(size, mass)
    shape = Shape(f"{name}_0", kind, size, Pose(), law.pair.second)
    return _free(name, Inertial(mass, inertia=vector6((*moments, 0.0, 0.0, 0.0))), shape, at, turn, STATIONARY)


def _free(
    name: str, inertial: Inertial, shape: Shape, at: Vector3, turn: Quaternion, velocity: tuple[float, ...]
) -> Body:
    joint = Joint(f"{name}_joint", "free", position=(*at, *turn), velocity=tuple(velocity))
    return Body(name, name, inertial, joint, (shape,))
