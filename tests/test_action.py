"""action.yml: its inputs are used, its actions are pinned, its commands parse, and its steps pass and fail as they should."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from tests.command_lines import FALL, commands, parse

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "action.yml").read_text(encoding="utf-8")
ACTION = YAML(typ="safe").load(TEXT)
STEPS = ACTION["runs"]["steps"]
INSTALL, CHECK, RUN = (step for step in STEPS if "run" in step)
INPUTS = {"specs": "specs/*.yaml", "engines": "mujoco", "arguments": "--quick --no-verify"}


def step(entry: dict, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a step as the service does: its variables are inputs."""
    given = {name: INPUTS[re.search(r"inputs\.([a-z-]+)", value)[1]] for name, value in entry["env"].items()}
    environment = {
        **os.environ,
        **given,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PIP_NO_INDEX": "1",
        "GITHUB_ACTION_PATH": str(ROOT),
        "GITHUB_WORKSPACE": str(folder),
        "GITHUB_STEP_SUMMARY": str(folder / "summary.md"),
    }
    words = ["bash", "--noprofile", "--norc", "-e", "-o", "pipefail", "-c", entry["run"]]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_every_input_is_used_and_described():
    used = set(re.findall(r"inputs\.([a-z-]+)", TEXT))
    assert used == {*ACTION["inputs"]}
    assert all(entry["description"].endswith(".") for entry in ACTION["inputs"].values())
    assert ACTION["runs"]["using"] == "composite"


def test_actions_are_pinned_and_inputs_reach_scripts_as_variables_only():
    actions = [entry["uses"] for entry in STEPS if "uses" in entry]
    assert len(actions) == 2
    assert all(re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40}", action) for action in actions)
    assert not [entry["run"] for entry in STEPS if "${{" in entry.get("run", "")]
    assert all(entry["shell"] == "bash" for entry in STEPS if "run" in entry)


def test_the_commands_of_the_steps_are_commands_of_simspec():
    lines = [line for entry in (INSTALL, CHECK, RUN) for line in commands(entry["run"])]
    assert [line.split()[1] for line in lines] == ["engines", "fmt", "check", "run"]
    for line in lines:
        parse(line)


def test_the_steps_pass_and_report_then_fail_at_a_wrong_expectation(tmp_path):
    pytest.importorskip("mujoco")
    spec = tmp_path / "specs" / "fall.yaml"
    spec.parent.mkdir()
    spec.write_text(FALL)
    for entry in (CHECK, RUN):
        done = step(entry, tmp_path)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "## simspec: fall: passed" in (tmp_path / "summary.md").read_text()
    assert (tmp_path / "reports" / "fall.xml").is_file()
    assert (tmp_path / "runs" / "fall" / "report.html").is_file()
    spec.write_text(FALL.replace("-0.00206", "-0.1"))
    done = step(RUN, tmp_path)
    assert done.returncode == 1
    assert "::error file=specs/fall.yaml,line=" in done.stdout


def test_a_pattern_without_files_is_an_error(tmp_path):
    done = step(CHECK, tmp_path)
    assert done.returncode != 0
    assert "specs/*.yaml: no such file" in done.stderr
