"""``simspec check``: load and resolve specs, and see whether engines support them; nothing is written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from simspec.arguments import chosen_engines, load_spec, names_alone, print_json
from simspec.commands.accept import accepted_sets, is_writable
from simspec.compiler import check_options, compile_world
from simspec.errors import EXIT_OK, Problem, SpecError, UnsupportedError
from simspec.language.foreign import Repair
from simspec.language.losses import repaired, repairs_data
from simspec.plausibility.examine import examine
from simspec.plausibility.findings import Plausibility
from simspec.report.imported import repairs_table
from simspec.report.plausibility import as_problems, plausibility_data, plausibility_lines
from simspec.report.refusals import WaysOut, brief, ways_out, with_endings
from simspec.report.screen import console, say
from simspec.robot_files import NO_WORDS, RobotFiles
from simspec.world.canonical import sha256


class Row(NamedTuple):
    """What is known of one spec that is in order."""

    spec: str
    name: str
    bodies: int
    world_sha256: str
    warnings: list[Problem]
    repairs: list[Repair]
    plausibility: Plausibility


def check(
    specs: Sequence[str],
    engine: list[str] | None,
    sets: list[str] | None,
    allow_outside: bool,
    strict: bool,
    as_json: bool,
    robot_files: RobotFiles = NO_WORDS,
    accept: list[str] | None = None,
    verbose: bool = False,
) -> int:
    """Check ``specs``; with ``engine``, or default engines of the project, compile them for these too. What is implausible
    about a model is printed after its verdict, with ``verbose`` whole. Raises SpecError with the problems of all specs, with
    ``strict`` also with what is most likely a mistake of the model. What engines refuse is one line for each feature, unless
    ``verbose``, with the ways out at the end."""
    engine = chosen_engines(engine)
    names = names_alone(engine)
    problems: list[Problem] = []
    rows: list[Row] = []
    short: list[str] = []
    ways: dict[str, WaysOut] = {}
    for name in specs:
        try:
            spec, world, warnings, _ = load_spec(
                name,
                accepted_sets(name, sets, accept, allow_outside, robot_files, engine),
                allow_outside,
                robot_files=robot_files,
                strict=strict,
                as_json=as_json,
            )
        except SpecError as error:
            problems.extend(error.problems)
            continue
        try:
            if engine:
                compile_world(world, names, spec.locate)
            else:
                problems.extend(check_options(world, spec.locate))
        except UnsupportedError as error:
            problems.extend(error.problems)
            short += brief(error.problems)
            ways_here = ways_out(error.problems, name, names, world, writable=is_writable(spec))
            if ways_here is not None:
                ways[name] = ways_here
            continue
        found = examine(spec, world)
        if strict:
            problems.extend(as_problems(found.warnings))
        repairs = repaired(spec.source.all())
        rows.append(Row(name, world.name, len(world.bodies), sha256(world), warnings, repairs, found))
    if problems:
        if not ways:
            raise SpecError(problems)
        raise with_endings(problems, ways, () if verbose else (*short, "-v prints each in full"))
    if as_json:
        more = [
            {"repairs": repairs_data(row.repairs), "plausibility": plausibility_data(row.plausibility)} for row in rows
        ]
        print_json({"specs": [{**row._asdict(), **said} for row, said in zip(rows, more, strict=True)]})
    else:
        for row in rows:
            count = len(row.warnings)
            warned = f", {count} warning{'s' if count > 1 else ''}" if count else ""
            say(f"{row.spec}: ok, {row.bodies} bodies, world {row.world_sha256[:12]}{warned}")
            if row.repairs:
                console().print(repairs_table(row.repairs))
            for line in plausibility_lines(row.plausibility, verbose, warned=True):
                say(line)
    return EXIT_OK
