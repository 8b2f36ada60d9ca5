"""One engine under test: worlds go in, answers of its own process come out, and what it refuses it must have declared."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from simspec.compiler import Compiled, compile_world, needed_decisions, write_folder
from simspec.control.law import Control
from simspec.control.request import to_request
from simspec.dialects.kit.contract import dialects
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.capabilities import DOUBLE, SINGLE, ServoLaw
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Answer, Operation, call
from simspec.engines.kit.registry import find_engine
from simspec.errors import Problem, UnsupportedError
from simspec.language.vocabulary import JOINT_KINDS, QUATERNION_JOINTS, SCALAR_JOINTS
from simspec.proof.certificate import EngineProof
from simspec.proof.checks import PRECISIONS
from simspec.proof.selftest_worlds import framed, sum_friction, sum_limits, sums
from simspec.proof.verify import LEVELS, verify
from simspec.support.declarations import Level, Support, combine
from simspec.support.features import Feature
from simspec.testing import worlds
from simspec.testing.worlds import (
    CONTACT_GAPS,
    accepting,
    ball_with_law,
    damped_springs,
    every_joint,
    gripper,
    ground,
    immersed,
    implicitly_damped,
    jointed,
    lifted,
    limits_and_armature,
    lying,
    point_mass,
    several_joints,
    shapes_world,
    tool_frame,
    touching_link,
    tree,
    with_cone,
    with_options,
    world,
)
from simspec.world.actions import JointController, JointTrajectory
from simspec.world.kinematics import initial_state
from simspec.world.rotations import rotation_error
from simspec.world.types import Body, Inertial, Joint, Physics, World

OF_SINGLES = PRECISIONS[SINGLE].model
"""The tolerance for numbers of single precision, where doubles are compared to some last bits."""
DIRECT = (Level.EXACT, Level.VIA_API)
"""Levels of support for which a spec has to say nothing."""


@dataclass(frozen=True)
class Bench:
    """``engine`` by name or label, the interpreter it lives in (None: this one), and a folder for artifacts."""

    engine: str
    python: str | None
    place: Path

    @property
    def kind(self) -> type[Engine]:
        """The engine's class."""
        return find_engine(self.engine)

    def near(self, double: float, single: float = OF_SINGLES) -> float:
        """A tolerance by the numbers that the engine computes with."""
        return double if self.kind.PRECISION == DOUBLE else single

    def lacks(self, capability: str) -> str:
        """Why the engine lacks a capability (by name); "" where it has it."""
        return {str(name): why for name, why in self.kind.LACKS.items()}.get(capability, "")

    @property
    def support(self) -> Mapping[Feature, Support]:
        """The combined declarations of engine and dialect."""
        return combine(dialects()[self.kind.DIALECT].SUPPORT, self.kind.SUPPORT)

    def refusals(self, world: World) -> tuple[Problem, ...]:
        """The features of ``world`` that the engine declares not to support, each as the problem that a user gets."""
        every = tuple(feature.value for feature in Feature)
        try:
            needed_decisions(
                with_options(world, self.kind.NAME, accept=every, outside=every), self.engine, pythons=self.pythons
            )
        except UnsupportedError as error:
            return error.problems
        return ()

    def allowed(self, world: World) -> World | None:
        """``world`` with everything accepted that the engine has approximately or outside; None where the engine declares that
        it does not support it, after compiling was seen to raise the error that says so.

        A refusal that is not declared is raised, as the failure that it is.
        """
        declared = self.refusals(world)
        if not declared:
            return accepting(world, self.kind.NAME)
        try:
            self.compiled(world)
        except UnsupportedError as error:
            messages = [problem.message for problem in error.problems]
            for problem in declared:
                assert problem.message in messages, f"no error says: {problem.message}"
            return None
        raise AssertionError(f"{self.engine} declares {declared[0].message!r}, and compiles the world")

    def first_allowed(self) -> World:
        """The first of a few simple worlds that the engine supports; the last has one free body without shapes."""
        few = (worlds.spheres(), worlds.hinges(), worlds.jointed("free"))
        world = next(filter(None, map(self.allowed, few)), None)
        assert world is not None, f"{self.engine} supports no free body"
        return world

    @property
    def pythons(self) -> dict[str, str]:
        """Its interpreter, where it is not this one, by the engine's label."""
        return {} if self.python is None else {self.engine: self.python}

    def compiled(self, world: World) -> Compiled:
        """The files of ``world``."""
        return compile_world(world, [self.engine], pythons=self.pythons)[self.engine]

    def artifacts(self, world: World) -> Path:
        """A new folder with the files of ``world``."""
        folder = self.place / str(len(list(self.place.iterdir())))
        write_folder(self.compiled(world).files, folder)
        return folder

    def ask(self, world: World, *operations: Operation) -> list[Answer]:
        """The answers of the engine's process, each operation with ``world`` loaded anew."""
        return call(self.engine, self.artifacts(world), operations, python=self.python).answers

    def run(self, world: World, steps: int, every: int | None = None, *channels: str) -> Answer:
        """A recorded run of ``world``, under its controllers: see :func:`run_operation`."""
        (answer,) = self.ask(world, run_operation(world, steps, every, *channels))
        return answer

    def drive(self, world: World, *phases: tuple[int, np.ndarray | None]) -> Mapping[str, np.ndarray]:
        """Motion with contact through phases of (steps, effort (nv,) or None): time, pose, velocity, one row at the start and
        one at the end of each phase."""
        (answer,) = self.ask(world, drive_operation(world, *phases))
        return answer.arrays

    def proof(self, world: World, *levels: str) -> EngineProof:
        """The proof of ``world`` in the engine, of these levels (none: all)."""
        return verify(world, [self.engine], pythons=self.pythons, levels=levels or LEVELS).engines[self.engine]


def run_operation(world: World, steps: int, every: int | None = None, *channels: str) -> Operation:
    """A run of ``steps``, recorded every ``every`` (None: at the start and at the end), with ``channels`` recorded too."""
    parameters: dict[str, Any] = {"steps": steps, "every": every or max(steps, 1), "channels": list(channels)}
    requested, arrays = to_request(world)
    return Operation("run", {**parameters, **requested}, arrays, world)


def windows_operation(world: World, run: Answer, *channels: str) -> Operation:
    """Windows from every recorded row of ``run`` but the last to the one after it; see ``_windows`` in ``operations.py``."""
    step = np.asarray(run.arrays["step"], dtype=np.int64)
    (steps,) = set(np.diff(step).tolist())
    requested, arrays = to_request(world)
    states = {name: np.ascontiguousarray(run.arrays[name][:-1]) for name in ("q", "v")}
    parameters: dict[str, Any] = {"starts": step[:-1].tolist(), "steps": steps, "channels": list(channels)}
    return Operation("windows", {**parameters, **requested}, {**arrays, **states}, world)


def drive_operation(world: World, *phases: tuple[int, np.ndarray | None]) -> Operation:
    """See :meth:`Bench.drive`."""
    zeros = np.zeros(sum(len(body.joint.velocity) for body in world.bodies))
    efforts = np.array([zeros if effort is None else effort for _, effort in phases])
    parameters = {"timestep": world.physics.timestep, "phases": [[steps, steps] for steps, _ in phases]}
    return Operation("drive", parameters, {"effort": efforts}, world)


def motion_operation(
    world: World, q: np.ndarray, v: np.ndarray, effort: np.ndarray, steps: int, every: int
) -> Operation:
    """Contact-free motion from a state under a constant effort."""
    arrays = {"q": q, "v": v, "effort": effort, "rubbing": np.zeros(0, dtype=np.int64)}
    return Operation("motion", {"steps": steps, "every": every}, arrays, world)


def touching_operation(world: World, q: np.ndarray) -> Operation:
    """Which bodies touch in the states q (k, nq)."""
    nv = sum(len(body.joint.velocity) for body in world.bodies)
    return Operation("touching", {}, {"q": q, "v": np.zeros((1, nv))}, world)


def state_error(world: World, measured: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference of coordinates; quaternions as rotations (rad)."""
    worst, at = 0.0, 0
    for body in world.bodies:
        size = len(body.joint.position)
        values, other = measured[at : at + size], expected[at : at + size]
        at += size
        if body.joint.kind in QUATERNION_JOINTS:
            worst = max(worst, float(rotation_error(values[-4:], other[-4:])))
            values, other = values[:-4], other[:-4]
        worst = max(worst, float(np.abs(values - other).max(initial=0.0)))
    return worst


def failures(checks: Sequence[Any]) -> list[Any]:
    """The checks that did not pass."""
    return [check for check in checks if not check.passed]


# Parts common to all suites: the engine's name, its interpreter, and a bench to query it on.


class Suite:
    """A suite of tests of one engine. Subclasses say which."""

    engine: ClassVar[str]
    """Its name, as in its entry point."""
    python: ClassVar[str | None] = None
    """The interpreter that it lives in; None: the one that runs the tests, or none for an engine that is a program."""

    @pytest.fixture(scope="class")
    @classmethod
    def bench(cls, tmp_path_factory: pytest.TempPathFactory) -> Bench:
        """The engine under test."""
        return Bench(cls.engine, cls.python, tmp_path_factory.mktemp("bench"))


# Worlds with driven joints, and joints driven in the oracle.


def driven(world: World, law: str = "computed-torque", joints: tuple[str, ...] | None = None, **more: Any) -> World:
    """``world`` with one controller on all its hinges and slides (or ``joints``), and gains that suit a body of 1 kg."""
    if joints is None:
        joints = tuple(body.joint.name for body in world.bodies if body.joint.kind in SCALAR_JOINTS)
    given: dict[str, Any] = {"effort_limits": (None,) * len(joints)}
    if law == "computed-torque":
        given |= {"natural_frequency": 20.0, "damping_ratio": 1.0}
    else:
        given |= {"kp": (40.0,) * len(joints), "kd": (3.0,) * len(joints)}
    return dataclasses.replace(world, controllers=(JointController("all", joints, law, **(given | more)),))


def native(base: World, kp: float = 40.0, kd: float = 3.0, limit: float | None = None) -> World:
    """``base`` with its hinges and slides under the engine's own controllers."""
    joints = tuple(body.joint.name for body in base.bodies if body.joint.kind in SCALAR_JOINTS)
    count = len(joints)
    controller = JointController(
        "all", joints, "native", kp=(kp,) * count, kd=(kd,) * count, effort_limits=(limit,) * count
    )
    return dataclasses.replace(base, controllers=(controller,))


def with_targets(world: World, targets: np.ndarray, joints: tuple[str, ...] | None = None) -> World:
    """``world`` with constant targets: a trajectory of one point."""
    joints = joints or world.controllers[0].joints
    return dataclasses.replace(world, trajectory=JointTrajectory(joints, (0.0,), (tuple(map(float, targets)),)))


def chain(kinds: tuple[str, ...] = ("hinge", "slide", "hinge", "hinge"), timestep: float = 0.001, **more: Any) -> World:
    """A chain of random bodies on a fixed base, at rest, under gravity."""
    bodies = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=(0.0,) * len(body.joint.velocity)))
        for body in worlds.tree(list(kinds), 5, **more)
    )
    return worlds.world(bodies, physics=Physics(timestep=timestep, steps=1000))


def wheel(inertia: float = 0.02, timestep: float = 0.001) -> World:
    """One hinge about the vertical, with its centre of mass on the axis: M = inertia, h = 0."""
    joint = Joint("wheel_joint", "hinge", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    body = Body("wheel", "wheel", Inertial(1.0, inertia=(inertia, inertia, inertia, 0.0, 0.0, 0.0)), joint)
    return worlds.world((body,), physics=Physics(timestep=timestep, steps=1000))


class OracleJoints:
    """The driven joints, in the oracle's motion of the whole world."""

    def __init__(self, world: World, control: Control):
        self.oracle = Oracle(world)
        self.q, self.v = initial_state(world)
        self._effort = np.zeros(self.oracle.nv)
        self._control = control
        self._done = 0

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        return self.q[self._control.q_places], self.v[self._control.v_places]

    def give(self, effort: np.ndarray) -> None:
        self._effort[self._control.v_places] = effort

    def step(self) -> None:
        pushed = pushes(self.oracle, self.q, self._done)
        states, speeds = self.oracle.motion(self.q, self.v, self._effort + pushed, 1, 1)
        self.q, self.v = states[-1], speeds[-1]
        self._done += 1


def pushes(oracle: Oracle, q: np.ndarray, step: int) -> np.ndarray:
    """The efforts (nv,) of a world's forces on bodies in a step, by the oracle's own Jacobians."""
    dt, effort = oracle.timestep, np.zeros(oracle.nv)
    for force in oracle.world.forces:
        until = np.inf if force.until is None else force.until / dt
        share = min(step + 1.0, until) - max(float(step), force.start / dt)
        effort += float(np.clip(share, 0.0, 1.0)) * oracle.effort_of(q, force)
    return effort


# Joints under an engine's own controllers, each alone on its base, and where the declared law takes them in closed form.

GRAVITY = -9.81
END = 2.0
"""s at which the targets' motion ends; tests are shorter."""


@dataclass(frozen=True)
class Servo:
    """One joint with its controller. ``slide``: a vertical slide under gravity, with a mass in place of a moment of inertia."""

    name: str
    inertia: float = 0.02
    kp: float = 40.0
    kd: float = 3.0
    limit: float | None = None
    target: float = 0.5
    speed: float = 0.0
    """Of the target, rad/s."""
    slide: bool = False


SERVOS = (
    Servo("unlimited"),
    Servo("limited", limit=5.0),
    Servo("weak", limit=0.4),
    Servo("moving", target=0.0, speed=0.5),
    Servo("velocity", kp=0.0, target=0.0, speed=0.5),
    Servo("hanging", inertia=2.0, kp=1000.0, kd=100.0, target=0.1, slide=True),
)


def servo_world(timestep: float, servos: tuple[Servo, ...] = SERVOS) -> World:
    """All the servos side by side, each from rest at zero."""
    joints = tuple(f"{servo.name}_joint" for servo in servos)
    control = JointController(
        "all",
        joints,
        "native",
        kp=tuple(servo.kp for servo in servos),
        kd=tuple(servo.kd for servo in servos),
        effort_limits=tuple(servo.limit for servo in servos),
    )
    rows = tuple(tuple(servo.target + time * servo.speed for servo in servos) for time in (0.0, END))
    trajectory = JointTrajectory(joints, (0.0, END), rows, interpolation="linear")
    physics = Physics((0.0, 0.0, GRAVITY), timestep, round(END / timestep))
    return worlds.world(tuple(map(_body, servos)), physics=physics, controllers=(control,), trajectory=trajectory)


def _body(servo: Servo) -> Body:
    joint = Joint(
        f"{servo.name}_joint",
        "slide" if servo.slide else "hinge",
        axis=(0.0, 0.0, 1.0),
        position=(0.0,),
        velocity=(0.0,),
    )
    mass, moment = (servo.inertia, 0.1) if servo.slide else (1.0, servo.inertia)
    return Body(servo.name, servo.name, Inertial(mass, inertia=(moment, moment, moment, 0.0, 0.0, 0.0)), joint)


def closed_form(law: ServoLaw, servo: Servo, steps: int, dt: float) -> np.ndarray:
    """Positions of the joint at the start and after each step (steps + 1,), by what the law declares."""
    q = v = 0.0
    fall = GRAVITY if servo.slide else 0.0
    limit = math.inf if servo.limit is None else servo.limit
    kp, kd, inertia, speed = servo.kp, servo.kd, servo.inertia, servo.speed
    positions = [q]
    for step in range(steps):
        error = servo.target + speed * step * dt - q
        if law is ServoLaw.EXPLICIT_SPRING:
            effort = kp * error + kd * (speed - v)
        elif law is ServoLaw.IMPLICIT_SPRING:
            after = (v + dt * fall + dt / inertia * (kp * error + kd * speed)) / (1.0 + dt / inertia * (kd + dt * kp))
            effort = kp * (error - dt * after) + kd * (speed - after)
        else:
            effort = inertia * ((speed + kp / (kd + dt * kp) * error - v) / dt - fall)
        v += dt * (min(max(effort, -limit), limit) / inertia + fall)
        q += dt * v
        positions.append(q)
    return np.array(positions)


# For each feature of the language a small world that needs it, for tests of features that an engine does not support.


def boxes() -> World:
    """Two boxes above a floor, of one size, so that their edges may cross."""
    base = shapes_world(("box",))
    floor, box = base.bodies
    joint = dataclasses.replace(box.joint, name="other_joint", position=(1.0, *box.joint.position[1:]))
    shapes = tuple(dataclasses.replace(shape, name="other_0") for shape in box.shapes)
    other = dataclasses.replace(box, name="other", model="other", joint=joint, shapes=shapes)
    return dataclasses.replace(base, bodies=(floor, box, other))


def felt_at_a_distance() -> World:
    """A sphere and a box above a floor, all with margins, without friction."""
    world = shapes_world(("sphere", "box"), 0.0)
    bodies = tuple(
        dataclasses.replace(
            body, shapes=tuple(dataclasses.replace(shape, margin=0.001 * number) for shape in body.shapes)
        )
        for number, body in enumerate(world.bodies, 1)
    )
    return dataclasses.replace(world, bodies=bodies)


def belt() -> World:
    """A sphere on a box whose surface moves."""
    base = shapes_world(("sphere",))
    floor, *others = base.bodies
    (shape,) = floor.shapes
    moving = dataclasses.replace(shape, surface_velocity=(0.2, 0.0, 0.0, 0.0, 0.0, 0.1))
    return dataclasses.replace(base, bodies=(dataclasses.replace(floor, shapes=(moving,)), *others))


NEEDING: Mapping[Feature, Callable[[], World]] = {
    **{
        Feature(f"shape.{kind}"): partial(shapes_world, (kind,))
        for kind in ("mesh", "ellipsoid", "capsule", "cylinder", "sphere")
    },
    Feature.SHAPE_BOX: boxes,
    Feature.SHAPE_HEIGHTFIELD: ground,
    **{Feature(f"joint.{kind}"): partial(jointed, kind) for kind in JOINT_KINDS},
    **{
        feature: partial(with_cone, feature.value.removeprefix("contact.cone."))
        for feature in Feature
        if feature.value.startswith("contact.cone.")
    },
    **{feature: partial(ball_with_law, **law) for feature, law in CONTACT_GAPS.items()},
    Feature.HARDNESS_STIFFNESS: partial(lying, **CONTACT_GAPS[Feature.HARDNESS_STIFFNESS]),
    Feature.SHAPE_MARGIN: felt_at_a_distance,
    Feature.SURFACE_VELOCITY: belt,
    Feature.MARGIN_PAIRS: partial(ball_with_law, friction=0.0, margin=0.002),
    Feature.ARMATURE: partial(limits_and_armature, armature=0.1),
    Feature.DRY_FRICTION: partial(limits_and_armature, dry_friction=0.1),
    **dict.fromkeys((Feature.LIMIT_POSITION, Feature.LIMIT_VELOCITY, Feature.LIMIT_EFFORT), limits_and_armature),
    **dict.fromkeys((Feature.DAMPING, Feature.SPRING), damped_springs),
    Feature.DAMPING_IMPLICIT: implicitly_damped,
    Feature.BALL_DAMPING: partial(jointed, "ball", damping=0.1),
    Feature.BALL_ARMATURE: partial(jointed, "ball", armature=0.1),
    Feature.BALL_LIMIT: partial(jointed, "ball", angle_limit=1.0),
    Feature.GRAVITY_SCALE: lifted,
    Feature.FREE_DAMPING: partial(jointed, "free", damping=0.1, angular_damping=0.1),
    Feature.FREE_ARMATURE: partial(jointed, "free", armature=0.1, angular_armature=0.1),
    Feature.FLUID: immersed,
    Feature.BALL_SPRING: partial(jointed, "ball", spring_stiffness=0.1),
    Feature.FRAME: lambda: dataclasses.replace(framed(""), engines=()),
    Feature.SUM: lambda: dataclasses.replace(sums(""), engines=()),
    Feature.SUM_LIMITS: lambda: dataclasses.replace(sum_limits(""), engines=()),
    Feature.SUM_DRY_FRICTION: lambda: dataclasses.replace(sum_friction(""), engines=()),
    Feature.COLLISION_GROUPS: gripper,
    Feature.EXCLUDED_PAIRS: gripper,
    Feature.TOUCHING_PAIRS: touching_link,
    Feature.INERTIA_FULL: every_joint,
    Feature.INERTIA_SINGULAR: point_mass,
    Feature.JOINT_SEVERAL: several_joints,
    Feature.MASSLESS: tool_frame,
    Feature.TREE_SIZE: lambda: world(tree(["fixed"] + ["hinge"] * 130, 1)),
    Feature.TREE_DEPTH: lambda: world(tree(["fixed"] + ["hinge"] * 500, 1)),
}
"""For each feature a world that needs it."""
