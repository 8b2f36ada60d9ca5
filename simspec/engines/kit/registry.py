"""The engines that installed packages offer (entry points ``simspec.engines``)."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from simspec.engines.kit.contract import Engine
from simspec.engines.kit.identity import engine_name
from simspec.errors import EngineError
from simspec.plugins import Offered, offered

DECLARED = ("NAME", "DIALECT", "DISTRIBUTION", "EXTRA", "SUPPORT", "SETTINGS", "RULES", "LAYERS")
"""What an engine's class must say."""


@functools.cache
def _offered() -> Offered:
    return offered("simspec.engines", _sound)


def _sound(name: str, engine: Any) -> type[Engine]:
    """The engine, if it is one that can be used. Raises TypeError, ValueError."""
    from simspec.dialects.kit.contract import dialects

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


def engines() -> Mapping[str, type[Engine]]:
    """Every known engine by name (entry points ``simspec.engines``), installed or not."""
    return _offered().good


def format_of(engine: type[Engine]) -> str:
    """The name of the format that an engine reads."""
    from simspec.dialects.kit.contract import dialects

    return dialects()[engine.DIALECT].FORMAT


def broken_engines() -> Mapping[str, str]:
    """The engines that are offered and cannot be used, with the reason."""
    return _offered().broken


def find_engine(name: str) -> type[Engine]:
    """The engine that a name or label (``identity.py``) stands for. Raises EngineError naming the known ones."""
    found = engines().get(engine_name(name))
    if found is None:
        why = broken_engines().get(engine_name(name))
        raise EngineError(name, why or f"no such engine; known: {', '.join(engines())}")
    return found
