"""Constraints of specs: names, copies, initial states that follow or must agree, and what is wrong, with its place."""

# ruff: noqa: E501 (a case is a line)
from __future__ import annotations

import dataclasses
import textwrap

import pytest

import simspec
from simspec.errors import SpecError
from simspec.world.kinematics import initial_state
from simspec.world.types import ConnectConstraint, FollowConstraint, WeldConstraint, World

HINGE = "{type: hinge, axis: [0, 1, 0]"
FINGERS = f"""
    palm: {{fixed: true}}
    left: {{parent: palm, mass: 1, inertia: {{principal: [1, 1, 1]}}, joint: {HINGE}, position: 30 deg, velocity: 0.5}}}}
    right: {{parent: palm, mass: 1, inertia: {{principal: [1, 1, 1]}}, joint: {HINGE}}}}}
    tip: {{parent: right, mass: 1, inertia: {{principal: [1, 1, 1]}}, joint: {{type: slide, axis: [1, 0, 0]}}}}
"""
MIRROR = "mirror: {follow: {joint: right_joint, leader: left_joint, ratio: -1, offset: 3 deg}}"


def scenario(tmp_path, bodies: str, constraints: str, more: str = "") -> World:
    lines = ["simspec: 1", "name: held", "bodies:", bodies, "constraints:", textwrap.indent(constraints, "  "), more]
    path = tmp_path / "held.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return simspec.load(path).resolve()


def refused(tmp_path, *parts: str) -> str:
    with pytest.raises(SpecError) as error:
        scenario(tmp_path, *parts)
    assert all(problem.location is not None and problem.location.line for problem in error.value.problems)
    return str(error.value)


def test_a_follower_begins_where_its_leader_wants_it(tmp_path):
    chain = f"{MIRROR}\nthird: {{follow: {{joint: tip_joint, leader: right_joint, ratio: 0.1, offset: 5 mm}}}}"
    world = scenario(tmp_path, FINGERS, chain)
    left, right, tip = (body.joint for body in world.bodies[1:])
    assert world.constraints == (
        FollowConstraint(
            "mirror",
            "right_joint",
            "left_joint",
            -1.0,
            simspec.load(tmp_path / "held.yaml").resolve().constraints[0].offset,
        ),
        FollowConstraint("third", "tip_joint", "right_joint", 0.1, 0.005),
    )
    assert right.position == (-left.position[0] + world.constraints[0].offset,)
    assert right.velocity == (-0.5,)
    assert tip.position == (0.1 * right.position[0] + 0.005,)


@pytest.mark.parametrize(
    ("constraint", "given"),
    [
        ("m: {follow: {joint: right_joint, leader: unknown}}", "there is no joint 'unknown'"),
        ("m: {follow: {joint: palm_joint, leader: left_joint}}", "palm_joint is a fixed joint"),
        ("m: {follow: {joint: left_joint, leader: left_joint}}", "a joint cannot follow itself"),
        ("m: {follow: {joint: right_joint, leader: left_joint, ratio: 0}}", "follow nothing"),
        ("m: {follow: {joint: right_joint, leader: left_joint, offset: 3 kg}}", "offset"),
        ("m: {follow: {joint: tip_joint, leader: left_joint, offset: 3 deg}}", "offset"),
        ("m: {follow: {joint: left_joint, leader: right_joint}}", "is not where right_joint wants it"),
        (f"{MIRROR}\nother: {{follow: {{joint: right_joint, leader: tip_joint}}}}", "follows left_joint already"),
        (
            "a: {follow: {joint: right_joint, leader: tip_joint}}\nb: {follow: {joint: tip_joint, leader: right_joint}}",
            "these joints follow each other: right_joint -> tip_joint -> right_joint",
        ),
        ("m: {connect: {bodies: [left, unknown], at: [0, 0, 0]}}", "there is no body 'unknown'"),
        ("m: {connect: {bodies: [left, left], at: [0, 0, 0]}}", "cannot be connected to itself"),
        ("m: {connect: {bodies: [left, tip], at: [1, 0, 0], second_at: [0, 0, 0.1]}}", "do not meet initially"),
        ("m: {weld: {bodies: [left, tip], pose: {xyz: [1, 0, 0]}}}", "is not initially where left holds it"),
        ("m: {connect: {bodies: [left, tip], at: [1, 0, 0]}}", "initial velocities of left and tip would part them"),
        ("m: {}", "expected one of follow, connect, weld"),
        ("m: {mimic: {joint: a}}", "no such key|unknown"),
    ],
)
def test_errors_have_their_location(tmp_path, constraint, given):
    import re

    assert re.search(given, refused(tmp_path, FINGERS, constraint))


def test_bodies_that_are_joined_rigidly_need_no_constraint(tmp_path):
    bodies = FINGERS + "    nail: {parent: tip, joint: {type: fixed}, mass: 1, inertia: {principal: [1, 1, 1]}}\n"
    assert "joined rigidly already" in refused(tmp_path, bodies, "m: {weld: {bodies: [tip, nail]}}")


def test_limits_hold_for_where_a_follower_is_put(tmp_path):
    bodies = FINGERS.replace(
        "joint: {type: slide, axis: [1, 0, 0]}", "joint: {type: slide, axis: [1, 0, 0], limits: {position: [0, 0.01]}}"
    )
    assert "beyond its limits" in refused(tmp_path, bodies, "m: {follow: {joint: tip_joint, leader: left_joint}}")


def test_a_follower_has_no_controller_and_patterns_leave_it_out(tmp_path):
    text = refused(tmp_path, FINGERS, MIRROR, "control: {c: {joints: [right_joint], kp: 1, kd: 1}}")
    assert "right_joint follows left_joint, and has no controller" in text
    every = "control: {c: {joints: ['*_joint'], law: computed-torque, natural_frequency: 5}}"
    world = scenario(tmp_path, FINGERS, MIRROR, every)
    assert world.controllers[0].joints == ("left_joint", "tip_joint")


def test_points_and_poses_follow_from_the_initial_positions(tmp_path):
    static = FINGERS.replace(", velocity: 0.5", "")
    text = "pin: {connect: {bodies: [left, tip], at: [0.2, 0, 0]}}\nglue: {weld: {bodies: [palm, tip]}}"
    world = scenario(tmp_path, static, text)
    glue, pin = world.constraints
    assert isinstance(glue, WeldConstraint)
    assert isinstance(pin, ConnectConstraint)
    assert glue.pose == dataclasses.replace(glue.pose, position=(0.0, 0.0, 0.0))
    assert pin.second_point == pytest.approx((0.2 * 3**0.5 / 2, 0.0, -0.1), abs=1e-15)
    assert {("left", "tip"), ("palm", "tip")} <= set(world.contact.excluded_bodies)


def test_arrays_copy_the_constraints_of_their_tree(tmp_path):
    bodies = """
    lead: {array: {line: 3, step: [1, 0, 0]}, mass: 1, inertia: {principal: [1, 1, 1]}, joint: {type: hinge, axis: [0, 1, 0], position: 0.1}}
    next: {parent: lead, mass: 1, inertia: {principal: [1, 1, 1]}, joint: {name: turn, type: hinge, axis: [0, 1, 0]}}
"""
    world = scenario(tmp_path, bodies, "m: {follow: {joint: turn, leader: lead_joint, ratio: 2}}")
    assert [
        (constraint.name, constraint.joint, constraint.leader)
        for constraint in world.constraints
        if isinstance(constraint, FollowConstraint)
    ] == [(f"m_{index}", f"turn_{index}", f"lead_{index}_joint") for index in range(3)]
    assert initial_state(world)[0].tolist() == pytest.approx([0.1, 0.2] * 3)


def test_models_bring_their_constraints_under_their_names(tmp_path):
    model = "\n".join(["simspec: 1", "name: hand", "model:", "  bodies:", FINGERS, "  constraints:", f"    {MIRROR}"])
    (tmp_path / "hand.yaml").write_text(model, encoding="utf-8")
    placed = """
simspec: 1
name: placed
models:
  one: {use: hand.yaml}
  two: {use: hand.yaml, array: {line: 2, step: [1, 0, 0]}, positions: {left_joint: 0.2}}
constraints:
  both: {follow: {joint: one/left_joint, leader: two_0/left_joint, offset: 0}}
"""
    (tmp_path / "placed.yaml").write_text(placed, encoding="utf-8")
    with pytest.raises(SpecError, match="one/left_joint is not where two_0/left_joint wants it"):
        simspec.load(tmp_path / "placed.yaml").resolve()
    (tmp_path / "placed.yaml").write_text(placed.partition("constraints:")[0], encoding="utf-8")
    world = simspec.load(tmp_path / "placed.yaml").resolve()
    assert [constraint.name for constraint in world.constraints] == ["one/mirror", "two_0/mirror", "two_1/mirror"]
    alone = simspec.load(tmp_path / "hand.yaml").resolve()
    assert [constraint.name for constraint in alone.constraints] == ["mirror"]


def test_the_place_of_a_constraint_is_found(tmp_path):
    (tmp_path / "hand.yaml").write_text(
        "\n".join(["simspec: 1", "name: hand", "model:", "  bodies:", FINGERS, "  constraints:", f"    {MIRROR}"]),
        encoding="utf-8",
    )
    path = tmp_path / "placed.yaml"
    path.write_text(
        "simspec: 1\nname: placed\nmodels:\n  one: {use: hand.yaml, array: {line: 2, step: [1, 0, 0]}}\n",
        encoding="utf-8",
    )
    place = simspec.load(path).locate("constraints.one_1/mirror")
    assert place is not None
    assert place.file.endswith("hand.yaml")
    assert place.line == 12


def test_constraints_of_a_model_stand_in_the_model(tmp_path):
    path = tmp_path / "hand.yaml"
    path.write_text(f"simspec: 1\nname: hand\nmodel:\n  bodies:\n{FINGERS}\nconstraints: {{}}\n", encoding="utf-8")
    with pytest.raises(SpecError, match="stand in the model itself"):
        simspec.load(path)
