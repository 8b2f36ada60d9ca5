"""Runs that are timed: each alone, in a process of its own, on one processor; the engines take turns.

What changes slowly, a processor's temperature or another user's work, then meets all engines alike, and a figure's spread is
over processes, which includes what differs from start to start (addresses, the layout of memory).
"""

from __future__ import annotations

import contextlib
import functools
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from simspec.engines.kit.process import DEADLINE
from simspec.errors import EngineError
from simspec.experiments.executors.contract import Task
from simspec.experiments.executors.local import DoRun
from simspec.experiments.machine import Clocks, Machine, Others, processors, this_machine
from simspec.runner.case import Case
from simspec.runner.execution import failed_run, start_case
from simspec.runner.run import Run

TIMED = "timed"
"""Where a run's provenance says how it was timed."""
_alone = threading.Lock()
"""Held while a run is timed: never two at a time in one process."""


@dataclass(frozen=True, slots=True)
class TimedCase:
    """A case, the folder of its compiled files, and the interpreter that has its engine (None: this one)."""

    case: Case
    folder: Path
    python: str | None = None


def core_for_timing() -> int | None:
    """The processor for engines that are timed: the last one that may be used, as interrupts mostly go to the first. None where
    the system cannot bind a process to one."""
    allowed = processors()
    return allowed[-1] if allowed else None


@contextlib.contextmanager
def bound_to(core: int | None) -> Iterator[None]:
    """Processes that this thread starts in the block run on one processor, and what they start as well; the thread itself is
    let go at the end. Nothing is done for None."""
    if core is None:
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def timed_run(
    case: Case,
    folder: Path,
    *,
    core: int | None,
    python: str | None = None,
    deadline: float = DEADLINE,
    source: Mapping[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Run a case alone, on ``core``, in a new process; arguments and errors as of :func:`simspec.runner.execution.run_case`.

    The run's provenance says under "timed" which processor it had (``core``: None, not bound to one), how many cores' worth of
    other work went on meanwhile (``others``, and ``stolen``: by the host of a virtual machine), and what ``machine`` it was.
    """
    with _alone, contextlib.ExitStack() as stack:
        before = Clocks.read()
        with bound_to(core):
            pending = stack.enter_context(start_case(case, folder, python=python, deadline=deadline, source=source))
        run = pending.wait(progress)
    others = Clocks.read().others_since(before)
    facts = {"core": core, "others": round(others.cores, 3), "stolen": round(others.stolen, 3)}
    return replace(run, provenance={**run.provenance, TIMED: {**facts, "machine": _machine().plain()}})


@functools.cache
def _machine() -> Machine:
    return this_machine()


def timed_tasks(pythons: Mapping[str, str]) -> DoRun:
    """How the runs of a sweep are done where speed is measured, for an executor of one job; ``pythons``: interpreters by
    label. The plan's order, engines innermost, has the engines take turns."""
    core = core_for_timing()

    def do_run(case: Case, folder: Path, task: Task) -> Run:
        python = pythons.get(task.engine)
        return timed_run(case, folder, core=core, python=python, deadline=task.deadline, source=task.source)

    return do_run


def timed_runs(
    cases: Sequence[TimedCase],
    repeats: int,
    *,
    deadline: float = DEADLINE,
    source: Mapping[str, Any] | None = None,
    progress: Callable[[str, float], None] = lambda text, share: None,
) -> Iterator[Run]:
    """Time every case ``repeats`` times, in turn: A B C A B C. An engine that fails gives a failed run."""
    core = core_for_timing()
    count = repeats * len(cases)
    for index in range(count):
        timed = cases[index % len(cases)]
        progress(f"timing {timed.case.engine}", index / count)
        try:
            yield timed_run(timed.case, timed.folder, core=core, python=timed.python, deadline=deadline, source=source)
        except EngineError as error:
            yield failed_run(timed.case.resolved, timed.case.engine, error, timed.python)


def disturbed(run: Run) -> list[str]:
    """In words, what went on beside a timed run; empty where nothing did, or the run was not timed."""
    facts = run.provenance.get(TIMED)
    return Others(facts["others"], facts["stolen"]).words() if facts else []
