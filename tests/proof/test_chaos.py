"""Motions that no two programs compute alike: tried more gently first, then not compared, and said so in the verdict."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from simspec.dynamics.oracle import Oracle
from simspec.proof import motion
from simspec.proof.checks import TOO_CHAOTIC, Check
from simspec.proof.expected import chaotic, judge, uncomparable
from simspec.proof.judge import judge_proof
from simspec.proof.motion import at_rest
from simspec.proof.verify import verify
from simspec.world.types import Body, EngineOptions, Inertial, Joint, Physics, Pose, World

pytestmark = pytest.mark.usefixtures("warm_engines")

LINK = 0.05
ROD = (1e-5, 1e-5, 1e-6, 0.0, 0.0, 0.0)


def chain(links: int, side: float = -1.0, first: float = 0.0, **joint: object) -> World:
    """Links on hinges about x and y in turn, that hang (``side`` −1) or stand on each other (1)."""
    bodies: list[Body] = []
    for row in range(links):
        place = (0.0, 0.0, side * LINK) if row else (0.0, 0.0, 20.0)
        axis = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))[row % 2]
        actual = Joint(
            f"j{row}",
            "hinge",
            f"l{row - 1}" if row else None,
            Pose(place),
            axis,
            position=(0.0 if row else first,),
            velocity=(0.0,),
            **joint,
        )
        bodies.append(Body(f"l{row}", "l0", Inertial(0.05, (0.0, 0.0, side * LINK / 2), ROD), actual))
    options = (EngineOptions("mujoco", accept=("joint.limits.position",)),)
    return World("chain", tuple(bodies), physics=Physics(steps=100), engines=options)


STANDING = chain(60, 1.0, position_limits=(-0.2, 0.2))


@pytest.mark.parametrize("first", [0.0, 1.0])
def test_a_long_chain_is_followed_near_its_rest(first):
    world = chain(100, first=first)
    plan = motion.plan(world, Oracle(world))
    assert plan.steps >= motion.FEWEST, plan.ends
    assert chaotic(world) == ""
    assert plan.tolerance <= 1e-7
    moves = np.abs(plan.poses[-1] - plan.poses[0]).max()
    assert moves > 1e4 * plan.tolerance, "the plan compares motion"
    assert (plan.effort != 0.0).all()


def test_rest_is_where_weights_and_springs_balance():
    world = chain(3, first=1.0, spring_stiffness=0.05, spring_rest=0.3)
    oracle = Oracle(world)
    zeros = np.zeros(3)

    def unbalanced(q: np.ndarray) -> float:
        return float(np.abs(oracle.bias_force(q, zeros) - oracle.joint_effort(q, zeros)).max())

    rest = at_rest(world, oracle, lambda q: False)
    assert unbalanced(rest) < 0.05 * unbalanced(np.array([1.0, 0.0, 0.0]))
    values = at_rest(world, oracle, lambda q: bool(abs(q[0]) < 0.9))
    assert 0.9 <= values[0] < 0.95, "it ends where a joint comes near a limit"


def test_growing_errors_are_chaos_and_a_narrow_range_is_not():
    plan = motion.plan(STANDING, Oracle(STANDING))
    assert plan.steps < motion.FEWEST
    assert plan.chaos.startswith(TOO_CHAOTIC)
    assert uncomparable(STANDING) == {"L6": plan.chaos}
    joint = dataclasses.replace(STANDING.bodies[-1].joint, dry_friction=1e-6)
    bodies = (*STANDING.bodies[:-1], dataclasses.replace(STANDING.bodies[-1], joint=joint))
    assert list(uncomparable(dataclasses.replace(STANDING, bodies=bodies))) == ["L6 motion"]
    hanging = chain(3, position_limits=(-1e-12, 1e-12))
    short = motion.plan(hanging, Oracle(hanging))
    assert short.steps < motion.FEWEST
    assert short.chaos == "", "it fails, since limits leave too few steps"


def test_the_verdict_names_chaotic_parts_and_a_judge_confirms_them():
    proof = verify(STANDING, ["mujoco"]).engines["mujoco"]
    assert proof.valid
    assert proof.verdict.startswith(f"valid; not compared: L6 ({TOO_CHAOTIC}")
    assert judge_proof("mujoco", proof, STANDING) == []
    assert judge(STANDING, proof.checks, {**proof.not_compared, "L6": "nothing moves in this world"})
    hanging = chain(3)
    sound = verify(hanging, ["mujoco"]).engines["mujoco"]
    without = [check for check in sound.checks if check.level != "L6"]
    said = {**sound.not_compared, "L6": proof.not_compared["L6"]}
    assert any("does not apply to this world" in line for line in judge(hanging, without, said))
    failed = Check("L6", "motion", 0, 1e-9, None, "", "few")
    assert any("L6 motion" in line for line in judge(STANDING, [*proof.checks, failed], proof.not_compared))
