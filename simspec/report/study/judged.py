"""The runs of a sweep, each held against what the study expects of it; done once for all tables."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from simspec.analysis.failures import Failure, first_failure
from simspec.analysis.validity import Trial, trial
from simspec.experiments.cases import world_of
from simspec.experiments.index import Row
from simspec.experiments.plan import Cell
from simspec.report.kit import length, number
from simspec.report.study.done import Done
from simspec.runner.expectations import Outcome, evaluate
from simspec.runner.run import Run


@dataclass(frozen=True)
class Deviation:
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
    row: Row
    trial: Trial
    deviation: Deviation | None
    failure: Failure | None


def judged(done: Done, case: str | None = None) -> list[Judged]:
    """The first repetition of each run of a case. Raises SpecError where nothing is expected."""
    if ("judged", case) not in done.kept:
        done.kept["judged", case] = [_judge(done, cell, row) for cell, row in done.runs(case) if cell.repeat == 0]
    runs: list[Judged] = done.kept["judged", case]
    return runs


def _judge(done: Done, cell: Cell, row: Row) -> Judged:
    run = done.store.load(row.key)
    # what is expected is of the study, and may be other than when the run was made
    run = dataclasses.replace(run, world=world_of(done.outcome.plan, cell))
    with np.errstate(over="ignore"):  # what flies off may be farther than numbers go: infinitely far
        outcomes = evaluate(run)
        return Judged(cell, row, trial(run, outcomes), _deviation(run, outcomes), first_failure(run, outcomes))


def _deviation(run: Run, outcomes: list[Outcome]) -> Deviation | None:
    pairs = zip(run.world.expectations, outcomes, strict=True)
    measured = [
        Deviation(one.measured, one.bound, one.unit)
        for asked, one in pairs
        if one.measured is not None and "tolerance" in dict(asked.parameters)
    ]
    return max(measured, key=lambda one: one.share, default=None)


def worst(runs: list[Judged]) -> Deviation | None:
    """The deviation of several runs that is the largest share of its tolerance."""
    return max((one.deviation for one in runs if one.deviation is not None), key=lambda one: one.share, default=None)
