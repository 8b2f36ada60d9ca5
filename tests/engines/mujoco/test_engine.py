"""MuJoCo's module: read-back, dynamics and motion against the oracle, contact against closed forms, and no disturbance."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest

from simspec.compiler import write_folder
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.dialects.mujoco.dialect import MujocoDialect
from simspec.engines.mujoco.engine import MuJoCo
from simspec.engines.mujoco.simulation import NO_EXPLICIT_PAIRS
from simspec.errors import EngineError, UnsupportedError
from simspec.formats.mjcf.format import MODEL
from simspec.proof.comparator import compare
from simspec.support.declarations import Level, combine
from simspec.support.features import Feature
from simspec.support.negotiation import negotiate
from simspec.world import kinematics
from simspec.world.contact_pairs import CollisionFilter
from simspec.world.types import Body, Contact, Inertial, Joint, Material, PairContact, Physics, Pose, Shape, World
from tests import worlds
from tests.dialects.mujoco.saying import ALL_SHAPES, WORLDS, as_stored, box_world, differences, emit, frictional

mujoco = pytest.importorskip("mujoco")


def write(world: World, folder: Path) -> Path:
    write_folder(emit(world), folder / "a")
    return folder / "a"


@pytest.fixture
def load(load_files):
    """A function that emits and loads a world, whatever the engine accepts of it."""
    return lambda world: load_files(MuJoCo, emit(world))


# --- read-back ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", WORLDS)
def test_read_back_is_the_world(name, load):
    world = WORLDS[name]
    found = load(world).read_back()
    assert differences(as_stored(world), found.bodies) == []
    assert found.gravity == world.physics.gravity
    assert found.timestep == world.physics.timestep
    assert found.friction_cone == world.contact.friction_cone


DEFECTS = [
    ("limits", r'range="-2.5 2"', 'range="-2.5 2.1"'),
    ("limits", r'range="-2.5 2"', 'limited="false" range="-2.5 2"'),
    ("limits", r'armature="0.1"', 'armature="0.11"'),
    ("limits", r'frictionloss="0.2"', 'frictionloss="0.3"'),
    ("limits", r'user="3 50"', 'user="3 49"'),
    ("limits", r'user="3 50"', 'user="-1 50"'),
    ("damped springs", r'damping="0.3"', 'damping="0.31"'),
    ("damped springs", r'stiffness="4"', 'stiffness="5"'),
    ("damped springs", r'springref="0.1"', 'springref="0.2"'),
    ("damped springs", r'type="hinge"', 'type="slide"'),
    ("damped springs", r'(axis="\S+ )(\S+)', r"\g<1>0.9"),
    ("damped springs", r'(<body name="link2" pos=")\S+', r"\g<1>0.5"),
    ("every joint", r'(<inertial .*quat="\S+ )(\S+)', r"\g<1>0"),
    ("every joint", r'(<inertial .* mass=")[^"]*', r"\g<1>9"),
    ("every joint", r'(<key .*qpos=")\S+', r"\g<1>9"),
    ("every joint", r'(<key .*qvel=")\S+', r"\g<1>9"),
    ("shapes", r'type="sphere" size="0.05"', 'type="sphere" size="0.051"'),
    ("shapes", r'type="capsule"', 'type="cylinder"'),
    ("shapes", r'(<geom name="box_0".* pos=")\S+', r"\g<1>0.5"),
    ("shapes", r'(<geom name="box_0")', r'\g<1> group="3"'),
    ("shapes", r'(<geom name="box_0")', r'\g<1> contype="0" conaffinity="0"'),
    ("spheres", r'gravity="0 0 -9.81"', 'gravity="0 0.1 -9.81"'),
    ("spheres", r'timestep="0.001"', 'timestep="0.002"'),
    ("spheres", r'cone="elliptic"', 'cone="pyramidal"'),
    ("spheres", r'(class="material/slick">\s*<geom .*)condim="1" friction="0', r'\g<1>condim="3" friction="0.1'),
    ("spheres", r'(class="material/slick">\s*<geom .*)solref="-10000 -1000"', r'\g<1>solref="-10000 -1500"'),
]


@pytest.mark.parametrize(("name", "old", "new"), DEFECTS)
def test_the_read_back_reports_the_state_of_the_engine(name, old, new, tmp_path):
    """Read from the engine, not from the request: a change of the file shows."""
    world = WORLDS[name]
    folder = write(world, tmp_path)
    text = (folder / MODEL).read_text()
    changed = re.sub(old, new, text, count=1)
    assert changed != text
    if 'limited="false" range' in changed:
        changed = changed.replace('limited="true" limited="false"', 'limited="false"')
    (folder / MODEL).write_text(changed)
    engine = MuJoCo()
    engine.load(folder, read_sidecar(folder))
    found = engine.read_back()
    engine.close()
    same = not differences(as_stored(world), found.bodies) and (
        (found.gravity, found.timestep, found.friction_cone)
        == (world.physics.gravity, world.physics.timestep, world.contact.friction_cone)
    )
    assert not same


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"bar"', '"rod"', "no body 'bar'"),
        ('<key name="initial"', '<key name="other"', "no keyframe"),
        ('energy="disable"', 'energy="enable"', "switches on"),
        ("</mujoco>", "", "refuses"),
        ('mass="1" diaginertia="0.01 0.01 0.01"', 'mass="1" diaginertia="0.01 0.01 0.03"', "refuses"),
    ],
)
def test_wrong_files_are_engine_errors(old, new, message, tmp_path):
    folder = write(worlds.gripper(), tmp_path)
    text = (folder / MODEL).read_text()
    assert old in text
    (folder / MODEL).write_text(text.replace(old, new))
    with pytest.raises(EngineError, match=message):
        MuJoCo().load(folder, read_sidecar(folder))


def test_a_shifted_zero_is_an_engine_error(tmp_path):
    folder = write(worlds.damped_springs(), tmp_path)
    text = (folder / MODEL).read_text()
    for old, new in (('ref="0"', 'ref="0.1"'), ('<joint pos="0 0 0"', '<joint pos="0 0.1 0"')):
        (folder / MODEL).write_text(text.replace(old, new, 1))
        engine = MuJoCo()
        engine.load(folder, read_sidecar(folder))
        with pytest.raises(EngineError, match="is not at"):
            engine.read_back()
        engine.close()


@pytest.mark.parametrize("friction", ["0.5 0.5 0 0 0", "0.4 0.5 0 0 0"])
def test_an_explicit_pair_with_another_law_is_found(friction, tmp_path):
    world = worlds.gripper()
    folder = write(world, tmp_path)
    text = (folder / MODEL).read_text()
    (folder / MODEL).write_text(text.replace('friction="0.4 0.4 0 0 0"', f'friction="{friction}"', 1))
    engine = MuJoCo()
    engine.load(folder, read_sidecar(folder))
    if friction == "0.5 0.5 0 0 0":
        checks = compare(world, engine.read_back(), MuJoCo.RULES, MuJoCo.LAYERS)
        assert [check.name for check in checks if not check.passed] == ["friction"]
    else:
        with pytest.raises(EngineError, match="not isotropic"):
            engine.read_back()
    engine.close()


# --- states, dynamics, motion -------------------------------------------------------------------------------------

MOTIONS = {
    "every joint": worlds.every_joint(),
    "every joint, damped": worlds.every_joint(damping=0.2, spring_stiffness=2.0),
    "damped springs": worlds.damped_springs(),
    "arm with armature": worlds.world(worlds.tree(["fixed", *["hinge"] * 6], 5, damping=0.1, armature=0.02)),
    "ball springs": worlds.world(worlds.tree(["ball"] * 3, 9, damping=0.05, spring_stiffness=3.0)),
    "branches": worlds.world(worlds.tree(["free", *["hinge"] * 6], 15, [-1, 0, 1, 0, 3, 1, 5])),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_state_round_trip_is_exact(name, load):
    world = MOTIONS[name]
    engine = load(world)
    q, v = kinematics.initial_state(world)
    for found, want in zip(engine.get_state(), (q, v), strict=True):
        np.testing.assert_allclose(found, want, rtol=0, atol=1e-15)  # MuJoCo normalises quaternions
    other = v + np.linspace(-1, 1, len(v))
    engine.set_state(q, other)
    np.testing.assert_array_equal(engine.get_state()[0], q)
    np.testing.assert_array_equal(engine.get_state()[1], other)


@pytest.mark.parametrize("name", MOTIONS)
def test_poses_velocities_mass_and_bias_are_the_oracles(name, load):
    pytest.importorskip("pinocchio")
    from simspec.dynamics.oracle import Oracle

    world = MOTIONS[name]
    engine, oracle = load(world), Oracle(world)
    for steps in (0, 300):
        engine.step(steps)
        q, v = engine.get_state()
        poses, velocities = engine.body_states()
        np.testing.assert_allclose(poses[:, :3], oracle.body_poses(q)[:, :3], rtol=0, atol=1e-12)
        turns = np.abs(np.sum(poses[:, 3:] * oracle.body_poses(q)[:, 3:], axis=1))
        np.testing.assert_allclose(turns, 1.0, rtol=0, atol=1e-12)
        # round-off of sums over a chain of bodies with values up to 1e2
        np.testing.assert_allclose(velocities, oracle.body_velocities(q, v), rtol=0, atol=1e-12 * np.ptp(velocities))
        mass, bias = oracle.mass_matrix(q), oracle.bias_force(q, v)
        np.testing.assert_allclose(engine.mass_matrix(), mass, rtol=0, atol=1e-12 * np.abs(mass).max())
        np.testing.assert_allclose(engine.bias_force(), bias, rtol=0, atol=1e-12 * np.abs(bias).max())


@pytest.mark.parametrize("name", MOTIONS)
def test_motion_is_the_oracles(name, load):
    """2,000 steps under a constant effort; 1e-10 is 100 times what was measured at worst (8e-13)."""
    pytest.importorskip("pinocchio")
    from simspec.dynamics.oracle import Oracle

    world = MOTIONS[name]
    engine, oracle = load(world), Oracle(world)
    effort = 0.3 * np.cos(np.arange(kinematics.layout_of(world).nv))
    q, v = kinematics.initial_state(world)
    for _ in range(10):
        for _ in range(200):
            q, v = oracle.step(q, v, effort)
        engine.step(200, effort)
        np.testing.assert_allclose(engine.body_states()[0][:, :3], oracle.body_poses(q)[:, :3], rtol=0, atol=1e-10)
        np.testing.assert_allclose(engine.get_state()[1], v, rtol=0, atol=1e-10 * np.abs(v).max())


def test_asking_never_disturbs_the_motion(load):
    """A run that queries all channels at every tenth step equals a bare loop to the last bit; contacts included."""
    world = dataclasses.replace(worlds.shapes_world(ALL_SHAPES), physics=Physics(timestep=0.002, steps=500))
    requested, bare = load(world), load(world)
    for _ in range(50):
        requested.step(10)
        before = requested.contacts()
        requested.detect_contacts()
        for name, values in requested.contacts().items():
            np.testing.assert_array_equal(values, before[name])
        requested.body_states()
        requested.mass_matrix()
        requested.bias_force()
        requested.energy()
        requested.read_back()
    model = bare.model
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert requested.data.ncon > 0
    np.testing.assert_array_equal(requested.data.qpos, data.qpos)
    np.testing.assert_array_equal(requested.data.qvel, data.qvel)


def test_set_state_forgets_everything(load):
    world = worlds.shapes_world()
    engine = load(world)
    q, v = engine.get_state()
    engine.step(300)
    first = engine.get_state()
    engine.step(100, np.ones(len(v)))
    engine.set_state(q, v)
    engine.step(300)
    for entry, other in zip(first, engine.get_state(), strict=True):
        np.testing.assert_array_equal(entry, other)


def test_effort_applies_to_its_call_only(load):
    body = worlds.tree(["slide"], 2)[0]
    body = dataclasses.replace(body, joint=dataclasses.replace(body.joint, velocity=(0.0,)))
    engine = load(worlds.world((body,), physics=Physics((0.0, 0.0, 0.0), 0.001, 1)))
    engine.step(100, np.array([2.0]))
    assert engine.get_state()[1][0] == pytest.approx(0.2 / body.inertial.mass, rel=1e-12)
    engine.step(100)
    assert engine.get_state()[1][0] == pytest.approx(0.2 / body.inertial.mass, rel=1e-12)


def test_energy_is_kept_by_exchange(load):
    """Kinetic, gravity and spring energy of one vertical slide against their formulas; armature counts as inertia."""
    joint = Joint(
        "j",
        "slide",
        None,
        Pose((0.0, 0.0, 0.5)),
        (0.0, 0.0, 1.0),
        armature=0.25,
        spring_stiffness=8.0,
        spring_rest=0.1,
        position=(0.3,),
        velocity=(2.0,),
    )
    body = Body("b", "b", Inertial(2.0, (0.1, 0.0, 0.2), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0)), joint)
    kinetic, potential = load(World("w", (body,))).energy()
    assert kinetic == pytest.approx(0.5 * 2.25 * 4.0, rel=1e-14)
    assert potential == pytest.approx(2.0 * 9.81 * 1.0 + 0.5 * 8.0 * 0.2**2, rel=1e-14)


# --- limits and dry friction, as declared -------------------------------------------------------------------------


def slider(timestep: float, velocity: float, **more: object) -> World:
    joint = Joint("j", "slide", None, Pose(), (1.0, 0.0, 0.0), position=(0.0,), velocity=(velocity,), **more)
    body = Body("b", "b", Inertial(1.0, inertia=(0.1, 0.1, 0.1, 0.0, 0.0, 0.0)), joint)
    return World("slider", (body,), physics=Physics((0.0, 0.0, 0.0), timestep, 1))


@pytest.mark.parametrize("timestep", [0.001, 0.004])
def test_a_limit_stops_within_a_single_step_and_does_not_bounce(timestep, load):
    engine = load(slider(timestep, 2.0, position_limits=(-1.0, 0.1003)))
    deepest = 0.0
    for _ in range(int(0.5 / timestep)):
        engine.step(1)
        deepest = max(deepest, float(engine.get_state()[0][0]))
    assert 0.1003 < deepest < 0.1003 + 2.0 * timestep
    # it comes back with the error reduction's share of the overshoot, 0.01 of at most v dt per step
    assert -0.01 * 2.0 <= engine.get_state()[1][0] < 0.0


def test_dry_friction_holds_and_slides(load):
    engine = load(slider(0.001, 0.0, dry_friction=1.0))
    engine.step(500, np.array([0.9]))
    assert abs(engine.get_state()[1][0]) < 2e-7  # declared: 1e-7 m/s at 1 ms and 1 m/s²
    engine = load(slider(0.001, 0.0, dry_friction=1.0))
    engine.step(500, np.array([1.5]))
    assert engine.get_state()[1][0] == pytest.approx(0.5 * 0.5, rel=1e-9)


# --- contact ------------------------------------------------------------------------------------------------------


def ball_drop(restitution: float, friction: float, speed: float, timestep: float, sideways: float = 0.0) -> World:
    material = Material("m", friction, restitution)
    floor = Body(
        "floor",
        "floor",
        Inertial(0.0),
        Joint("floor_joint", "fixed"),
        (Shape("floor_0", "box", (8.0, 8.0, 0.4), Pose((0.0, 0.0, -0.2)), "m"),),
    )
    start = Joint(
        "ball_joint",
        "free",
        position=(0.0, 0.0, 0.11, 1.0, 0.0, 0.0, 0.0),
        velocity=(sideways, 0.0, -speed, 0.0, 0.0, 0.0),
    )
    tensor = (0.004, 0.004, 0.004, 0.0, 0.0, 0.0)
    ball = Body("ball", "ball", Inertial(1.0, inertia=tensor), start, (Shape("ball_0", "sphere", (0.1,), Pose(), "m"),))
    contact = Contact(materials=(material,), pairs=(PairContact("m", "m", friction, restitution),))
    return World("drop", (floor, ball), contact, Physics((0.0, 0.0, 0.0), timestep, 1))


def bounce(engine: MuJoCo) -> np.ndarray:
    """The ball's velocity after it has left the floor again."""
    touched = False
    for _ in range(4000):
        engine.step(1)
        if engine.data.ncon:
            touched = True
        elif touched:
            break
    return engine.get_state()[1]


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("speed", [1.0, 5.0])
@pytest.mark.parametrize("restitution", [0.1, 0.5, 1.0])
def test_restitution_without_gravity_is_within_a_hundredth(restitution, speed, friction, load):
    """Without gravity what is left is the impedance (0.001) and the error reduction (at most 0.01 of the approach)."""
    v = bounce(load(ball_drop(restitution, friction, speed, 0.001)))
    assert v[2] / speed == pytest.approx(restitution, abs=0.0111)


def test_a_bouncing_ball_does_not_bounce_sideways(load):
    """A ball that sticks in the impact rolls: 5/7 of its sideways speed for I = 2/5 m r², spin the same."""
    v = bounce(load(ball_drop(0.5, 1.0, 3.0, 0.001, sideways=0.1)))
    # friction acts at 0.1 of the slip in the one step of the impact: between nothing and sticking, never beyond it
    assert 0.1 * 5.0 / 7.0 <= v[0] <= 0.1
    assert 0.0 <= 0.1 * v[4] <= v[0]


def block(friction: float, speed: float, timestep: float) -> World:
    world = ball_drop(0.0, friction, 0.0, timestep)
    floor, ball = world.bodies
    floor = dataclasses.replace(floor, shapes=(dataclasses.replace(floor.shapes[0], size=(40.0, 8.0, 0.4)),))
    start = dataclasses.replace(
        ball.joint, position=(0.0, 0.0, 0.05, 1.0, 0.0, 0.0, 0.0), velocity=(speed, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    box = (Shape("ball_0", "box", (0.2, 0.2, 0.1), Pose(), "m"),)
    ball = dataclasses.replace(ball, joint=start, shapes=box)
    return dataclasses.replace(world, bodies=(floor, ball), physics=Physics((0.0, 0.0, -9.81), timestep, 1))


@pytest.mark.parametrize(("friction", "speed"), [(0.3, 1.0), (0.5, 5.0), (1.0, 5.0)])
def test_a_box_slides_as_far_as_coulombs_law_and_stays_down(friction, speed, load):
    engine = load(block(friction, speed, 0.001))
    highest = 0.0
    for _ in range(3000):
        engine.step(1)
        q, v = engine.get_state()
        highest = max(highest, q[2] - 0.05)
        if abs(v[0]) < 1e-3:
            break
    want = speed**2 / (2 * friction * 9.81) - speed * 0.001 / 2
    assert q[0] == pytest.approx(want, rel=0.015)
    # without a cushion and a reference for friction of its own: 319 mm at μ = 1
    assert highest < (5e-3 if speed > 1.0 else 1e-6)


@pytest.mark.parametrize("cone", ["elliptic", "pyramid-inscribed"])
def test_contact_arrays_keep_the_contract(cone, load):
    world = block(0.5, 0.0, 0.001)
    world = dataclasses.replace(world, contact=dataclasses.replace(world.contact, friction_cone=cone))
    engine = load(world)
    assert len(engine.contacts()["distance"]) == 0
    engine.step(500)
    found = engine.contacts()
    assert found["normal_force"].sum() == pytest.approx(9.81, rel=1e-3)  # MuJoCo 3.3.7 leaves 3e-4, 4.0.0 1e-9
    assert len(found["body"]) == 4
    up = np.where(found["body"][:, :1] == 1, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0])
    np.testing.assert_allclose(found["normal"], up, atol=1e-9)
    assert (np.abs(found["distance"]) < (1e-4 if cone == "elliptic" else 1e-6)).all()  # 69 µm: the cushion of friction
    assert (found["distance"] < 0).all()
    np.testing.assert_allclose(found["position"][:, 2], 0.0, atol=1e-4)
    force = np.zeros(6)
    for index in range(engine.data.ncon):
        mujoco.mj_contactForce(engine.model, engine.data, index, force)
        assert found["normal_force"][index] == pytest.approx(force[0], rel=1e-14)


def test_no_contact_when_disabled(load):
    engine = load(block(0.5, 0.0, 0.001))
    engine.disable_contact()
    engine.step(100)
    assert engine.get_state()[1][2] == pytest.approx(-0.981, rel=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize(
    ("groups", "ignored"),
    [
        (["a", "a", "b", "b", "c"], ()),
        (["a", "a", "b", "b", "c"], (("a", "a"), ("a", "b"))),
        ([f"g{i:02}" for i in range(40)], tuple((f"g{i:02}", f"g{i + 1:02}") for i in range(39))),
    ],
)
def test_overlapping_bodies_touch_according_to_the_filter(groups, ignored, friction, load):
    world = box_world(groups, ignored)
    materials, pairs = (Material("slick", friction),), (PairContact("slick", "slick", friction, 0.0),)
    contact = dataclasses.replace(
        world.contact, materials=materials, pairs=pairs, excluded_bodies=(("b1", "b2"), ("b1", "b4"))
    )
    world = dataclasses.replace(world, contact=contact)
    engine = load(world)
    q, v = engine.get_state()
    q.reshape(-1, 7)[:, 0] = 0.001 * np.arange(len(groups))
    engine.set_state(q, v)
    allowed = CollisionFilter(world)
    names = [body.name for body in world.bodies]
    count = len(names)
    want = [(i, j) for i in range(count) for j in range(i + 1, count) if allowed.may_touch(names[i], names[j])]
    assert [tuple(row) for row in engine.detect_contacts()] == want


def test_parent_and_child_touch_unless_the_world_excludes_them(load):
    world = worlds.gripper()  # without friction: explicit pairs would pass by MuJoCo's own parent filter
    slick = {"materials": (Material("default"),), "pairs": (PairContact("default", "default", 0.0, 0.0),)}
    bodies = tuple(
        dataclasses.replace(b, joint=dataclasses.replace(b.joint, origin=Pose()))
        for b in world.bodies
        if b.name != "bar"
    )
    for excluded in ((), (("left", "palm"),)):
        contact = dataclasses.replace(world.contact, excluded_bodies=excluded, **slick)
        found = load(dataclasses.replace(world, bodies=bodies, contact=contact)).detect_contacts()
        assert [tuple(row) for row in found] == ([(0, 2)] if excluded else [(0, 1), (0, 2)])


def test_bodies_joined_rigidly_never_touch(load):
    bodies = worlds.tree(["free", "fixed", "fixed"], 3)
    ball = (Shape("s", "sphere", (0.5,), Pose(), "m"),)
    bodies = tuple(
        dataclasses.replace(b, shapes=tuple(dataclasses.replace(s, name=b.name + "_0") for s in ball)) for b in bodies
    )
    contact = Contact(materials=(Material("m"),), pairs=(PairContact("m", "m", 0.0, 0.0),))
    assert len(load(worlds.world(bodies, contact=contact)).detect_contacts()) == 0


# --- the rest -----------------------------------------------------------------------------------------------------


def test_a_chain_at_the_limit_loads_and_a_deeper_chain_is_rejected(load):
    assert load(worlds.world(worlds.tree(["hinge"] * 400, 5))).model.nv == 400
    with pytest.raises(UnsupportedError, match=r"tree\.depth"):
        negotiate(
            worlds.world(worlds.tree(["hinge"] * 401, 5)), "mujoco", combine(MujocoDialect.SUPPORT, MuJoCo.SUPPORT)
        )


def test_deeper_than_measured_is_an_engine_error(load):
    load(worlds.world(worlds.tree(["hinge"] * 496, 5)))
    with pytest.raises(EngineError, match="nesting"):
        load(worlds.world(worlds.tree(["hinge"] * 497, 5)))


def test_acceptance_names_unlisted_pairs_and_the_alternative():
    support = MuJoCo.SUPPORT[Feature.IMPACT_FRICTION]
    assert support.refine(frictional(0.0, 100)) is None
    beyond = support.refine(frictional(0.0, 3))
    assert (beyond.level, "{friction: coulomb}" in beyond.how) == (Level.APPROXIMATE, True)
    by_coulomb = worlds.with_options(frictional(0.0, 3), "mujoco", settings=(("friction", "coulomb"),))
    assert support.refine(by_coulomb).level is Level.OUTSIDE


def test_the_log_reports_omitted_pairs_and_failures(load):
    assert load(frictional(0.0, 100)).log() == []
    assert load(frictional(0.0, 3)).log() == [NO_EXPLICIT_PAIRS]
    engine = load(slider(0.001, 0.0))
    engine.set_state(np.array([0.0]), np.array([math.inf]))
    engine.step(1)
    assert any("qvel" in line.lower() for line in engine.log())
    assert not np.isfinite(engine.get_state()[1]).all()  # shown, not reset


def test_the_log_starts_empty_for_each_load(tmp_path):
    folder = write(slider(0.001, 0.0), tmp_path)
    engine = MuJoCo()
    engine.load(folder, read_sidecar(folder))
    engine.set_state(np.array([0.0]), np.array([math.nan]))
    engine.step(1)
    assert engine.log()
    engine.load(folder, read_sidecar(folder))
    assert engine.log() == []
    engine.close()
    engine.close()


def test_every_setting_reaches_the_engine(load):
    settings = {
        "solver": "cg",
        "iterations": 7,
        "ls_iterations": 8,
        "tolerance": 1e-5,
        "ls_tolerance": 0.02,
        "ccd_tolerance": 1e-9,
        "impratio": 3.0,
        "high_impratio": 500.0,
        "noslip_iterations": 2,
        "multiccd": False,
        "warmstart": False,
        "sleeping": True,
        "sleep_tolerance": 1e-3,
        "contact_error_reduction": 0.02,
        "contact_impedance": 0.99,
        "friction_rate": 50.0,
        "friction_share": 0.5,
        "friction_cushion": 2e-4,
        "limit_error_reduction": 0.03,
        "limit_impedance": 0.98,
        "dry_friction_impedance": 0.97,
        "explicit_pairs_limit": 4,
        "arena": 33,
    }
    # these exclude some of the others: see test_coulomb.py and test_integrators.py, and below
    assert set(settings) == set(MuJoCo.SETTINGS) - {"friction", "island", "integrator"}
    world = worlds.with_options(block(0.5, 0.0, 0.001), "mujoco", settings=tuple(settings.items()))
    arm = worlds.with_options(
        slider(0.001, 0.0, position_limits=(0.0, 1.0)), "mujoco", settings=tuple(settings.items())
    )
    model, joints = load(world).model, load(arm).model
    option = model.opt
    assert option.solver == mujoco.mjtSolver.mjSOL_CG
    for name in (
        "iterations",
        "ls_iterations",
        "tolerance",
        "ls_tolerance",
        "ccd_tolerance",
        "impratio",
        "noslip_iterations",
        "sleep_tolerance",
    ):
        assert getattr(option, name) == settings[name]
    assert option.enableflags & int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    assert model.narena == 33 * 2**20
    policy = mujoco.mjtSleepPolicy
    assert model.tree_sleep_policy.tolist() == [int(policy.mjSLEEP_AUTO_ALLOWED)]
    assert load(arm).model.tree_sleep_policy.tolist() == [int(policy.mjSLEEP_NEVER)]
    off = mujoco.mjtDisableBit
    for bit, disabled in ((off.mjDSBL_WARMSTART, True), (off.mjDSBL_ISLAND, False), (off.mjDSBL_EULERDAMP, True)):
        assert bool(option.disableflags & int(bit)) is disabled
    np.testing.assert_allclose(model.geom_solref[0], (-20000.0, -1000.0))
    assert model.geom_solimp[0][0] == model.geom_solimp[0][1] == 0.99
    np.testing.assert_allclose(model.pair_solref[0], (-20000.0, -1000.0))
    np.testing.assert_allclose(model.pair_solreffriction[0], (0.0, -50.0))
    np.testing.assert_allclose(joints.jnt_solref[0], (-30000.0, -1000.0))
    assert joints.jnt_solimp[0][0] == 0.98
    assert joints.dof_solimp[0][0] == 0.97
    slow = worlds.with_options(block(0.5, 0.0, 0.001), "mujoco", settings=(("friction_share", 0.02),))
    np.testing.assert_allclose(load(slow).model.pair_solreffriction[0], (0.0, -20.0))
