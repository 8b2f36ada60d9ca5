"""``simspec compile``: compile specs into their folders, or see whether these are current."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec import generated
from simspec.arguments import chosen_engines, engines_for_files, load_spec, spec_file
from simspec.commands.accept import accepted_sets, is_writable
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.generated import GENERATED, Built, Written
from simspec.outputs.marker import COMPILED
from simspec.outputs.targets import check_folder, demand, folder_problem
from simspec.report.plain import text
from simspec.report.refusals import WaysOut, ways_out, with_endings
from simspec.report.screen import console, say
from simspec.robot_files import NO_WORDS, RobotFiles
from simspec.selection import Selection
from simspec.world.canonical import sha256

if TYPE_CHECKING:
    from simspec.language.load import Spec
    from simspec.world.types import World


def compile_specs(
    specs: list[str] | None,
    engine: list[str] | None,
    format_name: str | None,
    out: Path | None,
    *,
    check: bool,
    explain: bool,
    sets: list[str] | None,
    accept: list[str] | None = None,
    allow_outside: bool,
    robot_files: RobotFiles = NO_WORDS,
    strict: bool,
    as_json: bool,
    profile: str | None = None,
) -> int:
    """Compile ``specs``, by default all of the folder ``specs``, for the engines named by ``engine``, or to plain files of the
    format ``format_name``."""
    if format_name is not None and (engine or explain):
        other = "--engine" if engine else "--explain"
        raise SpecError([Problem(f"--format writes plain files for any tool, {other} is about those of engines")])
    names = specs or [str(path) for path in sorted(Path("specs").glob("*.yaml"))]
    if not names:
        raise SpecError([Problem("no SPEC given, and no specs/*.yaml in the working folder")])

    warned: list[Problem] = []

    def load(name: str) -> tuple[Spec, World]:
        # what is only looked at for being current was warned of when it was written
        spec, world, warnings, _ = load_spec(
            name,
            accepted_sets(name, sets, accept, allow_outside, robot_files, starts=False),
            allow_outside,
            robot_files=robot_files,
            strict=strict,
            as_json=as_json,
            warn=not check or strict,
        )
        warned.extend(warnings)
        return spec, world

    if format_name is not None:
        from simspec.commands.plain import write_plain

        return write_plain(
            names, load, format_name, out, check=check, strict=strict, as_json=as_json, warnings=warned, profile=profile
        )
    return compile_all(
        names,
        load,
        engines_for_files(chosen_engines(engine)),
        out,
        check=check,
        explain=explain,
        as_json=as_json,
        warnings=warned,
    )


def compile_all(
    names: Sequence[str],
    load: Callable[[str], tuple[Spec, World]],
    selection: Selection,
    out: Path | None,
    *,
    check: bool,
    explain: bool,
    as_json: bool,
    warnings: Sequence[Problem] = (),
) -> int:
    """Compile specs into their folders, or see whether these are current. The problems of all specs come together."""
    alone = out is not None and len(names) == 1
    if alone and out is not None and not check:
        check_folder(out, COMPILED, [spec_file(names[0])])
    problems: list[Problem] = []
    loaded: list[tuple[Spec, World]] = []
    holds: list[Path] = []
    for name in names:
        try:
            loaded.append(load(name))
            holds.append(spec_file(name))
        except SpecError as error:
            problems.extend(error.problems)
    worlds = [world.name for _, world in loaded]
    twice = sorted({name for name in worlds if worlds.count(name) > 1})
    if twice:
        problems.append(Problem(f"several specs are called {', '.join(twice)}, and would write to one folder"))
    folders = [out if alone and out is not None else (out or GENERATED) / name for name in worlds]
    refused = [] if check else [folder_problem(folder, COMPILED, holds) for folder in folders]
    if any(refused):
        demand([*problems, *refused])
    built, chosen = _built(loaded, selection, problems)
    if check:
        return _check(built, folders, as_json, selection.named)
    written = [generated.write(scenario, folder) for scenario, folder in zip(built, folders, strict=True)]
    if as_json:
        data = [
            {**_compiled_data(scenario, place, explain), "not_compiled": choice.not_taken}
            for scenario, place, choice in zip(built, written, chosen, strict=True)
        ]
        sys.stdout.write(text({"compiled": data, "warnings": warnings}))
        return EXIT_OK
    for scenario, place, choice in zip(built, written, chosen, strict=True):
        say(f"{place.folder}: {'written' if place.changed else 'already current'}, {', '.join(scenario.compiled)}")
        for line in choice.lines():
            say(f"  not for {line}")
        if place.stored is not None and place.stored.reasons:
            what = "proofs dropped from certificate.json" if place.stored.kept else "certificate.json dropped"
            say(f"  {what}: {place.stored.reasons}; simspec verify proves anew")
        if explain:
            from simspec.report.explain import control_table, forces_table, tables

            if scenario.world.controllers:
                console().print(control_table(scenario.world))
            if scenario.world.forces:
                console().print(forces_table(scenario.world))
            for compiled in scenario.compiled.values():
                for shown in tables(scenario.world, compiled):
                    console().print(shown)
    return EXIT_OK


def _built(
    loaded: Sequence[tuple[Spec, World]], selection: Selection, problems: Sequence[Problem]
) -> tuple[list[Built], list[Selection]]:
    """What each spec is compiled to, and for which engines. Raises SpecError with ``problems`` and those of all specs."""
    built: list[Built] = []
    chosen: list[Selection] = []
    ways: dict[str, WaysOut] = {}
    every = list(problems)
    for spec, world in loaded:
        try:
            chosen.append(selection.for_world(world, spec.locate))
            built.append(generated.build(world, chosen[-1], spec.locate))
        except SpecError as error:
            every.extend(error.problems)
            name = spec.source.document.file
            found = ways_out(error.problems, name, selection.engines, world, selection.pythons, is_writable(spec))
            ways |= {name: found} if found is not None else {}
    if ways:
        raise with_endings(every, ways)
    demand(every)
    return built, chosen


def _check(built: Sequence[Built], folders: Sequence[Path], as_json: bool, named: bool) -> int:
    stale = [
        line
        for scenario, folder in zip(built, folders, strict=True)
        for line in generated.check(scenario, folder, named)
    ]
    versions = [line for folder in folders for line in generated.other_versions(folder)]
    if as_json:
        sys.stdout.write(text({"stale": stale, "other_versions": versions}))
        return EXIT_FAILED if stale else EXIT_OK
    for line in versions:
        say(f"other version: {line}", error=True)
    if stale:
        for line in stale:
            say(line, error=True)
    else:
        say(f"{len(built)} compiled specs are current")
    return EXIT_FAILED if stale else EXIT_OK


def _compiled_data(built: Built, written: Written, explain: bool) -> dict[str, Any]:
    from simspec.report.explain import explained

    reasons = {name: explained(built.world, compiled) for name, compiled in built.compiled.items()} if explain else {}
    driving: dict[str, Any] = {"controllers": built.world.controllers} if explain else {}
    if explain and built.world.forces:
        driving["forces"] = built.world.forces
    return {
        "folder": written.folder,
        "changed": written.changed,
        "certificate": None if written.stored is None else written.stored.data(),
        "world_sha256": sha256(built.world),
        "engines": {
            name: {
                "format": compiled.format,
                "sha256": compiled.sha256,
                "files": sorted(compiled.files),
                "decisions": compiled.decisions,
            }
            | ({"explained": reasons[name]} if explain else {})
            for name, compiled in built.compiled.items()
        },
        **driving,
    }
