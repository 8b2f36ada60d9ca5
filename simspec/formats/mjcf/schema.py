"""The elements of the MJCF language: which may stand in which, and which take defaults from where."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_IN_FRAMES: Final = _words(
    "body frame replicate joint freejoint geom site camera light attach composite flexcomp plugin"
)
ACTUATORS: Final = _words(
    "general motor position velocity intvelocity damper cylinder muscle adhesion dcmotor orientation pid"
)
_SENSORS: Final = _words(
    "touch accelerometer velocimeter gyro force torque magnetometer rangefinder camprojection jointpos jointvel "
    "jointactuatorfrc jointlimitpos jointlimitvel jointlimitfrc tendonpos tendonvel tendonactuatorfrc "
    "tendonlimitpos tendonlimitvel tendonlimitfrc actuatorpos actuatorvel actuatorfrc ballquat ballangvel framepos "
    "framequat framexaxis frameyaxis framezaxis framelinvel frameangvel framelinacc frameangacc subtreecom "
    "subtreelinvel subtreeangmom insidesite distance normal fromto contact e_potential e_kinetic clock tactile user "
    "plugin"
)

CHILDREN: Final[Mapping[str, frozenset[str]]] = {
    "mujoco": _words(
        "compiler option size statistic visual default extension custom asset worldbody contact deformable tendon "
        "equality actuator sensor keyframe"
    ),
    "compiler": _words("lengthrange"),
    "option": _words("flag"),
    "visual": _words("global quality headlight map scale rgba"),
    "default": ACTUATORS | _words("default joint geom site camera light pair equality tendon mesh texture material"),
    "extension": _words("plugin"),
    "plugin": _words("instance config"),
    "instance": _words("config"),
    "custom": _words("numeric text tuple"),
    "tuple": _words("element"),
    "asset": _words("mesh hfield skin texture material model"),
    "mesh": _words("plugin"),
    "skin": _words("bone"),
    "material": _words("layer"),
    "worldbody": _IN_FRAMES,
    "body": _IN_FRAMES | {"inertial"},
    "frame": _IN_FRAMES,
    "replicate": _IN_FRAMES,
    "geom": _words("plugin"),
    "composite": _words("joint geom site skin plugin"),
    "flexcomp": _words("edge elasticity contact pin plugin"),
    "deformable": _words("flex skin"),
    "flex": _words("edge elasticity contact"),
    "contact": _words("pair exclude"),
    "tendon": _words("spatial fixed"),
    "spatial": _words("site geom pulley"),
    "fixed": _words("joint"),
    "equality": _words("connect weld joint tendon flex flexvert flexstrain"),
    "actuator": ACTUATORS | {"plugin"},
    "sensor": _SENSORS,
    "keyframe": _words("key"),
}
"""What may stand in each element, ``include`` aside, which may stand anywhere. Elements that are not here hold none."""

ACTUATOR: Final = "actuator"
"""In a class of defaults: what all actuators share, of whichever kind it was said."""
ACTUATOR_ATTRIBUTES: Final = _words(
    "group nsample interp delay ctrllimited forcelimited actlimited ctrlrange forcerange actrange lengthrange gear "
    "cranklength user joint jointinparent tendon cranksite slidersite site refsite body armature damping"
)
"""Attributes of actuators of every kind; a class states them once for all kinds, and the last one said holds."""
ORIENTATIONS: Final = _words("quat axisangle xyaxes zaxis euler")
"""Attributes that say the same in other words: of an element's own and its class's only the element's own holds."""
HOLDERS: Final = _words("worldbody body frame replicate")
"""Elements in which bodies stand. The two last only place, and repeat, what is in them."""


def defaults_of(section: str, tag: str) -> tuple[str, ...]:
    """The elements of a class of defaults that ``tag`` in ``section`` takes attributes from; later ones override."""
    if section == "worldbody":
        return (tag,) if tag in ("joint", "geom", "site", "camera", "light") else ()
    if section == "actuator":
        return (ACTUATOR, tag) if tag in ACTUATORS else ()
    if section in ("equality", "tendon"):
        return (section,)
    if (section, tag) in (("contact", "pair"), ("asset", "mesh"), ("asset", "material"), ("asset", "texture")):
        return (tag,)
    return ()
