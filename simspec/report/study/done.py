"""One sweep of a study that was done, and what every table of it needs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rich.table import Table

from simspec.analysis.speed import Speed, speed
from simspec.attribution.explanation import Explanation
from simspec.experiments.first_gap import SecondPass
from simspec.experiments.index import Row
from simspec.experiments.plan import Cell
from simspec.experiments.store import Store
from simspec.experiments.sweep import Outcome
from simspec.language.study import Figure
from simspec.language.study_specs import SweepOfStudy

Record = Mapping[str, Any]
"""A row of data: text, truth values, finite numbers, None, and lists of these, by name. SI units."""


@dataclass(frozen=True)
class Explained:
    """What ``simspec explain`` finds of an engine beside the ``first`` of a sweep; None: nothing was asked, for the reason
    ``refused``."""

    engine: str
    first: str
    found: Explanation | None
    refused: str = ""


@dataclass(frozen=True)
class Done:
    """One sweep of a study that was done: ``figures``: those from elsewhere that it is held against; ``moved``: its second
    passes; ``kept``: what several tables need of the runs, worked out once."""

    sweep: SweepOfStudy
    outcome: Outcome
    store: Store
    figures: Sequence[Figure]
    moved: Sequence[tuple[SecondPass, Outcome]] = ()
    explained: Sequence[Explained] = ()
    """Where the other engines differ from the first, where the study shows it."""
    kept: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)

    def runs(self, case: str | None = None, whole: bool = False) -> Iterator[tuple[Cell, Row]]:
        """The runs of a case that are there; ``whole``: without those that failed."""
        for cell, row in self.outcome.rows():
            if row is not None and cell.case == case and not (whole and row.failed is not None):
                yield cell, row

    @property
    def engines(self) -> tuple[str, ...]:
        """The engines, in the order in which they took turns."""
        return self.outcome.plan.engines


@dataclass(frozen=True)
class Shown:
    """One thing that a study shows of a sweep. ``name``: by which pages ask for the table
    (``docs/guide/studies.md``), unique in its
    sweep; ``records``: its figures as data, not rounded; ``said``: what it says, in sentences computed from the same
    figures."""

    name: str
    table: Table
    records: Sequence[Record] = ()
    said: tuple[str, ...] = ()


def finite(value: float | None) -> float | None:
    """A number as data: None where there is none, or none that JSON has."""
    return value if value is not None and math.isfinite(value) else None


def speeds_of(done: Done, case: str | None = None) -> dict[float, dict[str, Speed]]:
    """The speed by timestep and engine; what has no whole run is not there."""
    runs: dict[tuple[float, str], list[Any]] = {}
    for cell, row in done.runs(case, whole=True):
        runs.setdefault((row.timestep, cell.engine), []).append(done.store.load(row.key, tables=False))
    speeds: dict[float, dict[str, Speed]] = {}
    for (timestep, engine), own in sorted(runs.items(), key=lambda item: item[0]):
        speeds.setdefault(timestep, {})[engine] = speed(own)
    return speeds


def elsewhere(figure: Figure) -> str:
    """What a column of figures from elsewhere is called: a name that no engine of simspec has."""
    return f"{figure.engine} (elsewhere{'' if figure.models == 'as-published' else f', {figure.models}'})"


def figure_at(figure: Figure, timestep: float) -> float | None:
    steps = figure.timesteps or ()
    return next((value for step, value in zip(steps, figure.values, strict=True) if abs(step - timestep) < 1e-9), None)


def milliseconds(timestep: float) -> str:
    return f"{1e3 * timestep:g} ms"


def figure_records(figures: Iterable[Figure]) -> list[Record]:
    """Figures from elsewhere as data, a record for each value; ``elsewhere`` tells them from those of runs."""
    return [
        {"elsewhere": True, "engine": one.engine, "models": one.models, "quantity": one.quantity, "unit": one.unit}
        | {"source": one.source, "timestep": timestep, "value": value}
        for one in figures
        for timestep, value in zip(one.timesteps or (None,), one.values, strict=True)
    ]
