"""What every executor of a sweep is given, and gives back. A task is plain data, so that it can be sent elsewhere; what it
needs, a world and compiled files, is named by hashes and supplied apart."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from simspec.errors import EXIT_ENGINE, SimspecError
from simspec.experiments.result import TaskResult
from simspec.runner.case import Case


@dataclass(frozen=True, slots=True)
class Task:
    """One run to do.

    key        under which it is stored
    engine     label
    world      hash of the world, as it is compiled
    artifacts  hash of the compiled files
    perturb, seed, repeat   as of the cell
    deadline   s that the engine's process may take
    cell       who asks for it: the key of the cell, and what it changes in the spec
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
    """What tasks need. Both are there from when a task is given until it is published."""

    def case(self, task: Task) -> Case:
        """The case of a task."""

    def folder(self, task: Task) -> Path:
        """The folder of its compiled files."""


Publish = Callable[[Task, TaskResult], None]
"""Stores a result; may be called from any thread, and twice for one task: the second time does nothing."""


class ExecutorError(SimspecError):
    """Tasks cannot be done: nobody is there who does them, or not any more. What was published is stored."""

    exit_code = EXIT_ENGINE


class Executor(Protocol):
    """Does tasks. Errors of an engine are results (``Run.failed``); an error of this machine (a full disk) ends the block,
    and is no result of anything."""

    def demand(self, engines: Collection[str]) -> None:
        """Raise ExecutorError where nobody does tasks of one of these engines (labels): asked before any task is given."""

    def run(self, tasks: Iterable[Task], publish: Publish) -> None:
        """Do all tasks; they are made while others are at work, so no more are asked for than are needed soon."""

    def close(self) -> None:
        """Let go of what is held for further tasks."""
