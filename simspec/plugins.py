"""Parts that packages offer by entry points: one that is broken is reported, and is nobody else's problem.

simspec's own come by the same way. Offered code runs when it is imported: what it raises then, whatever it is, makes it broken.
"""

from __future__ import annotations

import functools
import importlib.metadata
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

OWN = "simspec"


@dataclass(frozen=True)
class Offered:
    """What is offered for one purpose: by name what can be used, and why the others cannot."""

    good: dict[str, Any]
    broken: dict[str, str]


def offered(group: str, check: Callable[[str, Any], Any]) -> Offered:
    """Everything that installed packages offer as ``group``, sorted by name.

    ``check`` is given the name and what was loaded; it returns what is to be used, and raises where that is none. Of
    two of one name simspec's own counts, else the first.
    """
    good: dict[str, Any] = {}
    broken: dict[str, str] = {}
    points = [*importlib.metadata.entry_points(group=group)]
    known = {point.name for point in points if _distribution(point) == OWN}
    points += [
        importlib.metadata.EntryPoint(name, value, group)
        for name, value in _checkout().get(group, {}).items()
        if name not in known
    ]
    for point in sorted(points, key=lambda one: (one.name, _distribution(one) != OWN, one.value)):
        if point.name in good:
            broken[f"{point.name} ({_distribution(point)})"] = f"the name is already used: {point.value} is ignored"
            continue
        try:
            good[point.name] = check(point.name, point.load())
        except (Exception, SystemExit) as error:  # it is somebody else's code: it may raise anything
            why = f"{type(error).__name__}: {error}"
            broken[point.name] = f"{point.value} of {_distribution(point) or 'no package'} cannot be used: {why}"
    return Offered(good, broken)


def _distribution(point: importlib.metadata.EntryPoint) -> str:
    found = getattr(point, "dist", None)
    return str(found.name) if found is not None else ""


@functools.cache
def _checkout() -> Mapping[str, Mapping[str, str]]:
    """The entry points of the checkout that this is, by group: an installation for development knows those of the day when it
    was made. Empty where simspec is installed otherwise."""
    try:
        content = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    project = content.get("project", {})
    found: Mapping[str, Mapping[str, str]] = project.get("entry-points", {}) if project.get("name") == OWN else {}
    return found
