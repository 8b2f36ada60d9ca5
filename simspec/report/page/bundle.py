"""The page's program and style, as npm and esbuild made them of ``page/src`` (``make page-bundle``)."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from simspec.resources import resource_folder

LIBRARIES = ("three", "uplot")
"""What the program contains of others, each with its licence beside it."""


@dataclass(frozen=True)
class Bundle:
    """Script and style sheet, and the licences of the libraries in them, by name."""

    script: str
    style: str
    licences: dict[str, str]


@functools.cache
def bundle() -> Bundle:
    """The committed bundle. Raises FileNotFoundError where the installation is incomplete."""
    folder = resource_folder("page") / "bundle"
    read = {name: (folder / name).read_text(encoding="utf-8") for name in ("report.js", "report.css")}
    licences = {name: (folder / f"LICENSE-{name}.txt").read_text(encoding="utf-8") for name in LIBRARIES}
    return Bundle(read["report.js"], read["report.css"], licences)
