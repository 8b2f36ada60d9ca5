"""How a world is told to ODE: as ``world.json``, with the laws of materials in the sidecar, since ODE is given a law at every
point of contact and combines nothing."""

from __future__ import annotations

from typing import ClassVar

from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.sidecar import Sidecar
from simspec.dialects.kit.target import Target
from simspec.dialects.kit.world_laws import LAW_SUPPORT, lowered, raised
from simspec.dialects.ode.sidecar import OdeSidecar
from simspec.formats.world.tree import Document
from simspec.support.declarations import Table
from simspec.world.types import ReadBack, World


class OdeDialect(Dialect):
    """The world as JSON, and a table of laws."""

    NAME: ClassVar[str] = "ode"
    FORMAT: ClassVar[str] = "world"
    SUPPORT: ClassVar[Table] = LAW_SUPPORT
    SIDECAR: ClassVar[type[Sidecar]] = OdeSidecar

    def lower(self, world: World, target: Target) -> Lowered:
        return lowered(self, OdeSidecar, world, target)

    def raise_(self, document: Document, sidecar: OdeSidecar) -> ReadBack:
        return raised(document, sidecar)
