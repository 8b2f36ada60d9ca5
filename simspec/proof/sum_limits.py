"""Limits of sums of joint positions, pressed on (level L6, beside the motion, which stays away from them).

A force along a sum that stands at its limit is what the stop gives back, to the last bit: c F − c λ = 0, so that nothing moves
at all. A sum that arrives there, with the velocity that such a force gives, stops with all that it moves: the stop is
inelastic. So what must come is known without a law of impacts beside the engine's own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.process import Operation
from simspec.proof.checks import Check, Tally
from simspec.proof.inside import Stops
from simspec.world.derived import derived
from simspec.world.kinematics import initial_state, rubbing
from simspec.world.types import Follow, World

Floats = NDArray[np.float64]
LEVEL, STOPS_CHECK = "L6", "limits of sums"
STEPS = 20
"""Steps of one trial."""
WAY = 0.01
"""Share of a sum's range that it would cross in a trial without its limit: efforts are right where it begins."""
MARGIN = 0.02
"""Share of their ranges by which joints stay away from their own limits."""
TOLERANCE = 0.02
"""Of the speed that the same force gives where there is no limit: stops that give way reach 0.0072 of it (measured), one that
is missing reaches all of it."""


@dataclass(frozen=True)
class Trial:
    """One beginning, after which nothing moves; ``free`` (nv,): the velocities that the same force gives without the limit."""

    name: str
    where: str
    q: Floats
    v: Floats
    effort: Floats
    free: Floats


@dataclass(frozen=True)
class SumLimits:
    """The trials of a world, and the sums of which a limit is beyond those of their joints."""

    trials: tuple[Trial, ...]
    out_of_reach: tuple[str, ...]

    def operation(self, world: World) -> Operation:
        """What an engine is asked (see ``engines/kit/worker.py``)."""
        arrays = {name: np.array([getattr(trial, name) for trial in self.trials]) for name in ("q", "v", "effort")}
        arrays["rubbing"] = rubbing(world)
        return Operation("stopped", {"steps": [STEPS] * len(self.trials)}, arrays, world)


def nothing_stops(world: World) -> str:
    """Why no limit of a sum of this world is pressed on; "" where one is."""
    if not any(one.position_limits for one in world.sums):
        return "no sum of joint positions has limits"
    if not all(isinstance(held, Follow) for held in world.constraints):
        return "sums are not brought to their limits where loops are closed"
    return "" if _reached(world) else "the joints' own limits keep every sum off its limits"


def plan(world: World, oracle: Oracle) -> SumLimits | None:
    """The trials; None where no limit of a sum can be pressed on."""
    if nothing_stops(world):
        return None
    trials: list[Trial] = []
    reached = _reached(world)
    stops = Stops(world)
    names = [one.name for one in stops.along.sums]
    still = np.zeros(oracle.nv)
    for (row, side), q in reached.items():
        weights = stops.along.weights[row] * side
        span, seconds = float((stops.high - stops.low)[row]), STEPS * oracle.timestep
        balance = oracle.bias_force(q, still) - oracle.joint_effort(q, still)
        _, unit = oracle.step(q, still, balance + weights)
        gain = float(weights @ unit) / oracle.timestep
        force = 2.0 * WAY * span / (seconds**2 * gain)
        fast = unit * (WAY * span / (STEPS * oracle.timestep) / float(weights @ unit))
        free = oracle.motion(q, still, balance + force * weights, STEPS, STEPS)[1][-1]
        word = "upper" if side > 0 else "lower"
        where = f"constraints.{names[row]}.sum.limits.position"
        trials.append(Trial(f"pressed on its {word} limit", where, q, still, balance + force * weights, free))
        # half a step's way before the limit
        before = q.copy()
        moving = np.flatnonzero(stops.along.weights.any(axis=0))
        before[stops.places[moving]] -= 0.5 * oracle.timestep * fast[moving]
        trials.append(Trial(f"arrives at its {word} limit", where, before, fast, balance, fast))
    out = [name for row, name in enumerate(names) if not {(row, 1), (row, -1)} & reached.keys()]
    return SumLimits(tuple(trials), tuple(out))


@derived
def _reached(world: World) -> dict[tuple[int, int], Floats]:
    """Positions at which each sum with limits (its row) stands at its upper (1) or lower (−1) one, of those that can be."""
    stops = Stops(world)
    start, _ = initial_state(world)
    coupled = [held for held in world.constraints if isinstance(held, Follow)]
    reached: dict[tuple[int, int], Floats] = {}
    for row in range(len(stops.low)):
        for side, end in ((1, float(stops.high[row])), (-1, float(stops.low[row]))):
            targets = [
                (other, float(low), float(high))
                for other, (low, high) in enumerate(zip(stops.low, stops.high, strict=True))
                if other != row
            ]
            q = stops.moved(start, [*targets, (row, end, end)], MARGIN, coupled)
            if q is not None:
                reached[row, side] = q
    return reached


def stops_checks(world: World, plan: SumLimits, answer: Mapping[str, Floats]) -> list[Check]:
    """One check: the largest velocity that is left, as a share of what there would be without the limits."""
    tally = Tally()
    names = [body.joint.name for body in world.bodies for _ in body.joint.velocity]
    for trial, left in zip(plan.trials, answer["v"], strict=True):
        share = np.abs(left) / float(np.abs(trial.free).max())
        worst = int(np.argmax(share)) if np.isfinite(share).all() else int(np.argmin(np.isfinite(share)))
        detail = f"{trial.name}: {names[worst]} moves at {left[worst]:.6g} after {STEPS} steps, should be at rest"
        if plan.out_of_reach:
            detail += f"; out of the joints' reach: {', '.join(plan.out_of_reach[:3])}"
        tally.add(LEVEL, STOPS_CHECK, TOLERANCE, float(share[worst]), trial.where, detail)
    return tally.checks()
