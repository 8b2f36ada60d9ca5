"""What is beyond the files of a world for the complete self-test: see ``dialects/kit/world_mutations.py``."""

from __future__ import annotations

from simspec.dialects.kit.law_defects import ADDED_LAW
from simspec.dialects.kit.mutations import Addition, Inert
from simspec.dialects.kit.world_mutations import INERTIAL, SYMMETRIC, WORLD, in_single_precision, table

NAMED = ("laws.*", "passive.gravity_scales.*", "passive.around.boxes.*")

WEIGHTLESS = "Rapier is told no mass properties of what has no mass"
APART = 0.1
"""What tumbles on a floor is then up to 3.9e-2 apart after 0.6 s (measured)."""

TABLE = table(
    {},
    (
        Addition("", "9.81", "strength"),
        Addition("settings", "true", "sleeping"),
        Addition("laws", ADDED_LAW),
        Addition("laws.*", "0.1", "adhesion"),
    ),
    (
        *(Inert(site, SYMMETRIC, ("swapped",), "sidecar.json") for site in NAMED),
        *(Inert(site, WEIGHTLESS, ("moved",), WORLD) for site in INERTIAL[1:]),
        *in_single_precision(APART),
    ),
)
