"""What differs between versions of SDF: the form of the oldest, and what holds from which version on."""

from __future__ import annotations

import re
from typing import Final

from simspec.imports.elements import Element

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
        raise root.error("this version of SDF is not read", found=text[:20], allowed=allowed)
    return version


def parsed(text: str) -> Version | None:
    """The two numbers of a version; None where there are none."""
    match = re.fullmatch(r"\s*([0-9]{1,3})\.([0-9]{1,3})(\.[0-9]{1,3})?\s*", text)
    return None if match is None else (int(match.group(1)), int(match.group(2)))


def check_outermost(root: Element) -> None:
    """Raise SpecError where an element is not the outermost one of SDF."""
    is_old = root.tag == OLD_OUTERMOST and (parsed(root.attributes.get("version", "")) or NEWEST) < OUTERMOST_SINCE
    if root.tag != OUTERMOST and not is_old:
        raise root.error(f"the outermost element is <{root.tag[:60]}>", allowed="<sdf version=...>")


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
