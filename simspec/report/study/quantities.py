"""What runs come to: energy, penetration, contacts, speed and spread, by case, engine and timestep."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import median

from simspec.comparison.runs import QUANTITIES
from simspec.report.kit import number, table
from simspec.report.study.done import Done, Record, Shown, milliseconds
from simspec.report.study.variants import variants


def quantities_tables(done: Done) -> list[Shown]:
    """``quantities``."""
    made = variants(done)
    rows = [
        (one, timestep, {name: _medians(row.quantities.get(name) for _, row in runs) for name, _ in QUANTITIES})
        for one in made
        for timestep, runs in one.runs.items()
    ]
    shown = [(name, unit) for name, unit in QUANTITIES if any(told[name] is not None for _, _, told in rows)]
    heads = [f"{name}, {unit}" if unit else name for name, unit in shown]
    columns = ("settings", "engine", "timestep", *heads)
    built = table(f"{done.sweep.name}: What runs come to", *columns, right=range(2, len(columns)))
    records: list[Record] = []
    for one, timestep, told in rows:
        built.add_row(one.label, one.engine, milliseconds(timestep), *(number(told[name]) for name, _ in shown))
        records.append({"settings": one.label, "case": one.case, "engine": one.engine, "timestep": timestep} | told)
    built.caption = "Medians over the runs. What a run lacks, or what was not finite, is left out"
    return [Shown("quantities", built, records)]


def _medians(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None and abs(value) < float("inf")]
    return median(known) if known else None
