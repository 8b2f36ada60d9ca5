"""What a spec expects of its runs, and whether a run fulfils it.

Each expectation is measured (:mod:`simspec.runner.measures`) and compared with one bound. A run that failed, or has no record
of what an expectation needs, does not fulfil it.
"""

from __future__ import annotations

from dataclasses import dataclass

from simspec.runner.measures import MEASURES, Parameters, Unmeasurable
from simspec.runner.run import Run
from simspec.world.types import Expectation


@dataclass(frozen=True)
class Outcome:
    """One expectation held against one run: what was measured (None when it could not be), the bound that it must not
    pass, their unit, and where or when the measured value occurred."""

    kind: str
    passed: bool
    measured: float | None
    bound: float
    unit: str
    detail: str = ""


BOUNDS = ("tolerance", "depth", "speed", "at_least", "distance")
"""Parameters that are an expectation's bound; each has one of them at most."""


def evaluate(run: Run) -> list[Outcome]:
    """The outcome of every expectation of the run's world, in the world's order."""
    return [_evaluate(run, expectation) for expectation in run.world.expectations]


def _evaluate(run: Run, expectation: Expectation) -> Outcome:
    parameters: Parameters = dict(expectation.parameters)
    measure = MEASURES[expectation.kind]
    bound = next((float(parameters[name]) for name in BOUNDS if name in parameters), 0.0)
    if run.failed is not None or not run.recorded:
        return Outcome(expectation.kind, False, None, bound, "", f"the run failed: {run.failed}")
    try:
        measured = measure(run, parameters)
    except Unmeasurable as error:
        return Outcome(expectation.kind, False, None, bound, "", str(error))
    passed = measured.value >= measured.bound if measured.at_least else measured.value <= measured.bound
    return Outcome(
        expectation.kind, bool(passed), float(measured.value), float(measured.bound), measured.unit, measured.detail
    )
