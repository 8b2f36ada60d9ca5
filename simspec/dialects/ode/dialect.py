"""ODE's dialect: ``world.json``, with the laws of materials, which ODE is passed at every point of contact, in the sidecar."""

from __future__ import annotations

from typing import ClassVar

from simspec.dialects.kit.world import LawDialect


class OdeDialect(LawDialect):
    """The world as JSON, and a table of laws."""

    NAME: ClassVar[str] = "ode"
