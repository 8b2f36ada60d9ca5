"""ODE's dialect: ``world.json``, with the laws of materials in the sidecar; and the defects of its self-test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import GROUND, MARGINS, Plant
from simspec.dialects.kit.mutations import INERTIAL, PASSIVE_BY_NAME, SYMMETRIC, WORLD, FileAddition, Inert, table
from simspec.dialects.kit.world import LawDialect
from simspec.dialects.kit.world_defects import ADDED_LAW


class OdeDialect(LawDialect):
    """The world as JSON, and a table of laws."""

    NAME: ClassVar[str] = "ode"


DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.LAW_DEFECTS,
    "hardness": "ODE's contacts have only the common hardness, which has no parameters",
    **dict.fromkeys(GROUND, "simspec gives ODE no height fields"),
    "mesh, margin": "ODE has no margin around hulls, and no file has a number for one",
    **dict.fromkeys(MARGINS, "ODE's contact begins where shapes touch"),
}

BODILESS = "ODE has no body for what cannot move or has no mass"

TABLE = table(
    {"solver": ("step", "quick-step")},
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
        Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json", within=1e-9),
        *(Inert(site, BODILESS, ("moved", "scaled", "sign", "swapped"), WORLD) for site in INERTIAL),
    ),
)
