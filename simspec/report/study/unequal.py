"""Models that are not equal, beside equal ones: speed, spread and order of the engines."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from statistics import median
from typing import Any

from rich.table import Table

from simspec.report.kit import length, number, table
from simspec.report.study.done import Done, Record, Shown, figure_records, milliseconds, speeds_of

SPREAD = "spread at the end"
EQUAL = "equal models"
SAME_WORLD = "the scenario itself"


def unequal_tables(done: Done) -> list[Shown]:
    """``unequal.equal`` first, then ``unequal.models.NAME`` of each comparison: speed, spread, and who is ahead; and
    ``unequal.elsewhere``."""
    unequal = done.sweep.words.unequal
    made = [Shown("unequal.equal", *_comparison(done, EQUAL, {}))]
    made += [Shown(f"unequal.models.{name}", *_comparison(done, name, own)) for name, own in unequal.items()]
    elsewhere = [one for one in done.figures if one.timesteps is not None]
    if elsewhere:
        shown = table(
            f"{done.sweep.name}: Figures from elsewhere",
            "engine",
            "models",
            "quantity",
            "timestep",
            "value",
            right=(3, 4),
        )
        for one in elsewhere:
            for timestep, value in zip(one.timesteps or (), one.values, strict=True):
                told = number(value, "" if one.unit == "1" else one.unit)
                shown.add_row(one.engine, one.models, one.quantity.replace("_", " "), milliseconds(timestep), told)
        shown.caption = "; ".join(dict.fromkeys(one.source for one in elsewhere))
        made.append(Shown("unequal.elsewhere", shown, figure_records(elsewhere)))
    return made


def _comparison(done: Done, name: str, own: Mapping[str, str]) -> tuple[Table, list[Record]]:
    sweep = done.outcome.plan.sweep
    told = [f"{engine} has {case}: {_values(sweep.cases[case])}" for engine, case in own.items()]
    others = [engine for engine in done.engines if engine not in own]
    title = f"{done.sweep.name}: {EQUAL}" if not own else f"{done.sweep.name}: {name}: these models are NOT EQUAL"
    heads = [head for engine in done.engines for head in (f"{engine}, real time", "spread")]
    shown = table(title, "timestep", *heads, "order", right=range(1 + len(heads)))
    if own:
        shown.caption = "; ".join([*told, *([f"{', '.join(others)}: {SAME_WORLD}"] if others else [])])
    factors: dict[float, dict[str, float]] = {}
    spreads: dict[tuple[float, str], list[float]] = {}
    for engine in done.engines:
        for timestep, speeds in speeds_of(done, own.get(engine)).items():
            if engine in speeds and "cpu_factor" in speeds[engine].figures:
                factors.setdefault(timestep, {})[engine] = speeds[engine]["cpu_factor"].median
        for cell, row in done.runs(own.get(engine), whole=True):
            if cell.engine == engine and SPREAD in row.quantities:
                spreads.setdefault((row.timestep, engine), []).append(row.quantities[SPREAD])
    records: list[Record] = []
    for timestep, speeds_at in sorted(factors.items()):
        cells = []
        for engine in done.engines:
            wide = spreads.get((timestep, engine))
            spread = median(wide) if wide else None
            cells += [number(speeds_at.get(engine)), length(spread)]
            records.append(
                {"timestep": timestep, "engine": engine, "case": own.get(engine), "cpu_factor": speeds_at.get(engine)}
                | {"spread": spread}
            )
        shown.add_row(milliseconds(timestep), *cells, ranking(speeds_at))
    return shown, records


def ranking(factors: Mapping[str, float], intervals: Mapping[str, tuple[float, float]] | None = None) -> str:
    """The engines, the fastest first, each beside the next: ``b is 3 × as fast as a, a 2 × as fast as c``. Where ``intervals``
    of the two overlap, that is said."""
    known = intervals or {}
    ordered = sorted(factors, key=lambda engine: -factors[engine])
    parts: list[str] = []
    for first, second in itertools.pairwise(ordered):
        ratio = f"{factors[first] / factors[second]:.2g}" if factors[second] > 0.0 else "∞"
        times = "" if ratio == "1" else f"{ratio} × "
        overlap = first in known and second in known and known[first][0] <= known[second][1]
        end = " (intervals overlap)" if overlap else ""
        parts.append(f"{first} {'' if parts else 'is '}{times}as fast as {second}{end}")
    return ", ".join(parts) or ", ".join(ordered)


def _values(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{path}: {value}" for path, value in values.items())
