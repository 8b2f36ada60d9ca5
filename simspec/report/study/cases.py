"""The cases of a sweep beside the scenario itself: whether they hold, how closely, and what a step costs."""

from __future__ import annotations

from statistics import median

from rich.text import Text

from simspec.report.kit import table
from simspec.report.study.done import Done, Record, Shown, finite, milliseconds
from simspec.report.study.failures import example
from simspec.report.study.judged import Judged, judged, worst
from simspec.report.study.validity import cell, valid_of
from simspec.report.study.variants import PLAIN


def cases_tables(done: Done) -> list[Shown]:
    """``cases``: a row for each timestep, engine and case."""
    columns = ("timestep", "engine", "case", "valid", "largest deviation", "step", "what happened first")
    made = table(f"{done.sweep.name}: The scenario and its cases", *columns, right=(0, 3, 4, 5))
    groups = _groups(done)
    units = {one.deviation.unit for own in groups.values() for one in own if one.deviation is not None}
    records: list[Record] = []
    for (timestep, engine, case), own in groups.items():
        valid, cost = valid_of(own), _step_cost(own)
        failed = [one for one in own if one.failure is not None]
        name = PLAIN if case is None else case
        if case in done.sweep.words.fails:
            name += " (expected to fail)"
        told: str | Text = example(failed) if failed else "–"
        if valid and case in done.sweep.words.fails:
            told = Text("does NOT fail, as is expected of it", style="bold red")
        shown = (milliseconds(timestep), engine, name, f"{valid} of {len(own)}", cell(own, units))
        made.add_row(*shown, "–" if cost is None else f"{1e6 * cost:.1f} µs", told)
        largest = worst(own)
        records.append(
            {"timestep": timestep, "engine": engine, "case": case, "runs": len(own), "valid": valid}
            | {"deviation": finite(largest.value if largest else None), "unit": largest.unit if largest else None}
            | {"step_seconds": cost, "fails": case in done.sweep.words.fails}
        )
    made.caption = "Step: processor time of the engine's step calls, the median over runs"
    return [Shown("cases", made, records)]


def unfailed(done: Done) -> list[str]:
    """In words: which cases were expected to fail and do what is expected of the scenario, or gave no result, which shows
    nothing."""
    told = []
    for (timestep, engine, case), own in _groups(done).items() if done.sweep.words.fails else ():
        if case not in done.sweep.words.fails:
            continue
        valid, lost = valid_of(own), sum(one.row.failed is not None for one in own)
        where = f"in {engine} at {milliseconds(timestep)}"
        if valid:
            told.append(f"{case} was expected to fail, and {valid} of {len(own)} runs hold {where}")
        if lost:
            told.append(f"{case} was expected to fail, and {lost} of {len(own)} runs gave no result {where}")
    return told


def _groups(done: Done) -> dict[tuple[float, str, str | None], list[Judged]]:
    """The runs by timestep, engine and case, in this order, cases as the sweep has them."""
    sweep = done.outcome.plan.sweep
    cases = [*([] if sweep.only_cases else [None]), *sweep.cases]
    groups: dict[tuple[float, int, int], list[Judged]] = {}
    for index, case in enumerate(cases):
        for one in judged(done, case):
            key = (one.trial.timestep, done.engines.index(one.cell.engine), index)
            groups.setdefault(key, []).append(one)
    return {(step, done.engines[engine], cases[case]): own for (step, engine, case), own in sorted(groups.items())}


def _step_cost(runs: list[Judged]) -> float | None:
    """Processor time (s) of a step: the median over runs; None where none was measured."""
    costs = [one.row.cpu_seconds / one.row.steps for one in runs if one.row.cpu_seconds is not None and one.row.steps]
    return median(costs) if costs else None
