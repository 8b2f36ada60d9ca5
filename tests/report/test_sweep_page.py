"""The page of a sweep: axes, curves and verdict computed from its cases, and the page that the command writes from a store."""

from __future__ import annotations

import dataclasses
import json

import pytest

from simspec import cli
from simspec.errors import EXIT_OK
from simspec.experiments.index import RunRow
from simspec.report.page.sentences import Sentence
from simspec.report.screen import PAGE_FILE
from simspec.report.study.sweeps import MOST_CURVES, SPEED, SweptCase, axes, charts, verdict
from simspec.report.table import BAD, GOOD, PLAIN

SPEC = """\
simspec: 1
name: fall
physics: {timestep: 1 ms, duration: 10 ms}
bodies:
  ball: {mass: 1, inertia: {principal: [0.01, 0.01, 0.01]}, pose: {xyz: [0, 0, 1]}}
record: {every: 5 ms}
expect:
  - displacement: {body: ball, xyz: [0, 0, 0], tolerance: 0.6 mm}
sweep:
  engines: [mujoco]
  over: {physics.timestep: [1 ms, 5 ms]}
"""
ROW = RunRow(
    *("key", "cell", "", "world", "", "", "fall", "first", "1.0", None, 0.001, 1000, 0.5, 0.5, 1.0, 0.0, None, 0),
    *("", 1, 1, 100, "{}"),
)  # fmt: skip


def case(engine: str, energy: float, *values, failed: str | None = None, speed: float = 2.0) -> SweptCase:
    row = dataclasses.replace(
        ROW, engine=engine, failed=failed, step_seconds=1.0 / speed, summary=json.dumps({"energy at the end": energy})
    )
    return SweptCase(engine, None, tuple(values), row)


def some(engines=("first", "second"), masses=("1 kg", "2 kg"), timesteps=("1 ms", "500 us")):
    return [
        case(engine, 10.0 * number + place, ("physics.timestep", timestep), ("bodies.ball.mass", mass))
        for number, engine in enumerate(engines)
        for place, mass in enumerate(masses)
        for timestep in timesteps
    ]


def test_values_of_the_same_unit_are_places_of_an_axis_and_others_are_converted():
    timestep, mass = axes(some())
    assert (mass.label, mass.unit, sorted(mass.places.values())) == ("mass", "kg", [1.0, 2.0])
    assert (timestep.label, timestep.unit, sorted(timestep.places.values())) == ("timestep", "", [0.0005, 0.001])
    words = [case("first", 1.0, ("cone", cone)) for cone in ("pyramid", "elliptic")]
    assert axes(words) == []


def test_each_engine_and_set_of_other_values_is_a_curve():
    found = {chart["title"]: chart for chart in charts(some())}
    assert list(found) == ["Energy at the end over timestep", "Energy at the end over mass"]
    chart = found["Energy at the end over mass"]
    assert [series["label"] for series in chart["series"]] == [
        *("first, timestep 1 ms", "first, timestep 500 us", "second, timestep 1 ms", "second, timestep 500 us"),
    ]
    assert [series["colour"] for series in chart["series"]] == [0, 0, 1, 1]
    assert [(mark["x"], mark["value"]) for mark in chart["series"][2]["marks"]] == [(1.0, 10.0), (2.0, 11.0)]


def test_with_too_many_curves_each_engine_has_a_single_curve():
    masses = tuple(f"{number} kg" for number in range(1, MOST_CURVES))
    chart = charts(some(masses=masses))[0]
    assert [series["label"] for series in chart["series"]] == ["first", "second"]
    assert chart["series"][0]["marks"][0] == {
        "x": 0.0005, "value": 3.0, "low": None, "high": None, "values": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
    }  # fmt: skip


def test_the_verdict_has_at_most_five_sentences():
    proofs = Sentence(GOOD, "Models: all proven equal to those of the spec.")
    cases = [*some(), case("second", 0.0, ("bodies.ball.mass", "3 kg"), failed="it crashed")]
    said = [(sentence.tone, sentence.text) for sentence in verdict(cases, [], proofs)]
    assert said == [
        (BAD, "9 runs of 0 sets of values in first and second; 1 failed: second: it crashed."),
        (GOOD, "Models: all proven equal to those of the spec."),
        (GOOD, "Expectations: 9 of 9 met."),
        (PLAIN, "The engines differ most in energy at the end (timestep 1 ms, mass 1 kg): first 0 J, second 10 J."),
        (PLAIN, "Speed (median): first 2, second 2 × real time."),
    ]
    assert SPEED in cases[0].figures
    assert cases[-1].figures == {}


@pytest.mark.usefixtures("warm_engines")
def test_a_sweep_has_a_page_of_its_store(tmp_path, monkeypatch, capsys):
    (tmp_path / "fall.yaml").write_text(SPEC)
    monkeypatch.chdir(tmp_path)
    cli.main(["sweep", "fall.yaml", "--no-verify"])
    capsys.readouterr()
    assert cli.main(["report", "runs/fall"]) == EXIT_OK
    page = (tmp_path / "runs" / "fall" / PAGE_FILE).read_text()
    assert "2 runs of 2 sets of values in mujoco; none failed." in page
    assert "Models: 0 of 2 runs are proven to have the spec&#39;s model." in page
    assert "Expectations: 1 of 2 met." in page
    assert cli.main(["report", "runs/fall/sweep"]) == EXIT_OK
    assert (tmp_path / "runs" / "fall" / "sweep" / PAGE_FILE).read_text() == page
