"""PyBullet: its model equals the world, its motion agrees with the oracle, and its defaults are switched off."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.dialects.kit.sidecar import read_sidecar
from simspec.dialects.pybullet.dialect import PybulletDialect
from simspec.dynamics.oracle import Oracle
from simspec.engines.kit.settings import resolve_settings
from simspec.engines.pybullet.engine import PyBullet
from simspec.errors import EngineError, UnsupportedError
from simspec.support.declarations import combine
from simspec.support.features import Feature
from simspec.support.negotiation import negotiate
from simspec.world import frames
from simspec.world.kinematics import initial_state, layout_of
from simspec.world.types import (
    Body,
    Contact,
    FollowConstraint,
    Inertial,
    Joint,
    Material,
    PairContact,
    Physics,
    Pose,
    Shape,
)
from tests import constrained, worlds
from tests.dialects.pybullet.saying import WORLDS, assert_same_bodies, emit
from tests.engines import simulated
from tests.engines.crowds import BOX, crowd_and_contacts
from tests.engines.simulated import SimulatedEngineTests, assert_same_dynamics, random_state, slider

pytestmark = pytest.mark.skipif(PyBullet.version() is None, reason="pybullet is not installed")

STATE = 1e-14
"""A state goes in and out through two products of rotations: some units of the last place of numbers below 10."""
DYNAMICS = 1e-12
"""Relative to the largest entry; measured 4e-15. The proof requires 1e-9."""
MOTION = 1e-11
"""Pose after 2,000 steps, m or quaternion; measured 2e-13. The proof requires 1e-9."""
STEPS = 2000


@pytest.fixture
def load(load_files):
    """A function that emits a world, changes its files, and loads them."""
    return lambda world, change=lambda files: files: load_files(PyBullet, change(emit(world)))


def free_of_limits(world):
    return dataclasses.replace(
        world,
        bodies=tuple(
            dataclasses.replace(body, joint=dataclasses.replace(body.joint, position_limits=None))
            for body in world.bodies
        ),
    )


MOVING = {
    **simulated.MOVING,
    "armature": lambda: free_of_limits(worlds.limits_and_armature(armature=0.1)),
    "damped-armature-spring": lambda: worlds.world(
        worlds.tree(["hinge", "slide", "hinge"], 9, damping=0.2, armature=0.3, spring_stiffness=3.0)
    ),
}


def assert_same_poses(found, wanted, tolerance):
    signs = np.sign(np.sum(found[:, 3:] * wanted[:, 3:], axis=1, keepdims=True))
    np.testing.assert_allclose(found[:, :3], wanted[:, :3], rtol=0, atol=tolerance)
    np.testing.assert_allclose(found[:, 3:] * signs, wanted[:, 3:], rtol=0, atol=tolerance)


def energy(world, oracle, q, v):
    """½ vᵀ M v; gravity's potential of every mass, that of fixed bodies too; ½ k (q − rest)², ½ k |log R|²."""
    potential = 0.0
    gravity = np.array(world.physics.gravity)
    for body, place, pose in zip(world.bodies, layout_of(world).position, oracle.body_poses(q), strict=True):
        centre = pose[:3] + frames.rotate(tuple(pose[3:]), body.inertial.centre_of_mass)
        potential -= body.inertial.mass * float(gravity @ centre)
        joint = body.joint
        if joint.kind == "ball":
            turn = 2.0 * math.atan2(np.linalg.norm(q[place][1:]), abs(q[place][0]))
            potential += 0.5 * joint.spring_stiffness * turn**2
        elif joint.kind in ("hinge", "slide"):
            potential += 0.5 * joint.spring_stiffness * float(q[place][0] - joint.spring_rest) ** 2
    return 0.5 * v @ oracle.mass_matrix(q) @ v, potential


@pytest.mark.parametrize("name", WORLDS)
def test_reads_back_the_world(name, load):
    world = WORLDS[name]()
    found = load(world).read_back()
    assert_same_bodies(world.bodies, found.bodies, 1e-12)
    assert (found.gravity, found.timestep) == (world.physics.gravity, world.physics.timestep)
    for body, again in zip(world.bodies, found.bodies, strict=True):
        for shape, read in zip(body.shapes, again.shapes, strict=True):
            if shape.collision:
                friction = next(m.friction for m in world.contact.materials if m.name == shape.material)
                assert read.surfaces[0].friction ** 2 == pytest.approx(friction, abs=1e-12)


@pytest.mark.parametrize("seen", ["s", "b", "sv", "vs", "bv", "vb", "svs", "bvs", "vbsv"])
def test_equal_shapes_are_distinguished_by_their_order(seen, load):
    """Of one body: ``s`` a solid that is not seen, ``b`` one that is, ``v`` what only is seen, all of one size and place."""
    base = worlds.shapes_world(("capsule",))
    body = next(body for body in base.bodies if body.shapes and body.shapes[0].kind == "capsule")
    material = body.shapes[0].material
    shapes = tuple(
        dataclasses.replace(
            body.shapes[0],
            name=f"shape{index}",
            collision=word != "v",
            visual=word != "s",
            material="" if word == "v" else material,
        )
        for index, word in enumerate(seen)
    )
    bodies = tuple(dataclasses.replace(body, shapes=shapes) if entry is body else entry for entry in base.bodies)
    world = dataclasses.replace(base, bodies=bodies)
    back = load(world).read_back()
    again = next(entry for entry in back.bodies if entry.name == body.name).shapes
    assert [(shape.name, shape.collision, shape.visual) for shape in again] == [
        (shape.name, shape.collision, shape.visual) for shape in shapes
    ]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<mass value="', '<mass value="1'),
        ('ixx="', 'ixx="1'),
        ('damping="0"', 'damping="0.1"'),
        ('friction="0.3"', 'friction="0.4"'),
        ('upper="2"', 'upper="2.1"'),
        ('effort="50"', 'effort="51"'),
        ('velocity="3"', 'velocity="4"'),
        ('axis xyz="', 'axis xyz="-'),
    ],
)
def test_the_read_back_comes_from_the_file(old, new, load):
    world = WORLDS["limits"]()

    def change(files):
        assert old in files["link0.urdf"]
        head, _, tail = files["link0.urdf"].rpartition(old)
        return {**files, "link0.urdf": (head + new + tail).replace("--", "")}

    with pytest.raises(AssertionError):
        assert_same_bodies(world.bodies, load(world, change).read_back().bodies, 1e-6)


def test_a_joint_of_another_kind_than_the_sidecar_says_is_refused(load):
    def change(files):
        return {**files, "link0.urdf": files["link0.urdf"].replace('type="revolute"', 'type="prismatic"')}

    with pytest.raises(EngineError, match=r"holds the joint of .* as slide, the sidecar says hinge"):
        load(WORLDS["limits"](), change)


@pytest.mark.parametrize("name", MOVING)
def test_state_goes_in_and_out(name, load):
    world = MOVING[name]()
    engine, oracle = load(world), Oracle(world)
    start = engine.get_state()
    for found, wanted in zip(start, initial_state(world), strict=True):
        np.testing.assert_allclose(np.abs(found), np.abs(wanted), rtol=0, atol=STATE)
    generator = np.random.default_rng(1)
    for _ in range(3):
        q, v = random_state(world, generator)
        engine.set_state(q, v)
        again_q, again_v = engine.get_state()
        np.testing.assert_allclose(again_q, q, rtol=0, atol=STATE)
        np.testing.assert_allclose(again_v, v, rtol=0, atol=STATE)
        poses, velocities = engine.body_states()
        assert_same_poses(poses, oracle.body_poses(q), STATE)
        np.testing.assert_allclose(velocities, oracle.body_velocities(q, v), rtol=STATE, atol=10 * STATE)
        np.testing.assert_allclose(engine.energy(), energy(world, oracle, q, v), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", MOVING)
def test_mass_matrix_and_bias_force(name, load):
    world = MOVING[name]()
    engine, oracle, generator = load(world), Oracle(world), np.random.default_rng(2)
    for _ in range(2):
        q, v = random_state(world, generator)
        assert_same_dynamics(engine, oracle, q, v, DYNAMICS)
        again_q, again_v = engine.get_state()
        np.testing.assert_allclose(again_q, q, rtol=0, atol=STATE, err_msg="a probe must not move the simulation")
        np.testing.assert_allclose(again_v, v, rtol=0, atol=STATE)


@pytest.mark.parametrize("pushed", [False, True])
@pytest.mark.parametrize("name", MOVING)
def test_contact_free_motion(name, pushed, load):
    world = MOVING[name]()
    engine, oracle = load(world), Oracle(world)
    q, v = initial_state(world)
    effort = np.random.default_rng(3).normal(size=len(v)) * 0.3 if pushed else None
    engine.disable_contact()
    engine.set_state(q, v)
    engine.step(STEPS, effort)
    states, _ = oracle.motion(q, v, effort, STEPS, STEPS)
    assert_same_poses(engine.body_states()[0], oracle.body_poses(states[-1]), MOTION)


def test_dry_friction_stops_and_holds(load):
    engine = load(slider(dry_friction=4.0))
    engine.step(100)
    # v − t f/m, and the discrete path: the sum of the velocities after each step
    assert engine.get_state()[1][0] == pytest.approx(1.0 - 0.1 * 4.0 / 2.0, abs=1e-12)
    assert engine.get_state()[0][0] == pytest.approx(0.1 - 2.0 * 0.001**2 * 100 * 101 / 2, abs=1e-12)
    engine.step(900)
    engine.step(100, np.array([3.9]))
    stopped = engine.get_state()
    assert abs(stopped[1][0]) < 1e-15
    engine.step(100, np.array([3.999999]))
    assert engine.get_state()[0][0] == pytest.approx(stopped[0][0], abs=1e-15)
    engine.step(100, np.array([4.5]))
    assert engine.get_state()[1][0] == pytest.approx(0.1 * 0.5 / 2.0, abs=1e-12)


@pytest.mark.parametrize("limits", [(-0.2, 0.3), (0.0, 0.0), (-0.1, 0.0)])
def test_position_limits_hold_as_declared(limits, load):
    """The overshoot is at most one step's way, as the declaration of joint.limits.position says."""
    engine = load(slider(position_limits=limits))
    seen = []
    for _ in range(1000):
        engine.step(1, np.array([2.0]))
        seen.append(engine.get_state()[0][0])
    assert max(seen) <= limits[1] + 2.0 * 0.001
    # taken back by 1 % in each step, some hundred steps ago
    assert seen[-1] == pytest.approx(limits[1], abs=1e-5)


@pytest.mark.parametrize("erp", [None, 0.2])
def test_a_stop_rebounds_by_joint_erp_as_declared(erp, load):
    world = slider(position=(0.299,), velocity=(2.0,), position_limits=(-1.0, 0.3))
    settings = () if erp is None else (("joint_erp", erp),)
    engine = load(worlds.with_options(world, "pybullet", settings=settings))
    engine.step(1)
    assert engine.get_state()[0][0] == pytest.approx(0.301, abs=1e-12), "the overshoot is the way of one step"
    engine.step(1)
    assert engine.get_state()[1][0] == pytest.approx(-(0.01 if erp is None else erp) * 0.001 / 0.001, rel=1e-9)


def test_velocities_are_not_clamped_and_ratings_do_not_act(load):
    engine = load(slider(velocity=(1500.0,), velocity_limit=3.0, effort_limit=1.0))
    engine.step(10, np.array([2000.0]))
    assert engine.get_state()[1][0] == pytest.approx(1500.0 + 0.01 * 2000.0 / 2.0, rel=1e-14)
    free = dataclasses.replace(
        worlds.tree(["free"], 1)[0],
        inertial=Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)),
    )
    engine = load(worlds.world((free,), physics=Physics((0.0, 0.0, 0.0), 0.001, 10)))
    q, v = engine.get_state()
    v = v * 1000.0
    engine.set_state(q, v)
    engine.step(500)
    np.testing.assert_allclose(np.linalg.norm(engine.get_state()[1][3:]), np.linalg.norm(v[3:]), rtol=1e-12)
    np.testing.assert_allclose(engine.get_state()[1][:3], v[:3], rtol=1e-14)


@pytest.mark.parametrize("parents_touch", [False, True])
def test_only_permitted_pairs_touch(parents_touch, load):
    world, wanted = crowd_and_contacts(parents_touch)
    engine = load(world)
    assert engine.detect_contacts().tolist() == wanted
    q, v = engine.get_state()
    engine.disable_contact()
    assert engine.detect_contacts().tolist() == []
    engine.set_state(q, v)
    engine.step(1)
    assert len(engine.contacts()["distance"]) == 0
    assert engine.detect_contacts().tolist() == []


def scene(shape, at, velocity, friction=0.0, restitution=0.0, cone="elliptic", floor_mass=0.0, gravity=-9.81):
    """One body of 1 kg above a big box, 20 m wide, that cannot move."""
    inertia = (0.004, 0.004, 0.004, 0.0, 0.0, 0.0)
    floor = Body(
        "floor",
        "floor",
        Inertial(floor_mass, inertia=inertia if floor_mass else (0.0,) * 6),
        # a shape apart from its body's frame becomes a compound, which has no speculative contact to be switched off
        Joint("floor_joint", "fixed", None, Pose((0.0, 0.0, -0.1))),
        (Shape("floor_0", "box", (20.0, 20.0, 0.2), Pose(), "default"),),
    )
    joint = Joint("b_joint", "free", position=(*at, 1.0, 0.0, 0.0, 0.0), velocity=(*velocity, 0.0, 0.0, 0.0))
    body = Body("b", "b", Inertial(1.0, inertia=inertia), joint, (Shape("b_0", *shape, Pose(), "default"),))
    contact = Contact(
        cone,
        materials=(Material("default", friction, restitution),),
        pairs=(PairContact("default", "default", friction, restitution),),
    )
    return worlds.world((floor, body), contact=contact, physics=Physics((0.0, 0.0, gravity), 0.001, 1000))


@pytest.mark.parametrize("floor_mass", [0.0, 5.0])
def test_contacts_of_a_sphere_at_rest(floor_mass, load):
    engine = load(scene(("sphere", (0.1,)), (0.3, 0.2, 0.1), (0.0, 0.0, 0.0), floor_mass=floor_mass))
    assert len(engine.contacts()["distance"]) == 0, "no step yet"
    engine.step(500)
    found = engine.contacts()
    # a contact whose gap is +1e-17 by round-off is left out of one step; the overlap of g dt² that follows is taken back
    # by 1 % (contact_erp) in each step and adds as much to the force
    assert found["normal_force"].sum() == pytest.approx(9.81, rel=1e-3)
    assert found["body"].shape == (1, 2)
    # the normal points from the second body to the first: up if the sphere is first
    up = 1.0 if found["body"][0, 0] == 1 else -1.0
    assert sorted(found["body"][0]) == [0, 1]
    np.testing.assert_allclose(found["normal"][0], [0.0, 0.0, up], atol=1e-12)
    np.testing.assert_allclose(found["position"][0], [0.3, 0.2, 0.0], atol=1e-4)
    assert abs(found["distance"][0]) < 1e-4, "at rest to 0.1 mm"


def test_detecting_contacts_neither_moves_nor_remembers(load):
    world = scene(("sphere", (0.1,)), (0.0, 0.0, 0.099), (0.0, 0.0, 0.0))
    engine = load(world)
    q, v = engine.get_state()
    assert engine.detect_contacts().tolist() == [[0, 1]]
    np.testing.assert_array_equal(engine.get_state()[0], q)
    # just out of reach of the cached point: PyBullet itself keeps points up to 20 mm
    q[2] = 0.1005
    engine.set_state(q, v)
    assert engine.detect_contacts().tolist() == []
    assert len(engine.contacts()["distance"]) == 0
    q[2] = 0.0999
    engine.set_state(q, v)
    assert engine.detect_contacts().tolist() == [[0, 1]]
    engine.step(5)
    assert len(engine.contacts()["distance"]) == 1
    engine.set_state(q, v)
    assert len(engine.contacts()["distance"]) == 0, "a new state has no past"


def test_a_point_that_has_slid_off_an_edge_is_no_contact(load):
    """PyBullet keeps a point until it has moved 20 mm: the sphere is 5 mm beyond the edge, on no floor any more."""
    engine = load(scene(("sphere", (0.1,)), (9.991, 0.0, 0.0999), (5.0, 0.0, 0.0), gravity=0.0))
    engine.step(1)
    assert engine.detect_contacts().tolist() == [[0, 1]]
    engine.step(3)
    assert engine.get_state()[0][0] == pytest.approx(10.011, abs=1e-9)
    assert engine.detect_contacts().tolist() == []


def test_a_gap_is_no_contact(load):
    engine = load(scene(("sphere", (0.1,)), (0.0, 0.0, 0.1005), (1.0, 0.0, 0.0), gravity=0.0))
    engine.step(3)
    assert len(engine.contacts()["distance"]) == 0


@pytest.mark.parametrize("height", [0.5971, 0.5977, 0.5999])
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.8, 1.0])
def test_restitution(restitution, height, load):
    """Heights that leave gaps of 0.05 to 3 mm before the impact: speculative contact would take the bounce away."""
    engine = load(scene(("sphere", (0.1,)), (0.0, 0.0, height), (0.0, 0.0, 0.0), 0.3, restitution))
    speeds = []
    for _ in range(500):
        engine.step(1)
        speeds.append(engine.get_state()[1][2])
    down = int(np.argmin(speeds))
    # 0.013 is the declared effect of taking back the overlap
    assert max(speeds[down : down + 5]) / -speeds[down] == pytest.approx(restitution, abs=0.013)


@pytest.mark.parametrize(
    ("cone", "degrees", "factor"),
    [
        ("elliptic", 0, 1.0),
        ("elliptic", 22.5, 1.0),
        ("elliptic", 45, 1.0),
        ("pyramid-circumscribed", 0, 1.0),
        ("pyramid-circumscribed", 45, math.sqrt(2.0)),
    ],
)
def test_friction_has_the_requested_cone(cone, degrees, factor, load):
    turn = math.radians(degrees)
    velocity = (2.0 * math.cos(turn), 2.0 * math.sin(turn), 0.0)
    engine = load(scene(("box", (0.4, 0.4, 0.04)), (0.0, 0.0, 0.02), velocity, 0.5, cone=cone))
    engine.step(1000)
    q, v = engine.get_state()
    # slide distance v²/2μg − v dt/2 of semi-implicit Euler; 1e-3: 0.4 % is known of this contact law at μ g dt
    distance = math.hypot(q[0], q[1])
    assert 4.0 / (2.0 * 9.81 * (distance + 2.0 * 0.001 / 2.0)) == pytest.approx(0.5 * factor, rel=1e-3)
    assert np.abs(v[:2]).max() < 1e-15, "no creep"


def test_loading_again_reads_the_changed_file(load, tmp_path):
    """PyBullet caches files by path, as long as a physics client lives."""
    engine = load(slider())
    folder = tmp_path / "0" / "artifacts"
    text = (folder / "a.urdf").read_text(encoding="utf-8")
    (folder / "a.urdf").write_text(text.replace('<mass value="2"/>', '<mass value="3"/>'), encoding="utf-8")
    engine.load(folder, read_sidecar(folder))
    assert engine.read_back().bodies[0].inertial.mass == 3.0


def test_followers_that_act_on_each_other_are_swept_until_they_hold():
    """Their rows are solved one after the other; one alone needs no more sweeps."""
    follower = constrained.follower()
    joints = [body.joint.name for body in follower.bodies]
    two = dataclasses.replace(
        follower, constraints=(*follower.constraints, FollowConstraint("second", joints[3], joints[1], 0.5, 0.1))
    )
    for world, sweeps in ((follower, 200), (two, 2000), (constrained.closed_loop(), 2000)):
        assert PyBullet.chosen_settings(world, resolve_settings(PyBullet, world))["iterations"] == sweeps
        said = worlds.with_options(world, "pybullet", settings=(("iterations", 77),))
        assert PyBullet.chosen_settings(said, resolve_settings(PyBullet, said))["iterations"] == 77


def test_settings_reach_the_engine(load):
    world = worlds.with_options(slider(), "pybullet", settings=(("iterations", 77),))
    engine = load(world)
    import pybullet

    assert pybullet.getPhysicsEngineParameters(physicsClientId=engine.client)["numSolverIterations"] == 77


@pytest.mark.parametrize("text", ["", "<robot name='a'/>", "<robot name='a'><link name='a'>"])
def test_a_broken_file_is_an_engine_error(text, load):
    with pytest.raises(EngineError, match=r"a\.urdf"):
        load(slider(), lambda files: {**files, "a.urdf": text})


def test_a_missing_or_wrong_file_is_an_engine_error(load):
    with pytest.raises(EngineError, match=r"a\.urdf.*missing"):
        load(slider(), lambda files: {name: text for name, text in files.items() if name != "a.urdf"})
    with pytest.raises(EngineError, match="holds the links"):
        load(
            worlds.gripper(),
            lambda files: {**files, "palm.urdf": files["palm.urdf"].replace('"left"', '"west"')},
        )


def armature_problem(world):
    world = worlds.with_options(world, "pybullet", outside=("joint.armature",), accept=("joint.limits.position",))
    try:
        decisions = negotiate(world, "pybullet", combine(PybulletDialect.SUPPORT, PyBullet.SUPPORT))
    except UnsupportedError as error:
        return str(error)
    assert any(decision.feature is Feature.ARMATURE for decision in decisions)
    return None


def test_armature_is_computed_only_where_that_is_exact():
    assert armature_problem(worlds.limits_and_armature(armature=0.1)) is None
    assert "free or ball joint" in armature_problem(worlds.world(worlds.tree(["free", "hinge"], 1, armature=0.1)))
    assert "dry friction" in armature_problem(worlds.limits_and_armature(armature=0.1, dry_friction=0.2))
    touching = worlds.shapes_world(("sphere",))
    arm = worlds.tree(["hinge", "hinge"], 1, armature=0.1)
    arm = (arm[0], dataclasses.replace(arm[1], shapes=BOX))
    assert "may touch" in armature_problem(dataclasses.replace(touching, bodies=(*touching.bodies, *arm)))


def test_import_noise_stays_out_of_the_output(load, capfd):
    load(worlds.spheres(2))
    assert capfd.readouterr().out == ""


class TestSimulated(SimulatedEngineTests):
    """With the fixture ``load`` of this module."""
