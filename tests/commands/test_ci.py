"""``--junit``, ``--annotations``, ``--summary``, ``--github`` and ``--baseline``: written files, exit codes, and
refusals."""

from __future__ import annotations

import json

import pytest
from lxml import etree

from simspec import cli
from simspec.commands import run as baseline_command
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, EXIT_WRONG
from simspec.report.tested import LARGEST

pytestmark = pytest.mark.usefixtures("warm_engines")

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
RUN = ("run", "fall.yaml", "-e", "mujoco", "--no-verify")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    monkeypatch.delenv("GITHUB_WORKSPACE", raising=False)
    (tmp_path / "fall.yaml").write_text(FALL)
    return tmp_path


def call(*words: object) -> int:
    try:
        return cli.main([str(word) for word in words])
    except SystemExit as end:
        return int(end.code or 0)


def test_verify_and_run_write_the_requested_reports(folder, capsys):
    reports = ("--junit", "out.xml", "--summary", "out.md", "--annotations")
    assert call("verify", "fall.yaml", "-e", "mujoco", *reports) == EXIT_OK
    suite = etree.parse("out.xml").getroot()[0]
    assert suite.get("name") == "fall / mujoco"
    assert len(suite) > 4
    assert call(*RUN, "--no-repeats", *reports, "--set", "expect.0.displacement.tolerance=1e-6") == EXIT_FAILED
    out = capsys.readouterr().out
    assert "::error file=fall.yaml,line=8," in out
    assert len(etree.parse("out.xml").findall(".//failure")) == 1  # the files are replaced
    assert (folder / "out.md").read_text().splitlines()[1] == "## simspec: fall: failed"


def test_with_json_annotations_are_on_standard_error(capsys):
    code = call(*RUN, "--no-repeats", "--annotations", "--json", "--set", "expect.0.displacement.tolerance=1e-6")
    said = capsys.readouterr()
    assert code == json.loads(said.out)["exit_code"] == EXIT_FAILED
    assert said.err.startswith("::error file=fall.yaml")


def test_an_error_in_the_spec_is_reported_with_its_line(folder, capsys):
    (folder / "fall.yaml").write_text(FALL.replace("mass: 1", "mas: 1"))
    assert call("verify", "fall.yaml", "--junit", "out.xml", "--annotations") == EXIT_WRONG
    assert capsys.readouterr().out.startswith("::error file=fall.yaml,line=5,")
    assert len(etree.parse("out.xml").findall(".//error")) >= 1


def test_an_engine_that_is_not_there_is_reported(capsys):
    assert call("verify", "fall.yaml", "-e", "mujoco@0.1", "--junit", "out.xml") in (EXIT_WRONG, EXIT_ENGINE)


def test_the_step_summary_is_added_to(folder, monkeypatch, capsys):
    step = folder / "step.md"
    step.write_text("before\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(step))
    assert call("verify", "fall.yaml", "-e", "mujoco", "--github") == EXIT_OK
    once = step.read_text()
    assert once.startswith("before\n<!-- simspec summary -->\n## simspec: fall: passed")
    assert call("verify", "fall.yaml", "-e", "mujoco", "--summary", step) == EXIT_OK
    assert step.read_text() == once + once.removeprefix("before\n")
    step.write_text("x" * (LARGEST - 100))
    assert call("verify", "fall.yaml", "-e", "mujoco", "--github") == EXIT_OK
    assert "no room" in capsys.readouterr().err
    assert step.stat().st_size == LARGEST - 100


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("verify", "fall.yaml", "--github"), "GITHUB_STEP_SUMMARY is not set"),
        (("verify", "--self-test", "--annotations"), "require SPEC"),
        (("verify", "fall.yaml", "--junit", "fall.yaml"), "simspec did not write it"),
        (("verify", "fall.yaml", "--summary", "fall.yaml"), "simspec did not write it"),
        ((*RUN, "--write-baseline", "fall.yaml"), "simspec did not write it"),
        ((*RUN, "--baseline", "fall.yaml"), "fall.yaml"),
        ((*RUN, "--baseline", "b.json", "--no-repeats"), "--no-repeats does not measure"),
    ],
)
def test_impossible_options_are_refused_before_any_work(folder, capsys, words, message):
    assert call(*words) == EXIT_WRONG
    assert message in capsys.readouterr().err
    assert (folder / "fall.yaml").read_text() == FALL
    assert sorted(path.name for path in folder.iterdir()) == ["fall.yaml"]


def test_a_baseline_is_written_kept_to_and_not_replaced_by_what_regressed(folder, capsys):
    both = ("--baseline", "b.json", "--write-baseline", "b.json", "--timed-runs", "0")
    assert call(*RUN, *both) == EXIT_OK
    said = capsys.readouterr().out
    assert "no baseline yet" in said
    assert "baseline written: b.json" in said
    first = (folder / "b.json").read_text()
    assert call(*RUN, *both, "--summary", "out.md", "--junit", "out.xml") == EXIT_OK
    assert "none regressed" in (folder / "out.md").read_text()
    assert (folder / "b.json").read_text() == first
    wrong = (*RUN, "--set", "physics.gravity=[0, 0, -9.8]")
    assert call(*wrong, *both, "--junit", "out.xml") == EXIT_FAILED
    said = capsys.readouterr().out
    assert "Regressed" in said
    assert "kept, as this run regressed" in said
    assert (folder / "b.json").read_text() == first
    assert len(etree.parse("out.xml").findall(".//testsuite[@name='fall / baseline']//failure")) > 3
    assert call(*wrong, "--write-baseline", "b.json", "--timed-runs", "0") == EXIT_OK
    assert (folder / "b.json").read_text() != first


def test_speed_is_measured_for_a_baseline(folder, capsys):
    assert call(*RUN, "--write-baseline", "b.json", "--timed-runs", "3", "--json") == EXIT_OK
    said = json.loads(capsys.readouterr().out)["baseline"]
    assert said["written"] == "b.json"
    assert said["comparison"] is None
    figures = {figure["key"]: figure for figure in json.loads((folder / "b.json").read_text())["figures"]}
    speed = figures["mujoco/speed by processor time"]
    assert speed["interval"][0][0] <= speed["value"][0] <= speed["interval"][0][1]


def test_engines_are_timed_only_where_their_speed_is_compared_or_kept(monkeypatch, capsys):
    requested = []
    monkeypatch.setattr(baseline_command, "timed_runs", lambda cases, repeats, **_: requested.append(repeats) or [])
    assert call(*RUN, "--baseline", "b.json") == EXIT_OK
    assert call(*RUN, "--write-baseline", "b.json", "--timed-runs", "0") == EXIT_OK
    assert call(*RUN, "--baseline", "b.json") == EXIT_OK
    assert requested == []
    assert call(*RUN, "--write-baseline", "b.json", "--timed-runs", "4") == EXIT_OK
    assert requested == [4]
