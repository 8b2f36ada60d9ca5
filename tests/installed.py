"""The engines that tests run in. A skipped test names each engine that is left out, with the reason.

An engine is *demanded* where its tests fail when it is not installed. These are the ones that ``make setup`` installs (the
extras ``all`` and ``test``), and those that the environment variable ``SIMSPEC_DEMANDED_ENGINES`` names: engines, or ``all``.
Others are tested where they are installed: libraries of the machine, or packages that are too large for all users
(``make engines``).
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engines, not_installed
from simspec.plugins import NAME
from simspec.support.declarations import Level
from simspec.support.features import Feature

DEMANDED = "SIMSPEC_DEMANDED_ENGINES"
PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def requirements(extra: str) -> tuple[set[str], set[str]]:
    """Requirements of an extra: packages, and extras of simspec, itself among them."""
    packages, extras = set(), {extra}
    for line in PROJECT["optional-dependencies"][extra]:
        requirement = Requirement(line)
        if requirement.name != NAME:
            packages.add(requirement.name)
        for other in requirement.extras if requirement.name == NAME else ():
            more = requirements(other)
            packages |= more[0]
            extras |= more[1]
    return packages, extras


def demanded(words: str, known: Iterable[type[Engine]]) -> set[str]:
    """The names of the engines that have to be there. Raises ValueError for a word that is no engine's name."""
    everywhere = requirements("all")[1] | requirements("test")[1]
    by_name = {engine.NAME: engine for engine in known}
    named = {word.strip() for word in words.split(",")} - {""}
    if unknown := named - {"all", *by_name}:
        raise ValueError(f"{DEMANDED} names {', '.join(sorted(unknown))}; known: all, {', '.join(by_name)}")
    return {name for name, engine in by_name.items() if engine.EXTRA in everywhere or "all" in named or name in named}


_demanded = demanded(os.environ.get(DEMANDED, ""), engines().values())
LEFT_OUT = {
    name: not_installed(engine)
    for name, engine in engines().items()
    if name not in _demanded and engine.version() is None
}
"""The known engines that tests do without, each with the reason."""
INSTALLED = [name for name in engines() if name not in LEFT_OUT]
"""Every engine of this environment."""


def having(wanted: Callable[[type[Engine]], bool]) -> list[str]:
    """Those of which ``wanted`` is true."""
    return [name for name in INSTALLED if wanted(engines()[name])]


JOINTED = having(lambda engine: engine.SUPPORT[Feature.JOINT_HINGE].level is not Level.UNSUPPORTED)
"""Engines that have joints, which most worlds of tests need: the suites test the refusals of the other engines."""


def each(names: Iterable[str] | None = None) -> list[Any]:
    """Parameters of a test: the names of engines (default: all known ones), of which those that are left out are skipped."""
    return [
        pytest.param(name, marks=pytest.mark.skip(reason=f"{name}: {LEFT_OUT[name]}")) if name in LEFT_OUT else name
        for name in (engines() if names is None else names)
    ]
