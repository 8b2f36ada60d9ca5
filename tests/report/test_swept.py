"""A sweep as suites of a test report, and the options of ``simspec sweep`` that write it."""

from __future__ import annotations

import dataclasses

import pytest
from lxml import etree

from simspec import cli
from simspec.errors import EXIT_FAILED, EXIT_WRONG
from simspec.experiments.index import RunRow
from simspec.experiments.plan import Cell
from simspec.experiments.sweep import SweepOutcome
from simspec.report import tested
from simspec.report.tested import Status

pytestmark = pytest.mark.usefixtures("warm_engines")

SPEC = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 20 ms}
bodies:
  ball: {mass: 1, inertia: {principal: [0.01, 0.01, 0.01]}, pose: {xyz: [0, 0, 1]}}
record: {every: 10 ms}
expect:
  - displacement: {body: ball, xyz: [0, 0, 0], tolerance: 2.1 mm}
sweep:
  engines: [mujoco]
  over: {physics.timestep: [1 ms, 5 ms]}
"""


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    (tmp_path / "fall.yaml").write_text(SPEC)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    return tmp_path


def call(*words: str) -> int:
    try:
        return cli.main(["sweep", "fall.yaml", "--no-verify", *words])
    except SystemExit as end:
        return int(end.code or 0)


def test_each_run_is_an_entry_and_a_sweep_may_be_reported_again(place, capsys):
    reports = ("--junit", "out.xml", "--summary", "out.md", "--annotations")
    assert call(*reports) == EXIT_FAILED
    said = capsys.readouterr().out
    assert said.count("::error file=fall.yaml,line=") == 1
    first = (place / "out.xml").read_text()
    (suite,) = etree.fromstring(first.encode())
    assert [case.get("name") for case in suite] == ["run 1, physics.timestep=1 ms", "run 2, physics.timestep=5 ms"]
    assert suite[1].find("failure").get("message") == "1 of 1 expectations are not met"
    assert "## simspec: fall: failed" in (place / "out.md").read_text()
    assert call(*reports) == EXIT_FAILED  # nothing is run again
    assert (place / "out.xml").read_text() == first


def test_a_wrong_value_is_an_error_of_the_report(place):
    words = ("--set", "sweep.over={physics.timestep: [1 ms, 3 ms]}", "--junit", "out.xml")
    assert call(*words) == EXIT_WRONG
    assert etree.parse("out.xml").findall(".//error")


def test_an_unwritable_report_is_an_error_before_any_work(place, capsys):
    assert call("--junit", "fall.yaml") == EXIT_WRONG
    assert "simspec did not write it" in capsys.readouterr().err
    assert call("--dry-run", "--junit", "out.xml") == EXIT_WRONG
    assert "--dry-run" in capsys.readouterr().err
    assert [path.name for path in place.iterdir()] == ["fall.yaml"]


def test_of_very_many_runs_the_others_are_counted(monkeypatch):
    cells = [cell(number) for number in range(7)]
    monkeypatch.setattr(tested, "MOST_ENTRIES", 3)
    (suite,) = tested.sweep_suites(outcome(), [(cell, None) for cell in cells], lambda path: None)
    assert [cell.name for cell in suite.entries] == ["run 1", "run 2", "run 3", "4 more runs"]
    assert suite.count(Status.SKIPPED) == 4
    assert suite.entries[0].message == "it died 5 times"


def test_an_entry_has_the_seconds_of_its_process():
    about = ("key", "", "", "", "", "", "fall", "first", "1.0")
    run = (0.001, 20, 0.5, 0.25, 2.5, 0.0, None, 0, "")
    rows = [
        RunRow(*about, failed, *run, passed, 2, 0, "{}") for failed, passed in ((None, 2), (None, 1), ("it fell", 0))
    ]
    rows.append(dataclasses.replace(rows[0], process_seconds=None))
    (suite,) = tested.sweep_suites(outcome(), list(zip(map(cell, range(4)), rows, strict=True)), lambda path: None)
    assert [entry.status for entry in suite.entries] == [Status.PASSED, Status.FAILED, Status.ERROR, Status.PASSED]
    assert [entry.seconds for entry in suite.entries] == [2.5, 2.5, 2.5, 0.0]


def cell(number: int) -> Cell:
    return Cell(number, "first", None, (), None, 0, 0.0, None, "0" * 64)


def outcome() -> SweepOutcome:
    plan = type("Plan", (), {"spec": type("Spec", (), {"name": "fall"})()})()
    return SweepOutcome(plan, None, stopped={"first": "it died 5 times"})
