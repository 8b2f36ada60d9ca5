"""Where the solid shapes of a world are, which trees carry them, and where free trees can be put."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.proof.touch.geometry import Solid, solids, transforms
from simspec.world import frames
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.inertia import lumped_inertial
from simspec.world.kinematics import initial_state, rigid_groups, trees
from simspec.world.types import World

FAR = 500.0
"""Metres from the scenario at which free trees meet, so that they meet nothing else."""

Pair = tuple[int, int]
"""Numbers of two solid shapes, the smaller first."""


@dataclass
class States:
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
    extent     of every free tree the radius of its shapes about its root's frame (m); ``spacing`` keeps any two of them apart
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
        self.parts: dict[tuple[int, str], list[Solid]] = {}
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
