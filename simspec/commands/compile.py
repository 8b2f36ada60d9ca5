"""``simspec compile``: compile specs into their folders, or see whether these are current."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec import generated, selection
from simspec.commands.loading import LoadedSpec, load_all, spec_file
from simspec.commands.options import names_alone, print_json
from simspec.commands.scenario_options import CompileOptions, ExportOptions
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.generated import GENERATED, CompiledSpec, Written
from simspec.outputs.targets import COMPILED, check_folder, demand, folder_problem
from simspec.report.screen import console, say
from simspec.selection import Selection
from simspec.world.canonical import sha256

if TYPE_CHECKING:
    from simspec.report.problems import WaysOut


def compile_specs(options: CompileOptions) -> int:
    """Compile specs, by default all of the folder ``specs``, for engines, or to plain files of a format."""
    if options.format_name is not None and (options.engine or options.explain):
        other = "--engine" if options.engine else "--explain"
        raise SpecError([Problem(f"--format writes plain files for any tool, {other} is about those of engines")])
    names = options.specs or [str(path) for path in sorted(Path("specs").glob("*.yaml"))]
    if not names:
        raise SpecError([Problem("no SPEC given, and no specs/*.yaml in the working folder")])
    if options.format_name is not None:
        shared = {name: getattr(options, name) for name in ExportOptions.TAKES if name not in ("specs", "profile")}
        from simspec.commands.export import export

        return export(ExportOptions(specs=names, accept=options.accept, **shared))
    return _compile(options, names)


def _compile(options: CompileOptions, names: Sequence[str]) -> int:
    """Compile specs into their folders, or see whether these are current. The problems of all specs come together."""
    engines = selection.named(names_alone(options.chosen)) if options.chosen else selection.known()
    out, alone = options.out, options.out is not None and len(names) == 1
    if alone and out is not None and not options.check:
        check_folder(out, COMPILED, [spec_file(names[0])])
    loaded, problems = load_all(options, names)
    worlds = [entry.world.name for entry in loaded]
    twice = sorted({name for name in worlds if worlds.count(name) > 1})
    if twice:
        problems.append(Problem(f"several specs are called {', '.join(twice)}, and would write to one folder"))
    folders = [out if alone and out is not None else (out or GENERATED) / name for name in worlds]
    sources = [entry.file for entry in loaded]
    refused = [] if options.check else [folder_problem(folder, COMPILED, sources) for folder in folders]
    if any(refused):
        demand([*problems, *refused])
    built, chosen = _built(loaded, engines, problems)
    if options.check:
        return _check(built, folders, options.as_json, engines.named)
    written = [generated.write(scenario, folder) for scenario, folder in zip(built, folders, strict=True)]
    results = list(zip(built, written, chosen, strict=True))
    if options.as_json:
        data = [
            {**_data(built, place, options.explain), "not_compiled": local.not_taken} for built, place, local in results
        ]
        print_json({"compiled": data, "warnings": [problem for entry in loaded for problem in entry.warnings]})
        return EXIT_OK
    for scenario, place, local in results:
        say(f"{place.folder}: {'written' if place.changed else 'already current'}, {', '.join(scenario.compiled)}")
        for line in local.lines():
            say(f"  not for {line}")
        if place.stored is not None and place.stored.reasons:
            dropped = "proofs dropped from certificate.json" if place.stored.kept else "certificate.json dropped"
            say(f"  {dropped}: {place.stored.reasons}; simspec verify proves anew")
        if options.explain:
            _explain(scenario)
    return EXIT_OK


def _built(
    loaded: Sequence[LoadedSpec], engines: Selection, problems: Sequence[Problem]
) -> tuple[list[CompiledSpec], list[Selection]]:
    """The compiled specs, and the engines of each. Raises SpecError with ``problems`` and those of all specs."""
    built: list[CompiledSpec] = []
    chosen: list[Selection] = []
    ways: dict[str, WaysOut] = {}
    every = list(problems)
    for spec, world, *_ in loaded:
        try:
            chosen.append(engines.for_world(world, spec.locate))
            built.append(generated.build(world, chosen[-1], spec.locate))
        except SpecError as error:
            from simspec.commands.accept import is_writable
            from simspec.report.problems import ways_out

            every.extend(error.problems)
            name = spec.source.document.file
            found = ways_out(error.problems, name, engines.engines, world, engines.pythons, is_writable(spec))
            ways |= {name: found} if found is not None else {}
    if ways:
        from simspec.report.problems import with_endings

        raise with_endings(every, ways)
    demand(every)
    return built, chosen


def _explain(built: CompiledSpec) -> None:
    """Print how engines realise a scenario."""
    from simspec.report.explain import control_table, forces_table, tables

    if built.world.controllers:
        console().print(control_table(built.world))
    if built.world.forces:
        console().print(forces_table(built.world))
    for compiled in built.compiled.values():
        for table in tables(built.world, compiled):
            console().print(table)


def _check(built: Sequence[CompiledSpec], folders: Sequence[Path], as_json: bool, named: bool) -> int:
    stale = [
        line
        for scenario, folder in zip(built, folders, strict=True)
        for line in generated.check(scenario, folder, named)
    ]
    versions = [line for folder in folders for line in generated.other_versions(folder)]
    if as_json:
        print_json({"stale": stale, "other_versions": versions})
        return EXIT_FAILED if stale else EXIT_OK
    for line in [*(f"other version: {line}" for line in versions), *stale]:
        say(line, error=True)
    if not stale:
        say(f"{len(built)} compiled specs are current")
    return EXIT_FAILED if stale else EXIT_OK


def _data(built: CompiledSpec, written: Written, explain: bool) -> dict[str, Any]:
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
