"""``simspec engines install``: the commands that install engines, here or in environments of their own; with ``--yes`` they are
run."""

from __future__ import annotations

import importlib
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from simspec.commands.experiment_options import InstallOptions
from simspec.commands.installers import CLASH, forbidden, run
from simspec.commands.licences import OPTION, Consent, check_accepted, terms_lines
from simspec.commands.options import print_json
from simspec.engines.kit.compiled import forget_packages
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.environments import InstallState, diagnose, making, python_of
from simspec.engines.kit.registry import EngineId, EngineInstance, find_engine, instances, loaders, parse
from simspec.engines.kit.registry import engines as registry_engines
from simspec.errors import EXIT_ENGINE, EXIT_OK, EngineError, Problem, SpecError
from simspec.outputs.files import is_complete, mark_begun, mark_complete
from simspec.processes import isolated
from simspec.report.screen import plain, say


def install(options: InstallOptions) -> int:
    """Print the commands that install engines, or every known one that is not installed whole; run them with ``--yes``.

    A name with a version (``NAME@3.8``) gets an environment of its own, which is found by that label from then on; so does an
    engine that does not go with the packages of others (``Engine.SEPARATE_VERSION``), which is found by its name, too.
    ``--all`` leaves out engines that audit robot files and run no world. An engine with licence terms (``Engine.LICENCES``)
    is installed after the user has accepted them, which ``--yes`` alone does not; every prompt comes before the first command.

    Exit code 3 where an engine cannot be installed here, its licence is not accepted, or a command failed or may not be run.
    """
    names, yes, as_json = options.names or [], options.yes, options.as_json
    if bool(names) == options.every:
        known = ", ".join(loaders())
        raise SpecError([Problem("one or more engines, or --all", allowed=known, code="C102")])
    wanted: dict[str, EngineId] = {}
    for word in names or registry_engines():
        label = parse(word)
        if label.python is not None:
            message = f"{word!r} has an interpreter already"
            raise SpecError([Problem(message, allowed="NAME, NAME@VERSION", code="C103")])
        version = label.version or find_engine(label.name).SEPARATE_VERSION
        wanted[label.label] = EngineId(label.name, version)
    accepted = options.accepted or []
    check_accepted(accepted, [find_engine(label.name) for label in wanted.values()], yes)
    consent = Consent(accepted)
    for word, label in wanted.items():
        _introduce(word, label, consent, yes, as_json)
    rows = {}
    for word, label in wanted.items():
        engine = find_engine(label.name)
        refusal = consent.refusal(engine, word) if yes else None
        row = (
            _version_row(label, yes, refusal, as_json) if label.version else _install_row(engine, yes, refusal, as_json)
        )
        rows[word] = {**row, "licences": plain(engine.LICENCES)}
    code = EXIT_OK if all(row["problem"] is None for row in rows.values()) else EXIT_ENGINE
    if as_json:
        print_json({"engines": rows, "exit_code": code})
    return code


def _introduce(word: str, label: EngineId, consent: Consent, yes: bool, as_json: bool) -> None:
    """Print the facts that a user should know before an engine is installed, and prompt for consent to its licence terms."""
    engine = find_engine(label.name)
    if engine.INSTALLS:
        _tell(as_json, f"{word}: {engine.INSTALLS}")
    if not engine.LICENCES or not _is_to_do(label):
        return
    for line in terms_lines(engine):
        _tell(as_json, line)
    if yes:
        consent.prompt(engine, silent=as_json)
    else:
        _tell(as_json, f"{engine.NAME}: --yes prompts for consent to these terms; {OPTION} {engine.NAME} gives it")


def _is_to_do(label: EngineId) -> bool:
    """Whether there are commands to run for an engine: it is not whole, and can be installed."""
    if label.version:
        try:
            _, found = _environment(label)
        except EngineError:
            return False
        return found is None or found.problem is not None
    engine = find_engine(label.name)
    unchanged = (InstallState.WHOLE, InstallState.IMPOSSIBLE, InstallState.FILES)
    return bool(words(engine)) and diagnose(engine).state not in unchanged


def _install_row(engine: type[Engine], yes: bool, refusal: str | None, as_json: bool) -> dict[str, Any]:
    """Install an engine, or list its commands; the result as plain data. Each line is printed at once, unless as JSON.
    ``refusal``: why no command may be run."""
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
    row["problem"] = row["problem"] or refusal
    for command in commands:
        entry: dict[str, Any] = {"words": shlex.join(command), "ran": False, "code": None}
        row["commands"].append(entry)
        _tell(as_json, f"{engine.NAME}: {entry['words']}")
        if not yes or row["problem"]:
            continue
        if (why := forbidden(command)) is not None:
            row["problem"] = f"not run: {why}"
            continue
        entry["code"], why = run(command)
        entry["ran"] = entry["code"] is not None
        if why is not None:
            row["problem"] = f"{entry['words']}: {why}"
            if CLASH in why and engine.DISTRIBUTION:
                row["problem"] += f"; simspec engines install {engine.NAME}@VERSION --yes uses a separate environment"
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


def _version_row(label: EngineId, yes: bool, refusal: str | None, as_json: bool) -> dict[str, Any]:
    """The same for a version, which has an environment of its own."""
    row: dict[str, Any] = {"state": str(InstallState.ABSENT), "version": None, "commands": [], "problem": None}
    try:
        commands, found = _environment(label)
    except EngineError as error:
        row["problem"] = str(error).removeprefix(f"{label.label}: ").removeprefix(f"{label.name}: ")
        _tell(as_json, f"{label.label}: {row['problem']}")
        return row
    place = Path(commands[0][-1])
    if found is None or found.problem is not None:
        found = None
        row["commands"] = [{"words": shlex.join(command), "ran": False, "code": None} for command in commands]
        for entry in row["commands"]:
            _tell(as_json, f"{label.label}: {entry['words']}")
        if yes:
            row["problem"] = refusal or _make(place, commands, row["commands"])
            found = None if row["problem"] else _instance(label, place)
    if found is not None:
        row |= {"version": found.version, "problem": found.problem}
        if found.problem is None:
            row["state"] = str(InstallState.WHOLE)
            _tell(as_json, f"{label.label}: {found.version} is installed in {place}")
    if row["problem"]:
        _tell(as_json, f"{label.label}: {row['problem']}")
    return row


def installed_version(label: EngineId, yes: bool) -> str:
    """The interpreter of a version's environment, which is made first where it is not there and ``yes``; quietly: the last line
    of pip is in the error where it fails. Raises EngineError, with the commands that would make it, where there is none, and
    for an engine with licence terms: this function does not prompt."""
    commands, found = _environment(label)
    place = Path(commands[0][-1])
    if found is not None and found.problem is None:
        return str(python_of(place))
    if (refusal := Consent().refusal(find_engine(label.name), label.label)) is not None:
        raise EngineError(label.label, f"not installed: {refusal}")
    if not yes:
        way = f"simspec engines install {label.label} --yes, or --yes here"
        raise EngineError(label.label, f"is not installed: {way}")
    given: list[dict[str, Any]] = [{"words": shlex.join(command)} for command in commands]
    why = _make(place, commands, given, quiet=True) or _instance(label, place).problem
    if why is not None:
        raise EngineError(label.label, f"cannot be installed: {why}")
    return str(python_of(place))


def _environment(label: EngineId) -> tuple[list[list[str]], EngineInstance | None]:
    """The commands that make the environment of a version, and the engine in it; None where it is not there, or not whole.
    Raises EngineError where there can be none, and where its place is taken."""
    commands = making(label)
    place = Path(commands[0][-1])
    whole = is_complete(place)
    if whole is None and os.path.lexists(place):
        raise EngineError(label.label, f"{place} exists, and simspec did not make it: move it away")
    return commands, _instance(label, place) if whole else None


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
        entry["code"], why = run(command, quiet)
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


def _tell(as_json: bool, line: str) -> None:
    if not as_json:
        say(line)
