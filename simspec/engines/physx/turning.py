"""How single bodies turn in a step of PhysX, and the torque with which they turn by simspec's law of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simspec.world.rotations import cross, exponential, matrices, multiply

# How bodies turn in a step: by simspec's law of motion, where PhysX has another gyroscopic term and few digits.
#
# After all else PhysX takes dt ω × L off a body's angular momentum L = I ω and gives it the length back that it had. So it is
# given the torque with which that comes out as dt (τ − ω × Iω). The result is 1e-7 off in every step and always to the same
# side: 9e-4 rad/s of a body that turns at 6 rad/s for 2 s, 23 times what the round-off of single precision makes (measured). So
# bodies without contact are then given the velocity and the turn of the law, which is 3 times that round-off off.

SOLVED, MOST_TRIES = 1e-12, 50
"""How near the gyroscopic term is solved for, relative, and after how many tries that is given up."""


@dataclass(frozen=True)
class Turns:
    """Of bodies ``rows``: the ``torque`` that PhysX is given in a step, and the ``spin`` and ``turn`` of the law after it;
    vectors (n, 3) in world axes, quaternions (n, 4)."""

    rows: np.ndarray
    torque: np.ndarray
    spin: np.ndarray
    turn: np.ndarray


def turns(
    rows: np.ndarray, turn: np.ndarray, spin: np.ndarray, torque: np.ndarray, tensors: np.ndarray, timestep: float
) -> Turns:
    """Of bodies at ``turn`` (n, 4) with ``spin`` (n, 3) in world axes, ``torque`` (n, 3) and ``tensors`` (n, 3, 3) in their
    own."""
    axes = matrices(turn)
    local = np.einsum("nji,nj->ni", axes, spin)
    begins = np.einsum("nij,nj->ni", tensors, local)
    wanted = begins + timestep * (torque - cross(local, begins))
    inverse = np.linalg.inv(tensors)
    given = (_before(wanted, begins, local, inverse, timestep) - begins) / timestep
    after = np.einsum("nij,njk,nk->ni", axes, inverse, wanted)
    return Turns(rows, np.einsum("nij,nj->ni", axes, given), after, multiply(exponential(timestep * after), turn))


def _before(
    wanted: np.ndarray, begins: np.ndarray, spin: np.ndarray, inverse: np.ndarray, timestep: float
) -> np.ndarray:
    """The momenta of which PhysX's gyroscopic term makes the ``wanted`` ones: N |L| / |N| with N = L − dt ω × L, by repetition,
    as dt ω is small against 1."""
    found = wanted + timestep * cross(spin, begins)
    scale = np.linalg.norm(wanted, axis=1)
    scale = np.where(scale > 0.0, scale, 1.0)
    for _ in range(MOST_TRIES):
        turned = found - timestep * cross(np.einsum("nij,nj->ni", inverse, found), found)
        size = np.linalg.norm(turned, axis=1, keepdims=True)
        made = turned * np.linalg.norm(found, axis=1, keepdims=True) / np.where(size > 0.0, size, 1.0)
        found = found + (wanted - made)
        if np.max(np.linalg.norm(wanted - made, axis=1) / scale) < SOLVED:
            break
    return found
