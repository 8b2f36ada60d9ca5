"""What is a choice of how simspec tells MuJoCo a world, and not the world's: each row with its reason.

Nothing is left to MuJoCo's defaults: what all joints, shapes or explicit pairs share stands once in the file's ``<default>``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from simspec.dialects.kit.settings import NeededSetting
from simspec.dialects.mujoco.names import COULOMB, NATIVE, NO_RATING
from simspec.formats.mjcf.bodies import DEFAULT_COLOUR
from simspec.formats.mjcf.tree import Attributes

COMPILER: Final[Attributes] = (
    ("angle", "radian"),
    ("autolimits", False),  # a limit holds where ``limited`` says so, not where a range happens to stand
    ("inertiafromgeom", False),  # mass properties are the world's, never made from shapes
    ("balanceinertia", False),  # no silent repair of an inertia
    ("boundmass", 0),
    ("boundinertia", 0),
    ("settotalmass", -1),
    ("alignfree", False),  # a free body's frame is not moved into its principal axes
    ("discardvisual", False),
    ("fusestatic", False),  # bodies joined rigidly stay bodies
    ("usethread", False),
)
FLAGS: Final[tuple[tuple[str, bool], ...]] = (
    ("constraint", True),
    ("equality", True),
    ("frictionloss", True),
    ("limit", True),
    ("contact", True),
    ("spring", True),
    ("damper", True),
    ("gravity", True),
    ("clampctrl", True),
    ("filterparent", False),  # which bodies touch is said pair by pair, equally in every engine
    ("actuation", True),
    ("refsafe", True),
    ("sensor", True),
    ("midphase", True),
    ("eulerdamp", False),  # damping is explicit in time: −d v with the velocity before the step
    ("autoreset", False),  # a state that is not finite is a result, not a reason to begin again
    ("nativeccd", True),
    ("override", False),
    ("energy", False),
    ("fwdinv", False),
    ("invdiscrete", False),
)
"""Flags that every supported version knows; ``warmstart``, ``island`` and ``multiccd`` are settings. Newer versions have
further flags, all off unless asked for (``sleep``, by ``sleeping``); the engine's module checks them after loading."""
OPTION: Final[Attributes] = (
    ("integrator", "Euler"),  # semi-implicit: what all engines do
    ("jacobian", "auto"),
    ("density", 0.0),
    ("viscosity", 0.0),
    ("wind", (0.0, 0.0, 0.0)),
    ("magnetic", (0.0, 0.0, 0.0)),
    ("noslip_tolerance", 1e-6),
    ("ccd_iterations", 50),
)
SIZE: Final[Attributes] = (("nuser_jnt", 2),)
"""``user`` of a joint: its velocity and its effort rating, ``NO_RATING`` for none. Neither is enforced; MJCF's own
``actuatorfrcrange`` would be, on actuators only."""
JOINT_DEFAULTS: Final[Attributes] = (
    ("pos", (0.0, 0.0, 0.0)),
    ("ref", 0.0),
    ("limited", False),
    ("margin", 0.0),
    ("actuatorfrclimited", False),
    ("actuatorgravcomp", False),
    ("damping", 0.0),
    ("frictionloss", 0.0),
    ("armature", 0.0),
    ("stiffness", 0.0),
    ("springref", 0.0),
    ("user", (NO_RATING, NO_RATING)),
)
GEOM_DEFAULTS: Final[Attributes] = (
    ("group", 0),
    ("contype", 1),
    ("conaffinity", 1),
    ("condim", 1),
    ("friction", (0.0, 0.0, 0.0)),
    ("priority", 0),  # equal priorities: the larger friction holds
    ("solmix", 1.0),
    ("margin", 0.0),
    ("gap", 0.0),
    ("mass", 0.0),
    ("rgba", DEFAULT_COLOUR),
)
ACTUATOR: Final[Attributes] = (
    ("ctrllimited", False),
    ("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)),  # gains are on the joint's side
)
"""Of position and velocity actuators, the engine's own controllers (law ``native``)."""

MATERIAL_CLASS: Final = "material/"
"""Prefix of the class of a material; shapes that only show are of class ``visual``."""
VISUAL_CLASS: Final = "visual"
SOLVERS: Final[Mapping[str, str]] = {"newton": "Newton", "cg": "CG", "pgs": "PGS"}
SETTINGS: Final[Mapping[str, NeededSetting]] = {
    "solver": NeededSetting(str, tuple(SOLVERS)),
    "friction": NeededSetting(str, (NATIVE, COULOMB)),
    **dict.fromkeys(("iterations", "ls_iterations", "noslip_iterations", "explicit_pairs_limit"), NeededSetting(int)),
    **dict.fromkeys(("tolerance", "ls_tolerance", "ccd_tolerance", "impratio", "high_impratio"), NeededSetting(float)),
    **dict.fromkeys(("warmstart", "island", "multiccd"), NeededSetting(bool)),
    **dict.fromkeys(("contact_error_reduction", "contact_impedance"), NeededSetting(float, by_pair=True)),
    **dict.fromkeys(("friction_rate", "friction_share", "friction_cushion"), NeededSetting(float, by_pair=True)),
    **dict.fromkeys(("limit_error_reduction", "limit_impedance", "dry_friction_impedance"), NeededSetting(float)),
    "arena": NeededSetting(int, optional=True),
    "sleeping": NeededSetting(bool, optional=True),
    "sleep_tolerance": NeededSetting(float, optional=True),
}
"""Settings that an engine of this dialect must have; the last three are absent where they are off."""
