"""Commands that write files, or see whether they are current: fmt, schema, compile; each function returns the exit code."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec import generated
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.generated import GENERATED, Built, Written
from simspec.outputs.marker import COMPILED
from simspec.outputs.reading import read_bytes
from simspec.outputs.targets import LARGEST_OWN, check_file, check_folder, demand, folder_problem
from simspec.outputs.writing import write_file
from simspec.report.plain import text
from simspec.report.screen import say
from simspec.resources import find_spec
from simspec.world.canonical import sha256

if TYPE_CHECKING:
    from simspec.language.load import Spec
    from simspec.world.types import World


def one_file(path: Path, wanted: str, ours: Callable[[bytes], bool], check: bool, as_json: bool, how: str) -> int:
    """Write one generated file, or see whether it is current. ``how`` is the command that writes it; ``ours`` says of what is
    there whether that command wrote it: anything else is not replaced."""
    if not check:
        check_file(path, ours)
    try:
        current = read_bytes(path, LARGEST_OWN) == wanted.encode()
    except (FileNotFoundError, NotADirectoryError):
        current = False
    if not check and not current:
        write_file(path, wanted, ours)
    if as_json:
        sys.stdout.write(text({"file": path, "current": current, "written": not check and not current}))
    elif check and not current:
        say(f"{path} is stale; {how} writes it", error=True)
    elif not check:
        say(f"{path}: {'already current' if current else 'written'}")
    return EXIT_FAILED if check and not current else EXIT_OK


def schema_file(of: str, out: Path | None, check: bool, as_json: bool) -> int:
    """Write the JSON Schema called ``of`` to ``out`` (default: below ``schema/``; ``-``: standard output)."""
    from simspec.engines.kit import published
    from simspec.language import schema

    language = of == "language"
    wanted = schema.schema_text() if language else published.schema_text(of)
    if out is not None and str(out) == "-":
        sys.stdout.write(wanted)
        return EXIT_OK
    path = out if out is not None else Path("schema") / f"{'simspec' if language else of}.schema.json"
    ours = schema.is_schema if language else functools.partial(published.is_schema, of)
    return one_file(path, wanted, ours, check, as_json, "simspec schema" + ("" if language else f" --of {of}"))


def format_files(files: Sequence[Path], check: bool, as_json: bool) -> int:
    """Lay out every file, or say which would change; nothing is written when one of them is no spec."""
    from simspec.language.document import LARGEST_FILE, decode
    from simspec.language.formatting import format_text

    problems: list[Problem] = []
    results: list[tuple[Path, bytes, str]] = []
    for path in files:
        try:
            before = read_bytes(path, LARGEST_FILE)
            after = format_text(decode(before, str(path)), str(path))
            if not check and before != after.encode():
                check_file(path, before.__eq__)
        except FileNotFoundError:
            problems.append(Problem(f"{path}: no such file"))
        except SpecError as error:
            problems.extend(error.problems)
        else:
            results.append((path, before, after))
    if problems:
        raise SpecError(problems)
    changed = [path for path, before, after in results if before != after.encode()]
    if not check:
        for path, before, after in results:
            if before != after.encode():
                write_file(path, after, before.__eq__)  # only over the very text that was laid out
    if as_json:
        sys.stdout.write(text({"changed": changed, "written": not check}))
    else:
        for path in changed:
            say(f"{path}: {'would change; simspec fmt writes it' if check else 'written'}")
    return EXIT_FAILED if check and changed else EXIT_OK


def compile_specs(
    names: Sequence[str],
    load: Callable[[str], tuple[Spec, World]],
    engines: list[str],
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
        check_folder(out, COMPILED, [find_spec(names[0])])
    problems: list[Problem] = []
    loaded: list[tuple[Spec, World]] = []
    holds: list[Path] = []
    for name in names:
        try:
            loaded.append(load(name))
            holds.append(find_spec(name))
        except SpecError as error:
            problems.extend(error.problems)
    worlds = [world.name for _, world in loaded]
    twice = sorted({name for name in worlds if worlds.count(name) > 1})
    if twice:
        problems.append(Problem(f"several specs are called {', '.join(twice)}, and would share one folder"))
    folders = [out if alone and out is not None else (out or GENERATED) / name for name in worlds]
    refused = [] if check else [folder_problem(folder, COMPILED, holds) for folder in folders]
    if any(refused):
        demand([*problems, *refused])
    built: list[Built] = []
    for spec, world in loaded:
        try:
            built.append(generated.build(world, engines, spec.locate))
        except SpecError as error:
            problems.extend(error.problems)
    demand(problems)
    if check:
        return _check(built, folders, as_json)
    written = [generated.write(one, folder) for one, folder in zip(built, folders, strict=True)]
    if as_json:
        data = [_compiled_data(one, place, explain) for one, place in zip(built, written, strict=True)]
        sys.stdout.write(text({"compiled": data, "warnings": warnings}))
        return EXIT_OK
    for one, place in zip(built, written, strict=True):
        say(f"{place.folder}: {'written' if place.changed else 'already current'}, {', '.join(one.compiled)}")
        if place.dropped:
            say(f"  certificate.json dropped: {place.dropped}; simspec verify writes a new one")
        if explain:
            from simspec.report.explain import control_table, tables
            from simspec.report.terminal import console

            if one.world.controllers:
                console().print(control_table(one.world))
            for compiled in one.compiled.values():
                for found in tables(one.world, compiled):
                    console().print(found)
    return EXIT_OK


def _check(built: Sequence[Built], folders: Sequence[Path], as_json: bool) -> int:
    stale = [line for one, folder in zip(built, folders, strict=True) for line in generated.check(one, folder)]
    if as_json:
        sys.stdout.write(text({"stale": stale}))
    elif stale:
        for line in stale:
            say(line, error=True)
    else:
        say(f"{len(built)} compiled specs are current")
    return EXIT_FAILED if stale else EXIT_OK


def _compiled_data(built: Built, written: Written, explain: bool) -> dict[str, Any]:
    from simspec.report.explain import explained

    reasons = {name: explained(built.world, one) for name, one in built.compiled.items()} if explain else {}
    controllers = {"controllers": built.world.controllers} if explain else {}
    return {
        "folder": written.folder,
        "changed": written.changed,
        "certificate_dropped": written.dropped,
        "world_sha256": sha256(built.world),
        "engines": {
            name: {"format": one.format, "sha256": one.sha256, "files": sorted(one.files), "decisions": one.decisions}
            | ({"explained": reasons[name]} if explain else {})
            for name, one in built.compiled.items()
        },
        **controllers,
    }
