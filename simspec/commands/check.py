"""``simspec check``: load and resolve specs, and see whether engines support them; nothing is written. ``simspec accept``:
write the entries into a spec that let engines have it. ``check`` loads no compiler unless it names engines."""

from __future__ import annotations

import dataclasses
import io
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec.commands.loading import LoadedSpec, load_spec
from simspec.commands.options import demand_trusted, engine_names, engines_at_work, names_alone, print_json
from simspec.commands.scenario_options import AcceptOptions, CheckOptions, ListOptions
from simspec.engines.kit.registry import engine_name
from simspec.errors import EXIT_OK, EngineRefusal, Problem, SpecError, UnsupportedError
from simspec.files import library, resource_folder
from simspec.language.document import read_text
from simspec.language.foreign import repaired, repairs_data
from simspec.language.load import Spec
from simspec.option_checks import check_options
from simspec.outputs.writing import write_file
from simspec.plausibility.findings import Plausibility
from simspec.report.problems import as_problems, plausibility_data, plausibility_lines
from simspec.report.screen import console, say
from simspec.world.canonical import sha256
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.report.problems import WaysOut
    from simspec.selection import NotTaken, Selection


def check(options: CheckOptions) -> int:
    """Check specs, and compile them for the chosen engines. Implausible values of a model are printed after its verdict, with
    ``--verbose`` in full. Raises SpecError with the problems of all specs, with ``--strict`` also with likely mistakes of the
    model. Features that engines reject are one line each, unless ``--verbose``, with the ways out at the end."""
    from simspec.plausibility.examine import examine

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


# --- accept -----------------------------------------------------------------------------------------------------------------


def accept(options: AcceptOptions) -> int:
    """Write the entries that the engines of ``--engine`` (without: the project's, or those installed) need into the file."""
    from simspec.selection import named

    loaded = load_spec(options, options.spec, warn=False)
    words, pythons = options.chosen, options.interpreters()
    demand_trusted(engine_names(words), pythons)
    # by label: accepted features may depend on the version
    selection = named(engine_names(words), pythons) if words else engines_at_work(None, pythons)
    return accept_world(loaded.spec, loaded.world, selection, options.as_json)


def accept_world(spec: Spec, world: World, selection: Selection, as_json: bool) -> int:
    """Write the entries that engines need into the spec's file; existing entries stay. Unnamed engines that do not support
    the world at all are listed. Raises SpecError for scenarios of the library and for files that cannot be written,
    UnsupportedError with every feature that a named engine, or every engine, does not support at all."""
    from simspec.compiler import missing_options
    from simspec.report.matrix import link
    from simspec.selection import refusal

    path = _writable_file(spec)
    wanted: dict[str, dict[str, dict[str, str]]] = {}
    not_taken: dict[str, NotTaken] = {}
    for name in selection.engines:
        try:
            for key, features in missing_options(world, name, selection.pythons).items():
                wanted.setdefault(engine_name(name), {}).setdefault(key, {}).update(features)
        except UnsupportedError as error:
            located = [dataclasses.replace(problem, location=spec.locate(problem.path)) for problem in error.problems]
            not_taken[name] = refusal(located)
    if not_taken and (selection.named or not wanted):
        raise UnsupportedError([problem for refused in not_taken.values() for problem in refused.problems])
    wanted = {name: keys for name, keys in wanted.items() if keys}
    if wanted:
        before = read_text(path)
        after = edited(before, wanted)
        write_file(path, after, ours=lambda found: found == before.encode())
    if as_json:
        print_json({"file": path, "written": bool(wanted), "added": wanted, "not_taken": not_taken})
        return EXIT_OK
    for name, refused in not_taken.items():
        say(f"not for {name}: {refused}")
    for name, keys in wanted.items():
        for key, features in keys.items():
            for feature, why in features.items():
                say(f"engines.{name}.{key}: {feature}  # {why}")
                say(f"    {link(name, feature)}")
    say(f"{path}: {'written' if wanted else 'no entries missing'}")
    return EXIT_OK


def is_writable(spec: Spec) -> bool:
    """Whether entries can be written into the file of a spec."""
    try:
        _writable_file(spec)
    except SpecError:
        return False
    return True


def _writable_file(spec: Spec) -> Path:
    """The file of a spec that is the user's own."""
    path = spec.path
    if path is None:
        raise SpecError([Problem("a spec made in Python has no file to write", code="C105")])
    if spec.source.imported is not None:
        hint = f"simspec import {path} -o {path.stem}.yaml; then simspec accept {path.stem}.yaml"
        raise SpecError([Problem(f"{path} is no spec, and is not changed", hint=hint, code="C105")])
    if spec.source.package is not None:
        message = f"{path.name} belongs to {spec.source.package.name} and is not changed"
        raise SpecError([Problem(message, hint="use it in a spec of your own", code="C105")])
    if path.resolve().is_relative_to(resource_folder("specs").resolve()):
        hint = "copy it to a file of your own"
        raise SpecError([Problem(f"{path} belongs to simspec's library and is not changed", hint=hint, code="C105")])
    return path


def edited(before: str, wanted: Mapping[str, Mapping[str, Mapping[str, str]]]) -> str:
    """The text of a spec with features added under ``engines``; all else stays byte for byte. Raises SpecError where the file
    is not in YAML block style (JSON)."""
    from ruamel.yaml import YAML
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    lines = before.splitlines(keepends=True)
    first, last = _block(lines)
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 1_000_000
    yaml.indent(mapping=2, sequence=4, offset=2)
    actual: Any = (yaml.load("".join(lines[first:last])) or {}).get("engines")
    engines = actual if isinstance(actual, CommentedMap) else CommentedMap()
    engines.fa.set_block_style()
    for name, keys in wanted.items():
        engine = engines.get(name)
        options = engine if isinstance(engine, CommentedMap) else CommentedMap()
        options.fa.set_block_style()
        for key, features in keys.items():
            listed = options.get(key)
            if not isinstance(listed, CommentedSeq):
                listed = CommentedSeq()
            listed.fa.set_block_style()
            for feature, why in features.items():
                listed.append(feature)
                listed.yaml_add_eol_comment(why, len(listed) - 1)
            options[key] = listed
        engines[name] = options
    out = io.StringIO()
    yaml.dump(CommentedMap({"engines": engines}), out)
    found = "".join([*lines[:first], out.getvalue(), *lines[last:]])
    if any(feature not in found for keys in wanted.values() for features in keys.values() for feature in features):
        raise AssertionError("a feature was not written")
    return found


def _block(lines: list[str]) -> tuple[int, int]:
    """The lines of the file's `engines`, or the empty place at its end for one."""
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    keys = [k for k, line in enumerate(lines) if _TOP.match(line)]
    if not any(lines[k].startswith("simspec:") for k in keys):
        hint = "add the entries by hand, or run simspec fmt first"
        raise SpecError(
            [Problem("this file is not in YAML block style: its keys do not begin lines", hint=hint, code="C105")]
        )
    start = next((k for k in keys if _ENGINES.match(lines[k])), None)
    if start is None:
        return len(lines), len(lines)
    end = next((k for k in keys if k > start), len(lines))
    while end > start + 1 and (not lines[end - 1].strip() or lines[end - 1].startswith("#")):
        end -= 1  # blank lines and comments before the next key are its own
    return start, end


_TOP = re.compile(r"[\w\"']+\s*:")


_ENGINES = re.compile(r"[\"']?engines[\"']?\s*:")


# --- simspec list -----------------------------------------------------------------------------------------------------------


def list_scenarios(options: ListOptions) -> int:
    """Print the scenarios of the library: name, description, and the engines that support each; each as soon as it is known."""
    from simspec.compiler import needed_decisions
    from simspec.engines.kit.registry import engines
    from simspec.language.load import load

    found: dict[str, dict[str, Any]] = {}
    names = [name for name, engine in engines().items() if not engine.FILES_ALONE]
    screen = console()
    for scenario, path in library().items():
        spec = load(str(path))
        said = spec.data.description or ""
        found[scenario] = {"file": path, "description": said, "engines": [], "refused": {}, "not_read": ""}
        if not options.as_json:
            screen.note(f"{scenario}: {said}" if said else scenario)
        try:
            world = spec.resolve()
        except SpecError as error:
            problem = error.problems[0]
            found[scenario]["not_read"] = "; ".join(filter(None, (problem.message, problem.hint)))
            if not options.as_json:
                screen.note(f"  {found[scenario]['not_read']}", "yellow")
            continue
        refused: dict[str, list[str]] = {}
        for name in names:
            try:
                needed_decisions(world, name)
            except UnsupportedError as error:
                features = [problem.feature for problem in error.problems if isinstance(problem, EngineRefusal)]
                refused[name] = list(dict.fromkeys(filter(None, features)))
        supported = [name for name in names if name not in refused]
        found[scenario] |= {"engines": supported, "refused": refused}
        if not options.as_json:
            screen.note(f"  {', '.join(supported)}", "dim")
    if options.as_json:
        print_json(found)
    return EXIT_OK
