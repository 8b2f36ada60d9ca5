"""Why something is accepted or computed outside an engine, in one line, with the place where all of it is said."""

from __future__ import annotations

from simspec.engines.kit.identity import engine_name
from simspec.engines.kit.registry import engines
from simspec.report.matrix import anchor, support
from simspec.support.declarations import Level
from simspec.support.features import Feature

PAGE = "docs/reference/support-matrix.md"


def link(engine: str, feature: str) -> str:
    """Where the support matrix says how ``engine``, a name or a label, has ``feature``."""
    return f"{PAGE}#{anchor(engine_name(engine), feature)}"


def short_reason(engine: str, feature: str, said: str) -> str:
    """A certificate's entry (``LEVEL: reason``) in one line: what the engine's declaration says in short.

    The entry itself where that is no longer there: a certificate may be older than the engine.
    """
    level, _, how = said.partition(": ")
    engine = engine_name(engine)
    if engine not in engines() or feature not in list(Feature) or level not in list(Level):
        return said
    return support(engines()[engine])[Feature(feature)].brief(Level(level)) or how
