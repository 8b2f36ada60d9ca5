"""An installed Webots: where it is, which version, and how it is started without a window.

What this relies on is in its guide: WEBOTS_HOME is the folder of an installation, whose version stands in
``resources/version.txt``; controllers that Webots does not start itself load ``lib/controller/libController.so``.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path
from typing import Final

from simspec.errors import EngineError

NAME: Final = "webots"
HOME: Final = "WEBOTS_HOME"
"""The environment variable that names the folder of an installation."""
PLACES: Final = (Path("/usr/local/webots"), Path("/snap/webots/current/usr/share/webots"))
"""Where its packages put it."""
PROGRAM, LIBRARY, VERSION_FILE = "webots", "lib/controller/libController.so", "resources/version.txt"
LEAST: Final = "R2023b"
"""The oldest version: the one of which the files are."""
VERSION: Final = re.compile(r"R(\d{4})([a-z])(?:[-. ]?rev(?:ision)? ?\d+)?", re.ASCII | re.IGNORECASE)
MOST_READ: Final = 200
"""Bytes of the file that holds the version."""
OPTIONS: Final = ("--batch", "--mode=fast", "--minimize", "--no-rendering", "--stdout", "--stderr", "--extern-urls")
"""No questions to a user, no waiting for real time, no pictures; what it and its controllers say, and the address of the
controller that it waits for, on the standard output."""
SCREEN: Final = ("xvfb-run", "-a")
"""Starts a program with a screen in memory."""


class Installed:
    """The Webots of this machine."""

    def version(self) -> str | None:
        """Its version, as ``R2025a``; None where there is none, or where it cannot be used."""
        try:
            return _version(_home())
        except EngineError:
            return None

    def lacking(self) -> EngineError | None:
        """Why it cannot be used; None where it can."""
        try:
            home = _home()
            _version(home)
            _screen()
        except EngineError as error:
            return error
        return None

    def command(self, world: Path, port: int) -> list[str]:
        """What starts it on a world. Raises EngineError where it cannot be used."""
        home = _home()
        _version(home)
        return [*_screen(), str(home / PROGRAM), *OPTIONS, f"--port={port}", str(world)]

    def library(self) -> Path:
        """The library of controllers. Raises EngineError where it cannot be used."""
        return _home() / LIBRARY

    def environment(self) -> dict[str, str]:
        """The environment of Webots and of its controller. Raises EngineError where it cannot be used."""
        # Webots makes a folder for its controllers below TMPDIR, and controllers look for it in /tmp
        environment = {name: value for name, value in os.environ.items() if name != "TMPDIR"}
        environment[HOME] = str(_home())
        environment.setdefault("USER", environment.get("LOGNAME", "simspec"))  # a part of that folder's name
        return environment


INSTALLED: Final = Installed()


def _home() -> Path:
    """The folder of the installation: that of the environment variable, of the program on the path, or a usual one."""
    if not sys.platform.startswith("linux"):
        raise EngineError(NAME, "simspec starts Webots on Linux alone")
    named = os.environ.get(HOME)
    if named:
        return _whole(Path(named), f"{HOME} names {named}, which")
    found = shutil.which(PROGRAM)
    if found is not None and _is_home(home := Path(found).resolve().parent):
        return _whole(home, f"{home}, whose webots is on the path,")
    for place in PLACES:
        if _is_home(place):
            return _whole(place, str(place))
    raise EngineError(NAME, f"there is none: no webots on the path, and {HOME} is not set")


def _is_home(place: Path) -> bool:
    return (place / VERSION_FILE).is_file()


def _whole(home: Path, what: str) -> Path:
    for part in (VERSION_FILE, PROGRAM, LIBRARY):
        if not (home / part).is_file():
            raise EngineError(NAME, f"{what} has no {part}")
    if not os.access(home / PROGRAM, os.X_OK):
        raise EngineError(NAME, f"{what} has a {PROGRAM} that cannot be executed")
    return home.resolve()


def _version(home: Path) -> str:
    file = home / VERSION_FILE
    try:
        with open(file, "rb") as opened:
            text = opened.read(MOST_READ).decode("ascii", errors="replace").strip()
    except OSError as error:
        raise EngineError(NAME, f"{file}: {error.strerror}") from None
    found = VERSION.fullmatch(text)
    if found is None:
        raise EngineError(NAME, f"{file} should have a version like {LEAST}, and has {text[:40]!r}")
    version = f"R{found[1]}{found[2].lower()}"
    if version < LEAST:
        raise EngineError(NAME, f"{home} is {version}: simspec writes worlds of {LEAST}, which it does not read")
    return version


def _screen() -> tuple[str, ...]:
    """What Webots is started by for the screen that it needs, though nothing is drawn."""
    if os.environ.get("DISPLAY"):
        return ()
    if shutil.which(SCREEN[0]) is None:
        why = f"there is no screen (DISPLAY is not set), and no {SCREEN[0]}, which makes one in memory"
        raise EngineError(NAME, f"{why}: apt-get install xvfb")
    return SCREEN
