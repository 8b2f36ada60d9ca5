"""The oracle against closed forms: nothing of any engine or file."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle, random_states
from simspec.dynamics.oracle_tree import OracleTree
from simspec.engines.kit.capabilities import SINGLE
from simspec.proof.checks import PRECISIONS
from simspec.proof.selftest_worlds import constrained, sums
from simspec.testing import worlds as model_worlds
from simspec.world.actions import Fluid, Force, InertiaBox
from simspec.world.kinematics import initial_state, poses
from simspec.world.rotations import logarithm
from simspec.world.types import Body, ConnectConstraint, Inertial, Joint, Physics, Pose
from tests import worlds


def single(kind: str, inertial: Inertial, gravity=(0.0, 0.0, 0.0), timestep=1e-3, **joint):
    sizes = {"hinge": 1, "slide": 1, "ball": 3, "free": 6}
    joint.setdefault("velocity", (0.0,) * sizes[kind])
    joint.setdefault(
        "position", {"hinge": (0.0,), "slide": (0.0,), "ball": (1.0, 0, 0, 0), "free": (0.0, 0, 0, 1, 0, 0, 0)}[kind]
    )
    body = Body("b", "b", inertial, Joint("j", kind, **joint))
    world = worlds.world((body,), physics=Physics(gravity, timestep, 1000))
    return Oracle(world), *initial_state(world)


def test_free_fall_is_that_of_semi_implicit_euler():
    oracle, q, v = single("free", Inertial(2.0, (0.1, 0, 0), (1.0, 1, 1, 0, 0, 0)), (0.0, 0.0, -10.0))
    states, _ = oracle.motion(q, v, None, 100, 100)
    assert states[-1][2] == pytest.approx(-10.0 * 1e-6 * 100 * 101 / 2, abs=1e-13)


def test_a_pendulum_keeps_its_energy_and_its_small_period():
    length, inertia = 0.5, 0.02
    oracle, q, v = single(
        "hinge",
        Inertial(1.0, (0.0, 0.0, -length), (inertia, inertia, inertia, 0, 0, 0)),
        (0.0, 0.0, -9.81),
        1e-4,
        axis=(0.0, 1.0, 0.0),
        position=(0.02,),
    )
    period = 2 * math.pi * math.sqrt((inertia + length**2) / (9.81 * length))
    steps = round(period / 1e-4)
    states, speeds = oracle.motion(q, v, None, steps, steps)
    assert states[-1][0] == pytest.approx(0.02, rel=1e-3)
    start, end = sum(oracle.energy(q, v)), sum(oracle.energy(states[-1], speeds[-1]))
    assert end - start == pytest.approx(0.0, abs=1e-6)


def test_a_spring_and_damper_follow_their_closed_form():
    mass, stiffness, damping, rest, start, time = 2.0, 200.0, 4.0, 0.1, 0.2, 1.0
    oracle, q, v = single(
        "slide",
        Inertial(mass, inertia=(1.0, 1, 1, 0, 0, 0)),
        timestep=1e-5,
        axis=(1.0, 0.0, 0.0),
        damping=damping,
        spring_stiffness=stiffness,
        spring_rest=rest,
        position=(start,),
    )
    omega = math.sqrt(stiffness / mass)
    zeta = damping / (2 * math.sqrt(stiffness * mass))
    fast = omega * math.sqrt(1 - zeta**2)
    expected = rest + (start - rest) * math.exp(-zeta * omega * time) * (
        math.cos(fast * time) + zeta * omega / fast * math.sin(fast * time)
    )
    states, _ = oracle.motion(q, v, None, 100_000, 100_000)
    assert states[-1][0] == pytest.approx(expected, abs=1e-5)


def test_a_symmetric_top_precesses_at_the_rate_of_the_book():
    transverse, axial = 0.02, 0.03
    spin, tilt = 5.0, 0.3
    oracle, q, v = single(
        "free",
        Inertial(1.0, inertia=(transverse, transverse, axial, 0, 0, 0)),
        timestep=1e-5,
        velocity=(0.0, 0, 0, tilt, 0, spin),
    )
    rate = (axial - transverse) / transverse * spin  # Landau and Lifshitz, Mechanics, § 36
    _, speeds = oracle.motion(q, v, None, 10_000, 10_000)
    expected = (tilt * math.cos(rate * 0.1), tilt * math.sin(rate * 0.1), spin)
    np.testing.assert_allclose(speeds[-1][3:], expected, atol=1e-5)


def test_a_ball_spring_turns_the_body_back_along_its_rotation_vector():
    turn = (math.cos(0.2), 0.0, math.sin(0.2), 0.0)
    oracle, q, v = single(
        "ball",
        Inertial(1.0, inertia=(0.1, 0.1, 0.1, 0, 0, 0)),
        spring_stiffness=3.0,
        damping=0.5,
        position=turn,
        velocity=(0.0, 0.0, 2.0),
    )
    np.testing.assert_allclose(
        oracle.acceleration(q, v, np.zeros(3)), (0.0, -3.0 * 0.4 / 0.1, -0.5 * 2 / 0.1), atol=1e-12
    )


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.1, math.pi])
def test_rotation_vectors(angle):
    axis = np.array([0.6, 0.0, 0.8])
    quaternion = np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])
    np.testing.assert_allclose(logarithm(quaternion), angle * axis, atol=1e-15)
    np.testing.assert_allclose(logarithm(-quaternion), angle * axis, atol=3e-15)


@pytest.mark.parametrize("build", [worlds.every_joint, worlds.damped_springs, worlds.limits_and_armature])
def test_poses_are_those_of_plain_kinematics(build):
    world = build()
    q, _ = initial_state(world)
    expected = poses(world)
    for body, row in zip(world.bodies, Oracle(world).body_poses(q), strict=True):
        np.testing.assert_allclose(row[:3], expected[body.name].position, atol=1e-14)


def test_kinetic_energy_is_half_v_m_v_and_armature_counts():
    world = worlds.limits_and_armature(armature=0.3)
    oracle = Oracle(world)
    q, v = initial_state(world)
    assert oracle.energy(q, v)[0] == pytest.approx(0.5 * v @ oracle.mass_matrix(q) @ v, rel=1e-12)
    bare = Oracle(worlds.limits_and_armature())
    np.testing.assert_allclose(oracle.mass_matrix(q) - bare.mass_matrix(q), 0.3 * np.eye(3), atol=1e-13)


def test_bias_is_the_effort_that_leaves_no_acceleration():
    world = worlds.every_joint()
    oracle = Oracle(world)
    q, v = initial_state(world)
    np.testing.assert_allclose(oracle.acceleration(q, v, oracle.bias_force(q, v)), 0.0, atol=1e-10)


def test_velocities_are_the_rates_of_poses():
    world = worlds.every_joint()
    oracle = Oracle(world)
    q, v = initial_state(world)
    oracle.timestep = 1e-7
    moved, _ = oracle.step(q, v, oracle.bias_force(q, v))
    rate = (oracle.body_poses(moved)[:, :3] - oracle.body_poses(q)[:, :3]) / 1e-7
    np.testing.assert_allclose(oracle.body_velocities(q, v)[:, :3], rate, atol=1e-5)


def alone(kind: str, **more) -> Oracle:
    """A world of one coordinate: a body on a joint along or about z, its centre of mass 0.5 m along x. Of one coordinate
    Pinocchio gives vectors where it gives matrices of several."""
    inertial = Inertial(2.0, (0.5, 0.0, 0.0), (0.02, 0.02, 0.02, 0, 0, 0))
    joint = Joint("j", kind, axis=(0.0, 0.0, 1.0), position=(0.0,), velocity=(0.0,))
    return Oracle(worlds.world((Body("b", "b", inertial, joint, **more.pop("body", {})),), **more))


def test_a_force_on_a_world_of_a_single_coordinate():
    force = Force("b", (0.0, 3.0, 5.0), (0.0, 0.0, 7.0), (0.2, 0.0, 0.0))
    assert alone("slide").effort_of(np.zeros(1), force) == pytest.approx([5.0], abs=1e-15)
    assert alone("hinge").effort_of(np.zeros(1), force) == pytest.approx([0.2 * 3.0 + 7.0], abs=1e-15)


def test_a_fluid_in_a_world_of_a_single_coordinate():
    edge, density, viscosity, speed = 0.1, 900.0, 0.3, 2.0
    physics = Physics((0.0, 0.0, 0.0), 0.001, 1, Fluid(density, viscosity))
    oracle = alone("slide", body={"box": InertiaBox((edge,) * 3)}, physics=physics)
    expected = -3 * math.pi * edge * viscosity * speed - 0.5 * density * edge**2 * speed**2
    assert oracle.joint_effort(np.zeros(1), np.array([speed])) == pytest.approx([expected], rel=1e-14)
    (tree, *_), *_ = oracle._parts
    assert tree.viscous(np.zeros(1)) == pytest.approx(np.array([[3 * math.pi * edge * viscosity]]), rel=1e-14)


def test_a_loop_in_a_world_of_a_single_coordinate():
    base = alone("hinge").world
    body = Body("still", "still", Inertial(0.0), Joint("s", "fixed"))
    pin = ConnectConstraint("pin", "still", "b", (0.5, 0.0, 0.0), (0.5, 0.0, 0.0))
    oracle = Oracle(dataclasses.replace(base, bodies=(body, *base.bodies), constraints=(pin,)))
    (tree, *_), *_ = oracle._parts
    # the centre moves along y, and the violation is the first point less the second
    assert tree.jacobian(np.zeros(1)) == pytest.approx(np.array([[0.0], [-0.5], [0.0]]), abs=1e-15)
    assert oracle.constrained_velocity(np.zeros(1), np.ones(1)) == pytest.approx([0.0], abs=1e-15)
    q, v = oracle.motion(np.zeros(1), np.zeros(1), np.array([4.0]), 100, 100)
    assert q[-1] == pytest.approx([0.0], abs=1e-12)
    assert v[-1] == pytest.approx([0.0], abs=1e-12)


def test_features_omitted_from_its_motion_are_reported():
    assert Oracle(worlds.limits_and_armature(dry_friction=0.2)).leaves_out == [
        "joint.dry_friction",
        "joint.limits.position",
    ]
    assert Oracle(worlds.every_joint()).leaves_out == []


def test_bodies_listed_breadth_first_keep_their_order():
    """Pinocchio wants joints depth first; the world need not be."""
    bodies = worlds.tree(["free", "hinge", "ball", "slide", "hinge"], 3, [-1, 0, 0, 1, 2])
    world = worlds.world(bodies)
    oracle = Oracle(world)
    q, v = initial_state(world)
    mass = oracle.mass_matrix(q)
    np.testing.assert_allclose(mass, mass.T, atol=0)
    assert 0.5 * v @ mass @ v == pytest.approx(oracle.energy(q, v)[0], rel=1e-12)
    moved = dataclasses.replace(bodies[0], joint=dataclasses.replace(bodies[0].joint, origin=Pose()))
    assert moved == bodies[0]


@pytest.mark.parametrize(
    "world",
    [
        model_worlds.every_joint(),
        model_worlds.damped_springs(),
        model_worlds.limits_and_armature(),
        model_worlds.lifted(),
        model_worlds.immersed(),
        constrained("mujoco"),
        sums("mujoco"),
        dataclasses.replace(sums("mujoco"), sums=(), engines=()),
    ],
    ids=["every joint", "springs", "armature", "lifted", "immersed", "held", "sums", "without sums"],
)
@pytest.mark.parametrize("run", [None, 0], ids=["as they are", "rounded"])
@pytest.mark.filterwarnings("ignore:invalid value")  # closed loops do not tolerate rounding
def test_steps_on_end_are_single_steps_to_the_last_bit(world, run):
    """Between single steps the state goes through the world's own order; steps on end may stay in Pinocchio's."""
    rounded = None if run is None else PRECISIONS[SINGLE].rounding(run, np.random.default_rng(7))
    oracle = Oracle(world)
    q, v = (states[0] for states in random_states(world, 1))
    effort = 0.3 * np.random.default_rng(3).normal(size=oracle.nv)
    all_q, all_v = oracle.motion(q, v, effort, 25, 10, rounded)
    rows = {0: 0, 10: 1, 20: 2, 25: 3}
    assert len(all_q) == len(rows)
    for done in range(26):
        if done in rows:
            assert all_q[rows[done]].tobytes() == q.tobytes(), done
            assert all_v[rows[done]].tobytes() == v.tobytes(), done
        for tree, _, at_q, at_v in oracle._parts:
            if len(at_v):
                q[at_q], v[at_v] = stepped(tree, q[at_q], v[at_v], effort[at_v], rounded)


def stepped(tree, q, v, effort, rounded):
    q, v = tree.step(q, v, effort)
    return (q, v) if rounded is None else (rounded(q), rounded(v))


def test_a_number_is_drawn_for_each_coordinate_in_the_world_s_order():
    world = model_worlds.every_joint()
    tree = OracleTree(world)
    assert (tree.q_index != np.arange(tree.nq)).any()
    q, v = (states[0] for states in random_states(world, 1))
    effort = np.zeros(tree.nv)
    values, other = (PRECISIONS[SINGLE].rounding(1, np.random.default_rng(7)) for _ in range(2))
    at_once = tree.advanced(q, v, effort, 20, values)
    for _ in range(20):
        q, v = stepped(tree, q, v, effort, other)
    assert [state.tobytes() for state in at_once] == [q.tobytes(), v.tobytes()]
