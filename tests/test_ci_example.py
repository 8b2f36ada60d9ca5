"""The workflow of docs/guide/ci.md: each of its steps is run as the CI system runs it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from lxml import etree
from ruamel.yaml import YAML

from simspec import cli
from simspec.errors import EXIT_OK
from tests.command_lines import FALL

ROOT = Path(__file__).resolve().parent.parent
WORKFLOW = YAML(typ="safe").load(ROOT / "docs" / "examples" / "github-workflow.yml")
JOB = WORKFLOW["jobs"]["simspec"]
INSTALL, CHECK, VERIFY, RUN = (step for step in JOB["steps"] if "run" in step)


class Clone:
    """A checked-out repository in which a job runs."""

    def __init__(self, folder: Path):
        self.folder, self.step_summary = folder, folder / "step-summary"
        (folder / "specs").mkdir()
        self.spec = folder / "specs" / "fall.yaml"
        self.spec.write_text(FALL)

    def step(self, step: dict[str, str]) -> subprocess.CompletedProcess[str]:
        """Run a step; its own summary is an empty file before."""
        self.step_summary.write_text("")
        environment = {
            **os.environ,
            **WORKFLOW["env"],
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "PIP_NO_INDEX": "1",
            "GITHUB_WORKSPACE": str(self.folder),
            "GITHUB_STEP_SUMMARY": str(self.step_summary),
        }
        return subprocess.run(
            ["bash", "-e", "-o", "pipefail", "-c", step["run"]],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )


@pytest.fixture
def clone(tmp_path):
    return Clone(tmp_path)


def test_the_job_keeps_what_its_steps_write_and_names_every_action_by_version():
    (kept,) = (step for step in JOB["steps"] if "upload-artifact" in step.get("uses", ""))
    assert kept["with"]["path"].split() == ["reports/", "runs/"]
    assert kept["if"] == "always()"
    assert all(re.search(r"@v\d+$", step["uses"]) for step in JOB["steps"] if "uses" in step)
    assert WORKFLOW["permissions"] == {"contents": "read"}


def test_the_install_step_names_existing_extras(clone):
    done = clone.step(INSTALL)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "does not provide the extra" not in done.stderr


def test_every_step_passes_then_keeps_to_the_baseline_then_sees_a_change(clone, monkeypatch, warm_engines):
    for step in (CHECK, VERIFY, RUN):
        done = clone.step(step)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "no baseline yet" in done.stdout
    for name in ("verify", "run"):
        suites = etree.parse(clone.folder / "reports" / f"fall-{name}.xml").getroot()
        assert suites.get("errors") == suites.get("failures") == "0"
        assert int(suites.get("tests")) > 2
    assert clone.step_summary.read_text().splitlines()[1] == "## simspec: fall: passed"
    assert (clone.folder / "runs" / "fall" / "report.html").is_file()

    monkeypatch.chdir(clone.folder)
    words = "--no-verify --write-baseline baselines/fall.json --timed-runs 0"
    assert cli.main(["run", "specs/fall.yaml", *WORKFLOW["env"]["ENGINES"].split(), *words.split()]) == EXIT_OK
    clone.spec.write_text(FALL.replace("timestep: 1 ms", "timestep: 2 ms"))
    done = clone.step({"run": RUN["run"].replace("--report", "--timed-runs 0")})
    assert done.returncode == 1
    assert "Regressed" in done.stdout
    assert "::error title=baseline%3A mujoco/ball/" in done.stdout
    assert "### Baseline" in clone.step_summary.read_text()


def test_a_wrong_spec_fails_each_step_at_its_line(clone):
    clone.spec.write_text(FALL.replace("mass: 1", "mas: 1"))
    assert clone.step(CHECK).returncode != 0
    done = clone.step(VERIFY)
    assert done.returncode == 1
    assert "::error file=specs/fall.yaml,line=" in done.stdout
    assert etree.parse(clone.folder / "reports" / "fall-verify.xml").getroot().get("errors") != "0"
    assert "fall.yaml: failed" in clone.step_summary.read_text()
