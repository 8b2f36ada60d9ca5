"""Where a mechanism rests: beginnings of motions that are too chaotic from anywhere else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.world.kinematics import initial_state
from simspec.world.types import World

STEPS = 2000
"""Steps in which a mechanism falls to rest: a chain of 200 links of 5 cm that begins at 1 rad comes within 0.3 rad, from where
a motion of 2,000 steps is followed (measured)."""
WORK = 400_000
"""Coordinates × steps: of larger worlds as many steps as that allows."""
INSIDE = 0.1
"""Share of its range by which a joint has to be inside its limits at the beginning; otherwise it begins in their middle."""


def at_rest(world: World, oracle: Oracle, near_limits: Callable[[np.ndarray], bool]) -> np.ndarray:
    """A position (nq,) near the world's initial one where its springs and weights balance, or that is on the way there.

    The motion from rest is followed, and stopped whenever its kinetic energy falls: it then passes a lowest point of the
    potential on its way. It ends where ``near_limits`` says that a joint comes near a limit.
    """
    start, _ = initial_state(world)
    q = start.copy()
    for body, at in zip(world.bodies, oracle.layout.position, strict=True):
        limits = body.joint.position_limits
        if limits is not None:
            room = INSIDE * (limits[1] - limits[0])
            if not limits[0] + room < float(start[at][0]) < limits[1] - room:
                q[at] = sum(limits) / 2.0
    if world.constraints:
        q = oracle.inwards(oracle.settled(q, start))
    still = np.zeros(oracle.nv)
    v = still
    best, energy = q, 0.0
    for _ in range(min(STEPS, WORK // max(1, oracle.nv))):
        q, v = oracle.step(q, v, still)
        if not np.isfinite(q).all() or near_limits(q):
            return best
        best = q
        kinetic, _ = oracle.energy(q, v)
        if kinetic < energy:
            v, kinetic = still, 0.0
        energy = kinetic
    return best
