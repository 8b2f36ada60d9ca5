"""What a step costs in each case of a sweep, beside the scenario itself, and what the engines said of it."""

from __future__ import annotations

from simspec.report.kit import number, table
from simspec.report.study.digits import two_digits
from simspec.report.study.done import Done, Record, Shown, milliseconds
from simspec.report.study.variants import Variant, unsupported_table, variants

NOTE = (
    "Processor time of the step calls over the number of steps: the fastest of the runs, which the machine disturbed least. "
    "Ratio: to the scenario itself with the same values, in the same engine at the same timestep"
)


def case_cost_tables(done: Done) -> list[Shown]:
    """``case_cost``."""
    made = variants(done)
    columns = ("values", "case", "engine", "timestep", "a step", "ratio", "runs", "said by the engine")
    shown = table(f"{done.sweep.name}: What a step costs, by case", *columns, right=(3, 4, 5, 6))
    costs = {(one.engine, one.case, repr(one.values), step): _cost(one, step) for one in made for step in one.runs}
    records: list[Record] = []
    for one in made:
        if not one.supported:
            continue
        for step in one.runs:
            cost = costs[one.engine, one.case, repr(one.values), step]
            plain = costs.get((one.engine, None, repr(one.values), step))
            ratio = cost / plain if cost is not None and plain else None
            runs = len([row for _, row in one.runs[step] if row.failed is None])
            said = _said(done, one, step)
            told = f"{1e6 * cost:.3g} µs" if cost is not None else "–"
            compared = two_digits(ratio) if ratio is not None and one.case is not None else "–"
            names = (one.told_values, one.case or "–", one.engine, milliseconds(step))
            shown.add_row(*names, told, compared, number(runs), said or "–")
            records.append(
                {"settings": one.label, "engine": one.engine, "timestep": step, "case": one.case, "runs": runs}
                | {"seconds_per_step": cost, "ratio": ratio, "said": said}
            )
    shown.caption = NOTE
    return [Shown("case_cost", shown, records), Shown("case_cost.unsupported", unsupported_table(done, made))]


def _cost(one: Variant, step: float) -> float | None:
    """Seconds a step."""
    runs = [row for _, row in one.runs[step] if row.failed is None and row.steps and row.cpu_seconds is not None]
    return min((row.cpu_seconds / row.steps for row in runs if row.cpu_seconds is not None), default=None)


def _said(done: Done, one: Variant, step: float) -> str:
    """What engines said of the runs, and why runs failed, each once."""
    told: dict[str, None] = {}
    for _, row in one.runs[step]:
        if row.failed is not None:
            told[f"failed: {row.failed}"] = None
        else:
            told |= dict.fromkeys(map(str, done.store.load(row.key, tables=False).provenance.get("warnings", ())))
    return "; ".join(told)
