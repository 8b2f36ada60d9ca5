"""``simspec check``: load and resolve specs, and see whether engines support them; nothing is written."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from simspec.commands.loading import LoadedSpec, load_spec
from simspec.commands.options import names_alone, print_json
from simspec.commands.scenario_options import CheckOptions
from simspec.errors import EXIT_OK, Problem, SpecError, UnsupportedError
from simspec.language.foreign import repaired, repairs_data
from simspec.option_checks import check_options
from simspec.plausibility.examine import examine
from simspec.plausibility.findings import Plausibility
from simspec.report.problems import as_problems, plausibility_data, plausibility_lines
from simspec.report.screen import console, say
from simspec.world.canonical import sha256

if TYPE_CHECKING:
    from simspec.report.problems import WaysOut


def check(options: CheckOptions) -> int:
    """Check specs, and compile them for the chosen engines. Implausible values of a model are printed after its verdict, with
    ``--verbose`` in full. Raises SpecError with the problems of all specs, with ``--strict`` also with likely mistakes of the
    model. Features that engines reject are one line each, unless ``--verbose``, with the ways out at the end."""
    options = replace(options, engine=options.chosen)
    names = names_alone(options.chosen)
    problems: list[Problem] = []
    rows: list[tuple[str, LoadedSpec, Plausibility]] = []
    short: list[str] = []
    ways: dict[str, WaysOut] = {}
    for name in options.specs:
        try:
            loaded = load_spec(options, name)
        except SpecError as error:
            problems.extend(error.problems)
            continue
        spec, world = loaded.spec, loaded.world
        try:
            if names:
                from simspec.compiler import compile_world

                compile_world(world, names, spec.locate)
            else:
                problems.extend(check_options(world, spec.locate))
        except UnsupportedError as error:
            from simspec.commands.accept import is_writable
            from simspec.report.problems import brief, ways_out

            problems.extend(error.problems)
            short += brief(error.problems)
            ways_here = ways_out(error.problems, name, names, world, writable=is_writable(spec))
            if ways_here is not None:
                ways[name] = ways_here
            continue
        rows.append((name, loaded, examine(spec, world)))
        if options.strict:
            problems.extend(as_problems(rows[-1][2].warnings))
    if problems:
        if not ways:
            raise SpecError(problems)
        from simspec.report.problems import with_endings

        raise with_endings(problems, ways, () if options.verbose else (*short, "-v prints each in full"))
    if options.as_json:
        print_json({"specs": [_checked(*row) for row in rows]})
        return EXIT_OK
    for name, loaded, plausibility in rows:
        world, count = loaded.world, len(loaded.warnings)
        warned = f", {count} warning{'s' if count > 1 else ''}" if count else ""
        say(f"{name}: ok, {len(world.bodies)} bodies, world {sha256(world)[:12]}{warned}")
        if repairs := repaired(loaded.spec.source.all()):
            from simspec.report.problems import repairs_table

            console().print(repairs_table(repairs))
        for line in plausibility_lines(plausibility, options.verbose, warned=True):
            say(line)
    return EXIT_OK


def _checked(name: str, loaded: LoadedSpec, plausibility: Plausibility) -> dict[str, Any]:
    world = loaded.world
    return {
        "spec": name,
        "name": world.name,
        "bodies": len(world.bodies),
        "world_sha256": sha256(world),
        "warnings": loaded.warnings,
        "repairs": repairs_data(repaired(loaded.spec.source.all())),
        "plausibility": plausibility_data(plausibility),
    }
