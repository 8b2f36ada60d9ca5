"""What a step costs: the engine's step, control, recording."""

from __future__ import annotations

from simspec.analysis.pace import Paced, StepCost, paced, step_cost
from simspec.report.kit import number, table
from simspec.report.study.done import Done, Record, Shown, milliseconds

PARTS = {"step": "engine", "control": "control", "record": "recording"}
"""Parts of a step that are shown (wall time), with the heads of their columns."""


def cost_tables(done: Done) -> list[Shown]:
    """``cost``: by timestep and engine, from the repetitions of the run whose initial state is not moved."""
    heads = ("real time", "median repeat", *PARTS.values(), "repeats")
    columns = ("timestep", "engine", *heads)
    made = table(f"{done.sweep.name}: What a step costs", *columns, right=(0, *range(2, 2 + len(heads))))
    records: list[Record] = []
    for (timestep, engine), cost in _costs(done).items():
        if cost is None:
            made.add_row(milliseconds(timestep), engine, *["–"] * len(heads))
            continue
        factors = [number(timestep / one["step"] if one["step"] else None) for one in (cost.quiet, cost.median)]
        parts = [f"{1e6 * cost.quiet[name]:.1f} µs" for name in PARTS]
        made.add_row(milliseconds(timestep), engine, *factors, *parts, str(cost.repeats))
        records += [
            {"timestep": timestep, "engine": engine, "part": name, "quiet": cost.quiet[name]}
            | {"median": cost.median[name], "repeats": cost.repeats}
            for name in cost.quiet
        ]
    made.caption = (
        "Wall time of a step. A repeat does the same arithmetic: of each interval between two records the fastest counts; the "
        "median repeat says how quiet the machine was. – where it was not measured"
    )
    return [Shown("cost", made, records)]


def _costs(done: Done) -> dict[tuple[float, str], StepCost | None]:
    repeats: dict[tuple[float, int, str], list[tuple[Paced, int]]] = {}
    for cell, row in done.runs(whole=True):
        if cell.seed is None:
            key = (row.timestep, done.engines.index(cell.engine), repr(cell.overrides))
            repeats.setdefault(key, []).append((paced(done.store.load(row.key)), row.steps))
    return {
        (timestep, done.engines[index]): step_cost([one for one, _ in own], own[0][1])
        for (timestep, index, _), own in sorted(repeats.items(), key=lambda item: item[0])
    }
