"""Refusals of engines: one line for each feature, and two last lines with the command that accepts all acceptable features."""

from __future__ import annotations

import json
import shlex

import pytest

from simspec import cli
from simspec.compiler import compile_world
from simspec.engines.kit.registry import engines
from simspec.errors import EngineRefusal, Problem, UnsupportedError
from simspec.language.load import load
from simspec.report.problems import brief, ways_out

SPEC = """\
simspec: 1
name: rig
physics: {duration: 0.1}
contact: {friction_cone: elliptic, materials: {wood: {friction: 0.5, torsional_friction: 0.01}}}
bodies:
  floor: {fixed: true, shapes: [{box: {size: [2, 2, 0.1]}}]}
  arm:
    parent: floor
    mass: 1
    inertia: {principal: [0.1, 0.1, 0.1]}
    joint: {type: hinge, axis: [0, 1, 0], limits: {position: [-1, 1]}}
  box: {mass: 1, pose: {xyz: [0, 0.5, 0.15]}, shapes: [{box: {size: [0.2, 0.1, 0.2]}}]}
  rod: {mass: 1, pose: {xyz: [0, 0.9, 0.15]}, shapes: [{cylinder: {radius: 0.1, length: 0.2}}]}
"""
ENGINES = ("mujoco", "pybullet", "rapier", "physx")
WORDS = [word for name in ENGINES for word in ("-e", name)]


@pytest.fixture
def rig(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.yaml").write_text(SPEC)
    return tmp_path / "rig.yaml"


def refused(rig, *engines):
    with pytest.raises(UnsupportedError) as error:
        compile_world(load(rig).resolve(), engines or ENGINES)
    return error.value.problems


def test_each_refusal_has_its_engine_its_feature_and_the_option_that_accepts_it(rig):
    found = {(refusal.engine, refusal.feature): refusal.option for refusal in refused(rig)}
    assert found["mujoco", "joint.limits.position"] == "accept"
    assert found["rapier", "material.friction.torsional"] == ""
    assert all(isinstance(refusal, EngineRefusal) for refusal in refused(rig))


def test_a_feature_refused_by_all_engines_is_printed_on_a_single_line(rig):
    lines = brief(refused(rig))
    features = {refusal.feature for refusal in refused(rig)}
    assert len(lines) == len(features) < len(refused(rig))
    (line,) = [line for line in lines if "material.friction.torsional" in line]
    assert line.endswith("material.friction.torsional: approximate in mujoco; not supported by rapier, physx")


def test_check_ends_in_two_lines_whose_command_works(rig, capsys):
    assert cli.main(["check", "rig.yaml", *WORDS]) == 2
    *lines, accept, lack = capsys.readouterr().err.strip().splitlines()
    assert accept == (
        "To accept what differs in mujoco, pybullet: simspec accept rig.yaml -e mujoco -e pybullet or "
        f"{accept.rpartition(' or ')[2]}"
    )
    assert lack.startswith("Not supported by rapier, physx, whatever is accepted: ")
    assert "material.friction.torsional" in lack
    assert len(lines) < len(refused(rig)), "fewer than one line for each problem"
    command, _, words = accept.partition(": simspec ")[2].partition(" or ")
    assert cli.main(["check", "rig.yaml", "-e", "mujoco", "-e", "pybullet", *shlex.split(words)]) == 0
    assert cli.main(shlex.split(command)) == 0
    assert cli.main(["check", "rig.yaml", "-e", "mujoco", "-e", "pybullet"]) == 0


def test_the_full_texts_are_there_on_request_and_everything_as_data(rig, capsys):
    assert cli.main(["check", "rig.yaml", *WORDS]) == 2
    assert "accept it by name" not in capsys.readouterr().err
    assert cli.main(["check", "rig.yaml", *WORDS, "-v"]) == 2
    said = capsys.readouterr().err
    assert "accept it by name: engines.mujoco.accept: [joint.limits.position]" in said
    assert said.strip().splitlines()[-2].startswith("To accept what differs")
    assert cli.main(["check", "rig.yaml", *WORDS, "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert {"engine", "feature", "option", "message", "hint"} <= error["problems"][0].keys()
    ways = error["ways_out"]["rig.yaml"]
    assert "joint.limits.position" in ways["accepted"]["mujoco"]["accept"]
    assert "material.friction.torsional" in ways["unsupported"]["rapier"]
    assert ways["command"] == "simspec accept rig.yaml -e mujoco -e pybullet"


INSTALLED = all(engines()[name].version() for name in ENGINES)


@pytest.mark.parametrize("command", ["run", "verify", "compile"])
def test_other_commands_end_with_the_same_lines(rig, capsys, command):
    if command != "compile" and not INSTALLED:
        pytest.skip("an engine is not installed, which run and verify say first")
    assert cli.main([command, "rig.yaml", *WORDS]) == 2
    *_, accept, lack = capsys.readouterr().err.strip().splitlines()
    assert "simspec accept rig.yaml -e mujoco -e pybullet" in accept
    assert lack.startswith("Not supported by rapier, physx")


def test_a_feature_that_no_engine_supports_is_named(rig):
    found = ways_out(refused(rig, "rapier", "physx"), "rig.yaml", ("rapier", "physx"))
    assert "material.friction.torsional" in found.by_none
    assert found.command == found.words == ""
    first, last = found.lines()
    assert first == "Accepting by name does not help any of these engines"
    assert last.startswith("Supported by none of these engines: ")
    assert not ways_out(refused(rig), "rig.yaml", ENGINES).by_none, "MuJoCo has all of it"


def test_all_that_is_missing_can_be_accepted(rig):
    found = ways_out(refused(rig, "mujoco"), "a b.yaml", ("mujoco", "dart"))
    assert found.command == "simspec accept 'a b.yaml' -e mujoco"
    assert found.lines()[1] == "Every feature is supported by each of these engines once it is accepted"


def test_a_format_that_refuses_despite_acceptance_is_not_suggested(rig, monkeypatch):
    world = load(rig).resolve()
    monkeypatch.setattr("simspec.selection.acceptable", lambda world, name, pythons: name != "mujoco")
    found = ways_out(refused(rig, "mujoco", "pybullet"), "rig.yaml", ("mujoco", "pybullet"), world)
    assert list(found.accepted) == ["pybullet"]
    assert list(found.unsupported) == ["mujoco"]


def test_a_problem_of_no_engine_has_no_such_way_out():
    assert ways_out([Problem("a timestep that is wrong")], "rig.yaml", ENGINES) is None
    (line,) = brief([EngineRefusal("does not write this", "bodies.a", engine="mujoco"), Problem("another")])
    assert line == "mujoco: does not write this"
    why = "dart does not support contact between mesh and mesh: an overlap of 1 mm is reported as 69 mm"
    assert brief([EngineRefusal(why, engine="dart")]) == ["contact between mesh and mesh: not supported by dart"]


def test_a_scenario_of_the_library_is_not_to_be_written(capsys):
    assert cli.main(["check", "gripper-lift", "--set", "engines={}", "-e", "mujoco", "-e", "dart"]) == 2
    accept = capsys.readouterr().err.strip().splitlines()[-2]
    assert accept == "To accept what differs in mujoco, dart: --accept all"


def test_several_specs_have_two_lines_each(rig, capsys):
    (rig.parent / "other.yaml").write_text(SPEC.replace("name: rig", "name: other"))
    assert cli.main(["check", "rig.yaml", "other.yaml", "-e", "mujoco"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()[-4:]
    assert [line.split(":")[0] for line in lines] == ["rig.yaml", "rig.yaml", "other.yaml", "other.yaml"]


def test_check_accepts_by_name(rig, capsys):
    assert cli.main(["check", "rig.yaml", "-e", "mujoco", "--accept", "joint.limits.position"]) == 2
    said = capsys.readouterr().err
    assert "joint.limits.position" not in said
    assert cli.main(["check", "rig.yaml", "-e", "mujoco", "--accept", "all"]) == 0
