"""What the tasks of a sweep need: worlds, and compiled files, made once for each world and engine, and let go when no task
needs them any more."""

from __future__ import annotations

import contextlib
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from simspec.compiler import Compiled, compile_world
from simspec.experiments.executors.contract import Task
from simspec.files import scratch_folder
from simspec.runner.case import Case
from simspec.world.canonical import sha256
from simspec.world.types import World

MOST_KEPT = 16
"""Compiled worlds that are kept while no task needs them: engines, repetitions and perturbations of one world follow each
other."""


@dataclass
class Prepared:
    """A world compiled for one engine, in a folder; ``users``: tasks that still need it."""

    world: World
    compiled: Compiled
    folder: Path
    closing: contextlib.ExitStack = field(repr=False)
    users: int = 0


class LocalSupplies:
    """Worlds in memory, compiled files in temporary folders. ``close`` removes all of them. ``pythons``: interpreters by
    label."""

    def __init__(self, pythons: Mapping[str, str] | None = None) -> None:
        self._pythons = pythons or {}
        self._kept: OrderedDict[tuple[str, str], Prepared] = OrderedDict()
        self._lock = threading.Lock()

    def prepare(self, case: Case) -> Prepared:
        """The compiled world of a case. Raises UnsupportedError where its engine does not support it."""
        name = (sha256(case.resolved), case.engine)
        with self._lock:
            prepared = self._kept.get(name)
            if prepared is not None:
                self._kept.move_to_end(name)
                return prepared
        compiled = compile_world(case.resolved, [case.engine], pythons=self._pythons)[case.engine]
        with contextlib.ExitStack() as stack:
            folder = stack.enter_context(scratch_folder("sweep")) / "compiled"
            compiled.artifacts.write(folder)
            prepared = Prepared(case.resolved, compiled, folder, stack.pop_all())
        with self._lock:
            self._kept[name] = prepared
            idle = [old for old, one in self._kept.items() if not one.users and old != name]
            dropped = [self._kept.pop(old) for old in idle[: max(0, len(self._kept) - MOST_KEPT)]]
        for one in dropped:
            one.closing.close()
        return prepared

    def hold(self, task: Task) -> Task:
        """Keep what a task needs, until :meth:`release`."""
        with self._lock:
            self._kept[task.world, task.engine].users += 1
        return task

    def release(self, task: Task) -> None:
        """The task is done."""
        with self._lock:
            self._kept[task.world, task.engine].users -= 1

    def case(self, task: Task) -> Case:
        """As of :class:`simspec.experiments.executors.contract.Supplies`."""
        with self._lock:
            return Case(self._kept[task.world, task.engine].world, task.engine, perturb=task.perturb, seed=task.seed)

    def folder(self, task: Task) -> Path:
        """As of :class:`simspec.experiments.executors.contract.Supplies`."""
        with self._lock:
            return self._kept[task.world, task.engine].folder

    def close(self) -> None:
        """Remove all folders."""
        with self._lock:
            kept = list(self._kept.values())
            self._kept.clear()
        for one in kept:
            one.closing.close()
