"""What the commands of the command line share: their options, and what the words given to them stand for."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from simspec import numerals
from simspec.errors import EngineError, Problem, SpecError
from simspec.robot_files import NO_WORDS, RobotFiles

if TYPE_CHECKING:
    from simspec.language.load import Spec
    from simspec.project import Interpreters
    from simspec.selection import Selection
    from simspec.world.types import World

SpecName = Annotated[str, typer.Argument(metavar="SPEC", help="A YAML file, or the name of a library scenario.")]
SpecNames = Annotated[list[str] | None, typer.Argument(metavar="[SPEC]...", help="YAML files, or library scenarios.")]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Override a value: --set physics.timestep=2ms. Repeatable."),
]
Accepts = Annotated[
    list[str] | None,
    typer.Option(
        "--accept",
        metavar="FEATURE",
        help="Let engines have this feature approximately or from outside; all: whatever they need. Repeatable.",
    ),
]
Engines = Annotated[
    list[str] | None,
    typer.Option(
        "--engine",
        "-e",
        metavar="NAME",
        help="An engine. NAME@VERSION=PYTHON: in another interpreter. Repeatable.",
    ),
]
FormatName = Annotated[
    str | None,
    typer.Option("--format", metavar="NAME", help="Write plain files of this format, for any tool, and for no engine."),
]
Outside = Annotated[
    bool, typer.Option("--allow-outside", help="Allow `use:` to read files outside the project folder.")
]
Strict = Annotated[bool, typer.Option("--strict", help="Treat warnings as errors (exit code 2).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]
Pythons = Annotated[
    list[str] | None,
    typer.Option("--python", metavar="ENGINE=PATH", help="Run an engine in another Python interpreter. Repeatable."),
]
Deadline = Annotated[float, typer.Option(metavar="SECONDS", min=0.1, help="Deadline of one engine process.")]
DEADLINE = 600.0
AllEngines = Annotated[
    bool, typer.Option("--all-engines", help="Run in every installed engine that supports the spec, at least two.")
]
KeepGoing = Annotated[
    bool, typer.Option("--keep-going", help="Continue without an engine that is missing or fails (exit code 3).")
]
Repeats = Annotated[
    bool,
    typer.Option("--repeats/--no-repeats", help="Repeat runs, also with a perturbed initial state, to measure noise."),
]
FailOnDiff = Annotated[
    float | None,
    typer.Option(
        metavar="METRE",
        min=0.0,
        help="Exit with 1 if two engines differ by more than this and their noise, or if that noise is above this.",
    ),
]
JunitFile = Annotated[
    Path | None, typer.Option("--junit", metavar="FILE", help="Also write a test report that CI systems read (XML).")
]
Annotations = Annotated[
    bool, typer.Option("--annotations", help="Also print what failed as annotations of the spec's lines (GitHub).")
]
SummaryFile = Annotated[
    Path | None, typer.Option("--summary", metavar="FILE", help="Also write a summary as Markdown.")
]
GitHub = Annotated[
    bool, typer.Option("--github", help="In GitHub Actions: --annotations, and a summary beside the job.")
]
BaselineFile = Annotated[
    Path | None,
    typer.Option(
        "--baseline",
        metavar="FILE",
        help="Compare with figures stored earlier; exit with 1 if any changed beyond noise.",
    ),
]
NewBaseline = Annotated[
    Path | None, typer.Option("--write-baseline", metavar="FILE", help="Store this run's figures as a baseline.")
]
TimedRuns = Annotated[
    int,
    typer.Option(
        "--timed-runs",
        metavar="N",
        min=0,
        max=1000,
        help="For a baseline: runs of each engine for its speed, one at a time; 0: none.",
    ),
]


NUMBERS: Mapping[str, Callable[[str], float]] = {
    **dict.fromkeys(("--tolerance", "--fail-on-diff", "--deadline"), numerals.number),
    **dict.fromkeys(("--jobs", "--windows", "--timed-runs"), numerals.whole),
}
"""The options that take numbers, with how these are read before the command line is taken apart."""


class SchemaName(StrEnum):
    """The JSON Schemas that simspec writes."""

    LANGUAGE = "language"
    STUDY = "study"
    FIGURES = "figures"
    ENGINE_REQUEST = "engine-request"
    ENGINE_RESULT = "engine-result"
    PROJECT = "project"


def print_json(value: Any) -> None:
    """Print the one answer of a command."""
    from simspec.report.plain import text

    sys.stdout.write(text(value))


class Loaded(NamedTuple):
    """A spec, its world, what looks like a slip in it, and the overrides with which it was read."""

    spec: Spec
    world: World
    warnings: list[Problem]
    sets: list[str]


def load_spec(
    name: str,
    sets: list[str] | None = None,
    allow_outside: bool = False,
    *,
    robot_files: RobotFiles = NO_WORDS,
    check_effect: bool = True,
    strict: bool = False,
    as_json: bool = False,
    warn: bool = True,
    duration_of_model: str = "",
) -> Loaded:
    """Read and resolve a spec. Warnings are printed on standard error (with ``as_json`` the caller's answer holds them); with
    ``strict`` they are raised. ``robot_files``: how files of other languages are read; that this has an effect is checked here
    unless ``check_effect`` is false. ``duration_of_model``: how long a model runs whose file does not say so; it is added to
    ``sets``, and told on standard error."""
    from simspec.compiler import check_at_timestep, deep_contact, pairs_without_effect
    from simspec.language.load import load

    sets, options = list(sets or ()), robot_files.options()
    file = spec_name(name)
    spec = load(file, sets=tuple(sets), allow_outside=allow_outside, options=options)
    if check_effect:
        robot_files.check_effect(spec)
    if duration_of_model and spec.is_model_without_duration(sets):
        sets.append(f"physics.duration={duration_of_model}")
        from simspec.report.screen import say

        say(f"{name} is a model without a duration: --set {sets[-1]}", error=True)
        spec = load(file, sets=tuple(sets), allow_outside=allow_outside, options=options)
    world = spec.resolve()
    if problems := check_at_timestep(spec):
        raise SpecError(problems)
    found = [*spec.warnings(world), *pairs_without_effect(spec, world), *deep_contact(spec, world)] if warn else []
    if strict and found:
        raise SpecError(found)
    if found and not as_json:
        from simspec.report.terminal import show_warnings

        show_warnings(found)
    return Loaded(spec, world, found, sets)


def spec_name(name: str) -> str:
    """The name of the file that an argument of the command line means, as :func:`simspec.language.load.load` takes it. The
    argument is a path, a scenario of the library, ``package://NAME/PATH``, ``robot_descriptions://ROBOT``, or the bare name of
    such a robot where no file has it. Raises SpecError."""
    from simspec.language.packages import ROBOT, is_packaged, is_robot
    from simspec.resources import find_spec

    if is_packaged(name):
        return name
    try:
        return str(find_spec(name))
    except SpecError:
        if is_robot(name):
            return f"{ROBOT}{name}"
        raise


def spec_file(name: str) -> Path:
    """The same as a path. Raises SpecError."""
    from simspec.language.foreign import suffixes
    from simspec.language.packages import is_packaged, packaged

    text = spec_name(name)
    return packaged(text, suffixes()).path if is_packaged(text) else Path(text)


def interpreters(
    words: list[str] | None, engine_words: list[str] | None = None, *, starts: bool = True
) -> Interpreters:
    """The interpreters that ``--python`` and ``--engine`` name, and for other engines those of the project file and the
    environments that simspec made, by the engine's label. ``starts``: whether the command starts engines; one that lists, plans
    or shows starts no interpreter of a project file."""
    from simspec.engines.kit.identity import parse
    from simspec.engines.kit.registry import find_engine
    from simspec.project import load_project

    typed: dict[str, str] = {}
    for word in words or ():
        engine = parse(word)
        if engine.python is None:
            raise SpecError([Problem(f"--python {word}: no interpreter given", allowed="ENGINE=/path/to/python")])
        find_engine(engine.name)
        typed[engine.label] = engine.python
    for engine in map(parse, engine_words or ()):
        if engine.python is not None and typed.setdefault(engine.label, engine.python) != engine.python:
            message = f"{engine.label} is given two interpreters"
            raise SpecError([Problem(message, found=f"{typed[engine.label]} and {engine.python}")])
    project = load_project()
    return (project.known_interpreters() if starts else project.listed_interpreters()).with_named(typed)


def demand_trusted(labels: Iterable[str], pythons: Mapping[str, str]) -> None:
    """Raise NotTrustedError where an engine's interpreter is one of a project file that is not trusted: before anything is
    started or written."""
    for label in labels:
        pythons.get(label)


def chosen_engines(words: list[str] | None) -> list[str]:
    """The engines that ``--engine`` names, else the default engines of the project file; empty where there are none."""
    from simspec.project import load_project

    return words or list(load_project().default_engines)


def engine_names(words: list[str]) -> list[str]:
    """The engines asked for, by label."""
    from simspec.engines.kit.identity import parse
    from simspec.engines.kit.registry import find_engine
    from simspec.formats.kit.contract import formats

    labels: dict[str, None] = {}
    for word in words:
        engine = parse(word)
        try:
            find_engine(engine.name)
        except EngineError as error:
            if engine.name in formats():
                hint = f"--engine ENGINE; plain files: simspec compile SPEC --format {engine.name}"
                raise SpecError([Problem(f"{engine.name!r} is a format, not an engine", hint=hint)]) from error
            raise
        labels[engine.label] = None
    return list(labels)


def names_alone(words: list[str]) -> list[str]:
    """The same for what is about files: they are of an engine, whatever its version."""
    from simspec.engines.kit.identity import engine_name

    return list(dict.fromkeys(map(engine_name, engine_names(words))))


def engines_for_files(words: list[str] | None) -> Selection:
    """The engines that files are written for: those that are named, else every known one."""
    from simspec import selection

    return selection.named(names_alone(words)) if words else selection.known()


def engines_at_work(
    words: list[str] | None, pythons: Mapping[str, str], demand: bool = True, files_alone: bool = False
) -> Selection:
    """The engines that have to run: those that are named, else every installed one. Raises EngineError for a named engine that
    is not installed (unless ``demand`` is false, or ``files_alone`` is true and only its files are ever proven), SpecError when
    no engine is, NotTrustedError for one whose interpreter a project file names that is not trusted."""
    from simspec import selection
    from simspec.engines.kit.registry import find_engine

    if words:
        names = engine_names(words)
        demand_trusted(names, pythons)
        if demand:
            demand_installed([name for name in names if not (files_alone and find_engine(name).FILES_ALONE)], pythons)
        return selection.named(names, pythons)
    found = selection.available(pythons)
    demand_trusted(found.engines, pythons)
    if not found.engines:
        raise SpecError([Problem("no engine is installed", hint="pip install 'simspec[all]', or use --engine NAME")])
    return found


def demand_installed(names: list[str], pythons: Mapping[str, str]) -> None:
    """Raise EngineError for the first engine that is neither installed nor found in an interpreter of its own."""
    from simspec.comparison.study import missing_engines

    for name, why in missing_engines(names, pythons).items():
        raise EngineError(name, why)


def source_of(name: str, sets: list[str] | None, spec: Spec, robot_files: RobotFiles = NO_WORDS) -> dict[str, Any]:
    """Where a run's world came from, for its provenance: the file ``name``, from which ``spec`` was read, and what was said of
    it; what was repaired of robot files; of files of installed packages their versions and digests."""
    import hashlib

    from simspec.language.losses import repaired, repairs_data

    path = spec_file(name)
    read: dict[str, Any] = {"robot_files": asdict(robot_files)} if robot_files != NO_WORDS else {}
    if repairs := repaired(spec.source.all()):
        read["repairs"] = repairs_data(repairs)
    if packages := spec.packages():
        read["packages"] = packages
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return {"file": path.name, "sha256": digest, "sets": list(sets or ()), **read}
