"""Costs and displacements in a study: every case in comparison with the scenario, and bodies that fell."""

from __future__ import annotations

import json
import os

import pytest
from typer.testing import CliRunner

from simspec.cli import app
from simspec.report.table import two_digits

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """\
simspec: 1
name: slope
physics: {timestep: 2 ms, duration: 0.4 s}
contact:
  materials:
    wood: {friction: 0.6}
bodies:
  floor:
    fixed: true
    pose: {rpy: [0, 20 deg, 0]}
    shapes: [{box: {size: [4, 4, 1]}, pose: {xyz: [0, 0, -0.5]}, material: wood}]
  box:
    pose: {xyz: [0.0171, 0, 0.04698], rpy: [0, 20 deg, 0]}
    mass: 1 kg
    shapes: [{box: {size: [0.1, 0.1, 0.1]}, material: wood}]
record: {every: 20 ms, channels: [pose, velocity, contacts, energy]}
engines:
  mujoco: {accept: [contact.friction.impact, contact.cone.pyramid-inscribed]}
"""
STUDY = """\
simspec_study: 1
name: slopes
sweeps:
  slope:
    spec: slope.yaml
    sweep:
      engines: [mujoco, dart]
      over:
        contact.materials.wood.friction: [0, 0.6]
      cases:
        coulomb: {engines.mujoco.settings: {friction: coulomb}}
        inscribed: {contact.friction_cone: pyramid-inscribed}
      repeat: 2
    show: [case_cost, displacement]
"""


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    (folder / "slope.yaml").write_text(SPEC)
    (folder / "study.yaml").write_text(STUDY)
    before = os.getcwd()
    os.chdir(folder)
    try:
        made = CliRunner().invoke(app, ["study", "study.yaml", "--no-verify"])
        assert made.exit_code == 0, made.output
    finally:
        os.chdir(before)
    data = json.loads((folder / "runs" / "slopes" / "study.json").read_text())
    return {table["name"]: table for table in data["sweeps"]["slope"]}


def cells(shown):
    return [[cell["text"] for cell in row] for row in shown["rows"]]


def test_each_case_is_compared_with_the_unchanged_scenario(tables):
    rows = cells(tables["case_cost"])
    assert [row[:4] for row in rows if row[0] == "friction 0.6"] == [
        ["friction 0.6", "–", "mujoco", "2 ms"],
        ["friction 0.6", "–", "dart", "2 ms"],
        ["friction 0.6", "coulomb", "mujoco", "2 ms"],
        ["friction 0.6", "inscribed", "mujoco", "2 ms"],
    ]
    assert all(row[4].endswith(" µs") for row in rows)
    assert all((row[5] == "–") == (row[1] == "–") for row in rows)
    assert {row[6] for row in rows} == {"2"}


def test_ratios_are_those_of_the_times(tables):
    records = {(record["settings"], record["engine"]): record for record in tables["case_cost"]["records"]}
    plain, exact = records["friction 0.6", "mujoco"], records["coulomb, friction 0.6", "mujoco"]
    assert exact["ratio"] == pytest.approx(exact["seconds_per_step"] / plain["seconds_per_step"])
    assert plain["ratio"] == 1.0
    row = next(cell for cell in cells(tables["case_cost"]) if cell[:3] == ["friction 0.6", "coulomb", "mujoco"])
    assert row[5] == two_digits(exact["ratio"])


def test_sliding_bodies_are_displaced_and_sticking_bodies_are_not(tables):
    rows = {(row[0], row[1]): row[2] for row in cells(tables["displacement"])}
    # g sin 20° from rest: 50 mm sideways (53 along the slope) after 0.178 s
    assert rows["friction 0", "mujoco"] == rows["friction 0", "dart"] == "left its place at 0.2 s (2 of 2 runs)"
    sideways, down = rows["friction 0.6", "dart"].split(" / ")
    assert float(sideways) < 1.0
    assert float(down) < 1.0


def test_figures_of_displacement_are_data_too(tables):
    records = {(record["settings"], record["engine"]): record for record in tables["displacement"]["records"]}
    slid = records["friction 0", "dart"]
    assert slid["left_at"] == pytest.approx(0.18)
    # ½ g sin 20° t² along the slope
    assert slid["sideways"] == pytest.approx(0.2522, rel=0.02)
    assert slid["down"] == pytest.approx(0.0918, rel=0.02)
    assert records["friction 0.6", "dart"]["left_at"] is None


def test_an_engine_without_the_cone_has_a_reason_and_no_row(tables):
    for name in ("case_cost", "displacement"):
        rows = cells(tables[f"{name}.unsupported"])
        assert [row[0] for row in rows] == ["dart"]
        assert "inscribed" in rows[0][1]
        assert "contact.cone.pyramid-inscribed" in rows[0][2]
        assert not [row for row in cells(tables[name]) if "inscribed" in " ".join(row) and "dart" in row]
