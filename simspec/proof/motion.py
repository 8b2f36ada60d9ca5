"""Level L6: contact-free motion, step by step, against the oracle's semi-implicit Euler.

The tolerance is the larger of 1e-9 and 100 × the scenario's own round-off floor: the oracle run again several times, its
beginning changed in the last bits. Below that floor no two programs can agree, whatever they hold; it is printed beside the
deviation. Motion is compared as far as the floor is low enough for the tolerance to mean something.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from simspec.dynamics.oracle import Oracle
from simspec.dynamics.stability import unstable
from simspec.dynamics.states import SEED, random_states
from simspec.proof.checks import Check
from simspec.proof.probes import rotation_error
from simspec.world.kinematics import initial_state, rubbing
from simspec.world.types import World

STEPS = 2000
WORK = 2_600_000
"""Coordinates × steps: of larger worlds as many steps as that allows (216 free bodies: all), and ``FEWEST`` at least. More
bodies do not make each one's motion harder to tell."""
EVERY = 40
TOLERANCE = 1e-9
LOOSEST = 1e-7
"""Motion is compared up to the instant at which the tolerance would become larger: a chaotic world multiplies the last bit
without end, and within 0.1 m and rad everything agrees."""
FLOOR_FACTOR = 100.0
PERTURBATION = 1e-15
DISTURBED = 4
"""Runs with a changed beginning: the floor of one alone is off by up to a factor of 15 (measured)."""
TRIES = 6
"""Seeded beginnings to try until one keeps all joints off their limits for all steps; the longest is taken."""
HELD = 2
"""The first of those tries in which the weight is held up."""
GENTLE = 0.2
"""Share of speeds and efforts in those."""
GENTLER = (0.04, 0.008, 1e-4, 1e-6)
"""The same in more tries, where none so far keeps off the limits: the first two to come further, the others to come far enough
at all where a range is a hair's breadth."""
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

    @property
    def tolerance(self) -> float:
        """The larger of 1e-9 and 100 × the floor."""
        return max(TOLERANCE, FLOOR_FACTOR * self.floor)


def plan(world: World, oracle: Oracle) -> Motion:
    """Choose a beginning that stays off the limits, run the oracle, and run it again disturbed in the last bits."""
    most = min(STEPS, max(FEWEST, WORK // max(1, oracle.nv)))
    best: tuple[int, np.ndarray, np.ndarray, np.ndarray] | None = None
    for attempt in range(TRIES + len(GENTLER)):
        q, v, effort = _beginning(world, oracle, attempt)
        steps = _steps_within_limits(world, oracle, q, v, effort, most)
        if best is None or steps > best[0]:
            best = (steps, q, v, effort)
        if steps == most or (best[0] >= FEWEST and attempt >= TRIES + 1):
            break
    if best is None:
        raise ValueError("no beginning was tried")
    steps, q, v, effort = best
    every = max(1, min(EVERY, steps))
    exact = _poses(oracle, q, v, effort, steps, every)
    floors = np.zeros(len(exact))
    generator = np.random.default_rng(SEED + 200)
    for _ in range(DISTURBED):
        disturbed = _poses(oracle, *(_disturb(state, generator) for state in (q, v)), effort, steps, every)
        with np.errstate(invalid="ignore", over="ignore"):
            found = deviation(exact, disturbed).max(axis=1, initial=0.0)
        floors = np.maximum(floors, np.where(np.isfinite(found), found, np.inf))
    floors = np.maximum.accumulate(floors)
    steps, last, ends = _compared(world, floors, steps, every, most)
    return Motion(q, v, effort, steps, every, exact[: last + 1], float(floors[last]), rubbing(world), ends)


def _compared(world: World, floors: np.ndarray, steps: int, every: int, most: int) -> tuple[int, int, str]:
    """How many steps, and instants after the first, have a floor that can be used, and why not all of ``most``."""
    ends = "" if steps == most else "then a joint comes near a limit"
    useful = FLOOR_FACTOR * floors <= LOOSEST
    if useful.all():
        return steps, len(floors) - 1, ends
    last = int(np.argmin(useful)) - 1
    done = last * every
    ends = f"then round-off alone would move bodies by {LOOSEST / FLOOR_FACTOR:.0e}"
    if done < FEWEST and (diverging := unstable(world)):
        ends = f"then the motion diverges: {diverging[0]}; stable up to {diverging[0].largest_stable_step:.3g} s"
    return done, last, ends


def _beginning(world: World, oracle: Oracle, attempt: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints with limits start in the middle of their range, the rest anywhere; speeds and efforts are gentle.

    Efforts give about 1 m/s² or rad/s² to each coordinate alone, so that light and heavy bodies move alike. From ``HELD`` on
    they also carry the weight and the springs of where they start, and all else is gentler: falling reaches limits soonest.
    """
    q, v = (states[0] for states in random_states(world, 1, SEED + 1 + attempt, speed=0.5))
    start, _ = initial_state(world)
    for body, at_q, at_v in zip(world.bodies, oracle.layout.position, oracle.layout.velocity, strict=True):
        limits = body.joint.position_limits
        if limits is not None:
            # the world's own start where it is well inside, since that is where its motion is meant to happen
            low, high = limits
            own = float(start[at_q][0])
            inside = low + 0.1 * (high - low) < own < high - 0.1 * (high - low)
            q[at_q] = own if inside and attempt % 2 == 0 else (low + high) / 2
            v[at_v] *= min(1.0, 0.2 * (high - low))
    generator = np.random.default_rng(SEED + 100 + attempt)
    diagonal = np.zeros(oracle.nv)
    for block, mass in zip(oracle.blocks, oracle.mass_blocks(q), strict=True):
        diagonal[block] = np.diag(mass)
    effort = generator.uniform(-1.0, 1.0, oracle.nv) * diagonal
    if attempt < HELD:
        return q, v, effort
    gentle = GENTLE if attempt < TRIES else GENTLER[attempt - TRIES]
    still = np.zeros(oracle.nv)
    held = oracle.bias_force(q, still) - oracle.joint_effort(q, still)
    return q, gentle * v, held + gentle * effort


def _steps_within_limits(
    world: World, oracle: Oracle, q: np.ndarray, v: np.ndarray, effort: np.ndarray, most: int
) -> int:
    """How many steps the oracle does before a joint comes within 5 % of its range to a limit; ``most`` when none does."""
    rows = [
        (at.start, *body.joint.position_limits)
        for body, at in zip(world.bodies, oracle.layout.position, strict=True)
        if body.joint.position_limits is not None
    ]
    if not rows:
        return most
    index = np.array([row[0] for row in rows])
    low, high = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
    margin = 0.05 * (high - low)
    every = 10
    states, _ = oracle.motion(q, v, effort, most, every)
    outside = ((states[:, index] < low + margin) | (states[:, index] > high - margin)).any(axis=1)
    return most if not outside.any() else max(0, int(np.argmax(outside)) - 1) * every


def _disturb(state: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    return state * (1.0 + PERTURBATION * generator.choice([-1.0, 1.0], len(state)))


def _poses(oracle: Oracle, q: np.ndarray, v: np.ndarray, effort: np.ndarray, steps: int, every: int) -> np.ndarray:
    """The oracle's poses (n, bodies, 7) at every ``every``-th step; not finite where the motion diverges."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.array([oracle.body_poses(row) for row in oracle.motion(q, v, effort, steps, every)[0]])


def deviation(expected: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Per instant and body (n, bodies): metres relative to the larger of 1 m and the body's distance from the origin,
    plus radians."""
    reach = np.maximum(1.0, np.linalg.norm(expected[..., :3], axis=-1))
    away = np.linalg.norm(found[..., :3] - expected[..., :3], axis=-1) / reach
    return away + rotation_error(found[..., 3:], expected[..., 3:])


def motion_checks(world: World, motion: Motion, found: Mapping[str, np.ndarray]) -> list[Check]:
    """One check: the worst deviation of any body at any instant."""
    floor = f"floor {motion.floor:.1e}, {motion.steps} steps of {world.physics.timestep:g} s"
    floor += f" ({motion.ends})" if motion.ends else ""
    if len(motion.rubbing):
        floor += f", dry friction of {len(motion.rubbing)} joints switched off"
    if motion.steps < FEWEST:
        detail = f"{motion.steps} steps, should be {FEWEST} at least: {motion.ends}; {floor}"
        return [Check("L6", "motion", 0, motion.tolerance, None, "", detail)]
    pose = found["pose"]
    if pose.shape != motion.poses.shape:
        detail = f"{len(pose)} instants, should be {len(motion.poses)}"
        return [Check("L6", "motion", len(pose), motion.tolerance, None, "", detail)]
    error = deviation(motion.poses, pose)
    if not np.isfinite(error).all():
        return [Check("L6", "motion", error.size, motion.tolerance, None, "", f"not finite; {floor}")]
    instant, body = np.unravel_index(int(np.argmax(error)), error.shape)
    where = f"bodies.{world.bodies[body].name}, step {min(instant * motion.every, motion.steps)}"
    return [Check("L6", "motion", error.size, motion.tolerance, float(error[instant, body]), where, floor)]
