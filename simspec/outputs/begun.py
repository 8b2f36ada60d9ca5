"""Folders that other programs fill for simspec: a file in each says that simspec began it, and whether it is whole.

One that broke off is not used, and is begun anew; a folder without that file is nobody's to touch.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Final

BEGUN: Final = "simspec-begun.json"
"""The file that says whose a folder is: ``{"name": NAME, "whole": true or false}``, with the folder's own name."""
MOST: Final = 10_000
"""Bytes of that file."""


def is_complete(place: Path) -> bool | None:
    """Whether the folder at ``place`` is whole; None: there is none that simspec began for this user."""
    try:
        with (place / BEGUN).open("rb") as stream:
            if os.fstat(stream.fileno()).st_uid not in (os.geteuid(), 0):
                return None  # a program of somebody else is not started unasked
            told = json.loads(stream.read(MOST))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(told, Mapping) or told.get("name") != place.name:
        return None
    return told.get("whole") is True


def begin(place: Path) -> None:
    """An empty folder at ``place``, in the place of one that simspec began before. Raises FileExistsError for what it did not
    begin, OSError."""
    if os.path.lexists(place):
        if is_complete(place) is None:
            raise FileExistsError(f"{place} exists, and simspec did not make it: move it away")
        shutil.rmtree(place)
    place.mkdir(parents=True)
    _mark(place, whole=False)


def finish(place: Path) -> None:
    """Say that the folder at ``place`` is whole. Raises OSError."""
    _mark(place, whole=True)


def _mark(place: Path, whole: bool) -> None:
    (place / BEGUN).write_text(json.dumps({"name": place.name, "whole": whole}) + "\n", encoding="utf-8")
