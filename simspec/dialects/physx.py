"""PhysX's dialect: ``world.json``, with the threshold of restitution, one for all pairs, in the sidecar."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import BELTS, GROUND, MARGINS, Plant
from simspec.dialects.kit.mutations import (
    INERTIAL,
    PASSIVE_BY_NAME,
    WORLD,
    FileAddition,
    Inert,
    in_single_precision,
    table,
)
from simspec.dialects.kit.sidecar import Sidecar, Target
from simspec.dialects.kit.world import WorldDialect, WorldSidecar
from simspec.formats.world import JsonWorld
from simspec.support import classes
from simspec.support.declarations import Refinement, Support, Table, unsupported_if
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws
from simspec.world.types import World


@dataclass(frozen=True, slots=True, kw_only=True)
class PhysxSidecar(WorldSidecar):
    """A sidecar with the threshold of restitution."""

    restitution_threshold: float
    """m/s: slower approaches do not bounce; 0 where nothing bounces."""

    def check(self) -> None:
        WorldSidecar.check(self)
        if not (math.isfinite(self.restitution_threshold) and self.restitution_threshold >= 0.0):
            raise ValueError("sidecar.restitution_threshold is no speed")


LARGEST_RESTITUTION = 0.8
"""The restitution up to which bodies at rest do not hop."""
LARGEST_HOP = 0.5
"""The largest threshold (m/s) that keeps bodies from hopping: after a fall of 13 mm a body bounces at any timestep."""


def threshold(world: World) -> float:
    """The threshold of restitution (m/s) for PhysX: the world's, or the speed up to which bodies at rest would hop.

    PhysX multiplies the speed of a step after adding gravity. In units of g dt, a body that leaves with u is in the air for
    up to ⌈2u⌉ steps, and arrives with less than u + 2 = e a + 2, the fall of the last step included: a < 2 / (1 − e).
    """
    laws = [law for law in meeting_laws(world).values() if law.restitution]
    if not laws:
        return 0.0
    largest = min(LARGEST_RESTITUTION, max(law.restitution for law in laws))
    hop = 2.0 / (1.0 - largest) * math.hypot(*world.physics.gravity) * world.physics.timestep
    return max(min(hop, LARGEST_HOP), *(law.restitution_threshold for law in laws))


def _single_threshold(world: World) -> Refinement | None:
    found = sorted({law.restitution_threshold for law in meeting_laws(world).values() if law.restitution})
    several = f"PhysX has one bounce threshold for each scene, and the pairs here have {', '.join(f'{x:g}' for x in found)} m/s"
    return unsupported_if(several if len(found) > 1 else None)


class PhysxDialect(WorldDialect):
    """The world and its contact plan as JSON, and the threshold."""

    NAME: ClassVar[str] = "physx"
    SUPPORT: ClassVar[Table] = {
        **WorldDialect.SUPPORT,
        Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS,
        Feature.RESTITUTION_THRESHOLD: Support(
            WorldDialect.SUPPORT[Feature.RESTITUTION_THRESHOLD].level,
            "PhysX has one bounce threshold for each scene",
            refine=_single_threshold,
        ),
    }
    SIDECAR: ClassVar[type[Sidecar]] = PhysxSidecar

    def fields(self, world: World, target: Target, document: JsonWorld) -> Mapping[str, Any]:
        return {"restitution_threshold": threshold(world)}


DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.DEFECTS,
    "torsional friction": "PhysX's contacts have no torque",
    "rolling friction": "PhysX's contacts have no torque",
    "hardness": "PhysX's contacts have the common hardness alone, without parameters",
    "mesh, margin": "simspec gives PhysX hulls without a margin, and no file has a number for one",
    **dict.fromkeys(MARGINS, "PhysX's contact begins where shapes touch"),
    **dict.fromkeys(GROUND, "simspec gives PhysX no height fields"),
    **dict.fromkeys(BELTS, "world.json has no surfaces that move by themselves"),
}

MASSLESS = "PhysX's static actors have no mass"
SPREAD = 1.0
"""PhysX sweeps contacts in the order in which it finds corners, and begins each step anew: a cube that lands flat leaves with
up to 0.72 rad/s more or less where its shape is turned within its symmetry, 3e-3 when it has come to rest (measured)."""

TABLE = table(
    {},
    (FileAddition("", "9.81", "strength"), FileAddition("settings", "true", "sleeping")),
    (
        *PASSIVE_BY_NAME,
        *(Inert(site, MASSLESS, ("moved", "scaled", "sign", "swapped"), WORLD) for site in INERTIAL),
        Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json"),
        *in_single_precision(SPREAD),
    ),
)
