"""Engines that may not be in one process: both bring a library of one name, and each would take the other's objects.

simspec gives every engine a process of its own. What loads engines itself is told here, before a process dies of it.
"""

from __future__ import annotations

import sys

from simspec.engines.kit.contract import Engine
from simspec.errors import EngineError

_LOADED: dict[str, type[Engine]] = {}
"""Engines that this process has loaded, whose libraries stay in it."""


def enter(engine: type[Engine]) -> None:
    """Count ``engine`` as loaded into this process. Raises EngineError where it clashes with what is in it."""
    for package, why in engine.CLASHES.items():
        if package in sys.modules:
            raise EngineError(engine.NAME, f"cannot be loaded into a process that has {package}: {why}")
    for other in _LOADED.values():
        why = other.CLASHES.get(engine.DISTRIBUTION, "")
        if why:
            raise EngineError(engine.NAME, f"cannot be loaded into a process that has the engine {other.NAME}: {why}")
    _LOADED[engine.NAME] = engine
