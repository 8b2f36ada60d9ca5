"""Which solid shapes overlap deeply at the start: geometry of the world alone, no engine and no collision library.

All solid shapes but planes and height fields are convex, and a height field is looked at as the convex solids below its
triangles. Two such shapes, with the distance d of their centres, overlap along a direction n by
h₁(n) + h₂(−n) − d·n, with h the support function (how far a shape reaches along n from its centre); the depth is the least of
that over all n. A direction along which it is small proves that they do not overlap deeply, which most pairs
show at once; for the others the least is sought from many directions, and then around the best.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.frames import sorted_pair
from simspec.world.kinematics import poses
from simspec.world.shapes import SHAPES, Round, ShapeKind, field_of
from simspec.world.types import Body, Pose, Shape, World

DEEP = 0.1
"""Share of the smaller shape's inner radius from which an overlap is deep: resting contact overlaps by far less."""
MOST_PAIRS = 20_000
"""Pairs whose bounding spheres overlap that are looked at, those first whose centres are nearest relative to their inner
radii."""
MOST_OVERLAPS = 500
"""Maximum number of deep overlaps that are searched for: a world with so many has them everywhere."""
MOST_AT_ONCE = 500
"""Shapes of which every pair is formed; more are sought with a tree of their places."""
MOST_NEIGHBOURS = 1_000_000
"""Neighbours within reach that the tree returns: 16 MB."""
OUTSIZE = 4.0
"""Times the median bounding radius from which a shape is held against all others, for the tree's reach to stay short."""
DIRECTIONS = 96
"""Directions spread over the sphere, at angles of 13°, from which the least overlap is sought."""
PARALLEL = 1e-9
"""Of the cosine of the angle between two planes that face each other."""
ROUNDS = 12
"""Rounds of search around the best direction, each in 0.6 of the reach of the last: down to 0.05°."""


@dataclass(frozen=True, slots=True)
class Overlap:
    """Two shapes of two bodies that overlap by ``depth`` (m) at the start."""

    first_body: str
    first: str
    second_body: str
    second: str
    depth: float


@dataclass(frozen=True, slots=True)
class Solid:
    body: str
    shape: Shape
    centre: np.ndarray
    axes: np.ndarray
    """Rows: the shape's own x, y, z axes in the world."""

    @property
    def kind(self) -> ShapeKind:
        return SHAPES[self.shape.kind]

    @property
    def inner(self) -> float:
        return self.kind.inner_radius(self.shape.size)

    @property
    def outer(self) -> float:
        return self.kind.outer_radius(self.shape.size) + self.shape.margin

    def reach(self, directions: np.ndarray) -> np.ndarray:
        """How far (m) (n,) it is felt from its centre along unit vectors (n, 3) of the world."""
        reach: np.ndarray = self.kind.support(self.shape.size, directions @ self.axes.T) + self.shape.margin
        return reach


def solid_at(body: Body, shape: Shape, place: Pose) -> Solid:
    """A shape of a body whose frame is at ``place`` in the world."""
    at = frames.compose(place, shape.pose)
    return Solid(body.name, shape, np.array(at.position), np.array(frames.matrix(at.quaternion)).T)


def deep_overlaps(world: World) -> list[Overlap]:
    """Pairs of solid shapes that may touch and overlap deeply (``DEEP``) at the initial positions, the deepest first."""
    places = poses(world)
    solids = [
        solid_at(body, shape, places[body.name]) for body in world.bodies for shape in body.shapes if shape.collision
    ]
    may_touch, beyond = _filter(world), _beyond(world)
    overlaps: list[Overlap] = []
    widest = max((pair.margin for pair in world.contact.pairs if pair.margin is not None), default=0.0)
    for solid, other in _near(solids, widest):
        if not may_touch(solid, other):
            continue
        depth = _deepest(solid, other, beyond(solid, other))
        if len(overlaps) == MOST_OVERLAPS:
            break
        if depth > 0.0:
            overlaps.append(Overlap(solid.body, solid.shape.name, other.body, other.shape.name, depth))
    return sorted(overlaps, key=lambda overlap: -overlap.depth)


def _beyond(world: World) -> Callable[[Solid, Solid], float]:
    """How much larger (m) the contact distance of two shapes is than the sum of their margins."""
    stated = {(pair.first, pair.second): pair.margin for pair in world.contact.pairs if pair.margin is not None}

    def beyond(solid: Solid, other: Solid) -> float:
        margin = stated.get(sorted_pair(solid.shape.material, other.shape.material)) if stated else None
        return 0.0 if margin is None else margin - solid.shape.margin - other.shape.margin

    return beyond


def _filter(world: World) -> Callable[[Solid, Solid], bool]:
    rules = CollisionFilter(world)
    bodies: dict[tuple[str, str], bool] = {}

    def may_touch(solid: Solid, other: Solid) -> bool:
        pair = (solid.body, other.body)
        if pair not in bodies:
            bodies[pair] = rules.may_touch(*pair)
        return bodies[pair] and rules.may_materials_touch(solid.shape.material, other.shape.material)

    return may_touch


def _near(solids: list[Solid], widest: float) -> Iterator[tuple[Solid, Solid]]:
    """Pairs of which one is a plane, or whose bounding spheres overlap; at most ``MOST_PAIRS``. ``widest``: the largest margin
    (m) of two materials."""
    left = MOST_PAIRS
    planes = [solid for solid in solids if solid.kind.endless]
    others = [solid for solid in solids if not solid.kind.endless]
    if not others:
        return
    centre = np.array([solid.centre for solid in others])
    radius = np.array([solid.outer for solid in others]) + widest
    for plane in planes:
        below = np.flatnonzero((centre - plane.centre) @ plane.axes[2] < radius + plane.shape.margin)
        for index in below[:left]:
            yield plane, others[index]
        left -= len(below[:left])
    pairs = bounding_spheres_meet(centre, radius)
    inner = np.array([solid.inner for solid in others])
    distances = np.linalg.norm(centre[pairs[:, 0]] - centre[pairs[:, 1]], axis=1)
    nearest = np.argsort(distances / (inner[pairs[:, 0]] + inner[pairs[:, 1]]), kind="stable")
    for first, second in pairs[nearest[:left]]:
        yield others[first], others[second]


def bounding_spheres_meet(centre: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Index pairs (n, 2), first < second, of spheres that overlap."""
    count = len(centre)
    if count <= MOST_AT_ONCE:
        pairs = np.argwhere(np.triu(np.ones((count, count), dtype=bool), 1))
    else:
        from scipy.spatial import cKDTree

        large = radius > OUTSIZE * np.median(radius)
        many = np.flatnonzero(~large)
        reach = 2.0 * float(radius[many].max())
        tree = cKDTree(centre[many])
        while tree.count_neighbors(tree, reach) > MOST_NEIGHBOURS:  # a heap of bodies in one place: the first of them
            many = many[: len(many) // 2]
            tree = cKDTree(centre[many])
        parts = [many[tree.query_pairs(reach, output_type="ndarray")].reshape(-1, 2)]
        for row in np.flatnonzero(large)[:MOST_AT_ONCE]:
            neighbours = np.flatnonzero(np.linalg.norm(centre - centre[row], axis=1) < radius + radius[row])
            neighbours = neighbours[~large[neighbours] | (neighbours > row)]  # two large ones once
            parts.append(np.sort(np.stack([np.full(len(neighbours), row), neighbours], axis=1), axis=1))
        pairs = np.concatenate(parts)
    first, second = pairs.T
    distances = np.linalg.norm(centre[first] - centre[second], axis=1)
    close: np.ndarray = pairs[distances < radius[first] + radius[second]]
    return close


def fibonacci(count: int) -> np.ndarray:
    """Unit vectors (count, 3) spread evenly over the sphere: a Fibonacci spiral."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    turn = math.pi * (1.0 + math.sqrt(5.0)) * index
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


SPREAD = fibonacci(DIRECTIONS)


MOST_PRISMS = 64
"""Triangles of a height field below which a shape is looked at, those nearest its centre first."""


def _deepest(solid: Solid, other: Solid, beyond: float) -> float:
    """As :func:`_depth`, of any two shapes: of a height field the most that one of its prisms is overlapped by."""
    if solid.kind.grid and other.kind.grid:
        return 0.0
    if not (solid.kind.grid or other.kind.grid):
        return _depth(solid, other, beyond, DEEP * min(solid.inner, other.inner))
    ground, other = (solid, other) if solid.kind.grid else (other, solid)
    field = field_of(ground.shape.size)
    centre = ground.axes @ (other.centre - ground.centre)
    corners = field.points[field.triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    low[:, 2] = -field.base
    distances = np.linalg.norm(np.maximum(np.maximum(low - centre, centre - high), 0.0), axis=1)
    near = np.argsort(distances, kind="stable")[:MOST_PRISMS]
    limit, deepest = DEEP * min(ground.inner, other.inner), 0.0
    for triangle in near[distances[near] < other.outer + beyond + ground.shape.margin].tolist():
        prism = field.prism(triangle)
        middle = prism.mean(axis=0)  # a direction from a point within it is more informative
        size = tuple((prism - middle).ravel().tolist())
        at = ground.centre + middle @ ground.axes
        part = Solid(ground.body, dataclasses.replace(ground.shape, kind="mesh", size=size), at, ground.axes)
        deepest = max(deepest, _depth(part, other, beyond, limit))
    return deepest


def _depth(solid: Solid, other: Solid, beyond: float, limit: float) -> float:
    """The depth (m) of an overlap that is deeper than ``limit``; 0 when there is none. ``beyond``: see :func:`_beyond`."""
    separate = other.centre - solid.centre
    if solid.kind.endless:
        depth = float(other.reach(-solid.axes[2][None])[0] + solid.shape.margin + beyond - separate @ solid.axes[2])
        return depth if depth > limit else 0.0
    if solid.kind.round is other.kind.round is Round.EVERY:
        depth = solid.outer + other.outer + beyond - float(np.linalg.norm(separate))
        return depth if depth > limit else 0.0

    least = _overlap_along(solid, other, beyond)
    depth, best = least(_likely(solid, other))
    if depth <= limit:
        return 0.0
    depth = _searched(least, solid, other, depth, best)
    return depth if depth > limit else 0.0


class Convex(Protocol):
    """A convex shape or a plane at a place."""

    @property
    def kind(self) -> ShapeKind: ...

    @property
    def centre(self) -> np.ndarray: ...

    @property
    def axes(self) -> np.ndarray: ...

    def reach(self, directions: np.ndarray) -> np.ndarray: ...


def separation(solid: Convex, other: Convex) -> float:
    """How far (m) two convex shapes or planes are from each other; negative where they overlap."""
    if solid.kind.endless and other.kind.endless:
        facing = float(solid.axes[2] @ other.axes[2]) < PARALLEL - 1.0
        return float((other.centre - solid.centre) @ solid.axes[2]) if facing else -math.inf
    if other.kind.endless:
        solid, other = other, solid
    if solid.kind.endless:
        return -float(other.reach(-solid.axes[2][None])[0] - (other.centre - solid.centre) @ solid.axes[2])
    least = _overlap_along(solid, other, 0.0)
    return -_searched(least, solid, other, *least(_likely(solid, other)))


Least = Callable[[np.ndarray], tuple[float, np.ndarray]]
"""The least overlap (m) along some unit vectors (n, 3) of the world, and the vector it is along."""


def _overlap_along(solid: Convex, other: Convex, beyond: float) -> Least:
    separate = other.centre - solid.centre

    def least(directions: np.ndarray) -> tuple[float, np.ndarray]:
        overlap = solid.reach(directions) + other.reach(-directions) + beyond - directions @ separate
        best = int(overlap.argmin())
        return float(overlap[best]), directions[best]

    return least


def _likely(solid: Convex, other: Convex) -> np.ndarray:
    """Directions (n, 3) along most of which shapes overlap least: their axes, and the line through their centres."""
    values = np.concatenate([solid.axes, other.axes, -solid.axes, -other.axes])
    separate = other.centre - solid.centre
    away = float(np.linalg.norm(separate))
    return np.concatenate([values, (separate / away)[None]]) if away > 0.0 else values


def _searched(least: Least, solid: Convex, other: Convex, depth: float, best: np.ndarray) -> float:
    """The least overlap (m), from ``depth`` along ``best`` on."""
    edges = np.cross(solid.axes[:, None], other.axes[None]).reshape(-1, 3)
    size = np.linalg.norm(edges, axis=1)
    edges = edges[size > 1e-6] / size[size > 1e-6, None]
    depth, best = min((depth, best), least(np.concatenate([edges, -edges, SPREAD])), key=lambda item: item[0])
    reach = 0.25  # 14°, the distance of the directions
    for _ in range(ROUNDS):
        around = best + reach * SPREAD
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        depth, best = min((depth, best), least(around), key=lambda item: item[0])
        reach *= 0.6
    return depth
