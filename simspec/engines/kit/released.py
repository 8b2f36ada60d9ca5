"""The released versions of an engine that the package index has for this Python, by the ordinary client of it."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable, Sequence
from typing import Final

from packaging.specifiers import SpecifierSet
from packaging.version import InvalidVersion, Version

from simspec.engines.kit.contract import Engine
from simspec.errors import EngineError, clipped, visible
from simspec.isolated import ELSEWHERE, isolated

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
    """Versions that somebody names, in order, each once. Raises EngineError for what is no version."""
    named = {_version(engine, word): word for word in words}
    return [named[version] for version in sorted(named)]


def same_version(one: str, other: str) -> bool:
    """Whether two words name one version: 3.4 and 3.4.0 do."""
    try:
        return Version(one) == Version(other)
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
    """Whether a package may have versions between two: of one with a rule no end needs to be its own, so that it is asked
    unless both ends lie on one side."""
    rules = [SpecifierSet(rule)] if rule else [SpecifierSet(one) for one in engine.FORMER_DISTRIBUTIONS]
    inside = [any(one.contains(end) for one in rules) for end in (lowest, highest)]
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
