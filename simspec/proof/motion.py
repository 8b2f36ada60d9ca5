"""Level L6: contact-free motion, step by step, against the oracle's semi-implicit Euler.

The tolerance is the larger of 1e-9 and 100 × the scenario's own round-off floor: the oracle run again several times, its
beginning changed in the last bits (of engines in single precision: ``proof/checks.py``). Below that floor no two programs
can agree, whatever they hold; it is printed beside the deviation. Motion is compared as far as the floor is low enough for
the tolerance to mean something.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from simspec.dynamics.oracle import STATES_SEED, Oracle, angles_of, random_states, shortened
from simspec.dynamics.stability import unstable
from simspec.engines.kit.capabilities import DOUBLE
from simspec.language.vocabulary import QUATERNION_JOINTS, SCALAR_JOINTS
from simspec.proof.checks import PRECISIONS, TOO_CHAOTIC, Check, Precision, Rounded
from simspec.proof.limits import CALM, MIDDLE, Stops, calmed, followers, inside, left_to
from simspec.world.kinematics import frictional_coordinates, initial_state
from simspec.world.rotations import rotation_error
from simspec.world.types import Body, Follow, Record, World

# Where a mechanism rests: beginnings of motions that are too chaotic from anywhere else.

RESTING_STEPS = 2000
"""Steps in which a mechanism falls to rest: a chain of 200 links of 5 cm that begins at 1 rad comes within 0.3 rad, from where
a motion of 2,000 steps is followed (measured)."""
RESTING_WORK = 400_000
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
    for _ in range(min(RESTING_STEPS, RESTING_WORK // max(1, oracle.nv))):
        q, v = oracle.step(q, v, still)
        if not np.isfinite(q).all() or near_limits(q):
            return best
        best = q
        kinetic, _ = oracle.energy(q, v)
        if kinetic < energy:
            v, kinetic = still, 0.0
        energy = kinetic
    return best


STEPS = 2000
WORK = 2_600_000
"""Coordinates × steps: of larger worlds as many steps as that allows (216 free bodies: all), and ``FEWEST`` at least. More
bodies do not make each one's motion harder to tell."""
EVERY, LOOK = 40, 10
"""Steps between two instants that are compared; the second where there are few, and when a beginning is tried."""
SECONDS = 2.0
"""Time in which motion comes as far as it should: what falls for 8 s, as in 2,000 steps of 4 ms, is 300 m away at 80 m/s, where
the round-off of one engine is a hundred times the others' (measured)."""
LARGEST_TURN = 0.25
"""rad in a step up to which motion is compared: what turns faster is not resolved by the timestep at all, and one engine
turns nothing by more than π/4 in a step (measured, at the end of motions that diverge)."""
LARGEST_SLIDE = 3.0
"""m from the beginning up to which a slide is followed: one without limits is flung out without end, and at 100 m the mass
matrix is so uneven that one step is off by 1e-10 to 1e-8, by the engine (measured)."""
DISTURBED = 4
"""Disturbed runs: the floor of one alone is off by up to a factor of 15 (measured)."""
TRIES = 6
"""Seeded beginnings to try until one keeps all joints off their limits for all steps; the longest is taken."""
HELD = 2
"""The first of those tries in which the weight is held up."""
GENTLE = 0.2
"""Share of speeds and efforts in those."""
GENTLER = (0.04, 0.008, 1e-4, 1e-6)
"""The same in more tries, where none so far keeps off the limits: the first two to come further, the others to come far enough
at all where a range is a hair's breadth."""
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
class Motion:
    """What to do (``q``, ``v``, ``effort``, ``steps``), what the oracle made of it, and its round-off floor."""

    q: np.ndarray
    v: np.ndarray
    effort: np.ndarray
    steps: int
    every: int
    poses: np.ndarray
    floor: float
    rubbing: np.ndarray
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


KEPT = 24
"""Motions that a process keeps: those of the worlds of a self-test, or of a sweep that changes an engine's settings."""
_kept: dict[tuple[World, Precision], Motion] = {}


def plan(world: World, oracle: Oracle, precision: Precision = PRECISIONS[DOUBLE]) -> Motion:
    """Choose a beginning that stays off the limits, run the oracle, and run it again disturbed in the last bits.

    Motion is compared up to the instant at which the tolerance would become larger than ``precision.loosest``: a chaotic world
    multiplies the last bit without end, and within 0.1 m and rad everything agrees.

    Worlds that differ in nothing but their name, what is recorded and expected, and engines' options share a motion, whose
    arrays are not to be changed: it takes seconds, and comparing worlds milliseconds.
    """
    if any(not isinstance(one, Follow) for one in world.constraints):
        precision = precision.of_loops()
    same = dataclasses.replace(world, name="", record=Record(), expectations=(), engines=(), frames=())
    known = _kept.get((same, precision))
    if known is None:
        known = _plan(world, oracle, precision)
        if len(_kept) >= KEPT:
            _kept.pop(next(iter(_kept)), None)
        _kept[same, precision] = known
    return known


def _plan(world: World, oracle: Oracle, precision: Precision) -> Motion:
    most = min(STEPS, max(FEWEST, WORK // max(1, oracle.nv)))
    best: _Beginning | None = None
    for attempt in range(TRIES + len(GENTLER)):
        trial = _tried(world, oracle, *_beginning(world, oracle, attempt, most), most)
        if best is None or trial.steps > best.steps:
            best = trial
        if best.steps == most or (best.steps >= FEWEST and attempt >= TRIES + 1):
            break
    if best is None:
        raise ValueError("no initial state was tried")
    planned = _planned(world, oracle, best, most, precision)
    for attempt in range(HELD, TRIES + len(GENTLER)):
        if planned.steps >= FEWEST or unstable(world):
            break  # enough, or nothing gentler helps
        begun = _tried(world, oracle, *_beginning(world, oracle, attempt, most), most)
        gentler = _planned(world, oracle, begun, most, precision)
        if gentler.steps > planned.steps:
            planned = gentler
    if planned.steps < FEWEST and not unstable(world):
        planned = _from_rest(world, oracle, planned, most, precision)
    return planned


def _from_rest(world: World, oracle: Oracle, planned: Motion, most: int, precision: Precision) -> Motion:
    """The motion of ``FROM_REST`` that is followed for enough steps, or the longest; ``planned`` where none is longer."""
    rest = at_rest(world, oracle, lambda q: comes_near_limits(world, oracle, q[None]))
    slower = _slower(world, most)
    v = slower * random_states(world, 1, STATES_SEED + 1, speed=0.5)[1][0]
    v = oracle.constrained_velocity(rest, v) if world.constraints else v
    push, balance = _push(oracle, rest, 0, slower), _balance(oracle, rest)
    for share in FROM_REST:
        begun = _tried(world, oracle, rest, share * v, balance + share * push, most)
        trial = _planned(world, oracle, begun, most, precision)
        if trial.steps > planned.steps:
            planned = trial
        if planned.steps >= FEWEST:
            break
    return planned


def _planned(world: World, oracle: Oracle, begun: _Beginning, most: int, precision: Precision) -> Motion:
    """What the oracle makes of a beginning, with its floor, as far as that can be used."""
    q, v, effort, steps, ends, unsteady = begun.q, begun.v, begun.effort, begun.steps, begun.ends, begun.unsteady
    every = EVERY if steps >= 10 * EVERY else LOOK
    rows = [min(done, steps) for done in range(0, steps + every, every)]
    exact = _poses(oracle, begun.states[[-(-row // LOOK) for row in rows]])
    floors = np.zeros(len(exact))
    generator = np.random.default_rng(STATES_SEED + 200)
    for run in range(DISTURBED):
        off_q, off_v = precision.beginning(q, generator), precision.beginning(v, generator)
        rounded = precision.rounding(run, generator)
        disturbed = _poses(oracle, _motion(oracle, off_q, off_v, effort, steps, every, rounded)[0])
        with np.errstate(invalid="ignore", over="ignore"):
            deviations = deviation(exact, disturbed).max(axis=1, initial=0.0)
        floors = np.maximum(floors, np.where(np.isfinite(deviations), deviations, np.inf))
    floors = np.maximum.accumulate(floors)
    useful = precision.factor * floors <= precision.loosest
    last = len(floors) - 1
    if not useful.all():
        last = max(0, int(np.argmin(useful)) - 1)
        steps, ends = (
            last * every,
            f"{ROUND_OFF} would move bodies by {precision.loosest / precision.factor:.0e}",
        )
        unsteady = True
    if steps < FEWEST and (diverging := unstable(world)):
        ends = f"then it diverges: {diverging[0]}; stable up to {diverging[0].largest_stable_step:.3g} s"
        unsteady = False
    floor = float(floors[last])
    return Motion(
        q, v, effort, steps, every, exact[: last + 1], floor, frictional_coordinates(world), ends, precision, unsteady
    )


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


def _tried(world: World, oracle: Oracle, q: np.ndarray, v: np.ndarray, effort: np.ndarray, most: int) -> _Beginning:
    """How far the oracle comes from a beginning, looked at every ``LOOK`` steps: up to ``most``, or until a joint comes within
    5 % of its range to a limit, or turns too fast."""
    states, speeds = _motion(oracle, q, v, effort, most, LOOK)
    turned = f"then something turns by more than {LARGEST_TURN:g} rad in a step"
    reasons = {
        "then a joint comes near a limit": _near_limits(world, oracle, states),
        turned: ~(_turns(world, oracle, speeds) <= LARGEST_TURN),
    }
    slid = f"then something slides more than {LARGEST_SLIDE:g} m away"
    reasons[slid] = ~(_slides(world, oracle, states) <= LARGEST_SLIDE)
    ends, steps = "", most
    for why, bad in reasons.items():
        if bad.any() and (until := max(0, int(np.argmax(bad)) - 1) * LOOK) < steps:
            ends, steps = why, until
    unsteady = ends == turned or (bool(ends) and _grows(world, oracle, states, v, effort))
    return _Beginning(q, v, effort, steps, ends, states, unsteady)


def _grows(world: World, oracle: Oracle, states: np.ndarray, v: np.ndarray, effort: np.ndarray) -> bool:
    """Whether a joint goes ``GROWN`` times as far as the speeds and accelerations at the beginning take the fastest: the
    motion then grows by itself, as that of a mechanism that stands on its end does, and with it whatever disturbs it."""
    places = [at.start for body, at in _parts(world, oracle) if body.joint.kind in SCALAR_JOINTS]
    if not places:
        return False
    start, first = float(np.abs(v).max()), float(np.abs(oracle.acceleration(states[0], v, effort)).max())
    time = np.arange(len(states)) * LOOK * world.physics.timestep
    with np.errstate(invalid="ignore", over="ignore"):
        gone = np.abs(states[:, places] - states[0, places]).max(axis=1)
        return bool((gone > GROWN * (start * time + 0.5 * first * time * time)).any())


def _parts(world: World, oracle: Oracle) -> Iterator[tuple[Body, slice]]:
    """Each body with the place of its joint in q."""
    return zip(world.bodies, oracle.layout.position, strict=True)


def _near_limits(world: World, oracle: Oracle, states: np.ndarray) -> np.ndarray:
    """Whether, at each instant, a joint or a sum is within 5 % of its range to a limit, or beyond."""
    rows = [
        (at.start, *body.joint.position_limits)
        for body, at in zip(world.bodies, oracle.layout.position, strict=True)
        if body.joint.position_limits is not None
    ]
    stops = Stops(world)
    turned = stops.near(states, 0.05)
    for body, at in zip(world.bodies, oracle.layout.position, strict=True):
        if body.joint.angle_limit is not None:
            turned = turned | (angles_of(states[:, at]) > 0.95 * body.joint.angle_limit)
    if not rows:
        return turned
    index = np.array([row[0] for row in rows])
    low, high = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
    margin = 0.05 * (high - low)
    near: np.ndarray = ((states[:, index] < low + margin) | (states[:, index] > high - margin)).any(axis=1)
    return near | turned


def comes_near_limits(world: World, oracle: Oracle, states: np.ndarray) -> bool:
    """Whether in any of some states (n, nq) a joint or a sum is within 5 % of its range to a limit."""
    return bool(_near_limits(world, oracle, states).any())


def _slides(world: World, oracle: Oracle, states: np.ndarray) -> np.ndarray:
    """How far (instants,) the slide that went farthest is from where it began, at each instant; NaN where motion diverged."""
    parts = zip(world.bodies, oracle.layout.position, strict=True)
    index = [at.start for body, at in parts if body.joint.kind == "slide"]
    farthest: np.ndarray = np.abs(states[:, index] - states[0, index]).max(axis=1, initial=0.0)
    return farthest


def _turns(world: World, oracle: Oracle, speeds: np.ndarray) -> np.ndarray:
    """The largest angle (instants,) by which a joint turns in a step, at each instant; NaN where motion has diverged."""
    angles = np.zeros(len(speeds))
    for body, part in zip(world.bodies, oracle.layout.velocity, strict=True):
        if body.joint.kind in ("hinge", *QUATERNION_JOINTS):
            turning = speeds[:, part][:, -3:]
            with np.errstate(invalid="ignore", over="ignore"):
                angles = np.maximum(angles, np.sqrt((turning * turning).sum(axis=1)))
    return angles * world.physics.timestep


def _beginning(world: World, oracle: Oracle, attempt: int, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints with limits start in the middle of their range, the rest anywhere; speeds and efforts are gentle.

    Efforts give about 1 m/s² or rad/s² to each coordinate alone, so that light and heavy bodies move alike. From ``HELD`` on
    they also carry the weight and the springs of where they start, and all else is gentler: falling reaches limits soonest.
    In longer motions than ``SECONDS`` everything is as much slower, and free roots are held up as far as that takes, so that
    all come as far as in that time.
    """
    slower = _slower(world, most)
    q, v = (states[0] for states in random_states(world, 1, STATES_SEED + 1 + attempt, speed=0.5))
    start, _ = initial_state(world)
    for body, at_q, at_v in zip(world.bodies, oracle.layout.position, oracle.layout.velocity, strict=True):
        limits = body.joint.position_limits
        if body.joint.angle_limit is not None:
            q[at_q] = shortened(q[at_q], 0.5)
            v[at_v] *= min(1.0, 0.2 * body.joint.angle_limit)
        if limits is not None:
            # the world's own start where it is well inside, since that is where its motion is meant to happen
            low, high = limits
            own = float(start[at_q][0])
            q[at_q] = own if _well_inside(own, low, high) and attempt % 2 == 0 else (low + high) / 2
            v[at_v] *= min(1.0, 0.2 * (high - low))
    if any(one.position_limits for one in world.sums):
        q, v = inside(world, q, MIDDLE), calmed(world, v, CALM)
    if world.constraints:  # what is held together begins there, and moves so
        couple(world, oracle, q, start)
        q = oracle.inwards(oracle.settled(q, start))
        v = oracle.constrained_velocity(q, v)
    effort = _push(oracle, q, attempt, slower)
    v *= slower
    if attempt < HELD:
        weight = oracle.bias_force(q, np.zeros(oracle.nv))
        for body, at_v in zip(world.bodies, oracle.layout.velocity, strict=True):
            if body.joint.kind == "free":
                effort[at_v][:3] += (1.0 - slower**2) * weight[at_v][:3]
        return q, v, effort
    gentle = GENTLE if attempt < TRIES else GENTLER[attempt - TRIES]
    return q, gentle * v, _balance(oracle, q) + gentle * effort


def _slower(world: World, most: int) -> float:
    """The share of speeds in motions that are longer than ``SECONDS``."""
    return min(1.0, SECONDS / (most * world.physics.timestep))


def _push(oracle: Oracle, q: np.ndarray, attempt: int, slower: float) -> np.ndarray:
    """Seeded efforts (nv,) that give about 1 m/s² or rad/s² to each coordinate alone, in longer motions less."""
    generator = np.random.default_rng(STATES_SEED + 100 + attempt)
    diagonal = np.zeros(oracle.nv)
    for block, mass in zip(oracle.blocks, oracle.mass_blocks(q), strict=True):
        diagonal[block] = np.diag(mass)
    effort: np.ndarray = slower**2 * generator.uniform(-1.0, 1.0, oracle.nv) * diagonal
    return effort


def _balance(oracle: Oracle, q: np.ndarray) -> np.ndarray:
    """The efforts (nv,) that carry the weight and the springs at a position."""
    still = np.zeros(oracle.nv)
    weight: np.ndarray = oracle.bias_force(q, still) - oracle.joint_effort(q, still)
    return weight


def _well_inside(position: float, low: float, high: float) -> bool:
    """Whether a position is a tenth of the range or more from both limits."""
    margin = 0.1 * (high - low)
    return low + margin < position < high - margin


def couple(world: World, oracle: Oracle, q: np.ndarray, start: np.ndarray) -> None:
    """Put joints that follow others where these put them, in the middle of what the limits of all of them leave, in ``q``."""
    parts = zip(world.bodies, oracle.layout.position, strict=True)
    joints = {body.joint.name: (at.start, body.joint.position_limits) for body, at in parts}
    limits = {name: own for name, (_, own) in joints.items()}
    for first, chain in followers(world).items():
        low, high = left_to(chain, limits)
        at = joints[first][0]
        if np.isfinite(high - low) and not _well_inside(float(q[at]), low, high):
            own = float(start[at])
            q[at] = own if _well_inside(own, low, high) else (low + high) / 2
        for name, ratio, offset in chain:
            q[joints[name][0]] = ratio * q[at] + offset


def _motion(
    oracle: Oracle,
    q: np.ndarray,
    v: np.ndarray,
    effort: np.ndarray,
    steps: int,
    every: int,
    rounded: Rounded | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The oracle's states at every ``every``-th step; not finite where the motion diverges."""
    with np.errstate(invalid="ignore", over="ignore"):
        return oracle.motion(q, v, effort, steps, every, rounded)


def _poses(oracle: Oracle, states: np.ndarray) -> np.ndarray:
    return np.array([oracle.body_poses(row) for row in states])


def deviation(expected: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """Per instant and body (n, bodies): metres relative to the larger of 1 m and the body's distance from the origin,
    plus radians."""
    reach = np.maximum(1.0, np.linalg.norm(expected[..., :3], axis=-1))
    away = np.linalg.norm(actual[..., :3] - expected[..., :3], axis=-1) / reach
    apart: np.ndarray = away + rotation_error(actual[..., 3:], expected[..., 3:])
    return apart


def motion_checks(world: World, motion: Motion, answer: Mapping[str, np.ndarray]) -> list[Check]:
    """One check: the worst deviation of any body at any instant."""
    floor = f"floor {motion.floor:.1e}, {motion.steps} steps of {world.physics.timestep:g} s"
    floor += f" ({motion.ends})" if motion.ends else ""
    if len(motion.rubbing):
        floor += f", dry friction of {len(motion.rubbing)} joints switched off"
    if motion.steps < FEWEST:
        detail = f"{motion.steps} steps, should be {FEWEST} at least: {motion.ends}; {floor}"
        return [Check("L6", "motion", 0, motion.tolerance, None, "", detail)]
    pose = answer["pose"]
    if pose.shape != motion.poses.shape:
        detail = f"{len(pose)} instants, should be {len(motion.poses)}"
        return [Check("L6", "motion", len(pose), motion.tolerance, None, "", detail)]
    error = deviation(motion.poses, pose)
    if not np.isfinite(error).all():
        return [Check("L6", "motion", error.size, motion.tolerance, None, "", f"not finite; {floor}")]
    instant, body = np.unravel_index(int(np.argmax(error)), error.shape)
    where = f"bodies.{world.bodies[body].name}, step {min(instant * motion.every, motion.steps)}"
    return [Check("L6", "motion", error.size, motion.tolerance, float(error[instant, body]), where, floor)]
