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

LARGEST_RATIO = 1e5
"""Of friction's hardness to that of contact, in singles."""

SETTINGS: Mapping[str, Setting] = {
    **{name: setting for name, setting in MUJOCO.items() if name not in ("sleeping", "sleep_tolerance")},
    "device": Setting(
        AUTO,
        "What computes. auto: the first graphics processor that Warp finds (CUDA), where there is one, else the processor "
        "(cpu). Others than the processor are told with the run's messages; nobody has run simspec on one.",
        (AUTO, PROCESSOR, *(f"cuda:{index}" for index in range(8))),
        group=Group.ORDER,  # of sums, which a graphics processor takes otherwise
    ),
    "solver": dataclasses.replace(
        MUJOCO["solver"],
        meaning="The constraint solver. Newton solves MuJoCo's convex problem to the round-off of singles in a handful of "
        "iterations. Warp's cg is not offered, since 100 iterations, MuJoCo's number, are too few for it: a box that should "
        "lose 0.6 m/s along the surface in an impact gains 0.12, where newton's loses 0.06; of 1000 iterations it has newton's "
        "answer (one world, only these settings changed; measured, 1 ms). It has no pgs.",
        choices=("newton",),
        frictionless=None,
        frictionless_unless=None,
    ),
    "impratio": dataclasses.replace(MUJOCO["impratio"], maximum=LARGEST_RATIO),
    "high_impratio": dataclasses.replace(
        MUJOCO["high_impratio"],
        default=LARGEST_RATIO,
        meaning="impratio of worlds where compliant contact has friction, or something has torsional or rolling friction: "
        "MuJoCo makes friction as soft as its contact, and moments softer by (μ/c)². At most 1e5: at 1e7, MuJoCo's here, a "
        "box that friction holds on a slope is no number (NaN) after 2 to 228 steps, since singles have seven digits; at 1e5 "
        "it creeps 1e-6 m/s (measured).",
        maximum=LARGEST_RATIO,
    ),
    "friction": dataclasses.replace(
        MUJOCO["friction"],
        meaning="native: MuJoCo's own friction, which leaves out most of the friction of an impact. To be accepted by name "
        "(contact.friction.impact, contact.friction.carried). simspec's loop around MuJoCo's solver is not written for Warp.",
        choices=(NATIVE,),
    ),
    "island": dataclasses.replace(
        MUJOCO["island"],
        meaning="MuJoCo's, of the file, and without effect: Warp solves groups of bodies apart only where bodies sleep.",
        needs=None,
    ),
}
