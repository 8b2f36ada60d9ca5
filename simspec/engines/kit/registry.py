"""The engines that installed packages offer (entry points ``simspec.engines``)."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

from simspec.engines.kit.identity import engine_name
from simspec.errors import EngineError
from simspec.plugins import Plugins

if TYPE_CHECKING:
    from simspec.engines.kit.contract import Engine

DECLARED = ("NAME", "DIALECT", "DISTRIBUTION", "EXTRA", "SUPPORT", "SETTINGS", "RULES", "LAYERS")
"""What an engine's class must say."""


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
