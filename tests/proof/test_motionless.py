"""Initial states of motion proofs in worlds with loops and narrow limits, and worlds without such a proof, with the reason."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.proof.expected import judge, left_out, motionless
from simspec.proof.motion import FEWEST, plan
from simspec.proof.verify import verify
from simspec.world.kinematics import initial_state, layout_of
from tests import constrained, worlds
from tests.nightly import NIGHTLY

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINES = ["dart", "pybullet"]


@pytest.mark.parametrize(
    "limits", [(0.0, 0.5), *(pytest.param(limits, marks=NIGHTLY) for limits in [(0.0, 0.1), (0.2, 0.9)])]
)
def test_a_loop_that_begins_at_a_limit_is_moved_inside_along_its_constraints(limits):
    world = constrained.linkage(limits)
    assert motionless(world) == ""
    oracle = Oracle(world)
    motion = plan(world, oracle)
    assert motion.steps >= FEWEST, motion.ends
    assert constrained.violation(world, motion.q) < 1e-12
    first = motion.q[layout_of(world).position[1]].item()
    assert limits[0] + 0.1 * (limits[1] - limits[0]) < first < limits[1] - 0.1 * (limits[1] - limits[0])


def test_states_within_the_limits_are_unchanged():
    world = constrained.linkage((-1.0, 1.0))
    start, _ = initial_state(world)
    assert np.array_equal(Oracle(world).inwards(start), start)


def test_a_joint_that_constraints_hold_at_its_limit_is_named():
    """Three hinges with axes anyhow, of which a pin leaves none a motion."""
    world = constrained.closed_loop()
    assert motionless(world) == ""
    joint = world.bodies[1].joint
    (value,) = joint.position
    body = dataclasses.replace(world.bodies[1], joint=dataclasses.replace(joint, position_limits=(value, value + 1.0)))
    actual = dataclasses.replace(world, bodies=(world.bodies[0], body, *world.bodies[2:]))
    assert f"constraints hold joint {joint.name!r} at" in motionless(actual)
    assert left_out(actual)["L6"] == motionless(actual)


@pytest.mark.parametrize(("limits", "word"), [((0.0, 0.5), "no position of joint"), ((-0.5, 0.5), "")])
def test_coupled_joints_with_opposing_single_sided_ranges_are_named(limits, word):
    """As in a gripper whose fingers' joints all have one range: where two add up to zero, both are at its end."""
    base = constrained.follower()
    joints = [dataclasses.replace(body.joint, position_limits=limits, position=(0.0,)) for body in base.bodies[1:3]]
    bodies = [dataclasses.replace(body, joint=joint) for body, joint in zip(base.bodies[1:3], joints, strict=True)]
    follow = dataclasses.replace(base.constraints[0], offset=0.0)
    world = dataclasses.replace(base, bodies=(base.bodies[0], *bodies, *base.bodies[3:]), constraints=(follow,))
    assert motionless(world)[: len("no position of joint")] == word
    if word:
        assert f"{joints[0].name!r}, {joints[1].name!r} away" in motionless(world)
        assert left_out(world)["L6"] == motionless(world)


def test_a_joint_with_a_single_position_has_no_motion_test_and_the_certificate_says_so():
    base = worlds.world(worlds.tree(["fixed", "hinge", "hinge"], 7))
    joint = base.bodies[1].joint
    (value,) = joint.position
    body = dataclasses.replace(base.bodies[1], joint=dataclasses.replace(joint, position_limits=(value, value)))
    world = dataclasses.replace(base, bodies=(base.bodies[0], body, *base.bodies[2:]))
    for engine in ENGINES:
        world = worlds.with_options(world, engine, accept=("joint.limits.position",))
    proofs = verify(world, ENGINES).engines
    for proof in proofs.values():
        assert proof.valid, proof.checks
        assert proof.not_compared["L6"] == motionless(world)
        assert judge(world, proof.checks, proof.not_compared) == []
    moving = dataclasses.replace(world, bodies=base.bodies)
    assert any("does not apply" in line for line in judge(moving, proof.checks, proof.not_compared))
