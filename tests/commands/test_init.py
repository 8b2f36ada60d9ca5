"""A project that ``simspec init`` makes: its commands pass, its workflow parses; files that exist are kept."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from jsonschema import Draft7Validator
from ruamel.yaml import YAML

from simspec import cli
from simspec.commands import init as init_module
from simspec.commands.init import workflow_for
from tests.command_lines import commands, parse

ROOT = Path(__file__).resolve().parents[2]
FILES = {
    ".github/workflows/simspec.yml",
    ".gitignore",
    ".pre-commit-config.yaml",
    "simspec.schema.json",
    "simspec.toml",
    "specs/pendulum.yaml",
}
CUBE = """\
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
f 1 3 2
f 1 2 4
f 2 3 4
f 1 4 3
"""
ROBOT = """\
<robot name="cart 1"><link name="cart">
<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><mesh filename="wedge.obj"/></geometry></collision></link></robot>
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*words: str, code: int = 0) -> None:
    assert cli.main([*words]) == code


def files_of(folder: Path) -> set[str]:
    """The files of a project but for compiled ones."""
    found = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    return {name for name in found if not name.startswith("generated/")}


def test_the_commands_of_a_new_project_pass(folder, monkeypatch, capsys, warm_engines):
    pytest.importorskip("mujoco")
    run("init", "mine", "--engine", "mujoco")
    assert capsys.readouterr().out.splitlines()[-1] == (
        "now: cd mine && simspec verify specs/pendulum.yaml && simspec run specs/pendulum.yaml"
    )
    assert files_of(folder / "mine") == FILES
    monkeypatch.chdir(folder / "mine")
    run("fmt", "--check", "specs/pendulum.yaml")
    run("check", "specs/pendulum.yaml")
    run("verify", "specs/pendulum.yaml")
    run("compile", "--check")
    spec = YAML(typ="safe").load(Path("specs/pendulum.yaml"))
    assert (
        Path("specs/pendulum.yaml").read_text().startswith("# yaml-language-server: $schema=../simspec.schema.json\n")
    )
    assert not [*Draft7Validator(json.loads(Path("simspec.schema.json").read_text())).iter_errors(spec)]
    assert Path("simspec.toml").read_text().endswith('default-engines = ["mujoco"]\n')


def test_the_checks_of_commits_and_the_workflow_are_commands_of_simspec(folder):
    run("init", "--vscode")
    workflow = YAML(typ="safe").load(Path(".github/workflows/simspec.yml"))
    scripts = [step["run"] for step in workflow["jobs"]["simspec"]["steps"] if "run" in step]
    lines = [line for script in scripts for line in commands(script)]
    hooks = YAML(typ="safe").load(Path(".pre-commit-config.yaml"))["repos"][0]["hooks"]
    lines += [f"{hook['entry']} {'x' if hook.get('pass_filenames', True) else ''}" for hook in hooks]
    assert {line.split()[1] for line in lines} == {"fmt", "check", "verify", "run", "compile"}
    for line in lines:
        parse(line)
    assert json.loads(Path(".vscode/settings.json").read_text())["yaml.schemas"] == {
        "./simspec.schema.json": "specs/*.yaml"
    }
    published = YAML(typ="safe").load(ROOT / ".pre-commit-hooks.yaml")
    assert [(hook["id"], hook["entry"], hook["files"]) for hook in published] == [
        (hook["id"], hook["entry"], hook["files"]) for hook in hooks
    ]


def test_the_workflow_is_that_of_the_documentation(folder):
    text = (ROOT / "docs/examples/github-workflow.yml").read_text()
    run("init")
    made = Path(".github/workflows/simspec.yml").read_text()
    assert made.splitlines()[1:] == text.splitlines()[1:]
    other = workflow_for(text, ["rapier", "ode"])
    assert "  ENGINES: --engine rapier --engine ode\n" in other
    assert "pip install 'simspec-physics[rapier]'\n          simspec engines install ode --yes\n" in other
    assert len(YAML(typ="safe").load(other)["jobs"]["simspec"]["steps"]) == text.count("\n      - ")


def test_files_that_exist_are_kept(folder, capsys):
    Path(".gitignore").write_text("runs/\n")
    Path("simspec.toml").write_text('default-engines = ["ode"]\n')
    Path("specs").mkdir()
    Path("specs/arm.yaml").write_text("not read")
    run("init")
    said = capsys.readouterr().out
    assert "kept .gitignore; add to it: reports/\n" in said
    assert "kept simspec.toml\n" in said
    assert said.endswith("now: simspec check specs/*.yaml\n")
    assert Path(".gitignore").read_text() == "runs/\n"
    assert Path("simspec.toml").read_text() == 'default-engines = ["ode"]\n'
    assert files_of(folder) == FILES - {"specs/pendulum.yaml"} | {"specs/arm.yaml"}


def test_a_robot_comes_with_its_meshes(folder, monkeypatch, capsys):
    pytest.importorskip("trimesh")
    Path("robot").mkdir()
    Path("robot/wedge.obj").write_text(CUBE)
    Path("robot/cart.urdf").write_text(ROBOT)
    run("init", "mine", "--robot", "robot/cart.urdf", "--engine", "mujoco", "--engine", "ode", "--json")
    said = json.loads(capsys.readouterr().out)
    (name,) = (path for path in said["written"] if path.startswith("specs/") and path.endswith(".yaml"))
    assert "wedge.obj" in {Path(path).name for path in files_of(folder / "mine")}
    assert set(said["engines"]) | set(said["not_for"]) == {"mujoco", "ode"}
    Path("robot/wedge.obj").unlink()
    monkeypatch.chdir(folder / "mine")
    run("fmt", "--check", name)
    run("check", name)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("--dry-run",), 0),
        (("--robot", "missing.urdf"), 2),
        (("--engine", "unknown"), 3),
    ],
)
def test_nothing_is_written_without_need(folder, words, code):
    run("init", "mine", *words, code=code)
    assert not (folder / "mine").exists()


def test_a_target_that_cannot_be_written_leaves_no_part_of_a_project(folder, capsys):
    Path("mine").mkdir()
    Path("mine/specs").write_text("a file")
    run("init", "mine", code=2)
    assert files_of(folder / "mine") == {"specs"}
    run("init", "mine/specs", code=2)
    assert "mine/specs is not a folder" in capsys.readouterr().err


def test_a_wrong_robot_file_leaves_no_part_of_a_project(folder):
    Path("cart.urdf").write_text(ROBOT.replace('value="1"', 'value="-1"'))
    run("init", "mine", "--robot", "cart.urdf", code=2)
    assert not Path("mine").exists()


def test_the_engines_of_the_documentation_are_found():
    text = (ROOT / "docs/examples/github-workflow.yml").read_text()
    assert init_module._engines_of(text) == ["mujoco", "dart"]
