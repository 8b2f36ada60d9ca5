"""Random robots that most languages of robot files can say: trees with meshes, joints that follow others, and loops that are
closed where all joints are at zero."""

from __future__ import annotations

import dataclasses
import functools
import random

import numpy as np

from simspec.testing.worlds import inertial, pose
from simspec.world import frames
from simspec.world.frames import sorted_pair
from simspec.world.hull import centred, corners, mesh_size
from simspec.world.kinematics import poses
from simspec.world.types import (
    Body,
    ConnectConstraint,
    Contact,
    FollowConstraint,
    Material,
    PairContact,
    Pose,
    Shape,
    WeldConstraint,
    World,
)
from tests import worlds

KINDS = ("hinge", "slide", "ball", "fixed")


def robot(seed: int, kinds: tuple[str, ...] = KINDS, *, loops: bool = True, free: bool | None = None) -> World:
    """A robot of two to seven bodies, whose joints are of these kinds and begin at zero. ``free``: whether its root is; None:
    by the seed."""
    draw = random.Random(seed)
    count = draw.randint(2, 7)
    root = "free" if (draw.random() < 0.5 if free is None else free) else "fixed"
    chosen = [root, *(draw.choice(kinds) for _ in range(count - 1))]
    bodies = worlds.tree(chosen, seed, _parents(count, draw), damping=0.1)
    bodies = tuple(_at_rest(body, index, draw) for index, body in enumerate(bodies))
    base = World("robot", bodies)
    constraints = [*_follows(bodies, draw), *(_loops(base, draw) if loops else ())]
    excluded = {sorted_pair(body.name, body.joint.parent) for body in bodies if body.joint.parent is not None}
    excluded |= {sorted_pair(loop.first, loop.second) for loop in constraints if not isinstance(loop, FollowConstraint)}
    contact = Contact(
        materials=(Material("default", 0.5),),
        pairs=(PairContact("default", "default", 0.5, 0.0),),
        excluded_bodies=tuple(sorted(excluded)),
    )
    return worlds.world(
        bodies, "robot", contact=contact, constraints=tuple(sorted(constraints, key=lambda constraint: constraint.name))
    )


def _parents(count: int, draw: random.Random) -> list[int]:
    """The parent of each body, so that they stand depth first, as those of specs do."""
    parents = [-1]
    for index in range(1, count):
        above = [index - 1]
        while parents[above[-1]] >= 0:
            above.append(parents[above[-1]])
        parents.append(draw.choice(above))
    return parents


def _at_rest(body: Body, index: int, draw: random.Random) -> Body:
    joint = body.joint
    zero = {"ball": frames.IDENTITY, "hinge": (0.0,), "slide": (0.0,)}.get(joint.kind, joint.position)
    at_rest = dataclasses.replace(joint, position=zero, velocity=(0.0,) * len(joint.velocity))
    shapes = tuple(_shape(f"s{index}{number}", draw) for number in range(draw.randint(0, 2)))
    return dataclasses.replace(body, inertial=inertial(draw), joint=at_rest, shapes=shapes)


def _shape(name: str, draw: random.Random) -> Shape:
    collision, visual = draw.choice([(True, True), (True, False), (False, True)])
    kind, size = ("mesh", hull(draw.randrange(4))) if draw.random() < 0.7 else ("box", (0.1, 0.2, 0.3))
    return Shape(name, kind, size, pose(draw, 0.1), "default" if collision else "", collision, visual)


@functools.cache
def hull(number: int) -> tuple[float, ...]:
    """The size of a mesh of a few vertices, of which one is a cube's."""
    points = np.random.default_rng(number).normal(size=(12, 3)) * (0.05, 0.08, 0.11)
    if number == 0:
        points = np.array([[x, y, z] for x in (0.0, 0.1) for y in (0.0, 0.1) for z in (0.0, 0.1)])
    return mesh_size(centred(points[corners(points)])[1])


def _follows(bodies: tuple[Body, ...], draw: random.Random) -> list[FollowConstraint]:
    driven = [body.joint.name for body in bodies if body.joint.kind in ("hinge", "slide")]
    return [
        FollowConstraint(name, name, draw.choice(driven[:index]), draw.choice([1.0, -1.0, 0.37]))
        for index, name in enumerate(driven)
        if index and draw.random() < 0.5
    ]


def _loops(base: World, draw: random.Random) -> list[ConnectConstraint | WeldConstraint]:
    """A loop between two bodies that no joint joins, if there are two that could move against each other."""
    place = poses(base)
    names = [body.name for body in base.bodies]
    parents = {body.name: body.joint.parent for body in base.bodies}
    rigid = {body.name: body.name for body in base.bodies}
    for body in base.bodies:
        if body.joint.kind == "fixed" and body.joint.parent is not None:
            rigid[body.name] = rigid[body.joint.parent]
    pairs = [
        (a, b) for a in names for b in names if a != b and rigid[a] != rigid[b] and a != parents[b] and b != parents[a]
    ]
    if not pairs or draw.random() < 0.4:
        return []
    first, second = draw.choice(pairs)
    between = frames.compose(frames.inverse(place[first]), place[second])
    if draw.random() < 0.3:
        return [WeldConstraint("latch", first, second, between)]
    point = pose(draw, 0.2).position
    return [ConnectConstraint("latch", first, second, frames.compose(between, Pose(point)).position, point)]


def assert_same(ours: World, theirs: World, tolerance: float) -> None:
    """Both have the same bodies, joints, shapes and constraints, each number to the tolerance (relative to the larger of it and
    1). Names of materials and of couplings, initial states of followers, and what no file of robots says, are not compared."""
    assert [body.name for body in ours.bodies] == [body.name for body in theirs.bodies]
    for mine, other in zip(ours.bodies, theirs.bodies, strict=True):
        assert _near(_inertial(mine), _inertial(other), tolerance), mine.name
        here, there = mine.joint, other.joint
        assert (here.name, here.kind, here.parent) == (there.name, there.kind, there.parent)
        numbers = [(*_pose(joint.origin), *joint.axis, joint.damping, joint.armature) for joint in (here, there)]
        assert _near(*numbers, tolerance), mine.name
        shapes = [
            {shape.name: (shape.kind, shape.collision, shape.visual) for shape in body.shapes} for body in (mine, other)
        ]
        assert shapes[0] == shapes[1]
        of_other = {shape.name: shape for shape in other.shapes}
        for shape in mine.shapes:
            again = of_other[shape.name]
            assert _near((*shape.size, *_pose(shape.pose)), (*again.size, *_pose(again.pose)), tolerance), shape.name
    assert _constraints(ours).keys() == _constraints(theirs).keys()
    for name, constraint in _constraints(ours).items():
        assert _near(constraint, _constraints(theirs)[name], tolerance), name


def _near(first: tuple[float, ...], second: tuple[float, ...], tolerance: float) -> bool:
    return bool(np.allclose(first, second, rtol=tolerance, atol=tolerance))


def _inertial(body: Body) -> tuple[float, ...]:
    return (body.inertial.mass, *body.inertial.centre_of_mass, *body.inertial.inertia)


def _pose(place: Pose) -> tuple[float, ...]:
    return (*place.position, *(value for row in frames.matrix(place.quaternion) for value in row))


def _constraints(base: World) -> dict[tuple[str, ...], tuple[float, ...]]:
    said: dict[tuple[str, ...], tuple[float, ...]] = {}
    for constraint in base.constraints:
        if isinstance(constraint, FollowConstraint):
            said["follow", constraint.joint, constraint.leader] = (constraint.ratio, constraint.offset)
        elif isinstance(constraint, ConnectConstraint):
            said["connect", constraint.first, constraint.second] = (*constraint.first_point, *constraint.second_point)
        else:
            said["weld", constraint.first, constraint.second] = _pose(constraint.pose)
    return said
