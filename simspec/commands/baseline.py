"""``--baseline`` and ``--write-baseline`` of ``simspec run``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from simspec.comparison.study import Study
from simspec.compiler import compile_world
from simspec.errors import Problem, SpecError
from simspec.experiments.machine import disturbances, this_machine
from simspec.experiments.timing import TimedCase, timed_runs
from simspec.outputs.targets import demand, file_problem
from simspec.outputs.writing import write_file
from simspec.report.baseline import (
    Baseline,
    baseline_of,
    own_baseline,
    read_baseline,
)
from simspec.report.compared import Comparison, compare, comparison_data
from simspec.report.regressions import show_comparison
from simspec.runner.case import Case
from simspec.runner.run import Run
from simspec.scratch import scratch_folder


@dataclass(frozen=True)
class Baselines:
    """What is asked for: ``read``: the file to compare with, ``write``: the file to write; ``timed``: runs of each engine whose
    speed is measured."""

    read: Path | None = None
    write: Path | None = None
    timed: int = 0

    def __bool__(self) -> bool:
        return self.read is not None or self.write is not None

    def before(self, repeats: bool) -> Baseline | None:
        """The baseline to compare with; None where there is none yet. Raises SpecError when it is damaged, when the new one may
        not be written, or without repeats: before any work is done."""
        if not self:
            return None
        if not repeats:
            message = "a baseline requires each engine's own noise, which --no-repeats does not measure"
            raise SpecError([Problem(message, hint="leave one of the two out")])
        if self.write is not None:
            demand([file_problem(self.write, own_baseline)])
        return read_baseline(self.read) if self.read is not None else None


NO_BASELINES = Baselines()


@dataclass(frozen=True)
class Compared:
    """What came of it: the comparison (None: nothing to compare with), and what there is to say."""

    comparison: Comparison | None
    notes: tuple[str, ...]
    written: Path | None

    @property
    def failed(self) -> bool:
        """Whether something regressed, or nothing could be compared."""
        return self.comparison is not None and (bool(self.comparison.regressions) or not self.comparison.compared)

    def show(self, screen: Console) -> None:
        """Print it."""
        if self.comparison is not None:
            show_comparison(self.comparison, screen)
        for note in self.notes:
            screen.print(f"note: {note}", soft_wrap=True)
        if self.written is not None:
            screen.print(f"baseline written: {self.written}", soft_wrap=True)

    def data(self) -> dict[str, Any]:
        """For ``--json``."""
        told = {"notes": list(self.notes), "written": self.written}
        return told | {"comparison": comparison_data(self.comparison) if self.comparison is not None else None}


def with_baseline(
    asked: Baselines,
    before: Baseline | None,
    study: Study,
    *,
    tolerance: float,
    pythons: Mapping[str, str],
    deadline: float,
    progress: Callable[..., None],
) -> Compared:
    """Time the engines of a study, compare it with ``before``, and write the new baseline: not over one from which it
    regressed."""
    notes: list[str] = []
    timed: list[Run] = []
    if asked.timed and (asked.write is not None or (before is not None and before.has_speed)):
        notes = [f"speed: {why}" for why in disturbances()]
        timed = _time(asked.timed, study, pythons, deadline, progress)
    now = baseline_of(study, timed, tolerance, this_machine())
    comparison = None
    if before is not None:
        comparison = compare(before, now)
        notes += comparison.notes
        if not comparison.compared:
            notes.append("nothing could be compared with the baseline")
    elif asked.read is not None:
        notes.append(f"{asked.read}: no baseline yet: nothing was compared")
    written = asked.write
    if written is not None:
        if any(run.failed is not None for run in study.runs.values()):
            notes.append(f"{written}: not written, as an engine failed")
            written = None
        elif comparison is not None and comparison.regressions and _same_file(asked):
            notes.append(f"{written}: kept, as this run regressed from it; to accept it: --write-baseline alone")
            written = None
        else:
            write_file(written, now.text(), own_baseline)
    return Compared(comparison, tuple(notes), written)


def _same_file(asked: Baselines) -> bool:
    return asked.read is not None and asked.write is not None and asked.read.resolve() == asked.write.resolve()


def _time(
    repeats: int, study: Study, pythons: Mapping[str, str], deadline: float, progress: Callable[..., None]
) -> list[Run]:
    names = [name for name, run in study.runs.items() if run.failed is None]
    with scratch_folder("timing") as place:
        cases = []
        for name, compiled in compile_world(study.world, names, pythons=pythons).items():
            folder = place / name
            compiled.artifacts.write(folder)
            cases.append(TimedCase(Case(study.world, name), folder, pythons.get(name)))
        return list(timed_runs(cases, repeats, deadline=deadline, progress=progress)) if cases else []
