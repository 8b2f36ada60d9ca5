"""What is beyond the files of a world for the complete self-test: see ``dialects/kit/world_mutations.py``."""

from __future__ import annotations

from simspec.dialects.kit.mutations import Addition, Inert
from simspec.dialects.kit.world_mutations import INERTIAL, SYMMETRIC, WORLD, in_single_precision, table

NAMED = ("passive.gravity_scales.*", "passive.around.boxes.*")
MASSLESS = "PhysX's static actors have no mass"
APART = 0.1
"""As of the other engine of single precision: what tumbles on a floor parts by roundings."""

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
