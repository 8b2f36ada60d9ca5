"""Frames of one body that MuJoCo takes for one though they are two, told by other axes that mean the same.

MuJoCo does not compute the pose of an inertial frame, a geom or a site that is as its body's frame, or, of geoms, as the
inertial frame, and compares with a tolerance of 1e-6 (m, and of a quaternion's components). A mass matrix is then wrong by
up to 1e-6 of itself (measured: 1.3e-8 in a humanoid that was stored in single precision). It does so only where the axes are
near to each other. So where frames are near and not equal, principal axes are named in another order, shapes turned by half
a turn that leaves them as they are, and both sites of a constraint turned alike.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Final

from simspec.formats.mjcf.tree import MjcfBody, MjcfGeom, MjcfInertial, MjcfSite
from simspec.world import frames
from simspec.world.types import Pose, Quaternion

NEAR: Final = 2e-6
"""Frames whose positions (m) and quaternions differ by less are taken for one; MuJoCo's own bound is half of it."""
SAME: Final = 1e-12
"""Frames that differ by less are one to the precision of the proof."""
CYCLE: Final[Quaternion] = (0.5, 0.5, 0.5, 0.5)
"""The turn that brings x to y, y to z and z to x."""
HALF_TURNS: Final[tuple[Quaternion, ...]] = ((0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))
TURNS: Final[Mapping[str, tuple[Quaternion, ...]]] = {
    **dict.fromkeys(("sphere", "box", "cylinder", "capsule", "ellipsoid"), HALF_TURNS),
    "plane": HALF_TURNS[:1],
}
"""Turns about its own axes that leave a geom as it is, by its type; a mesh has none."""


def taken_for_one(frame: Pose, other: Pose) -> bool:
    """Whether MuJoCo takes two frames, or their axes, for one though they are two."""
    axes = min(
        max(abs(a - sign * b) for a, b in zip(frame.quaternion, other.quaternion, strict=True)) for sign in (1.0, -1.0)
    )
    away = max(abs(a - b) for a, b in zip(frame.position, other.position, strict=True))
    return axes < NEAR and (axes > SAME or SAME < away < NEAR)


def apart(body: MjcfBody) -> MjcfBody:
    """The body, with an inertial frame and geoms that MuJoCo does not take for what they are not."""
    inertial = body.inertial and _inertial(body.inertial)
    others = [Pose()] if inertial is None else [Pose(), Pose(inertial.position, inertial.orientation)]
    geoms = tuple(_geom(geom, others) for geom in body.geoms)
    return dataclasses.replace(body, inertial=inertial, geoms=geoms)


def _inertial(inertial: MjcfInertial) -> MjcfInertial:
    if not taken_for_one(Pose(inertial.position, inertial.orientation), Pose()):
        return inertial
    x, y, z = inertial.moments
    turn = frames.multiply(inertial.orientation, CYCLE)
    return dataclasses.replace(inertial, orientation=turn, moments=(y, z, x))


def _geom(geom: MjcfGeom, others: Sequence[Pose]) -> MjcfGeom:
    orientations = [geom.orientation]
    orientations += [frames.multiply(geom.orientation, turn) for turn in TURNS.get(geom.type, ())]
    for orientation in orientations:
        if not any(taken_for_one(Pose(geom.position, orientation), other) for other in others):
            return dataclasses.replace(geom, orientation=orientation)
    return geom


def sites_apart(sites: Mapping[str, tuple[MjcfSite, ...]]) -> dict[str, tuple[MjcfSite, ...]]:
    """The sites of bodies, in pairs of which each constraint holds the frames together."""
    pair = {site.name: site.name.rpartition("/")[0] for held in sites.values() for site in held}
    turned = {
        pair[site.name]
        for held in sites.values()
        for site in held
        if taken_for_one(Pose(site.position, site.orientation), Pose())
    }
    return {
        body: tuple(
            dataclasses.replace(site, orientation=frames.multiply(site.orientation, CYCLE))
            if pair[site.name] in turned
            else site
            for site in held
        )
        for body, held in sites.items()
    }
