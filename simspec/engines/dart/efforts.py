"""Efforts that DART does not have in this form, computed from its own state before every step.

Damping and springs are explicit in time: −d v, −k (q − rest), for a ball −k log R. DART's own are implicit.
Armature A is DART's implicit damping A / dt, with the effort (A / dt) v against it: (M + A) v̇ = τ − h exactly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from simspec.dialects.dart.sidecar import DartSidecar
from simspec.engines.dart.coordinates import Coordinates, Tree
from simspec.world import frames
from simspec.world.rotations import exponential_of


def shortest(vector: np.ndarray) -> np.ndarray:
    """The rotation vector of the same rotation with an angle of at most π."""
    angle = float(np.linalg.norm(vector))
    return vector * (1.0 - 2.0 * math.pi / angle) if angle > math.pi else vector


class Efforts:
    """The effort τ − loss v − stiffness (q − rest) on all of DART's coordinates; τ is what the caller gives."""

    def __init__(self, coordinates: Coordinates, joints: Mapping[str, Any], sidecar: DartSidecar, timestep: float):
        """``joints`` are DART's, by the name of the body. Gives DART the implicit part of the armature."""
        self._coordinates = coordinates
        self._first = {tree.skeleton.getName(): tree.dofs.start for tree in coordinates.trees}
        self.damping, self.armature, self.stiffness, self.rest = np.zeros((4, coordinates.count))

        for entry in sidecar.damping:
            self.damping[self.place(joints[entry.body])] = entry.value
        for entry in sidecar.armature:
            self.armature[self.place(joints[entry.body])] = entry.value
            joints[entry.body].setDampingCoefficient(0, entry.value / timestep)
        for spring in sidecar.springs:
            at = self.place(joints[spring.body])
            self.stiffness[at], self.rest[at] = spring.stiffness, spring.rest
        self._loss = self.damping - self.armature / timestep
        self._driven = {
            tree.skeleton.getName()
            for tree in coordinates.trees
            if self._loss[tree.dofs].any() or self.stiffness[tree.dofs].any()
        }
        self._always = [tree for tree in coordinates.trees if tree.skeleton.getName() in self._driven]
        self._given: dict[str, np.ndarray] = {}

    def place(self, joint: Any) -> slice:
        """Where a joint's coordinates stand among all."""
        start = self._first[joint.getSkeleton().getName()] + joint.getIndexInSkeleton(0)
        return slice(start, start + joint.getNumDofs())

    def give(self, effort: np.ndarray | None) -> list[Tree]:
        """Take τ = ``effort`` (nv,), None = zero, for the steps to come. Returns the trees that need an effort."""
        self._given = {}
        if effort is None:
            return self._always
        needed = []
        for tree in self._coordinates.trees:
            name = tree.skeleton.getName()
            if np.any(effort[tree.block]):
                self._given[name] = self._in_skeleton(tree, np.asarray(effort, dtype=float))
            if name in self._given or name in self._driven:
                needed.append(tree)
        return needed

    @property
    def driven(self) -> bool:
        """Whether there is something to apply before every step even without an effort from outside."""
        return bool(self._always)

    @staticmethod
    def _in_skeleton(tree: Tree, effort: np.ndarray) -> np.ndarray:
        """The effort in the skeleton's coordinates; torques on free joints still in the body's axes."""
        found = np.zeros(tree.dofs.stop - tree.dofs.start)
        for start, place in tree.straight:
            found[start] = effort[place]
        for one in tree.turners:
            given = effort[one.v]
            found[one.start : one.start + 3] = given[-3:]
            if one.kind == "free":
                found[one.start + 3 : one.start + 6] = given[:3]
        return found

    def apply(self, tree: Tree) -> None:
        """Set the forces of one tree for the next step, after which DART forgets them."""
        name, skeleton, dofs = tree.skeleton.getName(), tree.skeleton, tree.dofs
        given = self._given.get(name)
        if given is None:
            total = np.zeros(dofs.stop - dofs.start)
        else:
            total = given.copy()
            for one in tree.turners:
                if one.kind == "free":
                    turn = one.turn or exponential_of(one.joint.getPositions()[:3].tolist())
                    place = slice(one.start, one.start + 3)
                    total[place] = frames.rotate(turn, tuple(given[place].tolist()))
        if name in self._driven:
            total -= self._loss[dofs] * skeleton.getVelocities()
            total -= self.stiffness[dofs] * self._stretch(tree)
        skeleton.setForces(total)

    def _stretch(self, tree: Tree) -> np.ndarray:
        """q − rest of one tree, in DART's coordinates: of a ball joint log R."""
        found: np.ndarray = tree.skeleton.getPositions() - self.rest[tree.dofs]
        for one in tree.turners:
            if one.kind == "ball":
                found[one.start : one.start + 3] = shortest(found[one.start : one.start + 3])
        return found

    def energy(self) -> tuple[float, float]:
        """Kinetic energy of the armatures and potential energy of the springs (J)."""
        kinetic = potential = 0.0
        for tree in self._coordinates.trees:
            if self.armature[tree.dofs].any():
                kinetic += 0.5 * float(np.sum(self.armature[tree.dofs] * tree.skeleton.getVelocities() ** 2))
            if self.stiffness[tree.dofs].any():
                potential += 0.5 * float(np.sum(self.stiffness[tree.dofs] * self._stretch(tree) ** 2))
        return kinetic, potential
