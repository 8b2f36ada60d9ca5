"""Values of SDF with the defaults of the language, the versions of the language, and losses by element."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from simspec import numerals
from simspec.imports.draft import angle
from simspec.imports.elements import (
    APPEARANCE,
    CARRIED,
    HOW_HARD,
    INFORMATION,
    LOST,
    PHYSICS,
    UNUSED,
    Element,
    UniqueNames,
    plugin_loss,
)
from simspec.language.foreign import Fate, LossSeverity
from simspec.world import frames
from simspec.world.types import Pose, Vector3

TRUE: Final = ("true", "1")
FALSE: Final = ("false", "0")
EULER: Final = "euler_rpy"
QUATERNION: Final = "quat_xyzw"
UNIT: Final = 1e-2
"""How far from 1 a quaternion's length may be; the language's own bound."""


def text_of(parent: Element, tag: str, default: str) -> str:
    """The text of a child, taken."""
    child = parent.child(tag)
    return default if child is None or not child.text else child.text


def number_of(parent: Element, tag: str, default: float) -> float:
    """The number of a child, taken; ``inf`` is one. Raises SpecError for others."""
    child = parent.child(tag)
    return default if child is None else number(child)


def number(element: Element) -> float:
    """The number of an element; ``inf`` is one. Raises SpecError for others."""
    try:
        return numerals.number(element.text, infinite=True)
    except numerals.NumeralError as error:
        raise element.error(
            f"<{element.tag}> should be a number{error.suffix}", found=element.text[:80], code="I101"
        ) from None


def finite_of(parent: Element, tag: str, default: float) -> float:
    """The same, finite. Raises SpecError for others."""
    value = number_of(parent, tag, default)
    if math.isinf(value):
        raise parent.error(f"<{tag}> should be finite", found=str(value), code="I102")
    return value


def vector_of(parent: Element, tag: str, default: Vector3) -> Vector3:
    """Three numbers of a child, taken. Raises SpecError for others."""
    child = parent.child(tag)
    return default if child is None else vector(child)


def vector(element: Element) -> Vector3:
    """The three numbers of an element, taken."""
    x, y, z = element.content(3)
    return (x, y, z)


def flag_of(parent: Element, tag: str, default: bool) -> bool:
    """The flag of a child, taken. Raises SpecError for other texts."""
    child = parent.child(tag)
    return default if child is None else flag(child, child.text)


def flag(element: Element, text: str) -> bool:
    """A flag of an element. Raises SpecError for other texts."""
    word = text.strip().lower()
    if word not in (*TRUE, *FALSE):
        raise element.error("not a flag", found=text[:80], allowed="true, false, 1, 0", code="I101")
    return word in TRUE


IDENTITY: Final = Pose()


@dataclass(frozen=True, slots=True)
class Placement:
    """A pose, with the angles that the file gives where it gives them."""

    pose: Pose = IDENTITY
    rpy: Vector3 | None = None

    def then(self, inner: Placement) -> Placement:
        """The pose of C in A, from this of B in A and ``inner`` of C in B."""
        if self.pose == IDENTITY:
            return inner
        if inner.pose == IDENTITY:
            return self
        rpy = inner.rpy if self.pose.quaternion == frames.IDENTITY else None
        return Placement(frames.compose(self.pose, inner.pose), rpy)

    def inverse(self) -> Placement:
        """The pose of A in B."""
        return self if self.pose == IDENTITY else Placement(frames.inverse(self.pose))

    def data(self) -> dict[str, object]:
        """The pose as the language has it; {} for the identity."""
        data: dict[str, object] = {}
        if any(self.pose.position):
            data["xyz"] = list(self.pose.position)
        if self.pose.quaternion != frames.IDENTITY:
            if self.rpy is not None:
                data["rpy"] = [angle(value) for value in self.rpy]
            else:
                data["quat"] = list(self.pose.quaternion)
        return data


def at(position: Vector3) -> Placement:
    """A pose without rotation."""
    return Placement(Pose(position))


SAME: Final = Placement()


@dataclass(frozen=True, slots=True)
class SdfPose:
    """A ``<pose>`` of the file: where it is, and against which frame ("": the default of its element)."""

    placement: Placement = SAME
    relative_to: str = ""
    element: Element | None = None


def pose_of(parent: Element) -> SdfPose:
    """The ``<pose>`` of an element, taken. Raises SpecError for what is none."""
    child = parent.child("pose")
    if child is None:
        return SdfPose()
    relative = child.word("relative_to") or child.word("frame") or ""
    wording = child.word("rotation_format", EULER)
    degrees = flag(child, child.word("degrees") or "false")
    if wording not in (EULER, QUATERNION):
        raise child.error("not a format of rotations", found=wording, allowed=f"{EULER}, {QUATERNION}", code="I101")
    if not child.text:
        return SdfPose(Placement(), relative, child)
    values = child.content(7 if wording == QUATERNION else 6)
    position = frames.vector3(values[:3])
    if wording == QUATERNION:
        x, y, z, w = values[3:]
        if abs(math.hypot(w, x, y, z) - 1.0) > UNIT:
            raise child.error("not a unit quaternion", found=child.text[:80], code="I102")
        return SdfPose(Placement(Pose(position, frames.normalise((w, x, y, z)))), relative, child)
    turn = (math.pi / 180.0) if degrees else 1.0
    rpy = frames.vector3(value * turn for value in values[3:])
    if any(abs(angle) > 1e6 for angle in rpy):
        raise child.error("angles of more than 1e6 rad", found=child.text[:80], code="I102")
    return SdfPose(Placement(Pose(position, frames.from_rpy(*rpy)), rpy), relative, child)


LONGEST_NAME: Final = 200


class SdfNames(UniqueNames):
    """Names that the language allows, each once."""

    def __init__(self, taken: Iterable[str] = ()):
        super().__init__(("world", *taken))

    def give(self, text: str, element: Element | None = None) -> str:
        """A name made of a text; an element whose name changes says so."""
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", text)[:LONGEST_NAME]
        name = self.unique(plain if re.match(r"[A-Za-z_]", plain) else f"_{plain}")
        if element is not None and name != element.attributes.get("name", "").strip():
            element.set_aside("name", CARRIED, f"called {name} in the spec", INFORMATION)
        return name


Version = tuple[int, int]

OLDEST: Final[Version] = (1, 0)
NEWEST: Final[Version] = (1, 12)
UNIQUE_SINCE: Final[Version] = (1, 7)
"""Names are unique in a model since this version."""
FLAT_BEFORE: Final[Version] = (1, 8)
"""Before this version a name may contain `::`: models within others were written flat, as links and joints of one model."""
JOINT_FRAME_SINCE: Final[Version] = (1, 5)
"""Axes are in the joint's frame since this version; before, in the model's."""
EXPRESSED_SINCE: Final[Version] = (1, 7)
"""Since this version `expressed_in` says in which frame an axis is; before, `use_parent_model_frame`."""
STEP_SINCE: Final[Version] = (1, 4)
"""Before this version the timestep is that of the solver: `ode/solver/dt`, or `bullet/dt`."""
ELEMENTS_SINCE: Final[Version] = (1, 2)
"""Before this version values are attributes, and poses stand in `<origin pose=...>`."""
OUTERMOST_SINCE: Final[Version] = (1, 3)
"""Before this version the outermost element was called `gazebo`, too."""
OUTERMOST: Final = "sdf"
OLD_OUTERMOST: Final = "gazebo"
KEPT: Final = ("name", "type", "version", "default")
"""Attributes that version 1.2 has as well."""
INNER: Final = {
    "origin": ("pose", "pose"),
    "parent": ("link", "parent"),
    "child": ("link", "child"),
    "gravity": ("xyz", "gravity"),
    "ambient": ("rgba", "ambient"),
    "diffuse": ("rgba", "diffuse"),
    "specular": ("rgba", "specular"),
    "emissive": ("rgba", "emissive"),
}
"""Elements of version 1.0 of which one attribute is all that they say: which, and what the element is called since."""
STEPS: Final = (("ode", "solver", "dt"), ("bullet", "dt"))
STEP: Final = "max_step_size"


def version_of(root: Element) -> Version:
    """The version of a file. Raises SpecError where simspec does not read it."""
    text = root.need("version")
    version = parsed(text)
    if version is None or not OLDEST <= version <= NEWEST:
        allowed = f"{OLDEST[0]}.{OLDEST[1]} to {NEWEST[0]}.{NEWEST[1]}"
        raise root.error("this version of SDF is not read", found=text[:20], allowed=allowed, code="I101")
    return version


def parsed(text: str) -> Version | None:
    """The two numbers of a version; None where there are none."""
    match = re.fullmatch(r"\s*([0-9]{1,3})\.([0-9]{1,3})(\.[0-9]{1,3})?\s*", text)
    return None if match is None else (int(match.group(1)), int(match.group(2)))


def check_outermost(root: Element) -> None:
    """Raise SpecError where an element is not the outermost one of SDF."""
    is_old = root.tag == OLD_OUTERMOST and (parsed(root.attributes.get("version", "")) or NEWEST) < OUTERMOST_SINCE
    if root.tag != OUTERMOST and not is_old:
        raise root.error(f"the outermost element is <{root.tag[:60]}>", allowed="<sdf version=...>", code="I114")


def modernise(root: Element) -> None:
    """Give a file of an older version the elements that version 1.4 has for what it says, each at the place of the old one."""
    version = version_of(root)
    if version >= STEP_SINCE:
        return
    if version < ELEMENTS_SINCE:
        for element in list(root.within()):
            _attributes_as_elements(element)
    for element in list(root.within()):
        if element.tag == "filename" and element.parent is not None and element.parent.tag == "mesh":
            element.tag = "uri"
        if element.tag == "physics" and not element.look(STEP):
            _move_step(element)


def _attributes_as_elements(element: Element) -> None:
    if element.tag == "plugin":
        return
    if element.tag in INNER and INNER[element.tag][0] in element.attributes:
        attribute, element.tag = INNER[element.tag]
        element.text = element.attributes.pop(attribute)
    if element.tag == "damping" and element.parent is not None and element.parent.tag == "link":
        element.tag = "velocity_decay"
    for name in [name for name in element.attributes if name not in KEPT]:
        element.grow("uri" if (element.tag, name) == ("mesh", "filename") else name, element.attributes.pop(name))


def _move_step(physics: Element) -> None:
    """The timestep of the solver as that of the world."""
    for path in STEPS:
        place: Element | None = physics
        for tag in path:
            place = next(iter(place.look(tag)), None) if place is not None else None
        if place is not None and place.text:
            physics.grow(STEP, place.text)
            return


Said = tuple[Fate, LossSeverity, str]

_NO_SENSOR: Final[Said] = (LOST, INFORMATION, "simspec has no sensors")
_PLUGIN: Final[Said] = (LOST, PHYSICS, "a plugin is a program of another simulator, which may do anything")
_SCENERY: Final[Said] = (LOST, APPEARANCE, "simspec has no scenery")
_NO_LIGHT: Final[Said] = (LOST, APPEARANCE, "simspec has no lights")
NO_ACTOR: Final = "simspec has no actors"
_NO_SOUND: Final[Said] = (LOST, INFORMATION, "simspec has no sound")
_NO_AIR: Final[Said] = (LOST, PHYSICS, "the effect of wind is left to plugins; physics.fluid of a spec has another law")

IN_LINK: Final[Mapping[str, Said]] = {
    "sensor": _NO_SENSOR,
    "light": _NO_LIGHT,
    "projector": _SCENERY,
    "particle_emitter": _SCENERY,
    "audio_sink": _NO_SOUND,
    "audio_source": _NO_SOUND,
    "battery": (LOST, INFORMATION, "simspec has no batteries"),
    "velocity_decay": (LOST, PHYSICS, "simspec has no damping of free bodies"),
    "kinematic": (LOST, PHYSICS, "simspec has no links that nothing moves"),
    "enable_wind": _NO_AIR,
    "must_be_base_link": (LOST, INFORMATION, "the tree follows from the joints"),
    "plugin": _PLUGIN,
}
IN_COLLISION: Final[Mapping[str, Said]] = {
    "laser_retro": (LOST, INFORMATION, "simspec has no lasers"),
    "material": (UNUSED, APPEARANCE, "a collision shape is not drawn"),
    "max_contacts": (LOST, INFORMATION, "how many contacts are kept is each engine's setting"),
}
IN_VISUAL: Final[Mapping[str, Said]] = {
    "cast_shadows": _SCENERY,
    "laser_retro": (LOST, INFORMATION, "simspec has no lasers"),
    "transparency": (LOST, APPEARANCE, "the colour has its own opacity"),
    "visibility_flags": _SCENERY,
    "meta": (LOST, INFORMATION, "simspec has no layers"),
    "plugin": (LOST, APPEARANCE, "a plugin is a program of another simulator"),
}
IN_SURFACE: Final[Mapping[str, Said]] = {"soft_contact": (LOST, PHYSICS, "simspec has no soft bodies")}
IN_FRICTION: Final[Mapping[str, Said]] = {
    "fdir1": (LOST, PHYSICS, "friction is the same in every direction"),
    "slip1": (LOST, PHYSICS, "friction does not depend on the force"),
    "slip2": (LOST, PHYSICS, "friction does not depend on the force"),
}
IN_JOINT: Final[Mapping[str, Said]] = {"sensor": _NO_SENSOR, "plugin": _PLUGIN}
IN_CONTACT: Final[Mapping[str, Said]] = dict.fromkeys(
    ("poissons_ratio", "elastic_modulus"), (LOST, INFORMATION, HOW_HARD)
)
IN_CONTACT_OF_LINK: Final[Mapping[str, Said]] = dict.fromkeys(
    ("stiffness", "damping", "contact_cfm", "contact_erp"), (LOST, INFORMATION, HOW_HARD)
)
IN_MODEL: Final[Mapping[str, Said]] = {
    "plugin": _PLUGIN,
    "enable_wind": _NO_AIR,
    "allow_auto_disable": (LOST, INFORMATION, "whether bodies sleep is each engine's setting"),
    "gripper": (LOST, PHYSICS, "simspec holds no object but by contact"),
    "static": (UNUSED, INFORMATION, "the model around it says it"),
}
IN_WORLD: Final[Mapping[str, Said]] = {
    "plugin": _PLUGIN,
    "scene": _SCENERY,
    "light": _NO_LIGHT,
    "gui": (LOST, INFORMATION, "simspec has no windows"),
    "road": _SCENERY,
    "actor": (LOST, PHYSICS, NO_ACTOR),
    "population": (LOST, PHYSICS, "simspec has arrays of bodies, and no populations at random"),
    "state": (LOST, PHYSICS, "the state of a run that was saved; simspec begins at the poses of the models"),
    "wind": _NO_AIR,
    "atmosphere": _NO_AIR,
    "audio": _NO_SOUND,
    "magnetic_field": (LOST, INFORMATION, "simspec has no magnetic field"),
    "spherical_coordinates": (LOST, INFORMATION, "simspec has no place on the Earth"),
}
SETTINGS: Final[Said] = (LOST, INFORMATION, "settings of one engine; simspec has them under `engines`")


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
        if table[child.tag] is _PLUGIN:
            severity, reason = plugin_loss(child)
        if is_default(child):
            fate, severity, reason = UNUSED, INFORMATION, "the default"
        child.set_aside(None, fate, reason, severity)


def is_default(element: Element) -> bool:
    """Whether an element says only what holds without it. Raises SpecError for values that it may not have."""
    if element.tag in EMPTY and not element.look() and not element.text:
        return True
    if inner := element.look():
        return all(child.tag in DEFAULTS and is_default(child) for child in inner)
    if not element.text or element.tag not in DEFAULTS:
        return False
    default = DEFAULTS[element.tag]
    return flag(element, element.text) is default if isinstance(default, bool) else number(element) == default
