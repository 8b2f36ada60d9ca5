"""Tables: they answer the question, fit the width, and show no colour where none is wanted."""

from __future__ import annotations

import dataclasses
import io
import itertools
import json

import pytest

from simspec.comparison.floor import measure_floor
from simspec.comparison.runs import diff
from simspec.comparison.study import Study
from simspec.comparison.worlds import diff_worlds
from simspec.engines.kit.capabilities import Capability
from simspec.errors import EngineError, Location, Problem, SpecError
from simspec.proof.certificate import Certificate, EngineProof
from simspec.proof.checks import Check
from simspec.proof.expected import PARTS
from simspec.proof.selftest import DefectOutcome, SelfTest
from simspec.report import differences, matrix
from simspec.report import problems as problems_module
from simspec.report.certificate import PART_WORDS, level_title, self_test_table, show_certificate
from simspec.report.console import Screen
from simspec.report.matrix import engine_tables
from simspec.report.problems import show_error
from simspec.report.screen import error_data, plain, progress, study_data
from simspec.report.screen import text as json_text
from simspec.report.studies import show_study
from simspec.report.table import length
from simspec.runner.execution import failed_run
from simspec.runner.expectations import evaluate
from simspec.support.declarations import Level
from simspec.support.features import Feature
from simspec.world.types import Expectation
from tests import worlds
from tests.runner.synthetic import column, free_body, run, world

RATES = {"mujoco": 0.0, "pybullet": 1e-5, "dart": 0.4}
WORLD = world(
    free_body("upper_arm_link_of_the_robot"),
    free_body("mover"),
    expect=(Expectation("position", (("body", "mover"), ("tolerance", 0.1), ("xyz", (0.0, 0.0, 0.0)))),),
)


def a_study(crashed: bool = False) -> Study:
    runs = {
        name: run(WORLD, lambda body, t, rate=rate: column(rate * t * (body == "mover"), 0, 0), engine=name)
        for name, rate in RATES.items()
    }
    floors = {
        name: measure_floor(run, [run, dataclasses.replace(run, provenance={**run.provenance, "perturb": 1e-15})])
        for name, run in runs.items()
    }
    diffs = tuple(diff(a, b, floor=list(floors.values())) for a, b in itertools.combinations(runs.values(), 2))
    if crashed:
        runs["dart"] = failed_run(WORLD, "dart", EngineError("dart", "the process was ended by signal 11 (SIGSEGV)"))
    outcomes = {name: tuple(evaluate(run)) for name, run in runs.items()}
    return Study(WORLD, None, runs, {}, floors, outcomes, diffs)


def shown(work, width: int = 80) -> str:
    screen = Screen(file=io.StringIO(), width=width)
    work(screen)
    return screen.file.getvalue()


@pytest.mark.parametrize("width", [80, 120])
def test_a_study_fits_and_answers(width):
    text = shown(lambda screen: show_study(a_study(), screen), width)
    assert max(len(line) for line in text.splitlines()) <= width
    for name in RATES:
        assert name in text
    whole = " ".join(text.split())
    assert "400 mm" in whole
    assert "bitwise equal" in whole
    assert "FAILED" in whole
    assert "out of tolerance" in whole or "out of" in whole


def test_a_crash_stands_in_the_table():
    text = shown(lambda screen: show_study(a_study(crashed=True), screen), 120)
    assert "SIGSEGV" in text


def test_a_diff_lists_the_worst_bodies_first_and_counts_the_rest():
    many = world(*(free_body(f"ball_{k:02d}") for k in range(20)))
    a = run(many)
    b = run(many, lambda body, t: column(1e-3 * int(body[-2:]) * t, 0, 0), engine="second")
    found = diff(a, b)
    text = shown(lambda screen: [screen.print(table) for table in differences.diff_tables(found)])
    assert text.index("ball_19") < text.index("ball_18")
    assert f"and {20 - differences.SHOWN_BODIES} more" in text


def test_changes_of_a_world():
    spheres = worlds.spheres(2)
    heavy = dataclasses.replace(spheres.bodies[1].inertial, mass=11.0)
    other = dataclasses.replace(
        spheres, bodies=(spheres.bodies[0], dataclasses.replace(spheres.bodies[1], inertial=heavy))
    )
    text = shown(lambda screen: screen.print(differences.changes(diff_worlds(spheres, other))), 120)
    assert "bodies.ball_0.inertial.mass" in text
    assert "10.0" in text
    assert "11.0" in text
    assert "bodies.ball_1" in text


@pytest.mark.parametrize(
    ("metres", "words"),
    [(0.0, "0"), (1.5, "1.5 m"), (0.0032, "3.2 mm"), (4e-6, "4 µm"), (1.5e-9, "1.5e-09 m"), (None, "–"),
     (float("inf"), "∞"), (float("nan"), "NaN")],
)  # fmt: skip
def test_lengths(metres, words):
    assert length(metres) == words


def a_certificate(worst: float | None = 3e-12) -> Certificate:
    checks = (
        Check("L0", "mass", 4, 1e-12, 0.0, "bodies.arm"),
        Check("L1", "inertia", 4, 1e-9, worst, "bodies.arm", "joint is a slide"),
        Check("L6", "motion", 40, 2e-8, 1e-8, "bodies.arm, step 3", "floor 2.0e-10, 2000 steps of 0.001 s"),
    )
    good = EngineProof(
        "4.0", "abc", checks[::2], {}, {"shape.visual": "no such thing"}, not_compared={"L1": "nothing moves"}
    )
    approximate = EngineProof("3.2", "def", checks, {"joint.limits.position": "approximate: soft"}, {})
    return Certificate("arm", "0" * 64, "pinocchio 4", {"dart": good, "mujoco": approximate})


@pytest.mark.parametrize("width", [80, 120])
def test_a_certificate_shows_the_worst_of_each_level_and_what_is_behind_it(width):
    text = shown(lambda screen: show_certificate(a_certificate(), screen), width)
    assert max(len(line) for line in text.splitlines()[:14]) <= width
    lines = {line.split()[0]: line.split() for line in text.splitlines() if line.strip()}
    assert any("not compared" in line and "3.0e-12" in line for line in text.splitlines())
    assert "not compared: L1: nothing moves" in text
    assert lines["L0"][-2:] == ["equal", "equal"]
    assert lines["L6"][-3:] == ["2.0e-08", "1.0e-08", "1.0e-08"]
    assert lines["verdict"][1:] == ["valid", "valid"]
    assert "motion: floor 2.0e-10" in text
    assert "mujoco: accepted approximation (joint.limits.position)" in text
    assert "dart: not readable back: shape.visual" in text


@pytest.mark.parametrize(("worst", "words"), [(1e-3, "1.0e-03"), (None, "different kind")])
def test_a_certificate_that_fails_says_where(worst, words):
    text = shown(lambda screen: show_certificate(a_certificate(worst), screen), 120)
    assert "NOT VALID" in text
    assert "1 FAILED" in text
    row = next(line for line in text.splitlines() if "L1 inertia" in line)
    assert all(word in row for word in ("mujoco", words, "bodies.arm", "joint is a slide"))


def test_errors_put_the_place_first(capsys):
    problem = Problem(
        "no such key",
        "bodies.ball.mas",
        Location("a.yaml", 3, 5),
        found="mas",
        hint="did you mean 'mass'?",
        code="S101",
    )
    show_error(SpecError([problem, problem]))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "a.yaml:3:5: error[S101]: bodies.ball.mas: no such key"
    assert lines[2].strip() == "hint:    did you mean 'mass'?"
    assert lines[-1] == "2 problems; about it: simspec help S101"


def test_text_of_users_is_not_read_as_markup(capsys):
    show_error(SpecError([Problem("found [bold]this[/bold] and [/nothing]")]))
    assert "[bold]this[/bold] and [/nothing]" in capsys.readouterr().err


def test_errors_as_data():
    found = error_data(EngineError("dart", "gone"))["error"]
    assert (found["engine"], found["exit_code"]) == ("dart", 3)


def test_everything_of_a_study_is_json():
    found = json.loads(json_text(study_data(a_study(crashed=True))))
    assert found["exit_code"] == 3
    assert found["runs"]["dart"]["quantities"] == {}
    assert len(found["diffs"]) == 3


def test_values_that_are_not_finite_are_null():
    assert plain({"a": [float("nan"), float("inf"), 1.0]}) == {"a": [None, None, 1.0]}


def test_no_progress_in_a_pipe(capsys):
    with progress() as say:
        say("running")
    assert capsys.readouterr() == ("", "")


def test_the_self_test_shows_what_was_missed():
    found = SelfTest(
        (
            DefectOutcome("mujoco", "mass", True, ("L1", "L3")),
            DefectOutcome("mujoco", "axis", False),
            DefectOutcome("dart", "mass", None, reason="it has no such number"),
            DefectOutcome("dart", "axis", True, ("L2",)),
        )
    )
    text = shown(lambda screen: screen.print(self_test_table(found)))
    rows = {line.split()[0]: line.split()[1:] for line in text.splitlines() if line.strip()}
    assert rows["mass"][:2] == ["L1,", "L3"]
    assert "it has no such number" in text
    assert rows["axis"] == ["MISSED", "L2"]


def test_a_level_is_called_after_what_it_checks():
    def checks(*names):
        return [Check("L7", name, 1, 1e-9, 0.0, "") for name in names]

    assert level_title("L7", []) == "L7 control, step response"
    assert level_title("L7", checks("applied forces")) == "L7 applied forces"
    both = checks("prescribed motion", "step response", "step response, closed form")
    assert level_title("L7", both) == "L7 control, step response; prescribed motion"
    assert level_title("L6", checks("dry friction, at rest", "dry friction, sliding")) == "L6 dry friction"
    assert level_title("L3", checks("mass matrix")) == "L3 dynamics"
    # every part that a level may lack has a word, or its level is of one thing
    for level, part in PARTS:
        if level in PART_WORDS and part:
            assert part.partition(",")[0] in PART_WORDS[level]


def test_the_table_of_engines_fits_80_columns_with_a_symbol_for_each_feature():
    """A table of twelve engines left nine columns for each: "joint.h / inge"."""
    data = matrix.engine_data()
    _, support, abilities = engine_tables([], data)
    out = shown(lambda screen: [screen.print(table) for table in (support, abilities)], 80)
    proven = [name for name, facts in data.items() if facts["tier"] != matrix.FILES_ONLY]
    assert max(map(len, out.splitlines())) <= 80
    assert ["".join(column.name.split()) for column in support.columns[1:]] == proven
    rows = {words[0]: words[1:] for words in map(str.split, out.splitlines()) if words}
    for feature in Feature:
        levels = [Level(data[name]["support"][feature.value]["level"]) for name in proven]
        assert rows[feature.value] == [matrix.SYMBOLS[level] for level in levels]
    for capability in Capability:
        assert len(rows[capability.value]) == len(proven)


def test_an_engine_shows_every_feature_with_its_reason():
    features, abilities, settings = matrix.engine_table("rapier")
    rows = {row[0]: (str(row[1]), row[2]) for row in features.rows}
    assert rows.keys() == {feature.value for feature in Feature}
    assert rows["constraint.loop"][0] == "no"
    assert "no constraints between coordinates" in rows["constraint.loop"][1]
    assert all(how for said, how in rows.values() if said in ("no", "approximate"))
    assert len(abilities.rows) == len(Capability)
    assert settings.rows


@pytest.mark.parametrize("width", [40, 80])
def test_errors_on_a_terminal_are_wrapped_between_words(width, monkeypatch):
    """Every line fits, none ends with a blank, and only place and kind are set off."""
    out = io.StringIO()
    screen = Screen(file=out, width=width, force_terminal=True, color_system=None)
    monkeypatch.setattr(problems_module, "console", lambda error: screen)
    place = Location("a.yaml", 3, 5)
    problem = Problem("no such key " * 10, "bodies.ball.mas", place, allowed="word, " * 30, code="S101")
    show_error(SpecError([problem, Problem("other", code="S102"), Problem("more", code="S103")]))
    lines = out.getvalue().splitlines()
    assert lines[0].startswith("a.yaml:3:5: error[S101]:")
    assert max(map(len, lines)) <= width
    assert not [line for line in lines if line != line.rstrip()]
    assert "simspec help" in " ".join(lines)
