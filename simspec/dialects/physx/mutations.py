"""What is beyond the files of a world for the complete self-test: see ``dialects/kit/world_mutations.py``."""

from __future__ import annotations

from simspec.dialects.kit.mutations import Addition, Inert
from simspec.dialects.kit.world_mutations import INERTIAL, SYMMETRIC, WORLD, in_single_precision, table

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
