"""Level L7 of worlds with forces on bodies and with kinematic bodies: their effect on motion, in every engine, without contact.

Every body begins at rest, held against its weight, and the world's own forces act soon after, each for a while, with what share
of a step they begin and end by in the world. The oracle has them by its own Jacobians. The tolerance is L6's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from simspec.control.request import brought_forward, curve, forces_to_request, in_steps, motions_to_request
from simspec.dynamics.oracle import STATES_SEED, Oracle, random_states
from simspec.engines.kit.capabilities import DOUBLE, ROUNDING
from simspec.engines.kit.process import Operation
from simspec.proof.checks import LEEWAY, OTHERS, PRECISIONS, Check, Demand, Demands, Precision, Rounded, Tally
from simspec.proof.limits import MIDDLE, Stops, inside
from simspec.proof.motion import DISTURBED, NEAR, couple, deviation, pose_check
from simspec.world.actions import Force
from simspec.world.frames import vector3
from simspec.world.kinematics import frictional_coordinates, initial_state
from simspec.world.types import World

Floats = NDArray[np.float64]
FORCES_CHECK = "applied forces"
STEPS, EVERY = 100, 5
FIRST, LONGEST = 3, 60
"""The step in which the earliest force begins, and for how many steps a force acts at most."""
HALVINGS = 40
"""How often the forces are halved until no joint comes near a limit."""
INSIDE = 0.2
"""Share of its range that a joint begins away from its limits."""


@dataclass(frozen=True)
class Pushed:
    """A beginning (``q``, ``v``, ``effort``) of a ``world`` with its forces brought forward, and the expected ``poses`` at
    every ``EVERY``-th step, by the oracle with its round-off ``floor``."""

    world: World
    q: Floats
    v: Floats
    effort: Floats
    poses: Floats
    floor: float
    halved: int
    ends: str = ""
    """Why nothing can be compared."""
    precision: Precision = PRECISIONS[DOUBLE]
    spread: float = 0.0
    """How far another method of integration may deviate; 0: none is declared."""

    @property
    def tolerance(self) -> float:
        """That of L6."""
        return max(self.precision.tolerance(self.floor), self.spread)

    def operation(self, world: World) -> Operation:
        """The operation for an engine (see ``engines/kit/worker.py``)."""
        arrays = {"q": self.q, "v": self.v, "effort": self.effort, "rubbing": frictional_coordinates(self.world)}
        return Operation("pushed", {**forces_to_request(self.world), "steps": STEPS, "every": EVERY}, arrays, world)

    def demands(self) -> Demands:
        """One comparison for each body at each instant."""
        count = int(np.prod(self.poses.shape[:2]))
        tolerance = max(self.precision.tolerance(LEEWAY * self.floor), self.spread)
        return {("L7", FORCES_CHECK): Demand(count, count, tolerance)}

    def checks(self, world: World, answer: Mapping[str, Floats], creep: float = 0.0) -> list[Check]:
        """One check: the worst deviation of any body at any instant."""
        detail = f"floor {self.floor:.1e}, {STEPS} steps of {self.world.physics.timestep:g} s"
        if self.halved:
            detail += f", forces divided by 2^{self.halved}, with which no joint comes near a limit"
        part, names = ("L7", FORCES_CHECK), [body.name for body in self.world.bodies]
        if self.ends:
            return [Check(*part, 0, self.tolerance, None, "", f"{self.ends}; {detail}")]
        steps = range(0, STEPS + 1, EVERY)
        return [pose_check(part, names, steps, self.poses, answer["pose"], self.tolerance, detail)]


def plan(world: World, oracle: Oracle, precision: Precision = PRECISIONS[DOUBLE]) -> Pushed | None:
    """The probe of a world's forces; None where it has none."""
    if not world.forces:
        return None
    start, v = initial_state(world)
    v, stops = np.zeros_like(v), Stops(world)
    q = oracle.inwards(oracle.settled(inside(world, stops.within(start, INSIDE), INSIDE), start))
    effort = oracle.bias_force(q, v) - oracle.joint_effort(q, v)
    forces = brought_forward(world.forces, world.physics.timestep, FIRST, LONGEST)
    ends = "its motion without forces comes near a limit, or is not finite"
    for halved in range(HALVINGS):
        weaker = replace(world, forces=tuple(_times(0.5**halved, force) for force in forces))
        states = _motion(weaker, oracle, q, v, effort)
        if np.isfinite(states).all() and not stops.near(states, NEAR).any():
            ends = ""
            break
    poses = np.array([oracle.body_poses(row) for row in states])
    generator, floor = np.random.default_rng(STATES_SEED + 300), 0.0
    for run in range(DISTURBED):
        off, rounded = precision.beginning(q, generator), precision.rounding(run, generator)
        other = np.array([oracle.body_poses(row) for row in _motion(weaker, oracle, off, v, effort, rounded)])
        floor = max(floor, float(deviation(poses, other).max(initial=0.0)))
    spread = 0.0
    if precision.order:
        finer = np.array([oracle.body_poses(row) for row in _motion(weaker, oracle, q, v, effort, halves=2)])
        spread = OTHERS * float(deviation(finer, poses).max(initial=0.0))
    numbers = (floor if np.isfinite(floor) else 0.0, halved, ends, precision, spread)
    return Pushed(weaker, q, v, effort, poses, *numbers)


def _times(factor: float, force: Force) -> Force:
    forces, torques = (vector3(factor * value for value in vector) for vector in (force.force, force.torque))
    return replace(force, force=forces, torque=torques)


def _motion(
    world: World,
    oracle: Oracle,
    q: Floats,
    v: Floats,
    effort: Floats,
    rounded: Rounded | None = None,
    halves: int = 1,
) -> Floats:
    """The oracle's positions (n, nq) at every ``EVERY``-th step, the beginning first; by ``halves`` as many shorter steps."""
    rows, dt = [q], world.physics.timestep / halves
    for step in range(halves * STEPS):
        total = effort.copy()
        for force in world.forces:
            first = in_steps(force.start, dt)
            last = np.inf if force.until is None else in_steps(force.until, dt)
            share = min(last, step + 1.0) - max(first, float(step))
            if share > 0.0:
                total += min(share, 1.0) * oracle.effort_of(q, force)
        (_, q), (_, v) = oracle.motion(q, v, total, 1, 1, timestep=dt)
        if rounded is not None:
            q, v = rounded(q), rounded(v)
        if (step + 1) % (halves * EVERY) == 0:
            rows.append(q)
    return np.array(rows)


PRESCRIBED_CHECK = "prescribed motion"
MOVED = 100
"""Steps in which all motions are done: slower ones are made quicker for the engine."""


@dataclass(frozen=True)
class Followed:
    """A ``world`` with quick motions, and where its kinematic bodies (``names``) must be after every step (rows, bodies, 7)."""

    world: World
    names: tuple[str, ...]
    poses: Floats
    precision: Precision = PRECISIONS[DOUBLE]

    def operation(self, world: World) -> Operation:
        """The operation for an engine: all bodies begin where the world's do, at rest."""
        q, v = initial_state(self.world)
        parameters, motions = motions_to_request(self.world)
        rest = np.zeros_like(v)
        arrays = {**motions, "q": q, "v": rest, "effort": rest, "rubbing": frictional_coordinates(self.world)}
        return Operation("prescribed", {**parameters, "steps": MOVED, "every": 1}, arrays, world)

    def demands(self) -> Demands:
        """One comparison for each kinematic body after each step."""
        count = int(np.prod(self.poses.shape[:2]))
        return {("L7", PRESCRIBED_CHECK): Demand(count, count, self.precision.motion)}

    def checks(self, world: World, answer: Mapping[str, Floats], creep: float = 0.0) -> list[Check]:
        """One check: the worst deviation of a kinematic body from its motion, after any step."""
        rows = {body.name: row for row, body in enumerate(self.world.bodies)}
        pose, steps = answer["pose"][:, [rows[name] for name in self.names]], range(MOVED + 1)
        detail, tolerance = f"{MOVED} steps of {self.world.physics.timestep:g} s", self.precision.motion
        return [pose_check(("L7", PRESCRIBED_CHECK), self.names, steps, self.poses, pose, tolerance, detail)]


def plan_motions(world: World, oracle: Oracle, precision: Precision = PRECISIONS[DOUBLE]) -> Followed | None:
    """The probe of a world's kinematic bodies; None where it has none."""
    if not world.motions:
        return None
    times = np.arange(MOVED + 1) * world.physics.timestep
    shares = (min(1.0, times[-1] / motion.times[-1]) if motion.times[-1] else 1.0 for motion in world.motions)
    quick = tuple(
        replace(motion, times=tuple(share * time for time in motion.times))
        for motion, share in zip(world.motions, map(float, shares), strict=True)
    )
    faster = replace(world, motions=quick, forces=(), controllers=(), trajectory=None)
    poses = np.stack([np.concatenate(curve(motion).at(times), axis=1) for motion in quick], axis=1)
    return Followed(faster, tuple(motion.body for motion in quick), poses, precision)


# Dry friction in joints and along sums of their positions, measured against closed forms (level L6, alongside the motion, for
# which it is switched off).
#
# A joint that slides is braked by f against its velocity, whatever that is; one at rest stays there while the effort that is
# left for it is below f. Efforts are chosen by the oracle's M and h so that each joint with friction has a wanted
# acceleration, all others none; then what must come is a motion under constant efforts, which the oracle has:
#
#     M a + h + f sign(v) = τ    a joint slides, to both sides, gaining speed, losing it, and from rest     a = 0
# a joint at rest is held, just below f, to both sides
#
# So nothing sticks that should slide within a probe, and no law of stick and slip is needed in addition to the engine's.

LEVEL = "L6"
SLIDING_CHECK, REST_CHECK = "dry friction, sliding", "dry friction, at rest"
FRICTION_STEPS = (20, 10, 5, 2, 1)
"""Steps of one trial: as many of these as keep all joints sliding that should; one step always does."""
SLIDING, BELOW = 0.5, 0.99
"""Acceleration of a joint that slides, in units of what its own friction could give it, and the share of f that must not move
one at rest."""
SLIDES = 1e-4
"""Of the acceleration that its own friction gives a joint: one that constraints let slide less, as of an arm whose hand is
welded to the world, is not compared as it slides. Soft friction holds it, which does not matter to the others."""
RANGE, REACH = 0.05, 0.01
"""Largest share of a joint's range, and rad or m, that a trial may cross: efforts are right where it begins. A single step may
cross more than ``REACH``: the effect of friction on a speed is settled before anything moves."""
SLIDE_TOLERANCE = 1e-8
"""Of the speed that f alone gives in a trial: where all joints slide, friction is a constant effort, held to round-off (largest
measured in 16 × 36 arms of 0.5 to 16 ms and f of 2e-3 to 20 N m: 5e-11)."""
HOLD_TOLERANCE = 2e-3
"""Of the same speed, at rest: friction is then a constraint, soft in some engines and solved in part by iterative solvers
(largest measured in the same: 3.8e-4). A fifth of what f off by 1 % makes."""


@dataclass(frozen=True)
class ForceTrial:
    """One beginning (``q``, ``v``, ``effort``), and the velocities (nv,) that must have come after ``steps``; ``name`` says
    what is tried, ``tolerance`` how near they must be, in units of what a joint's friction alone makes of its speed."""

    name: str
    q: np.ndarray
    v: np.ndarray
    effort: np.ndarray
    steps: int
    expected: np.ndarray
    tolerance: float
    slides: bool = True
    along: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """The way (nv,) of joints that slide."""
    floored: bool = False
    """Whether the tolerance follows from a round-off floor."""

    @property
    def check(self) -> str:
        """Name of its check."""
        return SLIDING_CHECK if self.slides else REST_CHECK


@dataclass(frozen=True)
class DryFriction:
    """The trials of a world, the places in v of its joints with dry friction, and the accelerations (joints,) that their
    friction alone gives them."""

    trials: tuple[ForceTrial, ...]
    places: np.ndarray
    strength: np.ndarray

    def compared(self, trial: ForceTrial) -> np.ndarray:
        """Which of the joints are compared in a trial (joints,): those that slide, or all where constraints hold every one."""
        if not trial.slides:
            return np.ones(len(self.places), dtype=bool)
        found: np.ndarray = np.abs(trial.along[self.places]) >= SLIDES * self.strength
        return found if found.any() else np.ones(len(self.places), dtype=bool)

    def operation(self, world: World) -> Operation:
        """The operation for an engine (see ``engines/kit/worker.py``)."""
        arrays = {name: np.array([getattr(trial, name) for trial in self.trials]) for name in ("q", "v", "effort")}
        return Operation("trials", {"steps": [trial.steps for trial in self.trials]}, arrays, world)

    def demands(self) -> Demands:
        """One comparison for each joint that is compared in a trial."""
        demands: Demands = {}
        for trial in self.trials:
            part = (LEVEL, trial.check)
            count = int(self.compared(trial).sum()) + (demands[part].count if part in demands else 0)
            demands[part] = Demand(count, count, trial.tolerance * (LEEWAY if trial.floored else 1.0))
        return demands

    def checks(self, world: World, answer: Mapping[str, np.ndarray], creep: float = 0.0) -> list[Check]:
        """One check for joints that slide and one for joints at rest."""
        tally = Tally()
        every = [body.joint.name for body in world.bodies for _ in body.joint.velocity]
        for trial, speeds in zip(self.trials, answer["v"][:, self.places], strict=True):
            expected = trial.expected[self.places]
            scale = self.strength * trial.steps * world.physics.timestep + creep / trial.tolerance
            shares = np.abs(speeds - expected) / scale
            for joint in np.flatnonzero(self.compared(trial)):
                detail = f"{trial.name}: {speeds[joint]:.6g} after {trial.steps} steps, should be {expected[joint]:.6g}"
                where = f"joints.{every[self.places[joint]]}"
                tally.add(LEVEL, trial.check, trial.tolerance, float(shares[joint]), where, detail)
        return tally.checks()


def plan_friction(world: World, oracle: Oracle, precision: Precision = PRECISIONS[DOUBLE]) -> DryFriction | None:
    """The trials; None where nothing has dry friction."""
    rough = frictional_coordinates(world)
    if not len(rough):
        return None
    friction = np.zeros(oracle.nv)
    room = np.full(oracle.nv, np.inf)
    q = random_states(world, 1, STATES_SEED + 300)[0][0]
    for body, at_q, at_v in zip(world.bodies, oracle.layout.position, oracle.layout.velocity, strict=True):
        friction[at_v] = body.joint.dry_friction
        if body.joint.position_limits is not None:
            low, high = body.joint.position_limits
            q[at_q], room[at_v] = (low + high) / 2.0, RANGE * (high - low)
    q, start = inside(world, q, MIDDLE), initial_state(world)[0]
    if world.constraints:  # constrained joints may not be in the middle of its range, and must not be beyond
        couple(world, oracle, q, start)
        q = oracle.inwards(oracle.settled(q, start))
    places = {body.joint.name: at for body, at in zip(world.bodies, oracle.layout.velocity, strict=True)}
    along: list[tuple[np.ndarray, float]] = []
    for total in world.sums:
        if total.dry_friction:
            weights = np.zeros(oracle.nv)
            for joint, weight in total.joints:
                weights[places[joint]] = weight
            along.append((weights, total.dry_friction))
        if total.position_limits is not None:
            low, high = total.position_limits
            way = RANGE * (high - low) / sum(abs(weight) for _, weight in total.joints)
            for joint, _ in total.joints:
                room[places[joint]] = np.minimum(room[places[joint]], way)
    whole = friction + sum((np.abs(weights) * most for weights, most in along), np.zeros(oracle.nv))
    strength = oracle.mobility(q) * whole
    gain = np.minimum(SLIDING * strength, room / world.physics.timestep**2)
    side = np.where(np.random.default_rng(STATES_SEED + 301).random(oracle.nv) < 0.5, -1.0, 1.0)
    if world.constraints:  # joints that are held together slide together
        slides = oracle.constrained_velocity(q, gain * side)
        gain, side = np.abs(slides), np.sign(slides)
    rubbed = _Friction(friction, tuple(along))
    trials = tuple(_trials(oracle, q, rubbed, gain, room, side))
    spread = 0.0
    if precision.order:
        spread = max(_spread(trial, oracle, rubbed, strength, rough) for trial in trials if trial.slides)
        trials = tuple(replace(t, tolerance=max(t.tolerance, spread)) if t.slides else t for t in trials)
    if precision.name != DOUBLE:
        floor = max(_floor(trial, oracle, rubbed, strength, rough, precision) for trial in trials if trial.slides)
        tolerance = max(precision.sliding, precision.factor * floor, spread)
        floored = tolerance > precision.sliding
        trials = tuple(replace(t, tolerance=tolerance, floored=floored) if t.slides else t for t in trials)
    return DryFriction(trials, rough, strength[rough])


def _floor(
    trial: ForceTrial,
    oracle: Oracle,
    friction: _Friction,
    strength: np.ndarray,
    rough: np.ndarray,
    precision: Precision,
) -> float:
    """The effect of fewer digits of states and efforts on the speeds of a trial, in its own units: where friction is a small
    part of what acts, rounding is a large part of it."""
    generator = np.random.default_rng(STATES_SEED + 302)
    rounded, off = precision.rounding(1, generator), ROUNDING[precision.name]
    brake = friction.against(trial.along)
    efforts = (trial.effort * (1.0 + off * generator.choice([-1.0, 1.0], oracle.nv)) - brake, trial.effort - brake)
    speeds = [
        oracle.motion(trial.q, trial.v, effort, trial.steps, trial.steps, how)[1][-1]
        for effort, how in zip(efforts, (rounded, None), strict=True)
    ]
    shares = np.abs(speeds[0] - speeds[1])[rough] / (strength[rough] * trial.steps * oracle.timestep)
    return float(shares.max(initial=0.0))


def _spread(trial: ForceTrial, oracle: Oracle, friction: _Friction, strength: np.ndarray, rough: np.ndarray) -> float:
    """How far another method of integration may deviate in a trial, in its own units."""
    effort = trial.effort - friction.against(trial.along)
    speeds = [
        oracle.motion(trial.q, trial.v, effort, halves * trial.steps, trial.steps, timestep=oracle.timestep / halves)[
            1
        ][-1]
        for halves in (1, 2)
    ]
    shares = np.abs(speeds[0] - speeds[1])[rough] / (strength[rough] * trial.steps * oracle.timestep)
    return OTHERS * float(shares.max(initial=0.0))


@dataclass(frozen=True)
class _Friction:
    """The dry friction of joints (nv,), and along sums: weights (nv,) and the largest force of each."""

    joints: np.ndarray
    along: tuple[tuple[np.ndarray, float], ...]

    def against(self, v: np.ndarray) -> np.ndarray:
        """The effort (nv,) that overcomes the friction of motion along ``v``."""
        total: np.ndarray = self.joints * np.sign(v)
        for weights, most in self.along:
            total = total + weights * most * np.sign(weights @ v)
        return total

    def slide(self, speeds: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Whether, at each of some instants (n, nv), all joints with friction move the way that they do along ``v``."""
        rough = self.joints != 0.0
        alike: np.ndarray = (speeds * np.sign(v) > 0.0)[:, rough].all(axis=1)
        for weights, _ in self.along:
            alike = alike & ((speeds @ weights) * np.sign(weights @ v) > 0.0)
        return alike


def _trials(
    oracle: Oracle, q: np.ndarray, friction: _Friction, gain: np.ndarray, room: np.ndarray, side: np.ndarray
) -> Iterator[ForceTrial]:
    """``gain``: the acceleration of a joint that slides; ``room``: how far it may go: within it, and within the neighbourhood
    for which efforts were chosen."""
    rest, dt = np.zeros(oracle.nv), oracle.timestep
    stays = (count for count in FRICTION_STEPS if (1.5 * gain * (count * dt) ** 2 <= np.minimum(room, REACH)).all())
    steps = next(stays, FRICTION_STEPS[-1])
    speed = gain * (steps * dt)
    for sign, word in ((side, "one way"), (-side, "the other way")):
        brake = friction.against(gain * sign)
        for name, v, a in (
            ("slides and gains speed", speed, gain),
            ("slides and loses speed", 2.0 * speed, -gain),
            ("breaks away", rest, gain),
        ):
            v, a = v * sign, a * sign
            left = oracle.bias_force(q, v) - oracle.joint_effort(q, v) + oracle.effort_for(q, a)
            count, expected = _sliding(oracle, q, v, left, friction, gain * sign, steps)
            name = f"{name}, {word}"
            yield ForceTrial(name, q, v, left + brake, count, expected, SLIDE_TOLERANCE, along=gain * sign)
        balance = oracle.bias_force(q, rest) - oracle.joint_effort(q, rest) + BELOW * brake
        yield ForceTrial(f"is held, {word}", q, rest, balance, FRICTION_STEPS[0], rest, HOLD_TOLERANCE, False)


def _sliding(
    oracle: Oracle, q: np.ndarray, v: np.ndarray, effort: np.ndarray, friction: _Friction, along: np.ndarray, most: int
) -> tuple[int, np.ndarray]:
    """The most of ``STEPS``, up to ``most``, in which all joints with friction slide the way of ``along``, and the velocities
    then.

    A joint that comes to rest or turns round on its way is held back by less than its friction, or the other way.
    """
    speeds = oracle.motion(q, v, effort, most, 1)[1][1:]
    slides = friction.slide(speeds, along)
    until = len(slides) if slides.all() else int(np.argmin(slides))
    steps = next(count for count in FRICTION_STEPS if count <= max(until, 1))
    return steps, speeds[steps - 1]
