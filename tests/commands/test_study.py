"""A study from its file to its tables: everything is run once, stored, and shown, and what is not equal is said to be so."""

from __future__ import annotations

import json
import os

import pytest
from typer.testing import CliRunner

from simspec.cli import app
from simspec.report.study.speed import ranking

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """\
simspec: 1
name: bounce
physics: {timestep: 1 ms, duration: 60 ms}
contact:
  materials:
    rubber: {friction: 0}
bodies:
  floor: {fixed: true, shapes: [{plane: {}, material: rubber}]}
  ball: {pose: {xyz: [0, 0, 0.105]}, mass: 1 kg, shapes: [{sphere: {radius: 0.1}, material: rubber}]}
record: {every: 20 ms, channels: [pose, velocity, contacts, energy]}
expect:
  - no_penetration_deeper_than: {depth: 5 mm}
"""
STUDY = """\
simspec_study: 1
name: bounces
description: A ball in two engines
figures: figures.yaml
sweeps:
  steps:
    spec: bounce.yaml
    sweep:
      engines: [mujoco, pybullet]
      over:
        physics.timestep: [1 ms, 4 ms]
      cases:
        weak: {physics.gravity: [0, 0, -1]}  # no part of what is shown of the scenario itself
      repeat: 2
    small:
      sweep:
        over:
          physics.timestep: [4 ms]
    show: [speed, load, validity, determinism]
  times:
    spec: bounce.yaml
    sweep:
      engines: [mujoco]
      repeat: 2
    show: [over_time]
  mistakes:
    spec: bounce.yaml
    sweep:
      engines: [mujoco, pybullet]
      cases:
        weak: {physics.gravity: [0, 0, -1]}
    unequal:
      weak-in-one: {pybullet: weak}
    small: {}
    show: [unequal, playback]
"""
FIGURES = """\
simspec_figures: 1
source: a paper
figures:
  - {sweep: steps, quantity: real_time_factor, engine: Other, timesteps: [1 ms], values: [12.25], source: table 1}
  - {sweep: steps, quantity: largest_valid_timestep, engine: Other, values: [0.003], unit: s, source: in its text}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    for name, text in (("bounce", SPEC), ("study", STUDY), ("figures", FIGURES)):
        (folder / f"{name}.yaml").write_text(text)
    before = os.getcwd()
    os.chdir(folder)
    yield folder
    os.chdir(before)


def study(*words, code=0):
    result = CliRunner().invoke(app, ["study", *words])
    assert result.exit_code == code, result.output
    return result


def test_a_study_is_run_once_and_shown(folder):
    content = json.loads(study("study.yaml", "--no-verify", "--json").stdout)
    sheets = {sheet["title"]: sheet for sweep in content["sweeps"].values() for sheet in sweep}
    assert len(sheets) == 9

    speed = next(sheet for title, sheet in sheets.items() if "wall time" in title)
    assert [cell["text"] for cell in speed["head"]] == ["timestep", "mujoco", "pybullet", "Other (elsewhere)"]
    assert [row[0]["text"] for row in speed["rows"]] == ["1 ms", "4 ms"]
    assert [row[-1]["text"] for row in speed["rows"]] == ["12.25", "–"]
    assert all("(2 processes)" in row[1]["text"] for row in speed["rows"])

    validity = next(sheet for title, sheet in sheets.items() if "expected" in title)
    assert [row[0]["text"] for row in validity["rows"]] == ["mujoco", "pybullet", "Other (elsewhere)"]
    assert validity["rows"][0][1]["text"].startswith("at least 4 ms")
    assert validity["rows"][2][1]["text"] == "3 ms: in its text"

    same = next(sheet for title, sheet in sheets.items() if "again" in title)
    assert [row[2]["text"] for row in same["rows"]] == ["2 runs, bitwise equal"] * 4

    times = next(sheet for title, sheet in sheets.items() if "over time" in title)
    assert [row[0]["text"] for row in times["rows"]] == ["0 to 0.02 s", "0.02 to 0.04 s", "0.04 to 0.06 s"]
    assert all(float(row[1]["text"].replace(",", "")) > 0.0 for row in times["rows"])
    assert [row[2]["text"] for row in times["rows"]] == ["0", "1", "1"]  # it meets the floor after 32 ms

    unequal = sheets["mistakes: weak-in-one: these models are NOT EQUAL"]
    assert unequal["note"] == "pybullet has weak: physics.gravity: [0, 0, -1]; mujoco: the scenario itself"
    assert "NOT EQUAL" not in next(title for title in sheets if title.startswith("mistakes: equal"))

    records = {sheet["name"]: sheet["records"] for sweep in content["sweeps"].values() for sheet in sweep}
    at = {"timestep": 0.001, "engine": "mujoco", "quantity": "real_time_factor"}
    record = next(row for row in records["speed.real_time_factor"] if at.items() <= row.items())
    assert min(record["values"]) <= record["median"] <= max(record["values"])
    assert len(record["values"]) == 2
    elsewhere = [row for row in records["speed.real_time_factor"] if "elsewhere" in row]
    assert [(row["engine"], row["timestep"], row["value"]) for row in elsewhere] == [("Other", 0.001, 12.25)]
    shares = [row for row in records["validity"] if "share" in row]
    assert shares[0].items() >= {"engine": "mujoco", "timestep": 0.001, "share": 1.0, "runs": 1}.items()
    assert records["validity"][-1].items() >= {"elsewhere": True, "timestep": None, "value": 0.003}.items()
    assert [row["bitwise"] for row in records["determinism"]] == [True] * 4
    assert [row["contacts"] for row in records["over_time"]] == [0.0, 1.0, 1.0]
    weak = {"engine": "pybullet", "case": "weak"}
    assert any(weak.items() <= row.items() for row in records["unequal.models.weak-in-one"])

    page = (folder / "runs" / "bounces" / "study.md").read_text()
    assert "these models are NOT EQUAL" in page
    assert "proof not requested" in page
    again = json.loads(study("study.yaml", "--no-verify", "--json").stdout)
    assert all(", 0 of them now" in line for line in again["said"])
    assert again["sweeps"] == content["sweeps"]  # tables are functions of the store


def test_its_page_has_its_tables(folder):
    study("study.yaml", "--no-verify")
    result = CliRunner().invoke(app, ["report", "runs/bounces"])
    assert result.exit_code == 0, result.output
    page = (folder / "runs" / "bounces" / "report.html").read_text()
    assert "these models are NOT EQUAL" in page
    study_part, _, played = page.partition("one run of each engine at 1 ms</h2>")
    assert study_part.count("<table>") == 10  # nine, and where they came from
    assert "mujoco" in played
    drawn = json.loads(page.partition('id="scenes">')[2].partition("</script>")[0])
    assert [[run["engine"] for run in scene["runs"]] for scene in drawn["scenes"]] == [["mujoco", "pybullet"]]
    assert len(drawn["charts"]) == 1
    assert "Other (elsewhere)" in page
    tables = folder / "runs" / "bounces" / "study.json"
    whole = tables.read_text()
    tables.write_text(whole.replace('"schema": 2', '"schema": 3', 1))
    result = CliRunner().invoke(app, ["report", "runs/bounces"])
    assert result.exit_code == 2
    assert "schema 3, this simspec reads 2" in result.stderr
    tables.write_text(whole)


def test_the_small_study_has_a_separate_folder_and_may_share_the_store(folder):
    content = json.loads(
        study("study.yaml", "--small", "--no-verify", "--store", "runs/bounces/sweep", "--json").stdout
    )
    assert list(content["sweeps"]) == ["steps", "mistakes"]
    assert all(", 0 of them now" in line for line in content["said"])
    assert (folder / "runs" / "bounces-small" / "study.json").is_file()


def test_models_that_are_not_equal_are_each_proven(folder):
    content = json.loads(study("study.yaml", "--small", "--json").stdout)
    assert all("every model proven" in line for line in content["said"])


def test_the_plan_of_the_real_study(folder):
    content = json.loads(study("koerber-2021", "--small", "--dry-run", "--json").stdout)
    runs = {(sweep["sweep"], sweep["engine"]): sweep["runs"] for sweep in content["sweeps"]}
    assert runs["spheres", "mujoco"] == runs["robot-pick", "dart"] == 15  # 5 timesteps, 3 initial states
    assert content["seconds"] is None
    assert not (folder / "runs" / "koerber-2021-small").exists()


def test_a_file_without_a_study_is_refused(folder):
    assert "simspec_study" in study("bounce.yaml", code=2).stderr
    assert "No such file" in study("none.yaml", code=2).stderr


def test_ranking():
    assert ranking({"a": 2.0, "b": 6.0, "c": 1.0}) == "b is 3 × as fast as a, a 2 × as fast as c"
    assert ranking({}) == ""
