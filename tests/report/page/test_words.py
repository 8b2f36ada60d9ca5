"""The verdict: sentences that follow from results, and change with them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from simspec.errors import EngineError
from simspec.report.page.sentences import MOST_SENTENCES, Sentence, remarks, short_verdict, summary
from simspec.report.studies import StoredStudy
from simspec.report.table import BAD, GOOD, WARNING, listed
from simspec.runner.execution import failed_run
from tests.report.page import samples


def verdict(study) -> list[Sentence]:
    return [summary(study), *remarks(study)]


def said(study, start: str = "") -> list[str]:
    return [f"{sentence.tone}: {sentence.text}" for sentence in verdict(study) if sentence.text.startswith(start)]


def test_an_expectation_that_several_engines_fail_counts_once():
    study = samples.a_study()
    (lost,) = [outcome for row in study.outcomes.values() for outcome in row if not outcome.passed]
    study = dataclasses.replace(study, outcomes=dict.fromkeys(study.outcomes, (lost,)))
    assert summary(study).text.endswith("and 1 expectation failed.")


def test_what_is_said_of_runs_that_part():
    study = samples.a_study()
    first, *others = said(study)
    # 0.4 m/s is 1 mm from the start within the first record, 0.1 s
    assert first == "bad: The engines have the same model; their motions part at 0.1 s, and 1 expectation failed."
    assert "good: Models: proven equal to the spec in first, second and third, by 12 comparisons." in others
    assert [line for line in others if "Motion" in line] == [
        "good: Motion: within 1 mm and 0.001 rad of each other until 2 s: first – second. Largest difference: 20 µm, 0 rad.",
        "warning: Motion: first – third part at 0.1 s, in free motion: mover is the first to differ by more than 1 mm or "
        "0.001 rad (40 mm); the engines' own noise is then at most 0.",
        "warning: Motion: second – third part at 0.1 s, in free motion: mover is the first to differ by more than 1 mm or "
        "0.001 rad (40 mm); the engines' own noise is then at most 0.",
    ]
    assert "bad: Expectations: 1 of 3 failed: position in third (0.8 m, bound 0.1 m)." in others
    assert "good: Repeatability: first, second and third repeat the run to the last bit." in others
    assert "good: Speed: simulated time over processor time of the steps: first 8, second 8, third 8." in others


def test_runs_that_agree():
    first, *_ = said(samples.a_study(engines=("first", "second")))
    assert first == "good: The engines have the same model, and move alike."


def test_models_that_differ_come_first():
    first, *others = said(samples.a_study(valid=False))
    assert first == "bad: The engines do not have the same model: the runs below are not comparable."
    assert "bad: Models: first does not have the spec's model. Failed: L1 mass." in others
    assert not any("proven" in line for line in others)


@pytest.mark.parametrize(
    ("engines", "text"),
    [
        (("first", "second"), "warning: The models were not compared, and move alike."),
        (("first",), "warning: The model was not checked."),
    ],
)
def test_models_that_nobody_compared(engines, text):
    first, *others = said(samples.a_study(engines=engines, proven=False))
    assert first == text
    assert "warning: Models: not compared. There is no certificate for these runs." in others


def test_an_engine_that_the_certificate_does_not_contain():
    study = samples.a_study()
    certificate = dataclasses.replace(
        study.certificate, engines={name: proof for name, proof in study.certificate.engines.items() if name != "third"}
    )
    first, *others = said(dataclasses.replace(study, certificate=certificate))
    assert first == (
        "bad: Not every engine's model was compared with the spec's; their motions part at 0.1 s, and 1 expectation failed."
    )
    assert "warning: Models: third was not checked; the certificate does not contain it." in others


def test_a_failed_run():
    study = samples.a_study(engines=("first", "second"))
    broken = failed_run(study.world, "dart", EngineError("dart", "the process was ended by signal 11"))
    first, *others = said(dataclasses.replace(study, runs={**study.runs, "dart": broken}))
    assert first == "bad: dart did not finish."
    assert any("Run: dart failed" in line and "signal 11" in line for line in others)


def test_approximations_are_said_in_the_first_sentence():
    study = samples.a_study(engines=("first", "second"))
    proof = dataclasses.replace(
        study.certificate.engines["first"], approximations={"joint.armature": "approximate: how"}
    )
    certificate = dataclasses.replace(study.certificate, engines={**study.certificate.engines, "first": proof})
    first, *others = said(dataclasses.replace(study, certificate=certificate))
    assert first == "good: The engines have the same model, with approximations that the spec accepts, and move alike."
    assert "warning: Models: first differs from the spec as the spec accepts: joint.armature." in others


def test_noise_above_the_tolerance_is_no_agreement():
    study = samples.a_study(engines=("first", "second"))
    worst = dataclasses.replace(study.diffs[0].bodies[0], inconclusive_from=0.5, floor=0.01, angle_floor=0.0)
    unclear = dataclasses.replace(study.diffs[0], bodies=(worst, *study.diffs[0].bodies[1:]))
    first, *others = said(dataclasses.replace(study, diffs=(unclear,)))
    assert first == (
        "warning: The engines have the same model; whether they move alike is inconclusive, because of their own noise."
    )
    assert any("inconclusive, because the engines' noise is 10 mm" in line for line in others)


def test_every_tone_has_a_mark_and_names_are_listed():
    assert [sentence.mark for sentence in verdict(samples.a_study())]
    assert {GOOD, WARNING, BAD} == {"good", "warning", "bad"}
    assert [listed(names) for names in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == ["", "a", "a and b", "a, b and c"]


@pytest.mark.parametrize("valid", [True, False])
@pytest.mark.parametrize("crashed", [True, False])
def test_the_verdict_above_the_playback_has_at_most_five_sentences_without_repeats(valid, crashed):
    study = samples.a_study(valid=valid)
    if crashed:
        failed = failed_run(study.world, "dart", EngineError("dart", "ended by signal 11"))
        study = dataclasses.replace(study, runs={**study.runs, "dart": failed})
    sentences = short_verdict(StoredStudy(study, Path("runs/sample"), ()))
    texts = [sentence.text for sentence in sentences]
    assert sentences[0] == summary(study)
    assert len(texts) == len(set(texts)) <= MOST_SENTENCES
    assert any(text.startswith("Motion: first, second agree") for text in texts)
    assert crashed == any(text.startswith("Failed: dart: ended by signal 11") for text in texts)
    assert not any("\u00a0" in text for text in texts)
