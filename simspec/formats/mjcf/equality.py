"""Constraints as MJCF has them: equalities of joints, and of sites that stand in the bodies they are about."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from simspec.formats.mjcf.tree import Attributes, Equality, Site
from simspec.world import frames
from simspec.world.types import Connect, Constraint, Follow, Pose, Vector3, World

NOWHERE: Vector3 = (0.0, 0.0, 0.0)
SITE: Final = "constraint/"
"""Prefix of the two sites of a connect or a weld; behind it the constraint's name, and which of the two it is."""


def ends(constraint: Constraint, anchor: Vector3 = NOWHERE) -> tuple[Pose, Pose]:
    """The frames in the two bodies that a connect or a weld holds together, a weld at ``anchor`` in its second body."""
    if isinstance(constraint, Follow):
        raise TypeError(f"{constraint.name!r} couples joints, and holds no bodies")
    if isinstance(constraint, Connect):
        return Pose(constraint.first_point), Pose(constraint.second_point)
    return frames.compose(constraint.pose, Pose(anchor)), Pose(anchor)


def sites_of(
    world: World, offsets: Mapping[str, Vector3], anchors: Mapping[str, Vector3] = MappingProxyType({})
) -> dict[str, tuple[Site, ...]]:
    """The sites of constraints on every body that has some; ``offsets``: where the file's frames of free roots stand in the
    world's; ``anchors``: by the name of a weld the point of its second body at which it is held (default: its origin)."""
    sites: dict[str, tuple[Site, ...]] = {}
    for constraint in world.constraints:
        if isinstance(constraint, Follow):
            continue
        bodies = (constraint.first, constraint.second)
        for number, (body, end) in enumerate(
            zip(bodies, ends(constraint, anchors.get(constraint.name, NOWHERE)), strict=True), start=1
        ):
            place = frames.subtract(end.position, offsets.get(body, NOWHERE))
            site = Site(f"{SITE}{constraint.name}/{number}", place, end.quaternion)
            sites[body] = (*sites.get(body, ()), site)
    return sites


def frame_sites(world: World, offsets: Mapping[str, Vector3]) -> dict[str, tuple[Site, ...]]:
    """The named frames on every body that has some, as sites; ``offsets`` as of :func:`sites_of`."""
    sites: dict[str, tuple[Site, ...]] = {}
    for frame in world.frames:
        place = frames.subtract(frame.pose.position, offsets.get(frame.body, NOWHERE))
        site = Site(frame.name, place, frame.pose.quaternion)
        sites[frame.body] = (*sites.get(frame.body, ()), site)
    return sites


def equalities(world: World, more: Attributes = ()) -> tuple[Equality, ...]:
    """One equality for each constraint, with further attributes."""
    written = []
    for constraint in world.constraints:
        if isinstance(constraint, Follow):
            coefficients = (constraint.offset, constraint.ratio, 0.0, 0.0, 0.0)
            own: Attributes = (
                ("joint1", constraint.joint),
                ("joint2", constraint.leader),
                ("polycoef", coefficients),
            )
            written.append(Equality("joint", constraint.name, (*own, *more)))
        else:
            own = (("site1", f"{SITE}{constraint.name}/1"), ("site2", f"{SITE}{constraint.name}/2"))
            written.append(Equality(constraint.kind, constraint.name, (*own, *more)))
    return tuple(written)
