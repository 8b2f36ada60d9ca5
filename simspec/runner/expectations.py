"""What a spec expects of its runs, and whether a run fulfils it.

Each expectation is measured (:mod:`simspec.runner.measures`) and compared with one bound. A run that failed, or has no record
of what an expectation needs, does not fulfil it. A bound on a distance that is finer than the engine repeats its own run is the
author's word all the same: a run that misses it does not fulfil it, and the outcome says that rounding alone may make so much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.registry import engines
from simspec.runner.measures import MEASURES, Measured, Parameters, Unmeasurable
from simspec.runner.run import Run


@dataclass(frozen=True)
class Outcome:
    """One expectation held against one run: what was measured (None when it could not be), the bound that it must not
    pass, their unit, and where or when the measured value occurred. ``hint``: what can be done where the engine's numbers are
    too coarse for the bound."""

    kind: str
    passed: bool
    measured: float | None
    bound: float
    unit: str
    detail: str = ""
    hint: str = ""


BOUNDS = ("tolerance", "depth", "speed", "at_least", "distance")
"""Parameters that are an expectation's bound; each has one of them at most."""


ROUNDING_MAKES = 3.0
"""A miss of up to this many times the noise may be rounding alone, as for the differences of two engines."""


def evaluate(run: Run, noise: np.ndarray | None = None) -> list[Outcome]:
    """The outcome of every expectation of the run's world, in the world's order. ``noise``: to what distance (m) the engine
    repeats this run, by recorded row and body, where that was measured."""
    return [_evaluate(run, number, noise) for number in range(len(run.world.expectations))]


def _evaluate(run: Run, number: int, noise: np.ndarray | None) -> Outcome:
    expectation = run.world.expectations[number]
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
    detail, hint = measured.detail, ""
    if not passed and noise is not None and (why := _too_fine(run, measured, noise)):
        detail = f"{why}; {detail}"
        name = next(name for name in BOUNDS if name in parameters)
        path = f"expect.{number}.{expectation.kind}.{name}"
        hint = f"another bound in {run.engine} alone: --engine {run.engine} --set {path}=VALUE"
    value, bound = float(measured.value), float(measured.bound)
    return Outcome(expectation.kind, bool(passed), value, bound, measured.unit, detail, hint)


def _too_fine(run: Run, measured: Measured, noise: np.ndarray) -> str:
    """That a missed bound is finer than the engine's numbers resolve; "" where they do, or the miss is larger than theirs."""
    if measured.row is None or measured.row >= len(noise):
        return ""
    here = float(noise[measured.row].max(initial=0.0))
    if not measured.bound < here < np.inf or measured.value > ROUNDING_MAKES * here:
        return ""
    engine = engines().get(engine_name(run.engine))  # a stored run may be of an engine that is not known here
    numbers = f"{engine.PRECISION} precision" if engine is not None else run.engine
    return f"finer than {numbers} resolves here (noise {here:.2g} m)"
