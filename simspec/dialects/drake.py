"""Drake's dialect: ``world.json``, which carries everything that Drake supports; and the defects of its self-test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import BELTS, GROUND, MARGINS, Plant
from simspec.dialects.kit.mutations import PASSIVE_BY_NAME, FileAddition, Inert, table
from simspec.dialects.kit.world import WorldDialect
from simspec.support import classes
from simspec.support.declarations import Table
from simspec.support.features import Feature


class DrakeDialect(WorldDialect):
    """The world and its contact plan as JSON."""

    NAME: ClassVar[str] = "drake"
    SUPPORT: ClassVar[Table] = {**WorldDialect.SUPPORT, Feature.JOINT_SEVERAL: classes.BETWEEN_JOINTS}


DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.DEFECTS,
    "mesh, margin": "Drake has no margin around hulls that touch at points, and no file has a number for one",
    **dict.fromkeys(MARGINS, "Drake's contact begins where shapes touch"),
    **dict.fromkeys(GROUND, "simspec gives Drake no height fields"),
    **dict.fromkeys(BELTS, "Drake's surfaces move with their bodies alone"),
    "hardness": "Drake has one hardness, by a rule of its own: no file has a number for it",
}

TABLE = table(
    {"contact_approximation": ("auto", "sap", "tamsi")},
    (
        FileAddition("", "9.81", "strength"),
        FileAddition("settings", "true", "sleeping"),
        FileAddition("settings", "true", "hydroelastic_faces"),
        FileAddition("settings", '"discrete"', "integrator"),
    ),
    (
        *PASSIVE_BY_NAME,
        Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json", within=1e-9),
    ),
)
