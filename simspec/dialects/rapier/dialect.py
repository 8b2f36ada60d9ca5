"""Rapier's dialect: ``world.json``, with the laws of materials in the sidecar, which a hook writes into every contact."""

from __future__ import annotations

from typing import ClassVar

from simspec.dialects.kit.world import LawDialect


class RapierDialect(LawDialect):
    """The world as JSON, and a table of laws."""

    NAME: ClassVar[str] = "rapier"
