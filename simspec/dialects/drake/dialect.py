"""How a world is told to Drake: as ``world.json``, whole, so that the sidecar has nothing of its own."""

from __future__ import annotations

from typing import ClassVar

from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.sidecar import Sidecar, common_fields
from simspec.dialects.kit.target import Target
from simspec.dialects.kit.world_document import world_document
from simspec.dialects.kit.world_sidecar import WorldSidecar
from simspec.formats.world.format import WorldJson
from simspec.formats.world.tree import Document
from simspec.support.declarations import BETWEEN_JOINTS, LUMPED, Table
from simspec.support.features import Feature
from simspec.world.types import ReadBack, World


class DrakeDialect(Dialect):
    """The world and its contact plan as JSON."""

    NAME: ClassVar[str] = "drake"
    FORMAT: ClassVar[str] = "world"
    SUPPORT: ClassVar[Table] = {**WorldJson.SUPPORT, **LUMPED, Feature.JOINT_SEVERAL: BETWEEN_JOINTS}
    SIDECAR: ClassVar[type[Sidecar]] = WorldSidecar

    def lower(self, world: World, target: Target) -> Lowered:
        """The document of ``world`` with the copies of the target's plan, and its sidecar."""
        document, offsets = world_document(world, target)
        return Lowered(document, WorldSidecar(**common_fields(self.NAME, self.FORMAT, world, target, offsets)))

    def raise_(self, document: Document, sidecar: WorldSidecar) -> ReadBack:
        """See ``dialects/kit/world_model.py``."""
        from simspec.dialects.kit.world_model import world_model

        return world_model(document, sidecar)
