"""Seeded states, and what kinematics and dynamics an engine makes of them, against the oracle (levels L2 and L3)."""

from __future__ import annotations

import dataclasses
import itertools
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from simspec.compiler import compile_world, missing_options, write_folder
from simspec.control.law import Control
from simspec.control.reference import driven_joints, reference
from simspec.control.request import to_request
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.capabilities import DOUBLE, ROUNDING
from simspec.engines.kit.process import Operation, call
from simspec.engines.kit.registry import engine_name, find_engine
from simspec.errors import EngineError
from simspec.files import scratch_folder
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.proof.checks import LEEWAY, OTHERS, PRECISIONS, Check, Demand, Demands, Precision, Rounded, Tally
from simspec.proof.limits import Stops, inside
from simspec.proof.motion import NEAR
from simspec.world import frames
from simspec.world.actions import JointTrajectory
from simspec.world.frames import quaternion, vector3
from simspec.world.kinematics import constrained_trees, frictional_coordinates, initial_state, layout_of, trees, within
from simspec.world.rotations import rotation_error
from simspec.world.types import Body, Contact, EngineOptions, Inertial, Joint, Physics, Pose, World

FRAME_CHECK = "frame, position"
STATES = 5
FEW_STATES = 1
LARGE = 200
"""Coordinates above which one state is probed: a mass matrix of 1,296 coordinates is 13 MB."""


def kinematics_checks(
    world: World,
    oracle: Oracle,
    q: np.ndarray,
    v: np.ndarray,
    answer: Mapping[str, np.ndarray],
    precision: Precision = PRECISIONS[DOUBLE],
    has_frames: bool = False,
) -> list[Check]:
    """Poses and velocities of all bodies at states (k, nq), (k, nv), poses of named frames where the engine receives them, and
    whether the engine gives a state back."""
    tally = Tally()
    names = [body.name for body in world.bodies]
    for row in range(len(q)):
        pose, velocity = oracle.body_poses(q[row]), oracle.body_velocities(q[row], v[row])
        reach = np.maximum(1.0, np.linalg.norm(pose[:, :3], axis=1))
        away = np.linalg.norm(answer["pose"][row][:, :3] - pose[:, :3], axis=1) / reach
        turned = rotation_error(answer["pose"][row][:, 3:], pose[:, 3:])
        fast = np.maximum(1.0, np.linalg.norm(velocity, axis=1))
        faster = np.linalg.norm(answer["velocity"][row] - velocity, axis=1) / fast
        for name, values in (("pose, position", away), ("pose, orientation", turned), ("body velocity", faster)):
            worst = int(np.argmax(values)) if np.isfinite(values).all() else int(np.argmin(np.isfinite(values)))
            tally.add("L2", name, precision.model, float(values[worst]), f"bodies.{names[worst]}, state {row}")
        if has_frames and world.frames:
            given = answer["frame"][row] if "frame" in answer else np.zeros((0, 7))
            _add_frames(tally, world, pose, given, row, precision.model)
        state = float(np.abs(answer["v"][row] - v[row]).max(initial=0.0))
        if precision.name != DOUBLE:  # single precision has fewer digits behind the point for velocities of some m/s
            state /= max(1.0, float(np.abs(v[row]).max(initial=0.0)))
        tally.add("L2", "state given back", precision.model, state, f"state {row}")
    return tally.checks()


def _add_frames(tally: Tally, world: World, pose: np.ndarray, values: np.ndarray, state: int, tolerance: float) -> None:
    """Poses ``held`` (frames, 7) of named frames against where bodies at ``pose`` (bodies, 7) carry them."""
    if len(values) != len(world.frames):
        tally.add("L2", FRAME_CHECK, tolerance, math.inf, f"{len(values)} frames, should be {len(world.frames)}")
        return
    rows = {body.name: index for index, body in enumerate(world.bodies)}
    for frame, actual in zip(sorted(world.frames, key=lambda entry: entry.name), values, strict=True):
        body = pose[rows[frame.body]]
        place = frames.compose(Pose(vector3(body[:3].tolist()), quaternion(body[3:].tolist())), frame.pose)
        at = np.array(place.position)
        away = float(np.linalg.norm(actual[:3] - at)) / max(1.0, float(np.linalg.norm(at)))
        turned = float(rotation_error(actual[None, 3:], np.array([place.quaternion]))[0])
        where = f"frames.{frame.name}, state {state}"
        tally.add("L2", FRAME_CHECK, tolerance, away, where)
        tally.add("L2", "frame, orientation", tolerance, turned, where)


QUANTITIES = ("mass_matrix", "bias_force")
"""Quantities of an engine's dynamics, each where it has the capability of that name."""


def dynamics_operation(
    oracle: Oracle, q: np.ndarray, v: np.ndarray, quantities: Sequence[str] = QUANTITIES
) -> Operation:
    """The operation for an engine at states (k, nq), (k, nv): see :func:`dynamics_checks`."""
    places = np.concatenate([np.zeros(0, dtype=np.int64), *oracle.blocks])
    sizes = [len(block) for block in oracle.blocks]
    parameters = {"sizes": sizes, "quantities": list(quantities)}
    return Operation("dynamics", parameters, {"q": q, "v": v, "places": places}, oracle.world)


def dynamics_checks(
    world: World,
    oracle: Oracle,
    q: np.ndarray,
    v: np.ndarray,
    answer: Mapping[str, np.ndarray],
    precision: Precision = PRECISIONS[DOUBLE],
) -> list[Check]:
    """Mass matrix and bias force at states (k, nq), (k, nv) with velocity, and gravity force at the same ones at rest.

    Deviations are in each coordinate's own scale: an element of M as :func:`_scale` says, a force relative to √(Mii · hᵀM⁻¹h),
    its share of the effort's own energy norm in its tree, or to Mii × 1 (m/s² or rad/s²) where the force vanishes. Arrays
    that are not in ``answer`` were not requested.
    """
    tally = Tally()
    names = [body.name for body in world.bodies for _ in body.joint.velocity]
    turning, depth = _turning(world), _depths(world)
    zeros = np.zeros(oracle.nv)
    for row in range(len(q) if oracle.blocks else 0):
        masses = oracle.mass_blocks(q[row])
        forces = {}
        if "bias_force" in answer:
            forces["bias force"] = (oracle.bias_force(q[row], v[row]), answer["bias_force"][row])
            forces["gravity force"] = (oracle.bias_force(q[row], zeros), answer["gravity_force"][row])
        ends = np.cumsum([mass.size for mass in masses])
        packed = np.split(answer["mass"][row], ends[:-1]) if "mass" in answer else ()
        for block, mass, entries in itertools.zip_longest(oracle.blocks, masses, packed):
            root = np.sqrt(np.diag(mass))
            if entries is not None:
                scale = _scale(mass, turning[block], precision) * _grown(depth[block], precision)
                error = np.abs(entries.reshape(mass.shape) - mass) / scale
                at_row, at_column = np.unravel_index(int(np.argmax(error)), error.shape)
                where = f"bodies.{names[block[at_row]]}, bodies.{names[block[at_column]]}, state {row}"
                tally.add("L3", "mass matrix", precision.model, float(error[at_row, at_column]), where)
            for name, (expected, measured) in forces.items():
                force = expected[block]
                strength = math.sqrt(max(0.0, float(force @ np.linalg.solve(mass, force))))
                error = np.abs(measured[block] - force) / (root * np.maximum(strength, root))
                i = int(np.argmax(error))
                tally.add("L3", name, precision.model, float(error[i]), f"bodies.{names[block[i]]}, state {row}")
    return tally.checks()


def _turning(world: World) -> np.ndarray:
    """For each coordinate of v (n,) the number of the body that it turns about all three axes, -1 where it does not."""
    found = []
    for number, body in enumerate(world.bodies):
        count = len(body.joint.velocity)
        turns = 3 if body.joint.kind in QUATERNION_JOINTS else 0
        found += [-1] * (count - turns) + [number] * turns
    return np.array(found, dtype=int)


def _scale(mass: np.ndarray, turning: np.ndarray, precision: Precision) -> np.ndarray:
    """The scale of deviations of a mass matrix (n, n): √(Mii Mjj). Engines hold the inverse of a body's tensor, whose
    elements are all rounded as the largest one is, that of the least moment. Inverted again this is a rounding times the ratio
    of √(Mii Mjj) to the least moment, which counts as the whole tolerance at least. In doubles it is of no account; in singles
    it is for rods whose moments differ by more than 33 times (4e-6 measured at a ratio of 109, in two engines)."""
    diagonal = np.diag(mass)
    scale: np.ndarray = np.sqrt(np.outer(diagonal, diagonal))
    same = (turning[:, None] == turning) & (turning >= 0)
    least = np.array([min(diagonal[turning == number], default=math.inf) for number in turning])
    rounded = ROUNDING[precision.name] / precision.model * scale / least
    return np.where(same, scale * np.maximum(1.0, rounded), scale)


ROUNDINGS_OF_A_LINK = 6.0
"""Of the position and orientation of a link, relative to the link that carries it: 5.6 measured in a chain of
six, 3.5 of 14."""


def _depths(world: World) -> np.ndarray:
    """For each coordinate of v (n,) the number of bodies from the world to the last body that it moves."""
    depths: dict[str, int] = {}
    for body in world.bodies:
        depths[body.name] = 1 + (0 if body.joint.parent is None else depths[body.joint.parent])
    for body in reversed(world.bodies):
        if body.joint.parent is not None:
            depths[body.joint.parent] = max(depths[body.joint.parent], depths[body.name])
    return np.array([depths[body.name] for body in world.bodies for _ in body.joint.velocity], dtype=float)


def _grown(depth: np.ndarray, precision: Precision) -> np.ndarray:
    """The factor (n, n) by which round-off along chains of ``depth`` (n,) exceeds the tolerance of M: above 1 in singles, for
    more than five links (2.01e-6 measured with six, 2.9e-6 with 14, of a finger of a hand on an arm)."""
    rounded = ROUNDINGS_OF_A_LINK * ROUNDING[precision.name] / precision.model * depth
    factor: np.ndarray = np.maximum(1.0, np.maximum(rounded[:, None], rounded[None, :]))
    return factor


# The shortest test of whether an engine works at all: a ball falls for a tenth of a second, in its own process.

GRAVITY, TIMESTEP, STEPS, HEIGHT = 9.81, 1e-3, 100, 1.0
DEADLINE = 60.0
"""s: a cold disk and a compiler at work on an engine's own part take some; the fall itself milliseconds. Compiling
a model comes on top (``Engine.COMPILING``)."""
SPEED = 1e-5
"""How far the speed may be from g t, relative: every integrator that simspec admits gives it exactly, and a hundred sums in
single precision are off by 100 × 6e-8 at most."""
WAY = GRAVITY * TIMESTEP * TIMESTEP * STEPS
"""m, how far the height may be from ½ g t²: twice the error of an integrator of first order."""


@dataclass(frozen=True, slots=True)
class Fall:
    """A fall: the engine's version, s that it took, and how far speed (relative) and height (m) are from the closed form."""

    version: str
    seconds: float
    speed_error: float
    height_error: float


def fall(engine: str, python: str | None = None, deadline: float | None = None) -> Fall:
    """Let a ball fall in ``engine``, within ``deadline`` (s; None: the engine's largest need). Raises EngineError where
    that fails, or where the ball does not fall as a ball does."""
    ball = Body(
        "ball",
        "ball",
        Inertial(2.0, (0.0, 0.0, 0.0), (0.02, 0.02, 0.02, 0.0, 0.0, 0.0)),
        Joint("free", "free", position=(0.0, 0.0, HEIGHT, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6),
    )
    world = World("fall", (ball,), Contact(), Physics((0.0, 0.0, -GRAVITY), TIMESTEP, STEPS))
    deadline = DEADLINE + find_engine(engine).COMPILING if deadline is None else deadline
    pythons = {engine: python} if python is not None else {}
    # how a body turns, which an engine may have approximately, is not tested here
    needed = missing_options(world, engine, pythons)
    accept, outside = (tuple(sorted(needed.get(key, ()))) for key in ("accept", "outside"))
    world = replace(world, engines=(EngineOptions(engine_name(engine), accept=accept, outside=outside),))
    began = time.perf_counter()
    with scratch_folder("fall") as folder:
        write_folder(compile_world(world, [engine], pythons=pythons)[engine].files, folder / "files")
        parameters = {"timestep": TIMESTEP, "phases": [[STEPS, STEPS]]}
        drive = Operation("drive", parameters, {"effort": np.zeros((1, 6))}, world)
        reply = call(engine, folder / "files", [drive], python=python, deadline=deadline)
    arrays = reply.answers[0].arrays
    t = STEPS * TIMESTEP
    speed = abs(float(arrays["velocity"][-1, 0, 2]) + GRAVITY * t) / (GRAVITY * t)
    height = abs(float(arrays["pose"][-1, 0, 2]) - (HEIGHT - 0.5 * GRAVITY * t * t))
    if not (speed <= SPEED and height <= WAY):
        raise EngineError(
            engine,
            f"a ball that falls for {t:g} s has a speed that is {speed:.3g} (relative) off g t, and a height that is "
            f"{height:.3g} m off ½ g t²; allowed are {SPEED:g} and {WAY:.3g} m",
        )
    return Fall(reply.versions["engine_version"], time.perf_counter() - began, speed, height)


# Level L7: the controllers' step response, in every engine, without contact.
#
# All driven joints begin at rest and receive constant targets close by. The engine's motion is compared with
# the oracle under the same law, dry friction switched off, and, where computed torque has the whole tree to itself, against the
# closed form: then v̇ is the law's a exactly, whatever the robot, and the deviation of each joint obeys a recursion of two
# numbers. The tolerance is L6's.

RESPONSE_STEPS = 500
"""At 1 ms half a second, in which a law of 10 rad/s has done 96 % of its way."""
EVERY = 10
STEP = 0.05
"""rad or m: large enough for the Coriolis force to matter, small enough for a finger."""
SHARE = 0.05
"""Largest share of a joint's range that its target is away."""
INSIDE = 0.1
"""Share of its range that a joint begins away from its limits, which the oracle does not know."""
HALVINGS = 30
"""How often the step is halved until no effort is clipped."""


@dataclasses.dataclass(frozen=True)
class Response:
    """A beginning (``q``, ``v``) of a ``world`` with a constant trajectory, and the expected motion, at every ``EVERY``-th
    step: ``positions`` (n, joints) by the oracle with its round-off ``floor``, ``closed`` the same by the closed form, NaN
    where there is none. ``joints``: their names. ``steps``: after so many a joint comes near a limit; from there on both are
    NaN."""

    world: World
    q: np.ndarray
    v: np.ndarray
    joints: tuple[str, ...]
    positions: np.ndarray
    closed: np.ndarray
    floor: float
    clipped: bool
    steps: int = RESPONSE_STEPS
    precision: Precision = PRECISIONS[DOUBLE]
    spread: float = 0.0
    """How far another method of integration may deviate; 0: none is declared."""

    def operation(self, world: World) -> Operation:
        """The operation for an engine (see ``engines/kit/worker.py``)."""
        parameters, arrays = to_request(self.world)
        arrays = {**arrays, "q": self.q, "v": self.v, "rubbing": frictional_coordinates(self.world)}
        return Operation("respond", {**parameters, "steps": RESPONSE_STEPS, "every": EVERY}, arrays, self.world)

    @property
    def tolerance(self) -> float:
        """That of L6."""
        return max(self.precision.tolerance(self.floor), self.spread)

    @property
    def _parts(self) -> Mapping[str, np.ndarray]:
        """The expected positions by check, of those that there are."""
        parts = {"step response": self.positions, "step response, closed form": self.closed}
        return {name: expected for name, expected in parts.items() if not np.isnan(expected).all()}

    def demands(self) -> Demands:
        """One comparison for each joint at each instant at which it has an expected position."""
        tolerance = max(self.precision.tolerance(LEEWAY * self.floor), self.spread)
        counts = {("L7", name): int((~np.isnan(expected)).sum()) for name, expected in self._parts.items()}
        return {part: Demand(count, count, tolerance) for part, count in counts.items()}

    def checks(self, world: World, answer: Mapping[str, np.ndarray], creep: float = 0.0) -> list[Check]:
        """Two checks: against the oracle under the same law, and against the closed form."""
        actual = answer["positions"]
        detail = f"floor {self.floor:.1e}, {self.steps} steps of {self.world.physics.timestep:g} s"
        detail += f" of {RESPONSE_STEPS}: then a joint comes near a limit" if self.steps < RESPONSE_STEPS else ""
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
        targets = JointTrajectory(joints, (0.0,), (tuple((q[places] + amount).tolist()),))
        requested = dataclasses.replace(world, trajectory=targets)
        control, positions, steps = _response(requested, q, v)
        if not control.clipped.any():
            break
        amount = amount / 2.0
    rows = steps // EVERY + 1
    rounded = precision.rounding(0, np.random.default_rng(0))  # one disturbed run is enough: a law holds what it drives
    disturbed = _response(requested, q * (1.0 + precision.perturbation), v, rounded)[1]
    floor = float(np.abs(positions - disturbed)[:rows].max())
    spread = _spread(requested, q, v, positions[:rows]) if precision.order else 0.0
    closed = _closed_form(requested, joints, q[places], amount, bool(control.clipped.any()))
    positions[rows:] = closed[rows:] = np.nan
    return Response(
        requested, q, v, joints, positions, closed, floor, bool(control.clipped.any()), steps, precision, spread
    )


def _spread(world: World, q: np.ndarray, v: np.ndarray, positions: np.ndarray) -> float:
    """How far another method of integration may deviate from the oracle's positions: a multiple of the effect of half the
    timestep, by laws that act as often."""
    laws = tuple(dataclasses.replace(law, every_steps=2 * law.hold) for law in world.controllers)
    physics = dataclasses.replace(world.physics, timestep=0.5 * world.physics.timestep)
    finer = _response(dataclasses.replace(world, controllers=laws, physics=physics), q, v, halves=2)[1]
    return OTHERS * float(np.abs(finer[: len(positions)] - positions).max(initial=0.0))


def _response(
    world: World, q: np.ndarray, v: np.ndarray, rounded: Rounded | None = None, halves: int = 1
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
    positions = control.follow(joints, halves * RESPONSE_STEPS, halves * EVERY)
    return control, positions, joints.steps


def _closed_form(
    world: World, joints: tuple[str, ...], start: np.ndarray, step: np.ndarray, clipped: bool
) -> np.ndarray:
    """Positions by e' = e + dt v', v' = v + dt a, a = −(c₁ v + c₀ e) (implicit: of the step's end), e = q − q*."""
    count = RESPONSE_STEPS // EVERY + 1
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
