"""``simspec trust``: say that the programs and folders which a project file names may be used, or that they may not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from simspec.arguments import print_json
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.outputs import trust as trusted
from simspec.outputs.reading import read_bytes
from simspec.project import LARGEST, PROJECT_FILE, Project, find_project, parse_project
from simspec.report.kit import table
from simspec.report.screen import console, say

NOTHING = "names no interpreters and no folders: it needs no trust"


def trust(file: Path | None, listed: bool, revoked: bool, as_json: bool) -> int:
    """Trust a project file (default: the one in force here) with its content of this moment; with ``revoked``, no longer; with
    ``listed``, print the files that are trusted."""
    if listed and (revoked or file is not None):
        raise SpecError([Problem("--list excludes FILE and --revoke")])
    if listed:
        return _list(as_json)
    place = _place(file)
    return _revoke(place, as_json) if revoked else _trust(place, as_json)


def _place(file: Path | None) -> Path:
    """The project file that is meant. Raises SpecError where there is none."""
    if file is None:
        found = find_project(Path.cwd())
        if found is None:
            raise SpecError([Problem(f"there is no {PROJECT_FILE} here or above", hint="simspec trust FILE")])
        return found
    place = file / PROJECT_FILE if file.is_dir() else file
    if place.name != PROJECT_FILE:
        raise SpecError(
            [Problem(f"{file}: not a project file", allowed=f"a file called {PROJECT_FILE}, or its folder")]
        )
    return place.absolute()


def _trust(place: Path, as_json: bool) -> int:
    try:
        content = read_bytes(place, LARGEST)
    except FileNotFoundError:
        raise SpecError([Problem(f"{place}: no such file")]) from None
    project = parse_project(place, content)
    named = list(_named(project))
    if named:
        trusted.trust(place, content)
    if as_json:
        rows = [{"key": key, "value": value} for key, value in named]
        print_json({"file": place, "trusted": bool(named), "names": rows, "exit_code": EXIT_OK})
        return EXIT_OK
    for key, value in named:
        say(f"  {key}: {value}")
    say(f"{place}: {'trusted until it changes' if named else NOTHING}")
    return EXIT_OK


def _named(project: Project) -> Iterator[tuple[str, str]]:
    """What a project file names that is started or read, by key."""
    for label, python in project.interpreters.items():
        yield f"engines.{label}.python", python
    for key, folders in (("package-paths", project.package_paths), ("allowed-folders", project.allowed_folders)):
        for folder in folders:
            yield key, str(folder)


def _revoke(place: Path, as_json: bool) -> int:
    count = trusted.revoke(place)
    if as_json:
        print_json({"file": place, "trusted": False, "revoked": count, "exit_code": EXIT_OK})
        return EXIT_OK
    say(f"{place}: {'no longer trusted' if count else 'was not trusted'}")
    return EXIT_OK


def _list(as_json: bool) -> int:
    rows = [_row(record) for record in trusted.records()]
    if as_json:
        print_json({"files": rows, "exit_code": EXIT_OK})
        return EXIT_OK
    if not rows:
        say("no project file is trusted")
        return EXIT_OK
    shown = table("Trusted project files", "file", "state")
    for row in rows:
        shown.add_row(str(row["file"] or row["record"]), row["state"])
    console().print(shown)
    return EXIT_OK


def _row(record: trusted.Record) -> dict[str, Any]:
    """A record as plain data, with what the file is today."""
    row = {"file": record.file, "record": record.place}
    if record.file is None:
        return {**row, "state": "damaged record: remove it"}
    try:
        content = read_bytes(record.file, LARGEST)
    except (OSError, SpecError):
        return {**row, "state": "not readable"}
    current = trusted.digest(record.file, content) == record.place.name
    return {**row, "state": "trusted" if current else "changed since: not trusted"}
