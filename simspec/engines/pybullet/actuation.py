"""Hinges and slides of a PyBullet simulation, read and driven at every step with as few calls as it allows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from simspec.engines.kit.contract import Actuation, Engine
from simspec.engines.kit.motors import motor_limit, motor_rate
from simspec.engines.pybullet.simulation import Simulation
from simspec.engines.pybullet.trees import UNCLAMPED
from simspec.support.declarations import Refinement, unsupported_if
from simspec.world.kinematics import natively_driven
from simspec.world.types import World

NATIVE = (
    "POSITION_CONTROL with positionGain kp dt/(kd + dt kp) and velocityGain 1, a motor for velocity that makes "
    "v' = v* + kp/(kd + dt kp) (q* − q) with what effort it takes, up to the limit: errors vanish with the time constant kd/kp "
    "whatever the inertia, and do not sag under gravity; kp and kd count by their ratio alone"
)


def no_dry_friction(world: World) -> Refinement | None:
    """Not supported where a natively driven joint has dry friction."""
    rough = [body.name for body in world.bodies if body.joint.dry_friction]
    served = [name for name in natively_driven(world.bodies, world) if name in rough]
    return (
        unsupported_if(f"PyBullet has one motor a joint, and that of {served[0]!r} is its dry friction")
        if served
        else None
    )


def _driven(sim: Simulation, v: np.ndarray) -> Iterator[tuple[int, list[int], np.ndarray]]:
    """Of each tree its number, its links on the hinges and slides at the places ``v`` (n,), and where these stand in ``v``."""
    order = {int(place): index for index, place in enumerate(v)}
    for tree in sim.trees:
        links = [link for link in tree.movers if link.kind != "ball" and link.v.start in order]
        if links:
            yield tree.uid, [link.link for link in links], np.array([order[link.v.start] for link in links], dtype=int)


class JointArrays(Actuation):
    """One call for each tree to read, and one to drive. For simulations without springs and armature, which need more."""

    def __init__(self, engine: Engine, sim: Simulation, q: np.ndarray, v: np.ndarray):
        super().__init__(engine, q, v)
        self._sim = sim
        self._trees = []
        for uid, links, rows in _driven(sim, v):
            whole = len(links) == len(v) and (np.diff(rows) == 1).all()
            self._trees.append((uid, links, None if whole else rows))
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

    def give(self, effort: np.ndarray) -> None:
        sim, p = self._sim, self._sim.bullet
        for uid, links, rows in self._trees:
            forces = (effort if rows is None else effort[rows]).tolist()
            p.setJointMotorControlArray(uid, links, p.TORQUE_CONTROL, forces=forces, physicsClientId=sim.client)

    def step(self) -> None:
        self._sim.advance(1)


class JointServos:
    """Some hinges and slides with PyBullet's own position controller."""

    def __init__(self, sim: Simulation, v: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, limit: np.ndarray):
        self._sim = sim
        gain = motor_rate(stiffness, damping, sim.sidecar.timestep) * sim.sidecar.timestep
        limit = np.minimum(motor_limit(stiffness, damping, limit), UNCLAMPED)
        self._trees = []
        for uid, links, rows in _driven(sim, v):
            fixed = {
                "positionGains": gain[rows].tolist(),
                "velocityGains": [1.0] * len(links),
                "forces": limit[rows].tolist(),
                "physicsClientId": sim.client,
            }
            self._trees.append((uid, links, rows, fixed))

    def aim(self, position: np.ndarray, velocity: np.ndarray) -> None:
        p = self._sim.bullet
        for uid, links, rows, fixed in self._trees:
            where, speed = position[rows].tolist(), velocity[rows].tolist()
            p.setJointMotorControlArray(
                uid, links, p.POSITION_CONTROL, targetPositions=where, targetVelocities=speed, **fixed
            )
