"""Trajectories and grasps in the language: every wrong entry is an error at its line, before any engine is started."""

# ruff: noqa: E501 (a case is a line, so that cases can be compared)
from __future__ import annotations

import os

import jsonschema
import numpy as np
import pytest
from pydantic import ValidationError

from simspec.errors import SpecError
from simspec.language.actions import MOST_POINTS, Trajectory
from simspec.language.formatting import format_text
from simspec.language.load import Spec, load
from simspec.language.models import File
from simspec.language.reference import json_schema

SOLID = "mass: 1, inertia: {principal: [0.1, 0.1, 0.1]}"
TOP = """simspec: 1
name: driven
physics: {timestep: 1 ms, duration: 1 s}
"""
ROBOT = f"""models:
  arm:
    bodies:
      post: {{fixed: true}}
      upper: {{parent: post, {SOLID}, joint: {{name: shoulder, type: hinge, axis: [0, 0, 1], position: 0.5, limits: {{position: [-2, 2], velocity: 2}}}}}}
      fore: {{parent: upper, {SOLID}, joint: {{name: elbow, type: hinge, axis: [0, 0, 1], position: 0.5, origin: {{xyz: [0.5, 0, 0]}}}}}}
      finger: {{parent: fore, {SOLID}, joint: {{name: jaw, type: slide, axis: [0, 1, 0], position: 0.04, origin: {{xyz: [0.3, 0, 0]}}, limits: {{position: [0, 0.05]}}}}}}
      flap: {{parent: fore, {SOLID}, joint: {{name: idle, type: hinge, axis: [0, 0, 1]}}}}
      eye: {{parent: fore, {SOLID}, joint: {{name: gaze, type: ball}}}}
"""
GRASPS = """    grasps:
      pinch: {open: {jaw: 4 cm}, closed: {jaw: 1 cm}, forces: [{body: finger, force: [0, -3, 0]}]}
"""
CONTROL = """control:
  robot: {law: computed-torque, joints: [arm/shoulder, arm/elbow, arm/jaw], natural_frequency: 30, discretisation: implicit}
"""
TOOL = "  tool: {body: arm/fore, pose: {xyz: [0.3, 0, 0]}}\n"


def spec(trajectory, grasps=GRASPS, control=CONTROL):
    return TOP + ROBOT + grasps + control + (f"trajectory:\n{trajectory}" if trajectory else "")


def problems(folder, text, **files):
    """Problems of a spec, found when it is read or resolved."""
    path = folder / "driven.yaml"
    path.write_text(text, encoding="utf-8")
    for name, content in files.items():
        (folder / f"{name}.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(SpecError) as caught:
        load(path).resolve()
    return caught.value.problems


def line_of(text, marked):
    """The line of the first text that holds ``marked``."""
    return next(number for number, line in enumerate(text.splitlines(), 1) if marked in line)


def point(at, more="", positions="{arm/shoulder: 0.5}"):
    return f"    - {{at: {at}, positions: {positions}{more}}}\n"


TWO = "  points:\n" + point(0)
MOVES = TOOL + "  program:\n"
PLACE = "{xyz: [0.5, 0.3, 0], free_orientation: true}"

BAD = {
    # name: (trajectory, a text on the line of the problem, its path, message, found, allowed or hint)
    "nothing": ("  until: 1 s\n", "trajectory:", "trajectory", "expected one of points, file, program", None, None),
    "two ways": (TWO + "  program: [{wait: 1}]\n", "program:", "trajectory.program", "exclude each other", None, None),
    "no points": ("  points: []\n", "points:", "trajectory.points", "no points", "[]", "at least one"),
    "unknown key": (TWO + "  interpolaton: cubic\n", "interpolaton", "trajectory.interpolaton", "unknown key", None, "interpolation"),
    "unknown interpolation": (TWO + "  interpolation: spline\n", "spline", "trajectory.interpolation", "not an allowed word", "spline", "quintic"),
    "tool without program": (TWO + TOOL, "tool:", "trajectory.tool", "tool requires a program", None, None),
    "time goes back": (TWO + point("2 s") + point("1.5 s"), "1.5 s", "trajectory.points.2.at", "times must increase", "1.5 s after 2 s", None),
    "the same time": (TWO + point(1) + point("1000 ms"), "1000 ms", "trajectory.points.2.at", "times must increase", None, None),
    "too near": (TWO + point("1e-12"), "1e-12", "trajectory.points.1.positions.arm/shoulder", "too close", None, None),
    "negative time": ("  points:\n" + point("-1 s"), "-1 s", "trajectory.points.0.at", "at least 0", None, None),
    "time with another unit": ("  points:\n" + point("3 m"), "3 m", "trajectory.points.0.at", "", None, "s"),
    "until no whole step": (TWO + "  until: 0.0105 s\n", "until", "trajectory.until", "whole number of timesteps", None, "0.01"),
    "unknown joint": ("  points:\n" + point(0, positions="{arm/elbo: 1}"), "elbo:", "trajectory.points.0.positions.arm/elbo", "there is no joint 'arm/elbo'", "arm/elbo", "arm/elbow"),
    "joint without controller": ("  points:\n" + point(0, positions="{arm/idle: 1}"), "idle: 1", "trajectory.points.0.positions.arm/idle", "no controller drives it", None, "control"),
    "ball joint": ("  points:\n" + point(0, positions="{arm/gaze: 1}"), "gaze: 1", "trajectory.points.0.positions.arm/gaze", "no controller drives it", None, None),
    "joint twice": ("  points:\n" + point(0, positions="{arm/elbow: 1, arm/elbow: 2}"), "elbow: 2", "trajectory.points.0.positions.arm/elbow", "duplicated", None, None),
    "no joint": ("  points:\n" + point(0, positions="{}"), "positions: {}", "trajectory.points.0.positions", "numbers by joint", "{}", None),
    "text for a number": ("  points:\n" + point(0, positions="{arm/elbow: far}"), "far", "trajectory.points.0.positions.arm/elbow", "", "far", None),
    "length for an angle": ("  points:\n" + point(0, positions="{arm/elbow: 3 cm}"), "3 cm", "trajectory.points.0.positions.arm/elbow", "", "3 cm", None),
    "angle for a length": ("  points:\n" + point(0, positions="{arm/jaw: 3 deg}"), "3 deg", "trajectory.points.0.positions.arm/jaw", "", "3 deg", None),
    "joints that come and go": (TWO + point(1, positions="{arm/elbow: 1}"), "arm/elbow: 1", "trajectory.points.1.positions", "not the joints of the first point", "arm/elbow, arm/shoulder", None),
    "velocities now and then": (TWO + point(1, ", velocities: {arm/shoulder: 0}"), "velocities", "trajectory.points.1", "the first one has none", None, "or in none"),
    "velocities with linear": ("  points:\n" + point(0, ", velocities: {arm/shoulder: 0}") + "  interpolation: linear\n", "velocities", "trajectory.points.0.velocities", "are not allowed with interpolation linear", None, None),
    "quintic with half of it": ("  points:\n" + point(0, ", velocities: {arm/shoulder: 0}") + "  interpolation: quintic\n", "velocities", "trajectory.points.0", "velocities and accelerations", None, None),
    "beyond a limit": (TWO + point(9, positions="{arm/shoulder: 2.1}"), "2.1", "trajectory.points.1.positions.arm/shoulder", "exceeds its limits", "2.1 rad", "-2 to 2 rad"),
    "beyond a limit in between": ("  points:\n" + point(0, ", velocities: {arm/shoulder: 1}", "{arm/shoulder: 1.9}") + point(1, ", velocities: {arm/shoulder: -1}", "{arm/shoulder: 1.9}"), "at: 1,", "trajectory.points.1.positions.arm/shoulder", "exceeds its limits at 0.5 s", "2.15 rad", "-2 to 2 rad"),
    "too fast": ("  interpolation: linear\n" + TWO + point("1") + point("1.1 s", positions="{arm/shoulder: 1}"), "1.1 s", "trajectory.points.2.positions.arm/shoulder", "exceeds its velocity limit", "5 rad/s, 2.5 times its limit", "up to 2 rad/s"),
    "no program": ("  program: []\n", "program:", "trajectory.program", "no program", "[]", None),
    "step of nothing": ("  program:\n    - {in: 2 s}\n", "in: 2", "trajectory.program.0", "expected one of move, grip, wait", None, None),
    "two things at once": (MOVES + "    - {grip: 1, wait: 1, in: 1}\n", "grip", "trajectory.program.0", "exclude each other", None, None),
    "unknown step": (MOVES + "    - {mvoe: {xyz: [0, 0, 0]}, in: 1}\n", "mvoe", "trajectory.program.0.mvoe", "unknown key", None, "'move'"),
    "move without duration": (MOVES + f"    - {{move: {PLACE}}}\n", "xyz: [0.5", "trajectory.program.0", "needs a duration", None, "in: 2 s"),
    "move in no time": (MOVES + f"    - {{move: {PLACE}, in: 0 s}}\n", "0 s", "trajectory.program.0.in", "above 0", None, None),
    "move to nowhere": (MOVES + "    - {move: {}, in: 1 s}\n", "move: {}", "trajectory.program.0.move", "a move without target", None, "xyz, rpy or quat"),
    "two orientations": (MOVES + "    - {move: {rpy: [0, 0, 0], quat: [1, 0, 0, 0]}, in: 1}\n", "rpy", "trajectory.program.0.move", "exclude each other", None, None),
    "orientation that is free": (MOVES + "    - {move: {rpy: [0, 0, 0], free_orientation: true}, in: 1}\n", "rpy", "trajectory.program.0.move.rpy", "exclude each other", None, None),
    "squeeze without grip": (MOVES + "    - {wait: 1, squeeze: 1}\n", "squeeze", "trajectory.program.0.squeeze", "squeeze requires grip", None, None),
    "grip above 1": (MOVES + "    - {wait: 1}\n    - {grip: 1.2, in: 1}\n", "1.2", "trajectory.program.1.grip", "at most 1", "1.2", "≤ 1"),
    "grip below 0": (MOVES + "    - {grip: -0.1, in: 1}\n", "-0.1", "trajectory.program.0.grip", "at least 0", None, None),
    "squeeze above 1": (MOVES + "    - {grip: 1, squeeze: 150 %, in: 1}\n", "150 %", "trajectory.program.0.squeeze", "at most 1", None, None),
    "move without tool": (f"  program:\n    - {{move: {PLACE}, in: 1}}\n", "program:", "trajectory.program", "requires a tool frame", None, "tool"),
    "unknown tool": (f"  tool: {{body: arm/foer}}\n  program:\n    - {{move: {PLACE}, in: 1}}\n", "foer", "trajectory.tool.body", "no body 'arm/foer'", "arm/foer", "arm/fore"),
    "tool on a base": (f"  tool: {{body: arm/post}}\n  program:\n    - {{move: {PLACE}, in: 1}}\n", "body: arm/post", "trajectory.tool.body", "no joint moves this body", None, None),
    "tool on a loose joint": (f"  tool: {{body: arm/flap}}\n  program:\n    - {{move: {PLACE}, in: 1}}\n", "body: arm/flap", "trajectory.tool.body", "a hinge joint that no controller drives", None, "control"),
    "tool on a ball": (f"  tool: {{body: arm/eye}}\n  program:\n    - {{move: {PLACE}, in: 1}}\n", "body: arm/eye", "trajectory.tool.body", "a ball joint that no controller drives", None, None),
    "arm of another": (TOOL + f"  arm: [arm/sholder]\n  program:\n    - {{move: {PLACE}, in: 1}}\n", "sholder", "trajectory.arm.0", "not a joint between the world and the tool", None, "arm/shoulder"),
    "hand as the arm": (f"  tool: {{body: arm/finger}}\n  program:\n    - {{move: {PLACE}, in: 1}}\n    - {{grip: 1, in: 1}}\n", "program:", "trajectory.program", "arm/jaw would belong to both the arm and the grasp", None, "arm:"),
    "unknown grasp": ("  grasp: arm/punch\n  program:\n    - {grip: 1, in: 1}\n", "punch", "trajectory.grasp", "there is no grasp 'arm/punch'", "arm/punch", "arm/pinch"),
    "out of reach": (MOVES + f"    - {{move: {PLACE}, in: 1}}\n    - {{move: {{xyz: [0.9, 0, 0], free_orientation: true}}, in: 1, straight: false}}\n", "0.9", "trajectory.program.1.move", "the tool stays 100 mm away", "[0.9, 0, 0]", "nearer"),
    "out of reach on the way": (MOVES + f"    - {{move: {PLACE}, in: 1}}\n    - {{move: {{xyz: [0.1, 0.7, 0], free_orientation: true}}, in: 3}}\n    - {{move: {{xyz: [0.9, 0.7, 0], free_orientation: true}}, in: 3}}\n", "0.9, 0.7", "trajectory.program.2.move", "out of reach: the tool stays 340 mm away", "[0.9, 0.7, 0]", "nearer"),
    "an orientation that it cannot have": (MOVES + "    - {move: {rpy: [0.3, 0, 0]}, in: 1, straight: false}\n", "rpy", "trajectory.program.0.move", " rad away", None, None),
    "through a singular pose": (MOVES + "    - {move: {xyz: [0.2, 0.01, 0], free_orientation: true}, in: 3}\n    - {move: {xyz: [-0.2, -0.01, 0], free_orientation: true}, in: 3}\n", "-0.2", "trajectory.program.1.move", "", None, None),
    "move too fast": (MOVES + f"    - {{move: {PLACE}, in: 1}}\n    - {{move: {{xyz: [0.3, 0.5, 0], free_orientation: true}}, in: 0.2}}\n", "0.3, 0.5", "trajectory.program.1", "exceeds its velocity limit", "times its limit", "2 rad/s"),
    "too many points": ("  interval: 1 ms\n  program:\n    - {wait: 1}\n    - {grip: 1, in: 200 s}\n", "in: 200", "trajectory.program.1", "too many points", "200", "interval"),
    "too many places": (TOOL + "  interval: 1 ms\n  program:\n    - {move: {xyz: [9, 0, 0]}, in: 5 s}\n    - {move: {xyz: [9, 0, 0], free_orientation: true}, in: 6 s}\n", "in: 6", "trajectory.program.1", "too many solutions of", "11000 points", "straight: false"),
    "too many far places": (MOVES + "    - {move: {xyz: [9, 0, 0]}, straight: false, in: 1}\n" * 2000 + "    - {move: {xyz: [9, 0, 1]}, straight: false, in: 1}\n", "0, 1]", "trajectory.program.2000", "too many solutions of", "10005 points", None),
    "no such file": ("  file: reach.csv\n", "reach.csv", "trajectory.file", "no such file", "reach.csv", None),
    "file outside": ("  file: ../reach.csv\n", "reach.csv", "trajectory.file", "leaves the project folder", None, "--allow-outside"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_trajectory_is_an_error_at_its_line(name, tmp_path):
    trajectory, marked, path, message, found, more = BAD[name]
    text = spec(trajectory)
    (tmp_path / "pyproject.toml").touch()
    problem = problems(tmp_path, text)[0]
    assert message in problem.message
    assert problem.path.startswith(path)
    assert problem.location is not None
    assert problem.location.line == (
        text.splitlines().index("trajectory:") + 1
        if marked == "trajectory:"
        else line_of(text.split("trajectory:\n")[1], marked) + text.splitlines().index("trajectory:") + 1
    )
    assert found is None or found in (problem.found or "")
    assert more is None or more in f"{problem.allowed} {problem.hint}"


def test_points_times_joints_are_bounded():
    """More than a file can hold: of Python's data."""
    point = {f"j{index}": 0.0 for index in range(1001)}
    with pytest.raises(ValidationError, match="too many numbers"):
        Trajectory.model_validate({"points": [{"at": index, "positions": point} for index in range(1000)]})


def test_a_trajectory_wants_a_controller(tmp_path):
    (entry,) = problems(tmp_path, spec(TWO, control=""))
    assert "without a controller that follows it" in entry.message
    assert entry.path == "trajectory"


def test_a_grip_requires_a_single_grasp(tmp_path):
    grip = "  program:\n    - {grip: 1, in: 1}\n"
    (none,) = problems(tmp_path, spec(grip, grasps=""))
    assert none.message == "grip requires a grasp"
    two = GRASPS + GRASPS.splitlines()[1].replace("pinch", "hold") + "\n"
    (many,) = problems(tmp_path, spec(grip, grasps=two))
    assert many.message == "ambiguous grasp"
    assert many.allowed == "arm/pinch, arm/hold"


def test_a_grasp_moves_driven_joints_alone(tmp_path):
    control = CONTROL.replace(", arm/jaw", "")
    (entry,) = problems(tmp_path, spec("  program:\n    - {grip: 1, in: 1}\n", control=control))
    assert "the grasp arm/pinch moves arm/jaw, which no controller drives" in entry.message


BAD_GRASPS = {
    # name: (grasp, path below the grasp, message, found, allowed or hint)
    "unknown joint": ("{open: {jw: 0}, closed: {jw: 0}}", "open.jw", "no joint of the model", "jw", "'jaw'"),
    "ball joint": ("{open: {gaze: 0}, closed: {gaze: 0}}", "open.gaze", "not a hinge or slide", "gaze", None),
    "fixed body's joint": ("{open: {post_joint: 0}, closed: {post_joint: 0}}", "open.post_joint", "not a hinge or slide", None, None),
    "joint of one posture": ("{open: {jaw: 0, elbow: 0}, closed: {jaw: 0}}", "closed", "elbow is missing here", None, "the same joints"),
    "wrong unit": ("{open: {jaw: 1 deg}, closed: {jaw: 0}}", "open.jaw", "", "1 deg", None),
    "beyond a limit": ("{open: {jaw: 6 cm}, closed: {jaw: 0}}", "open.jaw", "outside the limits", "0.06", "0 to 0.05"),
    "closed beyond a limit": ("{open: {jaw: 0}, closed: {jaw: -1 mm}}", "closed.jaw", "outside the limits", "-0.001", None),
    "no open": ("{closed: {jaw: 0}}", "", "open is missing", None, None),
    "no joints": ("{open: {}, closed: {}}", "open", "numbers by joint", "{}", None),
    "unknown body": ("{open: {jaw: 0}, closed: {jaw: 0}, forces: [{body: fingr, force: [1, 0, 0]}]}", "forces.0.body", "no body 'fingr'", "fingr", "'finger'"),
    "body that it does not move": ("{open: {jaw: 0}, closed: {jaw: 0}, forces: [{body: fore, force: [1, 0, 0]}]}", "forces.0.body", "no joint of the grasp moves fore", None, None),
    "force without a body": ("{open: {jaw: 0}, closed: {jaw: 0}, forces: [{force: [1, 0, 0]}]}", "forces.0", "body is missing", None, None),
    "force in another unit": ("{open: {jaw: 0}, closed: {jaw: 0}, forces: [{body: finger, force: [1 m, 0, 0]}]}", "forces.0.force.0", "", "1 m", "N"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_GRASPS)
@pytest.mark.parametrize("used", [True, False])
def test_a_wrong_grasp_is_an_error_at_its_line_whether_used_or_not(name, used, tmp_path):
    grasp, path, message, found, more = BAD_GRASPS[name]
    text = spec("  program:\n    - {grip: 1, in: 1}\n" if used else "", grasps=f"    grasps:\n      pinch: {grasp}\n")
    problem = problems(tmp_path, text)[0]
    assert message in problem.message
    assert problem.path.startswith(f"models.arm.grasps.pinch.{path}".rstrip("."))
    assert problem.location.line == line_of(text, "pinch:")
    assert found is None or found in (problem.found or "")
    assert more is None or more in f"{problem.allowed} {problem.hint}"


def test_everything_wrong_is_said_at_once(tmp_path):
    trajectory = "  points:\n" + point(0, positions="{arm/elbw: 0, arm/idle: 1}") + "  interpolation: cubc\n"
    found = problems(tmp_path, spec(trajectory))
    assert [entry.path for entry in found] == ["trajectory.interpolation"]  # names are looked up in what can be read
    found = problems(tmp_path, spec(trajectory.replace("cubc", "cubic")))
    assert [entry.path.rpartition("/")[2] for entry in found] == ["elbw", "idle"]
    far = "{arm/shoulder: 3, arm/jaw: 1}"
    found = problems(tmp_path, spec("  points:\n" + point(0, positions=far)))
    assert [entry.path.rpartition("/")[2] for entry in found] == ["shoulder", "jaw"]


# --- tables ---

TABLES = {
    # name: (content, message, found, allowed or hint)
    "empty": ("", "begins with its header", "an empty file", "time,"),
    "no header": ("0,1\n1,2\n", "begins with its header", "0,1", None),
    "header alone": ("time,arm/elbow\n", "without rows", None, None),
    "time alone": ("time\n0\n", "no joint has a position", "time alone", None),
    "unknown joint": ("time,arm/elbw\n0,0\n", "there is no joint 'arm/elbw'", "arm/elbw", "arm/elbow"),
    "joint without controller": ("time,arm/idle\n0,0\n", "no controller drives it", "arm/idle", None),
    "unknown quantity": ("time,arm/elbow,arm/elbow:speed\n0,0,0\n", "unknown column", "arm/elbow:speed", "JOINT:velocity"),
    "column twice": ("time,arm/elbow,arm/elbow\n0,0,0\n", "duplicate column", "arm/elbow", None),
    "missing column": ("time,arm/elbow,arm/jaw,arm/jaw:velocity\n0,0,0,0\n", "missing columns", "arm/elbow", "JOINT:velocity"),
    "velocity of no joint": ("time,arm/elbow,arm/jaw:effort\n0,0,0\n", "missing columns", "arm/jaw", None),
    "text": ("time,arm/elbow\n0,0\n1,far\n", "not a usable number", "'far' in line 3, column arm/elbow", None),
    "NaN": ("time,arm/elbow\n0,nan\n", "not a usable number", "'nan' in line 2", None),
    "infinite": ("time,arm/elbow\n0,inf\n", "not a usable number", "'inf'", None),
    "too large": ("time,arm/elbow\n0,1e31\n", "not a usable number", "'1e31'", None),
    "unit": ("time,arm/elbow\n0,30 deg\n", "not a usable number", "'30 deg'", "without units"),
    "gap": ("time,arm/elbow\n0,\n", "not a usable number", "''", None),
    "not this script": ("time,arm/elbow\n0,1_0\n", "not a usable number", "'1_0'", None),
    "ragged": ("time,arm/elbow\n0,0\n1\n", "a value for every column", "1 values in line 3", "2"),
    "too wide": ("time,arm/elbow\n0,0,0\n", "a value for every column", "3 values in line 2", "2"),
    "time goes back": ("time,arm/elbow\n0,0\n2,0\n1,0\n", "times must increase", "1 s after 2 s in row 3", None),
    "negative time": ("time,arm/elbow\n-1,0\n0,0\n", "times begin at 0 or later", "-1 s", None),
    "too many rows": ("time,arm/elbow\n" + "".join(f"{row},0\n" for row in range(MOST_POINTS + 1)), "too long a table", None, "100000 rows"),
    "beyond a limit": ("time,arm/jaw\n0,0\n1,0.06\n", "arm/jaw exceeds its limits at 1 s, in row 2 of the table", "0.06 m", "0 to 0.05 m"),
    "too fast": ("time,arm/shoulder\n0,0\n0.1,1\n", "exceeds its velocity limit", "rad/s", "2 rad/s"),
    "not UTF-8": (b"time,arm/elbow\xff\n0,0\n", "not UTF-8", None, None),
    "too large a file": ("time,arm/elbow\n" + "0" * 10_000_001, "too large a table", "10.0 MB", "10 MB"),
    "accelerations with cubic": ("time,arm/elbow,arm/elbow:acceleration\n0,0,0\n1,0,0\n", "accelerations are not allowed with interpolation cubic", None, None),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_a_wrong_table_is_an_error_at_the_line_that_names_it(name, tmp_path):
    content, message, found, more = TABLES[name]
    text = spec("  file: reach.csv\n")
    problem = problems(tmp_path, text, reach=content)[0]
    assert message in problem.message
    assert problem.path == "trajectory.file"
    assert problem.location.line == line_of(text, "reach.csv")
    assert found is None or found in (problem.found or "")
    assert more is None or more in f"{problem.allowed} {problem.hint}"


RIGHT = {"time": np.arange(3.0), "joints": np.array(["arm/elbow"]), "positions": np.zeros((3, 1))}
ARRAYS = {
    # name: (arrays that differ from the right ones; None: left out, message, found)
    "objects": ({"joints": np.array(["arm/elbow"], dtype=object)}, "holds Python objects", None),
    "zero duration": ({"time": None}, "the array 'time' is missing", None),
    "no joints": ({"joints": None}, "the array 'joints' is missing", None),
    "no positions": ({"positions": None}, "the array 'positions' is missing", None),
    "another array": ({"forces": np.zeros(3)}, "unknown arrays", "forces"),
    "bytes for names": ({"joints": np.array([b"arm/elbow"])}, "joints must be a list of names", "S9"),
    "no names": ({"joints": np.array([], dtype="U3")}, "joints must be a list of names", "(0,)"),
    "names in a table": ({"joints": np.array([["arm/elbow"]])}, "joints must be a list of names", "(1, 1)"),
    "joint twice": ({"joints": np.array(["arm/elbow"] * 2), "positions": np.zeros((3, 2))}, "duplicate joint", "arm/elbow"),
    "too few rows": ({"positions": np.zeros((2, 1))}, "positions has the wrong shape", "(2, 1)"),
    "too few columns": ({"joints": np.array(["arm/elbow", "arm/jaw"])}, "positions has the wrong shape", "(3, 1)"),
    "one time": ({"time": np.array(1.0)}, "time has the wrong shape", "()"),
    "no times": ({"time": np.zeros(0), "positions": np.zeros((0, 1))}, "time has the wrong shape", "(0,)"),
    "complex": ({"positions": np.zeros((3, 1), dtype=complex)}, "positions has the wrong shape or kind", "complex128"),
    "NaN": ({"positions": np.array([[0.0], [np.nan], [0.0]])}, "not a usable number", "nan in positions, row 2"),
    "time goes back": ({"time": np.array([0.0, 2.0, 1.0])}, "times must increase", "row 3"),
    "velocities of another shape": ({"velocities": np.zeros((3, 2))}, "velocities has the wrong shape", "(3, 2)"),
    "many arrays": ({f"a{number}": np.zeros(1) for number in range(20)}, "23 arrays, more than 20", None),
    "much": ({"positions": np.zeros((8_000_001, 1))}, "more than 64 MB", None),
    "a name of 10 MB": ({"joints": np.array(["x" * 2_500_000])}, "joints.npy: names of more than 200 characters", None),
    "an array's name of 60 kB": ({"x" * 60_000: np.zeros(1)}, "names of more than 200 characters", None),
}  # fmt: skip


@pytest.mark.parametrize("name", ARRAYS)
def test_a_wrong_npz_is_an_error_at_the_line_that_names_it(name, tmp_path):
    changed, message, found = ARRAYS[name]
    arrays = {key: value for key, value in {**RIGHT, **changed}.items() if value is not None}
    np.savez_compressed(tmp_path / "reach.npz", **arrays)
    problem = problems(tmp_path, spec("  file: reach.npz\n"))[0]
    assert message in problem.message
    assert problem.path == "trajectory.file"
    assert found is None or found in (problem.found or "")


@pytest.mark.parametrize("name", ["reach.txt", "reach", "reach.CSV"])
def test_a_file_that_is_not_a_table_is_not_read(name, tmp_path):
    (tmp_path / name).write_text("time,arm/elbow\n0,0\n")
    (entry,) = problems(tmp_path, spec(f"  file: {name}\n"))
    assert entry.message == "not a readable table"


@pytest.mark.parametrize("name", ["reach.csv", "reach.npz"])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_a_table_that_is_no_regular_file_is_not_read(name, kind, tmp_path):
    path = tmp_path / name
    {"pipe": os.mkfifo, "device": lambda at: at.symlink_to("/dev/zero"), "folder": os.mkdir}[kind](path)
    (entry,) = problems(tmp_path, spec(f"  file: {name}\n"))
    assert entry.path == "trajectory.file"


def test_an_npz_that_is_none(tmp_path):
    (tmp_path / "reach.npz").write_text("time,arm/elbow\n0,0\n")
    (entry,) = problems(tmp_path, spec("  file: reach.npz\n"))
    assert "cannot be read" in entry.message


# --- the language itself ---

EVERYTHING = "  interpolation: quintic\n  until: 0.5 s\n" + TOOL + f"""  arm: [arm/shoulder, arm/el*]
  interval: 0.1 s
  grasp: arm/pinch
  program:
    - {{move: {PLACE}, in: 1 s, straight: false}}
    - {{grip: 60 %, in: 1 s, squeeze: 0.5}}
    - {{wait: 300 ms}}
"""  # fmt: skip


def test_every_field_is_read(tmp_path):
    path = tmp_path / "driven.yaml"
    path.write_text(spec(EVERYTHING), encoding="utf-8")
    read = load(path).data.trajectory
    assert (read.interpolation, read.until, read.interval, read.grasp) == ("quintic", 0.5, 0.1, "arm/pinch")
    assert (read.tool.body, read.tool.pose.xyz, read.arm) == ("arm/fore", (0.3, 0.0, 0.0), ("arm/shoulder", "arm/el*"))
    move, grip, wait = read.program
    assert (move.move.xyz, move.move.free_orientation, move.straight) == ((0.5, 0.3, 0.0), True, False)
    assert (grip.grip, grip.squeeze, getattr(grip, "in"), wait.wait) == (0.6, 0.5, 1.0, 0.3)


def test_fmt_keeps_what_it_says():
    text = spec(EVERYTHING)
    tidy = format_text(text, "driven.yaml")
    assert format_text(tidy, "driven.yaml") == tidy
    assert "    - {grip: 60 %, in: 1 s, squeeze: 0.5}\n" in tidy
    assert (
        tidy.index("trajectory:") < tidy.index("  interpolation:") < tidy.index("  until:") < tidy.index("  program:")
    )


def test_the_schema_says_the_same():
    from simspec.language.document import parse

    schema = json_schema()
    validator = jsonschema.validators.validator_for(schema)(schema)
    assert validator.is_valid(parse(spec(EVERYTHING), "x").data)
    for name in (
        "nothing",
        "unknown key",
        "unknown interpolation",
        "grip above 1",
        "unknown step",
        "squeeze above 1",
        "no joint",
    ):
        if name != "squeeze above 1":  # a share with a unit is a text to the schema
            assert not validator.is_valid(parse(spec(BAD[name][0]), "x").data), name


def test_a_trajectory_made_in_python_reads_back():
    data = {"points": [{"at": 0, "positions": {"arm/elbow": "30 deg"}}], "until": "0.2 s"}
    from simspec.language.document import parse

    read = Spec.from_data({**parse(spec(""), "x").data, "trajectory": data})
    written = read.data.model_dump(exclude_unset=True)
    assert File.model_validate(written) == read.data
    assert isinstance(read.data.trajectory, Trajectory)


ARM = """\
simspec: 1
name: arm
physics: {{timestep: 1 ms, duration: 2 s}}
bodies:
  base: {{fixed: true}}
  link: {{parent: base, mass: 1, inertia: {{principal: [1, 1, 1]}}, joint: {{name: elbow, type: {kind}, axis: [0, 0, 1]{more}}}}}
control: {{drive: {{joints: [elbow], kp: 10, kd: 1}}}}
trajectory: {{{trajectory}}}
"""


def dwelling(tmp_path, trajectory, kind="hinge", more=""):
    path = tmp_path / "arm.yaml"
    path.write_text(ARM.format(kind=kind, trajectory=trajectory, more=more))
    spec = load(path)
    return spec, [warning for warning in spec.warnings() if "equal points" in warning.message]


def points(*places, more=""):
    rows = (f"{{at: {0.5 * k}, positions: {{elbow: {place}}}{more}}}" for k, place in enumerate(places))
    return f"points: [{', '.join(rows)}]"


def test_an_overshoot_between_equal_points_is_warned_of_with_its_size(tmp_path):
    spec, (warning,) = dwelling(tmp_path, points(0, 1, 1, 0))
    assert warning.path == "trajectory.points.2.positions.elbow"
    assert "elbow leaves two equal points by 0.25 rad at 0.75 s" in warning.message
    assert "interpolation: linear" in warning.hint
    from simspec.control.reference import positions

    place = positions(spec.resolve().trajectory).at(np.array([0.75]))[0][0, 0]
    assert abs(place - 1.0) == pytest.approx(0.25, rel=1e-3)
    assert "by 0.25 m" in dwelling(tmp_path, points(0, 1, 1, 0), kind="slide")[1][0].message


@pytest.mark.parametrize(
    "trajectory",
    [
        points(0, 1, 1, 0) + ", interpolation: linear",
        points(0, 1, 1, 0) + ", interpolation: hold",
        points(0, 1, 1, 0, more=", velocities: {elbow: 0}"),
        points(0, 1, 2, 3),
        points(1, 1, 1, 1),
        points(0, 0),
    ],
)
def test_joints_with_equal_points_or_none_give_no_warning(tmp_path, trajectory):
    assert dwelling(tmp_path, trajectory)[1] == []


def test_a_quintic_and_a_table_are_looked_at_too(tmp_path):
    assert dwelling(tmp_path, points(0, 1, 1, 0) + ", interpolation: quintic")[1]
    (tmp_path / "way.csv").write_text("time,elbow\n0,0\n0.5,1\n1,1\n1.5,0\n")
    ((warning,),) = [dwelling(tmp_path, "file: way.csv")[1]]
    assert warning.path == "trajectory.file"


def test_a_spline_that_leaves_the_limits_between_points_within_them_names_linear(tmp_path):
    with pytest.raises(SpecError) as error:
        dwelling(tmp_path, points(0, 1, 1, 0), more=", limits: {position: [-0.1, 1.05]}")[0].resolve()
    assert "interpolation: linear does not overshoot" in error.value.problems[0].hint
    with pytest.raises(SpecError) as error:
        dwelling(tmp_path, points(0, 2, 1, 0), more=", limits: {position: [-0.1, 1.05]}")[0].resolve()
    assert error.value.problems[0].hint is None
