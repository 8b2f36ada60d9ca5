"""The laws, against their own formulas, closed forms, and each other."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.control.law import Control, ControlError
from simspec.control.reference import reference
from simspec.control.request import from_request, to_request
from simspec.dynamics.oracle import Oracle
from simspec.testing.bench import OracleJoints, chain, driven, wheel, with_targets
from simspec.world.actions import JointController, JointTrajectory
from simspec.world.kinematics import initial_state
from tests import worlds

DT = 0.001


class AtRest:
    """Joints that stay where they are, and note what they are given."""

    def __init__(self, q: np.ndarray, v: np.ndarray):
        self._q, self._v, self.given = q, v, []

    def read(self):
        return self._q, self._v

    def give(self, effort: np.ndarray) -> None:
        self.given.append(effort.copy())

    def step(self) -> None:
        """Nothing moves."""


def effort_at(world, q, v, steps: int = 1) -> dict[str, np.ndarray]:
    """The efforts of the first steps at a held state (q, v of the whole world), by joint."""
    control = Control(world, reference(world))
    joints = AtRest(q[control.q_places], v[control.v_places])
    control.advance(joints, 0, steps)
    return {name: np.array(joints.given)[:, k] for k, name in enumerate(control.joints)}


@pytest.fixture
def moving():
    """A chain, a random state of it, and a trajectory with feed-forward."""
    world = chain()
    generator = np.random.default_rng(3)
    oracle = Oracle(world)
    q, v = generator.uniform(-1, 1, oracle.nq), generator.uniform(-1, 1, oracle.nv)
    joints = tuple(body.joint.name for body in world.bodies)
    rows = [tuple(generator.uniform(-1, 1, 4).tolist()) for _ in range(6)]
    trajectory = JointTrajectory(
        joints, (0.0, 0.5, 1.0), tuple(rows[:3]), efforts=tuple(rows[3:]), interpolation="cubic"
    )
    return dataclasses.replace(world, trajectory=trajectory), oracle, q, v


def targets(world, time: float):
    found = reference(world)
    q, v, a = (part[0] for part in found.position.at(np.array([time]), 2))
    return q, v, a, found.effort.at(np.array([time]))[0][0]


def together(found: dict[str, np.ndarray], world) -> np.ndarray:
    return np.array([found[body.joint.name][0] for body in world.bodies])


def test_explicit_computed_torque_is_its_formula(moving):
    world, oracle, q, v = moving
    world = driven(world, damping_ratio=0.7)
    want_q, want_v, want_a, feed = targets(world, 0.0)
    a = want_a + 2 * 0.7 * 20.0 * (want_v - v) + 20.0**2 * (want_q - q)
    expected = oracle.mass_matrix(q) @ a + oracle.bias_force(q, v) + feed
    np.testing.assert_allclose(together(effort_at(world, q, v), world), expected, rtol=1e-12)


def test_implicit_computed_torque_is_the_law_at_the_step_s_end(moving):
    world, oracle, q, v = moving
    world = driven(world, discretisation="implicit", damping_ratio=0.7)
    found = together(effort_at(world, q, v), world)
    want_q, want_v, want_a, feed = targets(world, DT)
    a = np.linalg.solve(oracle.mass_matrix(q), found - feed - oracle.bias_force(q, v))
    v_end = v + DT * a
    q_end = q + DT * v_end
    expected = want_a + 2 * 0.7 * 20.0 * (want_v - v_end) + 20.0**2 * (want_q - q_end)
    np.testing.assert_allclose(a, expected, rtol=1e-9)


@pytest.mark.parametrize("kept", [False, True])
def test_explicit_pd_is_its_formula(moving, kept):
    world, oracle, q, v = moving
    world = driven(world, "pd", gravity_compensation=kept)
    want_q, want_v, _, feed = targets(world, 0.0)
    expected = 40.0 * (want_q - q) + 3.0 * (want_v - v) + feed
    if kept:
        expected += oracle.bias_force(q, np.zeros_like(v))
    np.testing.assert_allclose(together(effort_at(world, q, v), world), expected, rtol=1e-12)


@pytest.mark.parametrize("extra", [{}, {"damping": 0.3, "spring_stiffness": 2.0, "armature": 0.05}])
def test_implicit_pd_is_the_law_at_the_step_s_end(moving, extra):
    world, _, q, v = moving
    bodies = tuple(dataclasses.replace(body, joint=dataclasses.replace(body.joint, **extra)) for body in world.bodies)
    world = driven(dataclasses.replace(world, bodies=bodies), "pd", discretisation="implicit")
    found = together(effort_at(world, q, v), world)
    want_q, want_v, _, feed = targets(world, DT)
    a = Oracle(world).acceleration(q, v, found)
    v_end = v + DT * a
    expected = 40.0 * (want_q - q - DT * v_end) + 3.0 * (want_v - v_end) + feed
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_several_laws_share_a_tree(moving):
    """Each joint gets its own law's effort; joints of other laws, and without one, have no acceleration to computed torque."""
    world, oracle, q, v = moving
    names = world.trajectory.joints
    entry = {"effort_limits": (None,)}
    world = dataclasses.replace(
        world,
        controllers=(
            JointController("a", names[:1], "computed-torque", natural_frequency=10.0, damping_ratio=1.0, **entry),
            JointController("b", names[1:2], "pd", kp=(7.0,), kd=(1.0,), **entry),
            JointController(
                "c", names[2:3], "pd", "implicit", kp=(5.0,), kd=(2.0,), gravity_compensation=True, **entry
            ),
        ),
        trajectory=dataclasses.replace(
            world.trajectory,
            joints=names[:3],
            positions=tuple(row[:3] for row in world.trajectory.positions),
            efforts=(),
        ),
    )
    found = together(effort_at(world, q, v), world)
    now, soon = targets(world, 0.0), targets(world, DT)
    bias = oracle.bias_force(q, v)
    acceleration = np.zeros(4)
    acceleration[0] = now[2][0] + 20.0 * (now[1][0] - v[0]) + 100.0 * (now[0][0] - q[0])
    assert found[0] == pytest.approx((oracle.mass_matrix(q) @ acceleration + bias)[0], rel=1e-12)
    assert found[1] == pytest.approx(7.0 * (now[0][1] - q[1]) + (now[1][1] - v[1]), rel=1e-12)
    a = oracle.acceleration(q, v, found)
    v_end = v[2] + DT * a[2]
    gravity = oracle.bias_force(q, np.zeros(4))[2]
    expected = 5.0 * (soon[0][2] - q[2] - DT * v_end) + 2.0 * (soon[1][2] - v_end) + gravity
    assert found[2] == pytest.approx(expected, rel=1e-9)
    assert found[3] == 0.0


def test_a_single_joint_s_pd_response_is_the_closed_form():
    """A wheel: J ë = −kp e − kd ė, sampled by semi-implicit Euler: the powers of one 2 × 2 matrix."""
    inertia, kp, kd, target = 0.02, 8.0, 0.5, 0.3
    world = with_targets(driven(wheel(inertia), "pd", kp=(kp,), kd=(kd,)), [target])
    control = Control(world, reference(world))
    found = control.follow(OracleJoints(world, control), 1000, 100)[:, 0]
    speed = np.array([-DT * kp / inertia, 1.0 - DT * kd / inertia])
    matrix = np.array([np.array([1.0, 0.0]) + DT * speed, speed])
    share = np.array([np.linalg.matrix_power(matrix, 100 * k)[0, 0] for k in range(11)])
    np.testing.assert_allclose(found, target * (1.0 - share), atol=1e-12)
    # and the continuous one, to the order of the step
    rate, turn = kd / inertia / 2.0, np.sqrt(kp / inertia - (kd / inertia / 2.0) ** 2)
    t = np.arange(11) * 0.1
    exact = target * (1.0 - np.exp(-rate * t) * (np.cos(turn * t) + rate / turn * np.sin(turn * t)))
    np.testing.assert_allclose(found, exact, atol=0.01 * target)


def test_the_implicit_forms_hold_at_a_timestep_where_the_explicit_forms_fail():
    for law in ("pd", "computed-torque"):
        for discretisation, fails in (("explicit", True), ("implicit", False)):
            world = with_targets(driven(chain(timestep=0.1), law, discretisation=discretisation), [0.1] * 4)
            control = Control(world, reference(world))
            with np.errstate(all="ignore"):
                end = control.follow(OracleJoints(world, control), 60, 60)[-1]
            assert (not np.isfinite(end).all() or np.abs(end).max() > 10.0) == fails


def test_computed_torque_follows_a_trajectory():
    world = driven(chain())
    q, _ = initial_state(world)
    names = world.controllers[0].joints
    goal = q + np.array([0.5, 0.1, -0.5, 0.4])
    trajectory = JointTrajectory(names, (0.0, 0.8), (tuple(q.tolist()), tuple(goal.tolist())), interpolation="quintic")
    world = dataclasses.replace(world, trajectory=trajectory)
    control = Control(world, reference(world))
    end = control.follow(OracleJoints(world, control), 1000, 1000)[-1]
    np.testing.assert_allclose(end, goal, atol=1e-4)
    # v* is the trajectory's derivative, not its difference: ζ dt a*/ω of lag, a* ≤ 5.8 × 0.5 / 0.8² rad/s²
    assert control.error.max() < 1.2 * DT * 5.8 * 0.5 / 0.64 / 20.0
    assert not control.clipped.any()


def test_efforts_are_clipped_and_counted():
    world = with_targets(driven(wheel(), "pd", effort_limits=(0.5,)), [1.0])
    found = effort_at(world, np.zeros(1), np.zeros(1), steps=3)["wheel_joint"]
    assert found.tolist() == [0.5] * 3
    control = Control(world, reference(world))
    control.advance(AtRest(np.zeros(1), np.zeros(1)), 0, 3)
    assert control.clipped.tolist() == [3]
    assert control.applied.tolist() == [0.5]
    assert control.error.tolist() == [1.0]


def test_steps_in_a_single_call_and_in_many_are_the_same(moving):
    world = driven(moving[0])
    ends = []
    for counts in ((300,), (1, 7, 92, 200)):
        control = Control(world, reference(world))
        joints, done = OracleJoints(world, control), 0
        for count in counts:
            control.advance(joints, done, count)
            done += count
        ends.append((joints.q.tobytes(), joints.v.tobytes()))
    assert ends[0] == ends[1]


def test_a_law_that_needs_the_mass_matrix_refuses_a_tree_that_flies():
    world = worlds.world(worlds.tree(["free", "hinge"], 3))
    with pytest.raises(ControlError, match=r"control\.all.*free joint.*law: pd"):
        Control(driven(world), reference(driven(world)))
    Control(driven(world, "pd"), reference(driven(world, "pd")))


def test_a_request_carries_all_of_it(moving):
    world, _, q, v = moving
    world = driven(world)
    parameters, arrays = to_request(world)
    again = from_request(parameters, arrays)
    direct = Control(world, reference(world))
    for control in (again, direct):
        joints = AtRest(q[control.q_places], v[control.v_places])
        control.advance(joints, 0, 5)
        control.seen = np.array(joints.given)
    np.testing.assert_array_equal(again.seen, direct.seen)
    assert to_request(moving[0]) == ({}, {})
