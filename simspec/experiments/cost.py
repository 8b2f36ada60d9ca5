"""Predicted costs of runs, from the costs of stored runs: for each engine a time to start and end, and a time for each step."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import median
from typing import Any

from simspec.errors import SpecError
from simspec.experiments.index import Index, RunRow
from simspec.experiments.plan import Cell, Plan
from simspec.experiments.store import Store
from simspec.language.engine_options import WHOLE
from simspec.language.sweep import ROUND_UP
from simspec.language.units import UnitError, parse
from simspec.stored import StoredCertificate, read_as

USUAL_START = 0.5
"""s that a run is taken to need besides its steps where nothing was measured: a process that imports an engine."""
USUAL_STEP = 2e-5
"""s for each step there: a small world. Both weigh the progress shown, and are not printed."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Seconds of wall time that an engine's runs took: ``start`` besides the steps, and ``step`` for each; ``runs``:
    measured."""

    start: float
    step: float
    runs: int

    def seconds(self, steps: int) -> float:
        """Predicted time (s) of a run of ``steps`` steps."""
        return self.start + self.step * steps


def costs(rows: Iterable[RunRow], name: str) -> dict[str, Cost]:
    """By engine, what runs of the spec ``name`` took (medians); of other specs where there are none of it."""
    whole = [row for row in rows if row.failed is None and row.steps and row.step_seconds and row.process_seconds]
    found = {}
    for engine in dict.fromkeys(row.engine for row in whole):
        of_engine = [row for row in whole if row.engine == engine]
        used = [row for row in of_engine if row.name == name] or of_engine
        start = median((row.process_seconds or 0.0) - (row.step_seconds or 0.0) for row in used)
        step = median((row.step_seconds or 0.0) / row.steps for row in used)
        found[engine] = Cost(start, step, len(used))
    return found


USUAL = Cost(USUAL_START, USUAL_STEP, 0)


class Steps:
    """Numbers of steps of the cells of a plan, from their values without resolving them."""

    def __init__(self, plan: Plan):
        physics, trajectory = plan.spec.data.physics, plan.spec.data.trajectory
        self._usual = {"physics.timestep": physics.timestep, "physics.duration": physics.duration}
        until = None if trajectory is None else trajectory.until
        self._usual["trajectory.until"] = math.inf if until is None else until
        self._up = plan.sweep.times == ROUND_UP
        self._known: dict[Any, float] = {}

    def of(self, cell: Cell) -> int:
        """The steps of one cell."""
        times = {**self._usual, **{path: self._time(value) for path, value in cell.overrides if path in self._usual}}
        if times["physics.timestep"] <= 0.0:
            return 0
        steps = min(times["physics.duration"], times["trajectory.until"]) / times["physics.timestep"]
        return math.ceil(steps * (1.0 - WHOLE)) if self._up else round(steps)

    def _time(self, value: Any) -> float:
        """A time (s); 0 for what is none: the cell is an error where it is resolved."""
        if value not in self._known:
            try:
                self._known[value] = parse(value, "time") if isinstance(value, str) else float(value)
            except (UnitError, ValueError, TypeError):
                self._known[value] = 0.0
        return self._known[value]


@dataclass(frozen=True, slots=True)
class Estimate:
    """Remaining work: runs, steps, and seconds of wall time one after the other, by engine. Seconds are None for an engine
    without measurements."""

    runs: Mapping[str, int]
    steps: Mapping[str, int]
    seconds: Mapping[str, float | None]

    @property
    def total(self) -> float | None:
        """Seconds of all engines; None where one is not known."""
        known = [second for name, second in self.seconds.items() if self.runs[name]]
        return None if None in known else sum(entry for entry in known if entry is not None)


def estimate(plan: Plan, to_do: Iterable[Cell], measured: Mapping[str, Cost]) -> Estimate:
    """Predicted cost of the cells ``to_do``."""
    steps_of = Steps(plan)
    runs, steps = dict.fromkeys(plan.engines, 0), dict.fromkeys(plan.engines, 0)
    for cell in to_do:
        runs[cell.engine] += 1
        steps[cell.engine] += steps_of.of(cell)
    seconds = {
        name: measured[name].start * runs[name] + measured[name].step * steps[name] if name in measured else None
        for name in plan.engines
    }
    return Estimate(runs, steps, seconds)


# Predicted costs of the proofs of a sweep, from the costs of stored proofs.

MOST_READ = 200
"""Certificates of a store that are read for it, the last ones by name."""


@dataclass(frozen=True, slots=True)
class ProofsLeft:
    """Proofs that are still to be made: ``models`` by engine, at most (sets of values that differ in what no proof looks at
    share one); ``seconds`` of wall time of one by engine, None where none was made."""

    models: Mapping[str, int]
    seconds: Mapping[str, float | None]

    @property
    def count(self) -> int:
        """Models of all engines."""
        return sum(self.models.values())

    @property
    def total(self) -> float | None:
        """Seconds of all, one after the other; None where those of an engine are not known."""
        total = 0.0
        for engine, count in self.models.items():
            each = self.seconds[engine]
            if count and each is None:
                return None
            total += count * (each or 0.0)
        return total


def proof_seconds(index: Index, store: Store | None) -> dict[str, float]:
    """By engine, the median wall time of the proofs in a store; those that cannot be read are made anew by the sweep."""
    seconds: dict[str, list[float]] = {}
    for key in sorted(set(index.certificates.values()))[-MOST_READ:] if store is not None else ():
        text = store.certificate_text(key) if store is not None else None
        try:
            certificate = None if text is None else read_as(StoredCertificate, text, key)
        except SpecError:
            continue
        for engine, proof in certificate.engines.items() if certificate is not None else ():
            seconds.setdefault(engine, []).append(proof.seconds)
    return {engine: median(took) for engine, took in seconds.items()}


def proofs_left(cells: Iterable[Cell], index: Index, seconds: Mapping[str, float]) -> ProofsLeft:
    """The proofs that cells still need; ``seconds``: of one, by engine, where that is known."""
    proven: set[tuple[str, str]] = set()
    needed: set[tuple[str, str]] = set()
    engines: dict[str, None] = {}
    for cell in cells:
        engines[cell.engine] = None
        (proven if cell.key in index.certificates else needed).add((cell.engine, repr(cell.overrides)))
    left = needed - proven
    models = {engine: sum(model[0] == engine for model in left) for engine in engines}
    return ProofsLeft(models, {engine: seconds.get(engine) for engine in engines})
