"""DART: its model equals the world, its motion agrees with the oracle, and its defaults are switched off."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.dialects.kit.sidecar import SIDECAR, read_sidecar
from simspec.dynamics.oracle import Oracle
from simspec.engines.dart.engine import Dart
from simspec.errors import EngineError, UnsupportedError
from simspec.formats.skel.format import WORLD
from simspec.world.kinematics import initial_state, layout_of
from simspec.world.rotations import rotation_error
from simspec.world.types import Body, Inertial, Joint, Physics, Pose, Shape
from tests import worlds
from tests.dialects.dart.saying import WORLDS, failures, small_turns
from tests.engines import simulated
from tests.engines.simulated import SimulatedEngineTests, assert_same_dynamics, random_state, slider

pytestmark = pytest.mark.skipif(Dart.version() is None, reason="dartpy is not installed")

STATE = 1e-14
"""A state goes in and out through a rotation vector: some units of the last place of numbers below 10."""
DYNAMICS = 1e-12
"""Relative to the largest entry; measured 2e-15. The proof requires 1e-9."""
MOTION = 1e-11
"""Pose after 2,000 steps, m or rad; measured 2e-13. The proof requires 1e-9."""
STEPS = 2000


MOVING = {
    **simulated.MOVING,
    "armature": lambda: worlds.world(worlds.tree(["fixed", "hinge", "slide"], 13, armature=0.1)),
    "free-armature-spring": lambda: worlds.world(
        worlds.tree(["free", "hinge", "slide", "ball"], 9, damping=0.2, armature=0.3, spring_stiffness=3.0)
    ),
    "interleaved": WORLDS["interleaved"],
    "small-turns": small_turns,
    # a spring must pull the shorter way round, also where DART holds the rotation the longer way
    "small-turn-spring": lambda: small_turns(damping=0.1, spring_stiffness=5.0),
}


def assert_same_poses(found, wanted, tolerance):
    np.testing.assert_allclose(found[:, :3], wanted[:, :3], rtol=0, atol=tolerance)
    assert rotation_error(found[:, 3:], wanted[:, 3:]).max() <= tolerance


@pytest.mark.parametrize("name", WORLDS)
def test_reads_back_the_world(name, load_dart):
    world = WORLDS[name]()
    back = load_dart(world).read_back()
    assert failures(world, back) == []
    assert set(back.unreadable) <= set(Dart.UNREADABLE)
    for body, again in zip(world.bodies, back.bodies, strict=True):
        seen = {shape.name: shape.colour for shape in again.shapes if shape.visual}
        assert seen == {shape.name: shape.colour for shape in body.shapes if shape.visual}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<mass>", "<mass>1"),
        ("<ixy>", "<ixy>1"),
        ("<offset>", "<offset>1"),
        ("<xyz>", "<xyz>1"),
        ("<upper>2", "<upper>3"),
        ("<friction>0.3", "<friction>0.4"),
        ("<init_pos>", "<init_pos>1"),
        ("<init_vel>", "<init_vel>1"),
        ("-9.81", "-9.8"),
        ("<time_step>0.001", "<time_step>0.002"),
    ],
)
def test_the_read_back_comes_from_the_file(old, new, load_dart):
    def change(files):
        head, found, tail = files[WORLD].rpartition(old)
        assert found
        return {**files, WORLD: (head + new + tail).replace("1-", "-1")}

    world = WORLDS["limits"]()
    assert failures(world, load_dart(world, change).read_back()) != []


def test_a_sidecar_that_contradicts_the_file_is_rejected(load_dart):
    for old, new, said in (
        ('type="revolute"', 'type="prismatic"', "is a slide joint, the sidecar says hinge"),
        ("<collision_detector>dart<", "<collision_detector>ode<", "holds the collision detector ode"),
    ):
        with pytest.raises(EngineError, match=said):
            load_dart(
                WORLDS["limits"](), lambda files, old=old, new=new: {**files, WORLD: files[WORLD].replace(old, new)}
            )


def test_the_read_back_adds_implicit_damping_that_a_file_should_not_have(load_dart):
    world = worlds.damped_springs()
    back = load_dart(
        world, lambda files: {**files, WORLD: files[WORLD].replace("<damping>0<", "<damping>0.1<")}
    ).read_back()
    assert {name for name, _ in failures(world, back)} & {"damping", "armature"}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("damping", [{"body": "link1", "value": 0.1}]),
        ("armature", []),
        ("springs", [{"body": "link2", "stiffness": 1.0, "rest": 0.0}]),
        ("enforce_limits", []),
        ("friction_cone", "pyramid-circumscribed"),
    ],
)
def test_the_read_back_has_the_values_of_the_sidecar(key, value, load_dart):
    world = dataclasses.replace(WORLDS["limits"](), contact=WORLDS["shapes"]().contact)
    shape = Shape("s", "sphere", (0.1,), Pose(), "default")
    world = dataclasses.replace(
        world, bodies=(dataclasses.replace(world.bodies[0], shapes=(shape,)), *world.bodies[1:])
    )

    def change(files):
        return {**files, SIDECAR: json.dumps({**json.loads(files[SIDECAR]), key: value})}

    assert failures(world, load_dart(world).read_back()) == []
    assert failures(world, load_dart(world, change).read_back()) != []


@pytest.mark.parametrize("name", MOVING)
def test_state_goes_in_and_out(name, load_dart):
    world = MOVING[name]()
    engine, oracle = load_dart(world), Oracle(world)
    static = oracle.energy(*engine.get_state())[1] - engine.energy()[1]
    for found, wanted in zip(engine.get_state(), initial_state(world), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=STATE)
    generator = np.random.default_rng(1)
    for _ in range(3):
        q, v = random_state(world, generator)
        engine.set_state(q, v)
        again_q, again_v = engine.get_state()
        np.testing.assert_allclose(again_q, q, rtol=0, atol=STATE)
        np.testing.assert_allclose(again_v, v, rtol=0, atol=STATE)
        found, velocities = engine.body_states()
        assert_same_poses(found, oracle.body_poses(q), STATE)
        np.testing.assert_allclose(velocities, oracle.body_velocities(q, v), rtol=STATE, atol=10 * STATE)
        kinetic, potential = engine.energy()
        # bodies that cannot move have a constant potential, which DART counts
        wanted = oracle.energy(q, v)
        assert (kinetic, potential + static) == pytest.approx(wanted, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("turn", [0.0, 1e-9, 1e-6, 1e-5, 3e-4, 9.99e-4, 1e-3, 1e-2, 3.1, math.pi])
def test_rotations_are_stored_to_the_last_digits(turn, load_dart):
    """DART turns rotation vectors shorter than 1e-3 by a Taylor form, off by up to 1.7e-10."""
    world = worlds.world(worlds.tree(["free", "ball"], 3))
    engine, oracle = load_dart(world), Oracle(world)
    q, v = initial_state(world)
    places = layout_of(world).position
    for place in places:
        q[place.stop - 4 : place.stop] = (math.cos(turn / 2), *(math.sin(turn / 2) * x for x in (0.6, 0.0, 0.8)))
    engine.set_state(q, v)
    assert_same_poses(engine.body_states()[0], oracle.body_poses(q), STATE)
    again, _ = engine.get_state()
    for place in places:
        assert rotation_error(again[place][-4:], q[place][-4:]) <= STATE


@pytest.mark.parametrize("name", MOVING)
def test_mass_matrix_and_bias_force(name, load_dart):
    world = MOVING[name]()
    engine, oracle, generator = load_dart(world), Oracle(world), np.random.default_rng(2)
    for _ in range(2):
        q, v = random_state(world, generator)
        assert_same_dynamics(engine, oracle, q, v, DYNAMICS)


@pytest.mark.parametrize("speed", [1.0, 0.05])
@pytest.mark.parametrize("pushed", [False, True])
@pytest.mark.parametrize("name", MOVING)
def test_contact_free_motion(name, pushed, speed, load_dart):
    """At a twentieth of the speed every step turns by less than 1e-3 rad, where DART's own exponential is inexact."""
    world = MOVING[name]()
    engine, oracle = load_dart(world), Oracle(world)
    q, v = initial_state(world)
    v = speed * v
    effort = np.random.default_rng(3).normal(size=len(v)) * 0.3 if pushed else None
    engine.disable_contact()
    engine.set_state(q, v)
    engine.step(STEPS // 2, effort)
    engine.step(STEPS - STEPS // 2, effort)
    wanted = oracle.body_poses(oracle.motion(q, v, effort, STEPS, STEPS)[0][-1])
    again = oracle.body_poses(oracle.motion(q * (1 + 1e-15), v * (1 + 1e-15), effort, STEPS, STEPS)[0][-1])
    # a pushed chain may amplify the last bit: 1e-10 at a floor of 5e-11 for the ball on the free root, 20 m away
    assert_same_poses(engine.body_states()[0], wanted, max(MOTION, 10.0 * np.abs(wanted - again).max()))


def tumbling(**options):
    """A torque-free body that turns by 1e-4 to 5e-4 rad in a step; with a sphere as a shape if requested."""
    shapes = (Shape("s", "sphere", (0.1,), Pose(), "default"),) if options.pop("solid", False) else ()
    joint = Joint("j", "free", position=(0.0,) * 3 + (1.0,) + (0.0,) * 3, velocity=(0.0,) * 3 + (0.3, 0.4, 0.1))
    body = Body("a", "a", Inertial(1.0, inertia=(0.1, 0.2, 0.25, 0.0, 0.0, 0.0)), joint, shapes)
    contact = worlds.shapes_world().contact
    world = worlds.world((body,), physics=Physics((0.0, 0.0, 0.0), 0.001, STEPS), contact=contact)
    return worlds.with_options(world, "dart", settings=tuple(options.items()))


@pytest.mark.parametrize(
    ("options", "exact"),
    [
        ({}, True),
        ({"exact_rotation": "never"}, False),
        ({"solid": True}, False),
        ({"solid": True, "exact_rotation": "always"}, True),
    ],
)
def test_exact_rotation(options, exact, load_dart):
    """Off by more than 1e-10 without it, so that the case shows what it is for."""
    world = tumbling(**options)
    engine, oracle = load_dart(world), Oracle(world)
    engine.step(STEPS)
    states, _ = oracle.motion(*initial_state(world), None, STEPS, STEPS)
    error = rotation_error(engine.body_states()[0][:, 3:], oracle.body_poses(states[-1])[:, 3:]).max()
    assert error < MOTION if exact else 1e-10 < error < 1e-6


def test_switching_contact_off_switches_exact_rotation_on(load_dart):
    world = tumbling(solid=True)
    engine, oracle = load_dart(world), Oracle(world)
    engine.disable_contact()
    engine.step(STEPS)
    states, _ = oracle.motion(*initial_state(world), None, STEPS, STEPS)
    assert_same_poses(engine.body_states()[0], oracle.body_poses(states[-1]), MOTION)


def test_dry_friction_stops_and_holds(load_dart):
    engine = load_dart(slider(dry_friction=4.0))
    engine.step(100)
    # v − t f/m, and the discrete path: the sum of the velocities after each step
    assert engine.get_state()[1][0] == pytest.approx(1.0 - 0.1 * 4.0 / 2.0, abs=1e-12)
    assert engine.get_state()[0][0] == pytest.approx(0.1 - 2.0 * 0.001**2 * 100 * 101 / 2, abs=1e-12)
    engine.step(900)
    engine.step(100, np.array([3.9]))
    stopped = engine.get_state()
    assert abs(stopped[1][0]) < 1e-11, "measured 2e-12: the residual velocity of the solver"
    engine.step(100, np.array([3.999999]))
    assert engine.get_state()[0][0] == pytest.approx(stopped[0][0], abs=1e-11)
    engine.step(100, np.array([4.5]))
    assert engine.get_state()[1][0] == pytest.approx(0.1 * 0.5 / 2.0, abs=1e-11)


@pytest.mark.parametrize("limits", [(-0.2, 0.3), (0.0, 0.0), (-0.1, 0.0)])
def test_position_limits_stop_dead(limits, load_dart):
    engine = load_dart(slider(position_limits=limits))
    seen = []
    for _ in range(1000):
        engine.step(1, np.array([2.0]))
        seen.append(engine.get_state()[0][0])
    # the way of one step at most, as the limit is met between two steps
    assert max(seen) <= limits[1] + 1e-9
    assert seen[-1] == pytest.approx(limits[1], abs=1e-9)
    assert engine.get_state()[1][0] == pytest.approx(0.0, abs=1e-9)


def test_velocities_are_not_clamped_and_ratings_do_not_act(load_dart):
    engine = load_dart(slider(velocity=(1500.0,), velocity_limit=3.0, effort_limit=1.0, position_limits=(-1e6, 1e6)))
    engine.step(10, np.array([2000.0]))
    assert engine.get_state()[1][0] == pytest.approx(1500.0 + 0.01 * 2000.0 / 2.0, rel=1e-14)


def test_nothing_falls_asleep(load_dart):
    """DART 6.20 removes slow bodies from the simulation by default."""
    engine = load_dart(slider(velocity=(1e-4,)))
    engine.step(5000)
    assert engine.get_state()[0][0] == pytest.approx(5e-4, rel=1e-12)


def test_loading_again_reads_the_changed_file(load_dart, tmp_path):
    engine = load_dart(slider())
    folder = tmp_path / "0" / "artifacts"
    text = (folder / WORLD).read_text(encoding="utf-8")
    (folder / WORLD).write_text(text.replace("<mass>2<", "<mass>3<"), encoding="utf-8")
    engine.load(folder, read_sidecar(folder))
    assert engine.read_back().bodies[0].inertial.mass == 3.0


@pytest.mark.parametrize("folder", ["with space", "a#b", "50%20", "ü"])
def test_any_folder_can_be_loaded_from(folder, load_dart):
    """DART takes a path for a URI, in which some characters mean something else."""
    assert load_dart(slider(), folder=folder).read_back().bodies[0].inertial.mass == 2.0


def test_settings_reach_the_engine(load_dart):
    import dartpy

    settings = (("iterations", 77), ("tolerance", 1e-7), ("collision_detector", "bullet"))
    engine = load_dart(worlds.with_options(worlds.shapes_world(), "dart", settings=settings))
    solver = engine.world.getConstraintSolver()
    options = solver.getBoxedLcpSolver().getOptions()
    assert (options.maxSweeps, options.tolerance) == (77, 1e-7)
    assert isinstance(solver.getCollisionDetector(), dartpy.collision.BulletCollisionDetector)
    assert not engine.world.getDeactivationOptions().mEnabled


@pytest.mark.parametrize("text", ["", "<skel>", "<a/>", "<skel version='1.0'></skel>"])
def test_a_broken_file_is_an_engine_error(text, load_dart):
    with pytest.raises(EngineError, match=r"world\.skel"):
        load_dart(slider(), lambda files: {**files, WORLD: text})


def test_a_missing_or_wrong_file_is_an_engine_error(load_dart):
    with pytest.raises(EngineError, match=r"world\.skel.*missing"):
        load_dart(slider(), lambda files: {SIDECAR: files[SIDECAR]})
    with pytest.raises(EngineError, match="west"):
        load_dart(
            worlds.gripper(),
            lambda files: {
                **files,
                WORLD: files[WORLD].replace('"left"', '"west"').replace(">left<", ">west<"),
            },
        )
    with pytest.raises(EngineError, match="joint"):
        load_dart(
            worlds.damped_springs(),
            lambda files: {**files, WORLD: files[WORLD].replace('type="ball"', 'type="weld"')},
        )


def armature_problem(world):
    world = worlds.with_options(world, "dart", outside=("joint.armature",))
    try:
        compile_world(world, ["dart"])
    except UnsupportedError as error:
        return str(error)
    return None


def test_armature_is_computed_only_where_that_is_exact():
    assert armature_problem(MOVING["free-armature-spring"]()) is None
    assert "position limits" in armature_problem(worlds.limits_and_armature(armature=0.1))
    rough = worlds.world(worlds.tree(["fixed", "hinge"], 1, armature=0.1, dry_friction=0.2))
    assert "dry friction" in armature_problem(rough)
    touching = worlds.shapes_world(("sphere",))
    arm = worlds.tree(["hinge", "hinge"], 1, armature=0.1)
    arm = (arm[0], dataclasses.replace(arm[1], shapes=(Shape("box", "box", (0.1, 0.1, 0.1), Pose(), "default"),)))
    assert "may touch" in armature_problem(dataclasses.replace(touching, bodies=(*touching.bodies, *arm)))


def test_loading_says_nothing_on_the_output(load_dart, capfd):
    load_dart(worlds.spheres(2))
    assert capfd.readouterr() == ("", "")


class TestSimulated(SimulatedEngineTests):
    @pytest.fixture
    def load(self, load_dart):
        return load_dart
