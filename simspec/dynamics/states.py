"""Seeded states of a world's bodies: where joints and roots may be, and how fast."""

from __future__ import annotations

import math

import numpy as np

from simspec.language.vocabulary import QUATERNION_JOINTS, SCALAR_JOINTS
from simspec.world.kinematics import initial_state
from simspec.world.types import World

SEED = 20211


def angles_of(turns: np.ndarray) -> np.ndarray:
    """The angles (n,), 0 to π, of unit quaternions (n, 4)."""
    angles: np.ndarray = 2.0 * np.arctan2(np.linalg.norm(turns[:, 1:], axis=1), np.abs(turns[:, 0]))
    return angles


def shortened(turn: np.ndarray, share: float) -> np.ndarray:
    """The rotation (4,) about the same axis by a share of the angle."""
    w, axis = abs(float(turn[0])), turn[1:] * (1.0 if turn[0] >= 0.0 else -1.0)
    length = float(np.linalg.norm(axis))
    half = share * math.atan2(length, w)
    return np.array([math.cos(half), *(axis * (math.sin(half) / length if length else 0.0))])


def random_states(world: World, count: int, seed: int = SEED, speed: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """``count`` seeded states (count, nq), (count, nv): hinges anywhere within their limits (else ±π), slides within
    theirs (else ±0.5 m), any orientation that limits allow, free roots within 1 m of where they are, velocities within
    ±``speed``."""
    generator = np.random.default_rng(seed)
    start, _ = initial_state(world)
    states, velocities = [], []
    for _ in range(count):
        q: list[float] = []
        v: list[float] = []
        at = 0
        for body in world.bodies:
            joint = body.joint
            if joint.kind in SCALAR_JOINTS:
                reach = math.pi if joint.kind == "hinge" else 0.5
                low, high = joint.position_limits or (-reach, reach)
                low, high = max(low, -reach), min(high, reach)
                q.append(generator.uniform(low, high) if low < high else sum(joint.position_limits or (0.0, 0.0)) / 2)
            elif joint.kind in QUATERNION_JOINTS:
                if joint.kind == "free":
                    q.extend(start[at : at + 3] + generator.uniform(-1, 1, 3))
                turn = generator.normal(size=4)
                turn = turn / np.linalg.norm(turn) * (1.0 if turn[0] >= 0 else -1.0)
                q.extend(turn if joint.angle_limit is None else shortened(turn, joint.angle_limit / math.pi))
            at += len(joint.position)
            v.extend(generator.uniform(-speed, speed, len(joint.velocity)))
        states.append(q)
        velocities.append(v)
    shape = (count, -1) if states and states[0] else (count, 0)
    return np.array(states).reshape(shape), np.array(velocities).reshape((count, -1) if velocities[0] else (count, 0))
