"""The runs of one sweep of a study, grouped as its tables need them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simspec.analysis.speed import Speed, speed
from simspec.analysis.validity import Failure, TimestepTrial, first_failure, trial
from simspec.attribution.explanation import Explanation
from simspec.errors import clipped
from simspec.experiments.after_sweep import SecondPass
from simspec.experiments.cases import world_of
from simspec.experiments.index import RunRow
from simspec.experiments.plan import Cell
from simspec.experiments.store import Store
from simspec.experiments.sweep import REFUSED, SweepOutcome
from simspec.language.load import SweepOfStudy
from simspec.language.sweep import Figure
from simspec.report.table import Table, length, number
from simspec.runner.expectations import Outcome as ExpectationsOutcome
from simspec.runner.expectations import evaluate
from simspec.runner.run import Run

Record = Mapping[str, Any]
"""A row of data: text, truth values, finite numbers, None, and lists of these, by name. SI units."""


@dataclass(frozen=True)
class StudyExplanation:
    """The explanation of the difference of an engine from the ``first`` of a sweep; None: there is none, for the reason
    ``refused``."""

    engine: str
    first: str
    found: Explanation | None
    refused: str = ""


@dataclass(frozen=True)
class Done:
    """One sweep of a study that was done: ``figures``: those from elsewhere that it is held against; ``moved``: its second
    passes; ``kept``: results that several tables need, computed once."""

    sweep: SweepOfStudy
    outcome: SweepOutcome
    store: Store
    figures: Sequence[Figure]
    moved: Sequence[tuple[SecondPass, SweepOutcome]] = ()
    explained: Sequence[StudyExplanation] = ()
    """Where the other engines differ from the first, where the study shows it."""
    kept: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)

    def runs(self, case: str | None = None, whole: bool = False) -> Iterator[tuple[Cell, RunRow]]:
        """The runs of a case that are there; ``whole``: without those that failed."""
        for cell, row in self.outcome.rows():
            if row is not None and cell.case == case and not (whole and row.failed is not None):
                yield cell, row

    @property
    def engines(self) -> tuple[str, ...]:
        """The engines, in the order in which they took turns."""
        return self.outcome.plan.engines


class StudyTable(Table):
    """A table that a study shows of a sweep. ``name``: unique in its sweep (``docs/guide/studies.md``); ``records``: its
    figures as data, not rounded."""

    def __init__(self, done: Done, name: str, title: str, *columns: str, right: Sequence[int] = (), note: str = ""):
        super().__init__(f"{done.sweep.name}: {title}", *columns, right=right, note=note)
        self.name = name
        self.records: list[Record] = []

    def add(self, *values: Any, record: Record | None = None) -> None:
        """Add a row, with its figures as data."""
        super().add(*values)
        self.records += [record] if record is not None else []


def finite(value: float | None) -> float | None:
    """A number as data: None where there is none, or none that JSON has."""
    return value if value is not None and math.isfinite(value) else None


def speeds_of(done: Done, case: str | None = None) -> dict[float, dict[str, Speed]]:
    """The speed by timestep and engine, where there is a whole run."""
    runs: dict[tuple[float, str], list[Any]] = {}
    for cell, row in done.runs(case, whole=True):
        runs.setdefault((row.timestep, cell.engine), []).append(done.store.load(row.key, tables=False))
    speeds: dict[float, dict[str, Speed]] = {}
    for (timestep, engine), local in sorted(runs.items(), key=lambda item: item[0]):
        speeds.setdefault(timestep, {})[engine] = speed(local)
    return speeds


def elsewhere(figure: Figure) -> str:
    """The head of a column of figures from elsewhere: a name that no engine of simspec has."""
    return f"{figure.engine} (elsewhere{'' if figure.models == 'as-published' else f', {figure.models}'})"


def figure_at(figure: Figure, timestep: float) -> float | None:
    steps = figure.timesteps or ()
    return next((value for step, value in zip(steps, figure.values, strict=True) if abs(step - timestep) < 1e-9), None)


def milliseconds(timestep: float) -> str:
    return f"{1e3 * timestep:g} ms"


def figure_records(figures: Iterable[Figure]) -> list[Record]:
    """Figures from elsewhere as data, a record for each value; ``elsewhere`` distinguishes them from those of runs."""
    names = ("engine", "models", "quantity", "unit", "source")
    return [
        {"elsewhere": True, **{name: getattr(figure, name) for name in names}, "timestep": timestep, "value": value}
        for figure in figures
        for timestep, value in zip(figure.timesteps or (None,), figure.values, strict=True)
    ]


# Runs by world: engines, perturbations and repetitions of one world.

TIMESTEP = "physics.timestep"
Member = tuple[Cell, RunRow]


@dataclass
class Runs:
    """The runs of one world of a sweep: ``of[engine]`` in the order of the plan, failed ones too, repetitions left out."""

    timestep: float
    values: str
    of: dict[str, list[Member]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The timestep, and the other values of the sweep."""
        return f"{milliseconds(self.timestep)}, {self.values}" if self.values else milliseconds(self.timestep)

    def about(self, engine: str) -> dict[str, Any]:
        """The names of a record of an engine."""
        return {"timestep": self.timestep, "values": self.values, "engine": engine}

    def unmoved(self, engine: str) -> Member | None:
        """The run of an engine whose initial state is not moved; None where there is none."""
        return next((member for member in self.of.get(engine, ()) if member[0].seed is None), None)

    def moved(self, engine: str) -> Mapping[int, RunRow]:
        """The whole runs of an engine by seed; the one that is not moved has seed 0."""
        return {cell.seed or 0: row for cell, row in self.of.get(engine, ()) if row.failed is None}


def worlds_of(done: Done) -> list[Runs]:
    """The worlds of a sweep without its named cases, by timestep."""
    worlds: dict[tuple[float, str, int | None], Runs] = {}
    for cell, row in done.runs():
        if cell.repeat == 0:
            values = ", ".join(f"{path}: {value}" for path, value in cell.overrides if path != TIMESTEP)
            if cell.sample is not None:
                values = f"sample {cell.sample}"
            runs = worlds.setdefault((row.timestep, values, cell.sample), Runs(row.timestep, values))
            runs.of.setdefault(cell.engine, []).append((cell, row))
    return [worlds[key] for key in sorted(worlds, key=lambda key: key[:2])]


# Runs by variant: engine, case and values.

PLAIN = "–"
"""The name of the scenario itself among its cases."""
LONGEST = 60
"""Characters of a value."""


@dataclass
class Variant:
    """The runs of an engine of a case with the same values: ``runs`` by timestep (s), in the order of the plan."""

    engine: str
    case: str | None
    values: tuple[tuple[str, Any], ...]
    runs: dict[float, list[tuple[Cell, RunRow]]] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The case and the values in words."""
        text = self.value_words
        return ", ".join([*([self.case] if self.case is not None else []), *([text] if text != PLAIN else [])]) or PLAIN

    @property
    def value_words(self) -> str:
        """The values in words."""
        texts = [f"{path.rpartition('.')[2]} {clipped(str(value), LONGEST)}" for path, value in self.values]
        return ", ".join(texts) or PLAIN

    def all_runs(self) -> Iterator[tuple[Cell, RunRow]]:
        """The runs of all timesteps."""
        for runs in self.runs.values():
            yield from runs

    @staticmethod
    def refused(row: RunRow) -> bool:
        """Whether the engine does not support the scenario of a run."""
        return row.failed is not None and row.failed.startswith(REFUSED)

    @property
    def supported(self) -> bool:
        """Whether the engine supports it at any timestep."""
        return not all(self.refused(row) for _, row in self.all_runs())

    def refusals(self) -> list[str]:
        """Why the engine does not support the scenario with these values, each reason once."""
        failed = [row.failed for _, row in self.all_runs() if row.failed is not None and self.refused(row)]
        return list(dict.fromkeys(why.removeprefix(REFUSED).removeprefix(": ") for why in failed))


def variants(done: Done) -> list[Variant]:
    """The variants of a sweep that have runs, in the order of the plan.

    A case that changes nothing for an engine (it has settings of another one) has the very runs of a variant before it, and is
    left out.
    """
    cases: Mapping[str, Mapping[str, Any]] = done.outcome.plan.sweep.cases
    samples = done.outcome.plan.sweep.samples
    drawn = set(samples.values) if samples is not None else set()
    found: dict[tuple[str, str | None, str], Variant] = {}
    for cell, row in done.outcome.rows():
        if row is None:
            continue
        aside = {TIMESTEP, *drawn, *(cases[cell.case] if cell.case is not None else ())}
        values = tuple((path, value) for path, value in cell.overrides if path not in aside)
        variant = found.setdefault((cell.engine, cell.case, repr(values)), Variant(cell.engine, cell.case, values))
        variant.runs.setdefault(row.timestep, []).append((cell, row))
    first: dict[tuple[str, ...], Variant] = {}
    for variant in found.values():
        first.setdefault(tuple(row.key for _, row in variant.all_runs()), variant)
    return list(first.values())


def timesteps_of(made: list[Variant]) -> list[float]:
    """All timesteps (s) of some variants, the smallest first."""
    return sorted({timestep for variant in made for timestep in variant.runs})


def unsupported_table(done: Done, name: str, made: list[Variant]) -> StudyTable:
    """Which engines do not support which variants, and why."""
    reasons: dict[tuple[str, str], dict[str, None]] = {}
    for variant in made:
        for why in variant.refusals():
            reasons.setdefault((variant.engine, why), {})[variant.label] = None
    shown = StudyTable(done, f"{name}.unsupported", "Not supported", "engine", "settings", "why")
    for (engine, why), labels in reasons.items():
        shown.add(engine, ", ".join(labels), why)
    if not reasons:
        shown.add("none", PLAIN, "every engine supports everything that was requested")
    return shown


# Runs judged by the expectations of the study; computed once for all tables.


@dataclass(frozen=True)
class LargestDeviation:
    """The deviation of a run that is the largest share of its tolerance, and both, in ``unit``."""

    value: float
    tolerance: float
    unit: str

    @property
    def share(self) -> float:
        """Of the tolerance; infinite of none."""
        return self.value / self.tolerance if self.tolerance else (0.0 if self.value == 0.0 else float("inf"))

    def __str__(self) -> str:
        return length(self.value) if self.unit == "m" else number(self.value, self.unit)


@dataclass(frozen=True)
class Judged:
    """A run: whether it does what is expected, its largest deviation (None where nothing was measured that has a tolerance),
    and what happened first where it does not."""

    cell: Cell
    row: RunRow
    trial: TimestepTrial
    deviation: LargestDeviation | None
    failure: Failure | None


def judged(done: Done, case: str | None = None) -> list[Judged]:
    """The first repetition of each run of a case. Raises SpecError where nothing is expected."""
    if ("judged", case) not in done.kept:
        done.kept["judged", case] = [_judge(done, cell, row) for cell, row in done.runs(case) if cell.repeat == 0]
    runs: list[Judged] = done.kept["judged", case]
    return runs


def _judge(done: Done, cell: Cell, row: RunRow) -> Judged:
    run = done.store.load(row.key)
    # the expectations are those of the study, and may differ from those when the run was made
    run = dataclasses.replace(run, world=world_of(done.outcome.plan, cell))
    with np.errstate(over="ignore"):  # bodies that fly off may overflow: infinitely far
        outcomes = evaluate(run)
        return Judged(cell, row, trial(run, outcomes), _deviation(run, outcomes), first_failure(run, outcomes))


def _deviation(run: Run, outcomes: list[ExpectationsOutcome]) -> LargestDeviation | None:
    pairs = zip(run.world.expectations, outcomes, strict=True)
    measured = [
        LargestDeviation(outcome.measured, outcome.bound, outcome.unit)
        for expectation, outcome in pairs
        if outcome.measured is not None and "tolerance" in dict(expectation.parameters)
    ]
    return max(measured, key=lambda deviation: deviation.share, default=None)


def worst(runs: list[Judged]) -> LargestDeviation | None:
    """The deviation of several runs that is the largest share of its tolerance."""
    return max(
        (run.deviation for run in runs if run.deviation is not None), key=lambda entry: entry.share, default=None
    )
