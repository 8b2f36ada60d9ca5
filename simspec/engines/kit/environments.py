"""Versions of engines in environments of their own: made by simspec in the user's data folder, and found there by label.

A folder ``engines/NAME@VERSION`` is one environment, whole or begun (``outputs/begun.py``).
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from packaging.version import InvalidVersion, Version

from simspec.engines.kit.contract import Engine
from simspec.engines.kit.diagnosis import requirements
from simspec.engines.kit.identity import EngineId, parse
from simspec.engines.kit.installed import too_old
from simspec.engines.kit.registry import engines, find_engine
from simspec.engines.kit.released import package_of
from simspec.errors import EngineError, SpecError
from simspec.isolated import isolated
from simspec.outputs.begun import is_complete
from simspec.outputs.cache import data_folder, written_by_others

FOLDER: Final = "engines"
BESIDE: Final = ("numpy",)
"""What the worker needs in an engine's interpreter."""
LAWS: Final = "pin"
"""The extra of simspec for control laws that use the mass matrix, which run in the engine's process."""


def place_of(label: str) -> Path | None:
    """Where the environment of a label stands, made or not; None where the user has no data folder."""
    folder = data_folder(FOLDER)
    return None if folder is None else folder / label


def python_of(place: Path) -> Path:
    """The interpreter of an environment."""
    return place / "bin" / "python"


def environments() -> dict[str, str]:
    """The interpreters of every whole environment in the user's data folder, by label; none where others can write in it."""
    folder = data_folder(FOLDER)
    try:
        places = sorted(folder.iterdir()) if folder is not None and written_by_others(folder) is None else []
    except OSError:
        return {}  # there is no such folder, or it is not the user's to read: what is named and missing is told by label
    found = {place.name: str(python_of(place)) for place in places if _known(place.name) and is_complete(place) is True}
    # what is not installed here, and has its environment under the version that it names
    for name, engine in engines().items():
        label = EngineId(name, engine.APART).label
        if engine.APART and label in found and engine.version() is None:
            found[name] = found[label]
    return found


def _known(label: str) -> bool:
    try:
        engine = parse(label)
    except SpecError:
        return False
    return engine.name in engines() and bool(engine.version) and engine.label == label


def requirement(engine: type[Engine], version: str) -> str:
    """What pip is asked for, for the versions of an engine that a label means by ``version``. Raises EngineError where the
    engine comes with no package of Python, or ``version`` is no version of one."""
    if not engine.DISTRIBUTION:
        raise EngineError(engine.NAME, "comes with the machine, not with pip: it has one version there")
    try:
        wanted = Version(version)
    except InvalidVersion:
        raise EngineError(engine.NAME, f"{version!r} is not a version that pip knows") from None
    exact = wanted.is_prerelease or wanted.is_postrelease or wanted.local is not None
    return f"{package_of(engine, wanted)}=={version}" + ("" if exact else ".*")


def making(label: EngineId) -> list[list[str]]:
    """The commands that make the environment of a label. Raises EngineError where there can be none."""
    engine = find_engine(label.name)
    if (why := too_old(engine, label.version)) is not None:
        raise EngineError(label.label, why)
    place = place_of(label.label)
    if place is None:
        raise EngineError(label.label, "there is no home folder to keep it in: XDG_DATA_HOME can name another")
    if (why := written_by_others(place.parent)) is not None:
        raise EngineError(label.label, f"the folder {place.parent} is not used: {why}; XDG_DATA_HOME can name another")
    asked = requirement(engine, label.version)
    laws = [str(one).partition(";")[0].strip() for one in requirements(LAWS)]
    return [
        isolated("-m", "venv", str(place)),
        isolated("-m", "pip", "install", asked, *BESIDE, *engine.BESIDE, *laws, python=str(python_of(place))),
    ]
