"""The distribution that contains simspec: its name on package indexes, its version and its requirements.

A checkout that is used without an installation, or with one of an earlier commit, is described by its pyproject.toml.
"""

from __future__ import annotations

import functools
import importlib.metadata
from collections.abc import Mapping
from pathlib import Path
from typing import Any

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
