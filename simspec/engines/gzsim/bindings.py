"""gz sim's Python bindings: where they are on this machine, and which of them simspec can import.

They come with gz sim itself, for one version of Python, and are no package of pip. This module has never run with them: all
that it calls follows from gz sim's documentation and the sources of its bindings (gz sim 8 to 10).
"""

from __future__ import annotations

import functools
import glob
import importlib
import os
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any, Final

from simspec.errors import EngineError

NAME: Final = "gzsim"
FOLDER: Final = "SIMSPEC_GZ_SIM"
"""The environment variable that names the folder in which the package ``gz`` lies, where simspec does not find it."""
USUAL: Final = (
    "/usr/lib/python3/dist-packages",
    "/usr/local/lib/python3/dist-packages",
    "/usr/lib/python",
    "/usr/local/lib/python",
    "/opt/ros/*/opt/gz_sim_vendor/lib/python",
)
COMPANIONS: Final[Mapping[str, tuple[str, str]]] = {
    "": ("gz.math", "sdformat"),
    "10": ("gz.math9", "sdformat16"),
    "9": ("gz.math8", "sdformat15"),
    "8": ("gz.math7", "sdformat14"),
}
"""By the number in the name of gz sim's module, the newest first: the modules of numbers and of SDF that its functions give."""
LIBRARIES: Final = ("/usr/lib/*-linux-gnu", "/usr/local/lib", "/opt/ros/*/opt/gz_sim_vendor/lib")
WANTED: Final = (
    "gz sim 8 (Harmonic) or newer with its Python bindings, for the version of Python that simspec runs in: in Python's path, "
    f"or in the folder that {FOLDER} names"
)
_MODULE = re.compile(r"sim(\d*)(\..+)?")


@dataclass(frozen=True)
class FoundBindings:
    """Bindings that lie in ``folder``, and the number in the name of their module."""

    folder: Path
    number: str
    file: Path

    @property
    def usable(self) -> bool:
        """Whether this Python can import them, and simspec knows what they are."""
        return self.number in COMPANIONS and (
            (self.file / "__init__.py").is_file()
            or self.file.name.removeprefix(f"sim{self.number}") in (".py", *EXTENSION_SUFFIXES)
        )


@dataclass(frozen=True)
class Bindings:
    """The modules that the engine works with."""

    sim: Any
    math: Any


def _folders() -> Iterator[Path]:
    named = os.environ.get(FOLDER)
    if named:
        yield Path(named)
        return
    yield from (Path(name) for name in sys.path if name)
    for pattern in USUAL:
        yield from (Path(path) for path in sorted(glob.glob(pattern), reverse=True))


@functools.cache
def _all() -> tuple[FoundBindings, ...]:
    found = []
    for folder in dict.fromkeys(_folders()):
        try:
            files = sorted((folder / "gz").iterdir())
        except OSError:
            continue  # no such folder, or one that is not the user's to read: it holds nothing for simspec
        for file in files:
            named = _MODULE.fullmatch(file.name)
            if named and (file.is_dir() or named.group(2)):
                found.append(FoundBindings(folder, named.group(1), file))
    return tuple(found)


def found() -> FoundBindings | None:
    """The newest bindings that this Python can import; None where there are none."""
    usable = {entry.number: entry for entry in reversed(_all()) if entry.usable}
    return next((usable[number] for number in COMPANIONS if number in usable), None)


def version() -> str | None:
    """The version of gz sim, by the name of its library, else the number of its bindings; None where it is not found."""
    there = found()
    if there is None:
        return None
    for pattern in LIBRARIES:
        for file in sorted(glob.glob(f"{pattern}/libgz-sim{there.number}.so.*.*.*")):
            return file.rpartition(".so.")[2]
    return there.number or "0 of no number"


def why_not() -> str:
    """Why simspec can use no gz sim of this machine."""
    others = [entry for entry in _all() if not entry.usable]
    if not others:
        return "no gz sim is found here"
    other = others[0]
    if other.number not in COMPANIONS:
        return f"{other.file} is of another gz sim"
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    return f"{other.file} is of another Python than this one, {here}"


class GzSimInstallation:
    """The gz sim of this machine."""

    def version(self) -> str | None:
        """Its version; None where there is none that could be imported."""
        return version()

    def lacking(self) -> EngineError | None:
        """Why it cannot be used; None where it can, as far as that is known without importing it."""
        return EngineError(NAME, why_not()) if found() is None else None


INSTALLED: Final = GzSimInstallation()


@functools.cache
def bindings() -> Bindings:
    """The bindings, imported. Raises EngineError where they are not there, not whole or not new enough."""
    there = found()
    if there is None:
        raise EngineError(NAME, f"not installed ({why_not()}): {WANTED}")
    if str(there.folder) not in sys.path:
        sys.path.append(str(there.folder))
    # servers of other processes, and of other machines, are not to be heard
    os.environ["GZ_PARTITION"] = f"simspec-{os.getpid()}"
    os.environ["GZ_IP"] = "127.0.0.1"
    name = f"gz.sim{there.number}"
    numbers, sdf = COMPANIONS[there.number]
    try:
        importlib.import_module(sdf)  # the types of joints and axes
        sim, math = importlib.import_module(name), importlib.import_module(numbers)
    except ImportError as error:
        raise EngineError(NAME, f"half installed: {name} at {there.file} cannot be imported ({error})") from error
    lacking = [
        f"{name}.{entry}" for entry in ("TestFixture", "World", "Model", "Link", "Joint") if not hasattr(sim, entry)
    ]
    if not lacking and not hasattr(sim.Link, "world_inertial"):
        lacking = [f"{name}.Link.world_inertial"]
    if lacking:
        raise EngineError(NAME, f"wrong version: there is no {', '.join(lacking)}, which newer ones have")
    return Bindings(sim, math)
