"""The mass matrix and bias force that PyBullet steps with, measured by stepping it.

``calculateMassMatrix`` is right for hinges and slides on a massless fixed base only (measured: ball joints differ in the
second digit), ``calculateInverseDynamics`` takes gravity to be given in the base's axes, and neither is what a step
uses. So a second
simulation of the same files is stepped once per coordinate instead: from rest, without gravity, damping, motors, limits and
contact, a unit effort for one step of 1 s leaves the velocity M⁻¹ e exactly.
"""

from __future__ import annotations

import numpy as np

from simspec.engines.pybullet.efforts import Efforts
from simspec.engines.pybullet.simulation import Simulation
from simspec.engines.pybullet.trees import UNCLAMPED
from simspec.world import frames

PROBE_STEP = 1.0
"""Seconds: the velocity gained in one step is then the acceleration, with no digits lost."""


class Probe:
    """A simulation in which nothing but the tree dynamics acts."""

    def __init__(self, sim: Simulation):
        self._sim = sim
        self._efforts = Efforts(sim, (), ())
        self._known: tuple[np.ndarray, list[np.ndarray]] | None = None
        p, client = sim.bullet, sim.client
        sim.disable_contact()
        p.setTimeStep(PROBE_STEP, physicsClientId=client)
        for tree in sim.trees:
            for link in tree.movers:
                p.changeDynamics(tree.uid, link.link, jointDamping=0.0, physicsClientId=client)
                if link.kind != "ball":
                    p.changeDynamics(
                        tree.uid,
                        link.link,
                        jointLowerLimit=-UNCLAMPED,
                        jointUpperLimit=UNCLAMPED,
                        physicsClientId=client,
                    )
                    p.setJointMotorControl2(
                        tree.uid, link.link, p.VELOCITY_CONTROL, targetVelocity=0.0, force=0.0, physicsClientId=client
                    )
        self._blocks = [
            np.concatenate([np.arange(link.v.start, link.v.stop) for link in tree.links]).astype(int)
            for tree in sim.trees
        ]

    def _gain(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray | None) -> np.ndarray:
        """v̇ (nv,) at the state (q, v) under ``effort``."""
        sim = self._sim
        sim.set_state(q, v)
        if effort is not None:
            self._efforts.apply(effort)
        sim.advance(1)
        after_q, after_v = sim.get_state()
        for link in (tree.links[0] for tree in sim.trees if tree.root == "free"):
            # ω is given in the axes after the step; the gain is wanted in those before it: d(Rᵀω)/dt = Rᵀ dω/dt
            world = frames.rotate(tuple(after_q[link.q][3:].tolist()), tuple(after_v[link.v][3:].tolist()))
            after_v[link.v][3:] = frames.rotate(frames.conjugate(tuple(q[link.q][3:].tolist())), world)
        gain: np.ndarray = (after_v - v) / PROBE_STEP
        return gain

    def _set_gravity(self, on: bool) -> None:
        gravity = self._sim.sidecar.gravity if on else (0.0, 0.0, 0.0)
        self._sim.bullet.setGravity(*gravity, physicsClientId=self._sim.client)

    def masses(self, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of each tree its places in v, and its M, without armature. All trees are probed side by side; the last ones are kept,
        for the bias force."""
        if self._known is None or not np.array_equal(self._known[0], q):
            self._known = (q.copy(), self._measure_masses(q))
        return list(zip(self._blocks, self._known[1], strict=True))

    def _measure_masses(self, q: np.ndarray) -> list[np.ndarray]:
        self._set_gravity(False)
        sim = self._sim
        rest = np.zeros(sim.nv)
        inverses = [np.zeros((len(block), len(block))) for block in self._blocks]
        for column in range(max((len(block) for block in self._blocks), default=0)):
            effort = np.zeros(sim.nv)
            effort[[block[column] for block in self._blocks if column < len(block)]] = 1.0
            gain = self._gain(q, rest, effort)
            for block, inverse in zip(self._blocks, inverses, strict=True):
                if column < len(block):
                    inverse[:, column] = gain[block]
        found = []
        for inverse in inverses:
            # scaled to a unit diagonal first: a tree may hold kilograms and gram square millimetres side by side
            scale = np.sqrt(np.diag(inverse))
            found.append(np.linalg.inv(inverse / np.outer(scale, scale)) / np.outer(scale, scale))
        return found

    def bias_force(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """h (nv,) = −M v̇ of the unforced tree at (q, v)."""
        masses = self.masses(q)
        self._set_gravity(True)
        gain = self._gain(q, v, None)
        found = np.zeros(self._sim.nv)
        for places, mass in masses:
            found[places] = -mass @ gain[places]
        return found
