"""Defects planted into ``world.json`` and the sidecar as Rapier reads them."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.kit import law_defects
from simspec.dialects.kit.defects import GROUND, MARGINS, Plant

DEFECTS: Mapping[str, Plant | str] = {
    **law_defects.DEFECTS,
    "hardness": "Rapier's contacts have the common hardness alone, which has no numbers",
    "free armature": "Rapier has no armature of free bodies",
    "ball armature": "Rapier has no armature of balls",
    **dict.fromkeys(GROUND, "simspec gives Rapier no height fields"),
    "mesh, margin": "Rapier's hulls are told without a margin, and no file has a number for one",
    **dict.fromkeys(MARGINS, "Rapier's contact begins where shapes touch"),
}
