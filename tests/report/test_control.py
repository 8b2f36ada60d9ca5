"""Output about controllers: joints, law, numbers with their units."""

from __future__ import annotations

import io
import json

import pytest
from typer.testing import CliRunner

from simspec.cli import app
from simspec.engines.kit.registry import engines
from simspec.language.load import Spec
from simspec.report.console import Screen
from simspec.report.explain import control_table

SOLID = {"mass": 1, "inertia": {"principal": [1, 1, 1]}}
BODIES = {
    "post": {"fixed": True},
    "rail": {**SOLID, "parent": "post", "joint": {"name": "lift", "type": "slide", "axis": [0, 0, 1]}},
    "arm": {**SOLID, "parent": "post", "joint": {"name": "elbow", "type": "hinge", "axis": [0, 0, 1]}},
    "hand": {**SOLID, "parent": "arm", "joint": {"name": "wrist", "type": "hinge", "axis": [0, 0, 1]}},
}


def row(**controller: object) -> list[str]:
    """The cells of the only controller's row, and the caption."""
    spec = Spec.from_data({"name": "x", "bodies": BODIES, "control": {"robot": controller}})
    found = control_table(spec.resolve())
    screen = Screen(width=200, record=True, file=io.StringIO())
    screen.print(found)
    assert "robot" in screen.export_text()
    return [*found.rows[0], found.note]


@pytest.mark.parametrize(
    ("controller", "law", "numbers"),
    [
        ({"joints": ["elbow"], "kp": 3, "kd": 1}, "pd, explicit", "kp 3 N m/rad; kd 1 N m s/rad"),
        (
            {"joints": ["elbow", "wrist"], "kp": {"elbow": 3, "wrist": 5}, "kd": 1, "effort_limit": 4, "gear": 2},
            "pd, explicit",
            "kp 12 to 20 N m/rad; kd 4 N m s/rad; effort 8 N m",
        ),
        (
            {"joints": ["lift"], "kp": 3, "kd": 1, "gravity_compensation": True, "discretisation": "implicit"},
            "pd, implicit",
            "gravity compensation; kp 3 N/m; kd 1 N s/m",
        ),
        (
            {"joints": ["lift"], "actuator": "velocity", "kd": 1, "effort_limit": 0},
            "pd, explicit",
            "kd 1 N s/m; effort 0 N",
        ),
        (
            {"joints": ["elbow"], "law": "computed-torque", "natural_frequency": 30, "effort_limit": 9},
            "computed-torque, explicit",
            "ω 30 rad/s, ζ 1; effort 9 N m",
        ),
    ],
)
def test_a_controller_is_described_in_a_single_row(controller, law, numbers):
    assert row(**controller)[2:4] == [law, numbers]


def test_units_follow_joint_types_and_a_native_law_is_marked():
    gains = {"lift": 3, "elbow": 4, "wrist": 5}
    found = row(law="native", joints=["*"], kp=gains, kd=gains)
    assert found[:3] == ["robot", "lift, elbow, wrist", "native"]
    assert found[3] == "kp 4 to 5 N m/rad; kd 4 to 5 N m s/rad; kp 3 N/m; kd 3 N s/m"
    assert "differs between engines" in found[4]


def test_explain_tells_controllers_once_and_as_data(tmp_path):
    control = {"robot": {"joints": ["elbow"], "kp": 3, "kd": 1}}
    path = tmp_path / "x.yaml"
    path.write_text(Spec.from_data({"name": "x", "bodies": BODIES, "control": control}).to_yaml(), encoding="utf-8")
    engine = next(iter(engines()))
    command = ["compile", str(path), "--explain", "--engine", engine, "--out", str(tmp_path / "out")]
    text = CliRunner().invoke(app, command).output
    assert text.count("elbow") == 1
    assert "3 N m/rad" in text
    (data,) = json.loads(CliRunner().invoke(app, [*command, "--json"]).output)["compiled"]
    assert data["controllers"][0]["kp"] == [3.0]
    command.remove("--explain")
    assert "controllers" not in json.loads(CliRunner().invoke(app, [*command, "--json"]).output)["compiled"][0]
