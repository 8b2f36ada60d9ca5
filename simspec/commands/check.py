"""``simspec check``: load and resolve specs, and see whether engines support them; nothing is written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from simspec.arguments import chosen_engines, load_spec, names_alone, print_json
from simspec.compiler import check_options, compile_world
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.plausibility.examine import examine
from simspec.plausibility.findings import Plausibility
from simspec.report.plausibility import as_problems, plausibility_data, plausibility_lines
from simspec.report.screen import say
from simspec.robot_files import NO_WORDS, RobotFiles
from simspec.world.canonical import sha256


class Row(NamedTuple):
    """What is known of one spec that is in order."""

    spec: str
    name: str
    bodies: int
    world_sha256: str
    warnings: list[Problem]
    plausibility: Plausibility


def check(
    specs: Sequence[str],
    engine: list[str] | None,
    sets: list[str] | None,
    allow_outside: bool,
    strict: bool,
    as_json: bool,
    robot_files: RobotFiles = NO_WORDS,
    verbose: bool = False,
) -> int:
    """Check ``specs``; with ``engine``, or default engines of the project, compile them for these too. What is implausible
    about a model is printed after its verdict, with ``verbose`` whole. Raises SpecError with the problems of all specs, with
    ``strict`` also with what is most likely a mistake of the model."""
    engine = chosen_engines(engine)
    problems: list[Problem] = []
    rows: list[Row] = []
    for name in specs:
        try:
            spec, world, warnings, _ = load_spec(
                name, sets, allow_outside, robot_files=robot_files, strict=strict, as_json=as_json
            )
            if engine:
                compile_world(world, names_alone(engine), spec.locate)
            else:
                problems.extend(check_options(world, spec.locate))
        except SpecError as error:
            problems.extend(error.problems)
            continue
        found = examine(spec, world)
        if strict:
            problems.extend(as_problems(found.warnings))
        rows.append(Row(name, world.name, len(world.bodies), sha256(world), warnings, found))
    if problems:
        raise SpecError(problems)
    if as_json:
        print_json({"specs": [{**row._asdict(), "plausibility": plausibility_data(row.plausibility)} for row in rows]})
    else:
        for row in rows:
            count = len(row.warnings)
            warned = f", {count} warning{'s' if count > 1 else ''}" if count else ""
            say(f"{row.spec}: ok, {row.bodies} bodies, world {row.world_sha256[:12]}{warned}")
            for line in plausibility_lines(row.plausibility, verbose, warned=True):
                say(line)
    return EXIT_OK
