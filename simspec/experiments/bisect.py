"""Which released version of an engine changed a figure of a run: a search between two versions whose figures differ.

Each version is measured once, by a run and its repeats, which are stored as a sweep stores them: a later search, and a sweep
in the same store, find them there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from simspec.analysis.speed import find_figure, half_width, read_figure
from simspec.comparison.floor import perturbation_of
from simspec.compiler import compile_world
from simspec.engines.kit.process import DEADLINE
from simspec.engines.kit.registry import MARK
from simspec.errors import EngineError, Problem, SpecError, UnsupportedError
from simspec.experiments.store import Store, result_of
from simspec.experiments.sweep import run_key
from simspec.experiments.timing import versions_of
from simspec.files import scratch_folder
from simspec.runner.execution import run_jobs
from simspec.runner.run import Case, Run
from simspec.world.types import World

REPEATS: Final = 1
"""Unchanged repetitions of a version's run; one more begins in a state that is moved in the last bits."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A figure in one version.

    value  in ``unit``
    noise  the largest distance of the figure of a repeat from ``value``
    half   half of the interval of values that are not distinguished from ``value`` (:func:`half_width`)
    stored whether all of its runs were there before
    """

    version: str
    value: float
    unit: str
    noise: float
    half: float
    stored: bool = False

    def differs(self, other: Reading) -> bool:
        """Whether the two differ by more than either interval of values that are not distinguished."""
        return abs(self.value - other.value) > self.half + other.half


@dataclass(frozen=True)
class Bisection:
    """Result of a search.

    versions      those that were searched, in order
    readings      of those that were measured, by version
    not_measured  why others gave no figure, by version
    before, after the two readings between which the figure changed, with no measured version between them; None where the
                  ends do not differ
    notes         what must be known to read it
    """

    figure: str
    versions: tuple[str, ...]
    readings: Mapping[str, Reading]
    not_measured: Mapping[str, str] = field(default_factory=dict)
    before: Reading | None = None
    after: Reading | None = None
    notes: tuple[str, ...] = ()

    @property
    def found(self) -> bool:
        """Whether the figure changed between the ends."""
        return self.after is not None

    @property
    def between(self) -> tuple[str, ...]:
        """The versions between ``before`` and ``after``, none of which could be measured: the change may be in any."""
        if self.before is None or self.after is None:
            return ()
        first, last = (self.versions.index(reading.version) for reading in (self.before, self.after))
        return self.versions[first + 1 : last]


Measure = Callable[[str], Reading]
"""Measures a version. Raises EngineError where it cannot be installed or fails, UnsupportedError where it does not support the
world."""


def search(figure: str, versions: Sequence[str], measure: Measure) -> Bisection:
    """Find neighbours among ``versions`` (in order, two at least) whose figures differ, by halving.

    A version that cannot be measured, or whose noise hides the change, is left out, and its neighbours are tried. Where the
    figure changed more than once, one of the changes is found. Raises what ``measure`` raises for one of the ends.
    """
    readings = {version: measure(version) for version in (versions[0], versions[-1])}
    low, high = 0, len(versions) - 1
    if not readings[versions[0]].differs(readings[versions[-1]]):
        return Bisection(figure, tuple(versions), readings)
    failed: dict[str, str] = {}
    notes: list[str] = []
    while left := [number for number in range(low + 1, high) if versions[number] not in failed]:
        middle = min(left, key=lambda number: (abs(2 * number - low - high), number))
        version = versions[middle]
        try:
            readings[version] = reading = measure(version)
        except (EngineError, UnsupportedError) as error:
            failed[version] = _reason(error)
            continue
        changed, unchanged = (reading.differs(readings[versions[end]]) for end in (low, high))
        if changed and unchanged:
            notes.append(f"the figure changed more than once: in {version} it is neither that before nor that after")
        if not changed and not unchanged:
            failed[version] = f"its noise, {reading.noise:.2g} {reading.unit}".rstrip() + ", hides the change"
        elif changed:
            high = middle
        else:
            low = middle
    before, after = (readings[versions[end]] for end in (low, high))
    return Bisection(figure, tuple(versions), readings, failed, before, after, tuple(notes))


def _reason(error: EngineError | UnsupportedError) -> str:
    if isinstance(error, UnsupportedError):
        return error.problems[0].message
    return str(error).splitlines()[0].partition(": ")[2] or str(error)


def bisect(
    world: World,
    engine: str,
    versions: Sequence[str],
    figure: str,
    *,
    store: Path,
    pythons: Mapping[str, str] | None = None,
    deadline: float = DEADLINE,
    progress: Callable[[str], None] = lambda text: None,
) -> Bisection:
    """Find which of ``versions`` of ``engine`` changed ``figure`` beyond noise.

    versions in order, two at least; the change is searched between the first and the last
    figure   a number of a run (:func:`simspec.analysis.speed.find_figure`)
    store    folder of stored runs, made where there is none; it may be that of a sweep
    pythons  interpreters by label (``NAME@VERSION``); a version without one must be the one that is installed here
    deadline s that the process of one run may take
    progress called with a line when something begins

    Raises SpecError for an unknown figure, fewer than two versions, or a folder that is no store; EngineError where the first
    or the last version is not there or fails; UnsupportedError where one of these does not support the world.
    """
    if len(set(versions)) < 2 or len(set(versions)) != len(versions):
        raise SpecError(
            [Problem("bisect needs two versions or more, each once", found=", ".join(versions) or "none", code="C102")]
        )
    opened = Store.open(store, create=True)
    with opened.writing():
        known = pythons or {}
        measure = Versions(world, engine, find_figure(world, figure), opened, known.get, deadline, progress)
        return search(measure.figure, versions, measure)


Provide = Callable[[str], str | None]
"""The interpreter that has the engine of a label, None: this one. Raises EngineError where there is none."""


@dataclass(frozen=True)
class Versions:
    """Measures ``figure`` (:func:`find_figure`) of ``world`` in versions of ``engine``; runs are kept in ``store``.

    ``provide``: gives the interpreters; ``deadline``: s that the process of one run may take; ``tell``: called with what
    begins.
    """

    world: World
    engine: str
    figure: str
    store: Store
    provide: Provide
    deadline: float = DEADLINE
    tell: Callable[[str], None] = lambda text: None

    def __call__(self, version: str) -> Reading:
        """The figure in a version. Raises as :data:`Measure` does, and SpecError where no run has the figure."""
        label = f"{self.engine}{MARK}{version}"
        self.tell(f"looking for {label}")
        python = self.provide(label)
        pythons = {} if python is None else {label: python}
        runs, stored = self._runs(label, pythons)
        figures = [read_figure(run, self.figure) for run in runs]
        value, size = figures[0].value, max(figure.size for figure in figures)
        noise = max(abs(figure.value - value) for figure in figures[1:])
        half = half_width(runs[0], size, noise)
        if not all(map(math.isfinite, (value, half))):
            raise EngineError(label, f"{self.figure} is not finite")
        return Reading(version, value, figures[0].unit, noise, half, stored)

    def _runs(self, label: str, pythons: Mapping[str, str]) -> tuple[list[Run], bool]:
        """The run of a version and its repeats, and whether all were stored before; the others are stored now."""
        versions = versions_of([label], pythons)[label]
        plain = Case(self.world, label)
        moved = Case(self.world, label, perturb=perturbation_of(label))
        requested = [*((plain, repeat) for repeat in range(1 + REPEATS)), (moved, 0)]
        keys = [run_key(case, repeat, versions) for case, repeat in requested]
        runs = {key: run for key in keys if (run := self._stored(key)) is not None}
        missing = [number for number, key in enumerate(keys) if key not in runs]
        if missing:
            self.tell(f"running {label} {len(missing)} times: the run, and repeats for its noise")
            with scratch_folder("bisect") as place:
                folder = place / "compiled"
                compile_world(self.world, [label], pythons=pythons)[label].artifacts.write(folder)
                jobs = [(requested[number][0], folder) for number in missing]
                made = run_jobs(jobs, pythons=pythons, deadline=self.deadline)
            for number, run in zip(missing, made, strict=True):
                if run.failed is not None:
                    raise EngineError(label, run.failed)
                self.store.publish(result_of(run, keys[number], repeat=requested[number][1]), run.world)
                runs[keys[number]] = run
        return [runs[key] for key in keys], not missing

    def _stored(self, key: str) -> Run | None:
        """A stored run that did not fail; one that is damaged is moved aside, and made again."""
        if not self.store.has(key):
            return None
        try:
            run = self.store.load(key)
        except SpecError:
            self.store.set_aside(key)
            return None
        if run.failed is None:
            return run
        self.store.drop(key)  # a failure is tried again: it may have been the machine's
        return None
