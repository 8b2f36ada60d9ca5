"""Rapier's dialect: ``world.json``, with the laws of materials in the sidecar, which a hook writes into every contact."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import GROUND, MARGINS, Plant
from simspec.dialects.kit.mutations import (
    INERTIAL,
    PASSIVE_BY_NAME,
    SYMMETRIC,
    WORLD,
    FileAddition,
    Inert,
    in_single_precision,
    table,
)
from simspec.dialects.kit.world import LawDialect
from simspec.dialects.kit.world_defects import ADDED_LAW


class RapierDialect(LawDialect):
    """The world as JSON, and a table of laws."""

    NAME: ClassVar[str] = "rapier"


DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.LAW_DEFECTS,
    "hardness": "Rapier's contacts have the common hardness alone, without parameters",
    **dict.fromkeys(GROUND, "simspec gives Rapier no height fields"),
    "mesh, margin": "Rapier's hulls are given without a margin, and no file has a number for one",
    **dict.fromkeys(MARGINS, "Rapier's contact begins where shapes touch"),
}

WEIGHTLESS = "simspec gives Rapier no mass properties of massless bodies"
SPREAD = 0.1
"""Bodies that tumble on a floor then differ by up to 3.9e-2 after 0.6 s (measured)."""

TABLE = table(
    {},
    (
        FileAddition("", "9.81", "strength"),
        FileAddition("settings", "true", "sleeping"),
        FileAddition("settings", "true", "native_motion"),
        FileAddition("laws", ADDED_LAW),
        FileAddition("laws.*", "0.1", "adhesion"),
    ),
    (
        Inert("laws.*", SYMMETRIC, ("swapped",), "sidecar.json"),
        *PASSIVE_BY_NAME,
        *(Inert(site, WEIGHTLESS, ("moved",), WORLD) for site in INERTIAL[1:]),
        *in_single_precision(SPREAD),
    ),
)
