"""How the speed of a run changes while it runs: what the steps between recorded rows took, beside the contacts there."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit.arrays import SECONDS
from simspec.errors import Problem, SpecError
from simspec.runner.metrics import contact_counts
from simspec.runner.run import Run

Numbers = NDArray[np.float64]
INTERVALS = 20
"""Intervals of a table, at most."""


@dataclass(frozen=True)
class Paced:
    """What of one run is needed here, so that its states need not be kept: recorded times (rows,), s; ``seconds`` (rows,
    ``SECONDS``), None where the engine's program does not say; number of contact points (rows,), None where not recorded."""

    label: str
    time: Numbers
    seconds: Numbers | None
    contacts: NDArray[np.int64] | None


def paced(run: Run) -> Paced:
    """That of a run. Raises SpecError where it recorded nothing."""
    if not run.recorded:
        raise SpecError([Problem(f"{run.label} recorded nothing: {run.failed}")])
    contacts = contact_counts(run.arrays) if "contact.row" in run.arrays else None
    seconds = None if run.seconds is None else np.array(run.seconds)
    return Paced(run.label, np.array(run.time), seconds, contacts)


@dataclass(frozen=True)
class Pace:
    """Speed over simulated time. ``intervals``: begin and end of each, s. For each the median over runs: ``seconds`` that were
    spent in it, by the names of ``SECONDS``; simulated time over wall and processor time of the steps; the mean number of
    contact points in its records. None where it was not measured in every run, or was too short for the clock."""

    label: str
    intervals: tuple[tuple[float, float], ...]
    seconds: dict[str, tuple[float | None, ...]]
    real_time_factors: tuple[float | None, ...]
    cpu_factors: tuple[float | None, ...]
    contacts: tuple[float | None, ...]


def over_time(runs: Sequence[Paced], intervals: int = INTERVALS) -> Pace:
    """The speed over time of repeats of one run, in at most so many ``intervals`` of equally many records (the last may have
    fewer).

    Raises SpecError for no runs, for runs of several engines, and for runs that recorded at different times.
    """
    _demand_repeats(runs)
    first = runs[0]
    rows = len(first.time) - 1
    each = max(1, -(-rows // intervals))
    edges = [*range(0, rows, each), rows]
    parts = list(itertools.pairwise(edges))
    spent = {
        name: tuple(_median([_spent(run, column, part) for run in runs]) for part in parts)
        for column, name in enumerate(SECONDS)
    }
    passed = [float(first.time[end] - first.time[begin]) for begin, end in parts]
    return Pace(
        first.label,
        tuple((float(first.time[begin]), float(first.time[end])) for begin, end in parts),
        spent,
        tuple(_factor(*pair) for pair in zip(passed, spent["step"], strict=True)),
        tuple(_factor(*pair) for pair in zip(passed, spent["step_cpu"], strict=True)),
        tuple(_median([_contacts(run, part) for run in runs]) for part in parts),
    )


def _demand_repeats(runs: Sequence[Paced]) -> None:
    if not runs:
        raise SpecError([Problem("there are no runs to take the speed of")])
    first = runs[0]
    for run in runs:
        if run.label != first.label or not np.array_equal(run.time, first.time):
            raise SpecError([Problem("speed over time needs runs of one engine that recorded at the same times")])


def _spent(run: Paced, column: int, part: tuple[int, int]) -> float | None:
    return None if run.seconds is None else float(run.seconds[part[1], column] - run.seconds[part[0], column])


def _contacts(run: Paced, part: tuple[int, int]) -> float | None:
    return None if run.contacts is None else float(run.contacts[part[0] + 1 : part[1] + 1].mean())


def _median(values: Sequence[float | None]) -> float | None:
    measured = [value for value in values if value is not None]
    return median(measured) if len(measured) == len(values) else None


def _factor(passed: float, spent: float | None) -> float | None:
    return passed / spent if spent else None


@dataclass(frozen=True)
class StepCost:
    """What a step costs, in seconds by the names of ``SECONDS``, over repeats of one run, which do the same arithmetic.

    quiet   of each interval between two records the fastest repeat: what disturbs a machine for a while disturbs one of them
    median  of the repeats as they were
    """

    label: str
    steps: int
    repeats: int
    quiet: dict[str, float]
    median: dict[str, float]


def step_cost(runs: Sequence[Paced], steps: int) -> StepCost | None:
    """The cost of a step of runs of so many ``steps``; None where a run was not measured, or has no step.

    Raises SpecError for no runs, for runs of several engines, and for runs that recorded at different times: they are not the
    same arithmetic.
    """
    _demand_repeats(runs)
    measured = [run.seconds for run in runs if run.seconds is not None]
    if len(measured) < len(runs) or not steps:
        return None
    spent = np.stack([np.diff(seconds, axis=0) for seconds in measured])
    fastest, whole = spent.min(axis=0).sum(axis=0), np.median(spent.sum(axis=1), axis=0)
    quiet, usual = (
        {name: float(value) / steps for name, value in zip(SECONDS, one, strict=True)} for one in (fastest, whole)
    )
    return StepCost(runs[0].label, steps, len(runs), quiet, usual)
