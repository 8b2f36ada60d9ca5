"""Defects planted into ``world.json`` as Drake reads it."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import BELTS, GROUND, MARGINS, Plant
from simspec.dialects.kit.mutations import Addition, Inert, table

DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.DEFECTS,
    "free armature": "Drake has no armature of free bodies",
    "ball armature": "Drake has no armature of balls",
    "mesh, margin": "Drake has no margin around hulls that touch at points, and no file has a number for one",
    **dict.fromkeys(MARGINS, "Drake's contact begins where shapes touch"),
    **dict.fromkeys(GROUND, "simspec gives Drake no height fields"),
    **dict.fromkeys(BELTS, "Drake's surfaces move with their bodies alone"),
    "hardness": "Drake has one hardness, by a rule of its own: no file has a number for it",
}

# The complete self-test; see ``dialects/kit/mutations.py``.

TABLE = table(
    {"contact_approximation": ("auto", "sap", "tamsi")},
    (
        Addition("", "9.81", "strength"),
        Addition("settings", "true", "sleeping"),
        Addition("settings", "true", "hydroelastic_faces"),
    ),
    (Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json", within=1e-9),),
)
