"""The verdict: clusters instead of pairs, twelve lines of 80 columns at most, the command that helps."""

from __future__ import annotations

import dataclasses
import io
import itertools
import math
from pathlib import Path

import pytest

from simspec.comparison.clusters import agreement
from simspec.comparison.floor import measure_floor
from simspec.comparison.runs import diff
from simspec.comparison.study import Study
from simspec.errors import EngineError, EngineRefusal
from simspec.proof.certificate import Certificate, EngineProof, MotionLimit
from simspec.proof.checks import Check
from simspec.report.console import Screen
from simspec.report.verdict import LABEL, MOST_LINES, VerdictPart, fitted, show_verdict, verdict, verdict_data
from simspec.runner.execution import failed_run
from simspec.runner.expectations import Outcome, evaluate
from simspec.selection import NotTaken
from simspec.world.types import Expectation
from tests.runner.synthetic import column, free_body, run, world

FOLDER = Path("runs/quad")
WORLD = world(
    free_body("mover"),
    free_body("other"),
    expect=(Expectation("position", (("body", "mover"), ("tolerance", 0.1), ("xyz", (0.0, 0.0, 0.0)))),),
)


def study_of(rates: dict[str, float], certificate: Certificate | None = None, floors: bool = True) -> Study:
    """Runs whose body moves at constant speeds (m/s), by engine."""
    runs = {
        name: run(WORLD, lambda body, t, rate=rate: column(rate * t * (body == "mover"), 0, 0), engine=name)
        for name, rate in rates.items()
    }
    noise = {
        name: measure_floor(each, [each, dataclasses.replace(each, provenance={**each.provenance, "perturb": 1e-15})])
        for name, each in runs.items()
    }
    pairs = itertools.combinations(runs.values(), 2)
    diffs = tuple(diff(a, b, floor=[noise[a.engine], noise[b.engine]] if floors else None) for a, b in pairs)
    outcomes = {name: tuple(evaluate(each)) for name, each in runs.items()}
    return Study(WORLD, certificate, runs, {}, noise if floors else {}, outcomes, diffs)


def printed(parts: list[VerdictPart], width: int = 80, brief: bool = False) -> str:
    screen = Screen(file=io.StringIO(), width=width)
    show_verdict(parts, screen, brief)
    return screen.file.getvalue()


def by_label(study: Study, **not_run: NotTaken | str) -> dict[str, str]:
    texts: dict[str, str] = {}
    label = ""
    for part in verdict(study, not_run, FOLDER):
        label, text = part.label or label, part.text.replace("\u00a0", " ")
        texts[label] = f"{texts[label]}; {text}" if label in texts else text
    return texts


def proof(*checks: Check, approximations: dict[str, str] | None = None) -> EngineProof:
    return EngineProof("1.0", "0" * 64, checks, approximations or {})


def check(name: str, worst: float, count: int = 10) -> Check:
    return Check("L1", name, count, 1e-9, worst, "mover")


def test_engines_that_agree_form_a_cluster_in_every_order():
    for order in itertools.permutations({"a": 0.0, "b": 1e-6, "c": 0.4, "d": 2e-6}.items()):
        found = agreement(study_of(dict(order)))
        assert set(found.clusters[0].engines) == {"a", "b", "d"}
        assert found.clusters[1].engines == ("c",)
        assert found.clusters[0].position == pytest.approx(2e-6, rel=1e-3)
        (departure,) = found.departures
        assert departure.engine == "c"
        assert departure.reference in {"a", "b", "d"}


def test_agreement_is_not_transitive():
    """Of 0, 0.9 and 1.8 mm at the end the outer two differ by more than 1 mm: they are not in one cluster."""
    found = agreement(study_of({"a": 0.0, "b": 0.9e-3, "c": 1.8e-3}))
    assert [cluster.engines for cluster in found.clusters] == [("a", "b"), ("c",)]


def test_two_clusters_are_both_named():
    texts = by_label(study_of({"a": 0.0, "b": 0.0, "c": 0.4, "d": 0.4}))
    assert texts["motion"] == (
        "a, b agree within 0 m (noise 0); "
        "c, d (within 0 m of each other) differ by 400 mm at 1 s (mover), from 0.1 s, in free motion"
    )
    assert texts["next"].splitlines()[0].startswith("simspec explain runs/quad/a runs/quad/c  ")


def test_the_exceeded_tolerance_is_named():
    turned = world(free_body("mover"))

    def spun(angle):
        import numpy as np

        def pose(body, t):
            half = 0.5 * angle * np.asarray(t)
            zero = np.zeros_like(half)
            return np.stack([zero, zero, zero, np.cos(half), zero, zero, np.sin(half)], axis=-1)

        return pose

    runs = {name: run(turned, spun(angle), engine=name) for name, angle in {"a": 0.0, "b": 0.05}.items()}
    study = Study(turned, None, runs, {}, {}, dict.fromkeys(runs, ()), (diff(runs["a"], runs["b"]),))
    assert "b differs from a by 0.05 rad at 1 s (mover), from 0.1 s, in free motion" in by_label(study)["motion"]


def test_the_earliest_departure_has_all_figures_and_the_others_are_short():
    texts = by_label(study_of({"a": 0.0, "b": 0.0, "c": 0.02, "d": 0.4}))
    assert texts["motion"] == (
        "a, b agree within 0 m (noise 0); d differs by 400 mm at 1 s (mover), from 0.1 s, in free motion; "
        "further: c by 20 mm from 0.1 s"
    )


def test_a_single_engine_is_compared_with_nothing():
    texts = by_label(study_of({"a": 0.0}))
    assert texts["motion"] == "only a ran: nothing to compare with"
    assert texts["next"].splitlines() == ["simspec view runs/quad  (see it)"]


def test_the_model_line_counts_valid_proofs_and_names_the_worst_check_of_others():
    proofs = {
        "a": proof(check("masses", 0.0), check("inertia", 1e-12)),
        "b": proof(check("masses", 0.5), check("inertia", 1.0)),
        "c": proof(
            check("masses", 0.0),
            approximations={"shape.box": "why", "joint.limits.velocity": "outside: by simspec"},
        ),
    }
    texts = by_label(study_of(dict.fromkeys(proofs, 0.0), Certificate("quad", "0" * 64, "pinocchio", proofs)))
    assert texts["model"] == (
        "same in a, c (30 comparisons); "
        "differs in b: L1 mass, inertia by 1 (tolerance 1e-09) at mover and 1 more checks"
    )
    assert texts["accepted"] == "c: shape.box"
    assert by_label(study_of({"a": 0.0}))["model"] == "not proven to be the same: the proof was skipped"


def test_another_method_of_integration_has_a_line_with_its_deviation():
    limit = MotionLimit(1, (1e-3, 5e-4, 2.5e-4), (1e-3, 5e-4, 2.5e-4), (2.0, 2.0), 1e-9, (2e-4, 0.0), 0.5)
    how = {"physics.integrator": "approximate: another", "shape.box": "approximate: boxes"}
    proofs = {
        "a": proof(check("masses", 0.0)),
        "b": dataclasses.replace(proof(check("masses", 0.0), approximations=how), convergence=limit),
    }
    texts = by_label(study_of(dict.fromkeys(proofs, 0.0), Certificate("quad", "0" * 64, "pinocchio", proofs)))
    assert texts["method"] == "b of first order, 0.2 mm from semi-implicit Euler after 0.5 s at 1 ms"
    assert texts["accepted"] == "b: shape.box"


def test_a_run_without_a_proof_is_named_and_not_counted_as_the_same_model():
    """A stored certificate may lack engines that ran: six valid proofs of seven runs once read as all engines."""
    names = "abcdefg"
    proofs = {name: proof(check("masses", 0.0)) for name in names[:-1]}
    texts = by_label(study_of(dict.fromkeys(names, 0.0), Certificate("quad", "0" * 64, "pinocchio", proofs)))
    assert texts["model"].startswith("same in a, b, c, d, e, f (60 comparisons); not proven in g: ")


def test_expectations_are_counted_in_the_engines_that_ran():
    study = study_of({"a": 0.0, "b": 0.0})
    met = Outcome("position", True, 0.0, 1e-3, "m")
    lost = Outcome("position", False, None, 1e-3, "m", "the run failed: not installed")
    absent = dataclasses.replace(study.runs["b"], failed="not installed")
    study = dataclasses.replace(study, runs={**study.runs, "b": absent}, outcomes={"a": (met,), "b": (lost,)})
    assert by_label(study)["expectations"] == "1 of 1 met; not evaluated in b"
    study = dataclasses.replace(study, outcomes={"a": (dataclasses.replace(met, passed=False),), "b": (lost,)})
    assert (
        by_label(study)["expectations"] == "0 of 1 met; position not met in a (0 m, bound 0.001 m); not evaluated in b"
    )
    study = dataclasses.replace(study, runs={"b": absent}, outcomes={"b": (lost,)})
    assert by_label(study)["expectations"] == "not evaluated: b failed"


def test_a_motion_that_is_not_finite_is_the_largest_difference():
    texts = by_label(study_of({"a": 0.0, "b": 0.0, "c": math.nan}))
    assert "c differs by NaN at " in texts["motion"]


def test_a_proof_without_checks_is_not_the_same_model():
    texts = by_label(study_of({"a": 0.0}, Certificate("quad", "0" * 64, "pinocchio", {"a": proof()})))
    assert texts["model"] == "differs in a: nothing was compared"


def test_missed_expectations_name_engines_and_figures():
    texts = by_label(study_of({"a": 0.0, "b": 0.4}))
    assert texts["expectations"] == "0 of 1 met; position not met in b (0.4 m, bound 0.1 m)"
    assert by_label(study_of({"a": 0.0, "b": 1e-6}))["expectations"] == "1 of 1 met"


def test_engines_that_did_not_run_are_grouped_by_feature():
    refusals = tuple(EngineRefusal("no hinges", engine="x", feature="joint.hinge") for _ in range(2))
    texts = by_label(
        study_of({"a": 0.0}),
        x=NotTaken("x does not support joint.hinge", problems=refusals),
        y=NotTaken("y does not support joint.hinge", problems=refusals),
        z=NotTaken("not installed: pip install z"),
        s="of a stored report: " + "long " * 50,
    )
    assert texts["not run"].startswith("x, y: joint.hinge; s: of a stored report: long")
    assert len(texts["not run"]) < 160


def test_a_failed_engine_comes_first_and_is_not_compared():
    study = study_of({"a": 0.0, "b": 0.0})
    failed = failed_run(WORLD, "mujoco", EngineError("mujoco", "ended by signal 11\nmore"))
    study = dataclasses.replace(study, runs={**study.runs, "mujoco": failed})
    parts = verdict(study, {}, FOLDER)
    assert (parts[0].label, parts[0].text) == ("failed", "mujoco: ended by signal 11")
    assert agreement(study).clusters[0].engines == ("a", "b")


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_it_fits(width):
    study = study_of({f"engine_{k}": 0.3 * (k % 5) for k in range(10)})
    not_run = {f"other_{k}": NotTaken(f"reason {k} of some length that goes on and on") for k in range(9)}
    parts = verdict(study, not_run, FOLDER)
    text = printed(parts, width)
    lines = text.splitlines()
    assert len(lines) <= max(MOST_LINES, len(parts) + 1)
    commands = [line for line in lines if "simspec " in line]
    assert all(len(line) <= max(width, LABEL + 20) for line in lines if line not in commands)
    assert all(line == line.rstrip() for line in lines)
    if width >= 80:
        assert "simspec explain runs/quad/" in text


def test_a_brief_verdict_has_no_speed_and_no_commands():
    parts = verdict(study_of({"a": 0.0, "b": 0.4}), {"x": "not installed"}, FOLDER)
    brief = printed(parts, brief=True)
    assert "motion" in brief
    assert "expectations" in brief
    assert "simspec" not in brief
    assert "not run" not in brief


def test_its_data_has_every_line_but_the_commands():
    parts = verdict(study_of({"a": 0.0, "b": 0.4}), {}, FOLDER)
    data = verdict_data(parts)
    assert [entry["label"] for entry in data] == [part.label for part in parts if part.label != "next"]
    assert all(set(entry) == {"label", "text"} for entry in data)


def test_foreign_names_are_shown_escaped():
    (lines,) = fitted([VerdictPart("motion", "a\x1b[31mb\nc")], 80)
    assert lines == ["a\\x1b[31mb\\nc"]
