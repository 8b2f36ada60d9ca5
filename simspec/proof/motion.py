"""Level L6: contact-free motion, step by step, against the oracle's semi-implicit Euler.

The tolerance is the larger of 1e-9 and 100 × the scenario's own round-off floor: the oracle run again several times, its
beginning changed in the last bits (of engines in single precision: ``proof/checks.py``). Below that floor no two programs
can agree, whatever they hold; it is printed next to the deviation. Motion is compared as far as the floor is low enough for
the tolerance to mean something.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simspec.dynamics.oracle import STATES_SEED, Oracle, random_states, shortened
from simspec.dynamics.stability import unstable
from simspec.engines.kit.capabilities import DOUBLE, ROUNDING
from simspec.engines.kit.process import Operation
from simspec.language.vocabulary import QUATERNION_JOINTS, SCALAR_JOINTS
from simspec.proof.checks import LEEWAY, PRECISIONS, TOO_CHAOTIC, Check, Demand, Demands, Part, Precision, Rounded
from simspec.proof.limits import CALM, MIDDLE, Stops, calmed, followers, inside, left_to
from simspec.world.frames import vector3
from simspec.world.kinematics import frictional_coordinates, initial_state
from simspec.world.rotations import rotation_error
from simspec.world.types import FollowConstraint, RecordOptions, World

# Where a mechanism rests: beginnings of motions that are too chaotic from anywhere else.

RESTING_STEPS = 2000
"""Steps in which a mechanism falls to rest: a chain of 200 links of 5 cm that begins at 1 rad comes within 0.3 rad, from where
a motion of 2,000 steps is followed (measured)."""
RESTING_WORK = 400_000
"""Coordinates × steps: of larger worlds as many steps as that allows."""
INSIDE = 0.1
"""Share of its range by which a joint has to be inside its limits at the beginning; otherwise it begins in their middle."""
NEAR = 0.05
"""Share of its range to a limit from which on a joint, a ball or a sum is near it: later instants are not compared."""


def at_rest(world: World, oracle: Oracle, near_limits: Callable[[np.ndarray], bool]) -> np.ndarray:
    """A position (nq,) near the world's initial one where its springs and weights balance, or that is on the way there.

    The motion from rest is followed, and stopped whenever its kinetic energy falls: it then passes a lowest point of the
    potential on its way. It ends where ``near_limits`` says that a joint comes near a limit.
    """
    start, _ = initial_state(world)
    q = start.copy()
    for body, at in zip(world.bodies, oracle.layout.position, strict=True):
        if (limits := body.joint.position_limits) is not None and not _well_inside(float(start[at][0]), *limits):
            q[at] = sum(limits) / 2.0
    if world.constraints:
        q = oracle.inwards(oracle.settled(q, start))
    rest = np.zeros(oracle.nv)
    v, best, energy = rest, q, 0.0
    for _ in range(min(RESTING_STEPS, RESTING_WORK // max(1, oracle.nv))):
        q, v = oracle.step(q, v, rest)
        if not np.isfinite(q).all() or near_limits(q):
            return best
        best = q
        kinetic, _ = oracle.energy(q, v)
        if kinetic < energy:
            v, kinetic = rest, 0.0
        energy = kinetic
    return best


STEPS = 2000
WORK = 2_600_000
"""Coordinates × steps: of larger worlds as many steps as that allows (216 free bodies: all), and ``FEWEST`` at least. More
bodies do not make each one's motion harder to tell."""
EVERY, LOOK = 40, 10
"""Steps between two instants that are compared; the second where there are few, and when a beginning is tried."""
SECONDS = 2.0
"""Time in which motion comes as far as it should: a body that falls for 8 s, as in 2,000 steps of 4 ms, is 300 m away at 80
m/s, where the round-off of one engine is a hundred times the others' (measured)."""
LARGEST_TURN = 0.25
"""rad in a step up to which motion is compared: a faster turn is not resolved by the timestep at all, and one engine
turns nothing by more than π/4 in a step (measured, at the end of motions that diverge)."""
LARGEST_SLIDE = 3.0
"""m from the beginning up to which a slide is followed: one without limits is flung out without end, and at 100 m the mass
matrix is so uneven that one step is off by 1e-10 to 1e-8, by the engine (measured)."""
DISTURBED = 4
"""Disturbed runs: the floor of one alone is off by up to a factor of 15 (measured)."""
TRIES = 6
"""Seeded beginnings to try until one keeps all joints off their limits for all steps; the longest is taken."""
BALANCED = 2
"""The first of those tries in which the weight is held up."""
GENTLE = 0.2
"""Share of speeds and efforts in those."""
GENTLER = (0.04, 0.008, 1e-4, 1e-6)
"""The same in more tries, where none so far keeps off the limits: the first two to come further, the others to come far enough
at all where a range is a hair's breadth."""
NEARLY = 0.8
"""Share of the planned comparisons of a motion that ends where round-off grows too large."""
MOTION: Part = ("L6", "motion")
ROUND_OFF = "then round-off alone"
"""How the reason begins for which a motion ends whose floor grows too large."""
FROM_REST = (GENTLE, *GENTLER)
"""The same in the last tries, which begin where the mechanism rests: about a stable rest small motions stay small. A chain of
200 hinges that hangs is followed for 2,000 steps with 1e-4, and for 80 with 0.04 (measured)."""
GROWN = 1e3
"""Times the way to which initial speeds and accelerations lead. Joints of the library's robots come to 23 times, the links of
a chain that stands on its end to 1e5 and more (measured)."""
FEWEST = 100
"""Steps below which motion proves nothing: in 100 of 1 ms an acceleration that is off by 2e-7 m/s², which is what the smallest
slip of a digit in printing makes of gravity, moves a body by the tolerance; where limits allow fewer, the check fails."""


@dataclass(frozen=True)
class OracleMotion:
    """A beginning and its efforts (``q``, ``v``, ``effort``, ``steps``), the oracle's poses, and their round-off floor."""

    q: np.ndarray
    v: np.ndarray
    effort: np.ndarray
    steps: int
    every: int
    poses: np.ndarray
    floor: float
    frictional: np.ndarray
    """Places in v of the joints whose dry friction is taken away: it has a probe of its own."""
    ends: str = ""
    """Why there are fewer steps than were wanted."""
    precision: Precision = PRECISIONS[DOUBLE]
    unsteady: bool = False
    """Whether round-off, or a speed that grew without bound from a gentle beginning, is why, and not a limit of a joint."""

    @property
    def chaos(self) -> str:
        """Why this motion cannot be compared in any engine; "" where it can, or where something else is wrong with it."""
        if self.steps >= FEWEST or not self.unsteady:
            return ""
        return (
            f"{TOO_CHAOTIC}: from every beginning that was tried, with speeds down to {GENTLER[-1]:g} of "
            f"the usual ones and from rest, it can be followed for {self.steps} steps, and {FEWEST} are needed; {self.ends}"
        )

    @property
    def tolerance(self) -> float:
        """The larger of 1e-9 and 100 × the floor, in double precision."""
        return self.precision.tolerance(self.floor)

    def operation(self, world: World) -> Operation | None:
        """The operation for an engine (see ``engines/kit/worker.py``); None where no motion can be compared."""
        arrays = {"q": self.q, "v": self.v, "effort": self.effort, "rubbing": self.frictional}
        return None if self.chaos else Operation("motion", {"steps": self.steps, "every": self.every}, arrays, world)

    def demands(self) -> Demands:
        """Fewer comparisons are enough where round-off ends the motion: that instant is another on another machine."""
        rows, bodies = self.poses.shape[:2]
        least = int(NEARLY * rows) if self.ends.startswith(ROUND_OFF) else rows
        tolerance = min(self.precision.tolerance(LEEWAY * self.floor), self.precision.loosest)
        return {MOTION: Demand(rows * bodies, least * bodies, tolerance)}

    def checks(self, world: World, answer: Mapping[str, np.ndarray], creep: float = 0.0) -> list[Check]:
        """One check: the worst deviation of any body at any instant."""
        detail = f"floor {self.floor:.1e}, {self.steps} steps of {world.physics.timestep:g} s"
        detail += f" ({self.ends})" if self.ends else ""
        if len(self.frictional):
            detail += f", dry friction of {len(self.frictional)} joints switched off"
        if self.steps < FEWEST:
            detail = f"{self.steps} steps, should be {FEWEST} at least: {self.ends}; {detail}"
            return [Check(*MOTION, 0, self.tolerance, None, "", detail)]
        names = [body.name for body in world.bodies]
        rows = [min(row * self.every, self.steps) for row in range(len(self.poses))]
        return [pose_check(MOTION, names, rows, self.poses, answer["pose"], self.tolerance, detail)]


def pose_check(
    part: Part,
    names: Sequence[str],
    steps: Sequence[int],
    expected: np.ndarray,
    actual: np.ndarray,
    tolerance: float,
    detail: str,
) -> Check:
    """The worst deviation of any body (``names``) after any of ``steps``: poses (steps, bodies, 7)."""
    if actual.shape != expected.shape or not np.isfinite(actual).all():
        detail = f"poses of shape {actual.shape}, should be {expected.shape} and finite; {detail}"
        return Check(*part, actual.size, tolerance, None, "", detail)
    error = deviation(expected, actual)
    row, body = divmod(int(np.argmax(error)), error.shape[1])
    where = f"bodies.{names[body]}, step {steps[row]}"
    return Check(*part, error.size, tolerance, float(error[row, body]), where, detail)


KEPT = 24
"""Motions that a process keeps: those of the worlds of a self-test, or of a sweep that changes an engine's settings."""
_kept: dict[tuple[World, Precision], OracleMotion] = {}


def plan(world: World, oracle: Oracle, precision: Precision = PRECISIONS[DOUBLE]) -> OracleMotion:
    """Choose a beginning that stays off the limits, run the oracle, and run it again disturbed in the last bits.

    Motion is compared up to the instant at which the tolerance would become larger than ``precision.loosest``: a chaotic world
    multiplies the last bit without end, and within 0.1 m and rad everything agrees.

    Worlds that differ in nothing but their name, what is recorded and expected, and engines' options share a motion, whose
    arrays are not to be changed: it takes seconds, and comparing worlds milliseconds.
    """
    if not all(isinstance(constraint, FollowConstraint) for constraint in world.constraints):
        precision = precision.of_loops()
    same = dataclasses.replace(world, name="", record=RecordOptions(), expectations=(), engines=(), frames=())
    known = _kept.get((same, precision))
    if known is None:
        known = _Planning(world, oracle, precision).motion()
        if len(_kept) >= KEPT:
            _kept.pop(next(iter(_kept)), None)
        _kept[same, precision] = known
    return known


@dataclass(frozen=True)
class _Beginning:
    """A beginning, how many steps can be compared from there on as far as the oracle knows, and why not more."""

    q: np.ndarray
    v: np.ndarray
    effort: np.ndarray
    steps: int
    ends: str
    states: np.ndarray
    """The oracle's, every ``LOOK`` steps, and after the last."""
    unsteady: bool
    """Whether it ends since something turns too fast, or after it has grown by itself."""


class _Planning:
    """The choice of a motion. ``most``: steps at most; ``slower``: the share of speeds in motions that are longer than
    ``SECONDS``."""

    def __init__(self, world: World, oracle: Oracle, precision: Precision):
        self.world, self.oracle, self.precision, self.stops = world, oracle, precision, Stops(world)
        self.most = min(STEPS, max(FEWEST, WORK // max(1, oracle.nv)))
        self.slower = min(1.0, SECONDS / (self.most * world.physics.timestep))
        self.start, _ = initial_state(world)

    def motion(self) -> OracleMotion:
        best = self._tried(*self._beginning(0))
        for attempt in range(1, TRIES + len(GENTLER)):
            if best.steps == self.most or (best.steps >= FEWEST and attempt > TRIES + 1):
                break
            best = max(best, self._tried(*self._beginning(attempt)), key=lambda begun: begun.steps)
        planned = self._planned(best)
        for attempt in range(BALANCED, TRIES + len(GENTLER)):
            if planned.steps >= FEWEST or unstable(self.world):
                return planned  # enough, or nothing gentler helps
            gentler = self._planned(self._tried(*self._beginning(attempt)))
            planned = max(planned, gentler, key=lambda trial: trial.steps)
        return planned if planned.steps >= FEWEST or unstable(self.world) else self._from_rest(planned)

    def _from_rest(self, planned: OracleMotion) -> OracleMotion:
        """The motion of ``FROM_REST`` that is followed for enough steps, or the longest; ``planned`` where none is longer."""
        rest = at_rest(self.world, self.oracle, lambda q: bool(self.stops.near(q[None], NEAR).any()))
        v = self.slower * random_states(self.world, 1, STATES_SEED + 1, speed=0.5)[1][0]
        v = self.oracle.constrained_velocity(rest, v) if self.world.constraints else v
        push, balance = self._push(rest, 0), self._balance(rest)
        for share in FROM_REST:
            trial = self._planned(self._tried(rest, share * v, balance + share * push))
            planned = max(planned, trial, key=lambda motion: motion.steps)
            if planned.steps >= FEWEST:
                break
        return planned

    def _planned(self, begun: _Beginning) -> OracleMotion:
        """The oracle's motion from a beginning, with its floor, as far as that can be used."""
        precision, steps, ends, unsteady = self.precision, begun.steps, begun.ends, begun.unsteady
        every = EVERY if steps >= 10 * EVERY else LOOK
        rows = [min(done, steps) for done in range(0, steps + every, every)]
        exact = self._poses(begun.states[[-(-row // LOOK) for row in rows]])
        floors = np.zeros(len(exact))
        generator, directions = (np.random.default_rng(STATES_SEED + seed) for seed in (200, 300))
        for run in range(DISTURBED):
            oracle = self._tilted(directions)
            q, v = precision.beginning(begun.q, generator), precision.beginning(begun.v, generator)
            rounded = precision.rounding(run, generator)
            disturbed = self._poses(self._run(q, v, begun.effort, steps, every, rounded, oracle)[0])
            with np.errstate(invalid="ignore", over="ignore"):
                deviations = deviation(exact, disturbed).max(axis=1, initial=0.0)
            floors = np.maximum(floors, np.where(np.isfinite(deviations), deviations, np.inf))
        floors = np.maximum.accumulate(floors)
        useful = precision.factor * floors <= precision.loosest
        last = len(floors) - 1
        if not useful.all():
            last = max(0, int(np.argmin(useful)) - 1)
            steps, unsteady = last * every, True
            ends = f"{ROUND_OFF} would move bodies by {precision.loosest / precision.factor:.0e}"
        if steps < FEWEST and (diverging := unstable(self.world)):
            ends = f"then it diverges: {diverging[0]}; stable up to {diverging[0].largest_stable_step:.3g} s"
            unsteady = False
        values = frictional_coordinates(self.world)
        poses, floor = exact[: last + 1], float(floors[last])
        return OracleMotion(
            begun.q, begun.v, begun.effort, steps, every, poses, floor, values, ends, precision, unsteady
        )

    def _tried(self, q: np.ndarray, v: np.ndarray, effort: np.ndarray) -> _Beginning:
        """How far the oracle comes from a beginning, looked at every ``LOOK`` steps: until a joint comes near a limit, or turns
        or slides too far."""
        states, speeds = self._run(q, v, effort, self.most, LOOK)
        turned = f"then something turns by more than {LARGEST_TURN:g} rad in a step"
        reasons = {
            "then a joint comes near a limit": self.stops.near(states, NEAR),
            turned: ~(self._turns(speeds) <= LARGEST_TURN),
            f"then something slides more than {LARGEST_SLIDE:g} m away": ~(self._slides(states) <= LARGEST_SLIDE),
        }
        ends, steps = "", self.most
        for why, bad in reasons.items():
            if bad.any() and (until := max(0, int(np.argmax(bad)) - 1) * LOOK) < steps:
                ends, steps = why, until
        unsteady = ends == turned or (bool(ends) and self._grows(states, v, effort))
        return _Beginning(q, v, effort, steps, ends, states, unsteady)

    def _places(self, *kinds: str) -> list[int]:
        """Where in q the joints of some kinds begin."""
        parts = zip(self.world.bodies, self.oracle.layout.position, strict=True)
        return [at.start for body, at in parts if body.joint.kind in kinds]

    def _grows(self, states: np.ndarray, v: np.ndarray, effort: np.ndarray) -> bool:
        """Whether a joint goes ``GROWN`` times as far as the speeds and accelerations at the beginning take the fastest: the
        motion then grows by itself, as that of a mechanism that stands on its end does, and with it every disturbance."""
        places = self._places(*SCALAR_JOINTS)
        if not places:
            return False
        start, first = float(np.abs(v).max()), float(np.abs(self.oracle.acceleration(states[0], v, effort)).max())
        time = np.arange(len(states)) * LOOK * self.world.physics.timestep
        with np.errstate(invalid="ignore", over="ignore"):
            gone = np.abs(states[:, places] - states[0, places]).max(axis=1)
            return bool((gone > GROWN * (start * time + 0.5 * first * time * time)).any())

    def _slides(self, states: np.ndarray) -> np.ndarray:
        """How far (instants,) the slide that went farthest is from where it began; NaN where motion diverged."""
        index = self._places("slide")
        places = states[:, index]
        farthest: np.ndarray = np.abs(places - places[0]).max(axis=1, initial=0.0)
        return farthest

    def _turns(self, speeds: np.ndarray) -> np.ndarray:
        """The largest angle (instants,) by which a joint turns in a step; NaN where motion has diverged."""
        angles = np.zeros(len(speeds))
        for body, part in zip(self.world.bodies, self.oracle.layout.velocity, strict=True):
            if body.joint.kind in ("hinge", *QUATERNION_JOINTS):
                turning = speeds[:, part][:, -3:]
                with np.errstate(invalid="ignore", over="ignore"):
                    angles = np.maximum(angles, np.sqrt((turning * turning).sum(axis=1)))
        return angles * self.world.physics.timestep

    def _beginning(self, attempt: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joints with limits start in the middle of their range, the rest anywhere; speeds and efforts are gentle.

        Efforts give about 1 m/s² or rad/s² to each coordinate alone, so that light and heavy bodies move alike. From
        ``BALANCED`` on they also carry the weight and the springs of where they start, and all else is gentler: falling reaches
        limits soonest. In longer motions than ``SECONDS`` everything is as much slower, and free roots are held up as far as
        that takes, so that all come as far as in that time.
        """
        world, oracle, slower = self.world, self.oracle, self.slower
        q, v = (states[0] for states in random_states(world, 1, STATES_SEED + 1 + attempt, speed=0.5))
        for body, at_q, at_v in zip(world.bodies, oracle.layout.position, oracle.layout.velocity, strict=True):
            limits = body.joint.position_limits
            if body.joint.angle_limit is not None:
                q[at_q] = shortened(q[at_q], 0.5)
                v[at_v] *= min(1.0, 0.2 * body.joint.angle_limit)
            if limits is not None:
                # the world's start where it is well inside, since that is where its motion is meant to happen
                start = float(self.start[at_q][0])
                q[at_q] = start if _well_inside(start, *limits) and attempt % 2 == 0 else sum(limits) / 2
                v[at_v] *= min(1.0, 0.2 * (limits[1] - limits[0]))
        if any(total.position_limits for total in world.sums):
            q, v = inside(world, q, MIDDLE), calmed(world, v, CALM)
        if world.constraints:  # constrained joints begin there, and move so
            couple(world, oracle, q, self.start)
            q = oracle.inwards(oracle.settled(q, self.start))
            v = oracle.constrained_velocity(q, v)
        effort = self._push(q, attempt)
        v *= slower
        if attempt < BALANCED:
            weight = oracle.bias_force(q, np.zeros(oracle.nv))
            for body, at_v in zip(world.bodies, oracle.layout.velocity, strict=True):
                if body.joint.kind == "free":
                    effort[at_v][:3] += (1.0 - slower**2) * weight[at_v][:3]
            return q, v, effort
        gentle = GENTLE if attempt < TRIES else GENTLER[attempt - TRIES]
        return q, gentle * v, self._balance(q) + gentle * effort

    def _push(self, q: np.ndarray, attempt: int) -> np.ndarray:
        """Seeded efforts (nv,) that give about 1 m/s² or rad/s² to each coordinate alone, in longer motions less."""
        diagonal = np.zeros(self.oracle.nv)
        for block, mass in zip(self.oracle.blocks, self.oracle.mass_blocks(q), strict=True):
            diagonal[block] = np.diag(mass)
        generator = np.random.default_rng(STATES_SEED + 100 + attempt)
        effort: np.ndarray = self.slower**2 * generator.uniform(-1.0, 1.0, self.oracle.nv) * diagonal
        return effort

    def _balance(self, q: np.ndarray) -> np.ndarray:
        """The efforts (nv,) that carry the weight and the springs at a position."""
        rest = np.zeros(self.oracle.nv)
        weight: np.ndarray = self.oracle.bias_force(q, rest) - self.oracle.joint_effort(q, rest)
        return weight

    def _tilted(self, directions: np.random.Generator) -> Oracle | None:
        """In single precision an oracle whose gravity is off by one rounding in a random direction. An engine rounds the
        directions of its links, and with them those of all weights, for the whole motion; the error of a velocity then grows
        with the timestep, which that of a state that is rounded after every step does not."""
        if self.precision.perturbation:
            return None
        away = directions.normal(size=3)
        physics = self.world.physics
        off = ROUNDING[self.precision.name] * np.linalg.norm(physics.gravity) * away / np.linalg.norm(away)
        gravity = vector3((np.array(physics.gravity) + off).tolist())
        return Oracle(dataclasses.replace(self.world, physics=dataclasses.replace(physics, gravity=gravity)))

    def _run(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        steps: int,
        every: int,
        rounded: Rounded | None = None,
        oracle: Oracle | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The states of an oracle (None: the exact one) at every ``every``-th step; not finite where the motion diverges."""
        with np.errstate(invalid="ignore", over="ignore"):
            return (oracle or self.oracle).motion(q, v, effort, steps, every, rounded)

    def _poses(self, states: np.ndarray) -> np.ndarray:
        return np.array([self.oracle.body_poses(row) for row in states])


def _well_inside(position: float, low: float, high: float) -> bool:
    margin = INSIDE * (high - low)
    return low + margin < position < high - margin


def couple(world: World, oracle: Oracle, q: np.ndarray, start: np.ndarray) -> None:
    """Put joints that follow others where these put them, in the middle of what the limits of all of them leave, in ``q``."""
    parts = zip(world.bodies, oracle.layout.position, strict=True)
    joints = {body.joint.name: (at.start, body.joint.position_limits) for body, at in parts}
    limits = {name: ends for name, (_, ends) in joints.items()}
    for first, chain in followers(world).items():
        low, high = left_to(chain, limits)
        at = joints[first][0]
        if np.isfinite(high - low) and not _well_inside(float(q[at]), low, high):
            begun = float(start[at])
            q[at] = begun if _well_inside(begun, low, high) else (low + high) / 2
        for name, ratio, offset in chain:
            q[joints[name][0]] = ratio * q[at] + offset


def deviation(expected: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """Per instant and body (n, bodies): metres relative to the larger of 1 m and the body's distance from the origin,
    plus radians."""
    reach = np.maximum(1.0, np.linalg.norm(expected[..., :3], axis=-1))
    away = np.linalg.norm(actual[..., :3] - expected[..., :3], axis=-1) / reach
    error: np.ndarray = away + rotation_error(actual[..., 3:], expected[..., 3:])
    return error
