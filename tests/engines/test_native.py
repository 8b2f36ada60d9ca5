"""Law ``native`` in every engine that has it, beyond the shipped suite: the declared law on whole robots, native
controllers together with laws, and refusals."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

import simspec
from simspec.comparison.runs import summary
from simspec.compiler import compile_world
from simspec.control.law import Control, ControlError
from simspec.control.reference import fed_forward, reference
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.capabilities import Capability, NativeLaw, ServoLaw
from simspec.engines.kit.registry import engines
from simspec.errors import UnsupportedError
from simspec.proof.verify import verify
from simspec.runner.execution import run
from simspec.testing.bench import Servo, chain, closed_form, driven, native, wheel, with_targets
from simspec.world.actions import JointController, JointTrajectory
from simspec.world.types import RecordOptions, World
from tests import worlds
from tests.engines.natively import at_work
from tests.installed import having

pytestmark = pytest.mark.usefixtures("warm_engines")

INERTIA, KP, KD = 0.02, 40.0, 3.0
SPECS = Path(__file__).resolve().parents[2] / "specs"


NATIVE = having(lambda engine: Capability.NATIVE_CONTROLLERS not in engine.LACKS)
"""Engines that have controllers of their own."""


def declared(name: str) -> NativeLaw:
    """The law that the engine's own controllers follow."""
    law = engines()[name].NATIVE_LAW
    assert law is not None
    return law


@pytest.fixture(params=NATIVE)
def name(request) -> str:
    return request.param


def test_the_difference_between_engines_is_as_declared(name, loaded):
    """A motor follows with kd/kp as time constant; spring and damper with the joint's inertia besides."""
    world = with_targets(native(wheel(INERTIA, 1e-4)), [0.5])
    advance, _ = at_work(loaded(world), world)
    found = 1.0 - advance(500)[0] / 0.5
    motor = math.exp(-0.05 * KP / KD)
    fast, slow = (np.roots([INERTIA, KD, KP]).real[k] for k in (0, 1))
    spring = (fast * math.exp(slow * 0.05) - slow * math.exp(fast * 0.05)) / (fast - slow)
    assert abs(motor - spring) > 0.02  # the effect of the joint's inertia after 50 ms
    assert found == pytest.approx(spring if declared(name).sags else motor, abs=1e-3)


def test_joint_damping_counts_against_a_motor_at_its_limit(name, loaded):
    """Terminal speed: limit / damping, with the damping that the engine declares."""
    base = wheel(INERTIA)
    body = dataclasses.replace(base.bodies[0], joint=dataclasses.replace(base.bodies[0].joint, damping=0.1))
    world = dataclasses.replace(native(dataclasses.replace(base, bodies=(body,)), limit=0.5), trajectory=None)
    world = with_targets(world, [1000.0])
    engine = loaded(world)
    advance, control = at_work(engine, world)
    advance(4000)
    dt, damping = 0.001, 0.1
    expected = 5.0 * (1.0 + dt * damping / INERTIA if declared(name).implicit_damping else 1.0)
    left_out = declared(name).residual * INERTIA / (dt * damping)
    assert engine.get_state()[1][control.v_places[0]] == pytest.approx(expected, rel=1e-6 + left_out)


@pytest.mark.parametrize("quick", [True, False])
def test_laws_and_native_controllers_work_side_by_side(name, loaded, quick):
    """In two trees: each as if it were alone."""
    both = worlds.world((*chain().bodies, *dataclasses.replace(wheel(INERTIA)).bodies), physics=wheel(INERTIA).physics)
    law = driven(chain()).controllers[0]
    controller = native(wheel(INERTIA)).controllers[0]
    joints = (*law.joints, "wheel_joint")
    q = [body.joint.position[0] for body in chain().bodies]
    trajectory = JointTrajectory(joints, (0.0,), ((*(x + 0.1 for x in q), 0.5),))
    world = dataclasses.replace(
        both, controllers=(law, dataclasses.replace(controller, name="own")), trajectory=trajectory
    )
    advance, control = at_work(loaded(world), world, quick)
    found = dict(zip(control.joints, advance(400), strict=True))
    assert control.joints[-1] == "wheel_joint"
    assert np.isnan(control.applied[-1])
    assert np.isfinite(control.applied[:-1]).all()
    expected = closed_form(declared(name).law, Servo("wheel", INERTIA), 400, 0.001)[-1]
    assert found["wheel_joint"] == pytest.approx(expected, abs=declared(name).accuracy)
    lawful = JointTrajectory(law.joints, (0.0,), (trajectory.positions[0][:-1],))
    alone = dataclasses.replace(world, controllers=(law,), trajectory=lawful)
    engine = loaded(alone)
    control = Control(alone, reference(alone))
    control.advance(engine.actuate(control.q_places, control.v_places), 0, 400)
    for joint, value in zip(control.joints, engine.get_state()[0][control.q_places], strict=True):
        assert found[joint] == pytest.approx(value, abs=1e-12)


def split_chain(law: str = "computed-torque") -> World:
    """One tree, its first two joints under a law and the others under the engine's own controllers."""
    whole = chain()
    joints = [body.joint.name for body in whole.bodies]
    q = [body.joint.position[0] for body in whole.bodies]
    first = driven(whole, law, tuple(joints[:2])).controllers[0]
    controller = JointController(
        "own", tuple(joints[2:]), "native", kp=(200.0,) * 2, kd=(2.0,) * 2, effort_limits=(None,) * 2
    )
    rows = (tuple(q), tuple(x + 0.1 for x in q))
    trajectory = JointTrajectory(tuple(joints), (0.0, 0.4), rows)
    return dataclasses.replace(whole, controllers=(first, controller), trajectory=trajectory)


def test_both_kinds_in_a_single_tree_follow_and_are_recorded(name):
    world = worlds.with_options(dataclasses.replace(split_chain(), record=RecordOptions(50, ())), name)
    found = run(world, name)
    assert found.failed is None
    about = found.provenance["control"]
    assert sorted(about["joints"]) == sorted(body.joint.name for body in world.bodies)
    order = [list(reference(world).joints).index(joint) for joint in about["joints"]]
    (wanted,) = reference(world).position.at(found.time)
    np.testing.assert_allclose(found.arrays["control.target"], wanted[:, order], atol=1e-15)
    native_columns = np.array([joint in world.controllers[1].joints for joint in about["joints"]])
    assert np.isnan(found.arrays["control.effort"][1:, native_columns]).all()
    assert np.isfinite(found.arrays["control.effort"][1:, ~native_columns]).all()
    # springs sag by what the weight is of kp, and pull the others along; motors lag by a fraction of a mm
    assert max(about["error"]) < (0.2 if declared(name).sags else 0.05)
    assert [about["clipped"][k] for k in np.flatnonzero(native_columns)] == [None, None]
    assert [about["clipped"][k] for k in np.flatnonzero(~native_columns)] == [0, 0]
    assert "efforts clipped, most steps of a joint" in summary(found)


def test_the_same_run_twice_gives_the_same_bits(name):
    for base in (split_chain(), split_chain("pd"), with_targets(native(chain(), kp=200.0, kd=2.0), [0.1] * 4)):
        world = worlds.with_options(base, name)
        first, second = (run(world, name) for _ in range(2))
        assert first.failed is None
        assert first.arrays["q"].tobytes() == second.arrays["q"].tobytes()


def robot(dt: float = 0.001) -> World:
    """The arm of the library, moved by 0.3 rad in each joint within 2 s."""
    world = simspec.load(SPECS / "ur10e.yaml").resolve()
    joints = tuple(body.joint.name for body in world.bodies if body.joint.kind == "hinge")
    limits = {body.joint.name: body.joint.effort_limit for body in world.bodies}
    controller = JointController(
        "robot",
        joints,
        "native",
        kp=(20000.0, 20000.0, 10000.0, 500.0, 500.0, 50.0),
        kd=(1000.0, 1000.0, 300.0, 20.0, 20.0, 1.0),
        effort_limits=tuple(limits[name] for name in joints),
    )
    start = [body.joint.position[0] for body in world.bodies if body.joint.kind == "hinge"]
    rows = (tuple(start), tuple(x + 0.3 for x in start))
    return dataclasses.replace(
        world,
        physics=dataclasses.replace(world.physics, timestep=dt, steps=round(2.5 / dt)),
        record=RecordOptions(10, ()),
        expectations=(),
        controllers=(controller,),
        trajectory=JointTrajectory(joints, (0.0, 2.0), rows, interpolation="quintic"),
    )


def declared_lag(name: str, world: World) -> np.ndarray:
    """rad by joint. A motor is behind by dt a (kd + dt kp) / 2 kp, a spring by what its effort must be, |τ| / kp.

    An implicit spring meets the targets of a step's beginning at its end, and is behind by dt (v + a kd / kp) more.
    """
    controller, dt = world.controllers[0], world.physics.timestep
    kp, kd = np.array(controller.kp), np.array(controller.kd)
    times = np.arange(world.physics.steps) * dt
    q, v, a = reference(world).position.at(times, 2)
    if not declared(name).sags:
        return np.abs(a).max(axis=0) * dt * (kd + dt * kp) / (2.0 * kp)
    oracle = Oracle(world)
    rows = range(0, len(times), 10)
    efforts = [oracle.mass_matrix(q[row]) @ a[row] + oracle.bias_force(q[row], v[row]) for row in rows]
    behind = np.abs(np.array(efforts)) / kp
    if declared(name).law is ServoLaw.IMPLICIT_SPRING:
        behind += dt * np.abs(v[::10] + a[::10] * kd / kp)
    return behind.max(axis=0)


def test_the_arm_follows_a_slow_trajectory_within_the_declared_lag(name):
    world = robot()
    found = run(world, name)
    assert found.failed is None
    about = found.provenance["control"]
    lag = dict(zip(reference(world).joints, declared_lag(name, world), strict=True))
    for joint, error in zip(about["joints"], about["error"], strict=True):
        # joints pull each other along, and a spring swings into its sag; DART leaves what is below its solver's tolerance
        assert error < 1.1 * lag[joint] + 1e-6, joint
    q = found.arrays["q"][-1]
    error = np.abs(q - np.array(world.trajectory.positions[-1]))
    if declared(name).sags:
        sag = Oracle(world).bias_force(q, 0.0 * q) / np.array(world.controllers[0].kp)
        np.testing.assert_allclose(np.array(world.trajectory.positions[-1]) - q, sag, atol=1e-5)
    else:
        assert error.max() < 1e-6


LAWS = {law: [name for name in NATIVE if declared(name).law is law] for law in ServoLaw}


@pytest.mark.parametrize("law", [law for law, names in LAWS.items() if len(names) > 1])
def test_engines_of_the_same_law_move_an_arm_alike(law):
    """Drives of a whole arm are solved together, so that one engine that solves them joint by joint would differ."""
    world = robot(0.004)
    names = LAWS[law]
    found = {name: run(worlds.with_options(world, name), name).arrays["q"] for name in names}
    for name, other in itertools.combinations(names, 2):
        near = sum(declared(engine).accuracy for engine in (name, other))
        np.testing.assert_allclose(found[name], found[other], rtol=0.0, atol=near, err_msg=f"{name}, {other}")


def test_the_proof_passes_a_native_world_and_lists_omitted_checks(name):
    world = worlds.with_options(with_targets(native(chain(), kp=200.0, kd=2.0, limit=100.0), [0.1] * 4), name)
    proof = verify(world, [name], levels=["L0", "L1", "L2", "L3", "L6"]).engines[name]
    assert [check for check in proof.checks if not check.passed] == []
    counts = {(check.level, check.name): check.count for check in proof.checks}
    if "control.native" not in engines()[name].UNREADABLE:
        for level in ("L0", "L2"):
            assert counts[level, "controllers"] == 1
            for number in ("kp", "kd", "effort limit"):
                assert counts[level, f"controller's {number}"] == 4
    else:
        assert "control.native" in proof.not_checked
        law = dataclasses.replace(world, controllers=())
        assert "control.native" not in verify(law, [name], levels=["L1"]).engines[name].not_checked


def changed(**fields) -> World:
    base = wheel()
    joint = dataclasses.replace(base.bodies[0].joint, **fields)
    return native(dataclasses.replace(base, bodies=(dataclasses.replace(base.bodies[0], joint=joint),)))


REFUSED = {
    ("mujoco", "stiff"): (
        lambda: native(wheel(), kd=50.0),
        r"diverge at 0.001 s. Lower physics.timestep to 0.00079\d s, the largest stable step",
    ),
    ("mujoco", "no effort"): (lambda: native(wheel(), limit=0.0), "effort limit of zero"),
    ("drake", "no effort"): (lambda: native(wheel(), limit=0.0), "effort limit above zero"),
    ("drake", "dry friction"): (lambda: changed(dry_friction=0.1), "no dry friction in joints"),
    ("pybullet", "dry friction"): (
        lambda: changed(dry_friction=0.1),
        "one motor for each joint, and that of 'wheel' is its dry",
    ),
    ("pybullet", "armature"): (lambda: changed(armature=0.1), "would ignore the armature"),
    ("physx", "dry friction"): (
        lambda: changed(dry_friction=0.1),
        "one motor for each joint, and that of 'wheel' is its dry",
    ),
    ("rapier", "dry friction"): (
        lambda: changed(dry_friction=0.1),
        "one motor for each joint, and that of 'wheel' is its dry",
    ),
    ("dart", "armature"): (lambda: changed(armature=0.1), "would ignore the armature"),
    ("dart", "spring"): (lambda: changed(spring_stiffness=1.0), "'wheel' has a spring"),
}


@pytest.mark.parametrize("key", REFUSED, ids=" ".join)
def test_unsupported_features_of_native_controllers_are_rejected_at_their_location(key):
    build, text = REFUSED[key]
    accept = ("joint.dry_friction",)
    world = worlds.with_options(build(), key[0], accept=accept, outside=("joint.armature",))
    with pytest.raises(UnsupportedError, match=text) as caught:
        compile_world(world, [key[0]])
    assert caught.value.problems[0].path.startswith(("control.all", "bodies.wheel.joint."))
    others = [other for other in NATIVE if other != key[0] and (other, key[1]) not in REFUSED]
    for other in others:
        compile_world(worlds.with_options(world, other, accept=accept, outside=("joint.armature",)), [other])


def test_feed_forward_is_refused_and_not_lost(name):
    world = with_targets(native(wheel()), [0.5])
    fed = dataclasses.replace(world, trajectory=dataclasses.replace(world.trajectory, efforts=((0.1,),)))
    assert list(fed_forward(fed)) == [("all", "wheel_joint")]
    with pytest.raises(UnsupportedError, match="feed-forward") as caught:
        compile_world(fed, [name])
    assert caught.value.problems[0].path == "control.all"
    idle = dataclasses.replace(world, trajectory=dataclasses.replace(world.trajectory, efforts=((0.0,),)))
    compile_world(idle, [name])
    law = dataclasses.replace(fed, controllers=(dataclasses.replace(fed.controllers[0], law="pd"),))
    compile_world(law, [name])


def test_forgotten_controllers_are_an_error(loaded):
    world = with_targets(native(wheel()), [0.5])
    engine = loaded(world)
    control = Control(world, reference(world))
    with pytest.raises(ControlError, match="exactly where joints have the engine's own controllers"):
        control.advance(engine.actuate(control.q_places, control.v_places), 0, 1)
