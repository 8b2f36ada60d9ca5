"""The contract of every executor of the runs of a sweep; and the one for this machine: several runs side by side, or one at a
time where timing counts."""

from __future__ import annotations

import errno
import os
import tempfile
import threading
from collections.abc import Callable, Collection, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures import Executor as FuturesExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from simspec.engines.kit.process import side_by_side
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EXIT_ENGINE, EngineError, SimspecError
from simspec.experiments.store import TaskResult, result_of
from simspec.runner.execution import failed_run, run_case
from simspec.runner.run import Case, Run

# Inputs and outputs. A task is plain data, so that it can be sent elsewhere; its inputs, a world and compiled files, are
# named by hashes and supplied separately.


@dataclass(frozen=True, slots=True)
class Task:
    """One run to do.

    key        under which it is stored
    engine     label
    world      hash of the world, as it is compiled
    artifacts  hash of the compiled files
    perturb, seed, repeat   as of the cell
    deadline   s that the engine's process may take
    cell       the requesting cell: its key, and what it changes in the spec
    source     where the spec came from
    """

    key: str
    engine: str
    world: str
    artifacts: str
    perturb: float
    seed: int | None
    repeat: int
    deadline: float
    cell: Mapping[str, Any]
    source: Mapping[str, Any]


class Supplies(Protocol):
    """Inputs of tasks. Both exist from when a task is submitted until it is published."""

    def case(self, task: Task) -> Case:
        """The case of a task."""

    def folder(self, task: Task) -> Path:
        """The folder of its compiled files."""


Publish = Callable[[Task, TaskResult], None]
"""Stores a result; may be called from any thread, and twice for one task: the second time does nothing."""


class ExecutorError(SimspecError):
    """Tasks cannot be done: no worker is there, or not any more. Published results are stored."""

    exit_code = EXIT_ENGINE
    code = "E204"


class Executor(Protocol):
    """Does tasks. Errors of an engine are results (``Run.failed``); an error of this machine (a full disk) ends the block,
    and is no result of anything."""

    def demand(self, engines: Collection[str]) -> None:
        """Raise ExecutorError where no worker does tasks of one of these engines (labels): called before any task is given."""

    def run(self, tasks: Iterable[Task], publish: Publish) -> None:
        """Do all tasks; they are made while others are at work, so no more are taken than are needed soon."""

    def close(self) -> None:
        """Let go of what is held for further tasks."""


DoRun = Callable[[Case, Path, Task], Run]
"""How one run is done. Raises EngineError where the engine gave no result."""


Stored = Future[Any]
"""Storing a result, under way; the future's own result is None."""
STORED_BEHIND = 1
"""Results that wait to be stored while further runs are at work: each may hold a long recording."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a full disk, by their words: an engine's process writes what it records into the temporary folder."""


class _EndingError(Exception):
    """The sweep is being ended: the output of a killed engine is no result."""


class LocalExecutor:
    """``jobs`` runs at a time, each by a thread that waits for an engine's process; ``do_run``: how, by default in a process
    of its own (``pythons``: interpreters by label), forked from one that has imported the engine where there is
    ``warm``."""

    def __init__(
        self,
        supplies: Supplies,
        jobs: int,
        pythons: Mapping[str, str] | None = None,
        *,
        warm: WarmProcesses | None = None,
        do_run: DoRun | None = None,
    ):
        if jobs < 1:
            raise ValueError(f"{jobs} jobs")
        self._supplies, self._jobs, self._pythons = supplies, jobs, pythons or {}
        self._warm = warm
        self._do_run = do_run or self._in_a_process
        self._alone = jobs == 1 and do_run is not None  # it may be timed
        self._ending = threading.Event()

    def demand(self, engines: Collection[str]) -> None:
        """Every engine of a plan is installed here: its versions are part of the plan."""

    def run(self, tasks: Iterable[Task], publish: Publish) -> None:
        """As of :class:`simspec.experiments.executors.Executor`."""
        # alone: the next task is made, and perhaps compiled and proven, when nothing runs; else meanwhile
        most = 0 if self._alone else self._jobs + STORED_BEHIND
        with side_by_side(1) as storing, side_by_side(self._jobs) as pool:
            try:
                pending: set[Future[Stored | None]] = set()
                for task in tasks:
                    pending.add(pool.submit(self._run_task, task, storing, publish))
                    while len(pending) > most:
                        pending = _collect(pending)
                while pending:
                    pending = _collect(pending)
            except BaseException:
                self._ending.set()  # before engines are killed: their end is no result
                raise

    def close(self) -> None:
        """End the processes that runs were forked from."""
        if self._warm is not None:
            self._warm.close()

    def _run_task(self, task: Task, storing: FuturesExecutor, publish: Publish) -> Stored:
        """Do a run, and let its result be stored while the next one is at work."""
        try:
            run = self._do_run(self._supplies.case(task), self._supplies.folder(task), task)
        except EngineError as error:
            if self._ending.is_set():
                raise _EndingError from error
            for code in NO_ROOM:
                if os.strerror(code) in str(error):
                    raise OSError(code, os.strerror(code), tempfile.gettempdir()) from error
            run = failed_run(self._supplies.case(task).resolved, task.engine, error, self._pythons.get(task.engine))
        return storing.submit(_store, publish, task, packed(task, run))

    def _in_a_process(self, case: Case, folder: Path, task: Task) -> Run:
        return run_case(
            case,
            artifacts=folder,
            python=self._pythons.get(task.engine),
            deadline=task.deadline,
            source=task.source,
            warm=self._warm,
        )


def packed(task: Task, run: Run, more: Mapping[str, Any] | None = None) -> TaskResult:
    """The stored result of a task's run; ``more``: further circumstances of it."""
    return result_of(run, task.key, repeat=task.repeat, cell=task.cell, more=more)


def _store(publish: Publish, task: Task, result: TaskResult) -> None:
    publish(task, result)


def _collect(pending: set[Future[Stored | None]]) -> set[Future[Stored | None]]:
    """Wait for a future; return those that are pending, the storing of results included. Raises the error of a future."""
    done, left = wait(pending, return_when=FIRST_COMPLETED)
    for future in done:
        stored = future.result()
        if stored is not None:
            left.add(stored)
    return left
