"""Plug-ins: engines, dialects, formats and importers that packages provide by entry points.

simspec's plug-ins come the same way, and are trusted to be usable: they are listed by their entry points, and imported when
they are looked up. Plug-ins of other packages are imported and checked before they are listed; a broken one is reported by
``simspec engines`` and ignored otherwise. Code of other packages may raise anything when it is imported.
"""

from __future__ import annotations

import importlib
import importlib.metadata
from collections.abc import Callable, ItemsView, Iterator, Mapping, ValuesView
from importlib.metadata import EntryPoint
from typing import Any, Generic, TypeVar

from simspec.distribution import checkout

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
        if name in self._simspec and name not in self._loaded:
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
