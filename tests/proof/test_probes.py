"""The probes see what an engine does wrong: the oracle plays the engine, first rightly, then with one thing changed."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.dynamics.states import random_states
from simspec.proof import motion, touch
from simspec.proof.probes import dynamics_checks, kinematics_checks, rotation_error
from simspec.world.kinematics import CollisionFilter, rigid_groups
from simspec.world.types import Body, Contact, Inertial, Joint, PairContact, Pose, Shape, World
from tests import worlds

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
    both = (np.concatenate([q, q]), np.concatenate([v, np.zeros_like(v)]))
    dynamics = {
        "mass_matrix": np.array([oracle.mass_matrix(row) for row in both[0]]),
        "bias_force": np.array([oracle.bias_force(*row) for row in zip(*both, strict=True)]),
    }
    return world, oracle, (q, v), kinematics, both, dynamics


def test_a_perfect_engine_passes(engine):
    world, oracle, states, kinematics, both, dynamics = engine
    checks = kinematics_checks(world, oracle, *states, kinematics) + dynamics_checks(world, oracle, *both, dynamics)
    assert failed(checks) == set()
    counts = {check.name: (check.level, check.count) for check in checks}
    assert counts["pose, position"] == ("L2", 3)
    assert counts["mass matrix"] == counts["bias force"] == counts["gravity force"] == ("L3", 3)


@pytest.mark.parametrize("body", range(6))
@pytest.mark.parametrize(("column", "name"), [(0, "pose, position"), (2, "pose, position"), (4, "pose, orientation")])
def test_a_pose_that_is_off_is_noticed(engine, body, column, name):
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


def test_velocities_and_states_that_are_off_are_noticed(engine):
    world, oracle, states, kinematics, *_ = engine
    kinematics["velocity"][0, 3, 5] += 100 * MISS
    kinematics["v"][2, 1] += MISS
    assert failed(kinematics_checks(world, oracle, *states, kinematics)) == {"body velocity", "state given back"}


@pytest.mark.parametrize("field", ["pose", "velocity", "v"])
def test_what_is_not_a_number_fails(engine, field):
    world, oracle, states, kinematics, *_ = engine
    kinematics[field][1, 0] = math.nan
    assert failed(kinematics_checks(world, oracle, *states, kinematics))


def test_every_element_of_the_mass_matrix_counts_in_its_own_scale(engine):
    world, oracle, _, _, both, dynamics = engine
    right = dynamics["mass_matrix"].copy()
    size = right.shape[1]
    for i, j in itertools.combinations_with_replacement(range(size), 2):
        dynamics["mass_matrix"] = right.copy()
        dynamics["mass_matrix"][0, i, j] += MISS * math.sqrt(right[0, i, i] * right[0, j, j])
        assert failed(dynamics_checks(world, oracle, *both, dynamics)) == {"mass matrix"}, (i, j)


def test_forces_at_speed_and_at_rest_are_told_apart(engine):
    world, oracle, _, _, both, dynamics = engine
    right = dynamics["bias_force"].copy()
    for row, name in ((0, "bias force"), (3, "gravity force")):
        for i in range(right.shape[1]):
            dynamics["bias_force"] = right.copy()
            dynamics["bias_force"][row, i] += 1e-5 * np.abs(right[row]).max()
            assert failed(dynamics_checks(world, oracle, *both, dynamics)) == {name}
    dynamics["bias_force"][0, 0] = math.nan
    assert "bias force" in failed(dynamics_checks(world, oracle, *both, dynamics))


def test_gravity_pulling_the_other_way_is_noticed(engine):
    world, _, _, _, both, dynamics = engine
    up = dataclasses.replace(world, physics=dataclasses.replace(world.physics, gravity=(0.0, 0.0, 9.81)))
    assert failed(dynamics_checks(up, Oracle(up), *both, dynamics)) == {"bias force", "gravity force"}


# --- meetings -----------------------------------------------------------------------------------------------------


def radius(world: World, name: str) -> float:
    (body,) = (b for b in world.bodies if b.name == name)
    return body.shapes[0].size[0]


def overlapping(world: World, oracle: Oracle, q: np.ndarray) -> set[tuple[int, int]]:
    """The pairs of solid spheres, and spheres with the plane z = 0, that overlap: plain geometry, no engine."""
    poses = oracle.body_poses(q)
    found = set()
    for (a, one), (b, two) in itertools.combinations(enumerate(world.bodies), 2):
        if one.shapes[0].kind == "plane":
            gap = poses[b, 2] - radius(world, two.name)
        else:
            gap = np.linalg.norm(poses[a, :3] - poses[b, :3]) - radius(world, one.name) - radius(world, two.name)
        if gap < 0.0:
            found.add((a, b))
    return found


@pytest.mark.parametrize("count", [1, 2, 7, 8])
def test_free_spheres_meet_in_pairs_and_nothing_else_touches(count):
    world = worlds.spheres(count)
    oracle = Oracle(world)
    meetings = touch.plan(world, oracle)
    met = set()
    for q, pairs in zip(meetings.q, meetings.pairs, strict=True):
        planned = {(min(pair), max(pair)) for pair in pairs}
        assert overlapping(world, oracle, q) == planned
        met |= planned
    assert met == set(itertools.combinations(range(count + 1), 2))
    assert meetings.unreachable == meetings.untried == 0
    if count == 8:  # seven rounds of four pairs, one state a sphere for the floor, one with all apart
        assert len(meetings.q) == 7 + 8 + 1


def arm_of_spheres() -> World:
    """A planar arm of two hinges and a fixed tip, a post in its reach, and one beyond it."""
    solid, z = Inertial(1.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)), (0.0, 0.0, 1.0)

    def ball(name: str, x: float) -> tuple[Shape, ...]:
        return (Shape(f"{name}_0", "sphere", (0.1,), Pose((x, 0.0, 0.0)), "default"),)

    def post(name: str, x: float) -> Body:
        return Body(
            name, name, Inertial(0.0), Joint(f"{name}_joint", "fixed", origin=Pose((x, 0.0, 0.0))), ball(name, 0.0)
        )

    hinge = {"kind": "hinge", "axis": z, "position": (0.0,), "velocity": (0.0,), "position_limits": (-3.0, 3.0)}
    bodies = (
        Body("upper", "upper", solid, Joint("upper_joint", parent=None, **hinge), ball("upper", 0.5)),
        Body(
            "lower",
            "upper",
            solid,
            Joint("lower_joint", parent="upper", origin=Pose((1.0, 0.0, 0.0)), **hinge),
            ball("lower", 0.5),
        ),
        Body(
            "tip",
            "upper",
            solid,
            Joint("tip_joint", "fixed", "lower", Pose((1.0, 0.05, 0.0))),
            ball("tip", 0.0),
        ),
        post("near", -1.3),
        post("far", 9.0),
    )
    contact = Contact(
        materials=(worlds.MATERIAL,),
        pairs=(PairContact("default", "default", 0.4, 0.0),),
        excluded_bodies=worlds.parent_pairs(bodies),
    )
    return worlds.world(bodies, "arm-of-spheres", contact=contact)


def centres(world: World, oracle: Oracle, q: np.ndarray) -> np.ndarray:
    """Where the shapes' centres are: all of them lie on their body's x axis."""
    poses = oracle.body_poses(q)
    return np.array(
        [
            pose[:3] + body.shapes[0].pose.position[0] * np.array([1 - 2 * (pose[6] ** 2), 2 * pose[3] * pose[6], 0.0])
            for body, pose in zip(world.bodies, poses, strict=True)
        ]
    )


def test_joints_are_searched_until_shapes_meet_or_cannot():
    world = arm_of_spheres()
    oracle = Oracle(world)
    meetings = touch.plan(world, oracle)
    names = [body.name for body in world.bodies]
    met = set()
    for q, pairs in zip(meetings.q, meetings.pairs, strict=True):
        assert (np.abs(q) <= 3.0).all(), "inside the limits"
        for a, b in pairs:
            at = centres(world, oracle, q)
            assert np.linalg.norm(at[a] - at[b]) < 0.2, "the two spheres overlap"
            met.add(frozenset((names[a], names[b])))
    groups = rigid_groups(world)
    assert groups["lower"] == groups["tip"]
    assert frozenset(("lower", "tip")) not in met
    reachable = [("near", "lower"), ("near", "tip"), ("upper", "lower")]
    assert met == {frozenset(pair) for pair in reachable}
    # upper and near: 0.5 m from the axis, not 1.3; upper and tip: 0.5 m apart at least; all three and far
    assert meetings.unreachable == 5


def perfect_touching(world: World, meetings: touch.Meetings) -> np.ndarray:
    rule = CollisionFilter(world)
    rows = [
        (state, min(pair), max(pair))
        for state, pairs in enumerate(meetings.pairs)
        for pair in pairs
        if rule.may_touch(meetings.names[pair[0]], meetings.names[pair[1]])
    ]
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


@pytest.fixture
def gripper():
    world = worlds.gripper()
    meetings = touch.plan(world, Oracle(world))
    return world, meetings, perfect_touching(world, meetings)


def test_the_right_filter_passes(gripper):
    world, meetings, touching = gripper
    (check,) = touch.touch_checks(world, meetings, touching)
    assert check.passed
    # both fingers and the palm with the bar, one finger with the other, and two states in which nothing touches
    assert check.count == 6
    assert len(touching) == 2  # of these only the fingers with the bar may touch
    assert check.detail == "2 pairs cannot be brought together"  # the fingers slide in a line beside the palm


def test_a_contact_that_is_missing_is_noticed(gripper):
    world, meetings, touching = gripper
    for row in range(len(touching)):
        (check,) = touch.touch_checks(world, meetings, np.delete(touching, row, axis=0))
        assert not check.passed
        assert check.worst == 1.0
        assert "should touch" in check.detail


def test_a_contact_that_should_be_filtered_is_noticed(gripper):
    world, meetings, touching = gripper
    tried = {(state, min(p), max(p)) for state, pairs in enumerate(meetings.pairs) for p in pairs}
    forbidden = tried - {tuple(row) for row in touching.tolist()}
    assert len(forbidden) == 2
    for extra in forbidden:
        (check,) = touch.touch_checks(world, meetings, np.vstack([touching, extra]))
        assert not check.passed
        assert "should not touch" in check.detail
        assert check.where == f"bodies.{meetings.names[extra[1]]}, bodies.{meetings.names[extra[2]]}"


def test_a_forbidden_contact_counts_wherever_it_shows():
    """Parts of one rigid group cannot be brought together, yet an engine may let them touch."""
    world = arm_of_spheres()
    meetings = touch.plan(world, Oracle(world))
    touching = perfect_touching(world, meetings)
    assert touch.touch_checks(world, meetings, touching)[0].passed
    lower, tip = (meetings.names.index(name) for name in ("lower", "tip"))
    (check,) = touch.touch_checks(world, meetings, np.vstack([touching, (0, lower, tip)]))
    assert not check.passed
    assert check.where == "bodies.lower, bodies.tip"


def test_bodies_of_one_rigid_group_alone_are_asked_about_too():
    world = arm_of_spheres()
    bodies = (world.bodies[0], dataclasses.replace(world.bodies[3], joint=Joint("j", "fixed", "upper")))
    contact = dataclasses.replace(world.contact, excluded_bodies=worlds.parent_pairs(bodies))
    world = dataclasses.replace(world, bodies=bodies, contact=contact)
    meetings = touch.plan(world, Oracle(world))
    assert len(meetings.q) == 1
    assert meetings.pairs == [[]]
    assert not touch.touch_checks(world, meetings, np.array([(0, 0, 1)]))[0].passed
    assert touch.touch_checks(world, meetings, np.zeros((0, 3)))[0].passed


def test_states_are_bounded_and_what_is_left_is_said(monkeypatch):
    monkeypatch.setattr(touch, "MAX_STATES", 10)
    world = worlds.spheres(8)
    meetings = touch.plan(world, Oracle(world))
    assert len(meetings.q) == 10  # seven rounds, one with all apart, two spheres on the floor
    assert meetings.untried == 6
    (check,) = touch.touch_checks(world, meetings, perfect_touching(world, meetings))
    assert check.passed
    assert "6 pairs left untried" in check.detail


# --- motion -------------------------------------------------------------------------------------------------------


def moved(world: World) -> tuple[Oracle, motion.Motion]:
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
    (check,) = motion.motion_checks(world, plan, {"pose": plan.poses})
    assert check.passed
    assert check.worst == 0.0
    assert check.count == plan.poses.shape[0] * plan.poses.shape[1]
    assert "2000 steps" in check.detail
    assert "floor" in check.detail


def test_a_body_that_leaves_the_path_is_noticed_with_its_step():
    world = worlds.damped_springs()
    _, plan = moved(world)
    for change in (slice(0, 3), slice(3, 7)):
        found = plan.poses.copy()
        found[30, 2, change] += 1e-8
        (check,) = motion.motion_checks(world, plan, {"pose": found})
        assert not check.passed
        assert check.where == f"bodies.{world.bodies[2].name}, step {30 * plan.every}"


@pytest.mark.parametrize("factor", [1.0 + 1e-6, 1.0 - 1e-6])
def test_an_engine_with_another_damping_is_noticed(factor):
    world = worlds.damped_springs()
    _, plan = moved(world)
    bodies = tuple(
        dataclasses.replace(b, joint=dataclasses.replace(b.joint, damping=b.joint.damping * factor))
        for b in world.bodies
    )
    other = Oracle(dataclasses.replace(world, bodies=bodies))
    states, _ = other.motion(plan.q, plan.v, plan.effort, plan.steps, plan.every)
    found = np.array([other.body_poses(q) for q in states])
    assert not motion.motion_checks(world, plan, {"pose": found})[0].passed


def test_what_ends_early_or_is_not_a_number_fails():
    world = worlds.damped_springs()
    _, plan = moved(world)
    assert not motion.motion_checks(world, plan, {"pose": plan.poses[:-1]})[0].passed
    found = plan.poses.copy()
    found[5, 1, 0] = math.nan
    assert not motion.motion_checks(world, plan, {"pose": found})[0].passed


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
    (check,) = motion.motion_checks(world, plan, {"pose": plan.poses})
    assert check.passed
    assert f"{plan.steps} steps" in check.detail


def test_a_range_of_a_hair_is_enough_and_too_few_steps_fail(monkeypatch):
    world = narrow(-3e-8, 4e-8)
    _, plan = moved(world)
    assert plan.steps >= motion.FEWEST
    assert motion.motion_checks(world, plan, {"pose": plan.poses})[0].passed
    monkeypatch.setattr(motion, "FEWEST", plan.steps + 1)
    (check,) = motion.motion_checks(world, plan, {"pose": plan.poses})
    assert not check.passed
    assert check.count == 0
    assert "until a joint comes to a limit" in check.detail


def test_motion_is_asked_without_dry_friction_and_says_so():
    world = worlds.limits_and_armature(dry_friction=0.2)
    _, plan = moved(world)
    assert plan.rubbing.tolist() == [0, 1, 2]
    (check,) = motion.motion_checks(world, plan, {"pose": plan.poses})
    assert check.passed
    assert "dry friction of 3 joints switched off" in check.detail
    assert not motion.motion_checks(world, plan, {"pose": plan.poses * 2})[0].passed


def test_a_world_that_cannot_move_is_compared_all_the_same():
    world = worlds.world(worlds.tree(["fixed", "fixed"], 3))
    _, plan = moved(world)
    assert plan.floor == 0.0
    (check,) = motion.motion_checks(world, plan, {"pose": plan.poses})
    assert check.passed
    shifted = plan.poses + 1e-6
    assert not motion.motion_checks(world, plan, {"pose": shifted})[0].passed


def test_the_floor_of_chaos_is_the_tolerance():
    """Seven undamped hinges at 4 ms amplify the last bit: the tolerance follows what the oracle itself can promise."""
    bodies = worlds.tree(["fixed", *["hinge"] * 7], 21)
    world = worlds.world(bodies, physics=dataclasses.replace(worlds.every_joint().physics, timestep=0.004))
    _, plan = moved(world)
    assert plan.floor > 1e-11
    assert plan.tolerance == max(1e-9, 100 * plan.floor)
