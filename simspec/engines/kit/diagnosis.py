"""What is there of an engine, and what is missing and why: asked of package metadata, pkg-config and the compiler."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum

from packaging.requirements import Requirement
from packaging.version import InvalidVersion

from simspec.engines.kit.compiled import package_version
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.installing import how_to_install, why_not
from simspec.errors import EngineError


class State(StrEnum):
    """How far an engine is installed."""

    WHOLE = "installed"
    HALF = "half installed"
    OTHER_VERSION = "other version"
    ABSENT = "not installed"
    IMPOSSIBLE = "cannot be installed"
    FILES = "its files alone"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What is there of an engine. ``problems``: each thing that is missing or wrong; ``install``: the words that install it."""

    state: State
    version: str | None
    problems: tuple[str, ...]
    install: str


def diagnose(engine: type[Engine], environment: Mapping[str, str] | None = None) -> Diagnosis:
    """What is there of ``engine`` in this interpreter and on this machine. ``environment`` overrides markers of packages."""
    install = how_to_install(engine)
    if alone := engine.files_alone():
        lacking = [_reason(engine, error) for error in engine.NEEDS.lacking()]
        return Diagnosis(State.FILES, None, (alone, *lacking), install)
    if engine.version() is None and (why := why_not(engine, dict(environment or {}))) is not None:
        return Diagnosis(State.IMPOSSIBLE, None, (why,), install)
    absent, wrong = _packages(engine, environment)
    lacking = [_reason(engine, error) for error in engine.NEEDS.lacking()]
    there = _version(engine)
    problems = (*wrong, *absent, *lacking)
    if there is None:
        state = State.ABSENT
    elif wrong:
        state = State.OTHER_VERSION
    else:
        state = State.HALF if absent or lacking else State.WHOLE
    return Diagnosis(state, there, problems, install)


def compile_parts(engine: type[Engine]) -> tuple[str, ...]:
    """Why parts of the engine cannot be compiled and loaded, after trying to: each problem in a line or more."""
    problems = []
    for part in engine.NEEDS.parts:
        try:
            part.check()
        except EngineError as error:
            problems.append(_reason(engine, error))
    return tuple(problems)


def _reason(engine: type[Engine], error: EngineError) -> str:
    return str(error).removeprefix(f"{engine.NAME}: ")


def _version(engine: type[Engine]) -> str | None:
    """The version of what there is of the engine itself, also where what it needs beside is missing."""
    library = engine.NEEDS.library
    return engine.version() or (package_version(library.split()[0]) if library else None)


def _packages(engine: type[Engine], environment: Mapping[str, str] | None) -> tuple[list[str], list[str]]:
    """Packages of its extra that are not installed, and those in versions that simspec does not ask for."""
    absent, wrong = [], []
    for requirement in requirements(engine.EXTRA, environment) if engine.EXTRA else ():
        names = engine.distributions() if requirement.name == engine.DISTRIBUTION else (requirement.name,)
        found = next((version for name in names if (version := _installed(name)) is not None), None)
        asked = f"simspec[{engine.EXTRA}] asks for {requirement.name}{requirement.specifier}"
        if found is None:
            absent.append(f"{requirement.name} is not installed: {asked}")
        elif not _contains(requirement, found):
            wrong.append(f"{requirement.name} {found} is installed: {asked}")
    library = engine.NEEDS.library
    if library and package_version(library) is None and (found := package_version(library.split()[0])) is not None:
        wrong.append(f"version {found} of its library is installed: it asks for {library}")
    return absent, wrong


def _contains(requirement: Requirement, version: str) -> bool:
    """Whether a version is one of those asked for; what is no version is not."""
    try:
        return requirement.specifier.contains(version, prereleases=True)
    except InvalidVersion:
        return not requirement.specifier


def _installed(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def requirements(extra: str, environment: Mapping[str, str] | None = None) -> Iterator[Requirement]:
    """The packages that an extra of simspec pulls here, extras of simspec followed, as its own metadata say."""
    for line in importlib.metadata.requires("simspec") or ():
        requirement = Requirement(line)
        marker = requirement.marker
        if marker is None or not marker.evaluate({**(environment or {}), "extra": extra}):
            continue
        if marker.evaluate({**(environment or {}), "extra": ""}):
            continue  # of simspec itself, whatever the extra
        if requirement.name == "simspec":
            for other in requirement.extras:
                yield from requirements(other, environment)
        else:
            yield requirement
