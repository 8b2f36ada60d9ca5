"""Commands that write files, or see whether they are current: fmt, schema, compile; each function returns the exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from simspec import generated
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.generated import GENERATED, Built, Written, write_text
from simspec.report.plain import text
from simspec.world.canonical import sha256


def one_file(path: Path, wanted: str, check: bool, as_json: bool, how: str) -> int:
    """Write one generated file, or see whether it is current. ``how`` is the command that writes it."""
    current = path.is_file() and path.read_bytes() == wanted.encode()
    if not check and not current:
        write_text(wanted, path)
    if as_json:
        sys.stdout.write(text({"file": path, "current": current, "written": not check and not current}))
    elif check and not current:
        print(f"{path} is stale; {how} writes it", file=sys.stderr)
    elif not check:
        print(f"{path}: {'already current' if current else 'written'}")
    return EXIT_FAILED if check and not current else EXIT_OK


def format_files(files: Sequence[Path], check: bool, as_json: bool) -> int:
    """Lay out every file, or say which would change; nothing is written when one of them is no spec."""
    from simspec.spec.document import decode
    from simspec.spec.formatting import format_text

    problems: list[Problem] = []
    results: list[tuple[Path, bool, str]] = []
    for path in files:
        try:
            after = format_text(decode(path.read_bytes(), str(path)), str(path))
        except SpecError as error:
            problems.extend(error.problems)
            continue
        results.append((path, path.read_bytes() == after.encode(), after))
    if problems:
        raise SpecError(problems)
    changed = [path for path, same, _ in results if not same]
    if not check:
        for path, same, after in results:
            if not same:
                write_text(after, path)
    if as_json:
        sys.stdout.write(text({"changed": changed, "written": not check}))
    else:
        for path in changed:
            print(f"{path}: {'would change; simspec fmt writes it' if check else 'written'}")
    return EXIT_FAILED if check and changed else EXIT_OK


def compile_specs(
    names: Sequence[str],
    build: Callable[[str], Built],
    out: Path | None,
    *,
    check: bool,
    explain: bool,
    as_json: bool,
) -> int:
    """Compile specs into their folders, or see whether these are current. The problems of all specs come together."""
    built: list[Built] = []
    problems: list[Problem] = []
    for name in names:
        try:
            built.append(build(name))
        except SpecError as error:
            problems.extend(error.problems)
    worlds = [one.world.name for one in built]
    twice = sorted({name for name in worlds if worlds.count(name) > 1})
    if twice:
        problems.append(Problem(f"several specs are called {', '.join(twice)}, and would share one folder"))
    if problems:
        raise SpecError(problems)
    alone = out is not None and len(built) == 1
    folders = [out if alone and out is not None else (out or GENERATED) / name for name in worlds]
    if check:
        return _check(built, folders, as_json)
    written = [generated.write(one, folder) for one, folder in zip(built, folders, strict=True)]
    if as_json:
        data = [_compiled_data(one, place, explain) for one, place in zip(built, written, strict=True)]
        sys.stdout.write(text({"compiled": data}))
        return EXIT_OK
    for one, place in zip(built, written, strict=True):
        print(f"{place.folder}: {'written' if place.changed else 'already current'}, {', '.join(one.compiled)}")
        if place.dropped:
            print(f"  certificate.json dropped: {place.dropped}; simspec verify writes a new one")
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
        print("\n".join(stale), file=sys.stderr)
    else:
        print(f"{len(built)} compiled specs are current")
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
