"""``simspec bisect``: which released version of an engine changed a figure."""

from __future__ import annotations

import functools
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from simspec.analysis.run_figures import find_figure
from simspec.arguments import demand_trusted, interpreters, load_spec, print_json, spec_file
from simspec.attribution.configuration import Configuration
from simspec.attribution.models import model_lines, prove
from simspec.commands.accept import accepted_sets
from simspec.commands.engines_install import installed_version
from simspec.commands.run import OF_A_MODEL
from simspec.commands.sweep import RUNS, SWEEP_FOLDER
from simspec.compiler import compile_world
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.identity import MARK, EngineId, parse
from simspec.engines.kit.installed import too_old
from simspec.engines.kit.registry import find_engine
from simspec.engines.kit.released import in_order, released_versions, same_version
from simspec.errors import EXIT_FAILED, EXIT_OK, EngineError, Location, Problem, SpecError, UnsupportedError
from simspec.experiments.bisect import Bisection, Versions, search
from simspec.experiments.store import Store
from simspec.outputs.marker import STORE, STUDY
from simspec.outputs.targets import demand, folder_problem
from simspec.outputs.writing import open_folder
from simspec.report.bisect import bisect_data, bisect_lines
from simspec.report.progress import progress
from simspec.report.screen import say
from simspec.robot_files import NO_WORDS, RobotFiles
from simspec.world.types import World

NEAR: Final = 6
"""Released versions that a message lists for one that does not exist."""


def bisect(
    spec: str,
    *,
    engine: list[str] | None,
    first: str,
    last: str,
    figure: str,
    versions: str | None,
    yes: bool,
    store: Path | None,
    prove_models: bool,
    sets: list[str] | None,
    accept: list[str] | None,
    allow_outside: bool,
    robot_files: RobotFiles = NO_WORDS,
    python: list[str] | None,
    deadline: float,
    as_json: bool,
) -> int:
    """Find the version between ``first`` and ``last`` that changed ``figure``, and print it."""
    name = _only_engine(engine)
    kind = find_engine(name)
    _demand_order(kind, first, last)
    labels = [f"{name}{MARK}{end}" for end in (first, last)]
    sets = accepted_sets(spec, sets, accept, allow_outside, robot_files, labels, python)
    loaded = load_spec(
        spec, sets, allow_outside, robot_files=robot_files, as_json=as_json, duration_of_model=OF_A_MODEL
    )
    world, sets = loaded.world, loaded.sets
    named = find_figure(world, figure)
    pythons = interpreters(python)
    with progress(not as_json) as tell:
        if versions is None:
            tell(f"asking the package index for the versions of {name}")
            every = released_versions(kind, first, last)
        else:
            every = in_order(kind, [word.strip() for word in versions.split(",") if word.strip()])
        chosen = _between(kind, every, first, last, versions is not None)
        unsupported = _unsupported(world, name, chosen, loaded.spec.locate)
        folder = store or RUNS / world.name / SWEEP_FOLDER
        problems = [folder_problem(folder, STORE, [spec_file(spec)])]
        if store is None:
            problems.append(folder_problem(folder.parent, STUDY, [spec_file(spec)]))
        demand(problems)
        demand_trusted([f"{name}{MARK}{version}" for version in chosen], pythons)
        provide = functools.partial(_provided, kind, pythons, yes, tell)
        for end in (chosen[0], chosen[-1]):
            provide(f"{name}{MARK}{end}")  # before anything is written
        if store is None:
            open_folder(folder.parent, STUDY)
        opened = Store.open(folder, create=True)
        with opened.writing():
            measure = Versions(world, name, named, opened, provide, deadline, tell)
            tried = [version for version in chosen if version not in unsupported]
            done = search(named, tried, measure)
        models = _models(world, name, done, provide, deadline, tell) if prove_models else []
    done = Bisection(
        done.figure,
        tuple(chosen),
        done.readings,
        {**unsupported, **done.not_measured},
        done.before,
        done.after,
        done.notes,
    )
    more = _explain(spec, name, done, sets)
    code = EXIT_OK if done.found else EXIT_FAILED
    if as_json:
        print_json({"spec": spec, **bisect_data(name, done, models, more), "store": folder, "exit_code": code})
    else:
        for line in bisect_lines(name, done, models, more):
            say(line)
    return code


def _only_engine(words: Sequence[str] | None) -> str:
    """The one engine that is named. Raises SpecError for none, several, a version or an interpreter."""
    if not words or len(words) > 1:
        raise SpecError(
            [Problem("bisect takes one engine", found=", ".join(words or ()) or "none", allowed="--engine NAME")]
        )
    label = parse(words[0])
    if label.version or label.python is not None:
        message = "the versions are said by --from and --to"
        raise SpecError([Problem(message, found=words[0], allowed=f"--engine {label.name}")])
    return label.name


def _demand_order(engine: type[Engine], first: str, last: str) -> None:
    """Raise SpecError unless ``first`` is the older version, EngineError where one is none, or too old."""
    if same_version(first, last):
        raise SpecError([Problem(f"--from and --to are the same version, {first}", allowed="two versions")])
    ordered = in_order(engine, [first, last])
    if ordered != [first, last]:
        hint = f"--from {last} --to {first}"
        raise SpecError([Problem("--from is younger than --to", found=f"--from {first} --to {last}", hint=hint)])
    if not engine.DISTRIBUTION:
        raise EngineError(engine.NAME, "comes with the machine, not with pip: it has one version there")
    if (why := too_old(engine, first)) is not None:
        raise EngineError(f"{engine.NAME}{MARK}{first}", why)


def _between(engine: type[Engine], every: Sequence[str], first: str, last: str, given: bool) -> list[str]:
    """The versions from ``first`` to ``last``. Raises SpecError for versions of ``--versions`` outside of the two, EngineError
    where one of the two is not among the released ones."""
    if given:
        ends = in_order(engine, [first, last])
        every = in_order(engine, [*every, *ends])
        outside = [one for one in every if _outside(engine, one, first, last)]
        if outside:
            message = "--versions has versions that are not between --from and --to"
            raise SpecError([Problem(message, found=", ".join(outside), allowed=f"{first} to {last}")])
        return list(every)
    for end in (first, last):
        if not any(same_version(end, one) for one in every):
            near = ", ".join([*every[:NEAR], *(["…"] if len(every) > NEAR else [])]) or "none"
            message = f"is not a released version that this Python can install; between {first} and {last}: {near}"
            raise EngineError(f"{engine.NAME}{MARK}{end}", message)
    return list(every)


def _outside(engine: type[Engine], one: str, first: str, last: str) -> bool:
    ordered = in_order(engine, [first, one, last])
    return not (same_version(ordered[0], first) and same_version(ordered[-1], last))


def _unsupported(
    world: World, name: str, versions: Sequence[str], locate: Callable[[str], Location | None]
) -> dict[str, str]:
    """Why some of the versions do not support the world; what one of the two ends does not is raised."""
    reasons: dict[str, str] = {}
    for version in versions:
        try:
            compile_world(world, [f"{name}{MARK}{version}"], locate)
        except UnsupportedError as error:
            if version in (versions[0], versions[-1]):
                raise
            reasons[version] = error.problems[0].message
    return reasons


def _provided(
    engine: type[Engine], pythons: Mapping[str, str], yes: bool, tell: Callable[[str], None], label: str
) -> str | None:
    """The interpreter of a version: one that is known, this one where it has that version, else an environment."""
    if label in pythons:
        return pythons[label]
    version = label.partition(MARK)[2]
    if same_version(engine.version() or "none", version):
        return None
    if yes:
        tell(f"installing {label}, in an environment of its own")
    return installed_version(EngineId(engine.NAME, version), yes)


def _models(
    world: World,
    name: str,
    done: Bisection,
    provide: Callable[[str], str | None],
    deadline: float,
    tell: Callable[[str], None],
) -> list[str]:
    """Whether both versions hold the same model, in lines: what differs is then what they compute from it."""
    if done.before is None or done.after is None:
        return []
    labels = [f"{name}{MARK}{one.version}" for one in (done.before, done.after)]
    tell(f"verifying {' and '.join(labels)}: do both hold the model?")
    sides = [Configuration(world, label, provide(label)) for label in labels]
    return model_lines(prove(sides, deadline), True)


def _explain(spec: str, name: str, done: Bisection, sets: Sequence[str]) -> str:
    """The command that looks into the difference of the two versions."""
    if done.before is None or done.after is None:
        return ""
    words = ["simspec", "explain", spec]
    for one in (done.before, done.after):
        words += ["--engine", f"{name}{MARK}{one.version}"]
    for entry in sets:
        words += ["--set", entry]
    return shlex.join(words)
