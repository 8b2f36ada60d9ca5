"""Proof level L5: every contact probe, on every pair of materials of a scenario that can meet, in one engine.

All probe worlds of an engine run one after the other in one process; figures that were measured before come from the cache.
"""

from __future__ import annotations

import dataclasses
import math
import secrets
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from simspec.compiler import Compiled, compile_world, version_at_work, write_folder
from simspec.contact import ContactPlan
from simspec.engines.kit.capabilities import Capability
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.process import Answer, Operation, Running, call, start
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, UnsupportedError
from simspec.files import scratch_folder
from simspec.proof.checks import Check, failed
from simspec.proof.contact import friction, leaning, normal, oblique, scope, simultaneous, size, spin, stacks
from simspec.proof.contact import stacks as carried
from simspec.proof.contact.probe import GRAVITY, NO_BELT, Probe, ProbeFigure, ProbeLaw, widened
from simspec.proof.contact.probe import wanted as figures_wanted
from simspec.proof.contact.worlds import (
    FileLaw,
    belts,
    drive_of,
    joined,
    law_of_files,
    motion_of,
    of_pair,
    split,
    world_of_trial,
)
from simspec.world.canonical import to_plain
from simspec.world.contact_pairs import meeting_laws
from simspec.world.kinematics import layout_of
from simspec.world.reach import MaterialReach, reach
from simspec.world.types import Pair, Physics, ReadBack, World

LEVEL = "L5"
_COUPLED = (
    *(leaning.Rod(), leaning.Clamp(), leaning.Pile(), leaning.Jam(), leaning.LightJam(), carried.Squeeze()),
    *(simultaneous.Strike(), simultaneous.BallRow(), simultaneous.Edge(), stacks.Stack(), stacks.SlidingStack()),
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
    *(normal.Restitution(), normal.Rest(), normal.OverlapRecovery(), oblique.Oblique()),
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
    law: ProbeLaw | None
    probe: Probe | None
    compiled: tuple[Compiled, ...]
    operations: tuple[Operation, ...]
    worlds: tuple[tuple[World, ...], ...] = ()
    """Of each trial the worlds that it is driven in, in the order of the operations."""
    sizes: size.SizeTrial | None = None
    known: tuple[ProbeFigure, ...] | None = None
    sampled: tuple[ProbeFigure, ...] | None = None
    """Figures in the cache of a job that is measured all the same, to verify the cache."""

    def settings(self, engine: type[Engine]) -> Mapping[str, Any]:
        """The scenario's settings of the engine for the pair."""
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

    def wait(self, doing: Callable[[str], None] | None = None) -> tuple[list[ProbeFigure], list[str]]:
        """The figures, and the cache's complaints; ``doing`` as of :meth:`Running.wait`.

        A job at which the engine fails is a figure without a number."""
        answers = self._answers(doing)
        figures: list[ProbeFigure] = []
        complaints = [self.refused] if self.refused else []
        for job in self.jobs:
            if job.known is not None:
                raw: Sequence[ProbeFigure] = [dataclasses.replace(figure, cached=True) for figure in job.known]
            else:
                answer = next(answers)
                if isinstance(answer, EngineError):
                    subject = "shapes" if job.law is None else job.law.subject
                    name = size.NAME if job.probe is None else job.probe.NAME
                    figures.append(ProbeFigure(name, subject, str(answer), "", "", 0.0, None, 0.0))
                    continue
                raw = [_kept(figure, job) for figure in _figures(job, answer, self.engine)]
                if self.use_cache and not scope.write(job.key, raw):
                    complaints = [f"the cache {scope.ENTRIES.folder()} is not writable"]
                figures += scope.differing(job.sampled or (), raw)
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


def laws(world: World) -> list[ProbeLaw]:
    """The laws to be measured of ``world``: those of all pairs of materials that can meet."""
    moving = belts(world)
    return [
        ProbeLaw(
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
    refused = (scope.ENTRIES.refused() or "") if use_cache else ""
    use_cache = use_cache and python is None and not refused  # another interpreter's version is known only afterwards
    whole = law_of_files(world, engine, folder, read)
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


def _job(
    engine: type[Engine], whole: FileLaw, law: ProbeLaw, probe: Probe, use_cache: bool, python: str | None
) -> _Job:
    of_two = of_pair(whole, law.pair.first, law.pair.second)
    physics = Physics((0.0, 0.0, -GRAVITY), of_two.timestep)
    worlds: list[tuple[World, ...]] = []
    compiled: list[Compiled] = []
    operations: list[Operation] = []
    belt = whole.belts.get((law.pair.first, law.pair.second))
    for trial in probe.trials(dataclasses.replace(law, belt_written=belt)):
        parts = split(trial, engine.PROBED_TOGETHER)
        worlds.append(tuple(world_of_trial(part, of_two.contact, physics, of_two.options) for part in parts))
        for world, part in zip(worlds[-1], parts, strict=True):
            compiled.append(_compiled(engine, world, of_two.plan, python))
            operations.append(drive_of(world, part))
    # the other abilities of the world decide which probes there are, and is in their trials
    described = (to_plain(dataclasses.replace(law, reach=MaterialReach())), probe.NAME)
    key, known = _cached(engine, compiled, operations, *described) if use_cache else ("", None)
    return _Job(key, law, probe, tuple(compiled), tuple(operations), tuple(worlds), known=known)


def _size_job(engine: type[Engine], whole: FileLaw, sizes: size.SizeTrial, use_cache: bool, python: str | None) -> _Job:
    contact = dataclasses.replace(
        sizes.world.contact, friction_cone=whole.contact.friction_cone, pairs=whole.contact.pairs
    )
    world = dataclasses.replace(sizes.world, contact=contact, engines=(whole.options,))
    compiled = _compiled(engine, world, whole.plan, python)
    operation = Operation("touching", {}, {"q": sizes.q, "v": np.zeros((1, layout_of(world).nv))}, world)
    key, known = _cached(engine, [compiled], [operation], None, size.NAME) if use_cache else ("", None)
    return _Job(key, None, None, (compiled,), (operation,), sizes=sizes, known=known)


def _compiled(engine: type[Engine], world: World, plan: ContactPlan, python: str | None) -> Compiled:
    pythons = {} if python is None else {engine.NAME: python}
    return compile_world(world, [engine.NAME], plans={engine.NAME: plan}, pythons=pythons)[engine.NAME]


def _cached(
    engine: type[Engine], compiled: Sequence[Compiled], operations: Sequence[Operation], law: Any, probe: str
) -> tuple[str, tuple[ProbeFigure, ...] | None]:
    """The key of a job in the cache, and its figures there."""
    drives = [
        [operation.op, dict(operation.parameters), {name: value.tolist() for name, value in operation.arrays.items()}]
        for operation in operations
    ]
    key = scope.key(engine, [artifacts.sha256 for artifacts in compiled], drives, law, probe)
    known = scope.read(key)
    return key, None if known is None else tuple(known)


def _figures(job: _Job, answers: Sequence[Answer], engine: type[Engine]) -> Sequence[ProbeFigure]:
    if job.sizes is not None:
        return size.size_figures(job.sizes, answers[0].arrays["touching"], engine.thicker(job.sizes.world))
    if job.probe is None or job.law is None:
        raise ValueError("a job is a probe of a law, or of sizes")
    answer = iter(answers)
    motions = [joined([motion_of(world, next(answer)) for world in worlds]) for worlds in job.worlds]
    return job.probe.figures(job.law, motions)


def _sampled(jobs: Sequence[_Job]) -> list[_Job]:
    """The jobs, of which one that the cache knows is measured all the same, chosen at random."""
    known = [number for number, job in enumerate(jobs) if job.known is not None]
    found = list(jobs)
    if known:
        chosen = secrets.choice(known)
        found[chosen] = dataclasses.replace(jobs[chosen], known=None, sampled=jobs[chosen].known)
    return found


def _kept(figure: ProbeFigure, job: _Job) -> ProbeFigure:
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
    figure: ProbeFigure,
    law: ProbeLaw | None,
    engine: type[Engine],
    settings: Mapping[str, Any],
    version: str | None = None,
) -> ProbeFigure:
    """The figure with the tolerance that the engine's declared deviations give it under its settings in its release; a size
    has none."""
    return figure if law is None else widened(figure, law, engine.CONTACT_DEVIATIONS, settings, version)


def contact_checks(figures: Sequence[ProbeFigure]) -> list[Check]:
    """One check for each probe: how far its worst figure is off, in units of that figure's tolerance."""
    by_probe: dict[str, list[ProbeFigure]] = {}
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


def _off(figure: ProbeFigure) -> float:
    if figure.measured is None or not math.isfinite(figure.measured):
        return math.inf
    off = abs(figure.measured - figure.expected)
    return off / figure.tolerance if figure.tolerance else (0.0 if off == 0.0 else math.inf)


def not_measured(error: UnsupportedError | EngineError) -> Check:
    """The check of an engine whose files hold a law that cannot be probed, or that failed on the way."""
    text = error.problems[0].message if isinstance(error, UnsupportedError) else str(error)
    return failed(LEVEL, "contact law of the files", text)


# Whether the contact figures of a stored certificate are those that its world must have: judged from the world and from
# the engine's declarations, since a file may have been edited, and its hash with it.

ROUNDING = 1e-9
"""Relative: expected values are computed anew, perhaps by another libm."""
SettingsBetween = Callable[[Pair], Mapping[str, Any]]


def figure_faults(
    figures: Sequence[ProbeFigure],
    world: World,
    engine: type[Engine] | None,
    settings: SettingsBetween,
    version: str | None = None,
) -> Iterator[str]:
    """Figures that are missing or that the world does not have, and those whose expected value, tolerance or declared
    deviation is not that of the probe and of the engine. ``engine`` None: one that is not known here, whose deviations
    cannot be judged; ``settings``: those in force between two materials; ``version``: the engine's release."""
    by_subject: dict[str, list[ProbeFigure]] = {}
    for figure in figures:
        by_subject.setdefault(figure.subject, []).append(figure)
    known = set()
    for law in laws(world):
        known.add(law.subject)
        between = settings((law.pair.first, law.pair.second))
        yield from _of_law(by_subject.get(law.subject, []), law, engine, between, version)
    rest = [figure for name, some in by_subject.items() if name not in known for figure in some]
    yield from _of_sizes(rest, world, engine)


def _of_law(
    figures: Sequence[ProbeFigure],
    law: ProbeLaw,
    engine: type[Engine] | None,
    settings: Mapping[str, Any],
    version: str | None,
) -> Iterator[str]:
    probes = [probe for probe in PROBES.values() if probe.applies(law)]
    wanted = Counter((figure.probe, figure.quantity) for probe in probes for figure in figures_wanted(probe, law))
    there = Counter((figure.probe, figure.quantity) for figure in figures)
    for probe in probes:
        if not figures_wanted(probe, law) and not any(name == probe.NAME for name, _ in there):
            yield f"L5 {probe.NAME}: no figure of {law.subject}"
    for (name, quantity), count in wanted.items():
        if not there[name, quantity]:
            yield f"L5 {name}: no figure of {law.subject} ({quantity})"
        elif there[name, quantity] != count:
            yield f"L5 {name}: {there[name, quantity]} figures of {law.subject} ({quantity}), this world has {count}"
    for figure in figures:
        source, reference = _reference(figure, law, probes)
        if source is None:
            yield f"L5 {figure.probe}: {figure.subject} has no figure {figure.case!r} ({figure.quantity})"
        elif reference is not None:
            yield from _numbers(figure, reference, source.slack(law))
            if engine is not None:
                yield from _deviation(figure, law, engine, settings, version, reference)


def _reference(figure: ProbeFigure, law: ProbeLaw, probes: Sequence[Probe]) -> tuple[Probe | None, ProbeFigure | None]:
    """The probe that has this figure, and what the figure must be held against."""
    for probe in probes:
        if (found := probe.reference(law, figure)) is not None:
            return probe, found
    # a probe that does not say what it wants is judged by its own numbers
    silent = (probe for probe in probes if not figures_wanted(probe, law))
    return next(silent, None), None


def _numbers(figure: ProbeFigure, reference: ProbeFigure, slack: float) -> Iterator[str]:
    for name in ("expected", "without"):
        given, wanted = getattr(figure, name), getattr(reference, name)
        if (given is None) != (wanted is None) or (
            given is not None and abs(given - wanted) > (ROUNDING + slack) * max(abs(wanted), abs(reference.expected))
        ):
            yield f"L5 {figure.probe}, {figure.case}: {name} value {_number(given)}, this world has {_number(wanted)}"


def _deviation(
    figure: ProbeFigure,
    law: ProbeLaw,
    engine: type[Engine],
    settings: Mapping[str, Any],
    version: str | None,
    reference: ProbeFigure,
) -> Iterator[str]:
    """The tolerance is the probe's, or that of a deviation that the engine declares for this law."""
    share = figure.expected / reference.expected if reference.expected else 1.0
    plain = replace(figure, tolerance=share * reference.tolerance, deviation="", promised=None)
    wanted = deviating(plain, law, engine, settings, version)
    if figure.deviation != wanted.deviation:
        text = f"the deviation {figure.deviation!r}" if figure.deviation else "no deviation"
        yield f"L5 {figure.probe}, {figure.case}: {text}, {engine.NAME} declares {wanted.deviation or 'none'!r} here"
    elif abs(figure.tolerance - wanted.tolerance) > ROUNDING * wanted.tolerance:
        yield f"L5 {figure.probe}, {figure.case}: a tolerance of {figure.tolerance:g}, should be {wanted.tolerance:g}"
    elif (figure.promised is None) != (wanted.promised is None) or (
        figure.promised is not None
        and wanted.promised is not None
        and abs(figure.promised - wanted.promised) > ROUNDING * wanted.promised
    ):
        yield f"L5 {figure.probe}, {figure.case}: a promised tolerance of {_number(figure.promised)}"


def _of_sizes(figures: Sequence[ProbeFigure], world: World, engine: type[Engine] | None) -> Iterator[str]:
    lacks = engine is not None and Capability.PAIR_DETECTION in engine.LACKS
    trial = None if lacks else size.size_trial(world)
    given = {figure.subject: figure for figure in figures if figure.probe == size.NAME}
    wanted = {} if trial is None else {name: (shape, len(points)) for name, shape, _, points in trial.shapes}
    for name in wanted.keys() - given.keys():
        yield f"L5 {size.NAME}: no figure of {name}"
    thicker = {} if trial is None or engine is None else engine.thicker(trial.world)
    for figure in figures:
        if figure.probe != size.NAME or figure.subject not in wanted or trial is None:
            yield f"L5 {figure.probe}: {figure.subject} does not occur in this world"
            continue
        shape, points = wanted[figure.subject]
        outside = thicker.get(trial.world.bodies[shape].shapes[0].name, 0.0)
        limits = size.limits(outside)
        numbers = (figure.expected, figure.tolerance, figure.deviation, figure.case)
        if numbers != (0.0, *limits, size.case_of(points)):
            found = f"{figure.case}, a tolerance of {figure.tolerance:g}, should be {limits[0]:g}"
            yield f"L5 {size.NAME}, {figure.subject}: {found}"


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"
