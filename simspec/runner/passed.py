"""Bodies that are, in a run's records, on the other side of something that cannot move, or inside of it, or below all of it.

Looked at are the centres of collision shapes. A centre that is below the surface of a plane, or inside a box, overlaps it by
more than the shape's inner radius. A line between two records that crosses a box shows a passage only where the body is too
slow for a way around: twice the distance of the crossing from the nearest edge is longer than its speed allows in that time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simspec.mapped import parts
from simspec.runner import metrics
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.kinematics import poses, rigid_groups
from simspec.world.rotations import matrices
from simspec.world.shapes import SHAPES
from simspec.world.types import Shape

if TYPE_CHECKING:
    from simspec.runner.run import Run

Floats = NDArray[np.float64]
FASTER = 1.5
"""Times the larger of the recorded speeds at both ends that a body may have had between them."""
MOST_PAIRS = 20_000
"""Pairs of a moving shape and one that cannot move that are looked at, in the order of the bodies."""


@dataclass(frozen=True, slots=True)
class Passed:
    """A body, what it passed, and when (s)."""

    body: str
    obstacle: str
    time: float


@dataclass(frozen=True)
class _Static:
    body: str
    shape: Shape
    centre: Floats
    axes: Floats


def _statics(run: Run) -> list[_Static]:
    world = run.world
    groups, places = rigid_groups(world), poses(world)
    found = []
    for body in world.bodies:
        if groups[body.name] != "world":
            continue
        for shape in body.shapes:
            if shape.collision:
                at = frames.compose(places[body.name], shape.pose)
                found.append(_Static(body.name, shape, np.array(at.position), np.array(frames.matrix(at.quaternion))))
    return found


def _movers(run: Run) -> Iterator[tuple[int, Shape]]:
    """The collision shapes of bodies that move by themselves, each with the row of its body."""
    groups = rigid_groups(run.world)
    prescribed = {motion.body for motion in run.world.motions}
    for row, body in enumerate(run.world.bodies):
        if groups[body.name] == "world" or groups[body.name] in prescribed:
            continue
        for shape in body.shapes:
            if shape.collision:
                yield row, shape


def passed(run: Run) -> list[Passed]:
    """The first passage of each body through something that cannot move and that it may touch, in the order of the bodies."""
    world, statics = run.world, _statics(run)
    allowed = CollisionFilter(world)
    looked: list[tuple[int, Shape, _Static]] = []
    for row, shape in _movers(run):
        name = world.bodies[row].name
        for other in statics:
            if allowed.may_touch(name, other.body) and allowed.may_materials_touch(
                shape.material, other.shape.material
            ):
                looked.append((row, shape, other))
    looked = looked[:MOST_PAIRS]
    found: dict[int, Passed] = {}
    inside: set[int] = set()
    for part in _blocks(run):
        arrays = {name: np.asarray(run.arrays[name][part]) for name in ("pose", "velocity")}
        for index, (row, shape, other) in enumerate(looked):
            if row in found or index in inside:
                continue
            centres = _centres(arrays["pose"][:, row], shape)
            speeds = _speeds(arrays["velocity"][:, row], arrays["pose"][:, row], centres)
            at = _through(centres, speeds, np.asarray(run.time[part]), other)
            if at is None:
                continue
            if not at and not part.start:
                inside.add(index)  # it begins there
            else:
                found[row] = Passed(world.bodies[row].name, other.body, float(run.time[part.start + at]))
    return [found[row] for row in sorted(found)]


def _blocks(run: Run) -> Iterator[slice]:
    """Blocks of rows, each with the last row of the one before."""
    pose = run.arrays["pose"]
    for part in parts(len(run.time), metrics.TEMPORARY * pose[:1].nbytes, pose):
        yield slice(max(0, part.start - 1), part.stop)


def _centres(pose: Floats, shape: Shape) -> Floats:
    if not any(shape.pose.position):
        return pose[:, :3]
    with np.errstate(all="ignore"):
        centres: Floats = pose[:, :3] + matrices(pose[:, 3:7]) @ np.array(shape.pose.position)
    return centres


def _speeds(velocity: Floats, pose: Floats, centres: Floats) -> Floats:
    lever = np.linalg.norm(centres - pose[:, :3], axis=1)
    speeds: Floats = np.linalg.norm(velocity[:, :3], axis=1) + np.linalg.norm(velocity[:, 3:6], axis=1) * lever
    return speeds


def _through(centres: Floats, speeds: Floats, time: Floats, other: _Static) -> int | None:
    """The first row in which a centre is beyond or inside an obstacle, or has crossed it since the row before; None where it
    never is."""
    local = (centres - other.centre) @ other.axes
    kind = other.shape.kind
    if kind == "plane":
        return _first(local[:, 2] < 0.0)
    if kind == "heightfield":
        return None  # its surface is not convex; a body below all of it has left the world
    inside: NDArray[np.bool_]
    if kind == "box":
        half = np.array(other.shape.size) / 2.0
        inside = np.all(np.abs(local) < half, axis=1)
        crossing = _crosses_box(local, half, speeds, time)
    else:
        inner = SHAPES[kind].inner_radius(other.shape.size)
        away = np.linalg.norm(local, axis=1)
        inside = away < inner
        crossing = _crosses_ball(local, inner, speeds, time)
    inside[1:] |= crossing
    return _first(inside)


def _first(rows: NDArray[np.bool_]) -> int | None:
    return int(np.argmax(rows)) if rows.any() else None


def _room(speeds: Floats, time: Floats) -> Floats:
    """How far (rows − 1,) a body may have gone between two records."""
    room: Floats = FASTER * np.maximum(speeds[:-1], speeds[1:]) * np.diff(time)
    return room


def _crosses_box(local: Floats, half: Floats, speeds: Floats, time: Floats) -> NDArray[np.bool_]:
    """Whether the line between two records leads through a box from one face to the opposite one, and no way around is short
    enough."""
    begin, end = local[:-1], local[1:]
    crossed = np.zeros(len(begin), dtype=bool)
    room = _room(speeds, time)
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        a, b = begin[:, axis], end[:, axis]
        beyond = (np.minimum(a, b) <= -half[axis]) & (np.maximum(a, b) >= half[axis])
        if not beyond.any():
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            enter, leave = (-half[axis] - a) / (b - a), (half[axis] - a) / (b - a)
        edge = np.full(len(begin), np.inf)
        for share in (enter, leave):
            place = begin + np.where(beyond, share, 0.0)[:, None] * (end - begin)
            edge = np.minimum(edge, (half[others] - np.abs(place[:, others])).min(axis=1))
        crossed |= beyond & (2.0 * edge > room)
    return crossed


def _crosses_ball(local: Floats, radius: float, speeds: Floats, time: Floats) -> NDArray[np.bool_]:
    """The same of the largest ball inside a shape."""
    begin, step = local[:-1], np.diff(local, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = -(begin * step).sum(axis=1) / (step * step).sum(axis=1)
    between = (share > 0.0) & (share < 1.0)
    nearest = begin + np.where(between, share, 0.0)[:, None] * step
    crossed: NDArray[np.bool_] = between & (2.0 * (radius - np.linalg.norm(nearest, axis=1)) > _room(speeds, time))
    return crossed


def fallen(run: Run) -> list[Passed]:
    """Free bodies that began above the lowest point of all that cannot move and that they may touch, and end below it, by more
    than they reach. Where some of that has no end, as a plane, nothing is below it."""
    world = run.world
    gravity = np.array(world.physics.gravity)
    pull = float(np.linalg.norm(gravity))
    statics = _statics(run)
    if not pull or not statics:
        return []
    up = -gravity / pull
    allowed, groups = CollisionFilter(world), rigid_groups(world)
    lowest = {id(static): _lowest(static, up) for static in statics}
    found = []
    for row, body in enumerate(world.bodies):
        reach = [math.hypot(*s.pose.position) + SHAPES[s.kind].outer_radius(s.size) for s in body.shapes if s.collision]
        if body.joint.kind != "free" or groups[body.name] != body.name or not reach:
            continue
        ends = [lowest[id(static)] for static in statics if allowed.may_touch(body.name, static.body)]
        if not ends or any(math.isinf(end) for end in ends):
            continue
        pose, last = run.arrays["pose"], 0
        if pose[0, row, :3] @ up <= min(ends) or not pose[-1, row, :3] @ up < min(ends) - max(reach):
            continue
        for part in _blocks(run):
            above = np.flatnonzero(~(np.asarray(pose[part, row, :3]) @ up < min(ends) - max(reach)))
            last = part.start + int(above[-1]) if len(above) else last
        found.append(Passed(body.name, "", float(run.time[last + 1])))
    return found


def _lowest(entry: _Static, up: Floats) -> float:
    """The lowest height (m) of a shape along ``up``; −∞ where it has no end."""
    kind = SHAPES[entry.shape.kind]
    if kind.endless:
        return -math.inf
    reach = float(kind.support(entry.shape.size, (-up @ entry.axes)[None])[0])
    return float(entry.centre @ up) - reach
