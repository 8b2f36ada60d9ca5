"""Specs as commands read them: by file, library name or package, with overrides, accepted features and warnings."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from simspec.commands.options import Options, RobotFileOptions, engine_names, interpreters, names_alone
from simspec.commands.scenario_options import CompileOptions, ExportOptions
from simspec.errors import Problem, SpecError, UnsupportedError
from simspec.files import find_spec
from simspec.language.foreign import repaired, repairs_data, suffixes
from simspec.language.load import Spec, load
from simspec.language.packages import ROBOT, is_packaged, is_robot, packaged
from simspec.option_checks import check_at_timestep, deep_contact, pairs_without_effect
from simspec.world.types import World

OF_A_MODEL: Final = "1s"
"""Duration of the run of a model whose file does not give one: robot files have no element for it."""


class LoadedSpec(NamedTuple):
    """A spec, its world, the warnings about it, the overrides with which it was read, and its file."""

    spec: Spec
    world: World
    warnings: list[Problem]
    sets: list[str]
    file: Path


def load_spec(
    options: Options,
    name: str,
    *,
    sets: list[str] | None = None,
    check_effect: bool = True,
    warn: bool = True,
    starts: bool = True,
    duration: str = "",
) -> LoadedSpec:
    """Read and resolve a spec. Warnings are printed on standard error (with ``--json`` the command's answer has them); with
    ``--strict`` they are raised.

    sets          overrides, instead of those of ``--set`` and ``--accept``
    check_effect  whether options of robot files must have an effect on this spec
    starts        whether interpreters of engines may be started for their versions
    duration      of the run of a model whose file does not give one: it is added to the overrides, and reported
    """
    sets = list(accepted_sets(options, name, starts=starts) if sets is None else sets)

    def read() -> Spec:
        how = options.robot_files.options()
        return load(spec_name(name), sets=tuple(sets), allow_outside=options.allow_outside, options=how)

    spec = read()
    if check_effect:
        options.robot_files.check_effect(spec)
    if duration and spec.is_model_without_duration(sets):
        sets.append(f"physics.duration={duration}")
        from simspec.report.screen import say

        say(f"{name} is a model without a duration: --set {sets[-1]}", error=True)
        spec = read()
    world = spec.resolve()
    if problems := check_at_timestep(spec):
        raise SpecError(problems)
    found = (
        [*spec.warnings(world), *pairs_without_effect(spec, world), *deep_contact(spec, world, _named(options))]
        if warn
        else []
    )
    if options.strict and found:
        raise SpecError(found)
    if found and not options.as_json:
        from simspec.report.problems import show_warnings

        show_warnings(found)
    return LoadedSpec(spec, world, found, sets, spec_file(name))


def _named(options: Options) -> list[str] | None:
    """The engines that ``--engine`` names, so that no other one is imported; None without it. Raises EngineError, SpecError."""
    return names_alone(options.engine) if options.engine else None


def accepted_sets(options: Options, name: str, sets: list[str] | None = None, starts: bool = True) -> list[str]:
    """``sets`` (default: those of ``--set``) with the entries of ``accept`` and ``outside`` that ``--accept`` names, for every
    engine that needs them, and every version of one that ``--engine`` names.

    Raises SpecError for a word that is not a feature, and for one that no engine needs.
    """
    sets, words = list(options.sets or ()) if sets is None else sets, options.accept
    if not words:
        return sets
    from simspec.compiler import missing_options
    from simspec.engines.kit.registry import engine_name, engine_version, engines
    from simspec.language.strict import near
    from simspec.report.problems import EVERY
    from simspec.support.features import Feature

    features = {feature.value for feature in Feature}
    if problems := [
        Problem(
            f"--accept {word}: no such feature",
            found=word,
            hint=near(word, [*features, EVERY]) or "simspec accept SPEC",
            code="E108",
        )
        for word in words
        if word not in features and word != EVERY
    ]:
        raise SpecError(problems)
    world = load_spec(options, name, sets=sets, warn=False).world
    entries: list[str] = []
    used = {EVERY}
    labels = [label for label in engine_names(options.chosen) if engine_version(label)]
    pythons = interpreters(options.python, options.engine, starts=starts) if labels else None
    for engine in engines():
        missing: dict[str, dict[str, None]] = {}
        for label in (engine, *(label for label in labels if engine_name(label) == engine)):
            try:
                needed = missing_options(world, label, pythons)
            except UnsupportedError:
                continue  # not supported, whatever is accepted: reported where the engine is chosen
            for key, reasons in needed.items():
                missing.setdefault(key, {}).update(dict.fromkeys(reasons))
        for key, listed in missing.items():
            if accepted := [feature for feature in listed if feature in words or EVERY in words]:
                values = ", ".join([*getattr(world.options(engine), key), *accepted])
                entries.append(f"engines.{engine}.{key}=[{values}]")
                used.update(accepted)
    if unneeded := [word for word in words if word not in used]:
        message = f"--accept {' '.join(unneeded)}: no engine that supports {name} needs this"
        raise SpecError([Problem(message, hint="leave it out", code="C109")])
    return [*sets, *entries]


def load_all(options: CompileOptions | ExportOptions, names: Sequence[str]) -> tuple[list[LoadedSpec], list[Problem]]:
    """The specs that can be read, and the problems of all others. With ``--check`` nothing is warned of: that was done when the
    files were written."""
    loaded: list[LoadedSpec] = []
    problems: list[Problem] = []
    for name in names:
        try:
            warn = not options.check or options.strict
            loaded.append(load_spec(replace(options, engine=None), name, warn=warn, starts=False))
        except SpecError as error:
            problems.extend(error.problems)
    return loaded, problems


def spec_name(name: str) -> str:
    """The name of the file that an argument of the command line means, as :func:`simspec.language.load.load` takes it. The
    argument is a path, a scenario of the library, ``package://NAME/PATH``, ``robot_descriptions://ROBOT``, or the bare name of
    such a robot where no file has it. Raises SpecError."""
    if is_packaged(name):
        return name
    try:
        return str(find_spec(name))
    except SpecError:
        if is_robot(name):
            return f"{ROBOT}{name}"
        raise


def spec_file(name: str) -> Path:
    """The path of that file. Raises SpecError."""
    text = spec_name(name)
    return packaged(text, suffixes()).path if is_packaged(text) else Path(text)


def source_of(name: str, sets: list[str] | None, spec: Spec, robot_files: RobotFileOptions) -> dict[str, Any]:
    """The source of a run's world, for its provenance: the file ``name``, from which ``spec`` was read, the overrides, repairs
    of robot files, and of files of installed packages their versions and digests."""
    path = spec_file(name)
    read: dict[str, Any] = {"robot_files": asdict(robot_files)} if robot_files != RobotFileOptions() else {}
    if repairs := repaired(spec.source.all()):
        read["repairs"] = repairs_data(repairs)
    if packages := spec.packages():
        read["packages"] = packages
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return {"file": path.name, "sha256": digest, "sets": list(sets or ()), **read}
