"""Folders that travel with simspec: templates and the scenario library, in the wheel or beside the source."""

from __future__ import annotations

from pathlib import Path

from simspec.errors import Problem, SpecError
from simspec.reading import kind

_PACKAGE = Path(__file__).resolve().parent


def resource_folder(name: str) -> Path:
    """The folder ``name`` ("templates", "specs"): inside the installed package, or at the repository's top.

    Raises FileNotFoundError when neither exists (a broken installation).
    """
    for folder in (_PACKAGE / "_resources" / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"simspec's folder {name!r} is missing: the installation is incomplete")


LIBRARY = ("*.yaml", "contact/*.yaml")
"""Where the library's scenarios are below ``specs``; the others there are models."""


def find_spec(name: str) -> Path:
    """The file of a spec: a path, or the name of a scenario of the library that is shipped with simspec.

    Raises SpecError naming the library when there is neither.
    """
    path = Path(name)
    if path.is_file():
        return path
    folder = resource_folder("specs")
    library = {found.stem: found for part in LIBRARY for found in sorted(folder.glob(part))}
    if name in library:
        return library[name]
    import difflib

    near = difflib.get_close_matches(path.stem, library, 1)
    try:
        there: str | None = kind(path.stat().st_mode)
    except (OSError, ValueError):  # nothing is there, or nothing can be: a name too long, or with a zero byte
        there = None
    what = f"is {there}, not a spec" if there else "no such file, and no such scenario in the library"
    raise SpecError(
        [
            Problem(
                f"{name}: {what}",
                allowed=f"a YAML file, or one of {', '.join(library)}",
                hint=f"did you mean {near[0]!r}?" if near else None,
            )
        ]
    )
