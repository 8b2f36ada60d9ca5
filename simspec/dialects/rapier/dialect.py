"""How a world is told to Rapier: as ``world.json``, with the laws of materials in the sidecar, which a hook of
Rapier's gives every contact: what its shapes' numbers combine to is not used."""

from __future__ import annotations

from typing import ClassVar

from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.sidecar import Sidecar
from simspec.dialects.kit.target import Target
from simspec.dialects.kit.world_laws import LAW_SUPPORT, lowered, raised
from simspec.dialects.rapier.sidecar import RapierSidecar
from simspec.formats.world.tree import Document
from simspec.support.declarations import Table
from simspec.world.types import ReadBack, World


class RapierDialect(Dialect):
    """The world as JSON, and a table of laws."""

    NAME: ClassVar[str] = "rapier"
    FORMAT: ClassVar[str] = "world"
    SUPPORT: ClassVar[Table] = LAW_SUPPORT
    SIDECAR: ClassVar[type[Sidecar]] = RapierSidecar

    def lower(self, world: World, target: Target) -> Lowered:
        return lowered(self, RapierSidecar, world, target)

    def raise_(self, document: Document, sidecar: RapierSidecar) -> ReadBack:
        return raised(document, sidecar)
