"""Functions behind the methods of worlds and specs that need no folders (docs/reference/python-api.md)."""

from __future__ import annotations

import contextlib
import functools
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from simspec import selection
from simspec.compiler import Compiled, compile_world
from simspec.engines.kit.process import DEADLINE
from simspec.engines.kit.session import Session
from simspec.experiments.index import RunRow
from simspec.experiments.plan import Cell, plan_sweep
from simspec.experiments.store import Store
from simspec.experiments.sweep import SweepOutcome, local_executor, side_by_side
from simspec.experiments.sweep import sweep as run_sweep
from simspec.experiments.timing import versions_of
from simspec.files import scratch_folder
from simspec.language.load import Spec
from simspec.runner.run import Run
from simspec.world.types import World


def compile_for(world: World, engine: str, *, pythons: Mapping[str, str] | None = None) -> Compiled:
    """Compile ``world`` for one engine; nothing is written. Raises UnsupportedError."""
    return compile_world(world, [engine], pythons=pythons)[engine]


def session(world: World, engine: str) -> Session:
    """An engine in this process with ``world`` loaded, compiled to a temporary folder that exists as long as the session.

    Raises UnsupportedError, and EngineError as :class:`simspec.Session`.
    """
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(scratch_folder("session")) / "compiled"
        compile_for(world, engine).artifacts.write(folder)
        made = Session(engine, folder)
        weakref.finalize(made, stack.pop_all().close)
    return made


@dataclass(frozen=True)
class Swept:
    """The runs of a sweep. ``outcome``: counts, proofs and problems; ``store``: where the runs are."""

    outcome: SweepOutcome
    store: Store

    def rows(self) -> Iterator[tuple[Cell, RunRow | None]]:
        """Every cell of the plan in order, with the row of its run; None where there is none."""
        return self.outcome.rows()

    def runs(self) -> Iterator[tuple[Cell, Run]]:
        """Every cell that has a run, with the run, read from the store one by one."""
        return ((cell, self.store.load(row.key)) for cell, row in self.rows() if row is not None)


def sweep(
    spec: Spec,
    engines: Sequence[str] | None = None,
    *,
    store: Path | str | None = None,
    jobs: int | None = None,
    verify: bool = True,
    retry_failed: bool = False,
    pythons: Mapping[str, str] | None = None,
    deadline: float = DEADLINE,
    progress: Callable[[str, float | None], None] = lambda text, share: None,
) -> Swept:
    """Do all runs of the spec's ``sweep`` on this machine.

    engines  labels; without, those of the sweep, else every installed engine that supports the spec
    store    folder of stored runs, made where there is none; without, a temporary one that exists as long as the result
    jobs     runs side by side (default: the cores; one where speed is measured)

    Other arguments and errors are those of :func:`simspec.experiments.sweep.sweep`.
    """
    pythons = pythons or {}
    named = engines or (spec.data.sweep.engines if spec.data.sweep is not None else None)
    labels = list(named or selection.available(pythons).for_world(spec.resolve(), spec.locate).engines)
    plan = plan_sweep(spec, engines=labels, versions=versions_of(labels, pythons))
    start = functools.partial(local_executor, plan, side_by_side(jobs, plan), pythons)
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(scratch_folder("sweep")) / "store" if store is None else Path(store)
        opened = Store.open(folder, create=True)
        outcome = run_sweep(
            plan,
            opened,
            start,
            verify=verify,
            retry_failed=retry_failed,
            pythons=pythons,
            deadline=deadline,
            source={"file": spec.path.name} if spec.path is not None else {},
            progress=progress,
        )
        swept = Swept(outcome, opened)
        weakref.finalize(swept, stack.pop_all().close)
    return swept
