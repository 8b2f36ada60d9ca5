"""Worlds with constraints outside the tree, and how far those are from holding."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from simspec.world import frames
from simspec.world.actions import Force
from simspec.world.kinematics import layout_of, poses
from simspec.world.types import ConnectConstraint, FollowConstraint, Pose, World
from tests import worlds


def hinges() -> World:
    """A chain of three hinges on a fixed base."""
    return worlds.world(worlds.tree(["fixed", "hinge", "hinge", "hinge"], 7), "hinges")


def follower() -> World:
    """Two hinges in a chain that falls, of which the second follows the first, and begins where the coupling wants it."""
    base = hinges()
    leader, joint = (body.joint for body in base.bodies[1:3])
    offset = joint.position[0] + leader.position[0]
    return dataclasses.replace(base, constraints=(FollowConstraint("mirror", joint.name, leader.name, -1.0, offset),))


def closed_loop() -> World:
    """The same chain with its last body held where it is in its root's."""
    base = hinges()
    root, last = base.bodies[0].name, base.bodies[-1].name
    place = poses(base)
    point = frames.compose(frames.inverse(place[root]), place[last]).position
    return dataclasses.replace(base, constraints=(ConnectConstraint("latch", root, last, point, (0.0, 0.0, 0.0)),))


def pushed_loop() -> World:
    """A loop of five hinges whose first begins near a limit, pushed."""
    world = worlds.world(worlds.tree(["fixed", *["hinge"] * 5], 7), "loop")
    bodies, place = list(world.bodies), poses(world)
    root, last = bodies[0].name, bodies[-1].name
    point = frames.compose(frames.inverse(place[root]), place[last]).position
    joint = bodies[1].joint
    limits = (joint.position[0] - 0.01, joint.position[0] + 0.5)
    bodies[1] = dataclasses.replace(bodies[1], joint=dataclasses.replace(joint, position_limits=limits))
    pin, force = ConnectConstraint("pin", root, last, point, (0.0, 0.0, 0.0)), Force(last, (1.0, 0.0, 0.0), until=0.01)
    return dataclasses.replace(world, bodies=tuple(bodies), constraints=(pin,), forces=(force,))


def linkage(*limits: tuple[float, float] | None) -> World:
    """Three hinges about z in a plane, the last body pinned to the root's: it moves in one way. ``limits``: of the hinges."""
    base = hinges()
    bodies = [base.bodies[0]]
    for index, body in enumerate(base.bodies[1:]):
        bounds = limits[index] if index < len(limits) else None
        moved = dataclasses.replace(
            body.joint,
            origin=Pose((0.3, 0.1 * index, 0.0)),
            axis=(0.0, 0.0, 1.0),
            position=(0.2 * index,),
            velocity=(0.0,),
            position_limits=bounds,
        )
        bodies.append(dataclasses.replace(body, joint=moved))
    base = dataclasses.replace(base, bodies=tuple(bodies), name="linkage")
    place = poses(base)
    root, last = bodies[0].name, bodies[-1].name
    point = frames.compose(frames.inverse(place[root]), frames.compose(place[last], Pose((0.2, 0.0, 0.0)))).position
    return dataclasses.replace(base, constraints=(ConnectConstraint("latch", root, last, point, (0.2, 0.0, 0.0)),))


def violation(base: World, q: np.ndarray) -> float:
    """How far the constraints of :func:`follower` and :func:`closed_loop` are from holding in the state ``q`` (rad, m)."""
    (constraint,) = base.constraints
    at = {body.joint.name: q[place] for body, place in zip(base.bodies, layout_of(base).position, strict=True)}
    if isinstance(constraint, FollowConstraint):
        wanted = constraint.ratio * at[constraint.leader] + constraint.offset
        return float(np.abs(at[constraint.joint] - wanted).max())
    assert isinstance(constraint, ConnectConstraint)
    moved = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, position=tuple(at[body.joint.name].tolist())))
        for body in base.bodies
    )
    place = poses(dataclasses.replace(base, bodies=moved))
    ends = (
        frames.compose(place[constraint.first], Pose(constraint.first_point)).position,
        frames.compose(place[constraint.second], Pose(constraint.second_point)).position,
    )
    return math.dist(*ends)
