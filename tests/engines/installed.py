"""The engines that tests of this folder run in: those that are installed, chosen by what they declare."""

from __future__ import annotations

from collections.abc import Callable

from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import engines

INSTALLED = [name for name, engine in engines().items() if engine.version() is not None]
"""Every engine of this environment."""


def having(wanted: Callable[[type[Engine]], bool]) -> list[str]:
    """Those of which ``wanted`` is true."""
    return [name for name in INSTALLED if wanted(engines()[name])]
