"""What every engine must do, the same for all: one suite, one line for each engine.

Worlds are those of ``tests/worlds.py``. What an engine cannot do is asserted with the error it raises, never skipped.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from simspec.compiler import compile_world
from simspec.contact import rules as contact_rules
from simspec.dialects.kit.contract import dialects
from simspec.dynamics.oracle import Oracle
from simspec.dynamics.states import random_states
from simspec.engines.kit.arrays import CONTACT_FIELDS
from simspec.engines.kit.registry import engines, find_engine
from simspec.engines.kit.settings import check_settings, idle_settings
from simspec.errors import UnsupportedError
from simspec.proof.comparator import compare
from simspec.proof.probes import rotation_error
from simspec.support.declarations import Level, combine
from simspec.support.features import Feature
from simspec.world.kinematics import CollisionFilter, initial_state
from simspec.world.types import Surface, World
from tests import worlds
from tests.engines.conftest import ACCEPTED, EVERY

WORLDS = {
    "every joint": worlds.every_joint,
    "damped springs": worlds.damped_springs,
    "limits": worlds.limits_and_armature,
    "shapes": worlds.shapes_world,
    "spheres": worlds.spheres,
    "gripper": worlds.gripper,
}


@pytest.fixture(params=EVERY)
def name(request) -> str:
    return request.param


def test_every_known_engine_is_in_the_suite():
    assert sorted(EVERY) == sorted(engines())


@pytest.mark.parametrize("key", WORLDS)
def test_the_engine_holds_the_world(name, loaded, key):
    world = WORLDS[key]()
    engine = loaded(world)
    checks = compare(world, engine.read_back(), engine.RULES, engine.LAYERS)
    assert [check for check in checks if not check.passed] == []
    assert {"mass", "joint type", "gravity", "timestep"} <= {check.name for check in checks}


@pytest.mark.parametrize("key", WORLDS)
def test_it_starts_in_the_initial_state(loaded, key):
    world = WORLDS[key]()
    engine = loaded(world)
    q, v = initial_state(world)
    found_q, found_v = engine.get_state()
    assert state_error(world, found_q, q) < 1e-12
    np.testing.assert_allclose(found_v, v, rtol=0, atol=1e-12)


@pytest.mark.parametrize("key", WORLDS)
def test_states_go_in_and_come_out(loaded, key):
    world = WORLDS[key]()
    engine = loaded(world)
    for q, v in zip(*random_states(world, 3), strict=True):
        engine.set_state(q, v)
        found_q, found_v = engine.get_state()
        assert state_error(world, found_q, q) < 1e-12
        np.testing.assert_allclose(found_v, v, rtol=0, atol=1e-12)


def state_error(world: World, found: np.ndarray, expected: np.ndarray) -> float:
    """The largest difference of coordinates; quaternions as rotations."""
    worst, at = 0.0, 0
    for body in world.bodies:
        size = len(body.joint.position)
        one, other = found[at : at + size], expected[at : at + size]
        at += size
        if body.joint.kind in ("ball", "free"):
            worst = max(worst, float(rotation_error(one[-4:], other[-4:])))
            one, other = one[:-4], other[:-4]
        worst = max(worst, float(np.abs(one - other).max(initial=0.0)))
    return worst


@pytest.mark.parametrize("key", WORLDS)
def test_poses_velocities_masses_and_forces_are_the_oracle_s(loaded, key):
    world = WORLDS[key]()
    engine, oracle = loaded(world), Oracle(world)
    for q, v in zip(*random_states(world, 2), strict=True):
        engine.set_state(q, v)
        pose, velocity = engine.body_states()
        expected = oracle.body_poses(q)
        np.testing.assert_allclose(pose[:, :3], expected[:, :3], rtol=0, atol=1e-11)
        assert rotation_error(pose[:, 3:], expected[:, 3:]).max() < 1e-11
        np.testing.assert_allclose(velocity, oracle.body_velocities(q, v), rtol=0, atol=1e-10)
        mass = oracle.mass_matrix(q)
        np.testing.assert_allclose(engine.mass_matrix(), mass, rtol=0, atol=1e-9 * np.abs(mass).max())
        bias = oracle.bias_force(q, v)
        np.testing.assert_allclose(engine.bias_force(), bias, rtol=0, atol=1e-9 * max(1.0, np.abs(bias).max()))


@pytest.mark.parametrize("key", ["every joint", "damped springs", "limits"])
def test_contact_free_motion_is_the_oracle_s(loaded, key):
    world = WORLDS[key]()
    engine, oracle = loaded(world), Oracle(world)
    engine.disable_contact()
    q, v = (state[0] for state in random_states(world, 1, seed=5, speed=0.3))
    for body, at in zip(world.bodies, oracle.layout.position, strict=True):
        if body.joint.position_limits:
            q[at] = sum(body.joint.position_limits) / 2
    effort = 0.2 * np.diag(oracle.mass_matrix(q))
    engine.set_state(q, v)
    for _ in range(3):
        engine.step(100, effort)
    expected_q, expected_v = (states[-1] for states in oracle.motion(q, v, effort, 300, 300))
    found_q, found_v = engine.get_state()
    assert state_error(world, found_q, expected_q) < 1e-10
    np.testing.assert_allclose(found_v, expected_v, rtol=0, atol=1e-9)


@pytest.mark.parametrize("key", ["every joint", "damped springs", "limits"])
def test_energy_is_that_of_the_moving_bodies(loaded, key):
    world = WORLDS[key]()
    engine, oracle = loaded(world), Oracle(world)
    fixed = [body for body in world.bodies if body.joint.kind == "fixed" and body.joint.parent is None]
    assert all(body.inertial.mass > 0 for body in fixed)
    (q, v), (other_q, other_v) = zip(*random_states(world, 2), strict=True)
    found = []
    for state in ((q, v), (other_q, other_v)):
        engine.set_state(*state)
        found.append(engine.energy())
        assert found[-1][0] == pytest.approx(oracle.energy(*state)[0], rel=1e-9)
    # what is fixed to the world has a constant potential, which an engine may or may not count
    assert found[1][1] - found[0][1] == pytest.approx(
        oracle.energy(other_q, other_v)[1] - oracle.energy(q, v)[1], rel=1e-8, abs=1e-9
    )


def test_two_loads_step_alike_to_the_last_bit(loaded):
    world = worlds.spheres()
    seen = []
    for _ in range(2):
        engine = loaded(world)
        engine.step(300)
        seen.append(engine.get_state())
    for one, other in zip(*seen, strict=True):
        assert (one == other).all()


def test_steps_in_one_call_and_in_many_are_the_same(loaded):
    world = worlds.damped_springs()
    engine = loaded(world)
    engine.step(60)
    at_once = engine.get_state()
    engine = loaded(world)
    for _ in range(60):
        engine.step(1)
        engine.body_states()
        engine.energy()
    for one, other in zip(at_once, engine.get_state(), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14)


def test_a_resting_sphere_is_pressed_up_by_its_weight(name, loaded):
    world = worlds.spheres(1)
    engine = loaded(world)
    q, v = initial_state(world)
    q[:3] = (0.3, 0.2, 0.1)
    engine.set_state(q, v)
    engine.step(200)
    contacts = engine.contacts()
    assert {key: value.shape[1:] for key, value in contacts.items()} == dict(CONTACT_FIELDS)
    assert len(contacts["distance"]) == 1
    assert sorted(contacts["body"][0]) == [0, 1]
    up = contacts["normal"][0] * (1.0 if contacts["body"][0][0] == 1 else -1.0)
    np.testing.assert_allclose(up, (0.0, 0.0, 1.0), atol=1e-9)
    np.testing.assert_allclose(contacts["position"][0], (0.3, 0.2, 0.0), atol=2e-3)
    assert -2e-3 < contacts["distance"][0] <= 1e-6
    assert contacts["normal_force"][0] == pytest.approx(98.1, rel=0.02)


def test_bodies_in_the_air_touch_nothing(loaded):
    engine = loaded(worlds.spheres())
    engine.step(5)
    contacts = engine.contacts()
    assert len(contacts["distance"]) == 0
    assert contacts["body"].shape == (0, 2)
    assert engine.detect_contacts().shape == (0, 2)


def test_detection_obeys_the_filters_and_leaves_time_alone(loaded):
    world = worlds.gripper()
    engine = loaded(world)
    names = [body.name for body in world.bodies]
    rule = CollisionFilter(world)
    q, v = initial_state(world)
    # the fingers slide to the middle, where they overlap each other, and the bar with both
    q[1], q[2] = 0.28, -0.28
    q[3:6] = (0.0, 0.03, -0.3)
    engine.set_state(q, v)
    found = {(names[a], names[b]) for a, b in engine.detect_contacts()}
    assert found == {("left", "bar"), ("right", "bar")}
    assert rule.may_touch("left", "bar")
    after, _ = engine.get_state()
    np.testing.assert_allclose(after, q, atol=1e-15)


def test_without_contact_a_sphere_falls_through_the_floor(loaded):
    world = worlds.spheres(1)
    engine = loaded(world)
    engine.disable_contact()
    engine.set_state(*initial_state(world))
    engine.step(1000)
    q, _ = engine.get_state()
    # semi-implicit Euler falls g dt² n (n + 1) / 2
    assert q[2] == pytest.approx(0.5 - 9.81 * 1e-6 * 1000 * 1001 / 2, abs=1e-9)


def test_armature_is_in_the_mass_matrix(name, loaded):
    world = worlds.limits_and_armature(armature=0.05)
    bodies = tuple(
        dataclasses.replace(b, joint=dataclasses.replace(b.joint, position_limits=None)) for b in world.bodies
    )
    world = dataclasses.replace(world, bodies=bodies)
    engine, oracle = loaded(world, outside=("joint.armature",)), Oracle(world)
    q, _ = initial_state(world)
    np.testing.assert_allclose(engine.mass_matrix(), oracle.mass_matrix(q), rtol=0, atol=1e-9)


@pytest.mark.parametrize("feature", list(Feature), ids=str)
def test_a_gap_raises_the_error_it_declares(name, feature):
    """Every feature that the engine has only approximately, outside or not at all is refused unless named."""
    engine = find_engine(name)
    support = combine(dialects()[engine.DIALECT].SUPPORT, engine.SUPPORT)[feature]
    world = gap_world(feature)
    if world is None or support.level in (Level.EXACT, Level.VIA_API):
        return
    with pytest.raises(UnsupportedError, match=feature.value):
        compile_world(world, [name])


def gap_world(feature: Feature) -> World | None:
    """A world that needs the feature; None where every engine must have it exactly (see the test below)."""
    shapes = {Feature(f"shape.{kind}"): kind for kind in ("ellipsoid", "capsule", "cylinder")}
    if feature in shapes:
        return worlds.shapes_world((shapes[feature],))
    if feature.value.startswith("contact.cone."):
        world = worlds.with_options(worlds.shapes_world(), "pybullet", accept=())
        world = worlds.with_options(world, "dart", accept=(), settings=(("contact_solver", "dantzig"),))
        world = worlds.with_options(world, "drake", accept=(), settings=(("contact_approximation", "sap"),))
        cone = feature.value.removeprefix("contact.cone.")
        return dataclasses.replace(world, contact=dataclasses.replace(world.contact, friction_cone=cone))
    if feature in worlds.CONTACT_GAPS:
        return worlds.one_law(**worlds.CONTACT_GAPS[feature])
    built = {
        Feature.ARMATURE: lambda: worlds.limits_and_armature(armature=0.1),
        Feature.DRY_FRICTION: lambda: worlds.limits_and_armature(dry_friction=0.1),
        Feature.LIMIT_POSITION: lambda: worlds.with_options(
            worlds.limits_and_armature(), "drake", accept=(), settings=(("contact_approximation", "tamsi"),)
        ),
        Feature.TREE_SIZE: lambda: worlds.world(worlds.tree(["fixed"] + ["hinge"] * 130, 1)),
        Feature.TREE_DEPTH: lambda: worlds.world(worlds.tree(["fixed"] + ["hinge"] * 500, 1)),
    }
    return built[feature]() if feature in built else None


MUST_BE_EXACT = [
    *(Feature(f"joint.{kind}") for kind in ("fixed", "hinge", "slide", "ball", "free")),
    Feature.DAMPING,
    Feature.BALL_DAMPING,
    Feature.SPRING,
    Feature.BALL_SPRING,
    Feature.INERTIA,
    Feature.INERTIA_FULL,
    Feature.SHAPE_SPHERE,
    Feature.SHAPE_BOX,
    Feature.FRICTION,
    Feature.COLLISION_GROUPS,
    Feature.EXCLUDED_PAIRS,
    Feature.GRAVITY,
    Feature.TIMESTEP,
]


@pytest.mark.parametrize("feature", MUST_BE_EXACT, ids=str)
def test_the_core_of_the_language_is_exact_everywhere(name, feature):
    engine = find_engine(name)
    support = combine(dialects()[engine.DIALECT].SUPPORT, engine.SUPPORT)[feature]
    assert support.level in (Level.EXACT, Level.VIA_API)


def test_settings_say_what_they_do_and_refuse_what_they_cannot(name):
    engine = find_engine(name)
    assert all(setting.meaning for setting in engine.SETTINGS.values())
    defaults = {key: setting.default for key, setting in engine.SETTINGS.items()}
    idle = idle_settings(engine, defaults)
    assert check_settings(engine, [(key, value) for key, value in defaults.items() if key not in idle]) == []
    (problem,) = check_settings(engine, [("no_such_setting", 1)])
    assert "no_such_setting" in problem.message
    half = Surface(0.5, restitution=0.5)
    assert contact_rules.combine(engine.RULES, half, half)["friction"] > 0


def test_the_same_world_gives_the_same_bytes(name):
    world = worlds.with_options(worlds.shapes_world(), name, accept=ACCEPTED)
    first, second = (compile_world(world, [name])[name] for _ in range(2))
    assert dict(first.files) == dict(second.files)
    assert first.sha256 == second.sha256
    assert all("\r" not in text and text.endswith("\n") for text in first.files.values())
    assert all(not Path(path).is_absolute() and ".." not in Path(path).parts for path in first.files)
