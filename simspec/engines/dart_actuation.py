"""Hinges and slides of a DART simulation, read and driven at every step with as few calls as it allows."""

from __future__ import annotations

import numpy as np

from simspec.engines.base import Actuation, Engine
from simspec.engines.dart_simulation import Simulation


class JointArrays(Actuation):
    """One call for each skeleton to read positions, velocities, and one to drive. For simulations without efforts of their own
    (damping, springs, armature) and without rotations to be corrected, which need more."""

    def __init__(self, engine: Engine, sim: Simulation, q: np.ndarray, v: np.ndarray):
        super().__init__(engine, q, v)
        self._sim = sim
        order = {int(place): index for index, place in enumerate(v)}
        self._trees = []
        for tree in sim.coordinates.trees:
            places = [(start, order[place]) for start, place in tree.straight if place in order]
            if places:
                dofs, rows = (np.array(part, dtype=int) for part in zip(*places, strict=True))
                self._trees.append((tree.skeleton, dofs, rows, np.zeros(tree.dofs.stop - tree.dofs.start)))
        self._positions, self._velocities = np.zeros(len(v)), np.zeros(len(v))

    @staticmethod
    def suits(sim: Simulation) -> bool:
        """Whether a simulation has none of what asks for more."""
        return not sim.efforts.driven and not (sim.exact_rotation and sim.coordinates.turners)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        positions, velocities = self._positions, self._velocities
        for skeleton, dofs, rows, _ in self._trees:
            positions[rows] = skeleton.getPositions()[dofs]
            velocities[rows] = skeleton.getVelocities()[dofs]
        return positions, velocities

    def step(self, effort: np.ndarray) -> None:
        for skeleton, dofs, rows, total in self._trees:
            total[dofs] = effort[rows]
            skeleton.setForces(total)
        self._sim.plain_step()
