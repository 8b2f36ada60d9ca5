"""Forces of the world: bodies that are there and can move, and times within the run."""

from __future__ import annotations

from collections.abc import Container, Sequence

from simspec.errors import Problem
from simspec.language.document import Key
from simspec.language.sources import Source
from simspec.language.strict import near
from simspec.resolve.named_frames import places_of
from simspec.world import frames
from simspec.world.actions import Force
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, Frame, Physics, Pose, World

NOWHERE = (0.0, 0.0, 0.0)


def forces(
    source: Source,
    bodies: Sequence[Body],
    whole: Physics,
    kinematic: Container[str] = (),
    named: Sequence[Frame] = (),
) -> tuple[tuple[Force, ...], list[Problem]]:
    """The forces in the order of the file, and what is wrong with them. ``whole``: the time of the whole scenario;
    ``named``: the frames that may be named in place of a body."""
    places = places_of(bodies, named)
    groups = rigid_groups(World("", tuple(bodies)))
    end = whole.steps * whole.timestep
    resolved, problems = [], []
    for index, written in enumerate(source.content.forces):
        path: tuple[Key, ...] = ("forces", index)
        start = getattr(written, "from")
        body, place = places.get(written.body, ("", Pose()))
        if not body:
            message, hint = f"there is no body {written.body!r}", near(written.body, sorted(places))
            problems.append(source.document.problem((*path, "body"), message, found=written.body, hint=hint))
        elif groups[body] == "world":
            message = f"{body} is fixed to the world: no force moves it"
            problems.append(source.document.problem((*path, "body"), message, found=written.body))
        elif groups[body] in kinematic:
            message = f"{body} is kinematic: no force moves it"
            problems.append(source.document.problem((*path, "body"), message, found=written.body))
        if whole.steps and start >= end:
            late, found = "it begins after the end of the run", f"{start:g} s"
            hint = "a longer physics.duration"
            problems.append(
                source.document.problem((*path, "from"), late, found=found, allowed=f"below {end:g} s", hint=hint)
            )
        resolved.append(
            Force(
                body,
                written.force or NOWHERE,
                written.torque or NOWHERE,
                frames.compose(place, Pose(written.at or NOWHERE)).position,
                start,
                written.until,
            )
        )
    return tuple(resolved), problems
