"""What is beyond the files of a world for the complete self-test: see ``dialects/kit/world_mutations.py``."""

from __future__ import annotations

from simspec.dialects.kit.mutations import Addition, Inert
from simspec.dialects.kit.world_mutations import SYMMETRIC, table

NAMED = ("passive.gravity_scales.*", "passive.around.boxes.*")

TABLE = table(
    {},
    (
        Addition("", "9.81", "strength"),
        Addition("settings", "true", "sleeping"),
    ),
    tuple(Inert(site, SYMMETRIC, ("swapped",), "sidecar.json") for site in NAMED),
)
