"""Defects planted into ``world.json`` as PhysX's engine reads it."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import BELTS, GROUND, MARGINS, Plant

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
