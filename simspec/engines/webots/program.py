"""The Webots that is installed: where it is, of which version, and what of it is missing."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path
from typing import Final

from simspec.engines.kit.needs import Needs
from simspec.errors import EngineError
from simspec.reading import NotReadableError

NAME: Final = "webots"
HOME: Final = "WEBOTS_HOME"
USUAL: Final = ("/usr/local/webots", "/snap/webots/current/usr/share/webots", "/Applications/Webots.app/Contents")
"""Where installers put it."""
FIRST: Final = "R2023b"
"""The first version that has every field that is written."""
VERSION_FILE: Final = Path("resources/version.txt")
CONTROLLER: Final = Path("lib/controller/python/controller/__init__.py")
VERSION: Final = re.compile(r"R\d{4}[a-z](?:-rev\d+)?")
ELSEWHERE: Final = (
    f"install Webots {FIRST} or later from cyberbotics.com, and set {HOME} to its folder or put webots on the PATH"
)


def home() -> Path | None:
    """The folder of the Webots to be used: of ``WEBOTS_HOME``, else of the program on the PATH, else a usual one; None where
    there is none."""
    named = os.environ.get(HOME)
    if named:
        return Path(named)
    on_path = shutil.which("webots")
    if on_path is not None:
        return Path(os.path.realpath(on_path)).parent
    return next((Path(place) for place in USUAL if (Path(place) / VERSION_FILE).is_file()), None)


def executable(place: Path) -> Path:
    """The program in a folder of Webots."""
    return place / "webots"


def look() -> tuple[str | None, tuple[EngineError, ...]]:
    """The version of the Webots that is there, None where none says so; and what is missing or wrong of it."""
    place = home()
    if place is None:
        return None, (EngineError(NAME, f"no program webots: {HOME} is not set, and none is on the PATH"),)
    if not place.is_dir():
        return None, (EngineError(NAME, f"{HOME} is {str(place)!r}, which is no folder"),)
    lacking = []
    if not os.access(executable(place), os.X_OK) or not executable(place).is_file():
        lacking.append(f"{executable(place)} is no program")
    version = None
    try:
        with (place / VERSION_FILE).open("rb") as file:
            told = file.read(100).decode("utf-8", "replace").strip()
    except (OSError, NotReadableError) as error:
        lacking.append(f"{place / VERSION_FILE} cannot be read: {getattr(error, 'strerror', None) or error}")
    else:
        if VERSION.fullmatch(told) is None:
            lacking.append(f"{place / VERSION_FILE} says {told[:60]!r}, which is no version of Webots")
        else:
            version = told
            if told[: len(FIRST)] < FIRST:
                lacking.append(
                    f"Webots {told} is installed: {FIRST} or later is needed, which has all fields of the files"
                )
    if not (place / CONTROLLER).is_file():
        lacking.append(f"{place / CONTROLLER} is missing: the Python package that controls robots")
    return version, tuple(EngineError(NAME, why) for why in lacking)


NEEDS: Final = Needs(elsewhere=ELSEWHERE, look=look)
