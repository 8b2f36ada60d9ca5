"""MuJoCo Warp's solver settings: those of MuJoCo's files, as far as Warp has what they say, and the device. Measured as in
``simulation.py``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from simspec.dialects.mujoco.names import NATIVE
from simspec.engines.kit.settings import Group, Setting
from simspec.engines.mjwarp.importing import AUTO, PROCESSOR
from simspec.engines.mujoco.settings import SETTINGS as MUJOCO

SETTINGS: Mapping[str, Setting] = {
    **{name: setting for name, setting in MUJOCO.items() if name not in ("sleeping", "sleep_tolerance")},
    "device": Setting(
        AUTO,
        "What computes. auto: the first graphics processor that Warp finds (CUDA), where there is one, else the processor "
        "(cpu). Others than the processor are told with the run's messages; nobody has run simspec on one.",
        (AUTO, PROCESSOR, *(f"cuda:{index}" for index in range(8))),
        group=Group.OTHER,
    ),
    "solver": dataclasses.replace(
        MUJOCO["solver"],
        meaning="The constraint solver. Newton solves MuJoCo's convex problem to the round-off of singles in a handful of "
        "iterations; cg approaches it. Warp has no pgs.",
        choices=("newton", "cg"),
        frictionless=None,
        frictionless_unless=None,
    ),
    "friction": dataclasses.replace(
        MUJOCO["friction"],
        meaning="native: MuJoCo's own friction, which leaves out most of the friction of an impact. To be accepted by name "
        "(contact.friction.impact). simspec's loop around MuJoCo's solver is not written for Warp.",
        choices=(NATIVE,),
    ),
    "island": dataclasses.replace(
        MUJOCO["island"],
        meaning="MuJoCo's, of the file, and without effect: Warp solves groups of bodies apart only where bodies sleep.",
        needs=None,
    ),
}
