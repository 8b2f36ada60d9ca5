"""Baselines: physics by the engines' noise on any machine, speed on the same one, and what a damaged file is."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from simspec.comparison.floor import Floor
from simspec.comparison.study import Study
from simspec.errors import SpecError
from simspec.experiments.timing import TIMED, Machine
from simspec.report.baseline import (
    Baseline,
    FigureChange,
    baseline_of,
    compare,
    comparison_data,
    comparison_lines,
    comparison_suite,
    is_baseline,
    read_baseline,
    reasons,
)
from simspec.report.tested import Status
from simspec.runner.run import Run
from tests.runner.synthetic import column, free_body, run, world

WORLD = world(free_body("ball"), free_body("cube"), steps=100)
HERE = Machine("A processor", "x86_64", 4, 8, "performance", 16 * 2**30, "Linux 6.1", "CPython 3.11.9")
TOLERANCE = 1e-3


def a_run(moved: float = 0.0, engine: str = "first", turn: float = 1.0) -> Run:
    """Two bodies that drift; ``moved``: along x, of the first; ``turn``: the sign of its quaternion."""
    made = run(WORLD, lambda body, t: column(t + moved * (body == "ball"), 0, 0), engine=engine)
    made.arrays["pose"][:, 0, 3:] *= turn
    return made


def study(
    moved: float = 0.0, noise: float = 1e-9, engine: str = "first", growing: bool = False, **more: float
) -> Study:
    run = a_run(moved, engine, **more)
    flat = np.full(run.arrays["pose"].shape[:2], noise)
    if growing:
        flat *= np.linspace(0.0, 1.0, len(flat))[:, None] ** 8
    floors = {engine: Floor(engine, run.time, flat, flat, True, 1e-15)}
    return Study(WORLD, None, {engine: run}, {engine: (run, run)}, floors, {}, ())


def timed(factors: list[float], engine: str = "first", others: float = 0.0) -> list[Run]:
    """Runs of one second that took 1 / factor."""
    run = a_run(engine=engine)
    return [
        dataclasses.replace(
            run,
            provenance={
                **run.provenance,
                "steps": 100,
                "seconds": {"cpu": 1.0 / factor, "step": 1.0 / factor},
                TIMED: {"core": 0, "others": others, "stolen": 0.0, "machine": {}},
            },
        )
        for factor in factors
    ]


def baseline(of: Study | None = None, runs: list[Run] = (), machine: Machine = HERE) -> Baseline:
    return baseline_of(of or study(), runs, TOLERANCE, machine)


def stored(of: Baseline, folder) -> Baseline:
    path = folder / "baseline.json"
    path.write_text(of.text())
    assert is_baseline(path.read_bytes())
    return read_baseline(path)


def test_a_baseline_is_read_as_written(tmp_path):
    made = baseline(runs=timed([1.0, 1.1, 1.2]))
    assert stored(made, tmp_path) == made
    assert len({key.split("/")[2] for key in made.figures if key.startswith("first/ball/")}) == 5
    found = compare(stored(made, tmp_path), made)
    assert found.compared == len(made.figures) > 20
    assert not found.regressions


@pytest.mark.parametrize(
    ("moved", "noise", "regressed"),
    [
        (1e-12, 1e-9, 0),
        (2.9e-9, 1e-9, 0),
        (3.1e-9, 1e-9, 5),
        (1e-4, 1e-9, 5),
        (1e-4, 1e-4, 0),
        (1e-15, 0.0, 0),
        (1e-9, 0.0, 5),
    ],
)
def test_places_are_compared_by_the_noise_of_both(moved, noise, regressed):
    elsewhere = dataclasses.replace(HERE, cpu="Another")
    found = compare(baseline(study(0.0, noise)), baseline(study(moved, noise), machine=elsewhere))
    places = [row for row in found.regressions if row.key.endswith("/position")]
    assert [row.key.split("/")[1] for row in places] == ["ball"] * regressed


def test_where_noise_is_above_the_tolerance_nothing_is_compared_and_that_is_said():
    found = compare(baseline(study(0.0, 1.0, growing=True)), baseline(study(0.5, 1.0, growing=True)))
    ball = {row.key: row.change for row in found.rows if "/ball/" in row.key and row.key.endswith("position")}
    assert list(ball.values()) == [FigureChange.CHANGED] * 2 + [FigureChange.NOT_COMPARED] * 3
    assert any("noise" in why for why in reasons(found))
    rows = [row for row in found.rows if row.key.startswith("first/energy")]
    assert {row.change for row in rows} == {FigureChange.NOT_COMPARED}


def test_without_noise_there_is_no_comparison():
    bare = dataclasses.replace(study(), floors={}, repeats={})
    found = compare(baseline(bare), baseline(bare))
    assert found.compared == 1  # that the run did not fail
    assert reasons(found)["physics: noise was not measured"] > 10


def test_a_quaternion_and_its_negative_are_the_same_rotation():
    assert not compare(baseline(study()), baseline(study(turn=-1.0))).regressions


@pytest.mark.parametrize(
    ("before", "now", "change"),
    [
        ([1.0, 1.1, 1.2], [0.95, 1.0, 1.05], FigureChange.SAME),
        ([1.0, 1.1, 1.2], [0.91, 0.92, 0.93], FigureChange.SAME),
        ([1.0, 1.1, 1.2], [0.6, 0.7, 0.89], FigureChange.CHANGED),
        ([1.0, 1.1, 1.2], [0.6, 0.7, 0.91], FigureChange.SAME),
        ([1.0, 1.1, 1.2], [1.4, 1.5, 1.6], FigureChange.BETTER),
        ([1.0, 1.1], [0.1, 0.1, 0.1], FigureChange.NOT_COMPARED),
        ([1.0, 1.1, 1.2], [0.1, 0.1], FigureChange.NOT_COMPARED),
        ([1.0, 1.1, 1.2], [], FigureChange.NOT_COMPARED),
    ],
)
def test_speed_is_compared_by_its_spread_over_processes(before, now, change):
    found = compare(baseline(runs=timed(before)), baseline(runs=timed(now)))
    assert {row.change for row in found.rows if "speed" in row.key and "speed at" not in row.key} == {change}
    assert bool(found.regressions) == (change is FigureChange.CHANGED)


def test_speed_is_not_compared_with_another_machines_but_physics_is():
    elsewhere = dataclasses.replace(HERE, cpu="Another")
    found = compare(baseline(runs=timed([9, 9, 9])), baseline(study(1e-4), timed([1, 1, 1]), elsewhere))
    assert reasons(found)["speed: another machine (cpu: A processor and Another)"] == 2
    assert found.regressions
    assert {row.before.kind for row in found.regressions} == {"physics"}


def test_wall_time_of_a_busy_machine_is_not_compared_and_processor_time_is():
    found = compare(baseline(runs=timed([1, 1, 1], others=1.5)), baseline(runs=timed([1, 1, 1])))
    changes = {row.key: row.change for row in found.rows}
    assert changes["first/speed by wall time"] is FigureChange.NOT_COMPARED
    assert changes["first/speed by processor time"] is FigureChange.SAME


def test_a_missing_figure_is_a_regression_and_an_engine_that_was_not_run_is_none():
    both = dataclasses.replace(study(), runs={**study().runs, "second": a_run(engine="second")})
    found = compare(baseline(both), baseline())
    assert not found.regressions
    assert "verdict: second was not run" in reasons(found)
    failed = dataclasses.replace(study(), runs={"first": dataclasses.replace(a_run(), failed="crashed")})
    found = compare(baseline(), baseline(failed))
    assert found.regressions[0].why == "passed before"
    assert found.count(FigureChange.MISSING) > 10
    assert compare(baseline(failed), baseline()).count(FigureChange.NEW) > 10


def test_other_versions_and_other_worlds_are_said_and_other_specs_refused():
    now = baseline()
    old = dataclasses.replace(now, versions={"first": "0.9"}, world_sha256="0" * 64)
    notes = compare(old, now).notes
    assert notes[0].startswith("first: version 0.9 in the baseline, now")
    assert "--set" in notes[1]
    with pytest.raises(SpecError, match="another spec"):
        compare(dataclasses.replace(now, spec="other"), now)


def test_a_regression_is_reported_in_every_form():
    found = compare(baseline(), baseline(study(1e-4)))
    suite = comparison_suite("arm", found)
    assert suite.count(Status.FAILED) == 6  # places at five moments, and the spread at the end
    assert suite.entries[0].excess == pytest.approx(1e-4 / 3e-9, rel=1e-3)
    assert any("figures did not regress" in entry.name for entry in suite.entries)
    assert any("6 regressed" in line for line in comparison_lines(found))
    assert len(comparison_data(found)["regressions"]) == 6


def test_a_comparison_of_nothing_has_not_passed():
    other = dataclasses.replace(study(), runs={"second": a_run(engine="second")})
    found = compare(baseline(), baseline(other))
    assert found.compared == 0
    assert comparison_suite("arm", found).count(Status.FAILED) == 1


def _edited(change):
    def edit(text: str) -> str:
        data = json.loads(text)
        change(data)
        return json.dumps(data)

    return edit


DAMAGE = {
    "cut short": (lambda text: text[: len(text) // 2], "not JSON"),
    "not JSON": (lambda text: "mine", "not JSON"),
    "another list": (lambda text: "[1]", "not a baseline of simspec"),
    "newer": (_edited(lambda data: data.update(simspec_baseline=2)), "of schema 2, this simspec reads 1"),
    "not a schema": (_edited(lambda data: data.update(simspec_baseline="1")), "not a baseline"),
    "without a machine": (_edited(lambda data: data.pop("machine")), "machine: Field required"),
    "an unknown key": (_edited(lambda data: data.update(more=1)), "more: Extra inputs"),
    "a figure twice": (_edited(lambda data: data["figures"].append(data["figures"][0])), "is there twice"),
    "an interval too few": (_edited(lambda data: data["figures"][1]["interval"].pop()), "is damaged"),
    "an interval upside down": (_edited(lambda data: data["figures"][1]["interval"][0].reverse()), "is damaged"),
    "an interval of three": (_edited(lambda data: data["figures"][1]["interval"][0].append(1.0)), "at most 2 items"),
    "NaN": (lambda text: text.replace("0.0", "NaN", 1), "NaN is not a number"),
    "an unknown kind": (_edited(lambda data: data["figures"][0].update(kind="other")), "kind: Input should be"),
    "words for numbers": (_edited(lambda data: data["figures"][0].update(value=["1.0"])), "valid number"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_baseline_is_a_located_error(tmp_path, name):
    change, text = DAMAGE[name]
    path = tmp_path / "baseline.json"
    path.write_text(change(baseline().text()))
    with pytest.raises(SpecError) as caught:
        read_baseline(path)
    assert str(path) in str(caught.value)
    assert text in str(caught.value)


def test_there_may_be_no_baseline_yet(tmp_path):
    assert read_baseline(tmp_path / "none.json") is None
