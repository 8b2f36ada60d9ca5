"""Folders that travel with simspec: templates and the scenario library, in the wheel or beside the source."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def resource_folder(name: str) -> Path:
    """The folder ``name`` ("templates", "specs"): inside the installed package, or at the repository's top.

    Raises FileNotFoundError when neither exists (a broken installation).
    """
    for folder in (_PACKAGE / "_resources" / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"simspec's folder {name!r} is missing: this installation is incomplete")
