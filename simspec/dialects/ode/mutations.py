"""What is beyond the files of a world for the complete self-test: see ``dialects/kit/world_mutations.py``."""

from __future__ import annotations

from simspec.dialects.kit.mutations import Addition, Inert
from simspec.dialects.kit.world_mutations import SYMMETRIC, table

LAW = '{"first": "nothing", "second": "nothing", "friction": 0.5, "restitution": 0}'

TABLE = table(
    {"solver": ("step", "quick-step")},
    (
        Addition("", "9.81", "strength"),
        Addition("settings", "true", "sleeping"),
        Addition("laws", LAW),
        Addition("laws.*", "0.1", "adhesion"),
    ),
    (Inert("laws.*", SYMMETRIC, ("swapped",), "sidecar.json"),),
)
