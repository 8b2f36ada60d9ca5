"""Plausibility findings of `simspec check` and `simspec audit`: their text, number of lines, and exit codes."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from simspec import cli
from simspec.plausibility.findings import RULES, Grade, Plausibility, PlausibilityFinding, Sampling, ordered
from simspec.report.problems import MOST_LINES, WIDTH, plausibility_lines
from tests.plausibility.files import urdf

RUNNER = CliRunner()


@pytest.fixture
def slipped(tmp_path, monkeypatch):
    """A robot file with a slip, and with a note."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(urdf(centre="0 0 -0.05", axis="0 2 0"), encoding="utf-8")
    (tmp_path / "sound.urdf").write_text(urdf(), encoding="utf-8")
    (tmp_path / "noted.urdf").write_text(urdf(axis="0 2 0"), encoding="utf-8")
    return "arm.urdf"


def run(*words: str):
    return RUNNER.invoke(cli.app, words)


def test_a_line_for_each_rule_after_the_verdict(slipped):
    result = run("check", slipped)
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[0].startswith("arm.urdf: ok, 3 bodies")
    assert lines[1] == "plausibility: 1 warning, 1 note"
    assert lines[2] == "  warning mass-outside: 50 mm, arm, line 7"
    assert lines[3] == "  note axis-length: 2 times, shoulder, line 17"
    assert len(lines) == 4


def test_a_sound_model_has_no_line_more(slipped):
    assert len(run("check", "sound.urdf").stdout.splitlines()) == 1


def test_strict_fails_for_warnings_alone(slipped):
    result = run("check", slipped, "--strict")
    assert result.exit_code == 2
    assert "arm.urdf:7:" in result.output
    assert "implausible (mass-outside): arm" in result.output
    assert RULES["mass-outside"].hint[:40] in result.output
    assert run("check", "noted.urdf", "--strict").exit_code == 0


def test_verbose_has_each_with_its_place_and_the_way_out(slipped):
    text = run("check", slipped, "-v").stdout
    assert f"warning mass-outside: {RULES['mass-outside'].why}; way out: {RULES['mass-outside'].hint}" in text
    assert "arm.urdf:7:" in text
    assert "centre of mass 50 mm outside its shapes" in text


def test_json_has_everything(slipped):
    data = json.loads(run("check", slipped, "--json").stdout)["specs"][0]["plausibility"]
    first = data["findings"][0]
    assert (first["rule"], first["grade"], first["element"], first["unit"]) == ("mass-outside", "warning", "arm", "m")
    assert first["value"] == pytest.approx(0.05, rel=1e-3)
    assert first["location"]["line"] == 7
    assert {"limit", "why", "hint", "positions", "severity"} <= first.keys()
    assert data["sampling"]["positions"] == data["sampling"]["planned"] > 100


def test_lines_are_bounded():
    finding = PlausibilityFinding("mass-outside", Grade.WARNING, "a" * 200, "m" * 200, 0.05, "m", 2.0)
    import dataclasses

    many = [
        dataclasses.replace(finding, rule=rule, element=f"{index} {'a' * 90}") for rule in RULES for index in range(3)
    ]
    found = Plausibility(ordered(many), Sampling(10, 20, 2, {"j" * 5: "why"}, "cut"))
    lines = plausibility_lines(found)
    assert len(lines) == 1 + MOST_LINES + 1 + 2
    assert all(len(line) <= WIDTH for line in lines)
    assert all(line.endswith("; and 2 more") for line in lines[1 : 1 + MOST_LINES])
    left = len(RULES) - MOST_LINES
    assert f"  and {3 * left} findings of {left} more rules (-v)" in lines
    assert "10 of 20 positions" in "".join(lines)
    lines = plausibility_lines(found, verbose=True)
    assert sum(line.startswith("    ") for line in lines) == len(many)
    fewer = plausibility_lines(found, verbose=True, warned=True)
    assert not any(rule.warned and f" {code}:" in "".join(fewer) for code, rule in RULES.items())
