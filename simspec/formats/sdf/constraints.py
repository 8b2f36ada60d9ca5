"""Constraints as SDF has them: a joint that follows another of its model, and a further joint of a link for a loop in a tree.

A joint of the language is where its child has it, and joins what the links of both sides have there when all joints are at
zero: a loop that is not closed there is not the file's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Final

from simspec.formats.sdf import tree
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world import frames
from simspec.world.canonical import derived
from simspec.world.kinematics import poses, trees
from simspec.world.types import Body, Connect, Follow, Pose, Weld, World

CLOSED: Final = 1e-12
"""m and rad: how far a loop may be open where all joints are at zero."""

Names = Mapping[tuple[str, str], str]


def _roots(world: World) -> dict[str, str]:
    return {body.name: root for root, bodies in trees(world).items() for body in bodies}


def couplings_in_trees(world: World) -> Refinement | None:
    """Not supported where a joint follows one of another tree, which is another model."""
    root = {body.joint.name: root for root, bodies in trees(world).items() for body in bodies}
    across = [held.name for held in _follows(world) if root[held.joint] != root[held.leader]]
    return (
        unsupported_if(f"{across[0]!r} couples joints of two models, which do not know each other's")
        if across
        else None
    )


def loops_in_trees(world: World) -> Refinement | None:
    """Not supported where a loop joins two trees, or is open where all joints are at zero."""
    root = _roots(world)
    for loop in _loops(world):
        if root[loop.first] != root[loop.second]:
            return unsupported_if(f"{loop.name!r} holds bodies of two models, which do not know each other's")
        if loop.name not in _closed(world):
            return unsupported_if(
                f"{loop.name!r} is open where all joints are at zero, and the file says where it is closed there"
            )
    return None


def _follows(world: World) -> Iterator[Follow]:
    return (held for held in world.constraints if isinstance(held, Follow))


def _loops(world: World) -> Iterator[Connect | Weld]:
    return (held for held in world.constraints if not isinstance(held, Follow))


@derived
def _closed(world: World) -> Set[str]:
    """The names of the loops that are closed where all joints are at zero."""
    loops = list(_loops(world))
    return {loop.name for loop, away in zip(loops, _openings(world, loops), strict=True) if away <= CLOSED}


def _openings(world: World, loops: Sequence[Connect | Weld]) -> Iterator[float]:
    """How far each loop is open where all joints are at zero."""
    at_zero = poses(world, at_zero=True) if loops else {}
    for loop in loops:
        between = frames.compose(frames.inverse(at_zero[loop.first]), at_zero[loop.second])
        if isinstance(loop, Connect):
            yield math.dist(frames.compose(between, Pose(loop.second_point)).position, loop.first_point)
        else:
            turn = frames.multiply(frames.conjugate(loop.pose.quaternion), between.quaternion)
            yield max(math.dist(between.position, loop.pose.position), math.hypot(*turn[1:]))


def loops_within(world: World, bodies: tuple[Body, ...]) -> list[Connect | Weld]:
    """The loops of a tree that a file says."""
    if not world.constraints:
        return []
    names = {body.name for body in bodies}
    return [loop for loop in _loops(world) if {loop.first, loop.second} <= names and loop.name in _closed(world)]


def mimics(world: World, bodies: tuple[Body, ...], names: Names) -> dict[str, tree.Mimic]:
    """What joints of a tree follow, by the names of their bodies."""
    owner = {body.joint.name: body.name for body in bodies}
    return {
        owner[held.joint]: tree.Mimic(names["joint", owner[held.leader]], held.ratio, held.offset)
        for held in _follows(world)
        if {held.joint, held.leader} <= owner.keys()
    }


def closing_joints(world: World, bodies: tuple[Body, ...], names: Names) -> Iterator[tree.Joint]:
    """The joints that close the loops of a tree."""
    for loop in loops_within(world, bodies):
        first, second = names["body", loop.first], names["body", loop.second]
        name = names["constraint", loop.name]
        if isinstance(loop, Connect):
            yield tree.Joint(name, "ball", first, second, place=loop.second_point)
        else:
            yield tree.Joint(name, "fixed", first, second)
