"""``simspec compile --format``: places of plain files, and a report of losses by file and line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from simspec import cli

SPEC = """simspec: 1
name: swing
physics: {gravity: [0, 0, -9.81], timestep: 1 ms, duration: 1 s}
bodies:
  bob:
    mass: 1 kg
    inertia: {principal: [0.1, 0.1, 0.1]}
    joint:
      type: hinge
      axis: [0, 1, 0]
      spring: {stiffness: 3}
    shapes:
      - {sphere: {radius: 0.1}, collision: false}
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.yaml").write_text(SPEC)
    return tmp_path


def run(*words):
    return CliRunner().invoke(cli.app, ["compile", *words])


def test_files_and_losses_are_written_to_the_folder_of_the_format(here):
    done = run("swing.yaml", "--format", "urdf")
    assert done.exit_code == 0, done.output
    folder = Path("plain/swing/urdf")
    assert {path.name for path in folder.iterdir()} == {
        *("bob.urdf", "placement.json", "losses.json", "simspec-folder.json")
    }
    assert "joint.spring" in done.output
    assert "left out" in done.output
    assert "swing.yaml:11" in done.output
    content = json.loads((folder / "losses.json").read_text())
    (spring,) = [loss for loss in content["losses"] if loss["feature"] == "joint.spring"]
    assert spring["places"] == [{"path": "bodies.bob.joint.spring", "file": "swing.yaml", "line": 11}]
    assert spring["fate"] == "left out"
    assert {loss["feature"] for loss in content["losses"]} >= {"physics.gravity", "physics.timestep"}
    assert run("swing.yaml", "--format", "urdf").output.startswith(f"{folder}: already current")
    assert not Path("generated").exists()


def test_losses_name_the_same_places_wherever_the_command_is_called(here, monkeypatch):
    assert run("swing.yaml", "--format", "urdf").exit_code == 0
    first = (here / "plain/swing/urdf/losses.json").read_text()
    (here / "below").mkdir()
    monkeypatch.chdir(here / "below")
    assert run(str(here / "swing.yaml"), "--format", "urdf", "--out", "other").exit_code == 0
    assert (here / "below/other/losses.json").read_text() == first


def test_json_has_what_the_file_has(here):
    done = run("swing.yaml", "--format", "urdf", "--json")
    (data,) = json.loads(done.stdout)["plain"]
    written = json.loads(Path("plain/swing/urdf/losses.json").read_text())
    assert {key: data[key] for key in written} == written
    assert (data["changed"], "bob.urdf" in data["files"]) == (True, True)


def test_strict_refuses_what_is_lost_of_bodies_and_writes_nothing(here):
    done = run("swing.yaml", "--format", "urdf", "--strict")
    assert done.exit_code == 2
    assert "swing.yaml:11" in done.output
    assert "does not carry joint.spring" in done.output
    assert not Path("plain").exists()
    Path("swing.yaml").write_text(SPEC.replace("      spring: {stiffness: 3}\n", ""))
    assert run("swing.yaml", "--format", "urdf", "--strict").exit_code == 0, "gravity is of the scene"


def test_check_tells_stale_missing_and_left_over_files(here):
    assert run("swing.yaml", "--format", "urdf", "--check").exit_code == 1
    assert run("swing.yaml", "--format", "urdf").exit_code == 0
    assert run("swing.yaml", "--format", "urdf", "--check").exit_code == 0
    Path("swing.yaml").write_text(SPEC.replace("bob:", "bob2:"))
    done = run("swing.yaml", "--format", "urdf", "--check", "--json")
    assert done.exit_code == 1
    stale = json.loads(done.stdout)["stale"]
    assert "missing: plain/swing/urdf/bob2.urdf" in stale
    assert "not of this spec: plain/swing/urdf/bob.urdf" in stale
    assert run("swing.yaml", "--format", "urdf").exit_code == 0
    assert not Path("plain/swing/urdf/bob.urdf").exists()


def test_files_of_others_stay_and_are_in_nobodys_way(here):
    folder = Path("mine")
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    done = run("swing.yaml", "--format", "urdf", "--out", "mine")
    assert done.exit_code == 2
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]
    assert run("swing.yaml", "--engine", "mujoco", "--out", "other").exit_code == 0
    assert "of kind 'compiled', not 'plain'" in run("swing.yaml", "--format", "urdf", "--out", "other").output


def test_each_of_several_specs_gets_a_folder(here):
    (here / "second.yaml").write_text(SPEC.replace("name: swing", "name: second"))
    assert run("swing.yaml", "second.yaml", "--format", "urdf", "--out", "both").exit_code == 0
    assert Path("both/swing/bob.urdf").is_file()
    assert Path("both/second/bob.urdf").is_file()


def test_the_world_itself_loses_nothing(here):
    done = run("swing.yaml", "--format", "world", "--strict")
    assert done.exit_code == 0, done.output
    assert json.loads(Path("plain/swing/world/losses.json").read_text())["losses"] == []
    assert json.loads(Path("plain/swing/world/world.json").read_text())["name"] == "swing"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--format", "fbx"], "no format is called 'fbx'"),
        (["--format", "urdf", "--engine", "mujoco"], "--engine is about those of engines"),
        (["--format", "urdf", "--explain"], "--explain is about those of engines"),
        (["--engine", "urdf"], "'urdf' is a format, not an engine"),
        (["--format", "urdf", "--out", "."], "is not a name"),
        (["--format", "urdf", "--set", "bodies.bob.mass=-1"], "mass"),
    ],
)
def test_wrong_words_end_in_an_error(here, words, said):
    done = run("swing.yaml", *words)
    assert done.exit_code == 2
    assert said in done.output
    assert not Path("plain").exists()
