"""Level L3 of engines that return no mass matrix, or no bias force: accelerations of one contact-free step.

From rest, under the efforts that hold weights and springs and another at one coordinate of each tree, the velocity after a step
is dt times a column of M⁻¹, without cancellation. From rest without efforts it is that of gravity and springs, from a velocity
also that of the Coriolis and centrifugal forces: the latter only where the method is semi-implicit Euler, since others add
terms of the order of dt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.capabilities import ROUNDING, Capability
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Operation
from simspec.proof.checks import Check, Precision, Tally
from simspec.world.kinematics import frictional_coordinates
from simspec.world.types import World

MASS, GRAVITY, BIAS = "mass matrix", "gravity force", "bias force"
ABOVE_WEIGHT = 10.0
"""Times the acceleration by which weights and springs would move a coordinate that an effort gives it: the round-off of the
efforts that balance these is then small (in singles at 1 m/s² it made 6e-6 of M⁻¹, measured)."""
BY_STEPS = "by accelerations of one step"


def uncomparable(world: World, engine: type[Engine]) -> str:
    """Why accelerations of a step of ``engine`` cannot be compared in ``world``; "" where they can."""
    if Capability.CONTACT_OFF in engine.LACKS:
        return engine.LACKS[Capability.CONTACT_OFF]
    if len(frictional_coordinates(world)) and Capability.DRY_FRICTION_OFF in engine.LACKS:
        return engine.LACKS[Capability.DRY_FRICTION_OFF]
    if world.constraints:
        return "constraints act in each step"
    return engine.STEPS_UNMEASURED


@dataclass(frozen=True)
class Accelerations:
    """Trials of one step: states (n, …), efforts, and the expected accelerations (n, nv); ``kinds``: the check of each.
    ``scale`` (n, nv) of a deviation of each; ``states``: the number of the state of each."""

    q: np.ndarray
    v: np.ndarray
    effort: np.ndarray
    expected: np.ndarray
    scale: np.ndarray
    kinds: tuple[str, ...]
    states: tuple[int, ...]

    def operation(self, world: World) -> Operation:
        """The operation for an engine (see ``engines/kit/worker.py``)."""
        arrays = {"q": self.q, "v": self.v, "effort": self.effort, "rubbing": frictional_coordinates(world)}
        return Operation("accelerations", {"steps": [1] * len(self.q)}, arrays, world)

    def checks(self, world: World, answer: Mapping[str, np.ndarray], precision: Precision) -> list[Check]:
        """A check of each kind: M⁻¹ relative to √(M⁻¹ii M⁻¹jj), accelerations to √(M⁻¹ii hᵀM⁻¹h), their share of the energy
        norm of the force in its tree, or of 1 m/s² and rad/s² where that vanishes."""
        tally = Tally()
        names = [body.name for body in world.bodies for _ in body.joint.velocity]
        found = (answer["v"] - self.v) / world.physics.timestep
        shares = np.abs(found - self.expected) / self.scale
        for kind, state, share in zip(self.kinds, self.states, shares, strict=True):
            worst = int(np.argmax(share)) if np.isfinite(share).all() else int(np.argmin(np.isfinite(share)))
            where = f"bodies.{names[worst]}, state {state}"
            tally.add("L3", kind, precision.model, float(share[worst]), where, BY_STEPS)
        return tally.checks()


def plan(oracle: Oracle, q: np.ndarray, v: np.ndarray, precision: Precision, kinds: tuple[str, ...]) -> Accelerations:
    """Trials at states (k, nq), (k, nv) for the checks ``kinds``."""
    dt, rest = oracle.timestep, np.zeros(oracle.nv)
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, str, int]] = []

    def add(state: int, speed: np.ndarray, effort: np.ndarray, scale: np.ndarray, kind: str) -> None:
        expected = (oracle.step(q[state], speed, effort)[1] - speed) / dt
        rows.append((q[state], speed, effort, expected, scale, kind, state))

    for state in range(len(q)):
        inverses = [np.linalg.inv(mass) for mass in oracle.mass_blocks(q[state])]
        balance = oracle.bias_force(q[state], rest) - oracle.joint_effort(q[state], rest)
        for column in range(max(map(len, inverses), default=0) if MASS in kinds else 0):
            effort, scale = balance.copy(), np.ones(oracle.nv)
            for block, inverse in zip(oracle.blocks, inverses, strict=True):
                root = np.sqrt(np.diag(inverse))
                moved = min(column, len(block) - 1)
                weight = float(np.sqrt(max(0.0, balance[block] @ inverse @ balance[block])))
                push = max(1.0, ABOVE_WEIGHT * weight * float(root[moved]))
                effort[block[moved]] += push / float(inverse[moved, moved])
                scale[block] = push * root / root[moved]
            add(state, rest, effort, scale, MASS)
        for kind, speed in ((GRAVITY, rest), (BIAS, v[state])):
            if kind not in kinds:
                continue
            force = oracle.joint_effort(q[state], speed) - oracle.bias_force(q[state], speed)
            scale = np.ones(oracle.nv)
            for block, inverse in zip(oracle.blocks, inverses, strict=True):
                strength = np.sqrt(max(0.0, float(force[block] @ inverse @ force[block])))
                root = np.sqrt(np.diag(inverse))
                scale[block] = root * np.maximum(strength, 1.0 / root)
            # the round-off of a velocity, over the timestep, counts as the whole tolerance
            rounded = ROUNDING[precision.name] * float(np.abs(speed).max(initial=0.0)) / dt / precision.model
            add(state, speed, rest, np.maximum(scale, rounded), kind)
    at, speeds, efforts, expected, scales, names, states = zip(*rows, strict=True)
    numbers = (np.array(at), np.array(speeds), np.array(efforts), np.array(expected), np.array(scales))
    return Accelerations(*numbers, names, states)
