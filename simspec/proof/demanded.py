"""What levels L6 and L7 of a world's proof must have compared, how often and how closely: planned anew from the world, as
``simspec verify`` plans it. It takes the oracle's motion, 0.1 to 7 s of processor time for the library's worlds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simspec.proof.control import Response
from simspec.proof.dry_friction import REST_CHECK, SLIDING_CHECK
from simspec.proof.forces import FORCES_CHECK, PRESCRIBED_CHECK
from simspec.proof.motion import ROUND_OFF, Motion
from simspec.proof.precision import Precision
from simspec.proof.sum_limits import TOLERANCE as STOPS_TOLERANCE
from simspec.proof.verify import Probes, prepare
from simspec.world.canonical import derived
from simspec.world.types import World

LEEWAY = 4.0
"""How much larger than planned a tolerance may be that follows from a round-off floor: the floor is the worst of four disturbed
runs, and another machine's last bits give another worst."""
NEARLY = 0.8
"""Share of the planned comparisons of a motion that ends where round-off grows too large: that instant is another on another
machine."""


@dataclass(frozen=True, slots=True)
class Demand:
    """``count`` comparisons, ``least`` of them at least, within ``tolerance`` at most."""

    count: int
    least: int
    tolerance: float


Demands = dict[tuple[str, str], Demand]


@derived
def demanded(world: World, precision: str) -> Demands:
    """By level and name the checks of L6 and L7 that a proof of ``world`` has, in numbers of ``precision``."""
    probes = prepare(world, ("L6", "L7"), precision)
    found: Demands = {}
    if probes.motion is not None:
        found["L6", "motion"] = _of_motion(probes.motion, probes.motion.precision)
    found |= _of_friction(probes)
    for trial in () if probes.stops is None else probes.stops.trials:
        before = found.get(("L6", trial.check))
        count = 1 + (0 if before is None else before.count)
        found["L6", trial.check] = Demand(count, count, STOPS_TOLERANCE)
    if probes.response is not None:
        found |= _of_response(probes.response, probes.precision)
    if probes.pushed is not None:
        count = int(np.prod(probes.pushed.poses.shape[:2]))
        found["L7", FORCES_CHECK] = Demand(count, count, _tolerance(probes.precision, probes.pushed.floor))
    if probes.followed is not None:
        count = int(np.prod(probes.followed.poses.shape[:2]))
        found["L7", PRESCRIBED_CHECK] = Demand(count, count, probes.precision.motion)
    return found


def _tolerance(precision: Precision, floor: float) -> float:
    return max(precision.tolerance(floor), precision.tolerance(LEEWAY * floor))


def _of_motion(motion: Motion, precision: Precision) -> Demand:
    rows, bodies = motion.poses.shape[:2]
    least = int(NEARLY * rows) if motion.ends.startswith(ROUND_OFF) else rows
    return Demand(rows * bodies, least * bodies, min(_tolerance(precision, motion.floor), precision.loosest))


def _of_friction(probes: Probes) -> Demands:
    found: Demands = {}
    if probes.rubbing is None:
        return found
    for trial in probes.rubbing.trials:
        name = SLIDING_CHECK if trial.slides else REST_CHECK
        before = found.get(("L6", name))
        count = int(probes.rubbing.compared(trial).sum()) + (0 if before is None else before.count)
        floors = trial.tolerance > probes.precision.sliding and trial.slides
        found["L6", name] = Demand(count, count, LEEWAY * trial.tolerance if floors else trial.tolerance)
    return found


def _of_response(response: Response, precision: Precision) -> Demands:
    tolerance = _tolerance(precision, response.floor)
    found = {}
    for name, expected in (("step response", response.positions), ("step response, closed form", response.closed)):
        if count := int((~np.isnan(expected)).sum()):
            found["L7", name] = Demand(count, count, tolerance)
    return found
