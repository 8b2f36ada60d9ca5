"""``simspec engines``, ``simspec engines doctor``: the engines, their state, and the features that they support;
``simspec engines install``: the exact words that install them; ``simspec trust``: whether the programs and folders that a
project file names may be used.
"""

from __future__ import annotations

import functools
import importlib
import os
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from simspec.commands.experiment_options import (
    DoctorOptions,
    EnginesOptions,
    InstallOptions,
    ShowEnginesOptions,
    TrustOptions,
)
from simspec.commands.files import generated_files
from simspec.commands.options import demand_trusted, names_alone, print_json
from simspec.confinement import Walls, walls
from simspec.engines.kit import registry
from simspec.engines.kit.compiled import forget_packages
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.environments import InstallState, compile_parts, diagnose, making, python_of
from simspec.engines.kit.registry import EngineId, EngineInstance, find_engine, instances, parse
from simspec.engines.kit.registry import engines as registry_engines
from simspec.errors import EXIT_ENGINE, EXIT_OK, EngineError, Problem, SimspecError, SpecError, clipped, visible
from simspec.outputs import trust as trusted
from simspec.outputs.files import is_complete, mark_begun, mark_complete, read_bytes
from simspec.outputs.targets import check_file
from simspec.processes import ELSEWHERE, isolated
from simspec.project import LARGEST, PROJECT_FILE, Project, find_project, load_project, parse_project
from simspec.proof.probes import fall
from simspec.report import engine_pages, matrix
from simspec.report.matrix import engine_table, engine_tables
from simspec.report.screen import console, say
from simspec.report.table import Table

WORKS, FAILS, NOT_TRUSTED = "works", "fails", "not trusted"
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
    broken = {} if labels else dict(registry.engines().broken())
    wanted = list(rows) if labels or options.every else []
    wrong = [
        label
        for label, row in rows.items()
        if row["state"] != WORKS
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
    if python is not None or found.state is InstallState.WHOLE:
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


# --- install: here, or a version in an environment of its own -----------------------------------------------------------------

DEADLINE = 3600.0
"""s for one command: the largest engine is some 100 MB, and a slow line has an hour for it."""
STANDARD_ERROR = 2
"""Its descriptor: standard output is for the answer."""


def install(options: InstallOptions) -> int:
    """Print the commands that install engines, or every known one that is not installed whole; run them with ``--yes``.

    A name with a version (``NAME@3.8``) gets an environment of its own, which is found by that label from then on; so does an
    engine that does not go with the packages of others (``Engine.SEPARATE_VERSION``), which is found by its name, too.

    Exit code 3 where an engine cannot be installed here, or a command failed or may not be run.
    """
    names, yes, as_json = options.names or [], options.yes, options.as_json
    if bool(names) == options.every:
        raise SpecError([Problem("one or more engines, or --all", allowed=", ".join(registry_engines()), code="C102")])
    rows = {}
    for word in names or registry_engines():
        label = parse(word)
        if label.python is not None:
            message = f"{word!r} has an interpreter already"
            raise SpecError([Problem(message, allowed="NAME, NAME@VERSION", code="C103")])
        engine = find_engine(label.name)
        version = label.version or engine.SEPARATE_VERSION
        if version:
            rows[label.label] = _version_row(EngineId(label.name, version), yes, as_json)
        else:
            rows[label.label] = _install_row(engine, yes, as_json)
    code = EXIT_OK if all(row["problem"] is None for row in rows.values()) else EXIT_ENGINE
    if as_json:
        print_json({"engines": rows, "exit_code": code})
    return code


def _install_row(engine: type[Engine], yes: bool, as_json: bool) -> dict[str, Any]:
    """Install an engine, or list its commands; the result as plain data. Each line is printed at once, unless as JSON."""
    found = diagnose(engine)
    row: dict[str, Any] = {"state": str(found.state), "version": found.version, "commands": [], "problem": None}
    if found.state is InstallState.WHOLE:
        _tell(as_json, f"{engine.NAME}: {found.version} is installed")
        return row
    if found.state in (InstallState.IMPOSSIBLE, InstallState.FILES):
        row["problem"] = "; ".join([*found.problems, *([found.install] if found.state is InstallState.FILES else [])])
    commands = [] if row["problem"] else words(engine)
    if not row["problem"] and not commands:
        row["problem"] = f"{engine.NAME} does not say how it is installed"
    for command in commands:
        entry: dict[str, Any] = {"words": shlex.join(command), "ran": False, "code": None}
        row["commands"].append(entry)
        _tell(as_json, f"{engine.NAME}: {entry['words']}")
        if not yes or row["problem"]:
            continue
        if (why := _forbidden(command)) is not None:
            row["problem"] = f"not run: {why}"
            continue
        entry["code"], why = _run(command)
        entry["ran"] = entry["code"] is not None
        if why is not None:
            row["problem"] = f"{entry['words']}: {why}"
    if commands and yes and not row["problem"]:
        importlib.invalidate_caches()
        forget_packages()
        found = diagnose(engine)  # an installer may end with code 0 and have installed nothing
        row |= {"state": str(found.state), "version": found.version}
        if found.state is InstallState.WHOLE:
            _tell(as_json, f"{engine.NAME}: {found.version} is installed")
        else:
            row["problem"] = f"{found.state} after these commands: {'; '.join(found.problems)}".rstrip(": ")
    if row["problem"]:
        _tell(as_json, f"{engine.NAME}: {row['problem']}")
    return row


def _version_row(label: EngineId, yes: bool, as_json: bool) -> dict[str, Any]:
    """The same for a version, which has an environment of its own."""
    row: dict[str, Any] = {"state": str(InstallState.ABSENT), "version": None, "commands": [], "problem": None}
    try:
        commands = making(label)
    except EngineError as error:
        row["problem"] = str(error).removeprefix(f"{label.label}: ").removeprefix(f"{label.name}: ")
        _tell(as_json, f"{label.label}: {row['problem']}")
        return row
    place = Path(commands[0][-1])
    whole, found = is_complete(place), None
    if whole is None and os.path.lexists(place):
        row["problem"] = f"{place} exists, and simspec did not make it: move it away"
    elif whole:
        found = _instance(label, place)
    if row["problem"] is None and (found is None or found.problem is not None):
        row["commands"] = [{"words": shlex.join(command), "ran": False, "code": None} for command in commands]
        for entry in row["commands"]:
            _tell(as_json, f"{label.label}: {entry['words']}")
        row["problem"] = _make(place, commands, row["commands"]) if yes else None
        whole = yes and row["problem"] is None
        found = _instance(label, place) if whole else None
    if whole and found is not None:
        row |= {"version": found.version, "problem": found.problem}
        if found.problem is None:
            row["state"] = str(InstallState.WHOLE)
            _tell(as_json, f"{label.label}: {found.version} is installed in {place}")
    if row["problem"]:
        _tell(as_json, f"{label.label}: {row['problem']}")
    return row


def installed_version(label: EngineId, yes: bool) -> str:
    """The interpreter of a version's environment, which is made first where it is not there and ``yes``; quietly: the last line
    of pip is in the error where it fails. Raises EngineError, with the commands that would make it, where there is none."""
    commands = making(label)
    place = Path(commands[0][-1])
    if is_complete(place) and _instance(label, place).problem is None:
        return str(python_of(place))
    if is_complete(place) is None and os.path.lexists(place):
        raise EngineError(label.label, f"{place} exists, and simspec did not make it: move it away")
    if not yes:
        way = f"simspec engines install {label.label} --yes, or --yes here"
        raise EngineError(label.label, f"is not installed: {way}")
    given: list[dict[str, Any]] = [{"words": shlex.join(command)} for command in commands]
    why = _make(place, commands, given, quiet=True) or _instance(label, place).problem
    if why is not None:
        raise EngineError(label.label, f"cannot be installed: {why}")
    return str(python_of(place))


def _instance(label: EngineId, place: Path) -> EngineInstance:
    """The instance of a label in the interpreter of an environment."""
    requested = instances({label.label: str(python_of(place))})
    return next(instance for instance in requested if instance.label == label.label)


def _make(
    place: Path, commands: Sequence[Sequence[str]], given: Sequence[dict[str, Any]], quiet: bool = False
) -> str | None:
    """Make an environment anew by its commands; why it is not whole, None where it is."""
    try:
        mark_begun(place)
    except OSError as error:
        return f"{place}: {error.strerror}" if error.strerror else str(error)
    for command, entry in zip(commands, given, strict=True):
        entry["code"], why = _run(command, quiet)
        entry["ran"] = entry["code"] is not None
        if why is not None:
            return f"{entry['words']}: {why}"
    mark_complete(place)
    return None


def words(engine: type[Engine]) -> list[list[str]]:
    """The commands that install an engine: pip of this interpreter, and Debian's apt-get."""
    commands = [isolated("-m", "pip", "install", f"simspec-physics[{engine.EXTRA}]")] if engine.EXTRA else []
    if engine.NEEDS.debian:
        commands.append(["apt-get", "update", "--quiet"])
        commands.append(["apt-get", "install", "--yes", "--no-install-recommends", *engine.NEEDS.packages])
    return commands


def _forbidden(command: Sequence[str]) -> str | None:
    """Why a command is not run for the user."""
    if command[0] != "apt-get":
        return None
    if shutil.which("apt-get") is None:
        return "this system has no apt-get; the names of the packages may differ"
    return None if os.geteuid() == 0 else "it needs root"


def _run(command: Sequence[str], quiet: bool = False) -> tuple[int | None, str | None]:
    """The exit code of a command, whose words go to standard error, and what is wrong, with the last of its words where it is
    ``quiet``. None: it gave none."""
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if quiet else STANDARD_ERROR,
            stderr=subprocess.STDOUT if quiet else None,
            cwd=ELSEWHERE,
            env=environment,
            timeout=DEADLINE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None, f"did not end within {DEADLINE:g} s"
    except OSError as error:
        return None, f"cannot be started: {error.strerror}"
    words = (done.stdout or b"").decode(errors="replace").strip().splitlines() or [""]
    said = f": {clipped(visible(words[-1]))}" if words[-1] else ""
    return done.returncode, f"ended with code {done.returncode}{said}" if done.returncode else None


def _tell(as_json: bool, line: str) -> None:
    if not as_json:
        say(line)
