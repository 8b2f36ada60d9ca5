"""Seeded states, and what kinematics and dynamics an engine makes of them, against the oracle (levels L2 and L3)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.proof.checks import MODEL_TOLERANCE, Check, Tally
from simspec.world.types import World

STATES = 5
FEW_STATES = 1
LARGE = 200
"""Coordinates above which one state is probed: a mass matrix of 1,296 coordinates is 13 MB."""


def kinematics_checks(
    world: World, oracle: Oracle, q: np.ndarray, v: np.ndarray, found: Mapping[str, np.ndarray]
) -> list[Check]:
    """Poses and velocities of all bodies at states (k, nq), (k, nv), and whether the engine gives a state back."""
    tally = Tally()
    names = [body.name for body in world.bodies]
    for row in range(len(q)):
        pose, velocity = oracle.body_poses(q[row]), oracle.body_velocities(q[row], v[row])
        reach = np.maximum(1.0, np.linalg.norm(pose[:, :3], axis=1))
        away = np.linalg.norm(found["pose"][row][:, :3] - pose[:, :3], axis=1) / reach
        turned = rotation_error(found["pose"][row][:, 3:], pose[:, 3:])
        fast = np.maximum(1.0, np.linalg.norm(velocity, axis=1))
        faster = np.linalg.norm(found["velocity"][row] - velocity, axis=1) / fast
        for name, values in (("pose, position", away), ("pose, orientation", turned), ("body velocity", faster)):
            worst = int(np.argmax(values)) if np.isfinite(values).all() else int(np.argmin(np.isfinite(values)))
            tally.add("L2", name, MODEL_TOLERANCE, float(values[worst]), f"bodies.{names[worst]}, state {row}")
        state = float(np.abs(found["v"][row] - v[row]).max(initial=0.0))
        tally.add("L2", "state given back", MODEL_TOLERANCE, state, f"state {row}")
    return tally.checks()


def dynamics_checks(
    world: World, oracle: Oracle, q: np.ndarray, v: np.ndarray, found: Mapping[str, np.ndarray]
) -> list[Check]:
    """Mass matrix and bias force at states with velocity, then gravity force at the same ones at rest.

    The states come twice: (2k, nq), the second half with v = 0. Deviations are in each coordinate's own scale: an element
    of M relative to √(Mii Mjj), a force relative to √(Mii · hᵀM⁻¹h), its share of the effort's own energy norm, or to
    Mii × 1 (m/s² or rad/s²) where the force vanishes.
    """
    tally = Tally()
    coordinates = [body.name for body in world.bodies for _ in body.joint.velocity]
    half = len(q) // 2
    for row in range(len(q)):
        mass, bias = oracle.mass_matrix(q[row]), oracle.bias_force(q[row], v[row])
        if not len(mass):
            continue
        root = np.sqrt(np.diag(mass))
        if row < half:
            error = np.abs(found["mass_matrix"][row] - mass) / np.outer(root, root)
            i, j = np.unravel_index(int(np.argmax(error)), error.shape)
            where = f"bodies.{coordinates[i]}, bodies.{coordinates[j]}, state {row}"
            tally.add("L3", "mass matrix", MODEL_TOLERANCE, float(error[i, j]), where)
        strength = math.sqrt(max(0.0, float(bias @ np.linalg.solve(mass, bias))))
        error = np.abs(found["bias_force"][row] - bias) / (root * np.maximum(strength, root))
        i = int(np.argmax(error))
        name = "bias force" if row < half else "gravity force"
        tally.add("L3", name, MODEL_TOLERANCE, float(error[i]), f"bodies.{coordinates[i]}, state {row % half}")
    return tally.checks()


def rotation_error(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles (rad) between orientations (..., 4), as 2 |sin(angle/2)|, without loss of digits near zero."""
    w, xyz = a[..., :1], a[..., 1:]
    other_w, other = b[..., :1], b[..., 1:]
    apart = w * other - other_w * xyz - np.cross(xyz, other)
    return 2.0 * np.linalg.norm(apart, axis=-1)
