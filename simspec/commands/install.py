"""``simspec engines install``: the commands that install engines, here or in environments of their own; with ``--yes`` they are
run."""

from __future__ import annotations

import importlib
import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from simspec.commands.experiment_options import InstallOptions
from simspec.commands.options import print_json
from simspec.engines.kit.compiled import forget_packages
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.environments import InstallState, diagnose, making, python_of
from simspec.engines.kit.registry import EngineId, EngineInstance, find_engine, instances, loaders, parse
from simspec.engines.kit.registry import engines as registry_engines
from simspec.errors import EXIT_ENGINE, EXIT_OK, EngineError, Problem, SpecError, clipped, visible
from simspec.outputs.files import is_complete, mark_begun, mark_complete
from simspec.processes import ELSEWHERE, isolated
from simspec.report.screen import say

DEADLINE = 3600.0
"""s for one command: the largest engine is some 100 MB, and a slow line has an hour for it."""
STANDARD_ERROR = 2
"""Its descriptor: standard output is for the answer."""


def install(options: InstallOptions) -> int:
    """Print the commands that install engines, or every known one that is not installed whole; run them with ``--yes``.

    A name with a version (``NAME@3.8``) gets an environment of its own, which is found by that label from then on; so does an
    engine that does not go with the packages of others (``Engine.SEPARATE_VERSION``), which is found by its name, too.
    ``--all`` leaves out engines that audit robot files and run no world.

    Exit code 3 where an engine cannot be installed here, or a command failed or may not be run.
    """
    names, yes, as_json = options.names or [], options.yes, options.as_json
    if bool(names) == options.every:
        known = ", ".join(loaders())
        raise SpecError([Problem("one or more engines, or --all", allowed=known, code="C102")])
    rows = {}
    for word in names or registry_engines():
        label = parse(word)
        if label.python is not None:
            message = f"{word!r} has an interpreter already"
            raise SpecError([Problem(message, allowed="NAME, NAME@VERSION", code="C103")])
        engine = find_engine(label.name)
        version = label.version or engine.SEPARATE_VERSION
        if engine.INSTALLS:
            _tell(as_json, f"{label.label}: {engine.INSTALLS}")
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
