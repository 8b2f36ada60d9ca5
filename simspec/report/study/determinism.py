"""Repeated runs, compared bit for bit."""

from __future__ import annotations

from simspec.analysis.determinism import determinism
from simspec.report.kit import table
from simspec.report.study.done import Done, Shown, milliseconds


def determinism_tables(done: Done) -> list[Shown]:
    """``determinism``."""
    made = table(f"{done.sweep.name}: The same run again", "timestep", "engine", "result", right=(0,))
    keyed = sorted(done.runs(whole=True), key=lambda item: (item[1].timestep, done.engines.index(item[0].engine)))
    repeats: dict[tuple[float, str, str], list[str]] = {}
    for cell, row in keyed:
        repeats.setdefault((row.timestep, cell.engine, repr((cell.overrides, cell.seed))), []).append(row.key)
    for (timestep, engine, _), keys in repeats.items():
        if len(keys) < 2:
            made.add_row(milliseconds(timestep), engine, "one run only: nothing to compare")
        else:
            made.add_row(milliseconds(timestep), engine, str(determinism([done.store.load(key) for key in keys])))
    return [Shown("determinism", made)]
