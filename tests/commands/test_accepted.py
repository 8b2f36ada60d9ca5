"""``--accept``: approximations that a spec accepts, given on the command line, also for robot files, which cannot say them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from simspec import cli
from simspec.commands.loading import accepted_sets
from simspec.commands.options import Options
from simspec.errors import SpecError
from simspec.language.load import load

pytestmark = pytest.mark.usefixtures("warm_engines")

INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
BALL = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
LINKS = "".join(f'<link name="{name}">{INERTIAL}{BALL}</link>' for name in ("boom", "tip", "nail"))
ROBOT = f"""<robot name="arm"><link name="base"/>{LINKS}
  <joint name="luff" type="revolute">
    <parent link="base"/><child link="boom"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="turn" type="continuous">
    <parent link="boom"/><child link="tip"/><origin xyz="0 0 0.5"/><axis xyz="1 0 0"/>
  </joint>
  <joint name="bend" type="continuous">
    <parent link="tip"/><child link="nail"/><origin xyz="0 0 0.5"/><axis xyz="1 0 0"/>
  </joint>
</robot>
"""


@pytest.fixture
def robot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "arm.urdf"
    path.write_text(ROBOT, encoding="utf-8")
    return path.name


def test_a_robot_file_is_compiled_with_what_is_accepted_by_name(robot, capsys):
    assert cli.main(["compile", robot, "--engine", "mujoco"]) == 2
    assert "or --accept joint.limits.position" in capsys.readouterr().err
    assert cli.main(["compile", robot, "--engine", "mujoco", "--accept", "joint.limits.position"]) == 0
    # the reference world has the entries of the other engines that need some
    before = {path: path.read_bytes() for path in Path("generated").rglob("*.xml")}
    assert cli.main(["compile", robot, "--engine", "mujoco", "--accept", "all"]) == 0
    assert before
    assert {path: path.read_bytes() for path in before} == before


def test_engines_get_the_entries_that_they_need_and_no_others(robot):
    sets = accepted_sets(
        Options(sets=["engines.mujoco.accept=[contact.friction.impact]"], accept=["joint.limits.position"]), robot
    )
    assert "engines.mujoco.accept=[contact.friction.impact, joint.limits.position]" in sets, "existing entries stay"
    assert not any("engines.dart" in entry for entry in sets), "DART has limits as they are"


@pytest.mark.parametrize(
    ("word", "message"),
    [("joint.limit.position", "did you mean 'joint.limits.position'"), ("shape.plane", "no engine that supports")],
)
def test_a_word_that_accepts_nothing_is_an_error(robot, word, message):
    with pytest.raises(SpecError, match=message):
        accepted_sets(Options(accept=[word]), robot)


def test_a_model_whose_bodies_pass_through_each_other(robot, capsys):
    def excluded(*words: str) -> list[list[str]]:
        assert cli.main(["compile", robot, "--format", "world", "--out", "plain", *words]) == 0
        return json.loads(Path("plain/world.json").read_text(encoding="utf-8"))["contact"]["excluded_bodies"]

    assert ["boom", "nail"] not in excluded()
    assert ["boom", "nail"] in excluded("--set", "contact.self_collision=false")
    capsys.readouterr()
    assert cli.main(["import", robot, "--no-self-collision"]) == 0
    written = capsys.readouterr().out
    assert "self_collision: false" in written
    assert "an option of the import" in written


def test_a_placed_model_excludes_contact_between_its_bodies_only(robot, tmp_path):
    text = f"""simspec: 1
name: two
contact: {{materials: {{steel: {{friction: 0.5}}}}}}
models:
  a: {{use: {robot}, import: {{self_collision: false}}}}
  b: {{use: {robot}, pose: {{xyz: [2, 0, 0]}}}}
"""
    path = tmp_path / "two.yaml"
    path.write_text(text, encoding="utf-8")
    pairs = load(path).resolve().contact.excluded_bodies
    assert ("a/boom", "a/nail") in pairs
    assert ("b/boom", "b/nail") not in pairs
    assert not any(name.startswith("a/") != other.startswith("a/") for name, other in pairs)


def test_a_scenario_has_groups_for_it(tmp_path):
    path = tmp_path / "scene.yaml"
    text = "simspec: 1\nname: s\ncontact: {self_collision: false}\nbodies: {a: {fixed: true}}\n"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SpecError, match="only for a model"):
        load(path)


def test_a_model_that_is_run_by_itself_runs_for_a_second(robot, capsys):
    words = ["run", robot, "--engine", "mujoco", "--accept", "all", "--no-verify", "--no-repeats"]
    assert cli.main(words) == 0
    assert "physics.duration=1s" in capsys.readouterr().err
    assert json.loads(Path("runs/arm/mujoco/world.json").read_text(encoding="utf-8"))["physics"]["steps"] == 1000
