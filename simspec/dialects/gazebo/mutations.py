"""What is beyond the files of a world for the complete self-test: see ``dialects/kit/world_mutations.py``."""

from __future__ import annotations

from simspec.dialects.kit.mutations import Addition, Inert
from simspec.dialects.kit.world_mutations import SYMMETRIC, WORLD, table

NAMED = ("passive.gravity_scales.*", "passive.around.boxes.*")

TABLE = table(
    {"contact_solver": ("dantzig", "pgs")},
    (
        Addition("", "9.81", "strength"),
        Addition("settings", "true", "sleeping"),
        Addition("settings", "0.01", "softness"),
    ),
    (
        *(Inert(site, SYMMETRIC, ("swapped",), "sidecar.json") for site in NAMED),
        Inert("constraints.*", "the order of equations, but for round-off", ("swapped",), "sidecar.json", within=1e-9),
        Inert(
            "bodies.*.shapes.*.pose.position.*",
            "a translation of a plane within itself, which is the top of a box of 2.1 km",
            (),
            WORLD,
            within=1e-10,
        ),
        Inert(
            "bodies.*.shapes.*.pose.quaternion.*",
            "a rotation within a shape's symmetry, by which its corners are found in another order",
            ("swapped",),
            WORLD,
            within=1e-10,
        ),
    ),
)
