"""``simspec explain`` and ``bisect``: where the difference of two runs or specs comes from."""

from __future__ import annotations

import functools
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from simspec.analysis.speed import find_figure
from simspec.attribution.configuration import Configuration, ModelProof, model_lines, proof_of, prove
from simspec.attribution.sides import explain as explain_sides
from simspec.attribution.sides import side_of_run
from simspec.commands.check import is_writable
from simspec.commands.experiment_options import BisectOptions, ExplainOptions
from simspec.commands.install import installed_version
from simspec.commands.loading import OF_A_MODEL, accepted_sets, load_spec
from simspec.commands.options import demand_installed, demand_trusted, engine_names, interpreters, print_json
from simspec.commands.reports import SWEEP_FOLDER
from simspec.compiler import compile_world
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.environments import in_order, released_versions, same_version
from simspec.engines.kit.registry import MARK, EngineId, find_engine, parse, too_old
from simspec.errors import EXIT_FAILED, EXIT_OK, EngineError, Location, Problem, SpecError, UnsupportedError
from simspec.experiments.bisect import Versions, search
from simspec.experiments.store import Store
from simspec.generated import CERTIFICATE_FILE, GENERATED, read_certificate
from simspec.outputs.targets import STORE, STUDY, demand, folder_problem
from simspec.outputs.writing import open_folder
from simspec.report.experiments import bisect_data, bisect_lines
from simspec.report.explain import explanation_data, show_explanation
from simspec.report.problems import with_ways_out
from simspec.report.screen import progress, say
from simspec.runner.run import Run
from simspec.runner.store import load_run
from simspec.world.types import World

RUNS: Final = Path("runs")
NEAR: Final = 6
"""Released versions that a message lists for one that does not exist."""


# --- explain ----------------------------------------------------------------------------------------------------------------


def explain(options: ExplainOptions) -> int:
    """Explain the difference of two run folders, or of one or two specs in engines. The exit code is always 0: no result is a
    failure."""
    pythons = options.interpreters()
    a, b = options.a, options.b
    notes: list[str] = []
    versions: list[str | None] = [None, None]
    if any(Path(name).is_dir() for name in (a, b) if name is not None):
        if b is None or not (Path(a).is_dir() and Path(b).is_dir()):
            given = ", ".join(filter(None, (a, b)))
            message = "cannot explain this difference"
            raise SpecError([Problem(message, found=given, allowed="two run folders, or specs", code="C102")])
        if options.engine or options.others or options.sets or options.accept:
            message = "--engine, --set, --accept and --with are for specs: runs have their own"
            raise SpecError([Problem(message, found=f"{a}, {b}", code="C102")])
        options.robot_files.check_effect()
        runs = {name: load_run(name) for name in (a, b)}
        sides = [side_of_run(runs[name], pythons, name) for name in (a, b)]
        names = [f"{name} ({runs[name].label})" for name in (a, b)]
        notes = _other_versions([runs[name] for name in (a, b)], names, pythons)
        folders = [Path(name).parent for name in (a, b)]
        versions = [runs[name].provenance.get("engine_version") for name in (a, b)]
        demand_installed(list(dict.fromkeys(side.engine for side in sides)), pythons)
    else:
        sides, names = _of_specs(options, pythons)
        folders = [GENERATED / side.world.name for side in sides]
    proofs = [_stored_proof(*facts) for facts in zip(sides, folders, versions, strict=True)]
    with progress(not options.as_json) as tell:
        explanation = explain_sides(
            *sides,
            windows=options.windows,
            names=(names[0], names[1]),
            deadline=options.deadline,
            proofs=() if options.verify else proofs,
            verify=options.verify,
            progress=tell,
        )
    if options.as_json:
        print_json({**explanation_data(explanation), "notes": notes})
    else:
        show_explanation(explanation, notes)
    return EXIT_OK


def _stored_proof(side: Configuration, folder: Path, version: str | None) -> ModelProof:
    """The proof of a side in the certificate of a folder."""
    source = str(folder / CERTIFICATE_FILE)
    try:
        certificate = read_certificate(folder)
    except SpecError as error:
        return ModelProof(side.engine, missing=error.problems[0].message)
    if certificate is None:
        return ModelProof(side.engine, missing=f"there is no {source}")
    return proof_of(side, certificate, source, version)


def _of_specs(options: ExplainOptions, pythons: Mapping[str, str]) -> tuple[list[Configuration], list[str]]:
    words, others = options.engine or [], options.others or []
    if not 1 <= len(words) <= 2:
        allowed = (
            "--engine A --engine B; or one --engine, and what the second side has: --with PATH=VALUE, or a second spec"
        )
        raise SpecError(
            [Problem("explain takes one engine or two", found=", ".join(words) or "none", allowed=allowed, code="C102")]
        )
    if len(words) == 1 and options.b is None and not others:
        hint = "add a second --engine, --with PATH=VALUE for the second side, or a second spec"
        raise SpecError([Problem("there is only one side", found=words[0], hint=hint, code="C102")])
    labels = [engine_names([word])[0] for word in words]
    demand_installed(labels, pythons)
    labels = [labels[0], labels[-1]]
    loaded = [
        load_spec(options, name, sets=sets, check_effect=False, warn=False, duration=OF_A_MODEL)
        for name, sets in _accepting(options)
    ]
    options.robot_files.check_effect(*(entry.spec for entry in loaded))
    together = loaded[0].world == loaded[1].world
    for name, entry, label in zip((options.a, options.b or options.a), loaded, labels, strict=True):
        needed = labels if together else [label]
        with with_ways_out(name, needed, entry.world, pythons, is_writable(entry.spec)):
            compile_world(entry.world, needed, entry.spec.locate, pythons=pythons)
    sides = [Configuration(entry.world, label, pythons.get(label)) for entry, label in zip(loaded, labels, strict=True)]
    second = " ".join([f"{options.b or options.a} in {labels[1]}", *(f"--with {word}" for word in others)])
    return sides, [f"{options.a} in {labels[0]}", second]


def _accepting(options: ExplainOptions) -> list[tuple[str, list[str]]]:
    """The spec of each side, with its overrides, those of ``--accept`` included. Raises SpecError for a feature that neither
    needs."""
    sets = list(options.sets or ())
    sides: list[tuple[str, list[str]]] = []
    failed: list[SpecError] = []
    for name, given in ((options.a, sets), (options.b or options.a, [*sets, *(options.others or ())])):
        try:
            sides.append((name, accepted_sets(replace(options, python=None), name, given)))
        except SpecError as error:  # an error in the spec itself is raised when it is read
            sides.append((name, given))
            failed.append(error)
    if len(failed) == len(sides):
        raise failed[0]
    return sides


def _other_versions(runs: Sequence[Run], names: Sequence[str], pythons: Mapping[str, str]) -> list[str]:
    """A note for each run that was made with another version of its engine than is queried now."""
    notes = []
    for run, name in zip(runs, names, strict=True):
        made, here = run.provenance.get("engine_version"), find_engine(run.engine).version()
        if run.engine not in pythons and made != here:
            notes.append(f"note: {name} was made with {run.engine} {made}; {here} is used now")
    return notes


# --- bisect -----------------------------------------------------------------------------------------------------------------


def bisect(options: BisectOptions) -> int:
    """Find the version between ``--from`` and ``--to`` that changed a figure, and print it."""
    first, last = options.first, options.last
    name = _only_engine(options.engine)
    engine = find_engine(name)
    _demand_order(engine, first, last)
    labels = [f"{name}{MARK}{end}" for end in (first, last)]
    loaded = load_spec(replace(options, engine=labels), options.spec, duration=OF_A_MODEL)
    world = loaded.world
    figure = find_figure(world, options.figure)
    pythons = interpreters(options.python)
    with progress(not options.as_json) as tell:
        if options.versions is None:
            tell(f"asking the package index for the versions of {name}")
            released = released_versions(engine, first, last)
        else:
            released = in_order(engine, [word.strip() for word in options.versions.split(",") if word.strip()])
        chosen = _between(engine, released, first, last, options.versions is not None)
        unsupported = _unsupported(world, name, chosen, loaded.spec.locate)
        folder = options.store or RUNS / world.name / SWEEP_FOLDER
        problems = [folder_problem(folder, STORE, [loaded.file])]
        if options.store is None:
            problems.append(folder_problem(folder.parent, STUDY, [loaded.file]))
        demand(problems)
        demand_trusted([f"{name}{MARK}{version}" for version in chosen], pythons)
        provide = functools.partial(_provided, engine, pythons, options.yes, tell)
        for end in (chosen[0], chosen[-1]):
            provide(f"{name}{MARK}{end}")  # before anything is written
        if options.store is None:
            open_folder(folder.parent, STUDY)
        opened = Store.open(folder, create=True)
        with opened.writing():
            measure = Versions(world, name, figure, opened, provide, options.deadline, tell)
            tried = [version for version in chosen if version not in unsupported]
            done = search(figure, tried, measure)
        done = replace(done, versions=tuple(chosen), not_measured={**unsupported, **done.not_measured})
        models, command = [], ""
        if done.before is not None and done.after is not None:
            ends = [f"{name}{MARK}{reading.version}" for reading in (done.before, done.after)]
            engines = [word for label in ends for word in ("--engine", label)]
            sets = [word for entry in loaded.sets for word in ("--set", entry)]
            command = shlex.join(["simspec", "explain", options.spec, *engines, *sets])
            if not options.no_verify:  # whether both have the same model
                tell(f"verifying {' and '.join(ends)}: do both hold the model?")
                sides = [Configuration(world, label, provide(label)) for label in ends]
                models = model_lines(prove(sides, options.deadline), True)
    code = EXIT_OK if done.found else EXIT_FAILED
    if options.as_json:
        data = bisect_data(name, done, models, command)
        print_json({"spec": options.spec, **data, "store": folder, "exit_code": code})
    else:
        for line in bisect_lines(name, done, models, command):
            say(line)
    return code


def _only_engine(words: Sequence[str] | None) -> str:
    """The one engine that is named. Raises SpecError for none, several, a version or an interpreter."""
    if not words or len(words) > 1:
        raise SpecError(
            [
                Problem(
                    "bisect takes one engine",
                    found=", ".join(words or ()) or "none",
                    allowed="--engine NAME",
                    code="C102",
                )
            ]
        )
    label = parse(words[0])
    if label.version or label.python is not None:
        message = "the versions are said by --from and --to"
        raise SpecError([Problem(message, found=words[0], allowed=f"--engine {label.name}", code="C102")])
    return label.name


def _demand_order(engine: type[Engine], first: str, last: str) -> None:
    """Raise SpecError unless ``first`` is the older version, EngineError where one is none, or too old."""
    if same_version(first, last):
        raise SpecError(
            [Problem(f"--from and --to are the same version, {first}", allowed="two versions", code="C101")]
        )
    ordered = in_order(engine, [first, last])
    if ordered != [first, last]:
        hint = f"--from {last} --to {first}"
        raise SpecError(
            [Problem("--from is younger than --to", found=f"--from {first} --to {last}", hint=hint, code="C102")]
        )
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
        outside = [name for name in every if _outside(engine, name, first, last)]
        if outside:
            message = "--versions has versions that are not between --from and --to"
            raise SpecError([Problem(message, found=", ".join(outside), allowed=f"{first} to {last}", code="C102")])
        return list(every)
    for end in (first, last):
        if not any(same_version(end, name) for name in every):
            near = ", ".join([*every[:NEAR], *(["…"] if len(every) > NEAR else [])]) or "none"
            message = f"is not a released version that this Python can install; between {first} and {last}: {near}"
            raise EngineError(f"{engine.NAME}{MARK}{end}", message)
    return list(every)


def _outside(engine: type[Engine], name: str, first: str, last: str) -> bool:
    ordered = in_order(engine, [first, name, last])
    return not (same_version(ordered[0], first) and same_version(ordered[-1], last))


def _unsupported(
    world: World, name: str, versions: Sequence[str], locate: Callable[[str], Location | None]
) -> dict[str, str]:
    """Why some of the versions do not support the world. Raises UnsupportedError where one of the two ends does not."""
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
