"""Sleeping, in every engine that has it: off unless asked for; what sleeps stays where it is and wakes when something happens
to it; what is driven does not notice."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.control.law import Control
from simspec.control.reference import reference
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.settings import check_settings, resolve_settings, written_settings
from simspec.world.control import Trajectory
from simspec.world.kinematics import free_rigid
from simspec.world.types import Body, Contact, Inertial, Joint, PairContact, Physics, Pose, Shape, World
from tests import worlds
from tests.control.driving import driven
from tests.engines.conftest import ACCEPTED

ON = (("sleeping", True),)
ACCEPT = (*ACCEPTED, "shape.cylinder", "shape.plane")
RADIUS, LENGTH, MASS = 0.02, 0.1, 0.125
SETTLED = 3000
"""Steps of 1 ms after which every engine has put to sleep what rests: PyBullet takes 2 s."""


def shape(name: str, kind: str, size: tuple[float, ...], pose: Pose | None = None) -> Shape:
    return Shape(name, kind, size, pose or Pose(), worlds.MATERIAL.name)


def cylinder(name: str, x: float, z: float = LENGTH / 2, y: float = 0.0) -> Body:
    across, along = MASS * (3 * RADIUS**2 + LENGTH**2) / 12, MASS * RADIUS**2 / 2
    joint = Joint(f"{name}_joint", "free", None, position=(x, y, z, 1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6)
    inertial = Inertial(MASS, (0.0, 0.0, 0.0), (across, across, along, 0.0, 0.0, 0.0))
    return Body(name, name, inertial, joint, (shape(f"{name}_shape", "cylinder", (RADIUS, LENGTH)),))


def floor() -> Body:
    return Body("floor", "floor", Inertial(0.0), Joint("floor_joint", "fixed"), (shape("floor_0", "plane", ()),))


def scene(*bodies: Body, **more: object) -> World:
    """Bodies on a floor, at 1 ms."""
    law = PairContact(worlds.MATERIAL.name, worlds.MATERIAL.name, worlds.MATERIAL.friction, 0.0)
    contact = Contact(materials=(worlds.MATERIAL,), pairs=(law,), excluded_bodies=worlds.parent_pairs(bodies))
    return worlds.world((floor(), *bodies), contact=contact, **more)


@pytest.fixture
def asleep(name, loaded):
    """Load a world with sleeping on (or off)."""

    def load(world: World, sleeping: bool = True) -> Engine:
        return loaded(worlds.with_options(world, name, settings=ON if sleeping else ()), accept=ACCEPT)

    return load


def places(engine: Engine) -> np.ndarray:
    return engine.body_states()[0][1:, :3]


def hinge(name: str, parent: str | None, origin: Pose, shapes: tuple[Shape, ...] = (), length: float = 0.2) -> Body:
    """A rod along x on a hinge about z, so that gravity asks for no effort."""
    inertial = Inertial(0.5, (length / 2, 0.0, 0.0), (1e-4, 2e-3, 2e-3, 0.0, 0.0, 0.0))
    joint = Joint(f"{name}_joint", "hinge", parent, origin, (0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    return Body(name, "arm", inertial, joint, shapes)


def arm() -> tuple[Body, Body]:
    """Two rods in a plane 5 cm above the floor, with a ball at the end of the second."""
    reach = Pose((0.2, 0.0, 0.0))
    ball = (shape("forearm_0", "sphere", (0.02,), reach),)
    return hinge("upper", None, Pose((0.0, 0.0, 0.05))), hinge("forearm", "upper", reach, ball)


def drifting(speed: float) -> World:
    """A body that nothing touches or pulls, which moves along x."""
    body = cylinder("one", 0.0, 1.0)
    body = dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=(speed, 0.0, 0.0, 0.0, 0.0, 0.0)))
    return scene(body, physics=Physics((0.0, 0.0, 0.0), 0.001, 1))


def sweep() -> World:
    """A driven arm that stands still for 3 s, which is enough to fall asleep, then sweeps slowly into a standing cylinder."""
    world = driven(scene(*arm(), cylinder("target", 0.33, y=0.22), cylinder("other", -0.4)))
    joints = world.controllers[0].joints
    rows = ((0.0, 0.0), (0.0, 0.0), (0.9, 0.0))
    path = Trajectory(joints, (0.0, 3.0, 5.0), rows, interpolation="linear")
    return dataclasses.replace(world, trajectory=path)


# --- off unless asked for -------------------------------------------------------------------------------------------


def test_it_is_off_and_leaves_no_trace_in_files(name):
    world = scene(cylinder("one", 0.0))
    engine = find_engine(name)
    assert resolve_settings(engine, world)["sleeping"] is False
    assert "sleeping" not in written_settings(engine, world)
    plain, off, on = (
        compile_world(worlds.with_options(world, name, settings=given, accept=ACCEPT), [name])[name].files
        for given in ((), (("sleeping", False),), ON)
    )
    assert not any("sleep" in text for text in plain.values())
    told = {path: text for path, text in off.items() if path != "sidecar.json"}
    assert told == {path: text for path, text in plain.items() if path != "sidecar.json"}
    assert '"sleeping": true' in on["sidecar.json"]


def test_a_word_for_it_is_refused(name):
    assert check_settings(find_engine(name), [("sleeping", "yes")])


def test_what_rests_is_simulated_unless_asked_otherwise(asleep):
    """A body slower than any threshold for sleeping goes on."""
    engine = asleep(drifting(1e-5), sleeping=False)
    start = places(engine)[0, 0]
    engine.step(SETTLED)
    assert places(engine)[0, 0] - start == pytest.approx(1e-5 * SETTLED * 1e-3, rel=1e-6)


# --- what sleeps ----------------------------------------------------------------------------------------------------


def test_what_sleeps_stays_to_the_last_bit_where_it_rested(asleep):
    world = scene(cylinder("one", 0.0), cylinder("dropped", 0.3, LENGTH / 2 + 0.002))
    awake = asleep(world, sleeping=False)
    awake.step(SETTLED + 1000)
    wanted = places(awake)
    engine = asleep(world)
    engine.step(SETTLED)
    before = engine.get_state()
    assert not before[1].any()
    engine.step(1000)
    after = engine.get_state()
    assert before[0].tobytes() == after[0].tobytes()
    assert before[1].tobytes() == after[1].tobytes()
    np.testing.assert_allclose(places(engine), wanted, atol=2e-6)


@pytest.mark.parametrize("timestep", [0.0005, 0.004, 0.008])
def test_what_rests_sleeps_at_any_timestep(timestep, asleep):
    world = scene(cylinder("one", 0.0), cylinder("other", 0.3))
    world = dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=timestep))
    engine = asleep(world)
    engine.step(round(1e-3 * SETTLED / timestep))
    assert not engine.get_state()[1].any()


def test_a_stack_stands_as_it_does_awake(asleep):
    world = scene(cylinder("low", 0.0), cylinder("high", 0.0, 1.5 * LENGTH))
    ends = []
    for sleeping in (True, False):
        engine = asleep(world, sleeping)
        engine.step(SETTLED)
        ends.append(places(engine))
    np.testing.assert_allclose(ends[0], ends[1], atol=5e-6)


def test_questions_do_not_see_sleep(asleep):
    """Poses, dynamics, energy and overlaps are those of the state, whoever sleeps."""
    engine = asleep(scene(cylinder("one", 0.0)))
    engine.step(SETTLED)
    q, _ = engine.get_state()
    np.testing.assert_allclose(places(engine)[0], q[:3], atol=1e-12)
    np.testing.assert_allclose(np.diag(engine.mass_matrix())[:3], MASS, rtol=1e-12)
    np.testing.assert_allclose(engine.bias_force()[2], MASS * 9.81, rtol=1e-12)
    assert engine.energy()[1] == pytest.approx(MASS * 9.81 * q[2], rel=1e-9)
    assert engine.detect_contacts().tolist() == [[0, 1]]


def test_what_is_hit_wakes(asleep):
    """A ball that comes late knocks over a cylinder that sleeps as it knocks over one that does not."""
    gravity, late, speed = 0.1, 4.3, 1.0
    start = (-speed * late, 0.0, 0.07 + gravity * late**2 / 2, 1.0, 0.0, 0.0, 0.0)
    thrown = Joint("ball_joint", "free", position=start, velocity=(speed, 0.0, 0.0, 0.0, 0.0, 0.0))
    inertia = 0.4 * MASS * RADIUS**2
    solid = Inertial(MASS, inertia=(inertia, inertia, inertia, 0.0, 0.0, 0.0))
    ball = Body("ball", "ball", solid, thrown, (shape("ball_0", "sphere", (RADIUS,)),))
    world = scene(
        cylinder("target", 0.0), ball, cylinder("far", 0.5, y=0.5), physics=Physics((0.0, 0.0, -gravity), 0.001, 1)
    )
    ends = []
    for sleeping in (True, False):
        engine = asleep(world, sleeping)
        engine.step(4000)
        assert engine.get_state()[1][:6].any() == (not sleeping)
        engine.step(800)
        ends.append(places(engine))
    assert np.linalg.norm(ends[1][0] - (0.0, 0.0, LENGTH / 2)) > 0.05
    np.testing.assert_allclose(ends[0], ends[1], atol=5e-3)  # the edge it hits makes mm of the µm by which rest differs


def test_an_effort_wakes_within_the_step(asleep):
    world = scene(cylinder("one", 0.0))
    ends = []
    for sleeping in (True, False):
        engine = asleep(world, sleeping)
        engine.step(SETTLED)
        engine.step(200, np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]))
        ends.append(places(engine)[0])
        assert ends[-1][2] > LENGTH / 2 + 0.05
    np.testing.assert_allclose(ends[0], ends[1], atol=5e-6)


def test_a_new_state_wakes(asleep):
    """Setting a state leaves no memory of sleep: neither of a place in the air nor of a speed."""
    world = scene(cylinder("one", 0.0))
    ends = []
    for sleep_first in (True, False):
        engine = asleep(world)
        q, v = engine.get_state()
        if sleep_first:
            engine.step(SETTLED)
        q[2] += 1.0
        engine.set_state(q, v)
        engine.step(100)
        ends.append(engine.get_state())
    assert ends[1][0][2] == pytest.approx(1.0 + LENGTH / 2 - 9.81 * 1e-6 * 100 * 101 / 2, rel=1e-9)
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-12)
    np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-12)


# --- what does not ----------------------------------------------------------------------------------------------------


def test_what_is_driven_does_not_notice(asleep):
    """The arm's motion is the same, in which it stands still for long, begins slowly, and pushes what slept."""
    world = sweep()
    ends = []
    for sleeping in (True, False):
        engine = asleep(world, sleeping)
        control = Control(world, reference(world))
        joints = engine.actuate(control.q_places, control.v_places)
        control.advance(joints, 0, 3000)
        free = engine.get_state()[1][2:]
        assert free.any() == (not sleeping)
        control.advance(joints, 3000, 1000)
        moving = engine.get_state()[0][:2]
        control.advance(joints, 4000, 1200)
        ends.append((moving, engine.get_state()[0][:2], places(engine)))
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-9)
    np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-3)
    assert np.linalg.norm(ends[1][2][2, :2] - (0.33, 0.22)) > 0.02
    np.testing.assert_allclose(ends[0][2], ends[1][2], atol=2e-3)


def test_what_has_a_joint_goes_on_however_slowly(asleep):
    wheel = hinge("upper", None, Pose((0.0, 0.0, 0.5)))
    wheel = dataclasses.replace(wheel, joint=dataclasses.replace(wheel.joint, velocity=(1e-7,)))
    engine = asleep(scene(wheel, cylinder("one", 0.5)))
    engine.step(SETTLED)
    q, v = engine.get_state()
    assert q[0] == pytest.approx(1e-7 * SETTLED * 1e-3, rel=1e-6)
    assert not v[1:].any()


def test_free_rigid_bodies_are_told_from_others():
    world = worlds.world(
        worlds.tree(["free", "fixed"], 1, prefix="rigid-")
        + worlds.tree(["free", "hinge"], 2, prefix="jointed-")
        + worlds.tree(["hinge"], 3, prefix="held-")
        + worlds.tree(["fixed"], 4, prefix="base-")
    )
    assert free_rigid(world) == {"rigid-link0"}
