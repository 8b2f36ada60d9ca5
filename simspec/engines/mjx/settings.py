"""MJX's solver settings: those of MuJoCo's files, as far as MJX has what they say."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from simspec.dialects.mujoco.names import NATIVE
from simspec.engines.kit.settings import Setting
from simspec.engines.mujoco.settings import SETTINGS as MUJOCO

_UNUSED = "MuJoCo's, of the file; MJX has nothing of the kind, so that this alone is allowed."

SETTINGS: Mapping[str, Setting] = {
    **{name: setting for name, setting in MUJOCO.items() if name not in ("sleeping", "sleep_tolerance")},
    "solver": dataclasses.replace(
        MUJOCO["solver"],
        meaning="The constraint solver. Newton solves MuJoCo's convex problem to round-off in a handful of iterations. "
        "MJX's cg ends before that: a ball that should lose 0.6 m/s along the surface in an impact gains 0.17 (measured, "
        "1 ms). It has no pgs.",
        choices=("newton",),
        frictionless=None,
        frictionless_unless=None,
    ),
    "tolerance": dataclasses.replace(
        MUJOCO["tolerance"],
        meaning="The solver ends when it improves by less than this. MuJoCo's own number; smaller where bodies are light "
        "beside others, as for MuJoCo.",
    ),
    "friction": dataclasses.replace(
        MUJOCO["friction"],
        meaning="native: MuJoCo's own friction, which leaves out most of the friction of an impact. To be accepted by name "
        "(contact.friction.impact, contact.friction.carried). simspec's loop around MuJoCo's solver is not written for MJX.",
        choices=(NATIVE,),
    ),
    "noslip_iterations": dataclasses.replace(MUJOCO["noslip_iterations"], meaning=_UNUSED, maximum=0),
    "multiccd": dataclasses.replace(
        MUJOCO["multiccd"],
        default=False,
        meaning="MuJoCo's, of the file, and without effect: MJX has functions of its own for every two kinds of shapes, which "
        "find a face's points always.",
    ),
    "ccd_tolerance": dataclasses.replace(
        MUJOCO["ccd_tolerance"], meaning="MuJoCo's, of the file, and without effect in MJX.", finer=None
    ),
    "island": dataclasses.replace(
        MUJOCO["island"],
        meaning="MuJoCo's, of the file, and without effect: MJX solves all bodies together.",
        needs=None,
    ),
}
