"""Up to which timestep all that is expected holds, and how closely."""

from __future__ import annotations

from rich.text import Text

from simspec.analysis.validity import limit
from simspec.report.kit import number, table
from simspec.report.study.done import Done, Record, Shown, elsewhere, figure_records, finite, milliseconds
from simspec.report.study.judged import Deviation, Judged, judged, worst
from simspec.runner.expectations import Outcome


def validity_tables(done: Done) -> list[Shown]:
    """``validity``, and ``validity.deviations`` where what is expected has tolerances."""
    made = table(f"{done.sweep.name}: Up to which timestep all that is expected holds", "engine", "limit", "runs")
    records: list[Record] = []
    runs = judged(done)
    for engine in done.engines:
        trials = [one.trial for one in runs if one.cell.engine == engine]
        if not trials:
            made.add_row(engine, "no runs", "0")
            continue
        whole = limit(trials)
        made.add_row(engine, str(whole), str(len(trials)))
        told: Record = (
            {"engine": engine, "limit": whole.timestep, "first_invalid": whole.first_invalid, "runs": len(trials)}
            | {"failure": whole.first_failure, "later_valid": list(whole.later_valid)}
            | {"fewer_seeds": list(whole.fewer_seeds)}
        )
        records.append({**told, **_missed(whole.first_missed)})
        records += [
            {"engine": engine, "timestep": timestep, "share": share.value, "runs": share.trials}
            | {"lower": share.lower, "upper": share.upper}
            for timestep, share in whole.shares.items()
        ]
    for figure in done.figures:
        if figure.quantity == "largest_valid_timestep":
            made.add_row(elsewhere(figure), Text(f"{milliseconds(figure.values[0])}: {figure.source}"), "–")
    known = figure_records(figure for figure in done.figures if figure.quantity == "largest_valid_timestep")
    return [Shown("validity", made, records + known), *_deviations(done, runs)]


def _missed(outcome: Outcome | None) -> Record:
    """The first expectation that is missed, as data."""
    measured = finite(outcome.measured) if outcome is not None else None
    if outcome is None or measured is None:
        return {"missed": None}
    return {"missed": outcome.kind, "measured": measured, "bound": outcome.bound, "unit": outcome.unit}


def _deviations(done: Done, runs: list[Judged]) -> list[Shown]:
    """The largest deviation by timestep and engine; none where nothing that is expected has a tolerance."""
    units = {one.deviation.unit for one in runs if one.deviation is not None}
    if not units:
        return []
    title = f"{done.sweep.name}: Largest deviation from what is expected"
    made = table(title, "timestep", *done.engines, right=range(1 + len(done.engines)))
    records: list[Record] = []
    by_step: dict[float, dict[str, list[Judged]]] = {}
    for one in runs:
        by_step.setdefault(one.trial.timestep, {}).setdefault(one.cell.engine, []).append(one)
    for timestep, engines in sorted(by_step.items()):
        made.add_row(milliseconds(timestep), *(cell(engines.get(engine, []), units) for engine in done.engines))
        for engine, own in engines.items():
            largest = worst(own)
            records.append(
                {"timestep": timestep, "engine": engine, "runs": len(own), "valid": valid_of(own)}
                | {"deviation": finite(largest.value if largest else None), "unit": largest.unit if largest else None}
            )
    tolerances = sorted({(one.deviation.tolerance, one.deviation.unit) for one in runs if one.deviation is not None})
    bounds = ", ".join(str(Deviation(value, value, unit)) for value, unit in tolerances)
    made.caption = (
        f"Of all runs of a timestep; tolerance {bounds}. Where runs fail: how many, and their largest deviation"
    )
    return [Shown("validity.deviations", made, records)]


def valid_of(runs: list[Judged]) -> int:
    """How many runs do all that is expected."""
    return sum(one.trial.valid for one in runs)


def cell(runs: list[Judged], units: set[str]) -> str | Text:
    """The largest deviation of some runs; a share of its tolerance where there are several units."""
    if not runs:
        return "–"
    largest = worst(runs)
    told = "–" if largest is None else str(largest) if len(units) == 1 else f"{number(100.0 * largest.share)} %"
    failed = len(runs) - valid_of(runs)
    return Text(f"fails ({failed} of {len(runs)}): {told}", style="bold red") if failed else told
