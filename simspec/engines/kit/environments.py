"""Versions of engines in environments of their own: made by simspec in the user's data folder, and found there by label.

A folder ``engines/NAME@VERSION`` is one environment, whole or begun (``outputs/files.py``).
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.version import InvalidVersion, Version

from simspec.engines.kit.compiled import package_version
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import (
    EngineId,
    find_engine,
    how_to_install,
    loaders,
    parse,
    too_old,
    why_not,
)
from simspec.errors import EngineError, SpecError, clipped, visible
from simspec.outputs.files import data_folder, is_complete, written_by_others
from simspec.plugins import NAME, installed_version
from simspec.plugins import requirements as simspec_requirements
from simspec.processes import ELSEWHERE, isolated

# The released versions of an engine that the package index has for this Python, by the ordinary client of it.

PATIENCE: Final = 120.0
"""s that the client may take for the list of one package."""
_LISTED = re.compile(r"^Available versions:(.*)$", re.MULTILINE)


def released_versions(engine: type[Engine], first: str, last: str) -> list[str]:
    """The released versions from ``first`` to ``last``, in order, pre-releases left out.

    Raises EngineError where the engine comes with no package of Python, or the index cannot be queried.
    """
    if not engine.DISTRIBUTION:
        raise EngineError(engine.NAME, "comes with the machine, not with pip: it has one version there")
    lowest, highest = _version(engine, first), _version(engine, last)
    found: dict[Version, str] = {}
    for name, rule in _packages(engine):
        if not _reaches(engine, rule, lowest, highest):
            continue
        for word in _listed(engine, name):
            version = _release(word)
            if version is not None and lowest <= version <= highest and package_of(engine, version) == name:
                found[version] = word
    return [found[version] for version in sorted(found)]


def in_order(engine: type[Engine], words: Iterable[str]) -> list[str]:
    """Versions that a user names, in order, each once. Raises EngineError for a word that is no version."""
    named = {_version(engine, word): word for word in words}
    return [named[version] for version in sorted(named)]


def same_version(name: str, other: str) -> bool:
    """Whether two words name one version: 3.4 and 3.4.0 do."""
    try:
        return Version(name) == Version(other)
    except InvalidVersion:
        return False


def package_of(engine: type[Engine], version: Version) -> str:
    """The package that brings a version of an engine."""
    former = (name for rule, name in engine.FORMER_DISTRIBUTIONS.items() if SpecifierSet(rule).contains(version))
    return next(former, engine.DISTRIBUTION)


def _packages(engine: type[Engine]) -> list[tuple[str, str]]:
    """The packages that bring some version of an engine, each with the rule of its versions ("": those of no other)."""
    return [(engine.DISTRIBUTION, ""), *((name, rule) for rule, name in engine.FORMER_DISTRIBUTIONS.items())]


def _reaches(engine: type[Engine], rule: str, lowest: Version, highest: Version) -> bool:
    """Whether a package may have versions between two. A rule may match between two ends that it excludes, so that it is
    evaluated unless both ends lie on one side."""
    rules = (
        [SpecifierSet(rule)]
        if rule
        else [SpecifierSet(former_distribution) for former_distribution in engine.FORMER_DISTRIBUTIONS]
    )
    inside = [any(rule.contains(end) for rule in rules) for end in (lowest, highest)]
    return any(inside) if rule else not all(inside)


def _listed(engine: type[Engine], package: str) -> Sequence[str]:
    """The client's listing of a package. It is started from the root, so that no file of the user's is imported."""
    words = isolated("-m", "pip", "--disable-pip-version-check", "--no-input", "index", "versions", package)
    try:
        done = subprocess.run(
            words,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            cwd=ELSEWHERE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise EngineError(
            engine.NAME, f"the package index gave no versions of {package} within {PATIENCE:g} s"
        ) from None
    except OSError as error:
        raise EngineError(engine.NAME, f"pip cannot be started: {error.strerror}") from None
    listed = _LISTED.search(done.stdout)
    if done.returncode or listed is None:
        said = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1]
        why = f"pip index versions {package} ended with code {done.returncode}: {clipped(visible(said))}"
        raise EngineError(engine.NAME, f"{why}; --versions A,B,C gives them without the index")
    return [word.strip() for word in listed[1].split(",") if word.strip()]


def _version(engine: type[Engine], word: str) -> Version:
    try:
        return Version(word)
    except InvalidVersion:
        raise EngineError(engine.NAME, f"{word!r} is not a version that pip knows") from None


def _release(word: str) -> Version | None:
    try:
        version = Version(word)
    except InvalidVersion:
        return None
    return None if version.is_prerelease else version


# The installed parts of an engine, and the missing ones with the reason: from package metadata, pkg-config and the compiler.


class InstallState(StrEnum):
    """How far an engine is installed."""

    WHOLE = "installed"
    HALF = "half installed"
    OTHER_VERSION = "other version"
    ABSENT = "not installed"
    IMPOSSIBLE = "cannot be installed"
    FILES = "files only"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The installation of an engine. ``problems``: each part that is missing or wrong; ``install``: the command that installs
    it."""

    state: InstallState
    version: str | None
    problems: tuple[str, ...]
    install: str


def diagnose(engine: type[Engine], environment: Mapping[str, str] | None = None) -> Diagnosis:
    """The installation of ``engine`` in this interpreter and on this machine. ``environment`` overrides markers of packages."""
    install = how_to_install(engine)
    if alone := engine.files_alone():
        lacking = [_reason(engine, error) for error in engine.NEEDS.lacking()]
        return Diagnosis(InstallState.FILES, None, (alone, *lacking), install)
    if engine.version() is None and (why := why_not(engine, dict(environment or {}))) is not None:
        return Diagnosis(InstallState.IMPOSSIBLE, None, (why,), install)
    absent, wrong = _known_packages(engine, environment)
    lacking = [_reason(engine, error) for error in engine.NEEDS.lacking()]
    there = _version_of(engine)
    problems = (*wrong, *absent, *lacking)
    if there is None:
        state = InstallState.ABSENT
    elif wrong:
        state = InstallState.OTHER_VERSION
    else:
        state = InstallState.HALF if absent or lacking else InstallState.WHOLE
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


def _version_of(engine: type[Engine]) -> str | None:
    """The version of the engine itself, also where further requirements are missing."""
    library = engine.NEEDS.library
    return engine.version() or (package_version(library.split()[0]) if library else None)


def _known_packages(engine: type[Engine], environment: Mapping[str, str] | None) -> tuple[list[str], list[str]]:
    """Packages of its extra that are not installed, and those in versions that simspec does not ask for."""
    absent, wrong = [], []
    for requirement in requirements(engine.EXTRA, environment) if engine.EXTRA else ():
        names = engine.distributions() if requirement.name == engine.DISTRIBUTION else (requirement.name,)
        found = next((version for name in names if (version := installed_version(name)) is not None), None)
        text = f"simspec-physics[{engine.EXTRA}] requires {requirement.name}{requirement.specifier}"
        if found is None:
            absent.append(f"{requirement.name} is not installed: {text}")
        elif not _contains(requirement, found):
            wrong.append(f"{requirement.name} {found} is installed: {text}")
    library = engine.NEEDS.library
    if library and package_version(library) is None and (found := package_version(library.split()[0])) is not None:
        wrong.append(f"version {found} of its library is installed: it requires {library}")
    return absent, wrong


def _contains(requirement: Requirement, version: str) -> bool:
    """Whether a version is one of those requested; a word that is no version is not."""
    try:
        return requirement.specifier.contains(version, prereleases=True)
    except InvalidVersion:
        return not requirement.specifier


def requirements(extra: str, environment: Mapping[str, str] | None = None) -> Iterator[Requirement]:
    """The packages that an extra of simspec pulls here, extras of simspec followed, as its own metadata say."""
    for line in simspec_requirements():
        requirement = Requirement(line)
        marker = requirement.marker
        if marker is None or not marker.evaluate({**(environment or {}), "extra": extra}):
            continue
        if marker.evaluate({**(environment or {}), "extra": ""}):
            continue  # of simspec itself, whatever the extra
        if requirement.name == NAME:
            for other in requirement.extras:
                yield from requirements(other, environment)
        else:
            yield requirement


FOLDER: Final = "engines"
ALONGSIDE: Final = ("numpy",)
"""Requirements of the worker in an engine's interpreter."""
LAWS: Final = "pin"
"""The extra of simspec for control laws that use the mass matrix, which run in the engine's process."""


def place_of(label: str) -> Path | None:
    """Where the environment of a label stands, made or not; None where the user has no data folder."""
    folder = data_folder(FOLDER)
    return None if folder is None else folder / label


def python_of(place: Path) -> Path:
    """The interpreter of an environment."""
    return place / "bin" / "python"


def environments() -> dict[str, str]:
    """The interpreters of every whole environment in the user's data folder, by label; none where others can write in it."""
    folder = data_folder(FOLDER)
    try:
        places = sorted(folder.iterdir()) if folder is not None and written_by_others(folder) is None else []
    except OSError:
        return {}  # there is no such folder, or the user cannot read it: missing environments are reported by label
    found = {place.name: str(python_of(place)) for place in places if _known(place.name) and is_complete(place) is True}
    # an engine that is not installed here, and has its environment under the version that it names
    for label in list(found):
        engine = find_engine(parse(label).name)
        separate = EngineId(engine.NAME, engine.SEPARATE_VERSION).label
        if engine.SEPARATE_VERSION and label == separate and engine.version() is None:
            found[engine.NAME] = found[label]
    return found


def _known(label: str) -> bool:
    try:
        engine = parse(label)
    except SpecError:
        return False
    return engine.name in loaders() and bool(engine.version) and engine.label == label


def requirement(engine: type[Engine], version: str) -> str:
    """The requirement for pip, for the versions of an engine that a label means by ``version``. Raises EngineError where the
    engine comes with no package of Python, or ``version`` is no version of one."""
    if not engine.DISTRIBUTION:
        raise EngineError(engine.NAME, "comes with the machine, not with pip: it has one version there")
    try:
        wanted = Version(version)
    except InvalidVersion:
        raise EngineError(engine.NAME, f"{version!r} is not a version that pip knows") from None
    exact = wanted.is_prerelease or wanted.is_postrelease or wanted.local is not None
    return f"{package_of(engine, wanted)}=={version}" + ("" if exact else ".*")


def making(label: EngineId) -> list[list[str]]:
    """The commands that make the environment of a label. Raises EngineError where there can be none."""
    engine = find_engine(label.name)
    if (why := too_old(engine, label.version)) is not None:
        raise EngineError(label.label, why)
    place = place_of(label.label)
    if place is None:
        raise EngineError(label.label, "there is no home folder to keep it in: XDG_DATA_HOME can name another")
    if (why := written_by_others(place.parent)) is not None:
        raise EngineError(label.label, f"the folder {place.parent} is not used: {why}; XDG_DATA_HOME can name another")
    text = requirement(engine, label.version)
    laws = [str(entry).partition(";")[0].strip() for entry in requirements(LAWS)]
    return [
        isolated("-m", "venv", str(place)),
        isolated("-m", "pip", "install", text, *ALONGSIDE, *engine.ALONGSIDE, *laws, python=str(python_of(place))),
    ]
