"""Defects planted into ``world.json`` as Gazebo's engine reads it."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.kit import world_defects
from simspec.dialects.kit.defects import BELTS, GROUND, MARGINS, Plant

DEFECTS: Mapping[str, Plant | str] = {
    **world_defects.DEFECTS,
    "free armature": "DART has no armature of free bodies",
    "ball armature": "DART has no armature of balls",
    "torsional friction": "DART's contacts have no torque",
    "rolling friction": "DART's contacts have no torque",
    "mesh, margin": "DART has no margin around hulls, and no file has a number for one",
    **dict.fromkeys(MARGINS, "DART's contact begins where shapes touch"),
    **dict.fromkeys(GROUND, "simspec gives Gazebo no height fields"),
    **dict.fromkeys(BELTS, "world.json has no surfaces that move by themselves"),
    "hardness": "DART's contacts have the common hardness alone, which has no numbers",
}
