"""What a study came to, as tables: speed, load, limits of validity, speed over time, determinism, unequal models; each beside
the figures from elsewhere that the study names."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from simspec.analysis.determinism import determinism
from simspec.analysis.speed import Speed, speed
from simspec.analysis.validity import limit, trial
from simspec.experiments.cases import world_of
from simspec.experiments.index import Row
from simspec.experiments.plan import Cell
from simspec.experiments.store import Store
from simspec.experiments.sweep import Outcome
from simspec.language.study import Figure
from simspec.language.study_specs import SweepOfStudy
from simspec.report.kit import length, number, table
from simspec.report.page.sheets import Sheet
from simspec.runner.expectations import evaluate

SPREAD = "spread at the end"
EQUAL = "equal models"
SAME_WORLD = "the scenario itself"


@dataclass(frozen=True)
class Done:
    """One sweep of a study that was done: ``figures``: those from elsewhere that it is held against."""

    sweep: SweepOfStudy
    outcome: Outcome
    store: Store
    figures: Sequence[Figure]

    def runs(self, case: str | None = None, whole: bool = False) -> Iterator[tuple[Cell, Row]]:
        """The runs of a case that are there; ``whole``: without those that failed."""
        for cell, row in self.outcome.rows():
            if row is not None and cell.case == case and not (whole and row.failed is not None):
                yield cell, row

    @property
    def engines(self) -> tuple[str, ...]:
        """The engines, in the order in which they took turns."""
        return self.outcome.plan.engines


def tables(done: Done) -> list[Table]:
    """The tables that the study shows of a sweep."""
    return [made for word in done.sweep.words.show for made in _SHOWN[word](done)]


def markdown(sheet: Sheet) -> str:
    """A table in Markdown, with its title above and its note below."""
    lines = [f"**{_escaped(sheet.title)}**", ""]
    lines.append("| " + " | ".join(_escaped(cell.text) for cell in sheet.head) + " |")
    lines.append("|" + "|".join("---:" if "right" in cell.classes else "---" for cell in sheet.head) + "|")
    lines += ["| " + " | ".join(_escaped(cell.text) for cell in row) + " |" for row in sheet.rows]
    return "\n".join([*lines, *(["", _escaped(sheet.note)] if sheet.note else []), ""])


def _escaped(text: str) -> str:
    for character in "\\|<>`*_[]":
        text = text.replace(character, f"\\{character}")
    return text.replace("\n", " ")


# --- speed --------------------------------------------------------------------------------------------------------------


def _speeds(done: Done, case: str | None = None) -> dict[float, dict[str, Speed]]:
    """The speed by timestep and engine; what has no whole run is not there."""
    runs: dict[tuple[float, str], list[Any]] = {}
    for cell, row in done.runs(case, whole=True):
        runs.setdefault((row.timestep, cell.engine), []).append(done.store.load(row.key, tables=False))
    speeds: dict[float, dict[str, Speed]] = {}
    for (timestep, engine), own in sorted(runs.items(), key=lambda item: item[0]):
        speeds.setdefault(timestep, {})[engine] = speed(own)
    return speeds


def _speed(done: Done) -> list[Table]:
    speeds = _speeds(done)
    made = [
        _by_timestep(
            done, speeds, "real_time_factor", "Real-time factor: simulated time over the wall time of the steps"
        ),
        _by_timestep(done, speeds, "cpu_factor", "The same over the steps' processor time"),
    ]
    for shown in made:
        shown.caption = "Median, interval of the mean (95 %), and over how many processes"
    return made


def _by_timestep(done: Done, speeds: Mapping[float, Mapping[str, Speed]], name: str, title: str) -> Table:
    figures = [figure for figure in done.figures if figure.quantity == name and figure.timesteps is not None]
    heads = [*done.engines, *(_elsewhere(figure) for figure in figures)]
    made = table(f"{done.sweep.name}: {title}", "timestep", *heads, right=range(1 + len(heads)))
    for timestep, own in speeds.items():
        cells = [
            str(own[engine][name]) if engine in own and name in own[engine].figures else "–" for engine in done.engines
        ]
        made.add_row(_ms(timestep), *cells, *(number(_at(figure, timestep)) for figure in figures))
    return made


def _elsewhere(figure: Figure) -> str:
    """What a column of figures from elsewhere is called: a name that no engine of simspec has."""
    return f"{figure.engine} (elsewhere{'' if figure.models == 'as-published' else f', {figure.models}'})"


def _at(figure: Figure, timestep: float) -> float | None:
    steps = figure.timesteps or ()
    return next((value for step, value in zip(steps, figure.values, strict=True) if abs(step - timestep) < 1e-9), None)


def _ms(timestep: float) -> str:
    return f"{1e3 * timestep:g} ms"


def _load(done: Done) -> list[Table]:
    columns = ("timestep", "engine", "load of the steps", "load of the process", "peak memory")
    made = table(f"{done.sweep.name}: Load of the processor and memory", *columns, right=(0, 2, 3, 4))
    for timestep, engines in _speeds(done).items():
        for engine, own in engines.items():
            loads = [
                f"{own[name].median:.0%}" if name in own.figures else "–" for name in ("step_load", "process_load")
            ]
            memory = f"{own['peak_memory'].median / 2**20:.0f} MiB" if "peak_memory" in own.figures else "–"
            made.add_row(_ms(timestep), engine, *loads, memory)
    made.caption = (
        "Processor time over wall time: 100 % is one processor that was never taken away. Medians over processes"
    )
    return [made]


# --- validity, determinism ----------------------------------------------------------------------------------------------


def _validity(done: Done) -> list[Table]:
    made = table(f"{done.sweep.name}: Up to which timestep all that is expected holds", "engine", "limit", "runs")
    for engine in done.engines:
        trials = []
        for cell, row in done.runs():
            if cell.engine == engine and cell.repeat == 0:
                run = done.store.load(row.key, tables=row.failed is None)
                # what is expected is of the study, and may be other than when the run was made
                run = dataclasses.replace(run, world=world_of(done.outcome.plan, cell))
                trials.append(trial(run, evaluate(run)))
        made.add_row(engine, str(limit(trials)) if trials else "no runs", str(len(trials)))
    for figure in done.figures:
        if figure.quantity == "largest_valid_timestep":
            made.add_row(_elsewhere(figure), Text(f"{_ms(figure.values[0])}: {figure.source}"), "–")
    return [made]


def _determinism(done: Done) -> list[Table]:
    made = table(f"{done.sweep.name}: The same run again", "timestep", "engine", "result", right=(0,))
    keyed = sorted(done.runs(whole=True), key=lambda item: (item[1].timestep, done.engines.index(item[0].engine)))
    repeats: dict[tuple[float, str, str], list[str]] = {}
    for cell, row in keyed:
        repeats.setdefault((row.timestep, cell.engine, repr((cell.overrides, cell.seed))), []).append(row.key)
    for (timestep, engine, _), keys in repeats.items():
        if len(keys) < 2:
            made.add_row(_ms(timestep), engine, "one run only: nothing to compare")
        else:
            made.add_row(_ms(timestep), engine, str(determinism([done.store.load(key) for key in keys])))
    return [made]


# --- speed over time ----------------------------------------------------------------------------------------------------


def _over_time(done: Done) -> list[Table]:
    """The cost of each interval is the difference of the costs of two runs that end at its ends."""
    costs: dict[str, dict[float, list[float]]] = {engine: {} for engine in done.engines}
    longest: dict[str, Row] = {}
    for cell, row in done.runs(whole=True):
        if row.cpu_seconds is not None:
            costs[cell.engine].setdefault(round(row.steps * row.timestep, 9), []).append(row.cpu_seconds)
        if cell.engine not in longest or row.steps > longest[cell.engine].steps:
            longest[cell.engine] = row
    heads = [head for engine in done.engines for head in (f"{engine}, real time", "contacts")]
    made = table(f"{done.sweep.name}: Real-time factor over time", "time", *heads, right=range(1 + len(heads)))
    times = sorted({time for own in costs.values() for time in own})
    counted = {engine: _contacts(done, row) for engine, row in longest.items()}
    for begin, end in itertools.pairwise([0.0, *times]):
        cells = []
        for engine in done.engines:
            own = {0.0: [0.0], **costs[engine]}
            spent = median(own[end]) - median(own[begin]) if begin in own and end in own else 0.0
            cells += [number((end - begin) / spent if spent > 0.0 else None), _mean(counted.get(engine), begin, end)]
        made.add_row(f"{begin:g} to {end:g} s", *cells)
    made.caption = (
        "Simulated time over processor time, from the difference of runs of two durations (medians); – where noise hides it. "
        "Contacts: points, the mean of the records"
    )
    return [made]


def _contacts(done: Done, row: Row) -> tuple[np.ndarray, np.ndarray] | None:
    """The recorded times of a run, and how many points of contact there were; None where they were not recorded."""
    arrays = done.store.load(row.key).arrays
    if "contact.row" not in arrays:
        return None
    return arrays["time"], np.bincount(np.asarray(arrays["contact.row"]), minlength=len(arrays["time"]))


def _mean(counted: tuple[np.ndarray, np.ndarray] | None, begin: float, end: float) -> str:
    if counted is None:
        return "–"
    time, count = counted
    inside = (time > begin + 1e-9) & (time <= end + 1e-9)
    return f"{count[inside].mean():.0f}" if inside.any() else "–"


# --- unequal models -----------------------------------------------------------------------------------------------------


def _unequal(done: Done) -> list[Table]:
    """Equal models first, then each comparison of unequal ones: speed, spread, and who is ahead."""
    made = [_comparison(done, EQUAL, {})]
    made += [_comparison(done, name, own) for name, own in done.sweep.words.unequal.items()]
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
                shown.add_row(one.engine, one.models, one.quantity.replace("_", " "), _ms(timestep), told)
        shown.caption = "; ".join(dict.fromkeys(one.source for one in elsewhere))
        made.append(shown)
    return made


def _comparison(done: Done, name: str, own: Mapping[str, str]) -> Table:
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
        for timestep, speeds in _speeds(done, own.get(engine)).items():
            if engine in speeds and "cpu_factor" in speeds[engine].figures:
                factors.setdefault(timestep, {})[engine] = speeds[engine]["cpu_factor"].median
        for cell, row in done.runs(own.get(engine), whole=True):
            if cell.engine == engine and SPREAD in row.quantities:
                spreads.setdefault((row.timestep, engine), []).append(row.quantities[SPREAD])
    for timestep, speeds_at in sorted(factors.items()):
        cells = []
        for engine in done.engines:
            wide = spreads.get((timestep, engine))
            cells += [number(speeds_at.get(engine)), length(median(wide) if wide else None)]
        shown.add_row(_ms(timestep), *cells, ranking(speeds_at))
    return shown


def ranking(factors: Mapping[str, float]) -> str:
    """The engines, the fastest first, with how many times faster each is than the next."""
    ordered = sorted(factors, key=lambda engine: -factors[engine])
    parts = ordered[:1]
    for first, second in itertools.pairwise(ordered):
        parts.append(f"{factors[first] / factors[second]:.2g} × {second}" if factors[second] > 0.0 else second)
    return " = ".join(parts)


def _values(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{path}: {value}" for path, value in values.items())


_SHOWN: Mapping[str, Callable[[Done], list[Table]]] = {
    "speed": _speed,
    "load": _load,
    "validity": _validity,
    "over_time": _over_time,
    "determinism": _determinism,
    "unequal": _unequal,
}
