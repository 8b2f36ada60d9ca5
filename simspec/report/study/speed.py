"""Tables of speed: by timestep, over time, by part of a step, by case, and with unequal models."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from statistics import median

from simspec.analysis.speed import Paced, Speed, StepCost, over_time, paced, step_cost
from simspec.report.study.runs import (
    Done,
    Record,
    StudyTable,
    Variant,
    elsewhere,
    figure_at,
    figure_records,
    milliseconds,
    speeds_of,
    unsupported_table,
    variants,
)
from simspec.report.table import length, number, two_digits

# Speed over simulated time, with the number of contacts.


def over_time_tables(done: Done) -> list[StudyTable]:
    """``over_time``; of runs of several timesteps or durations a table each, ``over_time.4ms.2s``."""
    runs: dict[tuple[float, float], dict[str, list[Paced]]] = {}
    for cell, row in done.runs(whole=True):
        about = (row.timestep, row.steps * row.timestep)
        local = runs.setdefault(about, {}).setdefault(cell.engine, [])
        local.append(paced(done.store.load(row.key)))
    several = len(runs) > 1
    return [
        _shown(done, about[0], local, f"over_time.{1e3 * about[0]:g}ms.{about[1]:g}s" if several else "over_time")
        for about, local in sorted(runs.items(), key=lambda item: item[0])
    ]


def _shown(done: Done, timestep: float, runs: Mapping[str, Sequence[Paced]], name: str) -> StudyTable:
    paces = {engine: over_time(runs[engine]) for engine in done.engines if engine in runs}
    heads = [head for engine in paces for head in (f"{engine}, real time", "contacts")]
    title = f"Real-time factor over time, timestep {milliseconds(timestep)}"
    made = StudyTable(done, name, title, "time", *heads, right=range(1 + len(heads)))
    for index, (begin, end) in enumerate(next(iter(paces.values())).intervals):
        cells = []
        for engine, pace in paces.items():
            factor, contacts = pace.cpu_factors[index], pace.contacts[index]
            cells += [number(factor), "–" if contacts is None else f"{contacts:.0f}"]
            made.records.append(
                {"timestep": timestep, "begin": begin, "end": end, "engine": engine, "contacts": contacts}
                | {"cpu_factor": factor, "real_time_factor": pace.real_time_factors[index]}
                | {f"{kind}_seconds": values[index] for kind, values in pace.seconds.items()}
            )
        made.add(f"{begin:g} to {end:g} s", *cells)
    counts = sorted({len(run) for run in runs.values()})
    made.note = (
        f"Simulated time over processor time of the steps, median of {', '.join(map(str, counts))} runs; – where it was not "
        "measured. Contacts: points, the mean of the records"
    )
    return made


# Cost of a step: engine, control, recording.

PARTS = {"step": "engine", "control": "control", "record": "recording"}
"""Parts of a step that are shown (wall time), with the heads of their columns."""


def cost_tables(done: Done) -> list[StudyTable]:
    """``cost``: by timestep and engine, from the repetitions of the run whose initial state is not moved."""
    heads = ("real time", "median repeat", *PARTS.values(), "repeats")
    columns = ("timestep", "engine", *heads)
    made = StudyTable(done, "cost", "Cost of a step", *columns, right=(0, *range(2, 2 + len(heads))))
    for (timestep, engine), cost in _costs(done).items():
        if cost is None:
            made.add(milliseconds(timestep), engine, *["–"] * len(heads))
            continue
        factors = [number(timestep / entry["step"] if entry["step"] else None) for entry in (cost.quiet, cost.median)]
        parts = [f"{1e6 * cost.quiet[name]:.1f} µs" for name in PARTS]
        made.add(milliseconds(timestep), engine, *factors, *parts, str(cost.repeats))
        made.records += [
            {"timestep": timestep, "engine": engine, "part": name, "quiet": cost.quiet[name]}
            | {"median": cost.median[name], "repeats": cost.repeats}
            for name in cost.quiet
        ]
    made.note = (
        "Wall time of a step. A repeat does the same arithmetic: of each interval between two records the fastest counts; the "
        "median repeat says how quiet the machine was. – where it was not measured"
    )
    return [made]


def _costs(done: Done) -> dict[tuple[float, str], StepCost | None]:
    repeats: dict[tuple[float, int, str], list[tuple[Paced, int]]] = {}
    for cell, row in done.runs(whole=True):
        if cell.seed is None:
            key = (row.timestep, done.engines.index(cell.engine), repr(cell.overrides))
            repeats.setdefault(key, []).append((paced(done.store.load(row.key)), row.steps))
    return {
        (timestep, done.engines[index]): step_cost([entry for entry, _ in local], local[0][1])
        for (timestep, index, _), local in sorted(repeats.items(), key=lambda item: item[0])
    }


# Cost of a step by case, and warnings of the engines.

NOTE = (
    "Processor time of the step calls over the number of steps: the fastest of the runs, which the machine disturbed least. "
    "Ratio: to the scenario itself with the same values, in the same engine at the same timestep"
)


def case_cost_tables(done: Done) -> list[StudyTable]:
    """``case_cost``."""
    made = variants(done)
    columns = ("values", "case", "engine", "timestep", "a step", "ratio", "runs", "said by the engine")
    shown = StudyTable(done, "case_cost", "Cost of a step, by case", *columns, right=(3, 4, 5, 6), note=NOTE)
    costs = {
        (variant.engine, variant.case, repr(variant.values), step): _cost(variant, step)
        for variant in made
        for step in variant.runs
    }
    for variant in made:
        if not variant.supported:
            continue
        for step in variant.runs:
            cost = costs[variant.engine, variant.case, repr(variant.values), step]
            plain = costs.get((variant.engine, None, repr(variant.values), step))
            ratio = cost / plain if cost is not None and plain else None
            runs = len([row for _, row in variant.runs[step] if row.failed is None])
            said = _said(done, variant, step)
            record = {"settings": variant.label, "engine": variant.engine, "timestep": step, "case": variant.case}
            record |= {"runs": runs, "seconds_per_step": cost, "ratio": ratio, "said": said}
            names = (variant.value_words, variant.case or "–", variant.engine, milliseconds(step))
            compared = two_digits(ratio) if ratio is not None and variant.case is not None else "–"
            cells = (f"{1e6 * cost:.3g} µs" if cost is not None else "–", compared, number(runs), said or "–")
            shown.add(*names, *cells, record=record)
    return [shown, unsupported_table(done, "case_cost", made)]


def _cost(variant: Variant, step: float) -> float | None:
    """Seconds a step."""
    runs = [row for _, row in variant.runs[step] if row.failed is None and row.steps and row.cpu_seconds is not None]
    return min((row.cpu_seconds / row.steps for row in runs if row.cpu_seconds is not None), default=None)


def _said(done: Done, variant: Variant, step: float) -> str:
    """Warnings of the engines, and reasons of failures, each once."""
    given: dict[str, None] = {}
    for _, row in variant.runs[step]:
        if row.failed is not None:
            given[f"failed: {row.failed}"] = None
        else:
            given |= dict.fromkeys(map(str, done.store.load(row.key, tables=False).provenance.get("warnings", ())))
    return "; ".join(given)


# Unequal models: speed, spread and order of the engines.

SPREAD = "spread at the end"
EQUAL = "equal models"


def unequal_tables(done: Done) -> list[StudyTable]:
    """``unequal.equal`` first, then ``unequal.models.NAME`` of each comparison: speed, spread, and who is ahead; and
    ``unequal.elsewhere``."""
    made = [_comparison(done, "unequal.equal", EQUAL, {})]
    made += [
        _comparison(done, f"unequal.models.{name}", f"{name}: these models are NOT EQUAL", cases)
        for name, cases in done.sweep.words.unequal.items()
    ]
    elsewhere = [figure for figure in done.figures if figure.timesteps is not None]
    if elsewhere:
        heads = ("engine", "models", "quantity", "timestep", "value")
        shown = StudyTable(done, "unequal.elsewhere", "Figures from elsewhere", *heads, right=(3, 4))
        for entry in elsewhere:
            for timestep, value in zip(entry.timesteps or (), entry.values, strict=True):
                text = number(value, "" if entry.unit == "1" else entry.unit)
                shown.add(entry.engine, entry.models, entry.quantity.replace("_", " "), milliseconds(timestep), text)
        shown.note = "; ".join(dict.fromkeys(figure.source for figure in elsewhere))
        shown.records = figure_records(elsewhere)
        made.append(shown)
    return made


def _comparison(done: Done, name: str, title: str, cases: Mapping[str, str]) -> StudyTable:
    """Speed and spread where some engines have a case of their own; ``cases``: theirs, by engine."""
    heads = [head for engine in done.engines for head in (f"{engine}, real time", "spread")]
    shown = StudyTable(done, name, title, "timestep", *heads, "order", right=range(1 + len(heads)))
    if cases:
        values = done.outcome.plan.sweep.cases
        changed = {
            case: ", ".join(f"{path}: {value}" for path, value in values[case].items()) for case in cases.values()
        }
        notes = [f"{engine} has {case}: {changed[case]}" for engine, case in cases.items()]
        others = [engine for engine in done.engines if engine not in cases]
        shown.note = "; ".join([*notes, *([f"{', '.join(others)}: the scenario itself"] if others else [])])
    factors: dict[float, dict[str, float]] = {}
    spreads: dict[tuple[float, str], list[float]] = {}
    for engine in done.engines:
        for timestep, speeds in speeds_of(done, cases.get(engine)).items():
            if engine in speeds and "cpu_factor" in speeds[engine].figures:
                factors.setdefault(timestep, {})[engine] = speeds[engine]["cpu_factor"].median
        for cell, row in done.runs(cases.get(engine), whole=True):
            if cell.engine == engine and SPREAD in row.quantities:
                spreads.setdefault((row.timestep, engine), []).append(row.quantities[SPREAD])
    for timestep, speeds_at in sorted(factors.items()):
        cells = []
        for engine in done.engines:
            wide = spreads.get((timestep, engine))
            spread = median(wide) if wide else None
            cells += [number(speeds_at.get(engine)), length(spread)]
            shown.records.append(
                {"timestep": timestep, "engine": engine, "case": cases.get(engine), "cpu_factor": speeds_at.get(engine)}
                | {"spread": spread}
            )
        shown.add(milliseconds(timestep), *cells, ranking(speeds_at))
    return shown


def ranking(factors: Mapping[str, float], intervals: Mapping[str, tuple[float, float]] | None = None) -> str:
    """The engines, the fastest first, each compared with the next: ``b is 3 × as fast as a, a 2 × as fast as c``. Where
    ``intervals`` of the two overlap, that is said."""
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


# Speed and load by timestep, with figures from elsewhere.

FACTORS = {
    "real_time_factor": "Real-time factor: simulated time over the wall time of the steps",
    "cpu_factor": "The same over the steps' processor time",
}
LOADS = ("step_load", "process_load", "peak_memory")


def speed_tables(done: Done) -> list[StudyTable]:
    """``speed.real_time_factor`` and ``speed.cpu_factor``."""
    speeds = speeds_of(done)
    return [_by_timestep(done, speeds, name, title) for name, title in FACTORS.items()]


def _by_timestep(done: Done, speeds: Mapping[float, Mapping[str, Speed]], name: str, title: str) -> StudyTable:
    figures = [figure for figure in done.figures if figure.quantity == name and figure.timesteps is not None]
    heads = [*done.engines, *(elsewhere(figure) for figure in figures)]
    made = StudyTable(done, f"speed.{name}", title, "timestep", *heads, right=range(1 + len(heads)))
    made.records = _records(done, speeds, [name])
    for timestep, speed in speeds.items():
        cells = [
            str(speed[engine][name]) if engine in speed and name in speed[engine].figures else "–"
            for engine in done.engines
        ]
        made.add(milliseconds(timestep), *cells, *(number(figure_at(figure, timestep)) for figure in figures))
    made.note = "Median, interval of the mean (95 %), and over how many processes"
    return made


def load_tables(done: Done) -> list[StudyTable]:
    """``load``."""
    columns = ("timestep", "engine", "load of the steps", "load of the process", "peak memory")
    made = StudyTable(done, "load", "Load of the processor and memory", *columns, right=(0, 2, 3, 4))
    speeds = speeds_of(done)
    made.records = _records(done, speeds, LOADS)
    for timestep, engines in speeds.items():
        for engine, speed in engines.items():
            loads = [f"{speed[name].median:.0%}" if name in speed.figures else "–" for name in LOADS[:2]]
            memory = f"{speed['peak_memory'].median / 2**20:.0f} MiB" if "peak_memory" in speed.figures else "–"
            made.add(milliseconds(timestep), engine, *loads, memory)
    made.note = (
        "Processor time over wall time: 100 % is one processor that was never taken away. Medians over processes"
    )
    return [made]


def _records(done: Done, speeds: Mapping[float, Mapping[str, Speed]], names: Iterable[str]) -> list[Record]:
    """The figures ``names`` of each timestep and engine, with their interval and the values of the processes; and those from
    elsewhere."""
    records: list[Record] = []
    for timestep, engines in speeds.items():
        for engine, speed in engines.items():
            for name in (name for name in names if name in speed.figures):
                interval = speed[name].mean
                records.append(
                    {"timestep": timestep, "engine": engine, "quantity": name, "median": speed[name].median}
                    | {"lower": interval.lower if interval else None, "upper": interval.upper if interval else None}
                    | {"values": list(speed[name].values)}
                )
    return records + figure_records(figure for figure in done.figures if figure.quantity in names)
