"""Where the solid shapes of a world are, which trees carry them, and where free trees can be put."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.proof.touch.geometry import CollisionSolid, gap, solids, transforms, wanted_depth
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.hull import hull_of
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import initial_state, rigid_groups, trees
from simspec.world.rotations import matrices
from simspec.world.shapes import field_of
from simspec.world.types import World

FAR = 500.0
"""Metres from the scenario at which free trees meet, so that they meet nothing else."""

Pair = tuple[int, int]
"""Numbers of two solid shapes, the smaller first."""


@dataclass
class TouchStates:
    """States (nq,), and what overlaps in them: state, two shapes' numbers, and whether no others of their bodies and materials
    do."""

    q: list[np.ndarray] = field(default_factory=list)
    tried: list[tuple[int, int, int, bool]] = field(default_factory=list)

    def add(self, q: np.ndarray) -> int:
        """A further state; returns its number."""
        self.q.append(q)
        return len(self.q) - 1


class Scene:
    """A world's solid shapes in its initial state.

    solids     every solid shape
    tree       of every shape the number of its tree; ``roots`` are the trees' root bodies, ``free`` whether these are free
    group      of every shape the name of its body's rigid group
    parts      the shapes of one body and material
    at         poses (solids, 4, 4) in the world
    in_root    the same in the frame of the tree's root where that is free; ``from_shape`` are the inverse poses
    extent     of every free tree the radius of its shapes about its root's frame (m); ``spacing`` separates any two of them
    parking    where the root's frame of every free tree is out of the way
    parked     the state with every free tree on a place of its own, far from everything
    """

    def __init__(self, world: World, oracle: Oracle):
        self.world, self.oracle = world, oracle
        self.solids = solids(world)
        self.allowed = CollisionFilter(world)
        rooted = trees(world)
        index = {body.name: number for number, body in enumerate(world.bodies)}
        tree_of = {body.name: number for number, bodies in enumerate(rooted.values()) for body in bodies}
        groups = rigid_groups(world)
        self.names = [world.bodies[solid.body].name for solid in self.solids]
        self.roots = list(rooted)
        self._root_index = [index[root] for root in self.roots]
        self.free = [world.bodies[number].joint.kind == "free" for number in self._root_index]
        self.tree = [tree_of[name] for name in self.names]
        self.group = [groups[name] for name in self.names]
        self.parts: dict[tuple[int, str], list[CollisionSolid]] = {}
        for solid in self.solids:
            self.parts.setdefault(solid.part, []).append(solid)
        self.q, _ = initial_state(world)
        self.poses = transforms(oracle.body_poses(self.q))
        self.at = self.solid_poses(self.poses)
        self._excluded = set(world.contact.excluded_bodies)
        self._extents()
        self._park()

    def solid_poses(self, poses: np.ndarray) -> np.ndarray:
        """Poses (solids, 4, 4) of all shapes, from those (bodies, 4, 4) of all bodies."""
        if not self.solids:
            return np.zeros((0, 4, 4))
        placed: np.ndarray = poses[[solid.body for solid in self.solids]] @ np.array(
            [solid.pose for solid in self.solids]
        )
        return placed

    def _extents(self) -> None:
        """Radii of the free trees' shapes about their roots' frames, and in these frames where each shape is."""
        self.extent = [0.0] * len(self.roots)
        self.in_root = self.at.copy()
        for solid in self.solids:
            tree = self.tree[solid.number]
            if self.free[tree]:
                root = self.poses[self._root_index[tree]]
                self.in_root[solid.number] = np.linalg.inv(root) @ self.at[solid.number]
                reach = float(np.linalg.norm(self.in_root[solid.number][:3, 3]))
                reach += 0.0 if math.isinf(solid.outer) else solid.outer
                self.extent[tree] = max(self.extent[tree], reach)
        self.from_shape = np.linalg.inv(self.in_root)
        self.spacing = 2.2 * max((self.extent[tree] for tree, free in enumerate(self.free) if free), default=1.0)
        fixed = [
            float(np.linalg.norm(self.at[solid.number][:3, 3])) + solid.outer
            for solid in self.solids
            if not self.free[self.tree[solid.number]] and math.isfinite(solid.outer)
        ]
        self.far = FAR + 2.0 * max(fixed, default=0.0)

    def _park(self) -> None:
        """Put every free tree on a place of its own, far from everything."""
        along = 0.0
        self.parked, self.parking = self.q.copy(), {}
        for tree, free in enumerate(self.free):
            if free:
                along += self.extent[tree] + self.spacing / 2.0
                self.parking[tree] = frame_at(along, -self.far, self.far)
                self.put_root(self.parked, tree, self.parking[tree])
                along += self.extent[tree] + self.spacing / 2.0

    def put_root(self, q: np.ndarray, tree: int, frame: np.ndarray) -> None:
        """Put a free tree's root frame (4, 4) there; its coordinates are those of its centre of mass."""
        body = self.world.bodies[self._root_index[tree]]
        start = self.oracle.layout.position[self._root_index[tree]].start
        q[start : start + 3] = frame[:3, 3] + frame[:3, :3] @ np.array(lumped_inertial(self.world, body).centre_of_mass)
        q[start + 3 : start + 7] = frames.from_matrix(tuple(map(tuple, frame[:3, :3].tolist())))  # type: ignore[arg-type]

    def placeable(self, i: int, j: int) -> bool:
        """Whether one of two shapes is in a free tree that the other is not in."""
        first, other = self.tree[i], self.tree[j]
        return first != other and (self.free[first] or self.free[other])

    def may_touch(self, i: int, j: int) -> bool:
        """Whether the world's rules let two shapes touch."""
        materials = self.solids[i].shape.material, self.solids[j].shape.material
        return self.allowed.may_touch(self.names[i], self.names[j]) and self.allowed.may_materials_touch(*materials)

    def named(self, i: int, j: int) -> bool:
        """Whether the world names the two shapes' bodies as a pair that does not touch."""
        first, other = self.names[i], self.names[j]
        return (min(first, other), max(first, other)) in self._excluded


def frame_at(x: float, y: float, z: float) -> np.ndarray:
    """The pose (4, 4) of an unturned frame at a place."""
    frame = np.eye(4)
    frame[:3, 3] = x, y, z
    return frame


# Bringing a free tree to another tree's shape: where on the shape, and which pairs at once.

POSES = 3
"""Poses in which two shapes that may touch are tried when some detector misses overlaps of their kinds; one contact is enough.
In the last one the centre of the one is inside the other: a detector that takes a small sphere in place of a shape that it does
not know misses every shallower overlap (measured: of 0.01 m for an ellipsoid, of 0.1 m for a capsule)."""
EASY = frozenset({"sphere", "box", "plane"})
"""Kinds of shapes of which no detector of any engine missed an overlap (measured, see ``geometry.DIP``)."""
SEVERAL = 4
"""Shapes brought to one small shape at a time; they may overlap each other as well, which is judged by the same rules."""
GRID = 24
"""Places along one direction of a plane or of a large face."""
_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


def easy(solid: CollisionSolid, other: CollisionSolid) -> bool:
    """Whether one pose of the two is enough."""
    return solid.shape.kind in EASY and other.shape.kind in EASY


class Overlaps:
    """Poses in which one shape overlaps another, by geometry alone, each computed once.

    ``spacing``: the distance (m) between places on a large face, so that what is brought there does not meet.
    """

    def __init__(self, spacing: float):
        self._spacing = spacing
        self._known: dict[tuple[object, ...], np.ndarray | None] = {}
        self._grids: dict[tuple[object, ...], list[tuple[float, float]]] = {}

    def places(self, base: CollisionSolid) -> int:
        """How many shapes can be brought to ``base`` at once."""
        return max(SEVERAL, len(self._grid(base)))

    def relative(self, base: CollisionSolid, other: CollisionSolid, place: int, pose: int = 0) -> np.ndarray | None:
        """The pose (4, 4) of ``other`` in the frame of ``base``'s shape at one of its places; ``pose`` is one of ``POSES``.
        None when there is no clear overlap."""
        key = (base.shape.kind, base.shape.size, other.shape.kind, other.shape.size, place, pose)
        if key not in self._known:
            self._known[key] = self._find(base, other, place, pose)
        return self._known[key]

    def _find(self, base: CollisionSolid, other: CollisionSolid, place: int, pose: int) -> np.ndarray | None:
        point, normal = self._anchor(base, place, pose)
        wanted, enough = wanted_depth(base, other)
        placed, identity = np.eye(4), np.eye(4)
        placed[:3, :3] = matrices(_unit(np.random.default_rng(1000 + (7 * place + pose)).normal(size=4)))

        def depth(along: float) -> float:
            placed[:3, 3] = point + along * normal
            return -gap(base, identity, other, placed).distance

        if pose == POSES - 1:  # as deep again
            return placed if depth(-wanted) >= enough else None
        low, high = -min(base.inner, other.inner), other.outer
        for _ in range(40):
            middle = (low + high) / 2.0
            low, high = (middle, high) if depth(middle) >= wanted else (low, middle)
        return placed if depth(low) >= enough else None

    def _grid(self, base: CollisionSolid) -> list[tuple[float, float]]:
        """Places on a plane, or on the largest face of a box, in that face's own axes."""
        key = (base.shape.kind, base.shape.size)
        if key not in self._grids:
            self._grids[key] = self._new_grid(base)
        return self._grids[key]

    def _new_grid(self, base: CollisionSolid) -> list[tuple[float, float]]:
        if base.shape.kind == "plane":
            counts: tuple[int, ...] = (GRID, GRID)
        elif base.shape.kind == "box":
            counts = tuple(
                min(GRID, int(edge / self._spacing)) for axis, edge in enumerate(base.shape.size) if axis != _thin(base)
            )
        else:
            return []
        return [
            ((i - (counts[0] - 1) / 2) * self._spacing, (j - (counts[1] - 1) / 2) * self._spacing)
            for i in range(counts[0])
            for j in range(counts[1])
        ]

    def _anchor(self, base: CollisionSolid, place: int, pose: int) -> tuple[np.ndarray, np.ndarray]:
        """A point of the surface in the shape's frame, and its outward normal."""
        grid = self._grid(base)
        kind, size = base.shape.kind, base.shape.size
        if kind in ("plane", "box"):
            axis = 2 if kind == "plane" else _thin(base)
            across = [k for k in range(3) if k != axis]
            point, normal = np.zeros(3), np.zeros(3)
            half = 0.0 if kind == "plane" else size[axis] / 2.0
            side = -1.0 if kind == "box" and len(grid) <= 1 and place % 2 else 1.0
            if len(grid) > 1:
                point[across] = grid[place % len(grid)]
            elif kind == "box":  # within the face, off its middle
                shares = np.array([math.cos(_GOLDEN * place), math.sin(_GOLDEN * place)]) * 0.5 * min(place, 2) / 2.0
                point[across] = shares * [max(0.0, size[k] / 2.0 - base.inner) for k in across]
            point[axis], normal[axis] = side * half, side
            return point, normal
        return _SURFACE[kind](size, place, pose)


def _on_ball(size: Sequence[float], place: int, pose: int) -> tuple[np.ndarray, np.ndarray]:
    turn = _GOLDEN * (place + 3 * pose)
    height = 0.9 - 1.8 * ((place + 3 * pose) * 0.381966 % 1.0)
    flat = math.sqrt(1.0 - height * height)
    normal = np.array([flat * math.cos(turn), flat * math.sin(turn), height])
    return size[0] * normal, normal


def _on_side(size: Sequence[float], place: int, pose: int) -> tuple[np.ndarray, np.ndarray]:
    turn = _GOLDEN * (place + 3 * pose)
    normal = np.array([math.cos(turn), math.sin(turn), 0.0])
    return size[0] * normal, normal


def _on_cylinder(size: Sequence[float], place: int, pose: int) -> tuple[np.ndarray, np.ndarray]:
    if size[0] <= size[1] / 2.0:
        return _on_side(size, place, pose)
    return np.array([0.0, 0.0, size[1] / 2.0 * (-1) ** place]), np.array([0.0, 0.0, (-1.0) ** place])


def _on_ellipsoid(size: Sequence[float], place: int, pose: int) -> tuple[np.ndarray, np.ndarray]:
    thin = int(np.argmin(size))
    normal = np.zeros(3)
    normal[thin] = (-1.0) ** place
    return normal * size[thin], normal


def _on_hull(size: Sequence[float], place: int, pose: int) -> tuple[np.ndarray, np.ndarray]:
    """The middle of one of the largest faces."""
    faces = hull_of(size)
    corners = faces.vertices[faces.triangles]
    first, second, third = (corners[:, corner] for corner in range(3))
    area = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    chosen = np.argsort(-area, kind="stable")[(place + 3 * pose) % len(area)]
    return corners[chosen].mean(axis=0), faces.normals[chosen]


def _on_field(size: Sequence[float], place: int, pose: int) -> tuple[np.ndarray, np.ndarray]:
    """The middle of one triangle, spread over the field: of two places that follow each other one is in the upper triangle of
    its cell, one in the lower."""
    field = field_of(size)
    cells = len(field.triangles) // 2
    chosen = 2 * int(((place + 3 * pose + 1) * 0.381966 % 1.0) * cells) + (place + pose) % 2
    return field.points[field.triangles[chosen]].mean(axis=0), field.normals[chosen]


_SURFACE: Mapping[str, Callable[[Sequence[float], int, int], tuple[np.ndarray, np.ndarray]]] = {
    "sphere": _on_ball,
    "cylinder": _on_cylinder,
    "capsule": _on_side,
    "ellipsoid": _on_ellipsoid,
    "mesh": _on_hull,
    "heightfield": _on_field,
}
"""For each kind without a grid of places a point of the surface and its normal, by the place's number and the pose."""


def _thin(base: CollisionSolid) -> int:
    return int(np.argmin(base.shape.size))


def _unit(values: np.ndarray) -> np.ndarray:
    unit: np.ndarray = values / np.linalg.norm(values)
    return unit


# --- which pairs in which state -----------------------------------------------------------------------------------


@dataclass
class Rounds:
    """Pairs put into states, each into the first that has room: in one state a free tree goes to one shape of another, or stays
    and has others come to it. Sets of states are the bits of whole numbers.

    ``most``: states; ``crowd``: pairs in one state.
    """

    most: int
    crowd: int
    _moving: dict[int, int] = field(default_factory=dict)
    _staying: dict[int, int] = field(default_factory=dict)
    _full: dict[int, int] = field(default_factory=dict)
    _guests: dict[tuple[int, int], int] = field(default_factory=dict)
    _crowded: int = 0
    _sizes: dict[int, int] = field(default_factory=dict)

    def room(self, mover: int, host: int, solid: int) -> int | None:
        """The first state in which tree ``mover`` can come to the shape ``solid`` of tree ``host``."""
        taken = (
            self._crowded
            | self._moving.get(mover, 0)
            | self._staying.get(mover, 0)
            | self._moving.get(host, 0)
            | self._full.get(solid, 0)
        )
        free = ~taken & ((1 << self.most) - 1)
        return (free & -free).bit_length() - 1 if free else None

    def put(self, state: int, mover: int, host: int, solid: int, places: int) -> int:
        """Put it there; returns which of the shape's ``places`` it gets."""
        bit = 1 << state
        self._moving[mover] = self._moving.get(mover, 0) | bit
        self._staying[host] = self._staying.get(host, 0) | bit
        place = self._guests.get((state, solid), 0)
        self._guests[state, solid] = place + 1
        if place + 1 >= places:
            self._full[solid] = self._full.get(solid, 0) | bit
        self._sizes[state] = self._sizes.get(state, 0) + 1
        if self._sizes[state] >= self.crowd:
            self._crowded |= bit
        return place

    @property
    def states(self) -> Iterator[int]:
        """The states that are used."""
        return iter(sorted(self._sizes))
