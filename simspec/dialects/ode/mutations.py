"""What is beyond the files of a world for the complete self-test: see ``dialects/kit/world_mutations.py``."""

from __future__ import annotations

from simspec.dialects.kit.law_defects import ADDED_LAW
from simspec.dialects.kit.mutations import Addition, Inert
from simspec.dialects.kit.world_mutations import INERTIAL, SYMMETRIC, WORLD, table

BODILESS = "ODE has no body for what cannot move or has no mass"

NAMED = ("laws.*", "passive.gravity_scales.*", "passive.around.boxes.*")

TABLE = table(
    {"solver": ("step", "quick-step")},
    (
        Addition("", "9.81", "strength"),
        Addition("settings", "true", "sleeping"),
        Addition("settings", "true", "native_motion"),
        Addition("laws", ADDED_LAW),
        Addition("laws.*", "0.1", "adhesion"),
    ),
    (
        *(Inert(site, SYMMETRIC, ("swapped",), "sidecar.json") for site in NAMED),
        Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json", within=1e-9),
        *(Inert(site, BODILESS, ("moved", "scaled", "sign", "swapped"), WORLD) for site in INERTIAL),
    ),
)
