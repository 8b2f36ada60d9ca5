"""A comparison of the initial state alone, which is alike by construction, passes nowhere; and what is said of pairs that were
compared up to other times, and of what exceeded its tolerance."""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Callable

import numpy as np
import pytest

from simspec.commands import run as run_command
from simspec.commands.reports import diff_code, diff_runs
from simspec.commands.scenario_options import RunOptions
from simspec.comparison.floor import Floor, save_floor
from simspec.comparison.runs import INCONCLUSIVE, OUT, WITHIN, Diff, diff
from simspec.comparison.study import Study
from simspec.errors import EXIT_FAILED, EXIT_OK
from simspec.report.differences import diff_tables, differences, differences_table, inconclusive_note
from simspec.report.page import sentences
from simspec.report.screen import console, diff_data
from simspec.report.table import GOOD
from simspec.report.tested import junit, study_suites, summary
from simspec.runner.run import Run
from simspec.selection import named
from simspec.world import frames
from tests.runner.synthetic import column, free_body, run, world

TWO = world(free_body("still"), free_body("mover"))
Noise = Callable[[np.ndarray], np.ndarray]


def verdict(study) -> list[sentences.Sentence]:
    return [sentences.summary(study), *sentences.remarks(study)]


def chaos(begin: float) -> Noise:
    """Noise of an angle (rad) that is as large as anything from a time on."""
    return lambda time: np.where(time < begin - 1e-9, 1e-15, 1.0)


def quiet(time: np.ndarray) -> np.ndarray:
    return 1e-15 + 0.0 * time


def floor_of(run: Run, noise: Noise) -> Floor:
    nothing = np.zeros(run.arrays["pose"].shape[:2])
    return Floor(run.engine, run.time, nothing, nothing + noise(run.time)[:, None], True, 1e-15)


def turned(rate: float):
    """The second body turns about x."""
    return lambda name, t: np.array(
        [[0, 0, 0, *frames.from_axis_angle((1.0, 0, 0), rate * x * (name == "mover"))] for x in t]
    )


def a_study(begins: dict[str, Noise], rates: dict[str, float] | None = None) -> Study:
    """A study of engines with the given noise; ``rates``: angular speeds of the second body, by which alone engines differ."""
    runs = {name: run(TWO, turned((rates or {}).get(name, 0.0)), engine=name) for name in begins}
    floors = {name: floor_of(run, begins[name]) for name, run in runs.items()}
    diffs = tuple(
        diff(a, b, floor=[floors[a.engine], floors[b.engine]]) for a, b in itertools.combinations(runs.values(), 2)
    )
    return Study(TWO, None, runs, {}, floors, dict.fromkeys(runs, ()), diffs)


def nothing() -> Study:
    """The motion is chaotic before the second record, and the runs differ by 60° or more at their end."""
    return a_study({"first": chaos(0.1), "second": quiet}, {"second": 1.2})


def shown(table, capsys) -> str:
    console().print(table)
    return " ".join(capsys.readouterr().out.split())


def test_the_initial_state_alone_is_inconclusive():
    (found,) = nothing().diffs
    assert (found.horizon, found.compared_until) == (0.1, 0.0)
    assert (found.verdict, found.within) == (INCONCLUSIVE, False)
    assert {body.verdict for body in found.bodies} == {INCONCLUSIVE}
    assert "noise has outgrown the tolerance at 0.1 s, the first record after the beginning" in found.not_compared
    assert diff_code([found]) == EXIT_FAILED
    # the sentence names the noise that ended the comparison
    assert found.inconclusive_body.angle_floor == 1.0


def test_an_additional_record_is_a_comparison():
    (found,) = a_study({"first": chaos(0.2), "second": quiet}).diffs
    assert (found.compared_until, found.verdict, found.not_compared) == (0.1, WITHIN, "")
    assert diff_code([found]) == EXIT_OK


def test_noise_without_end_at_the_beginning():
    (found,) = a_study({"first": lambda time: np.inf + time, "second": quiet}).diffs
    assert found.verdict == INCONCLUSIVE
    assert "from the beginning on" in found.not_compared


def test_a_run_that_ended_at_its_beginning_agrees_with_nothing():
    a, b = run(TWO), run(TWO, engine="second")
    short = {
        name: value[:1] if name in ("step", "time", "pose", "velocity", "q", "v") else value
        for name, value in b.arrays.items()
    }
    b = dataclasses.replace(b, arrays=short, provenance={**b.provenance, "failed": "it fell"})
    found = diff(a, b, floor=[floor_of(a, quiet)])
    assert (found.verdict, found.horizon) == (INCONCLUSIVE, None)
    assert "no recorded time in common but the beginning" in found.not_compared
    assert "inconclusive, because nothing was compared" in inconclusive_note(found)


def test_initial_states_that_differ_are_a_difference_all_the_same():
    a = run(TWO)
    b = run(TWO, lambda name, t: column(0 * t + (name == "mover"), 0, 0), engine="second")
    found = diff(a, b, floor=[floor_of(a, chaos(0.1))])
    assert found.verdict == OUT
    assert [(body.body, body.verdict) for body in found.bodies] == [("mover", OUT), ("still", INCONCLUSIVE)]


def test_the_terminal_says_so(capsys):
    (found,) = nothing().diffs
    pairs, bodies = shown(differences([found]), capsys), shown(diff_tables(found)[0], capsys)
    assert "inconclusive: 1 rad second nothing was 0 s compared (chaos)" in pairs
    assert "noise has outgrown the tolerance at 0.1 s" in pairs
    assert "mover – – – – 1 rad inconclusive: not compared" in bodies
    assert "not before" not in pairs + bodies


def test_json_says_that_nothing_was_compared():
    (found,) = nothing().diffs
    data = diff_data(found)
    assert (data["within"], data["verdict"]) == (False, INCONCLUSIVE)
    assert data["not_compared"] == found.not_compared
    assert [body["compared"] for body in data["bodies"]] == [False, False]
    table = differences_table(nothing())
    (row, _) = (dict(zip((column.name for column in table.columns), row, strict=True)) for row in table.rows)
    assert (row["verdict"], row["largest, m"], row["rms, m"]) == (INCONCLUSIVE, None, None)
    assert "nothing was compared" in found._repr_html_()


def test_ci_reports_say_that_nothing_was_compared():
    study = nothing()
    suites = study_suites(study, lambda path: None, True)
    text = junit(suites)
    assert text.count("<failure") == 2
    assert "inconclusive: nothing was compared" in text
    markdown = summary(suites, study)
    assert "| first 1.0 – second 1.0 | inconclusive: nothing was compared" in markdown
    assert "| – | – | – |" in markdown
    assert "failed" in markdown.splitlines()[1]


def test_the_page_says_so():
    sentences = verdict(nothing())
    assert "their own noise leaves no time at which motions can be compared" in sentences[0].text
    (motion,) = [sentence for sentence in sentences if sentence.text.startswith("Motion")]
    assert motion.tone != GOOD
    assert motion.text.startswith("Motion: first – second: agreement within 1 mm and 0.001 rad is inconclusive")


def test_commands_end_with_1(tmp_path, monkeypatch, capsys):
    study = nothing()
    for recorded in study.runs.values():
        recorded.save(tmp_path / recorded.engine)
        save_floor(study.floors[recorded.engine], tmp_path / recorded.engine)
    assert diff_runs(tmp_path / "first", tmp_path / "second", 1e-3, True) == EXIT_FAILED
    assert json.loads(capsys.readouterr().out)["within"] is False
    monkeypatch.setattr(run_command, "study", lambda *_, **__: study)
    for requested, code in ((True, EXIT_FAILED), (False, EXIT_OK)):
        found = run_command.run_world(
            RunOptions(spec="", no_verify=True, fail_on_diff=1e-3 if requested else None),
            TWO,
            named(["first", "second"]),
            tmp_path / "run",
        )
        assert found == code
    assert "nothing was compared" in capsys.readouterr().err


def test_pairs_that_were_compared_longer_are_reported_separately():
    study = a_study({"a": quiet, "b": quiet, "c": chaos(0.5)}, {"b": 2e-4})
    texts = [sentence.text for sentence in verdict(study) if sentence.text.startswith("Motion")]
    assert texts == [
        "Motion: within 1 mm and 0.001 rad of each other until 1 s: a – b. Largest difference: 0, 0.0002 rad.",
        "Motion: within 1 mm and 0.001 rad of each other until 0.4 s, beyond which the engines' own noise has outgrown that: "
        "a – c, b – c. Largest difference: 0, 8e-05 rad.",
    ]
    assert "move alike until 0.4 s, where chaos begins in some of them" in verdict(study)[0].text


def test_pairs_of_which_nothing_was_compared_are_in_no_sentence_of_agreement():
    study = a_study({"a": quiet, "b": quiet, "c": chaos(0.1)})
    first, *_ = verdict(study)
    assert "whether they move alike is inconclusive" in first.text
    texts = [sentence.text for sentence in verdict(study) if sentence.text.startswith("Motion")]
    assert texts[0] == "Motion: within 1 mm and 0.001 rad of each other until 1 s: a – b. Largest difference: 0, 0 rad."
    assert texts[1].startswith("Motion: a – c, b – c: agreement within 1 mm and 0.001 rad is inconclusive")


# --- what exceeded its tolerance --------------------------------------------------------------------------------------


def tilted() -> Diff:
    """One body tilts by 10 mrad while it moves 0.4 mm, another moves 0.6 mm: only the angle is out of tolerance."""
    a = run(TWO)
    b = run(
        TWO,
        lambda name, t: np.concatenate(
            [column(t * (4e-4 if name == "mover" else 6e-4), 0, 0), turned(1e-2)(name, t)[:, 3:]], axis=1
        ),
        engine="second",
    )
    return diff(a, b, floor=[floor_of(run, quiet) for run in (a, b)])


def test_the_quantity_that_exceeded_its_tolerance_is_named_with_its_value(capsys):
    found = tilted()
    out = found.first_out
    assert (out.body, out.exceeded, out.first_out) == ("mover", ("angle",), 0.2)
    assert out.angle_out == pytest.approx(2e-3)
    assert out.position_out == pytest.approx(0.8e-4)
    row = shown(differences([found]), capsys)
    assert "(tolerance 1 mm and 0.001 rad, or 3 ×" in row
    assert "600 µm: still at 1 s mover at 0.2 s," in row
    assert "0.01 rad: mover at 1 s free motion:" in row
    assert "angle 0.002 rad" in row
    assert "(free motion): angle 0.002 rad" in shown(diff_tables(found)[0], capsys)
    study = Study(TWO, None, {}, {}, {}, {}, (found,))
    assert any("0.001 rad (angle 0.002 rad)" in sentence.text for sentence in verdict(study))
    suites = study_suites(study, lambda path: None, True)
    assert "first beyond the tolerance of 1 mm and 0.001 rad at 0.2 s: angle 0.002 rad" in junit(suites)
    assert "mover at 0.2 s: angle 0.002 rad" in summary(suites, study)
    assert [row[10] for row in differences_table(study).rows] == [None, "angle"]
    assert "angle 0.002 rad" in found._repr_html_()


def test_both_quantities_and_what_is_no_number():
    a = run(TWO)
    b = run(TWO, lambda name, t: column(np.where(t > 0.45, np.nan, 0.0), 0, 0), engine="second")
    found = diff(a, b, tolerance=1.0, floor=[floor_of(a, quiet)])
    assert found.first_out.first_out == pytest.approx(0.5)
    assert "position" in found.first_out.exceeded
    b = run(
        TWO, lambda name, t: np.concatenate([column(t, 0, 0), turned(1.0)(name, t)[:, 3:]], axis=1), engine="second"
    )
    mover = next(body for body in diff(a, b, floor=[floor_of(a, quiet)]).bodies if body.body == "mover")
    assert mover.exceeded == ("position", "angle")
