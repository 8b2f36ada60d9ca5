"""Control in the language: allowed and rejected entries, and the equality of all ways to write them."""

# ruff: noqa: E501 (a case is a line, so that cases can be compared)
from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.language.arrays import MOST_PATTERNS, matches
from simspec.language.control import MOST_CONTROLLERS, Controller
from simspec.language.formatting import format_text
from simspec.language.load import Spec, load
from simspec.language.models import Body, File
from simspec.language.reference import json_schema

SOLID = "mass: 1, inertia: {principal: [1, 1, 1]}"
HEAD = f"""simspec: 1
name: driven
physics: {{timestep: 1 ms, duration: 1 s}}
bodies:
  post: {{fixed: true}}
  arm: {{parent: post, {SOLID}, joint: {{name: elbow, type: hinge, axis: [0, 0, 1]}}}}
  hand: {{parent: arm, {SOLID}, joint: {{name: wrist, type: hinge, axis: [0, 1, 0]}}}}
  rail: {{parent: post, {SOLID}, joint: {{name: lift, type: slide, axis: [0, 0, 1]}}}}
  eye: {{{SOLID}, joint: {{name: gaze, type: ball}}}}
control:
"""
LINE = HEAD.count("\n") + 1
"""The line of the first controller."""
PD = "kp: 10, kd: 1"


def written(folder, control):
    path = folder / "driven.yaml"
    path.write_text(HEAD + control + "\n", encoding="utf-8")
    return path


def controller_line(text):
    """A controller on one line."""
    return f"  robot: {{{text}}}"


BAD = {
    # name: (controller, path below control.robot, message, found, allowed, hint); the last three only where given
    "unknown law": (f"law: pid, joints: [elbow], {PD}", "law", "not an allowed word", "'pid'", "computed-torque", "'pd'"),
    "unknown discretisation": (f"discretisation: euler, joints: [elbow], {PD}", "discretisation", "not an allowed word", "'euler'", "implicit", None),
    "unknown actuator": ("actuator: postion, joints: [elbow], kp: 1, kd: 1", "actuator", "not an allowed word", None, "velocity", "'position'"),
    "unknown key": (f"joints: [elbow], {PD}, gearing: 3", "gearing", "unknown key", None, "gear", "'gear'"),
    "no joints": (PD, "joints", "joints is missing", None, "full names", None),
    "empty joints": (f"joints: [], {PD}", "joints", "expected a list", "an empty list", None, None),
    "joints no list": (f"joints: elbow, {PD}", "joints", "expected a list", "'elbow'", None, None),
    "joint no name": (f"joints: [elbow, 3], {PD}", "joints.1", "expected a joint's name", "3", "full name", None),
    "joint with a space": (f"joints: ['el bow'], {PD}", "joints.0", "not a valid joint name", "'el bow'", "full name", None),
    "joint of a joint": (f"joints: [a/b/c], {PD}", "joints.0", "not a valid joint name", None, None, None),
    "too many patterns": (f"joints: [{', '.join(['a*'] * (MOST_PATTERNS + 1))}], {PD}", "joints", "too many entries", str(MOST_PATTERNS + 1), str(MOST_PATTERNS), None),
    "unknown joint": (f"joints: [elbo], {PD}", "joints.0", "there is no joint 'elbo'", "elbo", None, "'elbow'"),
    "pattern of nothing": (f"joints: ['arm/*'], {PD}", "joints.0", "no hinge or slide", "arm/*", "elbow, wrist, lift", None),
    "ball joint": (f"joints: [gaze], {PD}", "joints.0", "gaze is a ball joint", "gaze", "hinges and slides", None),
    "fixed joint": (f"joints: [post_joint], {PD}", "joints.0", "post_joint is a fixed joint", None, "hinges and slides", None),
    "pattern of balls alone": (f"joints: ['ga*'], {PD}", "joints.0", "gaze is a ball joint", None, None, None),
    "joint twice": (f"joints: [elbow, elbow], {PD}", "joints.1", "already listed", "elbow", None, "remove it"),
    "pattern adds nothing": (f"joints: [elbow, wrist, '*w'], {PD}", "joints.2", "already listed", "*w", None, None),
    "pd without gains": ("joints: [elbow], kd: 1", "", "needs kp and kd; kp is missing", None, None, "kp: "),
    "pd without damping": ("joints: [elbow], kp: 1", "", "needs kp and kd; kd is missing", None, None, "kd: "),
    "misspelt gain": ("joints: [elbow], kd: 1, kpp: 1", "kpp", "unknown key", None, "kp", "'kp'"),
    "velocity actuator with kp": (f"actuator: velocity, joints: [elbow], {PD}", "kp", "a velocity actuator has no kp", "10", "kd", None),
    "velocity actuator without kd": ("actuator: velocity, joints: [elbow]", "", "kd is missing", None, None, "kd: "),
    "effort actuator with kd": ("actuator: effort, joints: [elbow], kd: 1", "kd", "an effort actuator has no kd", "1", "neither", None),
    "native effort actuator": ("law: native, actuator: effort, joints: [elbow]", "actuator", "does not support an effort actuator", "effort", "position, velocity", "law: pd"),
    "native discretised": (f"law: native, discretisation: explicit, joints: [elbow], {PD}", "discretisation", "is not allowed with law native", "'explicit'", None, "remove it"),
    "native compensated": (f"law: native, gravity_compensation: true, joints: [elbow], {PD}", "gravity_compensation", "is not allowed with law native", None, None, None),
    "native with a frequency": (f"law: native, natural_frequency: 3, joints: [elbow], {PD}", "natural_frequency", "is not allowed", None, None, None),
    "pd with a frequency": (f"natural_frequency: 3, joints: [elbow], {PD}", "natural_frequency", "is not allowed with law pd", None, None, None),
    "pd with a ratio": (f"damping_ratio: 1, joints: [elbow], {PD}", "damping_ratio", "is not allowed with law pd", None, None, None),
    "computed torque without a frequency": ("law: computed-torque, joints: [elbow]", "", "needs a natural_frequency", None, None, "30 rad/s"),
    "computed torque with kp": ("law: computed-torque, natural_frequency: 9, kp: 1, joints: [elbow]", "kp", "is not allowed with law computed-torque", "1", None, None),
    "computed torque of an actuator": ("law: computed-torque, natural_frequency: 9, actuator: position, joints: [elbow]", "actuator", "is not allowed", None, None, None),
    "computed torque compensated": ("law: computed-torque, natural_frequency: 9, gravity_compensation: true, joints: [elbow]", "gravity_compensation", "always compensates gravity", None, None, None),
    "frequency in hertz": ("law: computed-torque, natural_frequency: 5 Hz, joints: [elbow]", "natural_frequency", "wrong unit", "'5 Hz'", "rad/s", None),
    "frequency zero": ("law: computed-torque, natural_frequency: 0, joints: [elbow]", "natural_frequency", "above 0", "0", None, None),
    "negative ratio": ("law: computed-torque, natural_frequency: 9, damping_ratio: -1, joints: [elbow]", "damping_ratio", "at least 0", "-1", None, None),
    "negative gain": ("joints: [elbow], kp: -1, kd: 1", "kp", "at least 0", "-1", None, None),
    "gain no number": ("joints: [elbow], kp: stiff, kd: 1", "kp", "found no number", "'stiff'", None, None),
    "gain a list": ("joints: [elbow], kp: [1], kd: 1", "kp", "expected an angular stiffness", "[1]", None, None),
    "gain without end": ("joints: [elbow], kp: .inf, kd: 1", "kp", "finite", None, None, None),
    "gain of no joint at all": ("joints: [elbow], kp: 3 kg, kd: 1", "kp", "wrong unit", "'3 kg'", "one with a unit: N m/rad or N/m", None),
    "gain of a slide at a hinge": ("joints: [elbow], kp: 3 N/mm, kd: 1", "kp", "expected an angular stiffness", "'3 N/mm'", "N m/rad", None),
    "gain of a hinge at a slide": ("joints: [lift], kp: 3 N m/rad, kd: 1", "kp", "expected a stiffness", "'3 N m/rad'", "N/m", None),
    "damping of a hinge at a slide": ("joints: [lift], kp: 3, kd: 1 N m s/rad", "kd", "expected a damping", None, "N s/m", None),
    "one gain for a mix": ("joints: [elbow, lift], kp: 3, kd: {elbow: 1, lift: 1}", "kp", "hinges and slides", "elbow: a hinge, lift: a slide", None, "kp: {JOINT"),
    "one entry for a mix": ("joints: [elbow, lift], kp: {'*': 3}, kd: {elbow: 1, lift: 1}", "kp.*", "hinges and slides", None, None, None),
    "one limit for a mix": ("joints: [elbow, lift], kp: {elbow: 1, lift: 1}, kd: {elbow: 1, lift: 1}, effort_limit: 3", "effort_limit", r"would have two units \(N m or N\)", None, None, None),
    "no gain for a joint": ("joints: [elbow, wrist], kp: {elbow: 3}, kd: 1", "kp", "no value for wrist", None, "one entry per joint", None),
    "two gains for a joint": ("joints: [elbow, wrist], kp: {'e*': 3, '*': 4}, kd: 1", "kp.*", r"elbow has two values: from '\*' and from 'e\*'", None, None, "an entry by name has precedence"),
    "gain for a joint that is not driven": ("joints: [elbow], kp: {elbow: 3, wrist: 4}, kd: 1", "kp.wrist", "'wrist' is not a joint of this controller", None, "elbow", None),
    "gain for a misspelt joint": ("joints: [elbow, wrist], kp: {elbow: 3, wrist: 3, wirst: 4}, kd: 1", "kp.wirst", "not a joint of this controller", None, "wrist", "'wrist'"),
    "gains for nothing": ("joints: [elbow], kp: {}, kd: 1", "kp", "no joint given", "{}", None, None),
    "key that is no name": ("joints: [elbow], kp: {elbow: 3, 'a b': 1}, kd: 1", "kp.a b", "not a valid joint name", "'a b'", None, None),
    "wrong number in a mapping": ("joints: [elbow, wrist], kp: {elbow: 3, wrist: -4}, kd: 1", "kp.wrist", "at least 0", "-4", None, None),
    "wrong unit in a mapping": ("joints: [elbow, lift], kp: {elbow: 3 N/m, lift: 3 N/m}, kd: {elbow: 1, lift: 1}", "kp.elbow", "expected an angular stiffness", "'3 N/m'", None, None),
    "gear zero": (f"joints: [elbow], {PD}, gear: 0", "gear", "at least 1e-06", "0", None, None),
    "gear backwards": (f"joints: [elbow], {PD}, gear: -3", "gear", "at least 1e-06", "-3", None, None),
    "gear without end": (f"joints: [elbow], {PD}, gear: 1e7", "gear", "must be at most", "10000000", "1e+06", None),
    "gear with a unit": (f"joints: [elbow], {PD}, gear: 3 rad", "gear", "wrong unit", "'3 rad'", None, None),
    "too stiff through the gear": ("joints: [elbow], kp: 1e25, kd: 1, gear: 1e6", "kp", "kp of elbow times the gear ratio is too large", "1e+25", "1e+30", None),
    "negative limit": (f"joints: [elbow], {PD}, effort_limit: -1", "effort_limit", "at least 0", "-1", None, None),
    "speed of a slide at a hinge": (f"joints: [elbow], {PD}, velocity_limit: 1 m/s", "velocity_limit", "expected an angular velocity", None, "rad/s", None),
    "rotor as a mass at a hinge": (f"joints: [elbow], {PD}, rotor_inertia: 1 kg", "rotor_inertia", "expected a moment of inertia", None, "kg m²", None),
    "compensation in words": (f"joints: [elbow], {PD}, gravity_compensation: 1", "gravity_compensation", "expected true or false", "1", None, None),
    "every half a step": (f"joints: [elbow], {PD}, every: 2.5 ms", "every", "control.robot.every must be a whole number of timesteps", "2.5 steps", "0.002 s or 0.003 s", None),
    "every without time": (f"joints: [elbow], {PD}, every: 0", "every", "above 0", "0", None, None),
    "every of the engine's own": (f"law: native, joints: [elbow], {PD}, every: 2 ms", "every", "not allowed with law native: the engine's own controller acts in every step", None, None, None),
    "a rate": (f"joints: [elbow], {PD}, decimation: 5", "decimation", "unknown key", None, None, "every"),
    "held for too long": ("joints: [elbow], kp: 0, kd: 10, every: 0.5 s", "", "unstable at this timestep", "efforts held for 500 steps", "every: 0.4 s", "a shorter every"),
    "list of nothing": (f"joints: , {PD}", "joints", "expected a list", "nothing", None, None),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_problem_has_its_path_message_value_and_hint(tmp_path, case):
    text, below, message, found, allowed, hint = BAD[case]
    with pytest.raises(SpecError) as caught:
        load(written(tmp_path, controller_line(text))).resolve()
    (problem,) = caught.value.problems
    assert problem.path == ".".join(filter(None, ("control.robot", below)))
    assert re.search(message, problem.message), problem.message
    for part, wanted in (("found", found), ("allowed", allowed), ("hint", hint)):
        if wanted is not None:
            assert wanted in (getattr(problem, part) or "nothing"), part
    assert problem.location.line == LINE
    assert problem.location.column > 1


@pytest.mark.parametrize(
    "text", ["control: 3", "control: [pd]", "control: {robot: }", "control: {a b: {joints: [x], kp: 1, kd: 1}}"]
)
def test_values_that_are_not_controllers_are_rejected(tmp_path, text):
    path = written(tmp_path, "")
    path.write_text(path.read_text().replace("control:", text), encoding="utf-8")
    with pytest.raises(SpecError) as caught:
        load(path)
    (problem,) = caught.value.problems
    assert problem.path.startswith("control")
    assert problem.location.line == LINE - 1


def test_all_problems_at_once(tmp_path):
    text = f"""\
  first: {{law: pd, joints: [elbo, wrist], kp: {{wrist: 3 m}}, kd: -1}}
  second: {{joints: [wrist], {PD}, gear: 0}}
  third: {{law: native, joints: [lift], kp: 1, discretisation: implicit}}"""
    with pytest.raises(SpecError) as caught:
        load(written(tmp_path, text))
    assert [problem.path for problem in caught.value.problems] == [
        "control.first.kp.wrist",
        "control.first.kd",
        "control.second.gear",
        "control.third",
        "control.third.discretisation",
    ]


def test_a_second_controller_of_a_joint_is_rejected(tmp_path):
    text = f"  first: {{joints: [elbow], {PD}}}\n  second: {{joints: [wrist, '*'], kp: 1, kd: 1}}"
    with pytest.raises(SpecError) as caught:
        load(written(tmp_path, text.replace("'*'", "'*w'"))).resolve()
    (problem,) = caught.value.problems
    assert problem.path == "control.second.joints.1"
    assert problem.message == "elbow has a controller already: first"
    assert problem.location.line == LINE + 1


def test_more_controllers_than_anyone_has(tmp_path):
    text = "\n".join(f"  c{i}: {{joints: [j{i}], {PD}}}" for i in range(MOST_CONTROLLERS + 1))
    with pytest.raises(SpecError, match="too many controllers"):
        load(written(tmp_path, text))


def test_values_that_are_no_data_are_reported_once(tmp_path):
    with pytest.raises(SpecError) as caught:
        load(written(tmp_path, controller_line("joints: [elbow, .nan], kp: {elbow: .nan}, kd: !!float 3")))
    assert len(caught.value.problems) == len({problem.location for problem in caught.value.problems}) == 3


# --- patterns ---


@pytest.mark.parametrize(
    ("pattern", "name", "meant"),
    [
        ("elbow", "elbow", True),
        ("elbow", "elbows", False),
        ("arm/*", "arm/elbow", True),
        ("arm/*", "arm/", True),
        ("arm/*", "arms/elbow", False),
        ("*", "arm/elbow", True),
        ("*joint", "finger_joint", True),
        ("a*a", "a", False),
        ("a*a", "aa", True),
        ("f*_joint_*", "finger_1_joint_2", True),
        ("f*_joint_*", "finger_1_join_2", False),
        ("*ab*ba*", "aba", False),
        ("*ab*ba*", "abba", True),
        ("a*b*b", "ab", False),
        ("**", "x", True),
    ],
)
def test_a_star_stands_for_any_text(pattern, name, meant):
    assert matches(pattern, name) is meant


@given(st.text("ab*", max_size=8), st.text("ab", max_size=10))
def test_patterns_mean_what_regular_expressions_would(pattern, name):
    wanted = re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), name)
    assert matches(pattern, name) is (wanted is not None)


def test_a_pattern_of_many_stars_is_quick():
    """Backtracking over 60 stars would not end in this life."""
    assert not matches("*a" * 60 + "*b", "a" * 400)


# --- the same by every way of saying it ---


MADE = {
    "kp": {"elbow": "10 N m/rad", "lift": "2 N/mm"},
    "kd": {"elbow": 1, "lift": "5 N s/m"},
    "gear": 3,
    "discretisation": "implicit",
}


def test_a_controller_that_is_made_in_python_is_that_of_its_yaml(tmp_path):
    solid = {"mass": 1, "inertia": {"principal": [1, 1, 1]}}
    bodies = {
        "arm": Body(**solid, joint={"name": "elbow", "type": "hinge", "axis": [0, 0, 1]}),
        "rail": Body(**solid, joint={"name": "lift", "type": "slide", "axis": [0, 0, 1]}),
    }
    file = File(simspec=1, name="made", bodies=bodies, control={"robot": Controller(joints=["*"], **MADE)})
    made = Spec.from_data(file)
    path = tmp_path / "made.yaml"
    path.write_text(made.to_yaml(), encoding="utf-8")
    assert load(path).data == made.data
    assert load(path).resolve() == made.resolve()
    (found,) = made.resolve().controllers
    assert (found.kp, found.kd) == ((90.0, 18000.0), (9.0, 45.0))


def test_every_is_stored_in_steps(tmp_path):
    path = written(tmp_path, controller_line(f"joints: [elbow], {PD}, every: 5 ms"))
    assert load(path).resolve().controllers[0].every_steps == 5
    assert load(path, sets=["control.robot.every=1 ms"]).resolve().controllers[0].every_steps == 0
    (controller,) = load(path, sets=["physics.timestep=2.5 ms"]).resolve().controllers
    assert (controller.every_steps, controller.hold) == (2, 2)


def test_an_override_changes_a_single_gain(tmp_path):
    path = written(tmp_path, controller_line("joints: [elbow, wrist], kp: {elbow: 3, wrist: 4}, kd: 1"))
    sets = ["control.robot.kp.wrist=5 N m/rad", "control.robot.kd=2", "control.robot.discretisation=implicit"]
    (found,) = load(path, sets=sets).resolve().controllers
    assert (found.kp, found.kd, found.discretisation) == ((3.0, 5.0), (2.0, 2.0), "implicit")
    with pytest.raises(SpecError, match="did you mean 'wrist'"):
        load(path, sets=["control.robot.kp.writs=5"]).resolve()


def test_the_canonical_layout_keeps_a_controller(tmp_path):
    path = written(
        tmp_path, controller_line("kd:   1, kp: {wrist: 4, 'el*': 3}, joints: [elbow, wrist], law: pd") + "   # soft"
    )
    text = path.read_text(encoding="utf-8")
    text = "expect: []\n" + text.replace("simspec: 1\n", "") + "simspec: 1\n"
    before = Spec.from_data(load(path).source.document.data).resolve()
    laid = format_text(text, "driven.yaml")
    path.write_text(laid, encoding="utf-8")
    assert load(path).resolve() == before
    words = ["simspec:", "bodies:", "control:", "expect:"]
    assert [line for line in laid.split("\n") if line.split(" ")[0] in words][:1] == ["simspec: 1"]
    assert [laid.index(f"\n{word}") for word in words[1:]] == sorted(laid.index(f"\n{word}") for word in words[1:])
    assert (
        "  robot:  # soft\n    law: pd\n    joints: [elbow, wrist]\n    kp: {wrist: 4, 'el*': 3}\n    kd: 1\n" in laid
    )
    assert format_text(laid, "driven.yaml") == laid


def test_the_schema_knows_numbers_by_joint():
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    controller = {**schema["definitions"]["Controller"], "definitions": schema["definitions"]}
    good = {"joints": ["arm/*"], "kp": "3 N m/rad", "kd": {"arm/*": 3}}
    jsonschema.validate(good, controller)
    for wrong in (
        {"kp": -1},
        {"kp": {}},
        {"kp": {"a b": 1}},
        {"kp": [1]},
        {"joints": []},
        {"joints": ["a b"]},
        {"gear": 0},
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({**good, **wrong}, controller)


def test_places_of_what_a_controller_says(tmp_path):
    spec = load(written(tmp_path, "  robot:\n    joints: [elbow]\n    kp: 1\n    kd: 1\n    rotor_inertia: 1e-3"))
    assert spec.locate("control.robot").line == LINE
    assert spec.locate("control.robot.kp").line == LINE + 2
    # the armature of a joint that states none comes from the rotor
    assert spec.locate("bodies.arm.joint.armature").line == LINE + 4
    assert spec.locate("bodies.hand.joint.armature").line == spec.locate("bodies.hand").line
