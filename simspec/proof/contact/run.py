"""Proof level L5: every contact probe, on every pair of materials of a scenario that can meet, in one engine.

All probe worlds of an engine run one after the other in one process; what was measured before is taken from the cache.
"""

from __future__ import annotations

import dataclasses
import math
import secrets
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simspec.compiler import Compiled, compile_world, version_at_work, write_folder
from simspec.contact.plan import ContactPlan
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.deviations import Deviation
from simspec.engines.kit.process import Answer, Operation, Running, call, start
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, UnsupportedError
from simspec.files import scratch_folder
from simspec.proof.checks import Check, failed
from simspec.proof.contact import cache, carried, friction, leaning, normal, oblique, simultaneous, size, spin, stacks
from simspec.proof.contact.file_law import FileLaw, belts, held, of_pair
from simspec.proof.contact.probe import GRAVITY, NO_BELT, Figure, Law, Probe, Trial
from simspec.proof.contact.worlds import drive_of, joined, motion_of, split, world_of_trial
from simspec.world.canonical import to_plain
from simspec.world.contact_pairs import meeting_laws
from simspec.world.kinematics import layout_of
from simspec.world.reach import Reach, reach
from simspec.world.types import Physics, ReadBack, World

LEVEL = "L5"
_COUPLED = (
    *(leaning.Rod(), leaning.Clamp(), leaning.Pile(), leaning.Jam(), leaning.LightJam(), carried.Squeeze()),
    *(simultaneous.Strike(), simultaneous.Row(), simultaneous.Edge(), stacks.Stack(), stacks.SlidingStack()),
    *(stacks.Cross(), carried.Carrier(), spin.Slide()),
)
_SINGLE = (
    *(
        friction.Push(),
        friction.PushOblong(),
        friction.Stop(),
        friction.StopOblong(),
        friction.Stick(),
        friction.Carry(),
    ),
    *(normal.Restitution(), normal.Rest(), normal.Overlap(), oblique.Oblique()),
    *(normal.Compliance(), normal.ComplianceByShape(), spin.Torsional(), spin.Rolling()),
)
COUPLED: Mapping[str, Probe] = {probe.NAME: probe for probe in _COUPLED}
"""Probes in which contacts depend on each other, by name."""
PROBES: Mapping[str, Probe] = {probe.NAME: probe for probe in (*_SINGLE, *_COUPLED)}
"""Every probe of two materials, by name, in the order of reports."""
PLOTTED = ("push-oblong",)
"""Probes whose points reports draw; the others' are not kept."""
DIGITS = 6
"""Of kept points: a hundredth of what a plot can show."""


@dataclass(frozen=True)
class _Job:
    """The trials of one probe on one pair (or of the sizes), compiled; ``first``: the index of its first operation."""

    key: str
    law: Law | None
    probe: Probe | None
    compiled: tuple[Compiled, ...]
    operations: tuple[Operation, ...]
    worlds: tuple[tuple[World, ...], ...] = ()
    """Of each trial the worlds that it is driven in, in the order of the operations."""
    sizes: size.SizeTrial | None = None
    known: tuple[Figure, ...] | None = None
    sampled: tuple[Figure, ...] | None = None
    """Figures in the cache of a job that is measured all the same, to verify the cache."""

    def settings(self, engine: type[Engine]) -> Mapping[str, Any]:
        """What the scenario sets in the engine for the pair."""
        if not self.worlds or self.law is None:
            return {}
        options = self.worlds[0][0].options(engine.NAME)
        measured = (self.law.pair.first, self.law.pair.second)
        of_pairs = {(pair.first, pair.second): dict(pair.settings) for pair in options.pairs}
        return dict(options.settings) | of_pairs.get(measured, {})


@dataclass(frozen=True)
class Measuring:
    """Probes under way in an engine."""

    engine: type[Engine]
    jobs: tuple[_Job, ...]
    operations: tuple[Operation, ...]
    """Of all jobs that are not known, in order, with their artifacts in place."""
    running: Running | None
    place: Path
    python: str | None
    version: str | None
    """The engine's release, which some deviations are of."""
    ends: float
    """When the deadline is over (``time.monotonic``)."""
    use_cache: bool
    refused: str = ""
    """Why the cache is not used."""

    def wait(self, doing: Callable[[str], None] | None = None) -> tuple[list[Figure], list[str]]:
        """The figures, and the cache's complaints; ``doing`` as of :meth:`Running.wait`.

        What makes the engine fail is a figure without a number."""
        answers = self._answers(doing)
        figures: list[Figure] = []
        complaints = [self.refused] if self.refused else []
        for job in self.jobs:
            if job.known is not None:
                raw: Sequence[Figure] = [dataclasses.replace(figure, cached=True) for figure in job.known]
            else:
                answer = next(answers)
                if isinstance(answer, EngineError):
                    figures.append(_failed(job, answer))
                    continue
                raw = [_kept(figure, job) for figure in _figures(job, answer, self.engine)]
                if self.use_cache and not cache.write(job.key, raw):
                    complaints = [f"the cache {cache.ENTRIES.folder()} is not writable"]
                figures += cache.differing(job.sampled or (), raw)
            settings = job.settings(self.engine)
            figures += [deviating(figure, job.law, self.engine, settings, self.version) for figure in raw]
        return figures, complaints

    def _answers(self, doing: Callable[[str], None] | None) -> Iterator[list[Answer] | EngineError]:
        """Of each job that is not known, its answers. One process for all; when it fails, one for each, to find out which
        of them it was."""
        if self.running is None:
            return
        counts = [len(job.operations) for job in self.jobs if job.known is None]
        starts = np.cumsum([0, *counts])
        try:
            answers = self.running.wait(doing=doing).answers
        except EngineError as error:
            for start_at, count in zip(starts, counts, strict=False):
                yield self._alone(self.operations[start_at : start_at + count], error)
            return
        for start_at, count in zip(starts, counts, strict=False):
            yield answers[start_at : start_at + count]

    def _alone(self, operations: Sequence[Operation], error: EngineError) -> list[Answer] | EngineError:
        left = self.ends - time.monotonic()
        if left <= 0.0:
            return error
        try:
            return call(self.engine.NAME, self.place, operations, python=self.python, deadline=left).answers
        except EngineError as again:
            return again


def laws(world: World) -> list[Law]:
    """What is to be measured of ``world``: the laws of all pairs of materials that can meet."""
    moving = belts(world)
    return [
        Law(
            law,
            world.contact.friction_cone,
            world.physics.timestep,
            moving[pair][2] if pair in moving else NO_BELT,
            reach=reach(world, *pair),
        )
        for pair, law in meeting_laws(world).items()
    ]


@contextmanager
def measure(
    world: World,
    engine_name: str,
    folder: Path,
    python: str | None,
    deadline: float,
    use_cache: bool,
    read: ReadBack | None = None,
    warm: WarmProcesses | None = None,
) -> Iterator[Measuring]:
    """Begin to measure what ``engine_name`` makes of the contact law in the artifacts of ``folder``; ``read`` is what the
    independent reader made of them (default: read here); ``warm``: processes that the engine is forked from.

    Raises UnsupportedError when the law that the files hold cannot be compiled, EngineError when the engine is missing.
    """
    engine = find_engine(engine_name)
    refused = (cache.ENTRIES.refused() or "") if use_cache else ""
    use_cache = use_cache and python is None and not refused  # another interpreter's version is known only afterwards
    whole = held(world, engine, folder, read)
    jobs = [
        _job(engine, whole, law, probe, use_cache, python)
        for law in laws(world)
        for probe in PROBES.values()
        if probe.applies(law)
    ]
    sizes = None if Capability.PAIR_DETECTION in engine.LACKS else size.size_trial(world)
    if sizes is not None:
        jobs.append(_size_job(engine, whole, sizes, use_cache, python))
    jobs = _sampled(jobs)
    with ExitStack() as stack:
        operations: list[Operation] = []
        place = stack.enter_context(scratch_folder("contact"))
        for job in jobs:
            if job.known is None:
                for compiled, operation in zip(job.compiled, job.operations, strict=True):
                    artifacts = place / str(len(operations))
                    write_folder(compiled.files, artifacts)
                    parameters = {**operation.parameters, "artifacts": str(artifacts)}
                    operations.append(dataclasses.replace(operation, parameters=parameters))
        running = None
        ends = time.monotonic() + deadline
        if operations:
            running = stack.enter_context(
                start(engine_name, place, operations, python=python, deadline=deadline, warm=warm)
            )
        version = version_at_work(engine_name, {} if python is None else {engine_name: python})
        yield Measuring(
            engine, tuple(jobs), tuple(operations), running, place, python, version, ends, use_cache, refused
        )


def _job(engine: type[Engine], whole: FileLaw, law: Law, probe: Probe, use_cache: bool, python: str | None) -> _Job:
    of_two = of_pair(whole, law.pair.first, law.pair.second)
    worlds: list[tuple[World, ...]] = []
    compiled: list[Compiled] = []
    operations: list[Operation] = []
    belt = whole.belts.get((law.pair.first, law.pair.second))
    for trial in probe.trials(dataclasses.replace(law, belt_written=belt)):
        parts = split(trial, engine.PROBED_TOGETHER)
        worlds.append(tuple(_world(of_two, part) for part in parts))
        for world, part in zip(worlds[-1], parts, strict=True):
            compiled.append(_compiled(engine, world, of_two.plan, python))
            operations.append(drive_of(world, part))
    name = _key(engine, compiled, operations, law, probe.NAME) if use_cache else ""
    known = cache.read(name) if use_cache else None
    return _Job(
        name,
        law,
        probe,
        tuple(compiled),
        tuple(operations),
        tuple(worlds),
        known=None if known is None else tuple(known),
    )


def _size_job(engine: type[Engine], whole: FileLaw, sizes: size.SizeTrial, use_cache: bool, python: str | None) -> _Job:
    contact = dataclasses.replace(
        sizes.world.contact, friction_cone=whole.contact.friction_cone, pairs=whole.contact.pairs
    )
    world = dataclasses.replace(sizes.world, contact=contact, engines=(whole.options,))
    compiled = _compiled(engine, world, whole.plan, python)
    operation = Operation("touching", {}, {"q": sizes.q, "v": np.zeros((1, layout_of(world).nv))}, world)
    name = _key(engine, [compiled], [operation], None, size.NAME) if use_cache else ""
    known = cache.read(name) if use_cache else None
    return _Job(name, None, None, (compiled,), (operation,), sizes=sizes, known=None if known is None else tuple(known))


def _compiled(engine: type[Engine], world: World, plan: ContactPlan, python: str | None) -> Compiled:
    name = engine.NAME
    pythons = {} if python is None else {name: python}
    return compile_world(world, [name], plans={name: plan}, pythons=pythons)[name]


def _key(
    engine: type[Engine], compiled: Sequence[Compiled], operations: Sequence[Operation], law: Law | None, probe: str
) -> str:
    drives = [
        [operation.op, dict(operation.parameters), {name: value.tolist() for name, value in operation.arrays.items()}]
        for operation in operations
    ]
    # what the world can do besides decides which probes there are, and is in their trials
    wanted = None if law is None else to_plain(dataclasses.replace(law, reach=Reach()))
    return cache.key(engine, [artifacts.sha256 for artifacts in compiled], drives, wanted, probe)


def _world(actual_pair: FileLaw, trial: Trial) -> World:
    physics = Physics((0.0, 0.0, -GRAVITY), actual_pair.timestep)
    return world_of_trial(trial, actual_pair.contact, physics, actual_pair.options)


def _figures(job: _Job, answers: Sequence[Answer], engine: type[Engine]) -> Sequence[Figure]:
    if job.sizes is not None:
        return size.size_figures(job.sizes, answers[0].arrays["touching"], engine.thicker(job.sizes.world))
    if job.probe is None or job.law is None:
        raise ValueError("a job is a probe of a law, or of sizes")
    answer = iter(answers)
    motions = [joined([motion_of(world, next(answer)) for world in worlds]) for worlds in job.worlds]
    return job.probe.figures(job.law, motions)


def _sampled(jobs: Sequence[_Job]) -> list[_Job]:
    """The jobs, of which one that the cache knows is measured all the same: nobody can say beforehand which."""
    known = [number for number, job in enumerate(jobs) if job.known is not None]
    found = list(jobs)
    if known:
        chosen = secrets.choice(known)
        found[chosen] = dataclasses.replace(jobs[chosen], known=None, sampled=jobs[chosen].known)
    return found


def _failed(job: _Job, error: EngineError) -> Figure:
    """The one figure of a job that the engine failed at."""
    subject = "shapes" if job.law is None else job.law.subject
    name = size.NAME if job.probe is None else job.probe.NAME
    return Figure(name, subject, str(error), "", "", 0.0, None, 0.0)


def _kept(figure: Figure, job: _Job) -> Figure:
    """A figure as certificates keep it: no number where there is none, points only where they are drawn, and what an engine
    without the effect would show."""
    wanted = None if job.probe is None or job.law is None else job.probe.reference(job.law, figure)
    if figure.without is None and wanted is not None:
        figure = dataclasses.replace(figure, without=wanted.without)
    points: tuple[tuple[float, ...], ...] = ()
    if figure.probe in PLOTTED and np.isfinite(figure.points).all():
        points = tuple(tuple(round(value, DIGITS) for value in row) for row in figure.points)
    measured = figure.measured
    finite = measured is not None and math.isfinite(measured)
    return dataclasses.replace(figure, measured=float(measured) if finite else None, points=points)  # type: ignore[arg-type]


def deviating(
    figure: Figure, law: Law | None, engine: type[Engine], settings: Mapping[str, Any], version: str | None = None
) -> Figure:
    """The figure with the tolerance that the engine's declared deviations give it under its settings in its release; a size
    has none."""
    return figure if law is None else widened(figure, law, engine.CONTACT_DEVIATIONS, settings, version)


def widened(
    figure: Figure, law: Law, declared: Iterable[Deviation], settings: Mapping[str, Any], version: str | None = None
) -> Figure:
    """The figure with the tolerance of the widest of some deviations that count for it, where it does not pass by itself."""
    sizes = [
        ((deviation.size * abs(figure.expected) if deviation.relative else deviation.size), deviation)
        for deviation in declared
        if deviation.probe == figure.probe
        and deviation.counts_for(law.pair, law.friction_cone, law.timestep, settings, law.reach.ratio, version)
    ]
    wider = [entry for entry in sizes if entry[0] > figure.tolerance]
    if not wider or figure.passed:
        return figure
    tolerance, deviation = max(wider, key=lambda entry: entry[0])
    return dataclasses.replace(figure, tolerance=tolerance, deviation=deviation.why, promised=figure.tolerance)


def contact_checks(figures: Sequence[Figure]) -> list[Check]:
    """One check for each probe: how far its worst figure is off, in units of that figure's tolerance."""
    by_probe: dict[str, list[Figure]] = {}
    for figure in figures:
        by_probe.setdefault(figure.probe, []).append(figure)
    checks = []
    for probe, some in by_probe.items():
        worst = max(some, key=_off)
        off = _off(worst)
        number = f"{worst.measured:.4g}" if worst.measured is not None else "no number"
        detail = (
            f"{worst.quantity} {number}, should be {worst.expected:.4g} ± {worst.tolerance:.2g} {worst.unit}".rstrip()
        )
        detail += f"; {worst.label}" + (f"; declared: {worst.deviation}" if worst.deviation else "")
        name = f"{probe}, in tolerances"
        checks.append(Check(LEVEL, name, len(some), 1.0, None if math.isinf(off) else off, worst.subject, detail))
    return checks


def _off(figure: Figure) -> float:
    if figure.measured is None or not math.isfinite(figure.measured):
        return math.inf
    off = abs(figure.measured - figure.expected)
    return off / figure.tolerance if figure.tolerance else (0.0 if off == 0.0 else math.inf)


def not_measured(error: UnsupportedError | EngineError) -> Check:
    """The check of an engine whose files hold a law that cannot be probed, or that failed on the way."""
    text = error.problems[0].message if isinstance(error, UnsupportedError) else str(error)
    return failed(LEVEL, "contact law of the files", text)
