"""The main job, end to end: compile, verify, run, repeat, compare."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec.comparison.floor import Floor, measure_floor, perturbation_of
from simspec.comparison.runs import TOLERANCE, Diff, diff
from simspec.compiler import Compiled, bounded, compile_world, output_files, version_at_work
from simspec.engines.kit.process import DEADLINE, at_work
from simspec.engines.kit.registry import find_engine, not_installed, other_version
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, EngineError, Location
from simspec.files import scratch_folder
from simspec.numerals import rounded
from simspec.outputs.writing import Artifacts
from simspec.plugins import Method
from simspec.runner.execution import failed_run, run_case, run_jobs
from simspec.runner.expectations import Outcome, evaluate
from simspec.runner.run import Case, Run
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.proof.certificate import Certificate


@dataclass(frozen=True)
class Study:
    """One world in several engines.

    ``certificate``: the proof that all hold the same model, None when it was not requested. ``runs``, ``floors`` (each
    engine's own noise), ``repeats`` (the runs that the noise was measured from) and ``outcomes`` (of the world's
    expectations) by engine; ``diffs`` one per pair of engines.
    """

    world: World
    certificate: Certificate | None
    runs: Mapping[str, Run]
    repeats: Mapping[str, tuple[Run, ...]]
    floors: Mapping[str, Floor]
    outcomes: Mapping[str, tuple[Outcome, ...]]
    diffs: tuple[Diff, ...]

    def __repr__(self) -> str:
        return f"<Study of {self.world.name!r} in {', '.join(self.runs)[:100]}>"

    show = Method("simspec.report.notebook:show_study")

    @property
    def exit_code(self) -> int:
        """The exit code of the command line: 3 when an engine failed, 1 when a proof or an expectation did, else 0."""
        if any(run.failed is not None for run in self.runs.values()):
            return EXIT_ENGINE
        if self.certificate is not None and not self.certificate.valid:
            return EXIT_FAILED
        passed = all(outcome.passed for outcomes in self.outcomes.values() for outcome in outcomes)
        return EXIT_OK if passed else EXIT_FAILED


class Arrivals:
    """Receives the parts of a study as it goes, each as soon as it exists; by default nothing is done with them.

    Results are saved here, so that a later error or the end of the process loses none.
    """

    def compiled(self, compiled: Mapping[str, Compiled], files: Artifacts) -> None:
        """The artifacts of all engines, and as the files of one folder, before anything is proven or run."""

    def certificate(self, certificate: Certificate) -> None:
        """The proof, before anything is run."""

    def run(self, run: Run) -> None:
        """One engine's run, failed or not, before the next begins."""

    def floor(self, floor: Floor) -> None:
        """One engine's own noise."""


def missing_engines(
    engines: Iterable[str], pythons: Mapping[str, str] | None = None, world: World | None = None
) -> dict[str, str]:
    """The engines that are not installed here, or not in that version, each with the way to have it; and those whose own
    interpreter gives no version, where what ``world`` needs depends on that."""
    reasons = {}
    for name in engines:
        engine = find_engine(name)
        if name in (pythons or {}):
            try:
                if world is not None and bounded(world, name):
                    version_at_work(name, pythons)
            except EngineError as error:
                reasons[name] = str(error).removeprefix(f"{name}: ")
            continue
        here = engine.version()
        if here is None:
            reasons[name] = not_installed(engine)
        elif (why := other_version(name, here)) is not None:
            reasons[name] = why
    return reasons


def study(
    world: World,
    engines: Iterable[str],
    *,
    compiled: Mapping[str, Compiled] | None = None,
    arrivals: Arrivals | None = None,
    prove: bool = True,
    levels: Iterable[str] | None = None,
    repeats: bool = True,
    cache: bool = True,
    keep_going: bool = False,
    tolerance: float = TOLERANCE,
    pythons: Mapping[str, str] | None = None,
    deadline: float = DEADLINE,
    source: Mapping[str, Any] | None = None,
    locate: Callable[[str], Location | None] = lambda path: None,
    progress: Callable[..., None] = lambda text, share=None: None,
) -> Study:
    """Compile ``world``, prove that the engines hold it, run it in each, and compare the runs pair by pair.

    compiled   what compiling ``world`` for these engines gave (default: compiled here)
    arrivals   receives artifacts, certificate, runs and floors as they come
    prove      whether to verify first
    levels     levels of the proof (default: all)
    repeats    whether to run each engine again, unchanged and perturbed, for its noise floor
    cache      whether contact figures and noise that were measured before are taken from the user's cache
    keep_going whether the others go on when an engine is missing or fails
    tolerance  position (m) and angle (rad) tolerance of the comparison
    source     where the world came from, for the runs' provenance
    progress   receives the current action, and of a run the completed share

    Runs are timed one after the other, each in a new process; only repeats, whose timing does not count, go two at a time, and
    are forked from warm processes, as proofs are. Raises EngineError
    when an engine is missing (unless ``keep_going``), UnsupportedError when the world cannot be compiled for one.
    """
    names = list(dict.fromkeys(engines))
    for name in names:
        find_engine(name)
    absent = missing_engines(names, pythons, world)
    if absent and not keep_going:
        raise EngineError(*next(iter(absent.items())))
    there = [name for name in names if name not in absent]
    arrivals = arrivals or Arrivals()
    # engines work from a private copy: the one that is kept may be replaced by another process meanwhile
    with WarmProcesses() as warm, scratch_folder("study") as place:
        root = place / "compiled"
        if compiled is None:
            progress("compiling")
            compiled = compile_world(world, there, locate, pythons=pythons)
        else:
            compiled = {name: compiled[name] for name in there}
        files = output_files(world, compiled)
        files.write(root)
        arrivals.compiled(compiled, files)
        artifacts = {name: root / name for name in there}
        certificate = None
        if prove and there:
            certificate = _prove(world, compiled, artifacts, levels, pythons, deadline, cache, progress, warm)
            arrivals.certificate(certificate)
        runs = _run_each(world, names, absent, artifacts, keep_going, pythons, deadline, source, progress, arrivals)
        floors: Mapping[str, Floor] = {}
        again: Mapping[str, tuple[Run, ...]] = {}
        if repeats:
            floors, again = _noise(runs, artifacts, pythons, deadline, cache, progress, warm)
    for floor in floors.values():
        arrivals.floor(floor)
    progress("comparing")
    recorded = [run for run in runs.values() if run.recorded]
    diffs = tuple(
        diff(a, b, tolerance=tolerance, floor=[floors[run.engine] for run in (a, b) if run.engine in floors])
        for a, b in itertools.combinations(recorded, 2)
    )
    noise = {name: floor.position for name, floor in floors.items()}
    outcomes = {name: tuple(evaluate(run, noise.get(name))) for name, run in runs.items()}
    return Study(world, certificate, runs, again, floors, outcomes, diffs)


def _prove(
    world: World,
    compiled: Mapping[str, Compiled],
    artifacts: Mapping[str, Path],
    levels: Iterable[str] | None,
    pythons: Mapping[str, str] | None,
    deadline: float,
    cache: bool,
    progress: Callable[..., None],
    warm: WarmProcesses,
) -> Certificate:
    from simspec.proof.verify import LEVELS, verify

    progress("verifying")
    return verify(
        world,
        list(compiled),
        compiled=compiled,
        artifacts=artifacts,
        levels=LEVELS if levels is None else levels,
        pythons=pythons or {},
        deadline=deadline,
        progress=progress,
        cache=cache,
        warm=warm,
    )


def _run_each(
    world: World,
    names: list[str],
    absent: Mapping[str, str],
    artifacts: Mapping[str, Path],
    keep_going: bool,
    pythons: Mapping[str, str] | None,
    deadline: float,
    source: Mapping[str, Any] | None,
    progress: Callable[..., None],
    arrivals: Arrivals,
) -> dict[str, Run]:
    runs: dict[str, Run] = {}
    for name in names:
        finished = "; ".join(f"{other} {_speed(run)}" for other, run in runs.items())
        doing = f"running {name}" + (f" (done: {finished})" if finished else "")
        if name in absent:
            runs[name] = failed_run(world, name, EngineError(name, absent[name]), (pythons or {}).get(name))
            arrivals.run(runs[name])
            continue
        progress(doing)
        try:
            runs[name] = run_case(
                Case(world, name),
                artifacts=artifacts[name],
                python=(pythons or {}).get(name),
                deadline=deadline,
                source=source,
                progress=functools.partial(progress, doing),
                doing=functools.partial(at_work, progress, doing),
            )
        except EngineError as error:
            runs[name] = failed_run(world, name, error, (pythons or {}).get(name))
        arrivals.run(runs[name])
        if runs[name].failed is not None and not keep_going:
            break
    return runs


def _speed(run: Run) -> str:
    """The result of a run in a few characters."""
    factor = run.real_time_factor
    return "failed" if run.failed is not None else f"{rounded(factor, 2)} × real time" if factor else "finished"


def _noise(
    runs: Mapping[str, Run],
    artifacts: Mapping[str, Path],
    pythons: Mapping[str, str] | None,
    deadline: float,
    cache: bool,
    progress: Callable[..., None],
    warm: WarmProcesses,
) -> tuple[dict[str, Floor], dict[str, tuple[Run, ...]]]:
    """The noise of each engine, and the runs that it was measured from: the engine's run again, unchanged, and with its initial
    state moved in the last bits. Noise of an earlier run with the same bits is taken from the cache."""
    from simspec.comparison.noise_cache import noise_key, read_noise, write_noise

    usable = {name: run for name, run in runs.items() if run.recorded and run.failed is None}
    # another interpreter is not described by the versions in the key
    keys = {name: noise_key(run) for name, run in usable.items() if cache and name not in (pythons or {})}
    known = {name: read_noise(usable[name], entry) for name, entry in keys.items()}
    names = [name for name in usable if known.get(name) is None]
    again: dict[str, tuple[Run, ...]] = {}
    if names:
        jobs = [
            (Case(runs[name].world, name, perturb=perturb), artifacts[name])
            for name in names
            for perturb in (0.0, perturbation_of(name))
        ]
        progress(f"repeating {', '.join(names)} for the noise floor")
        repeated = run_jobs(jobs, pythons=pythons, deadline=deadline, warm=warm)
        again = {name: tuple(repeated[2 * index : 2 * index + 2]) for index, name in enumerate(names)}
    floors = {}
    for name in usable:
        floor = known.get(name) or measure_floor(runs[name], again[name])
        if floor is None:
            continue
        floors[name] = floor
        if name in keys and not floor.cached and all(run.failed is None for run in again[name]):
            write_noise(floor, keys[name])
    return floors, again
