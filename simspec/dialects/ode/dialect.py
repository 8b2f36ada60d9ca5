"""How a world is told to ODE: as ``world.json``, with the laws of materials in the sidecar, since ODE is given a law at every
point of contact and combines nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.sidecar import Sidecar, common_fields
from simspec.dialects.kit.target import Target
from simspec.dialects.kit.world_document import world_document
from simspec.dialects.ode.sidecar import OdeSidecar
from simspec.formats.world.format import WorldJson
from simspec.formats.world.tree import Document
from simspec.support.declarations import GATHERED, Table
from simspec.world.types import ReadBack, World


class OdeDialect(Dialect):
    """The world as JSON, and a table of laws."""

    NAME: ClassVar[str] = "ode"
    FORMAT: ClassVar[str] = "world"
    SUPPORT: ClassVar[Table] = {**WorldJson.SUPPORT, **GATHERED}
    SIDECAR: ClassVar[type[Sidecar]] = OdeSidecar

    def lower(self, world: World, target: Target) -> Lowered:
        """The document of ``world``, whose shapes have no numbers of their own, and its sidecar."""
        document, offsets = world_document(world, target)
        # those of the plan, which in a probe of two materials may have more than meet there
        every = {(law.first, law.second): law for law in world.contact.pairs}
        laws = tuple(every[one, other] for one, other, _ in document.meets)
        fields = common_fields(self.NAME, self.FORMAT, world, target, offsets)
        return Lowered(document, OdeSidecar(**fields, laws=laws))

    def raise_(self, document: Document, sidecar: OdeSidecar) -> ReadBack:
        """See ``dialects/kit/world_model.py``."""
        from simspec.dialects.kit.world_model import world_model

        return replace(world_model(document, sidecar), laws=sidecar.laws)
