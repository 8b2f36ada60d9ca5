"""Defects planted into ``world.json`` and the sidecar as ODE reads them."""

from __future__ import annotations

from collections.abc import Mapping

from simspec.dialects.kit import law_defects
from simspec.dialects.kit.defects import GROUND, MARGINS, Plant

DEFECTS: Mapping[str, Plant | str] = {
    **law_defects.DEFECTS,
    "hardness": "ODE's contacts have the common hardness alone, which has no numbers",
    "free armature": "ODE has no armature of free bodies",
    "ball armature": "ODE has no armature of balls",
    **dict.fromkeys(GROUND, "simspec gives ODE no height fields"),
    "mesh, margin": "ODE has no margin around hulls, and no file has a number for one",
    **dict.fromkeys(MARGINS, "ODE's contact begins where shapes touch"),
}
