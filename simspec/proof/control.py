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
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.capabilities import DOUBLE
from simspec.engines.kit.process import Operation
from simspec.proof.checks import LEEWAY, PRECISIONS, Check, Demand, Demands, Precision, Rounded
from simspec.proof.limits import Stops, inside
from simspec.proof.motion import NEAR
from simspec.world.actions import Trajectory
from simspec.world.kinematics import constrained_trees, frictional_coordinates, initial_state, layout_of, trees, within
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

    def operation(self, world: World) -> Operation:
        """The operation that an engine is asked for (see ``engines/kit/worker.py``)."""
        parameters, arrays = to_request(self.world)
        arrays = {**arrays, "q": self.q, "v": self.v, "rubbing": frictional_coordinates(self.world)}
        return Operation("respond", {**parameters, "steps": STEPS, "every": EVERY}, arrays, self.world)

    @property
    def tolerance(self) -> float:
        """That of L6."""
        return self.precision.tolerance(self.floor)

    @property
    def _parts(self) -> Mapping[str, np.ndarray]:
        """The expected positions by check, of those that there are."""
        parts = {"step response": self.positions, "step response, closed form": self.closed}
        return {name: expected for name, expected in parts.items() if not np.isnan(expected).all()}

    def demands(self) -> Demands:
        """One comparison for each joint at each instant at which it has an expected position."""
        tolerance = self.precision.tolerance(LEEWAY * self.floor)
        counts = {("L7", name): int((~np.isnan(expected)).sum()) for name, expected in self._parts.items()}
        return {part: Demand(count, count, tolerance) for part, count in counts.items()}

    def checks(self, world: World, answer: Mapping[str, np.ndarray], creep: float = 0.0) -> list[Check]:
        """Two checks: against the oracle under the same law, and against the closed form."""
        actual = answer["positions"]
        detail = f"floor {self.floor:.1e}, {self.steps} steps of {self.world.physics.timestep:g} s"
        detail += f" of {STEPS}: then a joint comes near a limit" if self.steps < STEPS else ""
        detail += ", some efforts clipped" if self.clipped else ""
        if actual.shape != self.positions.shape or not np.isfinite(actual).all():
            detail = f"positions of shape {actual.shape}, not all of them finite; {detail}"
            return [Check("L7", "step response", actual.size, self.tolerance, None, "", detail)]
        checks = []
        for name, expected in self._parts.items():
            error = np.where(np.isnan(expected), 0.0, np.abs(actual - expected))
            row, column = np.unravel_index(int(error.argmax()), error.shape)
            found = (int((~np.isnan(expected)).sum()), self.tolerance, float(error[row, column]))
            if self.steps < EVERY:  # the beginning alone, which is given
                checks.append(Check("L7", name, 0, self.tolerance, None, "", detail))
            else:
                checks.append(Check("L7", name, *found, f"joints.{self.joints[column]}, step {row * EVERY}", detail))
        return checks


class _OracleJoints:
    """The driven joints in the oracle's motion; ``steps``: how many are done before a joint comes near a limit."""

    def __init__(self, world: World, control: Control, q: np.ndarray, v: np.ndarray, rounded: Rounded | None = None):
        self._oracle, self._rounded, self._stops = Oracle(world), rounded, Stops(world)
        self._q_places, self._v_places = control.q_places, control.v_places
        self._q, self._v, self._effort = q, v, np.zeros(self._oracle.nv)
        self.steps, self._free = 0, True

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        return self._q[self._q_places], self._v[self._v_places]

    def give(self, effort: np.ndarray) -> None:
        self._effort[self._v_places] = effort

    def step(self) -> None:
        states, speeds = self._oracle.motion(self._q, self._v, self._effort, 1, 1, self._rounded)
        self._q, self._v = states[-1], speeds[-1]
        self._free = self._free and not self._stops.near(self._q[None], NEAR)[0]
        self.steps += self._free


def plan(world: World, oracle: Oracle | None = None, precision: Precision = PRECISIONS[DOUBLE]) -> Response | None:
    """The response of a world's laws; None where nothing but native controllers drives."""
    laws = tuple(controller for controller in world.controllers if controller.law != "native")
    if not laws:
        return None
    world = dataclasses.replace(world, controllers=laws, forces=(), motions=())
    joints = driven_joints(world)
    start, v = initial_state(world)
    v, q = np.zeros_like(v), Stops(world).within(start, INSIDE)
    places, reach = [], []
    for body, at in zip(world.bodies, layout_of(world).position, strict=True):
        if body.joint.name in joints:
            limits = body.joint.position_limits
            places.append(at.start)
            inward = 1.0 if limits is None or q[at.start] < sum(limits) / 2.0 else -1.0
            reach.append(inward * (STEP if limits is None else min(STEP, SHARE * (limits[1] - limits[0]))))
    q = inside(world, q, INSIDE)
    if world.constraints:
        alone = Oracle(world)
        q = alone.inwards(alone.settled(q, start))
    amount = np.array(reach)
    for _ in range(HALVINGS):
        targets = Trajectory(joints, (0.0,), (tuple((q[places] + amount).tolist()),))
        requested = dataclasses.replace(world, trajectory=targets)
        control, positions, steps = _response(requested, q, v)
        if not control.clipped.any():
            break
        amount = amount / 2.0
    rows = steps // EVERY + 1
    rounded = precision.rounding(0, np.random.default_rng(0))  # one disturbed run is enough: a law holds what it drives
    disturbed = _response(requested, q * (1.0 + precision.perturbation), v, rounded)[1]
    floor = float(np.abs(positions - disturbed)[:rows].max())
    closed = _closed_form(requested, joints, q[places], amount, bool(control.clipped.any()))
    positions[rows:] = closed[rows:] = np.nan
    return Response(requested, q, v, joints, positions, closed, floor, bool(control.clipped.any()), steps, precision)


def _response(
    world: World, q: np.ndarray, v: np.ndarray, rounded: Rounded | None = None
) -> tuple[Control, np.ndarray, int]:
    """The oracle's positions (n, joints) under the world's laws, joints in the world's order, and how many steps are done
    before a joint comes near a limit."""
    driven = set(driven_joints(world))
    driven_trees = [bodies for bodies in constrained_trees(world) if any(body.joint.name in driven for body in bodies)]
    names = {body.name for bodies in driven_trees for body in bodies}
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
        names = {body.joint.name for body in moving}
        laws = [law for law in world.controllers if names & set(law.joints)]
        whole = names <= {name for law in laws for name in law.joints}
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
