"""Plug-ins that packages provide by entry points, the distribution that contains simspec, and methods imported when used."""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
from collections.abc import Callable, ItemsView, Iterator, Mapping, ValuesView
from importlib.metadata import EntryPoint
from pathlib import Path
from types import MethodType
from typing import Any, Generic, TypeVar

# The distribution. A checkout that is used without an installation, or with one of an earlier commit, is described by its
# pyproject.toml.

NAME = "simspec-physics"
"""simspec itself is another project's name on the public index."""


@functools.cache
def checkout() -> Mapping[str, Any]:
    """The table ``project`` of the pyproject.toml of this checkout; empty where simspec is installed otherwise."""
    import tomllib  # only where it is needed: each process of an engine loads this module

    try:
        content = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    project: Mapping[str, Any] = content.get("project", {})
    return project if project.get("name") == NAME else {}


def installed_version(name: str) -> str | None:
    """The version of an installed distribution; None where it is not installed. Only the head of its metadata is read:
    ``importlib.metadata`` parses all of them, with descriptions of a thousand lines, at every call."""
    try:
        distribution = importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        return None
    head, _, _ = (distribution.read_text("METADATA") or "").partition("\n\n")
    version = next((line[9:].strip() for line in head.splitlines() if line.startswith("Version: ")), None)
    return version or distribution.version


@functools.cache
def simspec_version() -> str:
    """The version of simspec; reading it takes 10 ms. Raises PackageNotFoundError."""
    try:
        return importlib.metadata.version(NAME)
    except importlib.metadata.PackageNotFoundError:
        if checkout():
            return str(checkout()["version"])
        raise


def requirements() -> tuple[str, ...]:
    """The requirements of simspec, those of its extras marked as such. Raises PackageNotFoundError."""
    try:
        return tuple(importlib.metadata.requires(NAME) or ())
    except importlib.metadata.PackageNotFoundError:
        if not checkout():
            raise
    lines = list(checkout().get("dependencies", ()))
    for extra, listed in checkout().get("optional-dependencies", {}).items():
        for line in listed:
            name, _, marker = line.partition(";")
            lines.append(f'{name.strip()}; {f"{marker.strip()} and " if marker else ""}extra == "{extra}"')
    return tuple(lines)


# Plug-ins: engines, dialects, formats and importers. simspec's are trusted to be usable: they are listed by their entry points,
# and imported when they are looked up. Those of other packages are imported and checked before they are listed; a broken one is
# reported by ``simspec engines`` and ignored otherwise. Code of other packages may raise anything when it is imported.

SIMSPEC = "simspec"
Plugin = TypeVar("Plugin")


class Plugins(Mapping[str, Plugin], Generic[Plugin]):
    """The usable plug-ins of an entry-point group by name, sorted by name.

    ``check`` takes a name and the loaded object; it returns the plug-in, and raises where that is not usable. Of two plug-ins
    of one name simspec's counts, else the first.
    """

    def __init__(self, group: str, check: Callable[[str, Any], Plugin]):
        self._check = check
        self._loaded: dict[str, Plugin] = {}
        self._broken: dict[str, str] = {}
        found = [*importlib.metadata.entry_points(group=group)]
        self._simspec = {point.name: point for point in found if point.module.partition(".")[0] == SIMSPEC}
        for name, value in checkout().get("entry-points", {}).get(group, {}).items():
            self._simspec.setdefault(name, EntryPoint(name, value, group))
        self._others = [point for point in found if self._simspec.get(point.name) is not point]  # not loaded yet
        self._others.sort(key=lambda point: (point.name, point.value), reverse=True)

    def __getitem__(self, name: str) -> Plugin:
        if name not in self._loaded:
            if name in self._simspec:
                self._load(self._simspec[name])
            else:
                self._load_others()
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        if name not in self._simspec:
            self._load_others()
        return name in self._loaded or (name in self._simspec and name not in self._broken)

    def __iter__(self) -> Iterator[str]:
        self._load_others()
        return iter(sorted(({*self._simspec} - {*self._broken}) | {*self._loaded}))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def items(self) -> ItemsView[str, Plugin]:
        self._load_all()
        return super().items()

    def values(self) -> ValuesView[Plugin]:
        self._load_all()
        return super().values()

    def broken(self) -> Mapping[str, str]:
        """Why each of the other plug-ins cannot be used."""
        self._load_all()
        return self._broken

    def stated(self, name: str, attribute: str) -> Any:
        """An attribute of a plug-in; the package of a plug-in of simspec may state it, which saves importing the plug-in."""
        if name in self._simspec:
            package = importlib.import_module(self._simspec[name].module.rpartition(".")[0])
            if hasattr(package, attribute):
                return getattr(package, attribute)
        return getattr(self[name], attribute)

    def _load_all(self) -> None:
        for name in self._simspec:
            if name not in self._loaded and name not in self._broken:
                self._load(self._simspec[name])
        self._load_others()

    def _load_others(self) -> None:
        while self._others:
            point = self._others.pop()
            if point.name in self._simspec or point.name in self._loaded:
                self._broken[f"{point.name} ({_distribution(point)})"] = (
                    f"the name is already used: {point.value} is ignored"
                )
            else:
                self._load(point)

    def _load(self, point: EntryPoint) -> None:
        try:
            self._loaded[point.name] = self._check(point.name, point.load())
        except (Exception, SystemExit) as error:
            why = f"{type(error).__name__}: {error}"
            self._broken[point.name] = f"{point.value} of {_distribution(point) or 'no package'} cannot be used: {why}"


def _distribution(point: EntryPoint) -> str:
    found = getattr(point, "dist", None)
    return str(found.name) if found is not None else ""


class Method:
    """A method of an early part of simspec whose function is in a later part, imported when it is used: no circle of imports.
    ``home``: its module and name; it takes the object first."""

    def __init__(self, home: str):
        self._module, _, self._name = home.partition(":")

    def __get__(self, instance: object, owner: type | None = None) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(importlib.import_module(self._module), self._name)
        return function if instance is None else MethodType(function, instance)
