"""Tables of validity: up to which timestep expectations hold and models are proven, and how runs fail."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from simspec.analysis.horizons import determinism
from simspec.analysis.validity import KINDS, limit
from simspec.experiments.sweep import REFUSED
from simspec.proof.certificate import Certificate
from simspec.proof.checks import Check
from simspec.report.certificate import strain
from simspec.report.study.runs import (
    PLAIN,
    Done,
    Judged,
    LargestDeviation,
    Record,
    StudyTable,
    elsewhere,
    figure_records,
    finite,
    judged,
    milliseconds,
    worst,
)
from simspec.report.table import BAD, TableCell, number
from simspec.runner.expectations import Outcome

# Expectations: the largest timestep at which all hold, and the largest deviations.


def validity_tables(done: Done) -> list[StudyTable]:
    """``validity``, and ``validity.deviations`` where what is expected has tolerances."""
    title = "Up to which timestep all that is expected holds"
    made = StudyTable(done, "validity", title, "engine", "limit", "runs")
    runs = judged(done)
    for engine in done.engines:
        trials = [run.trial for run in runs if run.cell.engine == engine]
        if not trials:
            made.add(engine, "no runs", "0")
            continue
        whole = limit(trials)
        made.add(engine, str(whole), str(len(trials)))
        record: Record = (
            {"engine": engine, "limit": whole.timestep, "first_invalid": whole.first_invalid, "runs": len(trials)}
            | {"failure": whole.first_failure, "later_valid": list(whole.later_valid)}
            | {"fewer_seeds": list(whole.fewer_seeds)}
        )
        made.records.append({**record, **_missed(whole.first_missed)})
        made.records += [
            {"engine": engine, "timestep": timestep, "share": share.value, "runs": share.trials}
            | {"lower": share.lower, "upper": share.upper}
            for timestep, share in whole.shares.items()
        ]
    for figure in done.figures:
        if figure.quantity == "largest_valid_timestep":
            made.add(elsewhere(figure), f"{milliseconds(figure.values[0])}: {figure.source}", "–")
    made.records += figure_records(figure for figure in done.figures if figure.quantity == "largest_valid_timestep")
    return [made, *_deviations(done, runs)]


def _missed(outcome: Outcome | None) -> Record:
    """The first expectation that is missed, as data."""
    measured = finite(outcome.measured) if outcome is not None else None
    if outcome is None or measured is None:
        return {"missed": None}
    return {"missed": outcome.kind, "measured": measured, "bound": outcome.bound, "unit": outcome.unit}


def _deviations(done: Done, runs: list[Judged]) -> list[StudyTable]:
    """The largest deviation by timestep and engine; none where nothing that is expected has a tolerance."""
    units = {run.deviation.unit for run in runs if run.deviation is not None}
    if not units:
        return []
    title, right = "Largest deviation from what is expected", range(1 + len(done.engines))
    made = StudyTable(done, "validity.deviations", title, "timestep", *done.engines, right=right)
    by_step: dict[float, dict[str, list[Judged]]] = {}
    for run in runs:
        by_step.setdefault(run.trial.timestep, {}).setdefault(run.cell.engine, []).append(run)
    for timestep, engines in sorted(by_step.items()):
        made.add(milliseconds(timestep), *(cell(engines.get(engine, []), units) for engine in done.engines))
        for engine, group in engines.items():
            largest = worst(group)
            made.records.append(
                {"timestep": timestep, "engine": engine, "runs": len(group), "valid": valid_of(group)}
                | {"deviation": finite(largest.value if largest else None), "unit": largest.unit if largest else None}
            )
    tolerances = sorted({(run.deviation.tolerance, run.deviation.unit) for run in runs if run.deviation is not None})
    bounds = ", ".join(str(LargestDeviation(value, value, unit)) for value, unit in tolerances)
    made.note = f"Of all runs of a timestep; tolerance {bounds}. Where runs fail: how many, and their largest deviation"
    return [made]


def valid_of(runs: list[Judged]) -> int:
    """How many runs do all that is expected."""
    return sum(run.trial.valid for run in runs)


def cell(runs: list[Judged], units: set[str]) -> str | TableCell:
    """The largest deviation of some runs; a share of its tolerance where there are several units."""
    if not runs:
        return "–"
    largest = worst(runs)
    text = "–" if largest is None else str(largest) if len(units) == 1 else f"{number(100.0 * largest.share)} %"
    failed = len(runs) - valid_of(runs)
    return TableCell(f"fails ({failed} of {len(runs)}): {text}", BAD) if failed else text


# First events in runs that fail.


def failures_tables(done: Done) -> list[StudyTable]:
    """``failures``: by timestep and engine, how many runs fail, and what happened first in them."""
    columns = ("timestep", "engine", "failed", "first event", "for example")
    made = StudyTable(done, "failures", "First events in the runs that fail", *columns, right=(0, 2))
    runs = judged(done)
    groups: dict[tuple[float, int], list[Judged]] = {}
    for run in runs:
        groups.setdefault((run.trial.timestep, done.engines.index(run.cell.engine)), []).append(run)
    for (timestep, index), local in sorted(groups.items()):
        failed = [judged for judged in local if judged.failure is not None]
        if not failed:
            continue
        kinds = Counter(judged.failure.kind for judged in failed if judged.failure is not None)
        said = ", ".join(f"{count} × {KINDS[kind]}" for kind, count in kinds.most_common())
        shown = (milliseconds(timestep), done.engines[index], f"{len(failed)} of {len(local)}")
        made.add(*shown, said, example(failed))
        made.records += [
            {"timestep": timestep, "engine": run.cell.engine, "seed": run.cell.seed}
            | {name: getattr(failure, name) for name in ("kind", "time", "what", "at", "body")}
            | {"away": finite(failure.away)}
            for run in failed
            if (failure := run.failure) is not None
        ]
    if not made.records:
        made.add("–", "–", f"0 of {len(runs)}", "no run failed", "–")
    made.note = "From the recorded motion: an event between two records has the time of the later one"
    return [made]


def example(failed: list[Judged]) -> str:
    """The first of some failures in words; the run without a seed comes first."""
    first = min(failed, key=lambda judged: -1 if judged.cell.seed is None else judged.cell.seed)
    seed = "" if first.cell.seed is None else f"seed {first.cell.seed}: "
    return f"{seed}{first.failure}"


# Cases: validity, deviation and cost of each.


def cases_tables(done: Done) -> list[StudyTable]:
    """``cases``: a row for each timestep, engine and case."""
    columns = ("timestep", "engine", "case", "valid", "largest deviation", "step", "first event")
    made = StudyTable(done, "cases", "The scenario and its cases", *columns, right=(0, 3, 4, 5))
    groups = _groups(done)
    units = {judged.deviation.unit for group in groups.values() for judged in group if judged.deviation is not None}
    for (timestep, engine, case), local in groups.items():
        valid, cost = valid_of(local), _step_cost(local)
        failed = [judged for judged in local if judged.failure is not None]
        name = PLAIN if case is None else case
        if case in done.sweep.words.fails:
            name += " (expected to fail)"
        given: str | TableCell = example(failed) if failed else "–"
        if valid and case in done.sweep.words.fails:
            given = TableCell("does NOT fail, as is expected of it", BAD)
        shown = (milliseconds(timestep), engine, name, f"{valid} of {len(local)}", cell(local, units))
        made.add(*shown, "–" if cost is None else f"{1e6 * cost:.1f} µs", given)
        largest = worst(local)
        made.records.append(
            {"timestep": timestep, "engine": engine, "case": case, "runs": len(local), "valid": valid}
            | {"deviation": finite(largest.value if largest else None), "unit": largest.unit if largest else None}
            | {"step_seconds": cost, "fails": case in done.sweep.words.fails}
        )
    made.note = "Step: processor time of the engine's step calls, the median over runs"
    return [made]


def unfailed(done: Done) -> list[str]:
    """In words: which cases were expected to fail and do what is expected of the scenario, or gave no result, which shows
    nothing."""
    given = []
    for (timestep, engine, case), group in _groups(done).items() if done.sweep.words.fails else ():
        if case not in done.sweep.words.fails:
            continue
        valid, lost = valid_of(group), sum(entry.row.failed is not None for entry in group)
        where = f"in {engine} at {milliseconds(timestep)}"
        if valid:
            given.append(f"{case} was expected to fail, and {valid} of {len(group)} runs hold {where}")
        if lost:
            given.append(f"{case} was expected to fail, and {lost} of {len(group)} runs gave no result {where}")
    return given


def _groups(done: Done) -> dict[tuple[float, str, str | None], list[Judged]]:
    """The runs by timestep, engine and case, in this order, cases as the sweep has them."""
    sweep = done.outcome.plan.sweep
    cases = [*([] if sweep.only_cases else [None]), *sweep.cases]
    groups: dict[tuple[float, int, int], list[Judged]] = {}
    for index, case in enumerate(cases):
        for entry in judged(done, case):
            key = (entry.trial.timestep, done.engines.index(entry.cell.engine), index)
            groups.setdefault(key, []).append(entry)
    return {
        (step, done.engines[engine], cases[case]): judged for (step, engine, case), judged in sorted(groups.items())
    }


def _step_cost(runs: list[Judged]) -> float | None:
    """Processor time (s) of a step: the median over runs; None where none was measured."""
    costs = [run.row.cpu_seconds / run.row.steps for run in runs if run.row.cpu_seconds is not None and run.row.steps]
    return median(costs) if costs else None


# Proofs: the largest timestep at which models are proven, and the checks that fail beyond.

MOST_SHOWN = 3
"""Checks of one model that are named; the others are counted."""


@dataclass(frozen=True)
class Proof:
    """The proof of an engine's model at a timestep: ``proven``, None where it was not verified (``why``), and the checks
    that failed."""

    proven: bool | None
    why: str = ""
    failed: tuple[Check, ...] = ()


def certified_tables(done: Done) -> list[StudyTable]:
    """``certified``: up to which timestep each engine's model is proven; ``certified.checks``: the failed checks with their
    deviations."""
    proofs = _proofs(done)
    heads = ("engine", "certified up to", "first that is not", "certified again at")
    limits = StudyTable(done, "certified", "Up to which timestep the model is proven", *heads)
    note = "Worst deviation and tolerance, in units of the quantity's own scale; the worst in relation to it first"
    title, columns = "Checks of the proof that fail", ("timestep", "engine", "checks")
    checks = StudyTable(done, "certified.checks", title, *columns, right=(0,), note=note)
    for engine in done.engines:
        local = dict(sorted(proofs.get(engine, {}).items()))
        largest, first, again = _limit(local)
        record = {"engine": engine, "limit": largest, "first_invalid": first, "later_valid": list(again)}
        limit = "no timestep" if largest is None else milliseconds(largest)
        if all(proof.proven is None for proof in local.values()):
            limit = "nothing was verified" if local else "no runs"
        beyond = "–" if first is None else milliseconds(first)
        limits.add(engine, limit, beyond, ", ".join(map(milliseconds, again)) or "–", record=record)
        for timestep, proof in local.items():
            if proof.proven is not True:
                checks.add(milliseconds(timestep), engine, proof.why if proof.proven is None else words(proof.failed))
            about = {"timestep": timestep, "engine": engine, "proven": proof.proven}
            checks.records += [
                {**about, "level": check.level, "check": check.name, "worst": check.worst}
                | {"tolerance": check.tolerance, "where": check.where}
                for check in proof.failed
            ] or [about]
    if not checks.rows:
        checks.add("–", "–", "none")
    return [limits, checks]


def _proofs(done: Done) -> dict[str, dict[float, Proof]]:
    """By engine and timestep. Several models of one timestep (values of the sweep) count as one: proven where all are."""
    found: dict[str, dict[float, dict[str, Proof]]] = {}
    for cell, row in done.runs():
        models = found.setdefault(cell.engine, {}).setdefault(row.timestep, {})
        if row.failed is not None and row.failed.startswith(REFUSED):
            models[row.failed] = Proof(None, row.failed)
            continue
        key = done.outcome.index.certificates.get(cell.key)
        if (name := key or "not verified") not in models:
            text = done.store.certificate_text(key) if key is not None else None
            models[name] = Proof(None, "not verified")
            if text is not None:
                certificate = Certificate.from_json(text, f"the certificate {key}")
                models[name] = Proof(certificate.valid, "", tuple(check for _, check in certificate.failures()))
    return {
        engine: {step: _all(list(proofs.values())) for step, proofs in steps.items()} for engine, steps in found.items()
    }


def _all(proofs: Sequence[Proof]) -> Proof:
    failed = tuple(dict.fromkeys(check for proof in proofs for check in proof.failed))
    if any(proof.proven is False for proof in proofs):
        return Proof(False, "", failed)
    return next((proof for proof in proofs if proof.proven is None), proofs[0])


def _limit(proofs: Mapping[float, Proof]) -> tuple[float | None, float | None, tuple[float, ...]]:
    """The largest timestep such that it and all smaller ones are proven, the first that is not, and later ones that are."""
    steps = sorted(proofs)
    first = next((step for step in steps if proofs[step].proven is not True), None)
    good = [step for step in steps if first is None or step < first]
    again = tuple(step for step in steps if first is not None and step > first and proofs[step].proven is True)
    return (good[-1] if good else None), first, again


def words(failed: Sequence[Check]) -> str:
    """Failed checks, the worst first, each with its figure."""
    if not failed:
        return "nothing was compared"
    ordered = sorted(failed, key=lambda check: -strain(check))
    figures = [_figure(check) for check in ordered[:MOST_SHOWN]]
    more = len(ordered) - MOST_SHOWN
    return "; ".join([*figures, *([f"and {more} more"] if more > 0 else [])])


def _figure(check: Check) -> str:
    where = f" ({check.where})" if check.where else ""
    if check.worst is None:
        detail = f": {check.detail}" if check.detail else ""
        return f"{check.level} {check.name}{where}{detail}"
    return f"{check.level} {check.name}: {number(check.worst)}, tolerance {number(check.tolerance)}{where}"


# Repeated runs, compared bit for bit.


def determinism_tables(done: Done) -> list[StudyTable]:
    """``determinism``."""
    made = StudyTable(done, "determinism", "The same run again", "timestep", "engine", "result", right=(0,))
    keyed = sorted(done.runs(whole=True), key=lambda item: (item[1].timestep, done.engines.index(item[0].engine)))
    repeats: dict[tuple[float, str, str], list[str]] = {}
    for cell, row in keyed:
        repeats.setdefault((row.timestep, cell.engine, repr((cell.overrides, cell.seed))), []).append(row.key)
    for (timestep, engine, _), keys in repeats.items():
        same = determinism([done.store.load(key) for key in keys]) if len(keys) > 1 else None
        result = "one run only: nothing to compare" if same is None else str(same)
        made.add(milliseconds(timestep), engine, result)
        bitwise = None if same is None else same.bitwise
        made.records.append(
            {"timestep": timestep, "engine": engine, "runs": len(keys), "bitwise": bitwise, "result": result}
        )
    return [made]
