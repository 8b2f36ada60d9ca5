"""Rapier's multibodies: flywheels, frames, efforts, limits, dry friction, contact of links, and what the live engine stores."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.capabilities import ServoLaw
from simspec.engines.rapier.engine import Rapier
from simspec.engines.rapier.multibodies import turn_to
from simspec.engines.rapier.units import SCALE
from simspec.errors import EngineError
from simspec.proof.checks import PRECISIONS, inventory_checks
from simspec.testing import worlds
from simspec.testing.bench import Servo, closed_form, servo_world
from simspec.testing.worlds import accepting
from simspec.world import frames
from simspec.world.kinematics import initial_state
from simspec.world.types import Body, Inertial, Joint, Pose
from tests.engines.free_bodies import DT, ball, loader, of, scene
from tests.engines.natively import at_work

pytestmark = pytest.mark.skipif(Rapier.version() is None, reason="rapier3d is not installed")
TENSOR = (0.02, 0.03, 0.025, 0.002, -0.001, 0.003)
SKEW = frames.direction((0.3, 0.5, 0.8))


@pytest.fixture
def load(load_files):
    return loader(Rapier, load_files)


def link(name, parent, kind="hinge", at=(0.0, 0.0, -0.3), mass=1.0, **joint):
    if kind in ("hinge", "slide"):
        joint = {"axis": (0.0, 1.0, 0.0), "position": (0.3,), "velocity": (0.5,), **joint}
    if kind == "ball":
        joint = {"position": (1.0, 0.0, 0.0, 0.0), "velocity": (0.4, -0.3, 0.5), **joint}
    inertial = Inertial(mass, (0.02, -0.03, -0.12) if mass else (0.0, 0.0, 0.0), TENSOR if mass else (0.0,) * 6)
    turn = frames.from_axis_angle(SKEW, 0.4)
    return Body(name, "arm", inertial, Joint(f"{name}_joint", kind, parent, Pose(at, turn), **joint))


def tree(*bodies):
    """A world of these bodies alone, without shapes."""
    return dataclasses.replace(scene(), bodies=bodies)


MIXED = (
    link("upper", None, axis=SKEW, at=(0.1, 0.0, 1.0)),
    link("fore", "upper", "slide", velocity=(0.2,), position=(0.05,)),
    link("carrier", "upper", mass=0.0, at=(0.1, 0.1, -0.1)),
    link("wrist", "carrier", axis=(-0.8, 0.0, 0.6), at=(0.0, 0.0, 0.0), armature=0.01),
    link("hand", "wrist", "ball"),
    link("plate", "hand", "fixed"),
    link("tip", "plate", axis=(-1.0, 0.0, 0.0), mass=0.1),
)
"""Branches, a massless body, an armature, a ball, a body with mass on a fixed joint."""


def flying(*bodies):
    root = ball("base", (0.1, 0.2, 0.3), (0.3, -0.2, 0.5, 1.0, -2.0, 0.5), turn=frames.from_axis_angle(SKEW, 1.0))
    return (dataclasses.replace(root, inertial=Inertial(2.0, (0.05, 0.02, -0.03), TENSOR), shapes=()), *bodies)


@pytest.mark.parametrize("timestep", [1e-3, 4e-3])
@pytest.mark.parametrize(
    "bodies",
    [
        MIXED,
        flying(
            *(
                dataclasses.replace(body, joint=dataclasses.replace(body.joint, parent=body.joint.parent or "base"))
                for body in MIXED
            )
        ),
    ],
    ids=["fixed", "free"],
)
def test_motion_is_semi_implicit_euler_to_the_round_off_of_singles(bodies, timestep, load):
    world = tree(*bodies)
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=timestep))
    engine, oracle = load(world), Oracle(world)
    (q, v), effort = initial_state(world), np.random.default_rng(1).uniform(-0.1, 0.1, oracle.nv)
    engine.step(200, effort)
    (expected, *_), (rate, *_) = (states[-1:] for states in oracle.motion(q, v, effort, 200, 200))
    assert engine.get_state()[0] == pytest.approx(expected, abs=3e-6)
    assert engine.get_state()[1] == pytest.approx(rate, abs=3e-5)


def test_without_its_flywheel_a_multibody_steps_by_another_method(load):
    """With a weak damper the energy of the flywheel falls too little for Rapier to leave its own method."""
    world = tree(
        link("upper", None, axis=SKEW, velocity=(4.0,)), link("fore", "upper", axis=(0.8, 0.0, 0.6), velocity=(5.0,))
    )
    engine, oracle = load(world), Oracle(world)
    (q, v), no_effort = initial_state(world), np.zeros(2)
    expected = oracle.motion(q, v, no_effort, 200, 200)[0][-1]
    sim = engine._simulation
    sim.links.multibodies[0].set_damping([1e-3, 0.0, 0.0])
    engine.step(200)
    assert np.abs(engine.get_state()[0] - expected).max() > 1e-5
    engine.set_state(q, v)
    engine.step(200)
    assert engine.get_state()[0] == pytest.approx(expected, abs=2e-6)


def test_mass_matrix_and_bias_force_are_those_of_the_oracle(load):
    world = tree(
        *flying(
            *(
                dataclasses.replace(body, joint=dataclasses.replace(body.joint, parent=body.joint.parent or "base"))
                for body in MIXED
            )
        )
    )
    engine, oracle = load(world), Oracle(world)
    q, v = initial_state(world)
    mass = oracle.mass_matrix(q)
    root = np.sqrt(np.diag(mass))
    assert np.abs(engine.mass_matrix() - mass).max() < 1e-6 * mass.max()
    assert (np.abs(engine.mass_matrix() - mass) / np.outer(root, root)).max() < 2e-6
    assert engine.bias_force() == pytest.approx(oracle.bias_force(q, v), abs=3e-5)


def test_bodies_on_fixed_joints_have_their_masses(load):
    world = tree(*flying(link("foot", "base", "fixed")))
    engine = load(world)
    back = {body.name: body for body in engine.read_back().bodies}
    assert back["foot"].inertial.mass == pytest.approx(1.0)
    assert back["foot"].joint.kind == "fixed"
    assert back["foot"].inertial.inertia == pytest.approx(TENSOR, rel=3e-7, abs=1e-8)


def test_springs_dampers_and_efforts_act_as_explicit_efforts(load):
    world = tree(
        link("upper", None, damping=0.3, spring_stiffness=5.0, spring_rest=0.1, at=(0.0, 0.0, 1.0)),
        link("hand", "upper", "ball", damping=0.05, spring_stiffness=0.8),
    )
    engine, oracle = load(world), Oracle(world)
    q, v = initial_state(world)
    effort = np.array([0.4, 0.1, -0.2, 0.3])
    engine.step(300, effort)
    assert engine.get_state()[0] == pytest.approx(oracle.motion(q, v, effort, 300, 300)[0][-1], abs=3e-6)
    engine.step(1)
    kinetic, potential = engine.energy()
    assert kinetic > 0.0
    assert math.isfinite(potential)


@pytest.mark.parametrize("timestep", [1e-3, 4e-3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_a_joint_stops_at_its_limit_within_the_step(kind, sign, timestep, load):
    limits = (-0.2, 5.0) if sign < 0.0 else (-5.0, 0.2)
    world = tree(
        link("arm", None, kind, axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(2.0 * sign,), position_limits=limits)
    )
    physics = dataclasses.replace(world.physics, timestep=timestep, gravity=(0.0, 0.0, 0.0))
    engine = load(dataclasses.replace(world, physics=physics))
    most = 0.0
    for _ in range(round(0.2 / timestep)):
        engine.step(1, np.array([0.05 * sign]))
        most = max(most, sign * float(engine.get_state()[0][0]))
    q, v = engine.get_state()
    assert most == pytest.approx(0.2, abs=3e-7)
    assert sign * q[0] == pytest.approx(0.2, abs=3e-7)
    assert v[0] == pytest.approx(0.0, abs=1e-4)
    engine.step(round(0.1 / timestep), np.array([-0.5 * sign]))  # nothing holds it there
    assert sign * engine.get_state()[0][0] < 0.199


def test_dry_friction_stops_what_slides_and_holds_what_rests(load):
    arm = link("arm", None, axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(1.0,), dry_friction=0.1)
    world = tree(arm)
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, gravity=(0.0, 0.0, 0.0)))
    engine, moment = load(world), Oracle(world).mass_matrix(np.zeros(1))[0, 0]
    engine.step(100)
    assert engine.get_state()[1][0] == pytest.approx(1.0 - 0.1 * 100 * DT / moment, rel=1e-5)
    engine.set_state(np.zeros(1), np.zeros(1))
    engine.step(100, np.array([0.099]))
    assert engine.get_state()[1][0] == pytest.approx(0.0, abs=1e-8)
    engine.disable_dry_friction(np.array([0]))
    engine.step(100, np.array([0.099]))
    assert engine.get_state()[1][0] == pytest.approx(0.099 * 100 * DT / moment, rel=1e-5)


def sliding(restitution=0.0, friction=0.5, velocity=(0.0, 0.0, 0.0)):
    """A box with a pendulum inside, which makes it a link of a multibody, over a floor."""
    box = ball("box", (0.0, 0.0, 0.1), (*velocity, 0.0, 0.0, 0.0), "box", (0.2, 0.2, 0.2))
    inner = Body(
        "inner",
        "box",
        Inertial(1e-4, inertia=(1e-6, 1e-6, 1e-6, 0.0, 0.0, 0.0)),
        Joint("inner_joint", "slide", "box", axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,), dry_friction=10.0),
    )
    world = scene(box, law=(friction, restitution))
    return dataclasses.replace(world, bodies=(*world.bodies, inner))


@pytest.mark.parametrize("angle", [0.0, 0.4, math.pi / 4])
def test_links_slide_with_the_friction_of_their_materials(angle, load):
    engine = load(sliding(velocity=(2.0 * math.cos(angle), 2.0 * math.sin(angle), 0.0)))
    assert engine._simulation.built.multibodies.links
    engine.step(100)
    v = engine.get_state()[1]
    assert v[:2] == pytest.approx((2.0 - 0.5 * 9.81 * 0.1) * np.array([math.cos(angle), math.sin(angle)]), abs=2e-4)
    engine.step(500)
    assert np.abs(engine.get_state()[1][:3]).max() < 1e-6
    (contact,) = {tuple(pair) for pair in engine.contacts()["body"].tolist()}
    assert contact == (0, 1)
    assert engine.contacts()["normal_force"].sum() == pytest.approx(2.0001 * 9.81, rel=1e-4)


def test_links_bounce_by_the_law(load):
    world = sliding(restitution=0.6, friction=0.0)
    box = world.bodies[1]
    joint = dataclasses.replace(
        box.joint, position=(0.0, 0.0, 0.1005, *box.joint.position[3:]), velocity=(0, 0, -1.0, 0, 0, 0)
    )
    engine = load(
        dataclasses.replace(world, bodies=(world.bodies[0], dataclasses.replace(box, joint=joint), world.bodies[2]))
    )
    engine.step(3)
    assert engine.get_state()[1][2] == pytest.approx(0.6, abs=0.02)


CHANGES = {
    "damping": lambda sim: sim.links.multibodies[0].set_damping([0.1] * 3),
    "armature": lambda sim: sim.links.multibodies[0].set_armature([0.0, 0.0, 9.0]),
    "self contacts": lambda sim: sim.links.multibodies[0].set_self_contacts_enabled(False),
    "contact of neighbours": lambda sim: setattr(_data(sim), "contacts_enabled", False),
    "a motor": lambda sim: _data(sim).set_motor_velocity(sim.rapier.JointAxis.ANG_X, 1.0, 1.0),
    "softness": lambda sim: setattr(_data(sim), "softness", sim.rapier.SpringCoefficients(10.0, 1.0)),
    "the flywheel's motor": lambda sim: sim.world.multibody_joints[
        sim.built.multibodies.wheels[0]
    ].data.set_motor_velocity(sim.rapier.JointAxis.ANG_X, 0.0, 1e30),
    "the flywheel's mass": lambda sim: setattr(
        sim.world.rigid_bodies[sim.built.multibodies.wheel_bodies[0]], "gravity_scale", 1.0
    ),
}


def _data(sim):
    return sim.world.multibody_joints[sim.built.multibodies.joints[0]].data


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_any_change_of_a_multibody_is_found(change, load):
    world = tree(link("upper", None, position_limits=(-1.0, 1.0)), link("fore", "upper"))
    engine = load(world)
    before = engine.read_back()
    (check,) = inventory_checks(
        Rapier.expected_inventory(world, before.neutral), before.inventory, PRECISIONS["single"]
    )
    assert check.passed, check.detail
    change(engine._simulation)
    back = engine.read_back()
    (check,) = inventory_checks(Rapier.expected_inventory(world, back.neutral), back.inventory, PRECISIONS["single"])
    assert not check.passed or back.bodies != before.bodies


def test_the_inventory_has_every_field_of_joints_and_motors():
    import rapier3d

    def fields(of):
        return {name for name in dir(of) if name[0] != "_" and not callable(getattr(of, name))}

    frames_and_axes = {f"local_{part}{number}" for part in ("frame", "anchor", "axis") for number in (1, 2)}
    known = {
        "contacts_enabled",
        "coupled_axes",
        "enabled",
        "limit_axes",
        "locked_axes",
        "motor_axes",
        "softness",
        "user_data",
    }
    assert fields(rapier3d.GenericJoint()) == known | frames_and_axes
    assert fields(rapier3d.JointMotor()) == {
        "damping",
        "impulse",
        "max_force",
        "model",
        "stiffness",
        "target_pos",
        "target_vel",
    }


def test_limits_that_are_set_for_a_step_are_not_read_back(load):
    world = tree(link("arm", None, position=(0.199,), velocity=(0.1,), position_limits=(-0.2, 0.2)))
    engine = load(world)
    engine.step(3)
    (arm,) = engine.read_back().bodies
    assert arm.joint.position_limits == pytest.approx((-0.2, 0.2))


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), SKEW, frames.direction((-0.6, 0.3, 0.1))])
def test_a_turn_brings_x_to_an_axis(axis):
    assert frames.rotate(turn_to(axis), (1.0, 0.0, 0.0)) == pytest.approx(axis, abs=1e-15)


def test_quaternions_of_the_frames_have_unit_length(load):
    engine = load(tree(*(link(str(row), str(row - 1) if row else None, axis=SKEW) for row in range(6))))
    sim = engine._simulation
    for handle in sim.built.multibodies.joints:
        data = sim.world.multibody_joints[handle].data
        for frame in (data.local_frame1, data.local_frame2):
            assert math.hypot(*frame.rotation.to_tuple()) == pytest.approx(1.0, abs=2e-8)


def test_a_last_body_without_mass_is_refused(load):
    with pytest.raises(EngineError, match="'fore', which moves and has no mass"):
        load(
            tree(link("upper", None), link("fore", "upper")),
            lambda content, sidecar: of("fore")(content).update(mass=0.0, inertia=[0.0] * 6, centre_of_mass=[0.0] * 3),
        )


def test_a_state_of_links_that_is_not_finite_is_an_error(load):
    engine = load(tree(link("upper", None), link("fore", "upper", axis=SKEW)))
    with pytest.raises(EngineError, match="the state of upper, fore is no longer finite"):
        engine.step(5, np.array([1e30, 1e30]))


def test_another_timestep_leaves_the_model_as_it_is(load):
    world = tree(link("upper", None, axis=SKEW), link("fore", "upper", axis=(0.8, 0.0, 0.6)))
    engine, finer = load(world), dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=DT / 4))
    q, v = initial_state(world)
    engine.set_timestep(DT / 4)
    engine.set_state(q, v)
    engine.step(400)
    expected = Oracle(finer).motion(q, v, np.zeros(2), 400, 400)[0][-1]
    assert engine.get_state()[0] == pytest.approx(expected, abs=3e-6)


def test_states_of_turned_balls_and_free_roots_go_in_and_come_out(load):
    world = tree(*flying(link("hand", "base", "ball")))
    engine, generator = load(world), np.random.default_rng(4)
    for _ in range(5):
        q, v = initial_state(world)
        q[3:7], q[7:] = (frames.normalise(tuple(generator.normal(size=4))) for _ in range(2))
        v = generator.normal(size=len(v))
        for put in (engine.set_state, engine.move_to):
            put(q, v)
            actual, rate = engine.get_state()
            assert np.abs(np.abs(actual) - np.abs(q)).max() < 3e-7
            assert rate == pytest.approx(v, abs=1e-6)


def test_the_unit_of_length_changes_no_digit_of_a_slide(load):
    world = tree(link("cart", None, "slide", position=(0.3,), velocity=(0.5,)))
    assert load(world)._simulation.links.positions()[-1] == np.float32(0.3 * SCALE)


def test_the_gripper_of_the_suite_has_slides_in_rapier(load):
    world = accepting(worlds.gripper(), "rapier")
    assert {body.joint.kind for body in load(world).read_back().bodies} >= {"slide"}


def test_a_controller_follows_a_target_to_a_position_limit(load):
    """Rapier clips a target speed to the limits, which simspec moves close to a stop: 1.9e-4 rad, where it had the speed."""
    servo = Servo("wheel", target=0.0, speed=0.5)
    world = servo_world(DT, (servo,))
    (body,) = world.bodies
    joint = dataclasses.replace(body.joint, position_limits=(-1.0, 0.5))
    world = dataclasses.replace(world, bodies=(dataclasses.replace(body, joint=joint),))
    advance, _ = at_work(load(world), world)
    found = [advance(1)[0] for _ in range(1000)]
    np.testing.assert_allclose(found, closed_form(ServoLaw.IMPLICIT_SPRING, servo, 1000, DT)[1:], rtol=0.0, atol=1e-5)
