"""``simspec bisect``: the version that changed a figure, and every error of a request."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from simspec import cli
from simspec.commands import explain as command
from simspec.engines.kit import environments as released
from simspec.engines.kit.registry import find_engine
from simspec.errors import EngineError
from simspec.experiments.bisect import Reading
from tests.files import program
from tests.nightly import nightly

RELEASED = ["3.3.6", "3.3.7", "3.4.0", "3.5.0"]
DEPTH = {"3.3.6": 0.2155e-3, "3.3.7": 0.2155e-3, "3.4.0": 0.1078e-3, "3.5.0": 0.1078e-3}
ENDS = ("--from", "3.3.6", "--to", "3.5.0")
WORDS = ("box-on-box", "--engine", "mujoco", "--figure", "displacement", "--no-verify")


@pytest.fixture
def calls(tmp_path, monkeypatch):
    """The index has ``RELEASED``; a version's figure is in ``DEPTH``, and no engine is started. Yields the installed
    and the measured versions."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    calls: dict[str, list[str]] = {"installed": [], "measured": []}
    monkeypatch.setattr(released, "_listed", lambda engine, package: RELEASED if package == "mujoco" else [])

    def installed(label, yes):
        calls["installed"].append(label.label)
        return "/environment/python"

    def measure(self, version):
        self.provide(f"{self.engine}@{version}")
        calls["measured"].append(version)
        if version not in DEPTH:
            raise EngineError(f"mujoco@{version}", "fails")
        return Reading(version, DEPTH[version], "m", 3e-8, 4.5e-8)

    monkeypatch.setattr(command, "installed_version", installed)
    monkeypatch.setattr(command.Versions, "__call__", measure)
    return calls


def test_the_version_is_named_with_both_values(calls, capsys):
    assert cli.main(["bisect", *WORDS, *ENDS]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "mujoco 3.4.0 changed expectation 1 displacement"
    assert lines[1].split() == ["3.3.7", "0.2155", "mm,", "noise", "0.03", "µm"]
    assert lines[2].split()[:3] == ["3.4.0", "0.1078", "mm,"]
    assert lines[3].strip() == "change -0.1077 mm (-50.0%)"
    assert lines[-1] == "look further: simspec explain box-on-box --engine mujoco@3.3.7 --engine mujoco@3.4.0"
    assert all(len(line) <= 80 for line in lines[:-1])
    assert calls["measured"] == ["3.3.6", "3.5.0", "3.3.7", "3.4.0"]
    assert set(calls["installed"]) == {f"mujoco@{version}" for version in RELEASED}


def test_json_has_everything(calls, capsys):
    assert cli.main(["bisect", *WORDS, *ENDS, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["changed_in"], content["found"], content["exit_code"]) == ("3.4.0", True, 0)
    assert content["before"] == {
        "version": "3.3.7",
        "value": 0.2155e-3,
        "unit": "m",
        "noise": 3e-8,
        "half_width": 4.5e-8,
        "stored": False,
    }
    assert list(content["measured"]) == content["versions"] == RELEASED


def test_no_change_is_exit_code_1(calls, capsys):
    assert cli.main(["bisect", *WORDS, "--from", "3.4.0", "--to", "3.5.0"]) == 1
    out = capsys.readouterr().out
    assert out.startswith("expectation 1 displacement does not change from mujoco 3.4.0 to 3.5.0\n")
    assert "within noise" in out
    assert "look further" not in out


def test_versions_may_be_given_without_the_index(calls, monkeypatch, capsys):
    def never(engine, package):
        raise AssertionError("the index is not needed")

    monkeypatch.setattr(released, "_listed", never)
    assert cli.main(["bisect", *WORDS, *ENDS, "--versions", "3.4.0, 3.3.8", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["versions"] == ["3.3.6", "3.3.8", "3.4.0", "3.5.0"]
    assert content["not_measured"] == {"3.3.8": "fails"}
    assert (content["changed_in"], content["between"]) == ("3.4.0", ["3.3.8"])
    assert content["before"]["version"] == "3.3.6"


WITHOUT = ("bisect", *WORDS)


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ((*WITHOUT, "--from", "3.4.0", "--to", "3.4"), 2, "--from and --to are the same version, 3.4.0"),
        ((*WITHOUT, "--from", "3.5.0", "--to", "3.3.6"), 2, "--from is younger than --to"),
        ((*WITHOUT, "--from", "3.5.0", "--to", "3.3.6"), 2, "--from 3.3.6 --to 3.5.0"),
        ((*WITHOUT, "--from", "3.3.6", "--to", "3.4.9"), 3, "mujoco@3.4.9: is not a released version"),
        ((*WITHOUT, "--from", "3.3.6", "--to", "3.4.9"), 3, "between 3.3.6 and 3.4.9: 3.3.6, 3.3.7, 3.4.0"),
        ((*WITHOUT, "--from", "3.x", "--to", "3.4.0"), 3, "'3.x' is not a version that pip knows"),
        ((*WITHOUT, "--from", "3.2.7", "--to", "3.4.0"), 3, "reads the files that simspec writes from 3.3.6 on"),
        ((*WITHOUT, *ENDS, "--versions", "3.4.0,3.9.0"), 2, "not between --from and --to"),
        ((*WITHOUT, *ENDS, "--versions", "3.4.0,new"), 3, "'new' is not a version that pip knows"),
        ((*WITHOUT, *ENDS, "--figure", "depht"), 2, "has a figure 'depht'"),
        ((*WITHOUT, *ENDS, "--engine", "dart"), 2, "bisect takes one engine"),
        (("bisect", "box-on-box", *ENDS, "--figure", "box.z"), 2, "bisect takes one engine"),
        (("bisect", "box-on-box", *ENDS, "--figure", "box.z", "--engine", "mujoco@3.4"), 2, "said by --from and --to"),
        (("bisect", "box-on-box", *ENDS, "--figure", "box.z", "--engine", "ode"), 3, "comes with the machine"),
        (("bisect", "box-on-box", *ENDS, "--figure", "box.z", "--engine", "nothing"), 3, "no such engine"),
        (("bisect", "no-such-spec", *WORDS[1:], *ENDS), 2, "no-such-spec"),
        (("bisect", "box-on-ramp", *WORDS[1:], "--figure", "rough_box.z", *ENDS), 2, "accept it by name"),
    ],
)
def test_bad_input_is_named_and_nothing_is_written(calls, capsys, tmp_path, words, code, message):
    assert cli.main(list(words)) == code
    assert message in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []
    assert calls == {"installed": [], "measured": []}


def test_unsupported_features_of_the_end_versions_are_accepted_by_name(calls, capsys):
    words = ["bisect", "box-on-ramp", "--engine", "mujoco", "--figure", "rough_box.z", "--no-verify", *ENDS]
    assert cli.main([*words, "--accept", "shape.box", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert "engines.mujoco.accept=[contact.friction.impact, shape.box]" in content["explain"]


def test_a_version_that_is_not_installed_names_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setattr(released, "_listed", lambda engine, package: RELEASED)
    assert cli.main(["bisect", *WORDS, *ENDS]) == 3
    error = capsys.readouterr().err
    assert "mujoco@3.3.6: is not installed: simspec engines install mujoco@3.3.6 --yes, or --yes here" in error
    assert list(tmp_path.iterdir()) == []


def test_a_version_that_cannot_be_installed_says_what_pip_said(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setattr(released, "_listed", lambda engine, package: RELEASED)
    script = """#!/bin/sh
if [ "$3" = venv ]; then mkdir -p "$4/bin" && cp "$0" "$4/bin/python"; exit; fi
echo 'ERROR: No matching distribution found'; exit 1
"""
    monkeypatch.setattr(sys, "executable", str(program(tmp_path / "python", script)))
    assert cli.main(["bisect", *WORDS, *ENDS, "--yes"]) == 3
    error = capsys.readouterr().err
    assert "mujoco@3.3.6: cannot be installed" in error
    assert "ended with code 1: ERROR: No matching distribution found" in error
    assert not Path("runs").exists()


def reachable() -> bool:
    """Whether the package index answers."""
    words = [sys.executable, "-I", "-m", "pip", "index", "versions", "mujoco"]
    return subprocess.run(words, capture_output=True, cwd="/", check=False, timeout=60).returncode == 0


@nightly
def test_the_version_that_changed_how_boxes_touch_is_found(tmp_path, monkeypatch, capsys):
    """Needs the package index: two versions are installed, each in a separate environment. Every commit tests parts of this:
    the search and the command above, with made-up figures; the run and storage of a version
    (``tests/experiments/test_bisect.py``); a second installed version (``tests/engines/test_second_environment.py``)."""
    if not reachable():
        pytest.skip("the package index cannot be reached")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    words = [
        "bisect",
        "box-on-box",
        "--engine",
        "mujoco",
        "--from",
        "3.3.7",
        "--to",
        "3.4.0",
        "--figure",
        "displacement",
    ]
    assert cli.main([*words, "--yes", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["changed_in"] == "3.4.0"
    assert content["before"]["value"] == pytest.approx(0.2155e-3, rel=1e-3)
    assert content["after"]["value"] == pytest.approx(0.1078e-3, rel=1e-3)
    assert any(line.startswith("models: equal") for line in content["models"])
    assert find_engine("mujoco").version() not in content["measured"]
    # nothing is measured twice
    assert cli.main([*words, "--no-verify", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert all(entry["stored"] for entry in again["measured"].values())
    assert again["before"]["value"] == content["before"]["value"]
