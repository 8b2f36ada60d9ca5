"""The engines that installed packages offer (entry points ``simspec.engines``), and the labels that stand for them."""

from __future__ import annotations

import functools
import os
import re
import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simspec.errors import EngineError, Problem, SpecError
from simspec.plugins import Plugins

if TYPE_CHECKING:
    from simspec.engines.kit.contract import Engine


# A *label* stands for an engine everywhere: in options of the command line, runs, certificates and tables. ``NAME`` is what
# is installed here; ``NAME@3.8`` is version 3.8 of it, wherever that is.

MARK = "@"
VERSION = re.compile(r"[0-9][0-9A-Za-z.+_-]{0,39}")
"""The form of a version in a label: it is a part of folders' names."""


STATED = re.compile(r"(?=[^0-9]*[0-9])[0-9A-Za-z][0-9A-Za-z .+_~!-]{0,63}")
"""The form of an engine's version that an interpreter or a process states: it stands in tables, keys and certificates."""


@dataclass(frozen=True, slots=True)
class EngineId:
    """An engine by name; ``version`` is the beginning of its version (``3.8`` for 3.8.1) or empty for any; ``python`` is the
    interpreter that has it, None for this one."""

    name: str
    version: str = ""
    python: str | None = None

    @property
    def label(self) -> str:
        """The name, or name and version: ``NAME@3.8``."""
        return f"{self.name}{MARK}{self.version}" if self.version else self.name


def parse(word: str) -> EngineId:
    """The engine that a word of the command line names: ``NAME``, ``NAME@VERSION``, each with ``=PYTHON`` or without. Raises
    SpecError for what is no version."""
    label, equals, python = word.partition("=")
    name, mark, version = label.partition(MARK)
    if (mark and not VERSION.fullmatch(version)) or (equals and not python) or not name:
        raise SpecError(
            [Problem(f"{word!r} contains no engine name", allowed="NAME, NAME@VERSION, NAME@VERSION=/path/to/python")]
        )
    return EngineId(name, version, python if equals else None)


def program_of(python: str) -> str:
    """The path that starts the interpreter ``python`` from any folder: a name alone is sought on the path, as a shell does."""
    return os.path.abspath(python) if os.sep in python else shutil.which(python) or python


def engine_name(label: str) -> str:
    """The name of the engine that a label stands for."""
    return label.partition(MARK)[0]


def engine_version(label: str) -> str:
    """The version that a label names, or its beginning; empty where it names none."""
    return label.partition(MARK)[2]


def other_version(label: str, version: str) -> str | None:
    """Why an engine of ``version`` is not what its label says; None when it is."""
    wanted = engine_version(label)
    if not wanted or re.match(re.escape(wanted) + r"(?![0-9A-Za-z])", version):
        return None
    way = f"simspec engines install {label} makes an environment with it"
    return (
        f"is version {version}, not {wanted}; {way}, --engine {label}=/path/to/python names an interpreter that has it"
    )


def demand_version(label: str, version: str) -> None:
    """Raise EngineError where an engine that is at work is not of the version that its label says."""
    if (why := other_version(label, version)) is not None:
        raise EngineError(label, why)


DECLARED = ("NAME", "DIALECT", "DISTRIBUTION", "EXTRA", "SUPPORT", "SETTINGS", "RULES", "LAYERS")
"""Required attributes of an engine's class."""


def _sound(name: str, engine: Any) -> type[Engine]:
    """The engine, if it is one that can be used. Raises TypeError, ValueError."""
    from simspec.dialects.kit.contract import dialects
    from simspec.engines.kit.contract import Engine

    if not (isinstance(engine, type) and issubclass(engine, Engine)):
        raise TypeError("it is not an Engine")
    missing = [word for word in DECLARED if not hasattr(engine, word)]
    if missing:
        raise ValueError(f"it does not define {', '.join(missing)}")
    if name != engine.NAME:
        raise ValueError(f"its NAME is {engine.NAME!r}")
    if engine.DIALECT not in dialects():
        raise ValueError(f"its DIALECT is {engine.DIALECT!r}, which is not a dialect")
    dialects()[engine.DIALECT].check_declared(engine.SETTINGS)
    engine.version()
    return engine


@functools.cache
def engines() -> Plugins[type[Engine]]:
    """Every known engine by name (entry points ``simspec.engines``), installed or not."""
    return Plugins("simspec.engines", _sound)


def format_of(engine: type[Engine]) -> str:
    """The name of the format that an engine reads."""
    from simspec.dialects.kit.contract import dialects

    return dialects()[engine.DIALECT].FORMAT


def find_engine(name: str) -> type[Engine]:
    """The engine that a name or label (``identity.py``) stands for. Raises EngineError naming the known ones."""
    found = engines().get(engine_name(name))
    if found is None:
        why = engines().broken().get(engine_name(name))
        raise EngineError(name, why or f"no such engine; known: {', '.join(engines())}")
    return found
