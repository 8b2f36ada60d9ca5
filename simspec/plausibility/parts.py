"""The rigid parts of a world with their shapes, and the geometry that the rules need: reaches, sizes, gaps, distances.

Everything follows from support functions (``world/shapes.py``). The distance of a point from a convex set is the greatest
n·p − h(n) over all unit vectors n: it is searched from spread directions and around the best, so that the result is never
above the true distance, and below it by up to 0.3 % of the size of the shapes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from simspec.world import frames, hull
from simspec.world.canonical import derived
from simspec.world.frames import vector3
from simspec.world.inertia import NO_INERTIA, rigid_members, summed_inertial
from simspec.world.kinematics import rigid_groups
from simspec.world.overlap import SPREAD, fibonacci, separation
from simspec.world.shapes import SHAPES, ShapeKind
from simspec.world.types import Body, Inertial, Pose, Shape, World

Floats = NDArray[np.float64]

AXES: Final = np.concatenate([np.eye(3), -np.eye(3)])
DIRECTIONS: Final = np.concatenate([AXES, SPREAD])
"""Unit vectors (n, 3) that come first in every search."""
FAR: Final = fibonacci(128)
"""Directions (n, 3), 11° between neighbours, along which the vertices of a mesh are chosen."""
ROUNDS: Final = 8
"""Rounds of search around the best direction, each in 0.6 of the reach of the last: from 14° down to 0.4°."""
LIGHT: Final = 0.01
"""Share of a rigid group's mass below which a member is a frame with a token mass."""
MOST_GAPS: Final = 64
"""Pairs of shapes whose distance is computed for one joint, those first whose bounding spheres are nearest."""


@dataclass(frozen=True, slots=True)
class Lump:
    """A convex shape at a place, with its figures computed once. A mesh of many vertices has only those that are furthest along
    spread directions: it is smaller than the shape by at most a 40th of its radius (a round one; a 100th on average)."""

    body: str
    shape: Shape
    centre: Floats
    axes: Floats
    """Rows: the shape's own x, y, z axes in the frame of the part."""
    points: Floats | None
    """Vertices (n, 3) in the shape's axes; None of a kind that has none."""
    inner: float
    """Radius (m) of the largest sphere about the centre inside it."""
    outer: float
    """Radius (m) of the smallest sphere about the centre that holds it, with the shape's margin."""
    volume: float
    """m³."""
    middle: Floats
    half: Floats
    """Centre and half edges (m) of its bounding box in its own axes."""

    @property
    def kind(self) -> ShapeKind:
        return SHAPES[self.shape.kind]

    def local(self, directions: Floats) -> Floats:
        """How far (m) (n,) it is felt from its centre along unit vectors (n, 3) in its own axes."""
        if self.points is None:
            reach: Floats = self.kind.support(self.shape.size, directions)
        else:
            reach = (directions @ self.points.T).max(axis=1)
        return reach + self.shape.margin

    def reach(self, directions: Floats) -> Floats:
        """The same along unit vectors in the frame of the part."""
        return self.local(directions @ self.axes.T)

    def boxed(self, directions: Floats) -> Floats:
        """How far (m) (n,) its bounding box reaches, in the same axes."""
        reach: Floats = directions @ self.middle + np.abs(directions) @ self.half
        return reach

    def at(self, place: Pose) -> Lump:
        """The same, with the body's frame at ``place``."""
        pose = frames.compose(place, self.shape.pose)
        centre, axes = np.array(pose.position), np.array(frames.matrix(pose.quaternion)).T
        return dataclasses.replace(self, centre=centre, axes=axes)


def lump_of(body: str, shape: Shape) -> Lump:
    """A shape in the frame of its body."""
    kind = SHAPES[shape.kind]
    points = None
    if kind.points:
        points = hull.mesh_vertices(shape.size)
        if len(points) > len(FAR):
            points = points[np.unique((FAR @ points.T).argmax(axis=1))]
            shape = dataclasses.replace(shape, size=hull.mesh_size(points))
    inner, outer = kind.inner_radius(shape.size), kind.outer_radius(shape.size) + shape.margin
    corners = kind.support(shape.size, AXES) if points is None else (AXES @ points.T).max(axis=1)
    high, low = corners[:3] + shape.margin, -corners[3:] - shape.margin
    middle, half = 0.5 * (high + low), 0.5 * (high - low)
    centre, axes = np.array(shape.pose.position), np.array(frames.matrix(shape.pose.quaternion)).T
    return Lump(body, shape, centre, axes, points, inner, outer, kind.volume(shape.size), middle, half)


@derived
def lumps_of(world: World) -> Mapping[str, tuple[Lump, ...]]:
    """The shapes of each body that have an end, in the body's frame, by the body's name."""
    made: dict[tuple[object, ...], Lump] = {}
    lumps: dict[str, tuple[Lump, ...]] = {}
    for body in world.bodies:
        local = []
        for shape in body.shapes:
            if SHAPES[shape.kind].static:
                continue
            key = (shape.kind, shape.size, shape.margin)
            known = made.get(key)
            if known is None:
                known = made[key] = lump_of(body.name, shape)
            shape = dataclasses.replace(shape, size=known.shape.size)
            local.append(dataclasses.replace(known, body=body.name, shape=shape).at(Pose()))
        lumps[body.name] = tuple(local)
    return MappingProxyType(lumps)


@dataclass(frozen=True)
class MotionPart:
    """A unit of motion, judged as a whole: a body, or a rigid group, by the name of the body that it is shown as.
    ``inertial`` and ``solids`` are in one frame."""

    name: str
    inertial: Inertial
    solids: tuple[Lump, ...]

    @cached_property
    def size(self) -> float:
        """The largest extent (m) of the shapes; 0 without shapes."""
        return extent(self.solids)

    def some(self, collision: bool) -> tuple[Lump, ...]:
        """The shapes that can touch, or those that are only seen."""
        return tuple(solid for solid in self.solids if solid.shape.collision is collision)


def part_of(name: str, members: Sequence[tuple[Body, Pose]], lumps: Mapping[str, Sequence[Lump]]) -> MotionPart:
    """Bodies at poses in one frame as one part."""
    heavy = [(body.inertial, place) for body, place in members if body.inertial.mass > 0.0]
    if len(heavy) == len(members) == 1:
        inertial = heavy[0][0]
    else:
        inertial = summed_inertial(heavy) if heavy else NO_INERTIA
    return MotionPart(name, inertial, tuple(lump.at(place) for body, place in members for lump in lumps[body.name]))


def pose_of(solid: Lump) -> Pose:
    """The pose of a shape in the frame of its part."""
    x, y, z = solid.axes.T.tolist()
    return Pose(vector3(solid.centre.tolist()), frames.from_matrix((tuple(x), tuple(y), tuple(z))))


def moving_groups(world: World) -> dict[str, MotionPart]:
    """The rigid groups that forces move, by the name of their topmost body, each in that body's frame."""
    kinematic = {motion.body for motion in world.motions}
    return {
        top: part_of(top, members, lumps_of(world))
        for top, members in rigid_members(world.bodies).items()
        if top not in kinematic
    }


def judged_parts(world: World) -> list[MotionPart]:
    """The parts whose mass can be compared with their shapes: each body with both, of a moving rigid group, that has more
    than a token share of the group's mass; and the group as a whole where another such body has no shapes."""
    kinematic = {motion.body for motion in world.motions}
    lumps = lumps_of(world)
    parts: list[MotionPart] = []
    for top, members in rigid_members(world.bodies).items():
        if top in kinematic:
            continue
        total = math.fsum(body.inertial.mass for body, _ in members)
        heavy = [body for body, _ in members if body.inertial.mass > LIGHT * total]
        parts += [part_of(body.name, [(body, Pose())], lumps) for body in heavy if lumps[body.name]]
        if any(not lumps[body.name] for body in heavy):
            whole = part_of(top, members, lumps)
            parts += [whole] if whole.solids else []
    return parts


def carrying(world: World) -> dict[str, str]:
    """For each moving rigid group below a joint the group that carries it; bodies without mass and shapes between several
    joints are passed over. ``world`` stands for what cannot move."""
    groups = rigid_groups(world)
    by_name = {body.name: body for body in world.bodies}
    empty = {
        top
        for top, members in rigid_members(world.bodies).items()
        if not any(body.inertial.mass or body.shapes for body, _ in members)
    }
    above: dict[str, str] = {}
    for top in dict.fromkeys(groups.values()):
        body = by_name.get(top)
        if body is None or body.joint.parent is None or body.joint.kind == "free":
            continue
        carrier = groups[body.joint.parent]
        while carrier in empty and (parent := by_name[carrier].joint.parent) is not None:
            carrier = groups[parent]
        above[top] = carrier
    return above


# --- geometry ---------------------------------------------------------------------------------------------------------


def reach(solids: Sequence[Lump], directions: Floats) -> Floats:
    """How far (m) (n,) the shapes reach along unit vectors (n, 3), from the origin of their frame."""
    reaches = [solid.reach(directions) + directions @ solid.centre for solid in solids]
    best: Floats = np.max(reaches, axis=0)
    return best


def extent(solids: Sequence[Lump]) -> float:
    """The largest extent (m) along any direction; 0 of no shapes."""
    if not solids:
        return 0.0
    return float((reach(solids, DIRECTIONS) + reach(solids, -DIRECTIONS)).max())


def box(solids: Sequence[Lump]) -> tuple[Floats, Floats]:
    """The lowest and the highest corner (m) of the bounding box along the frame's axes."""
    return -reach(solids, -np.eye(3)), reach(solids, np.eye(3))


def outside(solids: Sequence[Lump], point: Floats) -> float:
    """How far (m) a point is outside the convex hull of the shapes; negative: inside, by at most so much."""

    def beyond(directions: Floats) -> tuple[float, Floats]:
        distance = directions @ point - reach(solids, directions)
        best = int(distance.argmax())
        return float(distance[best]), directions[best]

    away, best = beyond(DIRECTIONS)
    spread = 0.25
    for _ in range(ROUNDS):
        around = best + spread * SPREAD
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        away, best = max((away, best), beyond(around), key=lambda item: item[0])
        spread *= 0.6
    return away


def axis_distance(solids: Sequence[Lump], point: Floats, axis: Floats) -> float:
    """How far (m) a line through ``point`` along a unit vector passes the nearest of the shapes; 0: it meets one."""
    helper = np.eye(3)[int(np.abs(axis).argmin())]
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    turns = np.linspace(0.0, 2.0 * math.pi, 180, endpoint=False)
    across = np.outer(np.cos(turns), first) + np.outer(np.sin(turns), second)
    nearest = math.inf
    for solid in solids:
        away = float((across @ (point - solid.centre) - solid.reach(across)).max())
        nearest = min(nearest, max(away, 0.0))
    return nearest


def gap(some: Sequence[Lump], others: Sequence[Lump]) -> float:
    """The least distance (m) between shapes of two parts; 0: two meet."""
    pairs = sorted(
        (float(np.linalg.norm(lump.centre - other.centre)) - lump.outer - other.outer, i, j)
        for i, lump in enumerate(some)
        for j, other in enumerate(others)
    )
    nearest = math.inf
    for least, i, j in pairs[:MOST_GAPS]:
        if least >= nearest:
            break
        nearest = min(nearest, separation(some[i], others[j]))
        if nearest <= 0.0:
            return 0.0
    return nearest
