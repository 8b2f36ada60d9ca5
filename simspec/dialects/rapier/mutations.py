"""What is beyond the files of a world for the complete self-test: see ``dialects/kit/world_mutations.py``."""

from __future__ import annotations

from simspec.dialects.kit.law_defects import ADDED_LAW
from simspec.dialects.kit.mutations import Addition, Inert
from simspec.dialects.kit.world_mutations import SYMMETRIC, table

NAMED = ("laws.*", "passive.gravity_scales.*", "passive.around.boxes.*")

TABLE = table(
    {},
    (
        Addition("", "9.81", "strength"),
        Addition("settings", "true", "sleeping"),
        Addition("laws", ADDED_LAW),
        Addition("laws.*", "0.1", "adhesion"),
    ),
    tuple(Inert(site, SYMMETRIC, ("swapped",), "sidecar.json") for site in NAMED),
)
