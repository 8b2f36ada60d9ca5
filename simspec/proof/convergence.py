"""Level L6 of engines that integrate by another method than semi-implicit Euler: contact-free motion in the limit of small
timesteps.

Methods differ by what vanishes with the timestep, models by what remains. An engine repeats one motion by the timesteps dt,
dt/2 and dt/4, and two checks compare it with the exact motion:

order   the ratio of its deviations at dt/2 and dt/4 is 2ᵖ, p the order of the declared method
motion  the deviation of its extrapolated motion, from which the terms dtᵖ and dtᵖ⁺¹ are eliminated

The exact motion is that of the oracle, by five timesteps down to dt/16, with the terms of first to fourth order eliminated
(Romberg's scheme). Poses are extrapolated as deviations from the finest: a vector, and the logarithm of a rotation. The
tolerance contains what the same elimination leaves of the oracle, whose method is of first order, and the round-off of the
motions.
Where dt is too coarse for that, the motions are those of dt/2, dt/4 or dt/8 and below.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simspec.dynamics.oracle import STATES_SEED, Oracle
from simspec.dynamics.stability import unstable
from simspec.engines.kit.capabilities import DOUBLE
from simspec.engines.kit.process import Operation
from simspec.proof import motion
from simspec.proof.certificate import MotionLimit
from simspec.proof.checks import LEEWAY, OTHERS, Check, Demand, Demands, MotionPlan, Part, Precision
from simspec.proof.motion import DISTURBED, FEWEST, MOTION, OracleMotion
from simspec.world.rotations import exponential, logarithm, multiply, relative
from simspec.world.types import World

ORDER: Part = ("L6", "order")
HALVES = (1, 2, 4)
"""Divisors of the timesteps by which an engine moves."""
EXACT = (1, 2, 4, 8, 16)
"""The same of the oracle."""
COARSER = (1, 2, 4, 8)
"""Divisors of the world's timestep that are tried until the motion of the oracle shows its order."""
STEPS = 500
"""Steps of the coarsest timestep at most."""
WITHIN = 0.15
"""Share by which the ratio of two deviations may be off 2ᵖ: measured at 1 ms are 1 % and less, at the floor of singles 4 %."""
EULER_WITHIN = 0.05
"""The same of the motion of the oracle, from which on the order counts as visible."""
VISIBLE = 30.0
"""Times the round-off above which a deviation shows an order: its ratio is then known to 7 %, half of ``WITHIN``."""
REMAINDER = 5e-4
"""Share of the deviation of semi-implicit Euler at the coarsest timestep that an extrapolated motion may have left: of explicit
Euler 6e-6 are left, of an engine in maximal coordinates, whose joints are corrected by a fifth of their error in each step,
1e-4 (measured, pendulums at 1 ms). The smallest damping that is planted leaves 3 times the tolerance
(docs/records/limit-proof.md)."""
ROUND_OFF = 1e-3
"""Share of the least tolerance of motion below which no deviation shows an order: in doubles 1e-12, ten times what the rounding
of an engine's 500 steps makes (1.9e-13 measured, of a free body)."""
SURE = 0.1
"""Share of the tolerance to which the exact motion has to be known."""
LOOSEST: Mapping[str, float] = {DOUBLE: 1e-6}
"""The largest tolerance in double precision; in single precision that of all motion (``Precision.loosest``). The
smallest damping that should be caught, 1e-4 N m s/rad, leaves 2.4e-6 (docs/records/limit-proof.md)."""


@dataclass(frozen=True)
class LimitMotion:
    """A beginning with its efforts, the exact poses (rows, bodies, 7), the poses of semi-implicit Euler by the coarsest
    timestep, and the tolerance. ``timesteps`` has three entries, the first of ``steps`` steps; ``noise``: the round-off of
    each; ``terms``: how many are eliminated. ``chaos`` and ``unseen``: why no motion can be compared; "" where it can."""

    begun: OracleMotion
    timesteps: tuple[float, ...]
    steps: int
    exact: np.ndarray
    common: np.ndarray
    noise: np.ndarray
    terms: int
    tolerance: float
    precision: Precision
    chaos: str = ""
    unseen: str = ""

    def operation(self, world: World) -> Operation | None:
        """The operation for an engine (see ``engines/kit/worker.py``); None where no motion can be compared."""
        if self.chaos or self.unseen:
            return None
        parameters = {"steps": self.steps, "every": self.begun.every, "timesteps": list(self.timesteps)}
        begun = self.begun
        arrays = {"q": begun.q, "v": begun.v, "effort": begun.effort, "rubbing": begun.frictional}
        return Operation("limit", parameters, arrays, world)

    def demands(self) -> Demands:
        """One comparison for each body at each instant, and one of the order."""
        count = self.exact.shape[0] * self.exact.shape[1]
        tolerance = max(LEEWAY * self.tolerance, self.precision.motion)
        return {MOTION: Demand(count, count, tolerance), ORDER: Demand(1, 1, WITHIN)}

    def checks(self, world: World, answer: Mapping[str, np.ndarray], creep: float = 0.0) -> list[Check]:
        """The checks of order and motion."""
        if self.unseen:
            return self.unmeasured()
        names = [body.name for body in world.bodies]
        shape = (len(self.timesteps), *self.exact.shape)
        poses = answer["pose"]
        if poses.shape != (shape[0] * shape[1], *shape[2:]) or not np.isfinite(poses).all():
            detail = f"poses of shape {poses.shape}, should be {(shape[0] * shape[1], *shape[2:])} and finite"
            return [Check(*MOTION, poses.size, self.tolerance, None, "", detail)]
        errors = [pose_errors(self.exact, part) for part in poses.reshape(shape)]
        left = sizes(eliminated(errors, self.precision.order, self.terms))
        row, body = np.unravel_index(int(np.argmax(left)), left.shape)
        figures = self.figures(poses)
        where = f"bodies.{names[body]}, step {row * self.begun.every}"
        found = Check(*MOTION, left.size, self.tolerance, float(left[row, body]), where, figures.text)
        return [self._order(figures), found]

    def unmeasured(self) -> list[Check]:
        """The failed check of a motion that shows no order."""
        return [Check(*ORDER, 0, WITHIN, None, "", self.unseen)] if self.unseen else []

    def figures(self, poses: np.ndarray) -> MotionLimit:
        """The figures of a certificate, of finite poses (timesteps × rows, bodies, 7)."""
        parts = poses.reshape(len(self.timesteps), *self.exact.shape)
        errors = [pose_errors(self.exact, part) for part in parts]
        deviations = tuple(float(sizes(error).max()) for error in errors)
        ratios = tuple(
            ratio(errors[index], errors[index + 1]) if deviations[index + 1] > self._visible(index + 1) else 0.0
            for index in range(len(errors) - 1)
        )
        between = pose_errors(self.common, parts[0])
        metres, radians = (float(np.linalg.norm(part, axis=-1).max()) for part in (between[..., :3], between[..., 3:]))
        return MotionLimit(
            self.precision.order,
            self.timesteps,
            deviations,
            ratios,
            float(sizes(eliminated(errors, self.precision.order, self.terms)).max()),
            (metres, radians),
            self.steps * self.timesteps[0],
        )

    def _visible(self, index: int) -> float:
        """The deviation from which on a motion shows an order."""
        return max(VISIBLE * float(self.noise[index]), ROUND_OFF * self.precision.motion)

    def _order(self, figures: MotionLimit) -> Check:
        wanted, found = 2.0**figures.order, figures.ratios[-1]
        if not found:
            detail = f"the deviation, {figures.deviations[-1]:.1e}, is below what shows an order; {figures.text}"
            return Check(*ORDER, 1, WITHIN, 0.0, "", detail)
        detail = f"deviations decrease {found:.3f} times with half the timestep, should be {wanted:g}; {figures.text}"
        return Check(*ORDER, 1, WITHIN, abs(found / wanted - 1.0), "", detail)


def pose_errors(exact: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """(…, 6): differences of position relative to the larger of 1 m and the distance from the origin, and the rotation vector
    (rad) from ``exact`` to ``poses`` (…, 7), in the axes of the former."""
    place = exact[..., :3]
    reach = np.maximum(1.0, np.linalg.norm(place, axis=-1, keepdims=True))
    away = (poses[..., :3] - place) / reach
    turned = logarithm(relative(exact[..., 3:], poses[..., 3:]))
    return np.concatenate([away, turned], axis=-1)


def with_errors(exact: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """The poses (…, 7) that differ from ``exact`` by ``errors`` (…, 6): the inverse of :func:`pose_errors`."""
    reach = np.maximum(1.0, np.linalg.norm(exact[..., :3], axis=-1, keepdims=True))
    turned = multiply(exact[..., 3:], exponential(errors[..., 3:]))
    return np.concatenate([exact[..., :3] + reach * errors[..., :3], turned], axis=-1)


def sizes(errors: np.ndarray) -> np.ndarray:
    """The size (…) of errors (…, 6): metres plus radians."""
    size: np.ndarray = np.linalg.norm(errors[..., :3], axis=-1) + np.linalg.norm(errors[..., 3:], axis=-1)
    return size


def eliminated(errors: Sequence[np.ndarray], order: int, terms: int) -> np.ndarray:
    """The errors of the finest of timesteps that halve, without the terms of ``order`` and above, as many as ``terms``."""
    for term in range(order, order + terms):
        weight = 2.0**term
        errors = [(weight * finer - coarser) / (weight - 1.0) for coarser, finer in itertools.pairwise(errors)]
    return errors[-1]


def amplified(noise: np.ndarray, order: int, terms: int) -> np.ndarray:
    """The round-off (rows,) of :func:`eliminated`, of that of each motion (timesteps, rows): independent of each other."""
    weights = eliminated(list(np.eye(len(noise))), order, terms)
    together: np.ndarray = np.sqrt((weights * weights) @ (noise * noise))
    return together


def ratio(coarser: np.ndarray, finer: np.ndarray) -> float:
    """By how many times errors decrease: Σ eᵢ fᵢ / Σ fᵢ²."""
    return float((coarser * finer).sum() / (finer * finer).sum())


def plan(world: World, oracle: Oracle, precision: Precision) -> MotionPlan:
    """The motion of a world whose engine integrates it by a method of ``precision.order``. It begins as the motion that is
    compared step by step."""
    timestep, why = world.physics.timestep, ""
    for coarser in COARSER:
        physics = dataclasses.replace(world.physics, timestep=timestep / coarser)
        finer = world if coarser == 1 else dataclasses.replace(world, physics=physics)
        begun = motion.plan(finer, oracle if finer is world else Oracle(finer), precision.of_order(0))
        if begun.steps >= FEWEST:
            tried = _Limit(begun, oracle, timestep / coarser, min(STEPS, begun.steps), precision)
            if (planned := tried.best()) is not None:
                return planned
            why = tried.why
        else:
            why = f"{begun.steps} steps of {1e3 * timestep / coarser:g} ms, should be {FEWEST} at least: {begun.ends}"
            if begun.chaos or not unstable(finer):
                break
    at = " ms, nor down to ".join(f"{1e3 * timestep / share:g}" for share in dict.fromkeys((1, coarser)))
    unseen = "" if begun.chaos else f"the order cannot be measured at {at} ms: {why}"
    nothing = np.zeros((0, len(world.bodies), 7))
    return LimitMotion(begun, (), 0, nothing, nothing, np.zeros(0), 1, precision.motion, precision, begun.chaos, unseen)


class _Limit:
    """The oracle's motions for one coarsest timestep, with as many of ``steps`` as are of use; ``why``: none are."""

    def __init__(
        self,
        begun: OracleMotion,
        oracle: Oracle,
        timestep: float,
        steps: int,
        precision: Precision,
    ):
        self.begun, self.oracle, self.timestep = begun, oracle, timestep
        self.precision = precision
        self.steps, self.why = steps // begun.every * begun.every, ""

    def best(self) -> LimitMotion | None:
        """The motion that shows a constant force best, whose effect grows with the square of time: the largest ratio of that to
        the tolerance, for either number of eliminated terms. None, where no motion shows an order."""
        euler = [self._poses(finer) for finer in EXACT]
        rows = min((_finite_rows(poses) for poses in euler), default=0)
        least = FEWEST // self.begun.every
        if rows <= least:
            self.why = "the motion diverges"
            return None
        euler = [poses[:rows] for poses in euler]
        errors = [pose_errors(euler[-1], poses) for poses in euler]
        left = eliminated(errors, 1, len(EXACT) - 1)
        unsure = _growing(sizes(left - eliminated(errors[:-1], 1, len(EXACT) - 2)))
        exact = with_errors(euler[-1], left)
        errors = [pose_errors(exact, poses) for poses in euler[: len(HALVES)]]
        noise = np.array([self._noise(euler[index], finer) for index, finer in enumerate(HALVES)])
        best: tuple[float, int, int, float] | None = None
        coarsest = _growing(sizes(errors[0]))
        for terms in (1, 2):
            remainder = REMAINDER * coarsest + OTHERS * _growing(sizes(eliminated(errors, 1, terms)))
            round_off = self.precision.factor * amplified(noise, self.precision.order, terms)
            tolerances = np.maximum(self.precision.motion, remainder + round_off)
            for row in range(least, rows):
                power, tolerance = row * row / float(tolerances[row]), float(tolerances[row])
                usable = tolerance <= LOOSEST.get(self.precision.name, self.precision.loosest)
                usable = usable and float(unsure[row]) <= SURE * tolerance
                if usable and (best is None or power > best[0]):
                    best = power, row, terms, tolerance
        if best is None:
            self.why = f"extrapolated motions of {FEWEST} steps are uncertain by {float(tolerances[least]):.1e}"
            return None
        _, row, terms, tolerance = best
        errors = [error[: row + 1] for error in errors]
        shown = ratio(*errors[-2:]) if float(sizes(errors[-1]).max()) > VISIBLE * noise[-1, row] else 2.0
        if not abs(shown / 2.0 - 1.0) <= EULER_WITHIN:
            self.why = f"deviations of semi-implicit Euler decrease {shown:.3g} times with half the timestep, in place of twice"
            return None
        timesteps = tuple(self.timestep / finer for finer in HALVES)
        parts = (exact[: row + 1], euler[0][: row + 1], noise[:, row])
        return LimitMotion(self.begun, timesteps, row * self.begun.every, *parts, terms, tolerance, self.precision)

    def _poses(self, finer: int, disturbed: int = -1) -> np.ndarray:
        begun, generator = self.begun, np.random.default_rng(STATES_SEED + 300 + max(0, disturbed))
        q, v, rounded = begun.q, begun.v, None
        if disturbed >= 0:
            q, v = (self.precision.beginning(part, generator) for part in (q, v))
            rounded = self.precision.rounding(disturbed, generator)
        with np.errstate(invalid="ignore", over="ignore"):
            states, _ = self.oracle.motion(
                q, v, begun.effort, self.steps * finer, begun.every * finer, rounded, self.timestep / finer
            )
        return np.array([self.oracle.body_poses(row) for row in states])

    def _noise(self, exact: np.ndarray, finer: int) -> np.ndarray:
        """The round-off (rows,) up to each instant of the motion ``exact`` by one timestep."""
        found = np.zeros(len(exact))
        for run in range(DISTURBED):
            found = np.maximum(found, sizes(pose_errors(exact, self._poses(finer, run)[: len(exact)])).max(axis=1))
        return np.maximum.accumulate(found)


def _growing(size: np.ndarray) -> np.ndarray:
    """The largest of sizes (rows, bodies) up to each row."""
    largest: np.ndarray = np.maximum.accumulate(size.max(axis=1, initial=0.0))
    return largest


def _finite_rows(poses: np.ndarray) -> int:
    """How many of the first poses (rows, bodies, 7) are finite."""
    finite = np.isfinite(poses).all(axis=(1, 2))
    return len(finite) if finite.all() else int(np.argmin(finite))
