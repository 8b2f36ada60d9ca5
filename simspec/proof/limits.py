"""Positions within the limits of sums of joint positions, for probes that stay away from limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.dynamics.oracle import STATES_SEED, Oracle
from simspec.engines.kit.process import Operation
from simspec.proof.checks import Check, Tally
from simspec.world.canonical import derived
from simspec.world.kinematics import frictional_coordinates, initial_state, layout_of
from simspec.world.passive_forces import JointSums
from simspec.world.types import Follow, World

Floats = NDArray[np.float64]
ROUNDS = 500
"""Of projections onto each sum in turn, and into the ranges of the joints; pairs of fingers need three."""
MIDDLE = 0.4
"""Share of their ranges by which sums begin away from their limits where a probe has room to move."""
CALM = 0.2
"""Of its range per second: the speed with which a sum begins at most."""
CLOSE = 1e-12
"""rad or m of a joint by which positions may miss what is asked of them."""


def followers(world: World) -> dict[str, list[tuple[str, float, float]]]:
    """By the first joint of each chain of joints that follow one other: the joints of the chain, itself among them, with the
    ratio and offset by which their positions are those of the first."""
    leaders = {one.joint: one for one in world.constraints if isinstance(one, Follow)}
    chains: dict[str, list[tuple[str, float, float]]] = {}
    for name in leaders:
        ratio, offset, first = 1.0, 0.0, name
        for _ in leaders:  # no chain is longer, and none goes round
            if first not in leaders:
                break
            one = leaders[first]
            ratio, offset, first = ratio * one.ratio, ratio * one.offset + offset, one.leader
        chains.setdefault(first, [(first, 1.0, 0.0)]).append((name, ratio, offset))
    return chains


def left_to(
    chain: Sequence[tuple[str, float, float]], limits: Mapping[str, tuple[float, float] | None], margin: float = 0.0
) -> tuple[float, float]:
    """The lowest and highest position of the first joint of a chain of :func:`followers` at which every joint of it is a share
    of its range away from its ``limits`` (None: it has none); the lowest is above the highest where there is none such."""
    low, high = -np.inf, np.inf
    for name, ratio, offset in chain:
        own = limits[name]
        if own is not None and ratio:
            room = margin * (own[1] - own[0])
            ends = sorted((limit - offset) / ratio for limit in (own[0] + room, own[1] - room))
            low, high = max(low, ends[0]), min(high, ends[1])
    return low, high


class Stops:
    """The sums of a world that have limits: ``along``, and ``low`` and ``high`` (sums,)."""

    def __init__(self, world: World):
        limited = [one for one in world.sums if one.position_limits is not None]
        self.along = JointSums(world.bodies, limited)
        ends = np.array([one.position_limits for one in limited], dtype=float).reshape(-1, 2)
        self.low, self.high = ends.T
        where = layout_of(world)
        self.places = np.zeros(where.nv, dtype=np.intp)
        """Where in q each coordinate of a hinge or slide is that stands in v; 0 of others, which no sum has."""
        self._own: dict[str, int] = {}
        self.floor, self.ceiling = np.full(where.nq, -np.inf), np.full(where.nq, np.inf)
        for body, q, v in zip(world.bodies, where.position, where.velocity, strict=True):
            if q.stop - q.start == 1:
                self.places[v] = q.start
            self._own[body.joint.name] = v.start
            if body.joint.position_limits is not None:
                self.floor[q], self.ceiling[q] = body.joint.position_limits

    def near(self, states: Floats, margin: float) -> NDArray[np.bool_]:
        """Whether, at each of some positions (n, nq), a sum is within a share of its range to a limit, or beyond."""
        lengths, room = self.along.lengths(states), margin * (self.high - self.low)
        near: NDArray[np.bool_] = ((lengths < self.low + room) | (lengths > self.high - room)).any(axis=1)
        return near

    def moved(
        self, q: Floats, targets: Sequence[tuple[int, float, float]], margin: float, coupled: Sequence[Follow] = ()
    ) -> Floats | None:
        """Positions near ``q`` (nq,) at which each of some sums (row, lower, upper) is between two values, joints follow those
        that they are ``coupled`` to, and every joint that is in any of these is a share of its range away from its limits; None
        where none are found."""
        q = q.copy()
        rows = [(self.along.weights[row], lower, upper) for row, lower, upper in targets]
        rows += [(self._weights(one), one.offset, one.offset) for one in coupled]
        touched = np.any([weights != 0.0 for weights, _, _ in rows], axis=0)
        at = self.places[touched]
        span = np.where(np.isfinite(self.ceiling - self.floor), self.ceiling - self.floor, 0.0)[at]
        low, high = self.floor[at] + margin * span, self.ceiling[at] - margin * span
        for _ in range(ROUNDS):
            off = 0.0
            q[at] = np.clip(q[at], low, high)
            for weights, lower, upper in rows:
                acting = np.flatnonzero(weights)
                length = float(weights[acting] @ q[self.places[acting]])
                gap = min(max(length, lower), upper) - length
                off = max(off, abs(gap) / float(np.abs(weights).max()))
                q[self.places[acting]] += weights[acting] * gap / float(weights @ weights)
            if off < CLOSE:
                return q
        return None

    def _weights(self, one: Follow) -> Floats:
        weights = np.zeros(len(self.places))
        weights[self._own[one.joint]], weights[self._own[one.leader]] = 1.0, -one.ratio
        return weights


def inside(world: World, q: Floats, margin: float) -> Floats:
    """``q`` (nq,), or positions near it at which all sums are ``margin`` of their ranges away from their limits; ``q`` where
    there are none."""
    if not any(one.position_limits for one in world.sums):
        return q
    stops = Stops(world)
    room = margin * (stops.high - stops.low)
    targets = list(zip(range(len(room)), (stops.low + room).tolist(), (stops.high - room).tolist(), strict=True))
    coupled = [held for held in world.constraints if isinstance(held, Follow)]
    moved = stops.moved(q, targets, margin, coupled)
    return q if moved is None else moved


def calmed(world: World, v: Floats, most: float) -> Floats:
    """``v`` (nv,) with no sum faster than ``most`` of its range per second."""
    stops = Stops(world)
    for weights, span in zip(stops.along.weights, stops.high - stops.low, strict=True):
        speed = float(weights @ v)
        v = v - weights * (speed - np.clip(speed, -most * span, most * span)) / float(weights @ weights)
    return v


# Limits of sums of joint positions and of ball joints, pressed on (level L6, beside the motion, which stays away from them).
#
# A force along a sum that stands at its limit is what the stop gives back, to the last bit: c F − c λ = 0, so that nothing
# moves at all. A sum that arrives there, with the velocity that such a force gives, stops with all that it moves: the stop is
# inelastic. So what must come is known without a law of impacts beside the engine's own.
LEVEL, STOPS_CHECK, BALLS_CHECK = "L6", "limits of sums", "limits of balls"
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
    """One beginning, after which nothing moves; ``free`` (nv,): the velocities that the same force gives without the limit;
    ``turned``: the largest velocity that damping leaves of an arrival (see :func:`_turned_aside`)."""

    name: str
    where: str
    q: Floats
    v: Floats
    effort: Floats
    free: Floats
    check: str = STOPS_CHECK
    turned: float = 0.0


@dataclass(frozen=True)
class SumLimits:
    """The trials of a world, and the sums of which a limit is beyond those of their joints."""

    trials: tuple[Trial, ...]
    out_of_reach: tuple[str, ...]

    def operation(self, world: World) -> Operation:
        """What an engine is asked (see ``engines/kit/worker.py``)."""
        arrays = {name: np.array([getattr(trial, name) for trial in self.trials]) for name in ("q", "v", "effort")}
        arrays["rubbing"] = frictional_coordinates(world)
        return Operation("stopped", {"steps": [STEPS] * len(self.trials)}, arrays, world)


def nothing_stops(world: World) -> str:
    """Why no limit of a sum of this world is pressed on; "" where one is."""
    if not any(one.position_limits for one in world.sums):
        return "no sum of joint positions has limits"
    if not all(isinstance(held, Follow) for held in world.constraints):
        return "sums are not brought to their limits where loops are closed"
    return "" if _reached(world) else "the joints' own limits keep every sum off its limits"


def no_ball_stops(world: World) -> str:
    """Why no limit of a ball joint of this world is pressed on; "" where one is."""
    if not any(body.joint.angle_limit for body in world.bodies):
        return "no ball joint has a limit"
    return "balls are not brought to their limits where joints are held together" if world.constraints else ""


def plan(world: World, oracle: Oracle) -> SumLimits | None:
    """The trials; None where no limit of a sum and of a ball can be pressed on."""
    sums = None if nothing_stops(world) else _of_sums(world, oracle)
    if no_ball_stops(world):
        return sums
    balls = tuple(_of_balls(world, oracle))
    return SumLimits(balls, ()) if sums is None else SumLimits((*sums.trials, *balls), sums.out_of_reach)


def _of_balls(world: World, oracle: Oracle) -> Iterator[Trial]:
    """A ball at its largest angle is turned further about the axis of that angle, whose rate is the ball's velocity about it,
    in either frame: what is pressed is what the stop gives back, as of a sum."""
    q, still = initial_state(world)[0], np.zeros(oracle.nv)
    parts = list(zip(world.bodies, oracle.layout.position, oracle.layout.velocity, strict=True))
    for body, at, _ in parts:
        if (limits := body.joint.position_limits) is not None:
            q[at] = min(max(q[at.start], 0.9 * limits[0] + 0.1 * limits[1]), 0.1 * limits[0] + 0.9 * limits[1])
        elif body.joint.angle_limit is not None:
            q[at] = (1.0, 0.0, 0.0, 0.0)
    q = inside(world, q, MIDDLE)
    generator, seconds = np.random.default_rng(STATES_SEED + 400), STEPS * oracle.timestep
    for body, at, at_v in parts:
        if (most := body.joint.angle_limit) is None or most >= np.pi:
            continue
        axis = generator.normal(size=3)
        axis /= np.linalg.norm(axis)
        weights, there = still.copy(), q.copy()
        weights[at_v], there[at] = axis, _turned(most, axis)
        balance = oracle.bias_force(there, still) - oracle.joint_effort(there, still)
        _, unit = oracle.step(there, still, balance + weights)
        gain = float(weights @ unit) / oracle.timestep
        force = 2.0 * WAY * most / (seconds**2 * gain)
        fast = unit * (WAY * most / seconds / float(weights @ unit))
        free = oracle.motion(there, still, balance + force * weights, STEPS, STEPS)[1][-1]
        where = f"bodies.{body.name}.joint.limits.angle"
        pressed = balance + force * weights
        yield Trial("pressed on its largest angle", where, there, still, pressed, free, BALLS_CHECK)
        before = there.copy()
        before[at] = _turned(most - 0.5 * oracle.timestep * WAY * most / seconds, axis)
        aside = _turned_aside(oracle, (before, fast, balance), weights, unit)
        yield Trial("arrives at its largest angle", where, before, fast, balance, fast, BALLS_CHECK, aside)


ARRIVING = 2
"""Steps in which what arrives is damped as it moves: the one to the limit, and the one in which the stop acts."""


def _turned_aside(
    oracle: Oracle,
    begun: tuple[Floats, Floats, Floats],
    weights: Floats,
    unit: Floats,
) -> float:
    """What damping makes of the velocity of an arrival before the stop has taken it: a part that the stop, which takes
    ``unit`` (nv,) of velocity along ``weights``, does not feel. ``begun``: the state and the effort of the first step."""
    q, v, effort = begun
    lost = oracle.step(q, v, effort)[1] - v
    aside = lost - unit * float(weights @ lost) / float(weights @ unit)
    return ARRIVING * float(np.abs(aside).max())


def _turned(angle: float, axis: Floats) -> Floats:
    return np.array([np.cos(angle / 2.0), *(np.sin(angle / 2.0) * axis)])


def _of_sums(world: World, oracle: Oracle) -> SumLimits:
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
        aside = _turned_aside(oracle, (before, fast, balance), weights, unit)
        trials.append(Trial(f"arrives at its {word} limit", where, before, fast, balance, fast, turned=aside))
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
    """A check of sums and one of balls: the largest velocity that is left, beyond what damping turned aside, as a share of what
    the same force gives without the limits."""
    tally = Tally()
    names = [body.joint.name for body in world.bodies for _ in body.joint.velocity]
    for trial, left in zip(plan.trials, answer["v"], strict=True):
        share = np.maximum(np.abs(left) - trial.turned, 0.0) / float(np.abs(trial.free).max())
        worst = int(np.argmax(share)) if np.isfinite(share).all() else int(np.argmin(np.isfinite(share)))
        detail = f"{trial.name}: {names[worst]} moves at {left[worst]:.6g} after {STEPS} steps, should be at rest"
        if plan.out_of_reach and trial.check == STOPS_CHECK:
            detail += f"; out of the joints' reach: {', '.join(plan.out_of_reach[:3])}"
        tally.add(LEVEL, trial.check, TOLERANCE, float(share[worst]), trial.where, detail)
    return tally.checks()
