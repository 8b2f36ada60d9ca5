"""What SDF says that the language does not: by element, what becomes of it, how much that matters, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from simspec.imports.elements import HOW_HARD, Element
from simspec.imports.sdf.values import flag, number
from simspec.language.foreign import Fate, Severity

Said = tuple[Fate, Severity, str]

_NO_SENSOR: Final[Said] = (Fate.LOST, Severity.INFORMATION, "simspec has no sensors")
_PLUGIN: Final[Said] = (
    Fate.LOST,
    Severity.PHYSICS,
    "a plugin is a program of another simulator, which may do anything",
)
_SCENERY: Final[Said] = (Fate.LOST, Severity.APPEARANCE, "simspec has no scenery")
_NO_LIGHT: Final[Said] = (Fate.LOST, Severity.APPEARANCE, "simspec has no lights")
NO_ACTOR: Final = "simspec has no actors"
_NO_SOUND: Final[Said] = (Fate.LOST, Severity.INFORMATION, "simspec has no sound")
_NO_AIR: Final[Said] = (
    Fate.LOST,
    Severity.PHYSICS,
    "what a wind does is left to plugins; physics.fluid of a spec has a law of its own",
)

IN_LINK: Final[Mapping[str, Said]] = {
    "sensor": _NO_SENSOR,
    "light": _NO_LIGHT,
    "projector": _SCENERY,
    "particle_emitter": _SCENERY,
    "audio_sink": _NO_SOUND,
    "audio_source": _NO_SOUND,
    "battery": (Fate.LOST, Severity.INFORMATION, "simspec has no batteries"),
    "velocity_decay": (Fate.LOST, Severity.PHYSICS, "simspec has no damping of free bodies"),
    "kinematic": (Fate.LOST, Severity.PHYSICS, "simspec has no links that nothing moves"),
    "enable_wind": _NO_AIR,
    "must_be_base_link": (Fate.LOST, Severity.INFORMATION, "the tree follows from the joints"),
    "plugin": _PLUGIN,
}
IN_COLLISION: Final[Mapping[str, Said]] = {
    "laser_retro": (Fate.LOST, Severity.INFORMATION, "simspec has no lasers"),
    "material": (Fate.UNUSED, Severity.APPEARANCE, "a collision shape is not drawn"),
    "max_contacts": (Fate.LOST, Severity.INFORMATION, "how many contacts are kept is each engine's setting"),
}
IN_VISUAL: Final[Mapping[str, Said]] = {
    "cast_shadows": _SCENERY,
    "laser_retro": (Fate.LOST, Severity.INFORMATION, "simspec has no lasers"),
    "transparency": (Fate.LOST, Severity.APPEARANCE, "the colour has its own opacity"),
    "visibility_flags": _SCENERY,
    "meta": (Fate.LOST, Severity.INFORMATION, "simspec has no layers"),
    "plugin": (Fate.LOST, Severity.APPEARANCE, "a plugin is a program of another simulator"),
}
IN_SURFACE: Final[Mapping[str, Said]] = {
    "soft_contact": (Fate.LOST, Severity.PHYSICS, "simspec has no soft bodies"),
}
IN_FRICTION: Final[Mapping[str, Said]] = {
    "fdir1": (Fate.LOST, Severity.PHYSICS, "friction is the same in every direction"),
    "slip1": (Fate.LOST, Severity.PHYSICS, "friction does not depend on the force"),
    "slip2": (Fate.LOST, Severity.PHYSICS, "friction does not depend on the force"),
}
IN_JOINT: Final[Mapping[str, Said]] = {
    "sensor": _NO_SENSOR,
    "plugin": _PLUGIN,
}
IN_CONTACT: Final[Mapping[str, Said]] = dict.fromkeys(
    ("poissons_ratio", "elastic_modulus"),
    (Fate.LOST, Severity.INFORMATION, HOW_HARD),
)
IN_CONTACT_OF_LINK: Final[Mapping[str, Said]] = dict.fromkeys(
    ("stiffness", "damping", "contact_cfm", "contact_erp"), (Fate.LOST, Severity.INFORMATION, HOW_HARD)
)
IN_MODEL: Final[Mapping[str, Said]] = {
    "plugin": _PLUGIN,
    "enable_wind": _NO_AIR,
    "allow_auto_disable": (Fate.LOST, Severity.INFORMATION, "whether bodies sleep is each engine's setting"),
    "gripper": (Fate.LOST, Severity.PHYSICS, "simspec holds no object but by contact"),
    "static": (Fate.UNUSED, Severity.INFORMATION, "the model around it says it"),
}
IN_WORLD: Final[Mapping[str, Said]] = {
    "plugin": _PLUGIN,
    "scene": _SCENERY,
    "light": _NO_LIGHT,
    "gui": (Fate.LOST, Severity.INFORMATION, "simspec has no windows"),
    "road": _SCENERY,
    "actor": (Fate.LOST, Severity.PHYSICS, NO_ACTOR),
    "population": (Fate.LOST, Severity.PHYSICS, "simspec has arrays of bodies, and no populations at random"),
    "state": (
        Fate.LOST,
        Severity.PHYSICS,
        "the state of a run that was saved; simspec begins at the poses of the models",
    ),
    "wind": _NO_AIR,
    "atmosphere": _NO_AIR,
    "audio": _NO_SOUND,
    "magnetic_field": (Fate.LOST, Severity.INFORMATION, "simspec has no magnetic field"),
    "spherical_coordinates": (Fate.LOST, Severity.INFORMATION, "simspec has no place on the Earth"),
}
PHYSICS: Final[Said] = (Fate.LOST, Severity.INFORMATION, "settings of one engine; simspec has them under `engines`")


DEFAULTS: Final[Mapping[str, bool | float]] = {
    "kinematic": False,
    "enable_wind": False,
    "must_be_base_link": False,
    "allow_auto_disable": True,
    "cast_shadows": True,
    "laser_retro": 0.0,
    "transparency": 0.0,
    "slip1": 0.0,
    "slip2": 0.0,
    "linear": 0.0,
    "angular": 0.0,
}
"""Values that change nothing."""
EMPTY: Final = ("velocity_decay", "contact")
"""Elements that say nothing where nothing is in them."""


def set_aside(parent: Element, table: Mapping[str, Said]) -> None:
    """Say of each child of these tags what becomes of it."""
    for child in parent.look(*table):
        fate, severity, reason = table[child.tag]
        if is_default(child):
            fate, severity, reason = Fate.UNUSED, Severity.INFORMATION, "the default"
        child.set_aside(None, fate, reason, severity)


def is_default(element: Element) -> bool:
    """Whether an element says only what holds without it. Raises SpecError for values that it may not have."""
    inner = element.look()
    if element.tag in EMPTY and not inner and not element.text:
        return True
    if inner:
        return all(child.tag in DEFAULTS and is_default(child) for child in inner)
    if not element.text or element.tag not in DEFAULTS:
        return False
    default = DEFAULTS[element.tag]
    return flag(element, element.text) is default if isinstance(default, bool) else number(element) == default
