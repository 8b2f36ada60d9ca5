"""``simspec engines``, ``simspec engines doctor``: the engines, their state, and the features that they support;
``simspec trust``: whether the programs and folders that a project file names may be used.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from simspec.commands.experiment_options import (
    DoctorOptions,
    EnginesOptions,
    ShowEnginesOptions,
    TrustOptions,
)
from simspec.commands.files import generated_files
from simspec.commands.options import demand_trusted, names_alone, print_json
from simspec.confinement import Walls, walls
from simspec.engines.kit import registry
from simspec.engines.kit.environments import InstallState, compile_parts, diagnose
from simspec.engines.kit.registry import find_engine, instances
from simspec.errors import EXIT_ENGINE, EXIT_OK, Problem, SimspecError, SpecError
from simspec.outputs import trust as trusted
from simspec.outputs.files import read_bytes
from simspec.outputs.targets import check_file
from simspec.project import LARGEST, PROJECT_FILE, Project, find_project, load_project, parse_project
from simspec.proof.probes import fall
from simspec.report import engine_pages, matrix
from simspec.report.matrix import engine_table, engine_tables
from simspec.report.screen import console, say
from simspec.report.table import Table

WORKS, LOADS, FAILS, NOT_TRUSTED = "works", "loads files", "fails", "not trusted"
"""States of an engine: ``LOADS`` of an engine that audits robot files and runs no world."""
NOTHING = "names no interpreters and no folders: it needs no trust"


def engines(options: EnginesOptions) -> int:
    """Print the engines, or write the support matrix, and the page of engines alongside it."""
    out, check = options.out, options.check
    if options.markdown:
        names = engine_pages.page_names()
        pages: dict[Path, tuple[Callable[[], str], Callable[[bytes], bool]]] = {
            out: (matrix.markdown, matrix.is_matrix),
            **{out.parent / name: (functools.partial(_engine_page, name), engine_pages.is_page) for name in names},
        }
        for path, (_, ours) in pages.items() if not check else ():
            check_file(path, ours)
        files = {path: (made(), ours) for path, (made, ours) in pages.items()}
        return generated_files(files, check, options.as_json, "simspec engines --markdown")
    data = matrix.engine_data()
    project = load_project()
    listed = project.listed_interpreters()
    rows = instances(listed, project.default_engines, listed.not_queried)
    if options.as_json:
        given = {"project": project.file, "project_trusted": project.not_trusted is None}
        print_json({"instances": rows, **given, "engines": data, "broken": matrix.broken()})
        return EXIT_OK
    for shown in engine_tables(rows, data):
        console().print(shown)
    for name, why in matrix.broken().items():
        say(f"{name}: {why}")
    return EXIT_OK


def show(options: ShowEnginesOptions) -> int:
    """Print what engines support, each feature with its short reason. Raises EngineError for an unknown engine."""
    if options.as_json:
        print_json({name: matrix.engine_data()[name] for name in names_alone(options.shown)})
        return EXIT_OK
    for name in names_alone(options.shown):
        for table in engine_table(name):
            console().print(table)
    return EXIT_OK


@functools.cache
def _engine_pages() -> dict[str, str]:
    return engine_pages.pages(Path())


def _engine_page(name: str) -> str:
    return _engine_pages()[name]


# --- doctor -----------------------------------------------------------------------------------------------------------------


def doctor(options: DoctorOptions) -> int:
    """Examine engines (default: all). Exit code 3 where one that is installed does not work, or is so in part or in another
    version; where one that is named, or with ``--all`` any, is not installed. Interpreters of a project file that is not
    trusted are not started: one that is named is an error, others are rows with the reason."""
    labels = options.names or []
    project = load_project()
    interpreters = project.known_interpreters()
    for label in labels:
        find_engine(label)
    demand_trusted(labels, interpreters)
    closed = {label: project.why_not_queried(label) for label in interpreters.not_trusted}
    wanted_labels = [label for label in interpreters if label not in closed and (not labels or label in labels)]
    started = {label: interpreters[label] for label in wanted_labels}
    known = instances(started, [*project.default_engines, *labels], closed)
    rows = {
        instance.label: not_examined(instance.label, closed[instance.label])
        if instance.label in closed
        else examined(instance.label, instance.python, instance.problem)
        for instance in known
        if not labels or instance.label in labels
    }
    broken = {} if labels else {**registry.engines().broken(), **registry.auditors().broken()}
    wanted = list(rows) if labels or options.every else []
    wrong = [
        label
        for label, row in rows.items()
        if row["state"] not in (WORKS, LOADS)
        and (
            label in wanted
            or row["state"] not in (InstallState.ABSENT, InstallState.IMPOSSIBLE, InstallState.FILES, NOT_TRUSTED)
        )
    ]
    code = EXIT_ENGINE if wrong or broken else EXIT_OK
    if options.as_json:
        print_json({"engines": rows, "broken": broken, "walls": walls()._asdict(), "exit_code": code})
        return code
    shown = Table("Engines", "engine", "version", "state", "falling ball", "s", "missing or wrong, and the way out")
    for label, row in rows.items():
        way = [f"-> {row['install']}"] if row["problems"] and row["install"] else []
        off = "" if row["height_error"] is None else f"{row['speed_error']:.0e}, {row['height_error']:.1e} m off"
        took = "" if row["seconds"] is None else f"{row['seconds']:.1f}"
        shown.add(label, row["version"] or "none", row["state"], off, took, "\n".join([*row["problems"], *way]))
    console().print(shown)
    for name, why in broken.items():
        say(f"{name}: {why}")
    say(f"confinement of processes that read foreign files: {offered(walls())}")
    return code


def not_examined(label: str, why: str) -> dict[str, Any]:
    """The same of an engine whose interpreter is not started, for the reason ``why``."""
    nothing = dict.fromkeys(("version", "install", "python", "seconds", "speed_error", "height_error"))
    return {**nothing, "state": NOT_TRUSTED, "problems": [why]}


def offered(kernel: Walls) -> str:
    """The means of the kernel to confine processes, in words."""
    present = [f"Landlock {kernel.landlock}"] * bool(kernel.landlock) + ["seccomp"] * kernel.calls
    return "; ".join([*([" and ".join(present)] if present else []), *([kernel.why] if kernel.why else [])])


def examined(label: str, python: str | None, problem: str | None) -> dict[str, Any]:
    """The state of an engine, as plain data."""
    engine = find_engine(label)
    found = diagnose(engine)
    state, problems = str(found.state), list(found.problems)
    if python is None and found.state is InstallState.ABSENT and not problems:
        problems = ["not installed"]
    elif python is not None or found.state is InstallState.WHOLE:
        problems = [problem] if problem is not None else list(compile_parts(engine))
    row: dict[str, Any] = {
        "version": found.version,
        "state": state,
        "problems": problems,
        "install": found.install,
        "python": python,
        "seconds": None,
        "speed_error": None,
        "height_error": None,
    }
    if problems:
        return row | {"state": FAILS if found.state is InstallState.WHOLE or python is not None else state}
    try:
        if engine.NAME in registry.auditors():
            from simspec.audit.sample import (
                load_sample,
            )  # with the importers: not for commands that examine no such engine

            version, seconds = load_sample(label, python)
            return row | {"state": LOADS, "version": version, "seconds": seconds}
        seen = fall(label, python)
    except SimspecError as error:
        return row | {"state": FAILS, "problems": [str(error).removeprefix(f"{label}: ")]}
    measured = {"seconds": seen.seconds, "speed_error": seen.speed_error, "height_error": seen.height_error}
    return row | {"state": WORKS, "version": seen.version, **measured}


# --- trust ------------------------------------------------------------------------------------------------------------------


def trust(options: TrustOptions) -> int:
    """Trust a project file (default: the one in force here) with its content of this moment; with ``--revoke``, no longer; with
    ``--list``, print the files that are trusted."""
    if options.listed and (options.revoked or options.file is not None):
        raise SpecError([Problem("--list excludes FILE and --revoke", code="C101")])
    if options.listed:
        return _list(options.as_json)
    place = _place(options.file)
    return _revoke(place, options.as_json) if options.revoked else _trust(place, options.as_json)


def _place(file: Path | None) -> Path:
    """The project file that is meant. Raises SpecError where there is none."""
    if file is None:
        found = find_project(Path.cwd())
        if found is None:
            raise SpecError(
                [Problem(f"there is no {PROJECT_FILE} here or above", hint="simspec trust FILE", code="C114")]
            )
        return found
    place = file / PROJECT_FILE if file.is_dir() else file
    if place.name != PROJECT_FILE:
        raise SpecError(
            [
                Problem(
                    f"{file}: not a project file", allowed=f"a file called {PROJECT_FILE}, or its folder", code="C105"
                )
            ]
        )
    return place.absolute()


def _trust(place: Path, as_json: bool) -> int:
    try:
        content = read_bytes(place, LARGEST)
    except FileNotFoundError:
        raise SpecError([Problem(f"{place}: no such file", code="C104")]) from None
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
    """The programs and folders that a project file names, by key."""
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
    shown = Table("Trusted project files", "file", "state")
    for row in rows:
        shown.add(str(row["file"] or row["record"]), row["state"])
    console().print(shown)
    return EXIT_OK


def _row(record: trusted.TrustRecord) -> dict[str, Any]:
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
