"""The probes see what an engine does wrong: the oracle plays the engine, first rightly, then with one thing changed."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle, random_states
from simspec.proof import motion
from simspec.proof.checks import PRECISIONS
from simspec.proof.probes import FRAME_CHECK, _scale, dynamics_checks, dynamics_operation, kinematics_checks
from simspec.world import frames
from simspec.world.rotations import matrices, multiply, rotation_error
from simspec.world.types import Frame, Pose, World
from tests import worlds
from tests.proof.wild import WILD, at_4_ms

MISS = 1e-7
"""Planted errors: a hundred times the tolerance."""


def failed(checks) -> set[str]:
    return {check.name for check in checks if not check.passed}


# --- states -------------------------------------------------------------------------------------------------------


def test_random_states_are_seeded_and_inside_the_limits():
    world = worlds.limits_and_armature()
    q, v = random_states(world, 50)
    assert q.shape == (50, 3)
    assert v.shape == (50, 3)
    assert (q > -2.5).all()
    assert (q < 2.0).all()
    assert np.ptp(q, axis=0) == pytest.approx([4.5, 4.5, 1.0], rel=0.15)  # the slide: within ±0.5 m
    for again, once in zip(random_states(world, 50), (q, v), strict=True):
        np.testing.assert_array_equal(again, once)
    assert (random_states(world, 50, seed=1)[0] != q).all()


def test_random_orientations_are_of_unit_length():
    world = worlds.every_joint()
    q, v = random_states(world, 5)
    oracle = Oracle(world)
    for body, at in zip(world.bodies, oracle.layout.position, strict=True):
        if body.joint.kind in ("ball", "free"):
            np.testing.assert_allclose(np.linalg.norm(q[:, at][:, -4:], axis=1), 1.0, rtol=1e-15)
    assert v.shape == (5, oracle.nv)


def test_a_world_without_coordinates_has_empty_states():
    q, v = random_states(worlds.world(worlds.tree(["fixed"], 1)), 3)
    assert q.shape == v.shape == (3, 0)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-3, 1.0])
def test_rotation_error_is_the_angle(angle):
    turned = np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0])
    for sign in (1.0, -1.0):
        found = rotation_error(np.array([1.0, 0.0, 0.0, 0.0]), sign * turned)
        assert found == pytest.approx(2 * math.sin(angle / 2), rel=1e-12, abs=1e-30)


# --- kinematics and dynamics --------------------------------------------------------------------------------------


@pytest.fixture
def engine():
    """A world, its oracle, states, and what a perfect engine answers."""
    world = worlds.every_joint()
    oracle = Oracle(world)
    q, v = random_states(world, 3)
    kinematics = {
        "pose": np.array([oracle.body_poses(row) for row in q]),
        "velocity": np.array([oracle.body_velocities(*row) for row in zip(q, v, strict=True)]),
        "q": q.copy(),
        "v": v.copy(),
    }
    zeros_like = np.zeros_like(v)
    dynamics = {
        "mass": np.array([np.concatenate([part.ravel() for part in oracle.mass_blocks(row)]) for row in q]),
        "bias_force": np.array([oracle.bias_force(*row) for row in zip(q, v, strict=True)]),
        "gravity_force": np.array([oracle.bias_force(*row) for row in zip(q, zeros_like, strict=True)]),
    }
    return world, oracle, (q, v), kinematics, dynamics


def test_a_perfect_engine_passes(engine):
    world, oracle, states, kinematics, dynamics = engine
    checks = kinematics_checks(world, oracle, *states, kinematics) + dynamics_checks(world, oracle, *states, dynamics)
    assert failed(checks) == set()
    counts = {check.name: (check.level, check.count) for check in checks}
    assert counts["pose, position"] == ("L2", 3)
    assert counts["mass matrix"] == counts["bias force"] == counts["gravity force"] == ("L3", 3)


@pytest.mark.parametrize("body", range(6))
@pytest.mark.parametrize(("column", "name"), [(0, "pose, position"), (2, "pose, position"), (4, "pose, orientation")])
def test_a_wrong_pose_is_found(engine, body, column, name):
    world, oracle, states, kinematics, *_ = engine
    kinematics["pose"][1, body, column] += 10 * MISS
    checks = kinematics_checks(world, oracle, *states, kinematics)
    assert failed(checks) == {name}
    (check,) = (c for c in checks if not c.passed)
    assert check.where == f"bodies.{world.bodies[body].name}, state 1"


def test_the_sign_of_a_quaternion_means_nothing(engine):
    world, oracle, states, kinematics, *_ = engine
    kinematics["pose"][:, :, 3:] *= -1.0
    assert failed(kinematics_checks(world, oracle, *states, kinematics)) == set()


def test_wrong_velocities_and_states_are_found(engine):
    world, oracle, states, kinematics, *_ = engine
    kinematics["velocity"][0, 3, 5] += 100 * MISS
    kinematics["v"][2, 1] += MISS
    assert failed(kinematics_checks(world, oracle, *states, kinematics)) == {"body velocity", "state given back"}


def test_frames_of_an_engine_move_with_their_bodies(engine):
    world, oracle, states, kinematics, *_ = engine
    frame = Frame("tip", world.bodies[2].name, Pose((0.3, -0.2, 0.1), frames.normalise((0.5, 0.1, -0.7, 0.2))))
    world = dataclasses.replace(world, frames=(frame,))
    pose = kinematics["pose"][:, 2]
    at = pose[:, :3] + np.einsum("nij,j->ni", matrices(pose[:, 3:]), frame.pose.position)
    turn = multiply(pose[:, 3:], np.array(frame.pose.quaternion))
    kinematics["frame"] = np.concatenate([at, turn], axis=1)[:, None]

    def missed(**changes):
        return failed(kinematics_checks(world, oracle, *states, {**kinematics, **changes}, has_frames=True))

    assert missed() == set()
    (check,) = (
        c for c in kinematics_checks(world, oracle, *states, kinematics, has_frames=True) if c.name == FRAME_CHECK
    )
    assert check.count == 3
    assert failed(kinematics_checks(world, oracle, *states, kinematics)) == set(), "an engine without frames"
    for column, name in ((1, FRAME_CHECK), (5, "frame, orientation")):
        off = kinematics["frame"].copy()
        off[2, 0, column] += 10 * MISS
        assert missed(frame=off) == {name}
    assert missed(frame=kinematics["frame"][:, :0]) == {FRAME_CHECK}
    del kinematics["frame"]
    assert missed() == {FRAME_CHECK}


@pytest.mark.parametrize("field", ["pose", "velocity", "v"])
def test_non_finite_kinematics_fail(engine, field):
    world, oracle, states, kinematics, *_ = engine
    kinematics[field][1, 0] = math.nan
    assert failed(kinematics_checks(world, oracle, *states, kinematics))


def test_every_element_of_the_mass_matrix_is_compared_in_its_scale(engine):
    world, oracle, states, _, dynamics = engine
    right = dynamics["mass"].copy()
    mass = oracle.mass_matrix(states[0][0])
    size = len(mass)
    np.testing.assert_array_equal(right[0], mass.ravel())  # one tree
    for i, j in itertools.combinations_with_replacement(range(size), 2):
        dynamics["mass"] = right.copy()
        dynamics["mass"][0, i * size + j] += MISS * math.sqrt(mass[i, i] * mass[j, j])
        assert failed(dynamics_checks(world, oracle, *states, dynamics)) == {"mass matrix"}, (i, j)


@pytest.mark.parametrize(("precision", "share"), [("double", 1.0), ("single", 109.0 * 2.0**-24 / 2e-6)])
def test_moments_of_a_thin_rod_are_compared_to_the_precision_of_inverse_tensors(precision, share):
    """In singles the larger moments of a rod are as precise as the ratio of its moments allows; the least one is as ever."""
    mass = np.diag([1.0, 1.0, 1.0, 0.01, 1.09, 1.09])
    scale = _scale(mass, np.array([-1, -1, -1, 0, 0, 0]), PRECISIONS[precision])
    assert np.diag(scale) == pytest.approx(np.diag(mass) * [1.0, 1.0, 1.0, 1.0, share, share])


def test_forces_at_speed_and_at_rest_are_distinguished(engine):
    world, oracle, states, _, dynamics = engine
    for key in ("bias_force", "gravity_force"):
        right = dynamics[key].copy()
        for i in range(right.shape[1]):
            dynamics[key] = right.copy()
            dynamics[key][0, i] += 1e-5 * np.abs(right[0]).max()
            assert failed(dynamics_checks(world, oracle, *states, dynamics)) == {key.replace("_", " ")}
        dynamics[key] = right
    dynamics["bias_force"][0, 0] = math.nan
    assert "bias force" in failed(dynamics_checks(world, oracle, *states, dynamics))


def test_gravity_pulling_the_other_way_is_found(engine):
    world, _, states, _, dynamics = engine
    up = dataclasses.replace(world, physics=dataclasses.replace(world.physics, gravity=(0.0, 0.0, 9.81)))
    assert failed(dynamics_checks(up, Oracle(up), *states, dynamics)) == {"bias force", "gravity force"}


def test_each_tree_is_queried_for_its_block_of_the_mass_matrix():
    """Two arms and a loose body, their bodies mixed: M of the whole is zero elsewhere."""
    arms = [worlds.tree(["hinge", "slide"], seed, prefix=f"{seed}_") for seed in (3, 4)]
    bodies = (arms[0][0], *worlds.tree(["free"], 5, prefix="loose_"), arms[1][0], arms[0][1], arms[1][1])
    world = worlds.world(bodies)
    oracle = Oracle(world)
    q, v = random_states(world, 1)
    assert [block.tolist() for block in oracle.blocks] == [[0, 8], [1, 2, 3, 4, 5, 6], [7, 9]]
    operation = dynamics_operation(oracle, q, v)
    assert operation.parameters["sizes"] == [2, 6, 2]
    assert operation.arrays["places"].tolist() == [0, 8, 1, 2, 3, 4, 5, 6, 7, 9]
    whole = oracle.mass_matrix(q[0])
    for block, mass in zip(oracle.blocks, oracle.mass_blocks(q[0]), strict=True):
        np.testing.assert_array_equal(whole[np.ix_(block, block)], mass)
        whole[np.ix_(block, block)] = 0.0
    assert not whole.any()


def test_copies_of_a_body_share_a_model_and_move_independently():
    world = worlds.spheres(40)
    oracle = Oracle(world)
    assert len({id(part[0]) for part in oracle._parts}) < len(oracle._parts)
    q, v = random_states(world, 1)
    alone = Oracle(dataclasses.replace(world, bodies=(world.bodies[33],)))
    at_q, at_v = oracle.layout.position[33], oracle.layout.velocity[33]
    for found, expected in zip(
        oracle.motion(q[0], v[0], None, 50, 50), alone.motion(q[0, at_q], v[0, at_v], None, 50, 50), strict=True
    ):
        np.testing.assert_allclose(found[-1][at_q if found.shape[1] == oracle.nq else at_v], expected[-1], rtol=1e-13)


def test_a_world_that_cannot_move_has_no_dynamics_to_compare():
    world = worlds.world(worlds.tree(["fixed"], 1))
    oracle, empty = Oracle(world), np.zeros((1, 0))
    found = {"mass": empty, "bias_force": empty, "gravity_force": empty}
    assert dynamics_checks(world, oracle, empty, empty, found) == []


# --- motion -------------------------------------------------------------------------------------------------------


def moved(world: World) -> tuple[Oracle, motion.OracleMotion]:
    oracle = Oracle(world)
    return oracle, motion.plan(world, oracle)


def test_motion_is_2000_steps_of_everything_at_once():
    world = worlds.every_joint(damping=0.2, spring_stiffness=1.0)
    _, plan = moved(world)
    assert plan.steps == 2000
    assert len(plan.poses) == 51
    assert (plan.effort != 0.0).all()
    assert (plan.v != 0.0).all()
    assert 0.0 < plan.floor < 1e-9
    assert plan.tolerance == max(1e-9, 100 * plan.floor)
    for body in range(len(world.bodies)):
        assert np.ptp(plan.poses[:, body, :3], axis=0).max() > 0.05, "every body moves"
    (check,) = plan.checks(world, {"pose": plan.poses})
    assert check.passed
    assert check.worst == 0.0
    assert check.count == plan.poses.shape[0] * plan.poses.shape[1]
    assert "2000 steps" in check.detail
    assert "floor" in check.detail


def test_a_body_that_leaves_the_path_is_found_with_its_step():
    world = worlds.damped_springs()
    _, plan = moved(world)
    for change in (slice(0, 3), slice(3, 7)):
        found = plan.poses.copy()
        found[30, 2, change] += 1e-8
        (check,) = plan.checks(world, {"pose": found})
        assert not check.passed
        assert check.where == f"bodies.{world.bodies[2].name}, step {30 * plan.every}"


@pytest.mark.parametrize("factor", [1.0 + 1e-6, 1.0 - 1e-6])
def test_an_engine_with_another_damping_is_found(factor):
    world = worlds.damped_springs()
    _, plan = moved(world)
    bodies = tuple(
        dataclasses.replace(b, joint=dataclasses.replace(b.joint, damping=b.joint.damping * factor))
        for b in world.bodies
    )
    other = Oracle(dataclasses.replace(world, bodies=bodies))
    states, _ = other.motion(plan.q, plan.v, plan.effort, plan.steps, plan.every)
    found = np.array([other.body_poses(q) for q in states])
    assert not plan.checks(world, {"pose": found})[0].passed


def test_short_or_non_finite_motion_fails():
    world = worlds.damped_springs()
    _, plan = moved(world)
    assert not plan.checks(world, {"pose": plan.poses[:-1]})[0].passed
    found = plan.poses.copy()
    found[5, 1, 0] = math.nan
    assert not plan.checks(world, {"pose": found})[0].passed


def test_motion_keeps_off_the_limits():
    world = worlds.limits_and_armature()
    oracle, plan = moved(world)
    assert plan.steps == 2000
    states, _ = oracle.motion(plan.q, plan.v, plan.effort, plan.steps, 1)
    assert (np.ptp(states, axis=0) > 0.01).all(), "held up, yet not held still"
    assert (states > -2.5).all()
    assert (states < 2.0).all()


def narrow(low: float, high: float) -> World:
    return worlds.world(worlds.tree(["fixed", "hinge", "hinge", "hinge"], 8, position_limits=(low, high)))


def test_motion_that_cannot_keep_off_the_limits_says_how_far_it_goes():
    world = narrow(-0.03, 0.04)
    oracle, plan = moved(world)
    assert motion.FEWEST < plan.steps < 2000
    states, _ = oracle.motion(plan.q, plan.v, plan.effort, plan.steps, 1)
    assert (states > -0.03).all()
    assert (states < 0.04).all()
    assert (np.ptp(states, axis=0) > 1e-4).all(), "every joint moves"
    (check,) = plan.checks(world, {"pose": plan.poses})
    assert check.passed
    assert f"{plan.steps} steps" in check.detail


def test_a_range_of_a_hair_is_enough_and_too_few_steps_fail(monkeypatch):
    world = narrow(-3e-8, 4e-8)
    _, plan = moved(world)
    assert plan.steps >= motion.FEWEST
    assert plan.checks(world, {"pose": plan.poses})[0].passed
    monkeypatch.setattr(motion, "FEWEST", plan.steps + 1)
    (check,) = plan.checks(world, {"pose": plan.poses})
    assert not check.passed
    assert check.count == 0
    assert "then a joint comes near a limit" in check.detail


def test_motion_is_requested_without_dry_friction_and_reports_it():
    world = worlds.limits_and_armature(dry_friction=0.2)
    _, plan = moved(world)
    assert plan.frictional.tolist() == [0, 1, 2]
    (check,) = plan.checks(world, {"pose": plan.poses})
    assert check.passed
    assert "dry friction of 3 joints switched off" in check.detail
    assert not plan.checks(world, {"pose": plan.poses * 2})[0].passed


def test_a_world_that_cannot_move_is_compared():
    world = worlds.world(worlds.tree(["fixed", "fixed"], 3))
    _, plan = moved(world)
    assert plan.floor == 0.0
    (check,) = plan.checks(world, {"pose": plan.poses})
    assert check.passed
    shifted = plan.poses + 1e-6
    assert not plan.checks(world, {"pose": shifted})[0].passed


def test_the_floor_of_chaos_is_the_tolerance():
    """Seven undamped hinges at 4 ms amplify the last bit: the tolerance follows what the oracle itself can promise."""
    bodies = worlds.tree(["fixed", *["hinge"] * 7], 21)
    world = worlds.world(bodies, physics=dataclasses.replace(worlds.every_joint().physics, timestep=0.004))
    _, plan = moved(world)
    assert plan.floor > 1e-11
    assert plan.tolerance == max(1e-9, 100 * plan.floor)


@pytest.mark.parametrize(("kinds", "seed", "parents", "joint", "why"), WILD)
def test_motion_is_compared_while_meaningful_with_the_reason_for_its_end(kinds, seed, parents, joint, why):
    world = at_4_ms(kinds, seed, parents, **joint)
    oracle, plan = moved(world)
    assert plan.steps >= motion.FEWEST
    assert plan.tolerance <= plan.precision.loosest
    assert np.isfinite(plan.poses).all()
    states, speeds = oracle.motion(plan.q, plan.v, plan.effort, plan.steps, plan.every)
    assert len(states) == len(plan.poses)
    for body, at_q, at_v in zip(world.bodies, oracle.layout.position, oracle.layout.velocity, strict=True):
        if body.joint.kind == "slide":
            assert np.abs(states[:, at_q] - states[0, at_q]).max() <= 3.0
        elif body.joint.kind != "fixed":
            assert np.linalg.norm(speeds[:, at_v][:, -3:], axis=1).max() * 0.004 <= 0.25
    (check,) = plan.checks(world, {"pose": plan.poses})
    assert check.passed
    assert why in check.detail


def test_the_floor_is_the_worst_of_several_runs():
    """One disturbed run is off by up to a factor of 15: every one of many stays within a few times the floor."""
    world = at_4_ms(["free", "fixed", "hinge", "ball", "ball"], 80)
    oracle, plan = moved(world)
    generator = np.random.default_rng(5)
    for _ in range(6):
        q, v = (state * (1.0 + 1e-15 * generator.choice([-1.0, 1.0], len(state))) for state in (plan.q, plan.v))
        states, _ = oracle.motion(q, v, plan.effort, plan.steps, plan.every)
        away = motion.deviation(plan.poses, np.array([oracle.body_poses(row) for row in states])).max()
        assert away <= 10.0 * plan.floor


@pytest.mark.parametrize("joint", [{"damping": 4000.0}, {"spring_stiffness": 1e6}])
def test_motion_that_diverges_fails_with_its_cause(joint):
    world = at_4_ms(["fixed", "hinge", "slide"], 3, **joint)
    _, plan = moved(world)
    (check,) = plan.checks(world, {"pose": plan.poses})
    assert not check.passed
    assert "is unstable at this timestep" in check.detail
    assert "stable up to" in check.detail


def test_long_motion_comes_no_farther_than_short_motion():
    """2,000 steps of 16 ms: 32 s of free fall would be 5 km."""
    for timestep in (0.001, 0.016):
        physics = dataclasses.replace(worlds.every_joint().physics, timestep=timestep)
        _, plan = moved(dataclasses.replace(worlds.spheres(2), physics=physics))
        assert plan.steps == 2000
        assert 5.0 < np.abs(plan.poses[:, 1:, :3]).max() < 30.0
