"""Sums of joint positions: read, resolved, refused, in the world's text, in its mechanics, in its proof."""

from __future__ import annotations

import copy
import dataclasses
import json

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.dynamics.stability import unstable
from simspec.errors import SpecError
from simspec.language.load import Spec
from simspec.proof import limits
from simspec.proof.limits import Stops, inside
from simspec.proof.selftest_worlds import bench, sums
from simspec.proof.selftest_worlds import sum_limits as limited
from simspec.runner import metrics
from simspec.world.actions import JointSum
from simspec.world.canonical import canonical_json, from_plain
from simspec.world.constraints import JointSums
from simspec.world.kinematics import constrained_trees, initial_state
from simspec.world.types import World

LINK = {"mass": 1, "inertia": {"principal": [0.01, 0.01, 0.01]}, "centre_of_mass": [0, 0, -0.2]}
SPEC = {
    "simspec": 1,
    "name": "arm",
    "physics": {"timestep": "1 ms", "duration": "1 s"},
    "bodies": {
        "base": {"fixed": True},
        "upper": {"parent": "base", "joint": {"name": "hip", "type": "hinge", "axis": [0, 1, 0]}, **LINK},
        "lower": {"parent": "upper", "joint": {"name": "knee", "type": "hinge", "axis": [0, 1, 0]}, **LINK},
        "ball": {"parent": "lower", "joint": {"name": "socket", "type": "ball"}, **LINK},
    },
}


def resolved(**content: object) -> World:
    spec = copy.deepcopy(SPEC)
    spec["constraints"] = {"tendon": {"sum": {"joints": {"knee": 0.03, "hip": -0.01}, **content}}}
    return Spec.from_data(spec).resolve()


def refused(**content: object) -> str:
    with pytest.raises(SpecError) as error:
        resolved(**content)
    (problem,) = error.value.problems
    return f"{problem.path}: {problem.message}"


def test_a_sum_is_resolved():
    world = resolved(stiffness="800 N/m", rest="1 cm", damping=2, limits={"position": ["-20 mm", 0.02]})
    joints = (("hip", -0.01), ("knee", 0.03))
    assert world.sums == (JointSum("tendon", joints, 800.0, 0.01, 2.0, (-0.02, 0.02)),)
    assert resolved(stiffness="8 N m/rad", rest="180 deg").sums[0].rest == pytest.approx(np.pi)
    again = from_plain(World, json.loads(canonical_json(world)))
    assert again == world
    assert '"sums"' not in canonical_json(bench(""))


@pytest.mark.parametrize(
    ("content", "given"),
    [
        ({}, "nothing acts along this sum"),
        ({"rest": 1, "damping": 1}, "a sum without a spring has no rest"),
        ({"stiffness": "1 N/m", "rest": "1 deg"}, "an angle and of a length"),
        ({"stiffness": -1}, "must be at least 0"),
        ({"damping": 1, "joints": {}}, "no joint given"),
        ({"damping": 1, "joints": {"knee": 0}}, "adds nothing"),
        ({"damping": 1, "joints": {"kne": 1}}, "there is no joint 'kne'"),
        ({"damping": 1, "joints": {"socket": 1}}, "socket is a ball joint"),
        ({"limits": {"position": [1, 1]}}, "not below the upper"),
        ({"limits": {"position": [0.1, 1]}}, "begins beyond its limits"),
        ({"damping": 1e5}, "explicit damping at the sum 'tendon' of joint positions is unstable"),
        ({"stiffness": 1e9}, "explicit spring at the sum 'tendon' of joint positions is unstable"),
    ],
)
def test_errors_are_reported_at_their_location(content, given):
    text = refused(**content)
    assert given in text
    assert text.startswith("constraints.tendon.sum")


def test_a_sum_in_an_array_is_copied_with_its_tree():
    spec = copy.deepcopy(SPEC)
    for name in ("base", "upper", "lower", "ball"):
        spec["bodies"][name] = {**spec["bodies"][name]}
    spec["bodies"]["base"]["array"] = {"grid": [2, 1, 1], "spacing": [3, 1, 1]}
    spec["constraints"] = {"tendon": {"sum": {"joints": {"knee": 1, "hip": -1}, "damping": 1}}}
    world = Spec.from_data(spec).resolve()
    assert len(world.sums) == 2
    names = {body.joint.name for body in world.bodies}
    assert all({joint for joint, _ in sum_.joints} <= names for sum_ in world.sums)


def test_efforts_are_the_gradient_of_the_energy_and_take_power_out():
    world = sums("")
    oracle, along = Oracle(world), JointSums(world.bodies, world.sums)
    q, v = np.array([0.3, -0.7]), np.array([0.4, 1.1])
    zeros = np.zeros(2)
    slope = [(along.energy(q + step) - along.energy(q - step)) / 2e-6 for step in 1e-6 * np.eye(2)]
    np.testing.assert_allclose(oracle.joint_effort(q, zeros), -np.array(slope), rtol=1e-8)
    lost = (oracle.joint_effort(q, v) - oracle.joint_effort(q, zeros)) @ v
    assert lost == pytest.approx(-4.0 * (along.weights @ v)[0] ** 2)
    arrays = {
        "q": q[None],
        "v": v[None],
        "pose": oracle.body_poses(q)[None],
        "velocity": oracle.body_velocities(q, v)[None],
    }
    kinetic, potential = metrics.energy(world, arrays)
    np.testing.assert_allclose([kinetic[0], potential[0]], oracle.energy(q, v), rtol=1e-12)


def test_the_largest_stable_step_is_that_of_a_single_mass_on_the_spring():
    """m L̈ = −k L with 1/m = c M⁻¹ cᵀ is stable while k dt² < 4 m."""
    world = dataclasses.replace(sums(""), sums=(dataclasses.replace(sums("").sums[0], stiffness=5e6, damping=0.0),))
    oracle, weights = Oracle(world), JointSums(world.bodies, world.sums).weights[0]
    (found,) = unstable(world)
    assert (found.along, found.damping) == ("tendon", False)
    mobility = weights @ np.linalg.solve(oracle.mass_matrix(initial_state(world)[0]), weights)
    assert found.largest_stable_step <= 2.0 / np.sqrt(5e6 * mobility) * 1.001
    calm = dataclasses.replace(world, physics=dataclasses.replace(world.physics, timestep=found.largest_stable_step))
    assert not unstable(calm)


def test_trees_that_a_sum_joins_move_together():
    entry = bench("")
    other = tuple(
        dataclasses.replace(
            body,
            name=f"{body.name}2",
            joint=dataclasses.replace(
                body.joint, name=f"{body.joint.name}2", parent=body.joint.parent and f"{body.joint.parent}2"
            ),
        )
        for body in entry.bodies
    )
    along = JointSum("rod", (("lower_joint", 1.0), ("lower_joint2", -2.0)), 50.0)
    world = dataclasses.replace(entry, bodies=(*entry.bodies, *other), sums=(along,))
    assert [len(bodies) for bodies in constrained_trees(world)] == [6]
    q, v = initial_state(world)
    states, _ = Oracle(world).motion(q, v, None, 50, 50)
    free, _ = Oracle(dataclasses.replace(world, sums=())).motion(q, v, None, 50, 50)
    assert np.abs(states[-1] - free[-1])[[1, 3]].min() > 1e-3


# --- the proof ---------------------------------------------------------------------------------------------------------


def test_positions_are_brought_inside_and_to_the_limits():
    world = limited("")
    stops = Stops(world)
    moved = inside(world, np.array([1.2, -1.0]), 0.4)
    assert not stops.near(moved[None], 0.39)[0]
    plan = limits.plan(world, Oracle(world))
    assert plan is not None
    assert len(plan.trials) == 4
    ends = sorted({round(float(stops.along.lengths(trial.q)[0]), 9) for trial in plan.trials if not trial.v.any()})
    assert ends == [-0.2, 0.4]


def test_a_limit_that_does_not_act_is_found():
    world = limited("")
    plan = limits.plan(world, Oracle(world))
    assert plan is not None
    at_rest = {"v": np.zeros((4, 2))}
    assert [check.passed for check in plan.checks(world, at_rest)] == [True]
    oracle = Oracle(world)
    steps = limits.STEPS
    free = [oracle.motion(trial.q, trial.v, trial.effort, steps, steps)[1][-1] for trial in plan.trials]
    for number in range(4):
        values = at_rest["v"].copy()
        values[number] = free[number]
        (check,) = plan.checks(world, {"v": values})
        assert not check.passed
        assert check.where == "constraints.tendon.sum.limits.position"
    (check,) = plan.checks(world, {"v": np.full((4, 2), np.nan)})
    assert not check.passed


def test_sums_without_an_effective_limit_give_a_reason():
    world = limited("")
    assert limits.nothing_stops(world) == ""
    assert "no sum" in limits.nothing_stops(sums(""))
    bodies = tuple(
        dataclasses.replace(body, joint=dataclasses.replace(body.joint, position_limits=(-0.1, 0.3)))
        if body.joint.kind == "hinge"
        else body
        for body in world.bodies
    )
    narrow = dataclasses.replace(world, bodies=bodies)
    assert "joints' own limits" in limits.nothing_stops(narrow)
    assert limits.plan(narrow, Oracle(narrow)) is None
