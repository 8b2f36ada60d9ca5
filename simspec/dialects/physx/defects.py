"""Defects planted into ``world.json`` as PhysX's engine reads it."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import BELTS, GROUND, MARGINS, Plant
from simspec.dialects.kit.mutations import INERTIAL, SYMMETRIC, WORLD, Addition, Inert, in_single_precision, table

DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.DEFECTS,
    "free armature": "PhysX has no armature of free bodies",
    "ball armature": "PhysX has no armature of balls",
    "torsional friction": "PhysX's contacts have no torque",
    "rolling friction": "PhysX's contacts have no torque",
    "hardness": "PhysX's contacts have the common hardness alone, which has no numbers",
    "mesh, margin": "simspec tells PhysX hulls without a margin, and no file has a number for one",
    **dict.fromkeys(MARGINS, "PhysX's contact begins where shapes touch"),
    **dict.fromkeys(GROUND, "simspec gives PhysX no height fields"),
    **dict.fromkeys(BELTS, "world.json has no surfaces that move by themselves"),
}

# The complete self-test; see ``dialects/kit/mutations.py``.

NAMED = ("passive.gravity_scales.*", "passive.around.boxes.*")
MASSLESS = "PhysX's static actors have no mass"
APART = 1.0
"""PhysX sweeps contacts in the order in which it finds corners, and begins each step anew: a cube that lands flat leaves with
up to 0.72 rad/s more or less where its shape is turned within its symmetry, 3e-3 when it has come to rest (measured)."""

TABLE = table(
    {},
    (
        Addition("", "9.81", "strength"),
        Addition("settings", "true", "sleeping"),
    ),
    (
        *(Inert(site, SYMMETRIC, ("swapped",), "sidecar.json") for site in NAMED),
        *(Inert(site, MASSLESS, ("moved", "scaled", "sign", "swapped"), WORLD) for site in INERTIAL),
        *in_single_precision(APART),
    ),
)
