"""Repeated runs, compared bit for bit."""

from __future__ import annotations

from simspec.analysis.determinism import determinism
from simspec.report.kit import table
from simspec.report.study.done import Done, Record, Shown, milliseconds


def determinism_tables(done: Done) -> list[Shown]:
    """``determinism``."""
    made = table(f"{done.sweep.name}: The same run again", "timestep", "engine", "result", right=(0,))
    records: list[Record] = []
    keyed = sorted(done.runs(whole=True), key=lambda item: (item[1].timestep, done.engines.index(item[0].engine)))
    repeats: dict[tuple[float, str, str], list[str]] = {}
    for cell, row in keyed:
        repeats.setdefault((row.timestep, cell.engine, repr((cell.overrides, cell.seed))), []).append(row.key)
    for (timestep, engine, _), keys in repeats.items():
        same = determinism([done.store.load(key) for key in keys]) if len(keys) > 1 else None
        result = "one run only: nothing to compare" if same is None else str(same)
        made.add_row(milliseconds(timestep), engine, result)
        bitwise = None if same is None else same.bitwise
        records.append(
            {"timestep": timestep, "engine": engine, "runs": len(keys), "bitwise": bitwise, "result": result}
        )
    return [Shown("determinism", made, records)]
