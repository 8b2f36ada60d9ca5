"""Probable mistakes are reported with their place and a hint; intended values are not."""

from __future__ import annotations

import json

import pytest

from simspec import cli
from simspec.language.load import Spec, load
from simspec.resolve import warnings as module

FLOOR = {"fixed": True, "shapes": [{"plane": {}}]}
BALL = {"pose": {"xyz": [0, 0, 1]}, "shapes": [{"sphere": {"radius": 0.1}, "density": 1000}]}
LINK = {"mass": 1, "inertia": {"principal": [0.1, 0.1, 0.1]}}


def warned(bodies, **more) -> list[tuple[str, str]]:
    """The (path, message) of every warning of a scenario."""
    data = {"name": "x", "physics": {"duration": 1}, "contact": {"materials": {"m": {}}}, "bodies": bodies, **more}
    found = Spec.from_data(data).warnings()
    assert all(problem.hint for problem in found)
    return [(problem.path, problem.message) for problem in found]


def hinge(**more):
    return {"arm": {**LINK, "joint": {"type": "hinge", "axis": [0, 0, 1], **more}}}


def test_a_scene_that_is_meant_has_none():
    tame = {"pose": {"xyz": [0, 0, 1], "rpy": [3.14, -6.28, 0]}}
    assert warned({"floor": FLOOR, "ball": BALL | tame}) == []
    assert warned(hinge(position="90 deg", limits={"position": [-6.2832, 6.29]})) == []


@pytest.mark.parametrize(
    ("bodies", "path", "words"),
    [
        ({"b": BALL | {"pose": {"rpy": [90, 0, 0]}}}, "bodies.b.pose.rpy.0", "90 without a unit is 90 rad: 14.3 turns"),
        ({"b": BALL | {"pose": {"rpy": [0, 0, -45.5]}}}, "bodies.b.pose.rpy.2", "-45.5 without a unit"),
        (hinge(position=30), "bodies.arm.joint.position", "30 without a unit"),
        (hinge(limits={"position": [-180, 180]}), "bodies.arm.joint.limits.position.0", "-180 without a unit"),
        (hinge(spring={"stiffness": 1, "rest": 45}), "bodies.arm.joint.spring.rest", "45 without a unit"),
        (hinge(origin={"rpy": [0, 90, 0]}), "bodies.arm.joint.origin.rpy.1", "90 without a unit"),
        (
            {"arm": {**LINK, "joint": {"type": "ball", "position": {"rpy": [0, 0, 60]}}}},
            "bodies.arm.joint.position.rpy.2",
            "60 without a unit",
        ),
        (
            {"b": {**BALL, "shapes": [{"sphere": {"radius": 0.1}, "density": 1, "pose": {"rpy": [0, 0, 10]}}]}},
            "bodies.b.shapes.0.pose.rpy.2",
            "10 without a unit",
        ),
    ],
)
def test_angles_of_many_turns_without_a_unit(bodies, path, words):
    found = dict(warned(bodies))
    assert words in found[path]


def test_angles_with_a_unit_and_displacements_of_slides_are_meant():
    assert warned(hinge(position="720 deg", limits={"position": ["-900 deg", "15 rad"]})) == []
    slide = {"arm": {**LINK, "joint": {"type": "slide", "axis": [0, 0, 1], "limits": {"position": [-20, 20]}}}}
    assert warned(slide) == []


def test_positions_of_a_placed_model_and_angles_in_its_file(tmp_path):
    model = {"simspec": 1, "name": "m", "model": {"bodies": hinge(origin={"rpy": [45, 0, 0]})}}
    (tmp_path / "m.yaml").write_text(json.dumps(model))
    scene = {"simspec": 1, "name": "s", "physics": {"duration": 1}}
    scene["models"] = {"a": {"use": "m.yaml", "positions": {"arm_joint": 90}}}
    (tmp_path / "s.yaml").write_text(json.dumps(scene))
    found = load(tmp_path / "s.yaml").warnings()
    assert {(problem.path, problem.location.file.rpartition("/")[2]) for problem in found} == {
        ("model.bodies.arm.joint.origin.rpy.0", "m.yaml"),
        ("models.a.positions.arm_joint", "s.yaml"),
    }


@pytest.mark.parametrize(
    ("bodies", "more", "path", "words"),
    [
        ({"b": BALL}, {"physics": {}}, "physics.duration", "zero duration"),
        ({"b": BALL}, {"physics": {"duration": 1, "gravity": [0, 0, -9810]}}, "physics.gravity", "9810 m/s²"),
        (
            {"b": {**BALL, "shapes": [{"sphere": {"radius": 100}, "density": 11}]}},
            {},
            "bodies.b.shapes.0",
            "reaches 100 m",
        ),
        (
            {"b": {**BALL, "shapes": [{"sphere": {"radius": 1}, "density": 7.85}]}},
            {},
            "bodies.b.shapes.0.density",
            "7.85",
        ),
        (
            {"b": {**BALL, "shapes": [{"sphere": {"radius": 1}, "density": 78500}]}},
            {},
            "bodies.b.shapes.0.density",
            "78500",
        ),
        ({"b": {**LINK, "mass": 2e6}}, {}, "bodies.b.mass", "2e+06 kg"),
        ({"b": {**LINK, "mass": 1e-12}}, {}, "bodies.b.mass", "1e-12 kg"),
        ({"b": {**BALL, "pose": {"xyz": [0, 50_000, 0]}}}, {}, "bodies.b.pose", "5e+04 m"),
    ],
)
def test_numbers_of_another_unit(bodies, more, path, words):
    found = dict(warned(bodies, **more))
    assert words in found[path]


def test_a_floor_may_be_large_and_a_model_file_takes_no_time(tmp_path):
    big = {"fixed": True, "shapes": [{"box": {"size": [5000, 5000, 10]}, "pose": {"xyz": [0, 0, -5]}}]}
    assert warned({"floor": big, "ball": BALL}) == []
    model = {"simspec": 1, "name": "m", "model": {"bodies": hinge()}}
    (tmp_path / "m.yaml").write_text(json.dumps(model))
    assert load(tmp_path / "m.yaml").warnings() == []


def test_initial_overlaps_and_arrays_are_reported_once(tmp_path):
    sunk = BALL | {"pose": {"xyz": [0, 0, 0]}, "array": {"line": 7, "step": [1, 0, 0]}}
    data = {"simspec": 1, "name": "x", "physics": {"duration": 1}, "contact": {"materials": {"m": {}}}}
    (tmp_path / "x.yaml").write_text(json.dumps({**data, "bodies": {"floor": FLOOR, "ball": sunk}}))
    [found] = load(tmp_path / "x.yaml").warnings()
    assert found.path == "bodies.ball_0.shapes.0"
    assert found.message == "floor and ball_0 overlap by 100 mm at the start (and 6 more of this kind)"
    assert (found.found, found.location.line) == ("floor_0 in ball_0_0", 1)
    assert warned({"floor": FLOOR, "ball": BALL | {"pose": {"xyz": [0, 0, 0.0995]}}}) == []


def finger(force: float):
    """A slide of 20 N that presses with ``force``."""
    pad = {"joint": {"type": "slide", "axis": [1, 0, 0], "limits": {"effort": 20, "position": [0, 0.1]}}, **LINK}
    model = {
        "bodies": {"palm": {"fixed": True}, "pad": {"parent": "palm", **pad}},
        "grasps": {
            "pinch": {
                "open": {"pad_joint": 0},
                "closed": {"pad_joint": 0.05},
                "forces": [{"body": "pad", "force": [force, 0, 0]}],
            }
        },
    }
    program = [{"grip": 1, "in": 0.2}, {"grip": 1, "squeeze": 1, "in": 0.2}]
    return {
        "models": {"hand": model},
        "control": {"hand": {"joints": ["hand/*"], "law": "pd", "kp": 100, "kd": 10, "discretisation": "implicit"}},
        "trajectory": {"program": program},
    }


def test_a_squeeze_beyond_the_finger():
    [(path, message)] = warned({}, **finger(30.0))
    assert path == "trajectory.program.1.squeeze"
    assert message == "hand/pad_joint is commanded 30 N and gives at most 20: the effort is clipped"
    assert warned({}, **finger(20.0)) == []


def test_many_are_bounded_and_the_rest_is_counted(monkeypatch):
    monkeypatch.setattr(module, "MOST_WARNINGS", 3)
    spec = Spec.from_data(
        {"name": "x", "physics": {"duration": 1}, "bodies": {f"b{k}": {**LINK, "mass": 1e7} for k in range(9)}}
    )
    found = spec.warnings()
    assert len(found) == 4
    assert found[-1].message == "and 6 more warnings"


SLIP = """simspec: 1
name: slip
physics: {duration: 0.01}
bodies:
  b: {mass: 1, inertia: {principal: [1, 1, 1]}, pose: {rpy: [90, 0, 0]}}
record: {every: 10 ms, channels: [pose, velocity]}
"""


@pytest.mark.parametrize(
    "command",
    [
        ["check"],
        ["compile", "--out", "o"],
        ["verify", "--engine", "mujoco", "--out", "o"],
        ["run", "--engine", "mujoco", "--no-repeats", "--no-verify"],
    ],
    ids=lambda words: words[0],
)
def test_commands_print_warnings_and_stop_only_on_request(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slip.yaml").write_text(SLIP)
    name, *options = command
    if name != "check":
        options = [*options, *(["--engine", "mujoco"] if name == "compile" else [])]

    def call(*more: str) -> int:
        return cli.main([name, "slip.yaml", *options, *more])

    assert call("--strict") == 2
    refused = capsys.readouterr().err
    assert "slip.yaml:5:62: error[W101]: bodies.b.pose.rpy.0: 90 without a unit" in refused
    assert sorted(path.name for path in tmp_path.iterdir()) == ["slip.yaml"]
    assert call() == 0
    said = capsys.readouterr().err
    assert "slip.yaml:5:62: warning[W101]: bodies.b.pose.rpy.0: 90 without a unit is 90 rad: 14.3 turns" in said
    assert "90 deg, or 90 rad if intended" in said
    assert call("--json") == 0
    captured = capsys.readouterr()
    answer = json.loads(captured.out)
    [found] = answer["specs"][0]["warnings"] if name == "check" else answer["warnings"]
    assert found["location"] == {"file": "slip.yaml", "line": 5, "column": 62}
    assert captured.err == ""
