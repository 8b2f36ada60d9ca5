"""Newton's dialect: ``world.json``, with the threshold of restitution, one for all pairs, in the sidecar."""

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
class NewtonSidecar(WorldSidecar):
    """A sidecar with the threshold of restitution."""

    restitution_threshold: float
    """m/s: slower approaches do not bounce; 0 where nothing bounces."""

    def check(self) -> None:
        WorldSidecar.check(self)
        if not (math.isfinite(self.restitution_threshold) and self.restitution_threshold >= 0.0):
            raise ValueError("sidecar.restitution_threshold is no speed")


def thresholds(world: World) -> list[float]:
    """The different thresholds of restitution (m/s) of pairs that bounce, in order."""
    return sorted({law.restitution_threshold for law in meeting_laws(world).values() if law.restitution})


def _single_threshold(world: World) -> Refinement | None:
    found = thresholds(world)
    several = f"Newton's solver has one restitution threshold, and the pairs here have {', '.join(f'{x:g}' for x in found)} m/s"
    return unsupported_if(several if len(found) > 1 else None)


class NewtonDialect(WorldDialect):
    """The world and its contact plan as JSON, and the threshold."""

    NAME: ClassVar[str] = "newton"
    SUPPORT: ClassVar[Table] = {
        **WorldDialect.SUPPORT,
        Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS,
        Feature.RESTITUTION_THRESHOLD: Support(
            WorldDialect.SUPPORT[Feature.RESTITUTION_THRESHOLD].level,
            "Newton's solver has one restitution threshold for all pairs",
            refine=_single_threshold,
        ),
    }
    SIDECAR: ClassVar[type[Sidecar]] = NewtonSidecar

    def fields(self, world: World, target: Target, document: JsonWorld) -> Mapping[str, Any]:
        return {"restitution_threshold": max(thresholds(world), default=0.0)}


DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.DEFECTS,
    "torsional friction": "Newton's contacts have no torque on a processor",
    "rolling friction": "Newton's contacts have no torque on a processor",
    "hardness": "simspec gives Newton's contacts the common hardness alone, without parameters",
    "mesh, margin": "simspec gives Newton hulls without a margin, and no file has a number for one",
    **dict.fromkeys(MARGINS, "simspec gives Newton no margins"),
    **dict.fromkeys(GROUND, "simspec gives Newton no height fields"),
    **dict.fromkeys(BELTS, "world.json has no surfaces that move by themselves"),
}

MASSLESS = "mass properties of bodies that cannot move have no effect in Newton"
SPREAD = 0.1

TABLE = table(
    {},
    (FileAddition("", "9.81", "strength"), FileAddition("settings", "true", "sleeping")),
    (
        *PASSIVE_BY_NAME,
        *(Inert(site, MASSLESS, ("moved", "scaled", "sign", "swapped"), WORLD) for site in INERTIAL),
        Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json", within=1e-4),
        *in_single_precision(SPREAD),
    ),
)
