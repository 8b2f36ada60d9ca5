"""How a world is told to PhysX: as ``world.json``, with the threshold of restitution, one for all pairs, in the sidecar."""

from __future__ import annotations

import math
from typing import ClassVar

from simspec.dialects.kit.contract import Dialect, Lowered
from simspec.dialects.kit.sidecar import Sidecar, common_fields
from simspec.dialects.kit.target import Target
from simspec.dialects.kit.world_document import world_document
from simspec.dialects.physx.sidecar import PhysxSidecar
from simspec.formats.world.format import WorldJson
from simspec.formats.world.tree import Document
from simspec.support.declarations import LUMPED, Refinement, Support, Table, unsupported_if
from simspec.support.features import Feature
from simspec.world.meeting import meeting_laws
from simspec.world.types import ReadBack, World


def thresholds(world: World) -> list[float]:
    """The different thresholds of restitution (m/s) of what meets and bounces, in order."""
    return sorted({law.restitution_threshold for law in meeting_laws(world).values() if law.restitution})


LIVELIEST = 0.8
"""The restitution up to which what rests does not hop."""
FASTEST_HOP = 0.5
"""m/s up to which that is so: what falls from 13 mm bounces at any timestep."""


def threshold(world: World) -> float:
    """The speed (m/s) below which PhysX is told that nothing bounces: the world's, or that up to which what rests would hop.

    PhysX multiplies a step's speed after gravity was added. In units of g dt: a body that leaves with u stays in the air for up
    to ⌈2u⌉ steps, and the fall of the step in which it arrives makes the approach less than u + 2 = e a + 2: a < 2 / (1 − e).
    """
    laws = [law for law in meeting_laws(world).values() if law.restitution]
    if not laws:
        return 0.0
    livelier = min(LIVELIEST, max(law.restitution for law in laws))
    hop = 2.0 / (1.0 - livelier) * math.hypot(*world.physics.gravity) * world.physics.timestep
    return max(min(hop, FASTEST_HOP), *(law.restitution_threshold for law in laws))


def _one_threshold(world: World) -> Refinement | None:
    found = thresholds(world)
    several = f"PhysX has one threshold for all that bounces, and the pairs here have {', '.join(f'{x:g}' for x in found)} m/s"
    return unsupported_if(several if len(found) > 1 else None)


class PhysxDialect(Dialect):
    """The world and its contact plan as JSON, and the threshold."""

    NAME: ClassVar[str] = "physx"
    FORMAT: ClassVar[str] = "world"
    SUPPORT: ClassVar[Table] = {
        **WorldJson.SUPPORT,
        **LUMPED,
        Feature.RESTITUTION_THRESHOLD: Support(
            WorldJson.SUPPORT[Feature.RESTITUTION_THRESHOLD].level,
            "one for all pairs that bounce",
            refine=_one_threshold,
        ),
    }
    SIDECAR: ClassVar[type[Sidecar]] = PhysxSidecar

    def lower(self, world: World, target: Target) -> Lowered:
        """The document of ``world`` with the copies of the target's plan, and its sidecar."""
        document, offsets = world_document(world, target)
        fields = common_fields(self.NAME, self.FORMAT, world, target, offsets)
        return Lowered(document, PhysxSidecar(**fields, restitution_threshold=threshold(world)))

    def raise_(self, document: Document, sidecar: PhysxSidecar) -> ReadBack:
        """See ``dialects/kit/world_model.py``."""
        from simspec.dialects.kit.world_model import world_model

        return world_model(document, sidecar)
