"""The command line: words in, files, tables and exit codes out; every error is a message, none a traceback."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import get_type_hints

import pytest
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from simspec import cli
from simspec.commands.help_format import GROUPS
from simspec.commands.options import COMMANDS as OPTIONS
from simspec.compiler import compile_world
from simspec.engines.kit.registry import engines
from simspec.files import library, resource_folder
from simspec.language.load import load
from simspec.runner.store import load_run
from tests.installed import INSTALLED

pytestmark = pytest.mark.usefixtures("warm_engines")

PACKAGE = Path(cli.__file__).resolve().parent
COMMANDS = (
    "new",
    "list",
    "check",
    "audit",
    "fmt",
    "schema",
    "compile",
    "verify",
    "run",
    "report",
    "view",
    "diff",
    "sweep",
    "study",
    "pages",
    "explain",
    "bisect",
    "engines",
    "accept",
    "import",
    "export",
    "trust",
    "help",
    "completion",
    "init",
)
FALL = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 0.1 s}
bodies:
  ball: {mass: 1, inertia: {principal: [0.01, 0.01, 0.01]}, pose: {xyz: [0, 0, 1]}}
record: {every: 10 ms}
expect:
  - displacement: {body: ball, xyz: [0, 0, -0.0495], tolerance: 1 mm}
"""
WRONG = FALL.replace("mass: 1,", "mas: 1,").replace("timestep: 1 ms", "timestep: 1 deg")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a good and a wrong spec, to work in."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.yaml").write_text(FALL)
    (tmp_path / "wrong.yaml").write_text(WRONG)
    return tmp_path


def simspec(*words: object, code: int = 0):
    """One command line; its exit code must be ``code``."""
    done = CliRunner().invoke(cli.app, [str(word) for word in words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == code, done.output
    return done


def data(*words: object, code: int = 0):
    return json.loads(simspec(*words, "--json", code=code).stdout)


def process(*words: object, **environment: str):
    return subprocess.run(
        [sys.executable, "-m", "simspec", *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )


# --- help -------------------------------------------------------------------------------------------------------------


def test_the_stored_help_is_that_of_the_commands():
    assert (PACKAGE / "help.txt").read_text(encoding="utf-8") == cli.help_text()


@pytest.mark.parametrize("words", [(), ("--help",), ("-h",)])
def test_help_needs_nothing_but_the_stored_text(words):
    done = process(*words)
    assert done.returncode == 0
    assert done.stdout == (PACKAGE / "help.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_teaches_by_an_example_and_speaks_json(command):
    text = simspec(command, "--help").output
    assert re.search(rf"^  simspec {command} ", text, re.MULTILINE), text
    assert "--json" in text


@pytest.mark.parametrize("command", COMMANDS)
def test_a_help_has_every_option_once_and_no_brace_or_type(command):
    text = simspec(command, "--help").output
    usage = text.splitlines()[0]
    assert usage.startswith(f"Usage: simspec {command} [OPTIONS]")
    assert not set("{}<") & set(usage)
    assert "x>=" not in text
    options = re.findall(r"^  (?:-\w, )?(--[\w-]+)", text, re.MULTILINE)
    assert len(options) == len(set(options))
    kind = OPTIONS[command]
    named = [name for name in kind.TAKES if "Argument" not in str(get_type_hints(kind, include_extras=True)[name])]
    assert len(options) == len([name for name in named if name != "context"]) + 1


def test_a_long_help_has_headings():
    text = simspec("run", "--help").output
    titles = re.findall(r"^(\w[\w ]*):$", text, re.MULTILINE)
    assert titles == ["Arguments", *GROUPS]
    fields = {name for kind in OPTIONS.values() for name in kind.TAKES} | {"help"}
    assert set(" ".join(GROUPS.values()).split()) <= fields


def test_the_list_of_commands_is_whole():
    found = {info.name for info in (*cli.app.registered_commands, *cli.app.registered_groups)}
    assert found == set(COMMANDS)


@pytest.mark.parametrize("kind", OPTIONS.values(), ids=OPTIONS)
def test_every_command_has_a_function_that_takes_its_options(kind):
    module, _, name = kind.BODY.partition(":")
    (hint, answer) = get_type_hints(getattr(importlib.import_module(module), name)).values()
    assert (hint, answer) == (kind, int)


def test_version():
    assert re.fullmatch(r"simspec \d+\.\d+\.\d+\n", process("--version").stdout)


def test_a_wrong_word_is_exit_2():
    done = process("simulate")
    assert done.returncode == 2
    assert "No such command" in done.stderr
    assert "Traceback" not in done.stderr


# --- errors -----------------------------------------------------------------------------------------------------------


def test_every_problem_is_named_with_its_place(folder):
    done = process("check", "wrong.yaml", NO_COLOR="1")
    assert done.returncode == 2
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    places = [line for line in lines if re.match(r"wrong\.yaml:\d+:\d+: ", line)]
    assert any(line.startswith("wrong.yaml:3:") for line in places)
    assert any(line.startswith("wrong.yaml:5:") for line in places)
    assert "Traceback" not in done.stderr
    assert "\x1b" not in done.stderr


def test_errors_as_json(folder):
    found = data("check", "wrong.yaml", code=2)["error"]
    assert found["exit_code"] == 2
    assert {problem["location"]["line"] for problem in found["problems"]} >= {3, 5}


def test_the_problems_of_all_specs_come_together(folder):
    (folder / "other.yaml").write_text(FALL.replace("mass: 1,", "mass: -1,"))
    found = data("check", "wrong.yaml", "other.yaml", "fall.yaml", code=2)["error"]
    assert {problem["location"]["file"] for problem in found["problems"]} == {"wrong.yaml", "other.yaml"}


def test_no_such_spec(folder):
    done = simspec("check", "spheres-126", code=2)
    assert "did you mean 'spheres-216'" in done.stderr


def test_a_folder_is_no_spec(folder):
    assert "is a folder, not a spec" in simspec("check", ".", code=2).stderr


def test_a_fifo_is_no_spec(folder):
    os.mkfifo(folder / "pipe.yaml")
    assert "is a FIFO, not a spec" in simspec("check", "pipe.yaml", code=2).stderr


@pytest.mark.parametrize("words", [("--out", ""), ("--out=",), ("-e", "")])
@pytest.mark.parametrize("as_json", [False, True])
def test_an_empty_argument_is_refused_before_anything_is_written(folder, capfd, words, as_json):
    before = sorted(folder.iterdir())
    assert cli.main(["run", "fall.yaml", "--engine", "mujoco", *words, *(["--json"] if as_json else [])]) == 2
    said = capfd.readouterr()
    text = json.loads(said.out)["error"]["problems"][0]["message"] if as_json else said.err
    assert "an argument of the command line is empty" in text
    assert sorted(folder.iterdir()) == before


def test_names_that_are_not_text_are_refused(folder, capsys, monkeypatch):
    """Engines and certificates name files in UTF-8: other names would be reported as errors of an engine."""
    name = os.fsdecode(b"bad\xff")
    (folder / f"{name}.yaml").write_text(FALL)
    assert cli.main(["check", f"{name}.yaml"]) == 2
    assert "the word 2 of the command line is not UTF-8 text" in capsys.readouterr().err
    (folder / name).mkdir()
    (folder / name / "fall.yaml").write_text(FALL)
    monkeypatch.chdir(folder / name)
    assert cli.main(["run", "fall.yaml", "-e", "mujoco", "--json"]) == 2
    assert "the current folder is not UTF-8 text" in capsys.readouterr().out
    assert [path.name for path in (folder / name).iterdir()] == ["fall.yaml"]


def test_a_folder_that_cannot_be_written_is_an_error(folder):
    (folder / "generated").write_text("in the way")
    done = simspec("compile", "fall.yaml", code=2)
    assert "generated" in done.stderr


def test_a_name_that_a_terminal_obeys_is_shown_escaped(folder):
    """In whatever is said of a file: an error, a note, a file that is written."""
    name, robot = "\x1b[31mred\n.yaml", "\x1b[31mred\n.urdf"
    (folder / name).write_text(FALL.replace("mass: 1,", "mass: -1,"))
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    (folder / robot).write_text(f'<robot name="r"><link name="a">{inertial}</link></robot>')
    commands = (("check", name), ("accept", robot, "-e", "mujoco"), ("run", robot, "-e", "mujoco", "--no-repeats"))
    for words in commands:
        done = CliRunner().invoke(cli.app, list(words))
        assert "\x1b[31mred" not in done.output
        assert "\\x1b[31mred\\n" in done.output


def test_an_engine_that_there_is_not(folder):
    found = data("run", "fall.yaml", "--engine", "havok", code=3)["error"]
    assert found["engine"] == "havok"
    assert "mujoco" in found["message"]


@pytest.mark.parametrize("words", [(), ("--all-engines", "--engine", "mujoco")])
def test_which_engines_must_be_said(folder, words):
    assert "--all-engines" in simspec("run", "fall.yaml", *words, code=2).stderr


def test_another_python_that_is_not_there(folder):
    done = simspec("run", "fall.yaml", "--engine", "mujoco", "--python", "mujoco=/nowhere/python", code=3)
    assert "mujoco failed: /nowhere/python cannot be started: No such file or directory" in done.stderr.replace(
        "\n", " "
    )
    done = simspec("run", "fall.yaml", "--engine", "mujoco", "--python", "/nowhere/python", code=2)
    assert "no interpreter given" in done.stderr


def test_an_engine_that_answers_nonsense_leaves_the_others_their_runs(folder):
    """With --keep-going: exit code 3, and what the others made of it is on disk."""
    impostor = folder / "python"
    impostor.write_text('#!/bin/sh\necho "[1, 2]" > "$4"/result.json\n')
    impostor.chmod(0o755)
    words = ("run", "fall.yaml", "--all-engines", "--keep-going", "--no-verify", "--no-repeats")
    done = simspec(*words, "--python", "dart=./python", code=3)
    assert "dart failed: its result.json is wrong" in done.stderr.replace("\n", " ")
    for engine in ("mujoco", "pybullet"):
        assert load_run(folder / "runs" / "fall" / engine).failed is None


# --- new, check, fmt, schema --------------------------------------------------------------------------------------------


def test_a_new_spec_is_good_laid_out_and_runs(folder):
    simspec("new", "pendulum")
    simspec("check", "pendulum.yaml")
    simspec("fmt", "--check", "pendulum.yaml")
    simspec("run", "pendulum.yaml", "--engine", "mujoco", "--no-verify", "--no-repeats")


def test_new_never_overwrites_and_wants_a_name(folder):
    simspec("new", "fall", code=2)
    assert (folder / "fall.yaml").read_text() == FALL
    assert "simspec new my-arm" in simspec("new", "my arm.yaml", code=2).stderr


def test_check_says_what_it_read(folder):
    (row,) = data("check", "fall.yaml")["specs"]
    assert (row["name"], row["bodies"]) == ("fall", 1)
    heavier = data("check", "fall.yaml", "--set", "bodies.ball.mass=2")["specs"][0]
    assert heavier["world_sha256"] != row["world_sha256"]


def test_fmt(folder):
    (folder / "ugly.yaml").write_text("# mine\n" + FALL.replace("{timestep: 1 ms, ", "{  timestep:   1 ms,"))
    assert data("fmt", "--check", "ugly.yaml", code=1)["changed"] == ["ugly.yaml"]
    simspec("fmt", "ugly.yaml")
    assert (folder / "ugly.yaml").read_text().startswith("# mine\n")
    simspec("fmt", "--check", "ugly.yaml")


def test_fmt_writes_nothing_if_a_file_is_not_a_spec(folder):
    (folder / "ugly.yaml").write_text(FALL.replace("{timestep: 1 ms, ", "{  timestep:   1 ms,"))
    (folder / "broken.yaml").write_text("a: [1\n")
    before = (folder / "ugly.yaml").read_text()
    done = simspec("fmt", "ugly.yaml", "broken.yaml", code=2)
    assert "broken.yaml:" in done.stderr
    assert (folder / "ugly.yaml").read_text() == before


def test_schema(folder):
    simspec("schema", "--check", "--out", "s.json", code=1)
    simspec("schema", "--out", "s.json")
    simspec("schema", "--check", "--out", "s.json")
    assert json.loads((folder / "s.json").read_text()) == json.loads(simspec("schema", "--out", "-").stdout)
    simspec("schema")
    assert (folder / "simspec.schema.json").read_text() == (folder / "s.json").read_text()


@pytest.mark.parametrize("name", ["engine-request", "engine-result"])
def test_schemas_of_the_engine_process(folder, name):
    path = folder / "schema" / f"{name}.schema.json"
    simspec("schema", "--of", name, "--check", code=1)
    path.parent.mkdir()
    simspec("schema", "--of", name)
    simspec("schema", "--of", name, "--check")
    Draft202012Validator.check_schema(json.loads(path.read_text()))
    path.write_text("{}")
    assert "schema" in simspec("schema", "--of", name, code=2).stderr


# --- compile --------------------------------------------------------------------------------------------------------------


def test_compile_writes_every_engine_and_is_stable(folder):
    simspec("compile", "fall.yaml")
    place = folder / "generated" / "fall"
    alongside = {"simspec-folder.json", "world.json"}
    names = {path.name for path in place.iterdir()}
    assert {*alongside, *INSTALLED} <= names <= {*alongside, *engines()}
    files = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    assert data("compile", "fall.yaml")["compiled"][0]["changed"] is False
    assert files == {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}


def test_compiling_a_single_engine_keeps_the_others_of_the_same_world(folder):
    simspec("compile", "fall.yaml")
    simspec("compile", "fall.yaml", "--engine", "mujoco")
    assert (folder / "generated" / "fall" / "dart").is_dir()
    simspec("compile", "fall.yaml", "--engine", "mujoco", "--set", "bodies.ball.mass=2")
    assert not (folder / "generated" / "fall" / "dart").exists()


def test_check_lists_missing_stale_and_unexpected_files(folder):
    missing = data("compile", "fall.yaml", "--check", code=1)["stale"]
    assert any(line.startswith("missing: generated/fall/world.json") for line in missing)
    simspec("compile", "fall.yaml")
    place = folder / "generated" / "fall"
    (only,) = data("compile", "fall.yaml", "--check", code=1)["stale"]
    assert only.startswith("missing: generated/fall/certificate.json")
    (place / "world.json").write_text("{}")
    (place / "notes.txt").write_text("mine, and none of simspec's business")
    (place / "mujoco" / "unknown.xml").write_text("among an engine's files it could act")
    found = data("compile", "fall.yaml", "--check", code=1)["stale"]
    assert "stale: generated/fall/world.json" in found
    assert "not of this spec: generated/fall/mujoco/unknown.xml" in found
    assert not any("notes.txt" in line for line in found)


def test_compile_without_a_spec_takes_the_folder(folder):
    assert "no specs/*.yaml in the working folder" in simspec("compile", "--check", code=2).stderr
    (folder / "specs").mkdir()
    (folder / "specs" / "fall.yaml").write_text(FALL)
    simspec("compile")
    assert (folder / "generated" / "fall" / "world.json").is_file()


def test_nothing_is_written_if_a_spec_is_wrong(folder):
    simspec("compile", "fall.yaml", "wrong.yaml", code=2)
    assert not (folder / "generated").exists()


def test_two_specs_of_the_same_name_are_refused(folder):
    (folder / "again.yaml").write_text(FALL.replace("principal: [0.01,", "principal: [0.011,"))
    assert "would write to one folder" in simspec("compile", "fall.yaml", "again.yaml", code=2).stderr


def test_explain_says_how_each_feature_is_realised(folder):
    text = simspec("compile", "fall.yaml", "--explain", "--engine", "pybullet").output
    assert "joint.free" in text
    assert "pybullet" in text


def test_explain_gives_the_same_as_data(folder):
    (entry,) = json.loads(simspec("compile", "fall.yaml", "--explain", "--engine", "pybullet", "--json").output)[
        "compiled"
    ]
    found = entry["engines"]["pybullet"]["explained"]
    assert found["engine"] == "pybullet"
    assert {setting["name"] for setting in found["settings"]} == set(engines()["pybullet"].SETTINGS)
    assert {"value", "in_force", "given", "meaning"} <= set(found["settings"][0])
    plain = json.loads(simspec("compile", "fall.yaml", "--engine", "pybullet", "--json").output)["compiled"][0]
    assert "explained" not in plain["engines"]["pybullet"]


# --- verify, run, diff ------------------------------------------------------------------------------------------------------


def test_verify_writes_a_certificate_and_then_leaves_it_alone(folder):
    simspec("verify", "fall.yaml", "--engine", "mujoco")
    path = folder / "generated" / "fall" / "certificate.json"
    first = path.read_bytes()
    assert "unchanged" in simspec("verify", "fall.yaml", "--engine", "mujoco").output
    assert path.read_bytes() == first
    simspec("compile", "fall.yaml", "--engine", "mujoco", "--check")
    # another world: the certificate is of other files, and must go
    done = simspec("compile", "fall.yaml", "--engine", "mujoco", "--set", "bodies.ball.mass=2")
    assert "certificate.json dropped" in done.output
    assert not path.exists()


def test_run_writes_results_that_can_be_compared_again(folder):
    found = data("run", "fall.yaml", "--engine", "mujoco", "--engine", "dart")
    place = folder / "runs" / "fall"
    assert found["certificate_valid"] is True
    assert {path.name for path in place.iterdir()} == {
        *("mujoco", "dart", "compiled", "certificate.json", "report.json", "simspec-folder.json")
    }
    assert json.loads((place / "report.json").read_text())["exit_code"] == 0
    (difference,) = found["diffs"]
    assert difference["within"] is True
    assert difference["horizon"] is None
    assert found["floors"]["mujoco"]["bitwise"] is True
    again = data("diff", place / "mujoco", place / "dart", "--tolerance", "1e-9")
    assert again["bodies"] == data("diff", place / "mujoco", place / "dart", "--tolerance", "1e-9")["bodies"]
    assert again["notes"] == []  # the saved repeats give the noise floor again
    assert again["bodies"][0]["position_largest"] == difference["bodies"][0]["position_largest"]


VERDICT = ["model", "motion", "expectations", "speed", "next"]


def test_the_tables_of_a_run(folder):
    text = simspec("run", "fall.yaml", "--engine", "mujoco", "--engine", "dart", "-v").output
    questions = ("Model: largest deviations", "Results", "Expectations", "Differences between engines", "\nmodel  ")
    at = [text.index(question) for question in questions]
    assert at == sorted(at)
    assert "\x1b" not in text
    assert max(len(line) for line in text.splitlines()) <= 120


def test_a_run_ends_with_a_verdict_of_at_most_twelve_lines(folder, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    words = ("run", "fall.yaml", "--engine", "mujoco", "--engine", "dart", "--no-repeats")
    lines = simspec(*words).stdout.splitlines()
    assert [line.split("  ")[0] for line in lines if line[0] != " "] == VERDICT
    assert len(lines) <= 12
    assert max(map(len, lines)) <= 80
    assert not any(line.endswith(" ") for line in lines)
    quiet = simspec(*words, "-q")
    assert [line.split("  ")[0] for line in quiet.stdout.splitlines() if line[0] != " "] == VERDICT[:-2]
    assert quiet.stderr == ""
    assert [part["label"] for part in data(*words)["verdict"] if part["label"]] == VERDICT[:-1]
    assert "exclude each other" in simspec(*words, "-q", "-v", code=2).stderr


def test_a_rule_of_repair_has_help():
    said = simspec("help", "massless-moments").stdout
    assert said.startswith("# massless-moments: a rule of repair")
    assert "moments of inertia of a link whose mass is 0 are left out" in " ".join(said.split())
    assert said.endswith("page: docs/guide/import-repairs.md\n")
    assert "Generated by" not in simspec("help", "contact.friction.impact").stdout


def test_the_help_fits_in_80_columns_and_is_whole():
    lines = cli.help_text().splitlines()
    assert max(map(len, lines)) <= 80
    assert not any(line.endswith("...") for line in lines[1:])


def test_scenarios_whose_meshes_cannot_be_read_here_are_listed_with_the_extra(monkeypatch):
    from simspec.meshes import load

    monkeypatch.setattr(load, "not_installed", lambda: ["trimesh"])
    monkeypatch.setattr(load, "read", lambda name: None)
    monkeypatch.setattr(load, "_remembered", {})
    found = data("list")
    assert found.keys() == library().keys()
    assert "pip install 'simspec-physics[meshes]'" in found["coupled-gripper"]["not_read"]
    assert found["double-pendulum"]["not_read"] == ""


def test_the_scenarios_of_the_library_are_listed_with_their_engines():
    lines = simspec("list").stdout.splitlines()
    found = data("list")
    assert found.keys() == library().keys()
    assert all(any(line.startswith(f"{name}:") for line in lines) for name in found)
    tumbling = found["tumbling-body"]
    assert {"mujoco", "rapier"} <= set(tumbling["engines"])
    assert "constraint.loop" in found["four-bar-push"]["refused"]["rapier"]
    compiled = compile_world(load(str(tumbling["file"])).resolve(), tumbling["engines"])
    assert list(compiled) == tumbling["engines"]


def test_an_expectation_that_fails_is_exit_1(folder):
    (folder / "high.yaml").write_text(FALL.replace("-0.0495", "0.5"))
    found = data("run", "high.yaml", "--engine", "mujoco", "--no-verify", "--no-repeats", code=1)
    (outcome,) = found["runs"]["mujoco"]["expectations"]
    assert outcome["passed"] is False


def results(folder, name: str) -> dict[str, bytes]:
    place = folder / "runs" / "fall" / name
    return {path.name: path.read_bytes() for path in place.iterdir()}


def test_results_of_other_engines_stay(folder):
    options = ("--no-repeats", "--engine")
    simspec("run", "fall.yaml", *options, "mujoco", "--engine", "dart")
    before = results(folder, "dart")
    found = data("run", "fall.yaml", *options, "mujoco")
    assert found["notes"] == []
    assert results(folder, "dart") == before
    # of the same world: the report and the certificate tell of both
    place = folder / "runs" / "fall"
    report = json.loads((place / "report.json").read_text())
    assert set(report["runs"]) == {"mujoco", "dart"}
    assert report["other_runs"] == {"dart": {"same_world": True}}
    assert set(json.loads((place / "certificate.json").read_text())["engines"]) == {"mujoco", "dart"}
    # of another world: they stay, and are named as such
    found = data("run", "fall.yaml", *options, "mujoco", "--no-verify", "--set", "bodies.ball.mass=2")
    assert any("dart" in note and "another world" in note for note in found["notes"])
    assert any("certificate.json" in note and "another world" in note for note in found["notes"])
    assert results(folder, "dart") == before
    report = json.loads((place / "report.json").read_text())
    assert set(report["runs"]) == {"mujoco"}
    assert report["other_runs"] == {"dart": {"same_world": False}}
    assert not (place / "certificate.json").exists()


def test_each_run_is_saved_as_it_ends(folder, monkeypatch):
    from simspec.comparison import study

    real = study.run_case

    def first_alone(case, **more):
        if case.engine == "dart":
            raise RuntimeError("not foreseen")
        return real(case, **more)

    monkeypatch.setattr(study, "run_case", first_alone)
    with pytest.raises(RuntimeError):
        simspec("run", "fall.yaml", "--engine", "mujoco", "--engine", "dart", "--no-repeats")
    place = folder / "runs" / "fall"
    assert {"compiled", "mujoco", "certificate.json"} <= {path.name for path in place.iterdir()}
    assert load_run(place / "mujoco").failed is None


def test_a_missing_engine(folder, monkeypatch):
    monkeypatch.setattr(engines()["dart"], "version", classmethod(lambda cls: None))
    found = data("run", "fall.yaml", "--engine", "mujoco", "--engine", "dart", code=3)
    assert found["error"]["engine"] == "dart"
    assert "pip install 'simspec-physics[dart]'" in found["error"]["message"]
    assert not (folder / "runs").exists()
    words = ("run", "fall.yaml", "--engine", "mujoco", "--engine", "dart", "--keep-going", "--no-repeats")
    found = data(*words, code=3)
    assert found["runs"]["mujoco"]["failed"] is None
    assert "not installed" in found["runs"]["dart"]["failed"]
    assert "not installed" in simspec(*words, code=3).output


def test_an_engine_that_hangs_is_that_runs_result(folder):
    long = ("--set", "physics.duration=100000 s", "--set", "record.every=1000 s", "--deadline", "3")
    words = ("run", "fall.yaml", "--engine", "mujoco", *long, "--no-verify", "--no-repeats")
    found = data(*words, code=3)
    assert "deadline of 3 s" in found["runs"]["mujoco"]["failed"]
    assert found["runs"]["mujoco"]["expectations"][0]["passed"] is False


def test_diff_of_two_specs_is_about_their_meaning(folder):
    (folder / "same.yaml").write_text("# other text\n" + FALL.replace("1 ms", "0.001"))
    assert "no differences" in simspec("diff", "fall.yaml", "same.yaml").output
    (folder / "other.yaml").write_text(FALL.replace("mass: 1,", "mass: 1.5,"))
    (change,) = data("diff", "fall.yaml", "other.yaml", code=1)["changes"]
    assert change == {"path": "bodies.ball.inertial.mass", "kind": "changed", "before": 1.0, "after": 1.5, "joint": ""}


def test_diff_wants_two_of_a_kind(folder):
    (folder / "runs").mkdir()
    assert "two run folders, or two specs" in simspec("diff", "runs", "fall.yaml", code=2).stderr
    assert "not a saved run" in simspec("diff", "runs", "runs", code=2).stderr


# --- engines ----------------------------------------------------------------------------------------------------------------


def test_engines(folder):
    found = data("engines")["engines"]
    assert set(found) == set(engines())
    text = simspec("engines").output
    assert all(name in text for name in found)
    simspec("engines", "--markdown", "--check", code=1)
    simspec("engines", "--markdown")
    simspec("engines", "--markdown", "--check")
    assert (folder / "docs" / "reference" / "support-matrix.md").is_file()


PROJECT = """\
default-engines = ["dart", "{label}"]
[engines."{label}"]
python = "here/python"
[engines."mujoco@2"]
python = "nothing/python"
"""


@pytest.fixture
def project(folder, monkeypatch):
    """A project whose file names a second label of DART, in a way from the file to this interpreter; the label."""
    label = f"dart@{engines()['dart'].version()}"
    (folder / "here").mkdir()
    # not a link: a virtual environment is found by the name that its interpreter is started by
    (folder / "here" / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (folder / "here" / "python").chmod(0o755)
    (folder / "simspec.toml").write_text(PROJECT.format(label=label))
    (folder / "below").mkdir()
    monkeypatch.chdir(folder / "below")
    monkeypatch.setenv("XDG_DATA_HOME", str(folder.parent / "data"))
    simspec("trust")
    return label


def test_engines_of_the_project_file(project, folder):
    answer = data("engines")
    assert answer["project"] == str(folder / "simspec.toml")
    rows = {instance["label"]: instance for instance in answer["instances"]}
    assert rows[project]["version"] is None, "a list starts no interpreter of a project file"
    assert rows[project]["problem"] == f"not queried; simspec engines doctor {project} starts it"
    assert project in simspec("engines").output
    found = data("engines", "doctor", project)["engines"][project]
    assert (found["version"], found["python"]) == (engines()["dart"].version(), str(folder / "here" / "python"))
    assert "cannot be started" in str(data("engines", "doctor", "mujoco@2", code=3)["engines"]["mujoco@2"]["problems"])


def test_two_labels_of_the_project_file_at_work(project, folder):
    study = data("run", "../fall.yaml", "--no-repeats", "--no-verify")
    assert set(study["runs"]) == {"dart", project}
    assert len(study["diffs"]) == 1
    assert set(data("verify", "../fall.yaml", "--engine", "mujoco")["certificate"]["engines"]) == {"mujoco"}
    quick = {name for name in INSTALLED if not engines()[name].COMPILING}
    assert set(data("run", "../fall.yaml", "--no-repeats", "--no-verify", "--all-engines")["runs"]) == quick


def test_the_command_line_comes_before_the_project_file(project, folder):
    (folder / "here" / "python").write_text("#!/bin/sh\nexit 3\n")
    assert project in simspec("run", "../fall.yaml", "--no-repeats", "--no-verify", code=3).output
    simspec("run", "../fall.yaml", "--no-repeats", "--no-verify", "--python", f"{project}={sys.executable}")
    simspec("run", "../fall.yaml", "--no-repeats", "--no-verify", "--engine", f"{project}={sys.executable}")


def test_a_bad_project_file_is_an_error_of_the_command(project, folder):
    (folder / "simspec.toml").write_text("\ndefault-engine = ['dart']\n")
    for words in (("check", "../fall.yaml"), ("compile", "../fall.yaml"), ("engines",), ("verify", "../fall.yaml")):
        answer = data(*words, code=2)
        assert answer["error"]["problems"][0]["location"]["line"] == 2
    simspec("new", "other")


def test_the_library_is_known_by_name(folder):
    names = [path.stem for path in resource_folder("specs").glob("*.yaml")]
    simspec("check", *names)
