"""Kinematic bodies of the world: their masses beside all that moves, what does not touch them, and how they move."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from simspec.errors import Problem
from simspec.language.document import Key
from simspec.language.motions import Motion as SpecMotion
from simspec.language.sources import Source
from simspec.language.strict import near
from simspec.resolve.poses import orientation
from simspec.world.actions import KINEMATIC_MASS_RATIO, Motion, Quaternion, Vector3
from simspec.world.kinematics import rigid_groups
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Inertial, Shape, World

LEAST = 1.0
"""kg of all that moves that a kinematic body is heavier than at least, where nothing or a feather moves."""


class Kinematic(NamedTuple):
    """What `kinematic` and `motion` make of a world.

    motions   one for each kinematic body, in the order of the world's bodies
    bodies    the world's bodies, kinematic ones with their mass, and where they begin
    apart     pairs of bodies that nothing pushes apart: both are where they are told to be
    problems  what is wrong
    """

    motions: tuple[Motion, ...]
    bodies: tuple[Body, ...]
    apart: list[tuple[str, str]]
    problems: list[Problem]


def motions(source: Source, bodies: tuple[Body, ...], kinematic: Sequence[str]) -> Kinematic:
    """The motions of a spec; ``kinematic``: the full names of the bodies that are."""
    written, problems = source.content.motion, []
    names = {body.name for body in bodies}
    for name in written:
        if name in kinematic:
            continue
        path: tuple[Key, ...] = ("motion", name)
        if name not in names:
            message, hint = f"there is no body {name!r}", near(name, sorted(kinematic or names))
            problems.append(source.document.problem(path, message, key=True, found=name, hint=hint))
        else:
            hint = "kinematic: true, of a root without joint"
            problems.append(source.document.problem(path, f"{name} is not kinematic", key=True, hint=hint))
    if not kinematic or problems:
        return Kinematic((), bodies, [], problems)
    moved = tuple(_motion(body, written.get(body.name)) for body in bodies if body.name in kinematic)
    groups = rigid_groups(World("", bodies))
    solid = [body.name for body in bodies if any(shape.collision for shape in body.shapes)]
    moving = [name for name in solid if groups[name] in kinematic]
    still = [name for name in solid if groups[name] == "world"]
    apart = [(first, second) for first in moving for second in still]
    apart += [
        (first, second) for first in moving for second in moving if first < second and groups[first] != groups[second]
    ]
    carried = sum(body.inertial.mass for body in bodies if groups[body.name] not in ("world", *kinematic))
    placed = {motion.body: _placed(motion, KINEMATIC_MASS_RATIO * max(carried, LEAST)) for motion in moved}
    return Kinematic(
        moved, tuple(placed[body.name](body) if body.name in placed else body for body in bodies), apart, []
    )


def _motion(body: Body, written: SpecMotion | None) -> Motion:
    """The motion of a body; where nothing is written it stands where its pose says."""
    x, y, z, qw, qx, qy, qz = body.joint.position
    place, turn = (x, y, z), (qw, qx, qy, qz)
    if written is None:
        return Motion(body.name, (0.0,), (place,), (turn,))
    places: list[Vector3] = []
    turns: list[Quaternion] = []
    for point in written.points:
        place = point.xyz or place
        turn = orientation(point) if point.rpy is not None or point.quat is not None else turn
        places.append(place)
        turns.append(turn)
    times = tuple(point.at for point in written.points)
    return Motion(body.name, times, tuple(places), tuple(turns), written.interpolation)


def _placed(motion: Motion, mass: float) -> Callable[[Body], Body]:
    """What makes a body one of this mass, where its motion begins, at rest: round, about its frame's origin, as far out as its
    shapes."""

    def placed(body: Body) -> Body:
        reach = max([1.0, *(_reach(shape) for shape in body.shapes)])
        inertia = mass * reach**2
        joint = replace(
            body.joint,
            position=(*motion.positions[0], *motion.quaternions[0]),
            velocity=(0.0,) * len(body.joint.velocity),
        )
        return replace(body, inertial=Inertial(mass, inertia=(inertia, inertia, inertia, 0.0, 0.0, 0.0)), joint=joint)

    return placed


def _reach(shape: Shape) -> float:
    """How far from the body's origin a shape reaches (m)."""
    return math.hypot(*shape.pose.position) + SHAPES[shape.kind].outer_radius(shape.size)
