"""The driver of a sweep: stored runs are skipped, the others are compiled, proven, run and stored, each as soon as it is
complete. It may be ended at any moment: the next call does the rest."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import (
    EXIT_ENGINE,
    EXIT_FAILED,
    EXIT_OK,
    EXIT_WRONG,
    EngineError,
    Problem,
    SpecError,
    UnsupportedError,
)
from simspec.experiments.cases import case_of, rounded_data, roundings
from simspec.experiments.certify import Certifier, LocalSupplies
from simspec.experiments.executors import Executor, LocalExecutor, Supplies, Task, packed
from simspec.experiments.index import USUAL, Index, RunRow, Steps, costs, refresh, row_of
from simspec.experiments.plan import Cell, Plan
from simspec.experiments.store import Store, TaskResult
from simspec.experiments.timing import timed_tasks
from simspec.runner.execution import failed_run
from simspec.runner.run import Case
from simspec.stored import SweptRun
from simspec.world.canonical import sha256
from simspec.world.types import World

MOST_DEATHS = 5
"""Runs of an engine that gave no result, and none that did, after which it is stopped: the others go on."""
SAVE_EVERY = 500
"""Runs after which the index is written, or a tenth of those in the store: runs missing from the index of a killed sweep are
found again, which takes time."""
REFUSED = "does not support this world"
"""How the reason of a run begins whose engine was not started."""
MOST_INVALID = 20
"""Cells that are reported one by one which make the spec invalid; the others are counted."""

Progress = Callable[[str, float | None], None]
Start = Callable[[LocalSupplies], Executor]


@dataclass
class SweepOutcome:
    """Result of a call of :func:`sweep`.

    ``done``: cells that were there before; ``ran``: runs that were made now; ``skipped``: cells of an engine that was stopped;
    ``stopped``: why, by engine; ``invalid``: problems of cells whose values make the spec invalid, and ``invalid_count`` of
    them; ``unproven``: why, by engine and model, the proof failed; ``by_contact``: those of them that fail in measured
    contact (L5) and in nothing else; ``proofs``: models that were verified now.
    """

    plan: Plan
    index: Index
    done: int = 0
    ran: int = 0
    skipped: int = 0
    stopped: dict[str, str] = field(default_factory=dict)
    invalid: list[Problem] = field(default_factory=list)
    invalid_count: int = 0
    unproven: dict[str, str] = field(default_factory=dict)
    by_contact: set[str] = field(default_factory=set)
    proofs: int = 0
    verified: bool = True
    notes: list[str] = field(default_factory=list)

    def rows(self) -> Iterator[tuple[Cell, RunRow | None]]:
        """Every cell of the plan, with its run where there is one."""
        for cell in self.plan:
            yield cell, self.index.done(cell.key)

    def exit_code(self, failed: int, unfulfilled: int) -> int:
        """The exit code of the command; ``failed``: failed runs, ``unfulfilled``: unfulfilled expectations."""
        if self.invalid_count:
            return EXIT_WRONG
        if self.stopped or failed:
            return EXIT_ENGINE
        return EXIT_FAILED if self.unproven or unfulfilled else EXIT_OK


def stored_key(case: Case, cell: Cell, versions: Mapping[str, str], measure: str = "physics") -> str:
    """Under which key the run of a cell is stored: equal for cells that ask for the same in different ways. Timed runs
    (``measure``: speed) have keys of their own."""
    return run_key(case, cell.repeat, versions, measure)


def run_key(case: Case, repeat: int, versions: Mapping[str, str], measure: str = "physics") -> str:
    """The same of a repetition of a case that no cell requests."""
    timed = {"measure": measure} if measure == "speed" else {}
    return sha256({"case": case.key(versions), "repeat": repeat, **timed})


def cell_data(plan: Plan, cell: Cell) -> dict[str, Any]:
    """The request as plain data: the key of the cell, what it changes in the spec, and the times that it rounds up."""
    overrides = [[path, value] for path, value in cell.overrides]
    requested = {"key": cell.key, "case": cell.case, "overrides": overrides, "sample": cell.sample}
    rounded = rounded_data(roundings(plan, cell))
    return {**requested, **({"rounded": rounded} if rounded else {})}


def sweep(
    plan: Plan,
    store: Store,
    start: Start,
    *,
    verify: bool = True,
    retry_failed: bool = False,
    pythons: Mapping[str, str] | None = None,
    deadline: float,
    source: Mapping[str, Any] | None = None,
    progress: Progress = lambda text, share: None,
    wait: bool = False,
) -> SweepOutcome:
    """Do the runs that ``plan`` requests and ``store`` does not have.

    start         makes the executor, for the supplies that it is given
    verify        whether each model that an engine is given is proven first
    retry_failed  whether runs that failed are done again
    pythons       interpreters by label
    deadline      s that the engine's process of one run may take
    source        where the spec came from
    wait          whether to wait for another sweep that writes to the store

    Raises SpecError when another sweep writes to the store, OSError when the disk is full: all stored runs are whole then.
    """
    with store.writing(wait):
        index = refresh(store, repair=True, tell=progress)
        outcome = SweepOutcome(plan, index, verified=verify, notes=list(index.notes))
        supplies = LocalSupplies(pythons)
        driver = _Driver(outcome, store, supplies, retry_failed, pythons or {}, deadline, source, progress)
        try:
            executor = start(supplies)
            try:
                executor.run(driver.tasks(executor.demand), driver.publish)
            finally:
                executor.close()
        finally:
            supplies.close()
            driver.finish()
    return outcome


class _Driver:
    """One sweep at work. ``tasks`` is gone through by one thread; ``publish`` may be called by any."""

    def __init__(
        self,
        outcome: SweepOutcome,
        store: Store,
        supplies: LocalSupplies,
        retry_failed: bool,
        pythons: Mapping[str, str],
        deadline: float,
        source: Mapping[str, Any] | None,
        progress: Progress,
    ):
        self._outcome, self._store, self._supplies = outcome, store, supplies
        self._plan, self._index, self._verify = outcome.plan, outcome.index, outcome.verified
        self._retry, self._deadline, self._source, self._progress = retry_failed, deadline, dict(source or {}), progress
        self._lock = threading.RLock()
        self._begun: set[str] = set()
        """Keys of runs that are at work, or were made by this call."""
        self._lived: set[str] = set()
        self._deaths: dict[str, int] = {}
        self._pythons = pythons
        self._certifier = Certifier(store, pythons, deadline, lambda text: self._tell(text), self._verify)
        self._steps, self._costs = Steps(self._plan), costs(self._index.rows.values(), self._plan.spec.name)
        self._to_do = self._weight_done = 0.0
        self._count = self._unsaved = 0
        self._weights: dict[str, float] = {}

    def tasks(self, demand: Callable[[Collection[str]], None] = lambda engines: None) -> Iterator[Task]:
        """The runs that are not there yet, in the order of the plan, compiled and proven. ``demand`` receives the needed
        engines (``Executor.demand``) before anything is done."""
        needed: dict[str, None] = {}
        for cell in self._plan:
            if not self._settled(cell):
                if self._index.done(cell.key) is None or self._retry:
                    needed[cell.engine] = None
                self._to_do += self._weight(cell)
                self._count += 1
        demand(needed.keys())
        self._tell("starting")
        for cell in self._plan:
            row = self._settled(cell)
            if row is not None:
                self._pass_over(row)
            elif cell.engine in self._outcome.stopped:
                self._outcome.skipped += 1
                self._advance(self._weight(cell))
            else:
                yield from self._task(cell)

    def _settled(self, cell: Cell) -> RunRow | None:
        """The run of a cell that needs nothing more: neither a run nor a proof."""
        row = self._index.done(cell.key)
        if row is None or (self._retry and row.failed is not None and row.key not in self._begun):
            return None
        certificate = self._index.certificates.get(cell.key)
        if self._verify and certificate is not None and self._certifier.known(certificate):
            self._judge(cell, certificate)
        elif self._verify and row.failed is None:
            return None
        return row

    def _pass_over(self, row: RunRow) -> None:
        """A cell whose run is there."""
        if row.key not in self._begun:
            self._outcome.done += 1
            self._note_life(row.engine, row.failed, row.steps)

    def _task(self, cell: Cell) -> Iterator[Task]:
        try:
            case = case_of(self._plan, cell)
        except SpecError as error:
            self._outcome.invalid_count += 1
            invalid = self._outcome.invalid
            fresh = [problem for problem in error.problems if problem not in invalid]
            invalid += fresh[: max(0, MOST_INVALID - len(invalid))]
            self._advance(self._weight(cell))
            return
        versions = self._plan.versions[cell.engine]
        key = stored_key(case, cell, versions, self._plan.measure)
        with self._lock:
            self._index.know(cell.key, key)
            there = self._index.rows.get(key)
            again = self._retry and there is not None and there.failed is not None and key not in self._begun
            wanted = key not in self._begun and (there is None or again)
        if again:
            with self._lock:
                self._store.drop(key)
                self._index.rows.pop(key, None)
                self._index.changed = True
        if self._store.has(key) and wanted and not again:
            with self._lock:
                self._store.put_world(case.resolved)
                self._index.add(row_of(self._store, key, self._store.check(key), case.resolved.physics.timestep))
                self._outcome.done += 1  # only its world was lost
            wanted = False
        try:
            prepared = self._supplies.prepare(case)
        except UnsupportedError as error:
            if wanted:
                self._refused(cell, key, case, error)
            self._advance(0.0 if wanted else self._weight(cell))
            return
        if self._verify:
            certificate = self._certifier.demand(case.resolved, prepared, versions)
            with self._lock:
                self._index.certify(cell.key, certificate)
            self._judge(cell, certificate)
        if not wanted:
            if there is not None and key not in self._begun:
                self._pass_over(there)
            self._advance(self._weight(cell))
            return
        task = self._begin(cell, key, case.resolved, prepared.compiled.sha256)
        self._tell_runs()  # else the last proof would seem to go on while runs do
        yield self._supplies.hold(task)

    def _begin(self, cell: Cell, key: str, world: World, artifacts: str) -> Task:
        with self._lock:
            self._begun.add(key)
            self._weights[key] = self._weight(cell)
        moved = (cell.perturb, cell.seed, cell.repeat)
        data = cell_data(self._plan, cell)
        return Task(key, cell.engine, sha256(world), artifacts, *moved, self._deadline, data, self._source)

    def _judge(self, cell: Cell, certificate: str) -> None:
        why = self._certifier.verdicts.get(certificate)
        if why is not None:
            self._outcome.unproven.setdefault(certificate, f"{cell.engine}: {why}")
            if certificate in self._certifier.by_contact:
                self._outcome.by_contact.add(certificate)

    def _refused(self, cell: Cell, key: str, case: Case, error: UnsupportedError) -> None:
        """An engine that does not support a world: that is its result."""
        first, more = error.problems[0], len(error.problems) - 1
        text = f"{REFUSED}: {first.message}" + (f"; and {more} more problems" if more else "")
        run = failed_run(case.resolved, cell.engine, EngineError(cell.engine, text), self._pythons.get(cell.engine))
        task = self._begin(cell, key, case.resolved, "")
        self._store_result(task, packed(task, run), case.resolved)

    def publish(self, task: Task, result: TaskResult) -> None:
        """Store a result."""
        world = self._supplies.case(task).resolved
        given = {**result.result["provenance"], **result.circumstances}
        for name, wanted in self._plan.versions[task.engine].items():
            if given.get(name, wanted) != wanted and result.result["failed"] is None:
                raise EngineError(task.engine, f"{name} is {given[name]}, and was {wanted} when the sweep began")
        self._store_result(task, result, world)
        self._supplies.release(task)

    def _store_result(self, task: Task, result: TaskResult, world: World) -> None:
        self._store.publish(result, world)
        facts: SweptRun = self._store.facts(task.key)
        with self._lock:
            row = row_of(self._store, task.key, facts, world.physics.timestep)
            self._index.add(row)
            self._outcome.ran += 1
            self._note_life(row.engine, row.failed, row.steps)
            self._advance(self._weights.pop(task.key, 0.0))
            self._unsaved += 1
            if self._unsaved >= max(SAVE_EVERY, len(self._index.rows) // 10):
                self._unsaved = 0
                self._index.save(self._store)

    def _note_life(self, engine: str, failed: str | None, steps: int) -> None:
        """Count what an engine came to: one that never gives a result is stopped. A state that stops being finite is one."""
        with self._lock:
            if failed is not None and failed.startswith(REFUSED):
                return
            if failed is None or steps:
                self._lived.add(engine)
            elif engine not in self._lived:
                self._deaths[engine] = self._deaths.get(engine, 0) + 1
                if self._deaths[engine] >= MOST_DEATHS:
                    why = f"none of its first {self._deaths[engine]} runs gave a result: {failed}"
                    self._outcome.stopped.setdefault(engine, why)

    def finish(self) -> None:
        """Write what follows from the store."""
        with self._lock:
            self._outcome.proofs = self._certifier.made
            self._outcome.notes += self._certifier.notes
            self._index.save(self._store)

    def _weight(self, cell: Cell) -> float:
        return self._costs.get(cell.engine, USUAL).seconds(self._steps.of(cell))

    def _advance(self, weight: float) -> None:
        with self._lock:
            self._weight_done += weight
            self._tell_runs()

    def _tell_runs(self) -> None:
        self._tell(f"{self._outcome.ran:,} of {self._count:,} runs")

    def _tell(self, text: str) -> None:
        self._progress(text, min(1.0, self._weight_done / self._to_do) if self._to_do else None)


def side_by_side(jobs: int | None, plan: Plan) -> int:
    """How many runs at a time: as many as there are cores, one where speed is measured. Raises SpecError for another number
    there."""
    if plan.measure == "speed":
        if jobs not in (None, 1):
            message, path = "speed is measured with one run at a time", "sweep.measure"
            raise SpecError([Problem(message, path, plan.spec.locate(path), f"--jobs {jobs}", "--jobs 1", code="C109")])
        return 1
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return jobs or cores


def local_executor(plan: Plan, jobs: int, pythons: Mapping[str, str], supplies: Supplies) -> LocalExecutor:
    """Runs on this machine. Where speed is measured, each is alone on a processor, in a new process."""
    if plan.measure == "speed":
        return LocalExecutor(supplies, 1, pythons, do_run=timed_tasks(pythons))
    return LocalExecutor(supplies, jobs, pythons, warm=WarmProcesses())
