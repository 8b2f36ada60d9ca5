"""The options of robot files: the same in every command that takes such files, by themselves or as what a spec uses."""

from __future__ import annotations

import pytest

from simspec import cli
from simspec.commands.options import COMMANDS as COMMANDS_BY_NAME
from simspec.commands.options import ROBOT_OPTIONS, RobotFileOptions
from simspec.errors import SpecError
from simspec.language.foreign import ImportOptions
from tests.meshes.solids import box, stl

pytestmark = pytest.mark.usefixtures("warm_engines", "warm_readers")

INERTIAL = '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="{0}" ixy="0" ixz="0" iyz="0"/></inertial>'
MESH = '<collision><geometry><mesh filename="package://far_description/{0}.stl"/></geometry></collision>'
ROBOT = f"""<robot name="two" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="file" default="gone"/>
  <link name="base"/>
  <link name="arm">{INERTIAL.format(1)}{MESH.format("$(arg file)")}</link>
  <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/></joint>
</robot>
"""
CELL = """\
simspec: 1
name: cell
physics: {duration: 5 ms}
contact: {materials: {steel: {friction: 0.5}}}
models: {r: {use: r.xacro}}
sweep: {over: {physics.timestep: [1 ms, 2 ms]}}
"""
SAID = ("--repair", "triangle-inequality", "--package-path", "../elsewhere", "--arg", "file=box", "--no-self-collision")
NAMED = ("--package", "far_description=../elsewhere/far_description")
SHORT = ("--set", "physics.duration=5ms", "--windows", "3")
COMMANDS = {
    "import": ["import", "r.xacro"],
    "export": ["export", "r.xacro", "--format", "mjcf"],
    "check": ["check", "r.xacro"],
    "check of a scenario": ["check", "cell.yaml"],
    "compile": ["compile", "r.xacro", "--engine", "mujoco"],
    "verify": ["verify", "r.xacro", "--engine", "mujoco"],
    "run": ["run", "r.xacro", "--engine", "mujoco", "--no-verify", "--no-repeats", "--set", "physics.duration=5ms"],
    "diff": ["diff", "r.xacro", "cell.yaml"],
    "explain": ["explain", "r.xacro", "--engine", "mujoco", "--with", "physics.gravity=[0, 0, -9]", *SHORT],
    "sweep": ["sweep", "cell.yaml", "--engine", "mujoco", "--dry-run"],
    "accept": ["accept", "cell.yaml", "--engine", "mujoco"],
    "audit": ["audit", "r.urdf", "--engine", "mujoco", "--no-verify"],
}
SUCCEEDS = {"diff": 1, "audit": 1}
"""Exit codes of commands that find something, which are otherwise 0."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    project, package = tmp_path / "project", tmp_path / "elsewhere" / "far_description"
    (project / ".git").mkdir(parents=True)
    package.mkdir(parents=True)
    (package / "box.stl").write_bytes(stl(*box(0.1, 0.2, 0.3)))
    (project / "r.xacro").write_text(ROBOT)
    (project / "r.urdf").write_text(
        ROBOT.replace('<xacro:arg name="file" default="gone"/>', "").replace("$(arg file)", "box")
    )
    (project / "cell.yaml").write_text(CELL)
    monkeypatch.chdir(project)
    return project


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_takes_them(folder, capsys, name):
    words = COMMANDS[name]
    said = [word for word in SAID if name != "audit" or word not in ("--arg", "file=box")]  # engines read no xacro
    with_all = cli.main([*words, *said])
    captured = capsys.readouterr()
    assert with_all == SUCCEEDS.get(name, 0), captured.out + captured.err


@pytest.mark.parametrize("name", ["import", "check of a scenario"])
def test_each_of_them_is_needed(folder, capsys, name):
    words = COMMANDS[name]
    assert cli.main([*words, *SAID[4:]]) == 2
    err = capsys.readouterr().err
    assert "triangle inequality" in err
    assert "the package 'far_description' is not found" in err
    assert cli.main([*words, *SAID[:4]]) == 2
    assert "no such file" in capsys.readouterr().err
    assert cli.main([*words, *SAID[:2], *SAID[4:], *NAMED]) == 0


@pytest.mark.parametrize("name", ["import", "check of a scenario", "run"])
def test_the_project_file_says_where_packages_are(folder, capsys, name, monkeypatch):
    """For every command, and after what the command line says."""
    said = [*SAID[:2], *SAID[4:]]
    monkeypatch.setenv("XDG_DATA_HOME", str(folder.parent / "data"))
    (folder / "simspec.toml").write_text('package-paths = ["../elsewhere"]\n')
    assert cli.main([*COMMANDS[name], *said]) == 2
    assert f"simspec trust {folder / 'simspec.toml'}" in " ".join(capsys.readouterr().err.split())
    assert cli.main(["trust"]) == 0
    code = cli.main([*COMMANDS[name], *said])
    captured = capsys.readouterr()
    assert code == SUCCEEDS.get(name, 0), captured.out + captured.err
    nearer = folder.parent / "nearer" / "far_description"
    nearer.mkdir(parents=True)
    (nearer / "box.stl").write_text("no mesh")
    code = cli.main([*COMMANDS[name], *said, "--package-path", "../nearer"])
    captured = capsys.readouterr()
    assert "7 bytes, where a binary STL has at least 84" in " ".join((captured.out + captured.err).split())
    assert code


def test_every_command_that_reads_specs_has_the_import_options():
    """One that reads specs and has no options for robot files is listed here."""
    without = {"study", "pages"}
    for name, kind in COMMANDS_BY_NAME.items():
        if "allow_outside" in kind.TAKES and name not in without:
            assert set(ROBOT_OPTIONS) <= set(kind.TAKES), name


@pytest.mark.parametrize("option", [("--repair", "massless"), ("--arg", "a=1"), ("--no-self-collision",)])
def test_import_options_without_a_robot_file_are_an_error(tmp_path, capsys, monkeypatch, option):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["check", "bouncing-ball", *option]) == 2
    assert f"{option[0]} is without effect on bouncing-ball" in capsys.readouterr().err
    assert cli.main(["check", "bouncing-ball", "--package-path", "."]) == 0


@pytest.mark.parametrize("words", [{"package": ["a"]}, {"arg": ["=1"]}, {"package": ["a=b", "a=c"]}])
def test_words_of_another_form_are_errors(words):
    with pytest.raises(SpecError, match=r"NAME=|given twice"):
        RobotFileOptions(**words).options()


def test_options_of_a_file_are_joined_with_options_of_all_files(tmp_path):
    options = ImportOptions({"a": "own"}, ("first",), {"x": "1", "y": "2"}, ("massless",), base=tmp_path)
    more = ImportOptions({"a": "all", "b": "all"}, ("second",), {"x": "3"}, ("massless", "other"), self_collision=False)
    both = options.together(more)
    assert both == ImportOptions(
        {"a": "own", "b": "all"},
        ("first", "second"),
        {"x": "3", "y": "2"},
        ("massless", "other"),
        base=tmp_path,
        self_collision=False,
    )
