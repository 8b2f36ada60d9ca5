"""Hinges and slides of a PyBullet simulation, read and driven at every step with as few calls as it allows."""

from __future__ import annotations

import numpy as np

from simspec.engines.base import Actuation, Engine
from simspec.engines.pybullet_simulation import Simulation


class JointArrays(Actuation):
    """One call for each tree to read, and one to drive. For simulations without springs and armature, which need more."""

    def __init__(self, engine: Engine, sim: Simulation, q: np.ndarray, v: np.ndarray):
        super().__init__(engine, q, v)
        self._sim = sim
        order = {int(place): index for index, place in enumerate(v)}
        self._trees = []
        for tree in sim.trees:
            links = [link for link in tree.movers if link.kind != "ball" and link.v.start in order]
            if links:
                rows = np.array([order[link.v.start] for link in links], dtype=int)
                whole = len(links) == len(order) and (np.diff(rows) == 1).all()
                self._trees.append((tree.uid, [link.link for link in links], None if whole else rows))
        self._positions, self._velocities = np.zeros(len(v)), np.zeros(len(v))

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        client, ask = self._sim.client, self._sim.bullet.getJointStates
        positions, velocities = self._positions, self._velocities
        for uid, links, rows in self._trees:
            states = ask(uid, links, client)
            at = slice(None) if rows is None else rows
            positions[at] = [state[0] for state in states]
            velocities[at] = [state[1] for state in states]
        return positions, velocities

    def step(self, effort: np.ndarray) -> None:
        sim, p = self._sim, self._sim.bullet
        for uid, links, rows in self._trees:
            forces = (effort if rows is None else effort[rows]).tolist()
            p.setJointMotorControlArray(uid, links, p.TORQUE_CONTROL, forces=forces, physicsClientId=sim.client)
        sim.advance(1)
