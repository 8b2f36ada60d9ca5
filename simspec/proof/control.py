"""Level L7: the controllers' step response, in every engine, without contact.

All driven joints begin at rest and are told to be a little elsewhere, for good. What the engine makes of that is held against
the oracle under the same law, dry friction switched off, and, where computed torque has the whole tree to itself, against the
closed form: then v̇ is the law's a exactly, whatever the robot, and the deviation of each joint obeys a recursion of two
numbers. The tolerance is L6's.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from simspec.control.law import Control
from simspec.control.reference import driven_joints, reference
from simspec.control.request import to_request
from simspec.dynamics.oracle import Oracle, angles_of, shortened
from simspec.engines.kit.capabilities import DOUBLE
from simspec.engines.kit.process import Operation
from simspec.proof.checks import PRECISIONS, Check, Precision, Rounded
from simspec.proof.limits import Stops, inside
from simspec.world.actions import Trajectory
from simspec.world.kinematics import (
    constrained_trees,
    frictional_coordinates,
    initial_state,
    layout_of,
    trees,
    within,
)
from simspec.world.types import World

STEPS = 500
"""At 1 ms half a second, in which a law of 10 rad/s has done 96 % of its way."""
EVERY = 10
STEP = 0.05
"""rad or m: large enough for the Coriolis force to matter, small enough for a finger."""
SHARE = 0.05
"""Largest share of a joint's range that it is told to move."""
INSIDE = 0.1
"""Share of its range that a joint begins away from its limits, which the oracle does not know."""
NEAR = 0.05
"""Share of its range to a limit from which on a joint, driven or not, is near it: what follows is not compared, as in L6."""
HALVINGS = 30
"""How often the step is halved until no effort is clipped."""


@dataclasses.dataclass(frozen=True)
class Response:
    """What to do (``world`` with its constant trajectory, ``q``, ``v``), and what must come of it, at every ``EVERY``-th step:
    ``positions`` (n, joints) by the oracle with its round-off ``floor``, ``closed`` the same by the closed form, NaN where
    there is none. ``joints``: their names. ``steps``: after so many a joint comes near a limit; from there on both are NaN."""

    world: World
    q: np.ndarray
    v: np.ndarray
    joints: tuple[str, ...]
    positions: np.ndarray
    closed: np.ndarray
    floor: float
    clipped: bool
    steps: int = STEPS
    precision: Precision = PRECISIONS[DOUBLE]

    def operation(self) -> Operation:
        """What an engine is asked (see ``engines/kit/worker.py``)."""
        parameters, arrays = to_request(self.world)
        arrays = {**arrays, "q": self.q, "v": self.v, "rubbing": frictional_coordinates(self.world)}
        return Operation("respond", {**parameters, "steps": STEPS, "every": EVERY}, arrays, self.world)

    @property
    def tolerance(self) -> float:
        """That of L6."""
        return self.precision.tolerance(self.floor)


class _OracleJoints:
    """The driven joints in the oracle's motion."""

    def __init__(self, world: World, control: Control, q: np.ndarray, v: np.ndarray, rounded: Rounded | None = None):
        self._oracle, self._rounded = Oracle(world), rounded
        self._q_places, self._v_places = control.q_places, control.v_places
        self._q, self._v = q, v
        self._effort = np.zeros(self._oracle.nv)
        limited = [
            (at.start, *body.joint.position_limits)
            for body, at in zip(world.bodies, self._oracle.layout.position, strict=True)
            if body.joint.position_limits is not None
        ]
        self._limited = np.array([place for place, _, _ in limited], dtype=int)
        low, high = (np.array([row[k] for row in limited]) for k in (1, 2))
        self._low, self._high = low + NEAR * (high - low), high - NEAR * (high - low)
        self._stops = Stops(world)
        self._turning = [
            (at, (1.0 - NEAR) * body.joint.angle_limit)
            for body, at in zip(world.bodies, self._oracle.layout.position, strict=True)
            if body.joint.angle_limit is not None
        ]
        self.steps, self._free = 0, True

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        return self._q[self._q_places], self._v[self._v_places]

    def give(self, effort: np.ndarray) -> None:
        self._effort[self._v_places] = effort

    def step(self) -> None:
        states, speeds = self._oracle.motion(self._q, self._v, self._effort, 1, 1, self._rounded)
        self._q, self._v = states[-1], speeds[-1]
        near = self._q[self._limited]
        self._free = self._free and bool(((near > self._low) & (near < self._high)).all())
        self._free = self._free and not self._stops.near(self._q[None], NEAR)[0]
        self._free = self._free and all(angles_of(self._q[at][None])[0] < most for at, most in self._turning)
        self.steps += self._free


def plan(world: World, precision: Precision = PRECISIONS[DOUBLE]) -> Response | None:
    """The response of a world's laws; None where nothing but native controllers drives."""
    laws = tuple(controller for controller in world.controllers if controller.law != "native")
    if not laws:
        return None
    world = dataclasses.replace(world, controllers=laws, forces=(), motions=())
    joints = driven_joints(world)
    q, v = initial_state(world)
    v = np.zeros_like(v)
    places, reach = [], []
    for body, at in zip(world.bodies, layout_of(world).position, strict=True):
        limits = body.joint.position_limits
        if limits is not None:
            margin = INSIDE * (limits[1] - limits[0])
            q[at] = np.clip(q[at], limits[0] + margin, limits[1] - margin)
        if (largest := body.joint.angle_limit) is not None:
            angle = float(angles_of(q[at][None])[0])
            if angle > (1.0 - INSIDE) * largest:
                q[at] = shortened(q[at], (1.0 - INSIDE) * largest / angle)
        if body.joint.name in joints:
            places.append(at.start)
            inward = 1.0 if limits is None or q[at.start] < sum(limits) / 2.0 else -1.0
            reach.append(inward * (STEP if limits is None else min(STEP, SHARE * (limits[1] - limits[0]))))
    q = inside(world, q, INSIDE)
    if world.constraints:
        oracle = Oracle(world)
        q = oracle.inwards(oracle.settled(q, initial_state(world)[0]))
    amount = np.array(reach)
    for _ in range(HALVINGS):
        asked = _stepped(world, joints, q[places] + amount)
        control, positions, steps = _response(asked, q, v)
        if not control.clipped.any():
            break
        amount = amount / 2.0
    rows = steps // EVERY + 1
    rounded = precision.rounding(0, np.random.default_rng(0))  # one disturbed run is enough: a law holds what it drives
    disturbed = _response(asked, q * (1.0 + precision.perturbation), v, rounded)[1]
    floor = float(np.abs(positions - disturbed)[:rows].max())
    closed = _closed_form(asked, joints, q[places], amount, bool(control.clipped.any()))
    positions[rows:] = closed[rows:] = np.nan
    return Response(asked, q, v, joints, positions, closed, floor, bool(control.clipped.any()), steps, precision)


def _stepped(world: World, joints: tuple[str, ...], targets: np.ndarray) -> World:
    """The world with all driven joints told to be at ``targets``."""
    return dataclasses.replace(world, trajectory=Trajectory(joints, (0.0,), (tuple(targets.tolist()),)))


def _response(
    world: World, q: np.ndarray, v: np.ndarray, rounded: Rounded | None = None
) -> tuple[Control, np.ndarray, int]:
    """The oracle's positions (n, joints) under the world's laws, joints in the world's order, and how many steps are done
    before a joint comes near a limit."""
    driven = set(driven_joints(world))
    own = [bodies for bodies in constrained_trees(world) if any(body.joint.name in driven for body in bodies)]
    names = {body.name for bodies in own for body in bodies}
    keep_q, keep_v = (
        np.concatenate(
            [np.r_[part] for body, part in zip(world.bodies, parts, strict=True) if body.name in names]
        ).astype(int)
        for parts in (layout_of(world).position, layout_of(world).velocity)
    )
    world = within(world, (body for body in world.bodies if body.name in names))
    control = Control(world, reference(world))
    joints = _OracleJoints(world, control, q[keep_q], v[keep_v], rounded)
    positions = control.follow(joints, STEPS, EVERY)
    return control, positions, joints.steps


def _closed_form(
    world: World, joints: tuple[str, ...], start: np.ndarray, step: np.ndarray, clipped: bool
) -> np.ndarray:
    """Positions by e' = e + dt v', v' = v + dt a, a = −(c₁ v + c₀ e) (implicit: of the step's end), e = q − q*."""
    count = STEPS // EVERY + 1
    targets = np.full((count, len(joints)), np.nan)
    if clipped:
        return targets
    dt = world.physics.timestep
    for bodies in trees(world).values():
        moving = [body for body in bodies if body.joint.kind != "fixed"]
        own = {body.joint.name for body in moving}
        laws = [law for law in world.controllers if own & set(law.joints)]
        whole = own <= {name for law in laws for name in law.joints}
        extra = any(body.joint.damping or body.joint.spring_stiffness for body in moving)
        extra = extra or bool(world.constraints) or bool(world.sums)
        if not laws or not whole or extra or any(law.law != "computed-torque" or law.hold > 1 for law in laws):
            continue
        for law in laws:
            stiffness, damping = law.natural_frequency**2, 2.0 * law.damping_ratio * law.natural_frequency
            ahead = law.discretisation == "implicit"
            divisor = 1.0 + damping * dt + stiffness * dt**2 if ahead else 1.0
            slope = np.array([-stiffness, -(damping + (stiffness * dt if ahead else 0.0))]) / divisor
            speed = np.array([dt * slope[0], 1.0 + dt * slope[1]])
            matrix = np.array([[1.0, 0.0] + dt * speed, speed])
            share = [np.linalg.matrix_power(matrix, row * EVERY)[0, 0] for row in range(count)]
            for name in law.joints:
                column = joints.index(name)
                targets[:, column] = start[column] + step[column] * (1.0 - np.array(share))
    return targets


def control_checks(response: Response, answer: Mapping[str, np.ndarray]) -> list[Check]:
    """Two checks: against the oracle under the same law, and against the closed form."""
    positions = answer["positions"]
    floor = f"floor {response.floor:.1e}, {response.steps} steps of {response.world.physics.timestep:g} s"
    if response.steps < STEPS:
        floor += f" of {STEPS}: then a joint comes near a limit"
    if response.clipped:
        floor += ", some efforts clipped"
    if positions.shape != response.positions.shape or not np.isfinite(positions).all():
        detail = f"positions of shape {positions.shape}, not all of them finite; {floor}"
        return [Check("L7", "step response", positions.size, response.tolerance, None, "", detail)]
    checks = [_check("step response", response, response.positions, positions, floor)]
    if not np.isnan(response.closed).all():
        checks.append(_check("step response, closed form", response, response.closed, positions, floor))
    return checks


def _check(name: str, response: Response, expected: np.ndarray, actual: np.ndarray, detail: str) -> Check:
    error = np.where(np.isnan(expected), 0.0, np.abs(actual - expected))
    row, column = np.unravel_index(int(error.argmax()), error.shape)
    worst = float(error[row, column])
    where = f"joints.{response.joints[column]}, step {row * EVERY}"
    count = int((~np.isnan(expected)).sum())
    if response.steps < EVERY:  # the beginning alone, which is given
        return Check("L7", name, 0, response.tolerance, None, "", detail)
    return Check("L7", name, count, response.tolerance, worst, where, detail)
