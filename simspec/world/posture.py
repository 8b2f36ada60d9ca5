"""Poses of bodies at joint positions other than the initial ones; coupled joints follow their leaders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from simspec.world import frames
from simspec.world.kinematics import joint_displacement
from simspec.world.types import FollowConstraint, Pose, World


def initial_positions(world: World) -> dict[str, tuple[float, ...]]:
    """The initial position of every joint that moves, by its name."""
    return {body.joint.name: body.joint.position for body in world.bodies if body.joint.kind != "fixed"}


def followers(world: World) -> dict[str, FollowConstraint]:
    """The couplings of joints, by the joint that follows."""
    return {entry.joint: entry for entry in world.constraints if isinstance(entry, FollowConstraint)}


def with_followers(world: World, positions: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    """``positions`` with every coupled joint at its ratio times its leader's position, plus its offset. A leader may itself
    follow another joint."""
    couplings = followers(world)
    placed = {joint: tuple(position) for joint, position in positions.items()}

    def follow(joint: str, passed: frozenset[str]) -> tuple[float, ...]:
        coupling = couplings.get(joint)
        if coupling is not None and joint not in passed:  # a ring of couplings has no first leader: its positions stay
            (leader,) = follow(coupling.leader, passed | {joint})
            placed[joint] = (coupling.ratio * leader + coupling.offset,)
        return placed[joint]

    for joint in couplings:
        follow(joint, frozenset())
    return placed


def poses_at(world: World, positions: Mapping[str, Sequence[float]]) -> dict[str, Pose]:
    """The pose of every body frame in the world with joints at ``positions``, by name; joints without a name there are at their
    initial positions. A free joint has x y z, then w x y z, of the body frame."""
    placed: dict[str, Pose] = {}
    for body in world.bodies:
        joint = body.joint
        start = joint_frame(placed, body.joint.parent, joint.origin)
        placed[body.name] = frames.compose(start, joint_displacement(body, positions.get(joint.name, joint.position)))
    return placed


def joint_frame(placed: Mapping[str, Pose], parent: str | None, origin: Pose) -> Pose:
    """The pose of a joint's frame in the world, where ``placed`` has its parent."""
    return origin if parent is None else frames.compose(placed[parent], origin)
