"""``simspec trust``: interpreters and files that a foreign project file names are neither started nor read before the user
trusts it."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

from simspec import cli
from simspec import project as project_module
from simspec.commands import explain as bisect
from simspec.commands.options import interpreters
from simspec.engines.kit.registry import engines
from simspec.project import NotTrustedError, load_project
from tests.files import program

pytestmark = pytest.mark.usefixtures("warm_engines")

ENGINE = "mujoco"
VERSION = engines()[ENGINE].version() or ""
LABEL = f"{ENGINE}@{VERSION}"
SPEC = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 10 ms}
bodies:
  ball:
    pose: {xyz: [0, 0, 1]}
    mass: 1 kg
    inertia: {principal: [1, 1, 1]}
sweep:
  over:
    physics.timestep: [1 ms, 2 ms]
"""
PLAIN = f'[engines.{ENGINE}]\npython = "bin/python"\n'
"""The engine in another interpreter, which this one has too."""
LABELLED = f'default-engines = ["{LABEL}"]\n[engines."{LABEL}"]\npython = "bin/python"\n'


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A repository whose project file names an interpreter in it, which leaves a mark when it is started."""
    folder = tmp_path / "repository"
    folder.mkdir()
    script = f'#!/bin/sh\necho started >> {tmp_path}/started\nexec "{sys.executable}" "$@"\n'
    program(folder / "bin" / "python", script)
    (folder / "fall.yaml").write_text(SPEC)
    (folder / "simspec.toml").write_text(LABELLED)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.chdir(folder)
    return folder


def started(project: Path) -> bool:
    return (project.parent / "started").exists()


def content(folder: Path) -> set[Path]:
    return set(folder.rglob("*"))


STARTING = [
    ("run", "fall.yaml", "--all-engines"),
    ("run", "fall.yaml", "--engine", "dart", "--engine", LABEL),
    ("run", "fall.yaml", "--keep-going", "--engine", "dart", "--engine", LABEL),
    ("run", "fall.yaml", "--accept", "all", "--engine", LABEL),
    ("verify", "fall.yaml", "--engine", LABEL),
    ("verify", "--self-test", "--engine", LABEL),
    ("sweep", "fall.yaml", "--engine", LABEL),
    ("sweep", "fall.yaml", "--store", "elsewhere"),
    ("explain", "fall.yaml", "--engine", "dart", "--engine", LABEL),
    ("accept", "fall.yaml", "--engine", LABEL),
    ("audit", "robot.urdf", "--engine", LABEL),
    ("engines", "doctor", LABEL),
]


def demands_trust(project: Path, capsys, *words: str) -> None:
    """A command ends with the command that trusts the file; nothing is started, nothing half-written."""
    before = content(project)
    code = cli.main([*words])
    err = " ".join(capsys.readouterr().err.split())
    assert (code, f"hint: read it, then simspec trust {project}/simspec.toml" in err) == (2, True), err
    assert not started(project)
    assert content(project) == before


@pytest.mark.parametrize("words", STARTING, ids=" ".join)
def test_nothing_of_an_untrusted_file_is_started(project, capsys, words):
    """Here by the engine's name, for which this interpreter has an engine that is not taken in its place."""
    (project / "simspec.toml").write_text(PLAIN)
    (project / "robot.urdf").write_text('<robot name="r"><link name="base"/></robot>')
    demands_trust(project, capsys, *(ENGINE if word == LABEL else word for word in words))


@pytest.mark.parametrize(
    "words",
    [("run", "fall.yaml"), ("verify", "fall.yaml"), ("sweep", "fall.yaml"), ("accept", "fall.yaml")],
    ids=" ".join,
)
def test_nor_by_its_version_as_a_default_engine(project, capsys, words):
    demands_trust(project, capsys, *words)


def test_bisect_requires_trust_before_it_writes(project, capsys, monkeypatch):
    """Also for a version in the middle."""
    monkeypatch.setattr(bisect, "_between", lambda kind, every, first, last, given: [first, VERSION, last])
    words = ("bisect", "fall.yaml", "--engine", ENGINE, "--figure", "ball.z", "--versions", VERSION)
    demands_trust(project, capsys, *words, "--from", "3.8", "--to", "9.9")


LISTING = [
    ("engines",),
    ("engines", "--json"),
    ("engines", "doctor", "ode"),
    ("sweep", "fall.yaml", "--dry-run"),
    ("check", "fall.yaml"),
    ("check", "fall.yaml", "--engine", LABEL),
    ("compile", "fall.yaml", "--out", "../out"),
    ("compile", "fall.yaml", "--out", "../out", "--accept", "contact.friction"),
    ("diff", "fall.yaml", "fall.yaml"),
    ("fmt", "fall.yaml", "--check"),
    ("schema", "--of", "project", "--out", "-"),
]


@pytest.mark.parametrize("trusted", [False, True])
@pytest.mark.parametrize("words", LISTING, ids=" ".join)
def test_commands_that_only_list_plan_or_show_start_no_interpreter(project, capsys, words, trusted):
    if trusted:
        assert cli.main(["trust"]) == 0
    before = content(project)
    code = cli.main([*words])
    captured = capsys.readouterr()
    assert code in (0, 2 if "contact.friction" in words else 0), captured.err
    assert not started(project)
    assert content(project) == before
    if words[0] in ("engines", "sweep") and "doctor" not in words:
        said = " ".join(captured.out.split())
        assert "not queried" in said
        assert ("simspec trust" in said) == (not trusted)


def test_a_plan_knows_no_stored_runs_of_what_it_does_not_query(project, capsys):
    assert cli.main(["sweep", "fall.yaml", "--dry-run", "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert plan["not_queried"] == {LABEL: f"not queried: not trusted; simspec trust {project}/simspec.toml"}
    assert (plan["done"], plan["to_do"]["runs"]) == (0, {LABEL: 2})


def test_the_doctor_starts_trusted_interpreters_alone(project, capsys):
    assert cli.main(["engines", "doctor", "--json"]) in (0, 3)
    row = json.loads(capsys.readouterr().out)["engines"][LABEL]
    assert (row["state"], row["version"]) == ("not trusted", None)
    assert "simspec trust" in row["problems"][0]
    assert not started(project)
    assert cli.main(["trust"]) == 0
    capsys.readouterr()
    assert cli.main(["engines", "doctor", LABEL, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["engines"][LABEL]["state"] == "works"
    assert started(project)


def test_a_trusted_file_is_used_until_it_changes(project, capsys):
    words = ["run", "fall.yaml", "--no-repeats", "--no-verify"]
    assert cli.main(["trust"]) == 0
    said = capsys.readouterr().out
    assert f"engines.{LABEL}.python: {project}/bin/python" in said
    assert "trusted until it changes" in said
    assert cli.main(words) == 0
    assert started(project)
    (project.parent / "started").unlink()
    capsys.readouterr()
    (project / "simspec.toml").write_text(f"{LABELLED}# \n")
    demands_trust(project, capsys, *words)
    (project / "simspec.toml").write_text(LABELLED)
    assert cli.main(["trust", "--revoke", "."]) == 0
    capsys.readouterr()
    demands_trust(project, capsys, *words)


def test_a_word_of_the_command_line_needs_no_trust(project, capsys):
    label = f"{LABEL}={sys.executable}"
    assert cli.main(["run", "fall.yaml", "--no-repeats", "--no-verify", "--engine", label]) == 0
    assert interpreters([label], None)[LABEL] == sys.executable
    with pytest.raises(NotTrustedError):
        dict(interpreters(None))
    assert not started(project)


def test_engines_of_other_names_need_no_trust(project, capsys):
    assert cli.main(["run", "fall.yaml", "--no-repeats", "--no-verify", "--engine", ENGINE]) == 0
    (project / "simspec.toml").write_text(f'default-engines = ["{ENGINE}"]\n')
    assert load_project(project).not_trusted is None
    assert cli.main(["run", "fall.yaml", "--no-repeats", "--no-verify"]) == 0


def test_the_bytes_that_are_parsed_are_those_that_are_trusted(project, monkeypatch):
    """A file that is replaced meanwhile is another file."""
    assert cli.main(["trust"]) == 0
    read = project_module.read_bytes

    def replaced(file, limit):
        content = read(file, limit)
        file.write_text("default-engines = ['dart']\n")
        return content

    monkeypatch.setattr(project_module, "read_bytes", replaced)
    assert load_project(project).interpreters == {LABEL: f"{project}/bin/python"}
    monkeypatch.undo()
    (project / "simspec.toml").write_text(LABELLED.replace("bin/python", "bin/other"))
    monkeypatch.setattr(
        project_module, "read_bytes", lambda file, limit: (read(file, limit), file.write_text(LABELLED))[0]
    )
    assert str(load_project(project).not_trusted).startswith("not trusted")


# --- the command ------------------------------------------------------------------------------------------------------


def test_trusted_files_are_listed(project, capsys):
    other = project / "other" / "simspec.toml"
    other.parent.mkdir()
    other.write_text('allowed-folders = ["."]\n')
    assert cli.main(["trust", "--list"]) == 0
    assert "no project file is trusted" in capsys.readouterr().out
    assert cli.main(["trust"]) == cli.main(["trust", "other", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out.partition("\n{")[2].join(["{", ""]))
    assert answer["names"] == [{"key": "allowed-folders", "value": str(other.parent)}]
    other.write_text('allowed-folders = [".."]\n')
    assert cli.main(["trust", "--list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["files"]
    states = {row["file"]: row["state"] for row in rows}
    assert states == {str(project / "simspec.toml"): "trusted", str(other): "changed since: not trusted"}
    (project / "simspec.toml").unlink()
    assert cli.main(["trust", "--list"]) == 0
    assert "not readable" in capsys.readouterr().out
    assert cli.main(["trust", "--revoke", str(project / "simspec.toml")]) == 0
    assert "no longer trusted" in capsys.readouterr().out


def test_a_file_that_names_nothing_needs_no_trust(project, capsys):
    (project / "simspec.toml").write_text("default-engines = ['dart']\n")
    assert cli.main(["trust"]) == 0
    assert "needs no trust" in capsys.readouterr().out
    assert not (project.parent / "data").exists()


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("--list", "--revoke"), "--list excludes"),
        (("--list", "simspec.toml"), "--list excludes"),
        (("fall.yaml",), "not a project file"),
        (("bin",), "no such file"),
        (("link/simspec.toml",), "a symbolic link"),
        (("bad",), "not TOML"),
    ],
)
def test_words_and_files_that_cannot_be_trusted(project, capsys, words, error):
    for name, text in (("link", None), ("bad", "x =")):
        (project / name).mkdir()
        place = project / name / "simspec.toml"
        place.symlink_to("../simspec.toml") if text is None else place.write_text(text)
    assert cli.main(["trust", *words]) == 2
    assert error in capsys.readouterr().err
    assert not (project.parent / "data").exists()


def test_without_a_project_file_there_is_nothing_to_trust(project, capsys):
    (project / "simspec.toml").unlink()
    (project / ".git").mkdir()
    assert cli.main(["trust"]) == 2
    assert "there is no simspec.toml here or above" in capsys.readouterr().err


def test_a_store_that_cannot_be_used_is_said_and_trusts_nothing(project, capsys):
    assert cli.main(["trust"]) == 0
    (project.parent / "data" / "simspec" / "trust").chmod(0o777)
    capsys.readouterr()
    assert cli.main(["trust"]) == cli.main(["trust", "--list"]) == 2
    assert "others can write in it" in capsys.readouterr().err
    assert cli.main(["verify", "fall.yaml"]) == 2
    assert "others can write in it" in capsys.readouterr().err
    assert not started(project)


# --- folders ----------------------------------------------------------------------------------------------------------


URDF = """<robot name="r"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link></robot>
"""
USER = "simspec: 1\nname: far\nphysics: {duration: 0.01, timestep: 1 ms}\nmodels: {robot: {use: ../far/robot.urdf}}\n"
STUDY = "simspec_study: 1\nname: far\ndescription: d\nsweeps: {one: {spec: ../far/fall.yaml, show: [speed]}}\n"


@pytest.fixture
def far(project):
    """A robot and a scenario outside the repository, in a folder that its project file allows."""
    (project.parent / "far").mkdir()
    (project.parent / "far" / "robot.urdf").write_text(URDF)
    (project.parent / "far" / "fall.yaml").write_text(SPEC)
    (project / "user.yaml").write_text(USER)
    (project / "pyproject.toml").write_text("")
    (project / "simspec.toml").write_text('allowed-folders = ["../far"]\n')
    return project


@pytest.mark.parametrize("command", ["check", "compile"])
def test_allowed_folders_are_read_without_a_flag_once_trusted(far, capsys, command):
    words = [command, "user.yaml", *(["--out", "../out"] if command == "compile" else [])]
    assert cli.main(words) == 2
    err = " ".join(capsys.readouterr().err.split())
    assert "leaves the project folder" in err
    assert f"simspec trust {far}/simspec.toml" in err
    assert cli.main([*words, "--allow-outside"]) == 0
    assert cli.main(["trust"]) == 0
    assert cli.main(words) == 0
    (far / "user.yaml").write_text(USER.replace("../far/", "../farther/"))
    os.rename(far.parent / "far", far.parent / "farther")
    (far.parent / "far").mkdir()
    capsys.readouterr()
    assert cli.main(words) == 2
    assert "leaves the project folder" in capsys.readouterr().err


def test_links_do_not_lead_out_of_an_allowed_folder(far, capsys):
    assert cli.main(["trust"]) == 0
    os.rename(far.parent / "far" / "robot.urdf", far.parent / "robot.urdf")
    (far.parent / "far" / "robot.urdf").symlink_to("../robot.urdf")
    assert cli.main(["check", "user.yaml"]) == 2
    assert "leaves the project folder" in capsys.readouterr().err


def test_a_spec_that_needs_no_folder_needs_no_trust(far, capsys):
    assert cli.main(["check", "fall.yaml"]) == 0


def test_studies_use_allowed_folders(far, capsys):
    (far / "study.yaml").write_text(STUDY)
    assert cli.main(["study", "study.yaml", "--dry-run"]) == 2
    assert "simspec trust" in capsys.readouterr().err
    assert cli.main(["trust"]) == 0
    assert cli.main(["study", "study.yaml", "--dry-run"]) == 0


def test_untrusted_package_paths_are_not_passed_by(far, capsys, monkeypatch):
    """A package of this name elsewhere is not taken in the place of the one that the file means."""
    for name in ("theirs", "elsewhere"):
        (far.parent / name / "arm").mkdir(parents=True)
        (far.parent / name / "arm" / "box.stl").write_text("")
    mesh = '<collision><geometry><mesh filename="package://arm/box.stl"/></geometry></collision></link>'
    (far / "robot.urdf").write_text(URDF.replace("</link>", mesh))
    (far / "simspec.toml").write_text('package-paths = ["../theirs"]\n')
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(far.parent / "elsewhere"))
    assert cli.main(["check", "robot.urdf"]) == 2
    err = " ".join(capsys.readouterr().err.split())
    assert (
        f"'arm' is sought in folders of a project file that is not trusted found: arm hint: simspec trust {far}" in err
    )
    # interpreters of the command line come first, and need no trust
    cli.main(["check", "robot.urdf", "--package-path", "../elsewhere"])
    assert "not trusted" not in capsys.readouterr().err
