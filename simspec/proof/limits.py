"""Positions within the limits of sums of joint positions, for probes that stay away from limits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from simspec.dynamics.oracle import STATES_SEED, Oracle, angles_of, shortened
from simspec.engines.kit.capabilities import DOUBLE
from simspec.engines.kit.process import Operation
from simspec.proof.checks import PRECISIONS, Check, Demand, Demands, Precision, Tally
from simspec.world.canonical import derived
from simspec.world.constraints import JointSums
from simspec.world.kinematics import frictional_coordinates, initial_state, layout_of
from simspec.world.types import FollowConstraint, World

Floats = NDArray[np.float64]
ROUNDS = 500
"""Of projections onto each sum in turn, and into the ranges of the joints; pairs of fingers need three."""
MIDDLE = 0.4
"""Share of their ranges by which sums begin away from their limits where a probe has room to move."""
CALM = 0.2
"""Of its range per second: the speed with which a sum begins at most."""
CLOSE = 1e-12
"""rad or m of a joint by which positions may miss their targets."""


def followers(world: World) -> dict[str, list[tuple[str, float, float]]]:
    """By the first joint of each chain of joints that follow one other: the joints of the chain, itself among them, with the
    ratio and offset by which their positions are those of the first."""
    leaders = {follow.joint: follow for follow in _couplings(world)}
    chains: dict[str, list[tuple[str, float, float]]] = {}
    for name in leaders:
        ratio, offset, first = 1.0, 0.0, name
        for _ in leaders:  # no chain is longer, and none goes round
            if first not in leaders:
                break
            follow = leaders[first]
            ratio, offset, first = ratio * follow.ratio, ratio * follow.offset + offset, follow.leader
        chains.setdefault(first, [(first, 1.0, 0.0)]).append((name, ratio, offset))
    return chains


def left_to(
    chain: Sequence[tuple[str, float, float]], limits: Mapping[str, tuple[float, float] | None], margin: float = 0.0
) -> tuple[float, float]:
    """The lowest and highest position of the first joint of a chain of :func:`followers` at which every joint of it is a share
    of its range away from its ``limits`` (None: it has none); the lowest is above the highest where there is none such."""
    low, high = -np.inf, np.inf
    for name, ratio, offset in chain:
        ends_of_joint = limits[name]
        if ends_of_joint is not None and ratio:
            room = margin * (ends_of_joint[1] - ends_of_joint[0])
            ends = sorted((end - offset) / ratio for end in (ends_of_joint[0] + room, ends_of_joint[1] - room))
            low, high = max(low, ends[0]), min(high, ends[1])
    return low, high


class Stops:
    """The limits of a world's joints (``floor`` and ``ceiling``, (nq,), infinite where there is none), of its balls, and of its
    sums of joint positions: ``along``, and ``low`` and ``high`` (sums,)."""

    def __init__(self, world: World):
        limited = [total for total in world.sums if total.position_limits is not None]
        self.along = JointSums(world.bodies, limited)
        self.low, self.high = np.array([total.position_limits for total in limited], dtype=float).reshape(-1, 2).T
        where = layout_of(world)
        self.places = np.zeros(where.nv, dtype=np.intp)
        """Where in q each coordinate of a hinge or slide is that stands in v; 0 of others, which no sum has."""
        self._joints = {body.joint.name: v.start for body, v in zip(world.bodies, where.velocity, strict=True)}
        self.floor, self.ceiling = np.full(where.nq, -np.inf), np.full(where.nq, np.inf)
        self._balls: list[tuple[slice, float]] = []
        for body, q, v in zip(world.bodies, where.position, where.velocity, strict=True):
            if q.stop - q.start == 1:
                self.places[v] = q.start
            if body.joint.position_limits is not None:
                self.floor[q], self.ceiling[q] = body.joint.position_limits
            if body.joint.angle_limit is not None:
                self._balls.append((q, body.joint.angle_limit))
        self._limited = np.flatnonzero(np.isfinite(self.ceiling - self.floor))

    def near(self, states: Floats, margin: float) -> NDArray[np.bool_]:
        """Whether, at each of some positions (n, nq), a joint, a ball or a sum is within a share of its range to a limit, or
        beyond."""
        low, high = (
            np.concatenate([ends[self._limited], of_sums])
            for ends, of_sums in ((self.floor, self.low), (self.ceiling, self.high))
        )
        values = np.concatenate([states[:, self._limited], self.along.lengths(states)], axis=1)
        room = margin * (high - low)
        near: NDArray[np.bool_] = ((values < low + room) | (values > high - room)).any(axis=1)
        for at, largest in self._balls:
            near |= angles_of(states[:, at]) > (1.0 - margin) * largest
        return near

    def within(self, q: Floats, margin: float) -> Floats:
        """``q`` (nq,) with each joint and ball a share of its range away from its limits; sums as they come."""
        q, room = q.copy(), margin * (self.ceiling - self.floor)[self._limited]
        q[self._limited] = np.clip(
            q[self._limited], self.floor[self._limited] + room, self.ceiling[self._limited] - room
        )
        for at, largest in self._balls:
            if (angle := float(angles_of(q[None, at])[0])) > (1.0 - margin) * largest:
                q[at] = shortened(q[at], (1.0 - margin) * largest / angle)
        return q

    def moved(
        self,
        q: Floats,
        targets: Sequence[tuple[int, float, float]],
        margin: float,
        coupled: Sequence[FollowConstraint] = (),
    ) -> Floats | None:
        """Positions near ``q`` (nq,) at which each of some sums (row, lower, upper) is between two values, joints follow those
        that they are ``coupled`` to, and every joint that is in any of these is a share of its range away from its limits; None
        where none are found."""
        q = q.copy()
        rows = [(self.along.weights[row], lower, upper) for row, lower, upper in targets]
        for follow in coupled:
            weights = np.zeros(len(self.places))
            weights[self._joints[follow.joint]], weights[self._joints[follow.leader]] = 1.0, -follow.ratio
            rows.append((weights, follow.offset, follow.offset))
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


def inside(world: World, q: Floats, margin: float) -> Floats:
    """``q`` (nq,), or positions near it at which all sums are ``margin`` of their ranges away from their limits; ``q`` where
    there are none."""
    if not any(total.position_limits for total in world.sums):
        return q
    stops = Stops(world)
    room = margin * (stops.high - stops.low)
    targets = list(zip(range(len(room)), (stops.low + room).tolist(), (stops.high - room).tolist(), strict=True))
    moved = stops.moved(q, targets, margin, _couplings(world))
    return q if moved is None else moved


def _couplings(world: World) -> list[FollowConstraint]:
    return [constraint for constraint in world.constraints if isinstance(constraint, FollowConstraint)]


def calmed(world: World, v: Floats, most: float) -> Floats:
    """``v`` (nv,) with no sum faster than ``most`` of its range per second."""
    stops = Stops(world)
    for weights, span in zip(stops.along.weights, stops.high - stops.low, strict=True):
        speed = float(weights @ v)
        v = v - weights * (speed - np.clip(speed, -most * span, most * span)) / float(weights @ weights)
    return v


# Limits of sums of joint positions and of ball joints, pressed on (level L6, alongside the motion, which stays away from them).
#
# A force along a sum that stands at its limit is what the stop gives back, to the last bit: c F − c λ = 0, so that nothing
# moves at all. A sum that arrives there, with the velocity that such a force gives, stops with all that it moves: the stop is
# inelastic. So the expected motion needs no law of impacts in addition to the engine's.
LEVEL, STOPS_CHECK, BALLS_CHECK = "L6", "limits of sums", "limits of balls"
STEPS = 20
"""Steps of one trial."""
WAY = 0.01
"""Share of a sum's range that it would cross in a trial without its limit: efforts are right where it begins."""
MARGIN = 0.02
"""Share of their ranges by which joints stay away from their own limits."""
TOLERANCE = 0.02
"""Of the speed that the same force gives where there is no limit: compliant stops reach 0.0072 of it (measured), a missing one
reaches all of it."""
ARRIVING = 2
"""Steps in which what arrives is damped as it moves: the one to the limit, and the one in which the stop acts."""


@dataclass(frozen=True)
class LimitTrial:
    """One beginning, after which nothing moves; ``free`` (nv,): the velocities that the same force gives without the limit;
    ``turned``: the largest velocity that damping leaves of an arrival (see :func:`_trials`)."""

    name: str
    where: str
    q: Floats
    v: Floats
    effort: Floats
    free: Floats
    check: str = STOPS_CHECK
    turned: float = 0.0


@dataclass(frozen=True)
class SumLimitTrials:
    """The trials of a world, and the sums of which a limit is beyond those of their joints."""

    trials: tuple[LimitTrial, ...]
    out_of_reach: tuple[str, ...]

    def operation(self, world: World) -> Operation:
        """The operation for an engine (see ``engines/kit/worker.py``)."""
        arrays = {name: np.array([getattr(trial, name) for trial in self.trials]) for name in ("q", "v", "effort")}
        arrays["rubbing"] = frictional_coordinates(world)
        return Operation("stopped", {"steps": [STEPS] * len(self.trials)}, arrays, world)

    def demands(self) -> Demands:
        """One comparison for each trial."""
        counts = Counter((LEVEL, trial.check) for trial in self.trials)
        return {part: Demand(count, count, TOLERANCE) for part, count in counts.items()}

    def checks(self, world: World, answer: Mapping[str, Floats], creep: float = 0.0) -> list[Check]:
        """A check of sums and one of balls: the largest velocity that is left, beyond what damping turned aside, as a share of
        what the same force gives without the limits."""
        tally = Tally()
        names = [body.joint.name for body in world.bodies for _ in body.joint.velocity]
        for trial, left in zip(self.trials, answer["v"], strict=True):
            share = np.maximum(np.abs(left) - trial.turned, 0.0) / float(np.abs(trial.free).max())
            worst = int(np.argmax(share)) if np.isfinite(share).all() else int(np.argmin(np.isfinite(share)))
            detail = f"{trial.name}: {names[worst]} moves at {left[worst]:.6g} after {STEPS} steps, should be at rest"
            if self.out_of_reach and trial.check == STOPS_CHECK:
                detail += f"; out of the joints' reach: {', '.join(self.out_of_reach[:3])}"
            tally.add(LEVEL, trial.check, TOLERANCE, float(share[worst]), trial.where, detail)
        return tally.checks()


def nothing_stops(world: World) -> str:
    """Why no limit of a sum of this world is pressed on; "" where one is."""
    if not any(total.position_limits for total in world.sums):
        return "no sum of joint positions has limits"
    if not all(isinstance(constraint, FollowConstraint) for constraint in world.constraints):
        return "sums are not brought to their limits where loops are closed"
    return "" if _reached(world) else "the joints' own limits keep every sum off its limits"


def no_ball_stops(world: World) -> str:
    """Why no limit of a ball joint of this world is pressed on; "" where one is."""
    if not any(body.joint.angle_limit for body in world.bodies):
        return "no ball joint has a limit"
    return "balls are not brought to their limits where joints are held together" if world.constraints else ""


def plan(world: World, oracle: Oracle, precision: Precision = PRECISIONS[DOUBLE]) -> SumLimitTrials | None:
    """The trials; None where no limit of a sum and of a ball can be pressed on."""
    reached = {} if nothing_stops(world) else _reached(world)
    stops = Stops(world)
    names = [total.name for total in stops.along.sums] if reached else []
    trials = [trial for (row, side), q in reached.items() for trial in _of_sum(oracle, stops, row, side, q)]
    if not no_ball_stops(world):
        trials += _of_balls(world, oracle)
    out = (name for row, name in enumerate(names) if not {(row, 1), (row, -1)} & reached.keys())
    return SumLimitTrials(tuple(trials), tuple(out)) if trials else None


def _of_sum(oracle: Oracle, stops: Stops, row: int, side: int, q: Floats) -> Iterator[LimitTrial]:
    """Trials of the sum ``row``, which at ``q`` stands at its upper (1) or lower (−1) limit."""
    moving = np.flatnonzero(stops.along.weights.any(axis=0))

    def before(fast: Floats) -> Floats:
        at = q.copy()
        at[stops.places[moving]] -= 0.5 * oracle.timestep * fast[moving]
        return at

    limit, span = f"{'upper' if side > 0 else 'lower'} limit", float((stops.high - stops.low)[row])
    where = f"constraints.{stops.along.sums[row].name}.sum.limits.position"
    return _trials(oracle, q, stops.along.weights[row] * side, span, before, (limit, where, STOPS_CHECK))


def _of_balls(world: World, oracle: Oracle) -> Iterator[LimitTrial]:
    """A ball at its largest angle is turned further about the axis of that angle, whose rate is the ball's velocity about it,
    in either frame: the stop gives back exactly the pressing force, as of a sum."""
    q = Stops(world).within(initial_state(world)[0], 0.1)
    balls = [
        parts
        for parts in zip(world.bodies, oracle.layout.position, oracle.layout.velocity, strict=True)
        if parts[0].joint.angle_limit is not None
    ]
    for _, at, _ in balls:
        q[at] = (1.0, 0.0, 0.0, 0.0)
    q = inside(world, q, MIDDLE)
    generator = np.random.default_rng(STATES_SEED + 400)
    for body, at, at_v in balls:
        if (most := body.joint.angle_limit or np.pi) >= np.pi:
            continue
        axis = generator.normal(size=3)
        axis /= np.linalg.norm(axis)

        def turned(angle: float, fast: Floats | None = None, at: slice = at, axis: Floats = axis) -> Floats:
            there = q.copy()
            there[at] = np.array([np.cos(angle / 2.0), *(np.sin(angle / 2.0) * axis)])
            return there

        weights = np.zeros(oracle.nv)
        weights[at_v] = axis
        before = partial(turned, most - 0.5 * WAY * most / STEPS)
        named = ("largest angle", f"bodies.{body.name}.joint.limits.angle", BALLS_CHECK)
        yield from _trials(oracle, turned(most), weights, most, before, named)


def _trials(
    oracle: Oracle,
    q: Floats,
    weights: Floats,
    span: float,
    before: Callable[[Floats], Floats],
    named: tuple[str, str, str],
) -> Iterator[LimitTrial]:
    """A force along ``weights`` (nv,) that presses on a limit at ``q``, and an arrival from half a step's way ``before`` it (of
    a velocity). Before the stop acts, damping changes that velocity by a part that the stop does not feel."""
    (limit, where, check), rest, seconds = named, np.zeros(oracle.nv), STEPS * oracle.timestep
    balance = oracle.bias_force(q, rest) - oracle.joint_effort(q, rest)
    _, unit = oracle.step(q, rest, balance + weights)
    gain = float(weights @ unit)
    pressed = balance + 2.0 * WAY * span / (seconds**2 * (gain / oracle.timestep)) * weights
    free = oracle.motion(q, rest, pressed, STEPS, STEPS)[1][-1]
    yield LimitTrial(f"pressed on its {limit}", where, q, rest, pressed, free, check)
    fast = unit * (WAY * span / seconds / gain)
    start = before(fast)
    lost = oracle.step(start, fast, balance)[1] - fast
    aside = ARRIVING * float(np.abs(lost - unit * float(weights @ lost) / gain).max())
    yield LimitTrial(f"arrives at its {limit}", where, start, fast, balance, fast, check, aside)


@derived
def _reached(world: World) -> dict[tuple[int, int], Floats]:
    """Positions at which each sum with limits (its row) stands at its upper (1) or lower (−1) one, of those that can be."""
    stops, (start, _) = Stops(world), initial_state(world)
    ranges = list(zip(range(len(stops.low)), stops.low.tolist(), stops.high.tolist(), strict=True))
    reached: dict[tuple[int, int], Floats] = {}
    for row, low, high in ranges:
        others = [entry for entry in ranges if entry[0] != row]
        for side, end in ((1, high), (-1, low)):
            q = stops.moved(start, [*others, (row, end, end)], MARGIN, _couplings(world))
            if q is not None:
                reached[row, side] = q
    return reached
