"""Level L7 of worlds with forces on bodies and with kinematic bodies: what they do to motion, in every engine, without contact.

Every body begins at rest, held against its weight, and the world's own forces act soon after, each for a while, with what share
of a step they begin and end by in the world. The oracle has them by its own Jacobians. The tolerance is L6's.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from simspec.control.forces import brought_forward, forces_to_request, in_steps
from simspec.control.motions import curve, motions_to_request
from simspec.dynamics.oracle import Oracle
from simspec.dynamics.states import SEED, angles_of, shortened
from simspec.engines.kit.capabilities import DOUBLE
from simspec.engines.kit.process import Operation
from simspec.proof.checks import Check
from simspec.proof.inside import inside
from simspec.proof.motion import DISTURBED, comes_near_limits, deviation
from simspec.proof.precision import PRECISIONS, Precision, Rounded
from simspec.world.actions import Force, Motion
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


@dataclasses.dataclass(frozen=True)
class Pushed:
    """What to do (``world`` with its forces brought forward, ``q``, ``v``, ``effort``), and what must come of it: ``poses`` at
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

    @property
    def tolerance(self) -> float:
        """That of L6."""
        return self.precision.tolerance(self.floor)

    def operation(self, asked: World) -> Operation:
        """What an engine is asked (see ``engines/kit/worker.py``)."""
        arrays = {"q": self.q, "v": self.v, "effort": self.effort, "rubbing": frictional_coordinates(self.world)}
        return Operation("pushed", {**forces_to_request(self.world), "steps": STEPS, "every": EVERY}, arrays, asked)


def plan(world: World, oracle: Oracle, precision: Precision = PRECISIONS[DOUBLE]) -> Pushed | None:
    """The probe of a world's forces; None where it has none."""
    if not world.forces:
        return None
    start, v = initial_state(world)
    q, v = start.copy(), np.zeros_like(v)
    for body, at in zip(world.bodies, oracle.layout.position, strict=True):
        if (limits := body.joint.position_limits) is not None:
            margin = INSIDE * (limits[1] - limits[0])
            q[at] = np.clip(q[at], limits[0] + margin, limits[1] - margin)
        if (most := body.joint.angle_limit) is not None:
            angle = float(angles_of(q[None, at])[0])
            q[at] = shortened(q[at], min(1.0, (1.0 - INSIDE) * most / angle) if angle else 1.0)
    q = oracle.inwards(oracle.settled(inside(world, q, INSIDE), start))
    effort = oracle.bias_force(q, v) - oracle.joint_effort(q, v)
    forces = brought_forward(world.forces, world.physics.timestep, FIRST, LONGEST)
    ends = "its motion without forces comes near a limit, or is not finite"
    for halved in range(HALVINGS):
        asked = dataclasses.replace(world, forces=tuple(_times(0.5**halved, force) for force in forces))
        states = _motion(asked, oracle, q, v, effort)
        if np.isfinite(states).all() and not comes_near_limits(world, oracle, states):
            ends = ""
            break
    poses = np.array([oracle.body_poses(row) for row in states])
    generator, floor = np.random.default_rng(SEED + 300), 0.0
    for run in range(DISTURBED):
        off, rounded = precision.beginning(q, generator), precision.rounding(run, generator)
        other = np.array([oracle.body_poses(row) for row in _motion(asked, oracle, off, v, effort, rounded)])
        floor = max(floor, float(deviation(poses, other).max(initial=0.0)))
    return Pushed(asked, q, v, effort, poses, floor if np.isfinite(floor) else 0.0, halved, ends, precision)


def _times(factor: float, force: Force) -> Force:
    x, y, z = force.force
    a, b, c = force.torque
    return dataclasses.replace(
        force, force=(factor * x, factor * y, factor * z), torque=(factor * a, factor * b, factor * c)
    )


def _motion(
    world: World, oracle: Oracle, q: Floats, v: Floats, effort: Floats, rounded: Rounded | None = None
) -> Floats:
    """The oracle's positions (n, nq) at every ``EVERY``-th step, the beginning first."""
    rows, dt = [q], world.physics.timestep
    for step in range(STEPS):
        total = effort.copy()
        for force in world.forces:
            first = in_steps(force.start, dt)
            last = np.inf if force.until is None else in_steps(force.until, dt)
            share = min(last, step + 1.0) - max(first, float(step))
            if share > 0.0:
                total += min(share, 1.0) * oracle.effort_of(q, force)
        q, v = oracle.step(q, v, total)
        if rounded is not None:
            q, v = rounded(q), rounded(v)
        if (step + 1) % EVERY == 0:
            rows.append(q)
    return np.array(rows)


def forces_checks(pushed: Pushed, answer: Mapping[str, Floats]) -> list[Check]:
    """One check: the worst deviation of any body at any instant."""
    world, pose = pushed.world, answer["pose"]
    detail = f"floor {pushed.floor:.1e}, {STEPS} steps of {world.physics.timestep:g} s"
    if pushed.halved:
        detail += f", forces divided by 2^{pushed.halved}, with which no joint comes near a limit"
    if pushed.ends:
        return [Check("L7", FORCES_CHECK, 0, pushed.tolerance, None, "", f"{pushed.ends}; {detail}")]
    if pose.shape != pushed.poses.shape or not np.isfinite(pose).all():
        detail = f"poses of shape {pose.shape}, not all of them finite; {detail}"
        return [Check("L7", FORCES_CHECK, pose.size, pushed.tolerance, None, "", detail)]
    error = deviation(pushed.poses, pose)
    instant, body = np.unravel_index(int(np.argmax(error)), error.shape)
    where = f"bodies.{world.bodies[body].name}, step {instant * EVERY}"
    return [Check("L7", FORCES_CHECK, error.size, pushed.tolerance, float(error[instant, body]), where, detail)]


PRESCRIBED_CHECK = "prescribed motion"
MOVED = 100
"""Steps in which all motions are done: what takes longer is told to the engine quicker."""


@dataclasses.dataclass(frozen=True)
class Followed:
    """A ``world`` with quick motions, and where its kinematic bodies (``names``) must be after every step (rows, bodies, 7)."""

    world: World
    names: tuple[str, ...]
    poses: Floats
    precision: Precision = PRECISIONS[DOUBLE]

    def operation(self, asked: World) -> Operation:
        """What an engine is asked: all bodies begin where the world's do, at rest."""
        q, v = initial_state(self.world)
        parameters, motions = motions_to_request(self.world)
        still = np.zeros_like(v)
        arrays = {**motions, "q": q, "v": still, "effort": still, "rubbing": frictional_coordinates(self.world)}
        return Operation("prescribed", {**parameters, "steps": MOVED, "every": 1}, arrays, asked)


def plan_motions(world: World, precision: Precision = PRECISIONS[DOUBLE]) -> Followed | None:
    """The probe of a world's kinematic bodies; None where it has none."""
    if not world.motions:
        return None
    dt = world.physics.timestep
    quick = tuple(_in_time(motion, MOVED * dt) for motion in world.motions)
    asked = dataclasses.replace(world, motions=quick, forces=(), controllers=(), trajectory=None)
    times = np.arange(MOVED + 1) * dt
    poses = np.stack([np.concatenate(curve(motion).at(times), axis=1) for motion in quick], axis=1)
    return Followed(asked, tuple(motion.body for motion in quick), poses, precision)


def _in_time(motion: Motion, longest: float) -> Motion:
    """A motion whose last point comes at ``longest`` (s) at the latest."""
    share = min(1.0, longest / motion.times[-1]) if motion.times[-1] else 1.0
    return dataclasses.replace(motion, times=tuple(share * time for time in motion.times))


def motion_checks(followed: Followed, answer: Mapping[str, Floats]) -> list[Check]:
    """One check: the worst deviation of a kinematic body from its motion, after any step."""
    rows = {body.name: row for row, body in enumerate(followed.world.bodies)}
    pose = answer["pose"][:, [rows[name] for name in followed.names]]
    detail = f"{MOVED} steps of {followed.world.physics.timestep:g} s"
    if pose.shape != followed.poses.shape or not np.isfinite(pose).all():
        detail = f"poses of shape {pose.shape}, not all of them finite; {detail}"
        return [Check("L7", PRESCRIBED_CHECK, pose.size, followed.precision.motion, None, "", detail)]
    error = deviation(followed.poses, pose)
    instant, body = np.unravel_index(int(np.argmax(error)), error.shape)
    where = f"bodies.{followed.names[body]}, step {instant}"
    return [
        Check("L7", PRESCRIBED_CHECK, error.size, followed.precision.motion, float(error[instant, body]), where, detail)
    ]
