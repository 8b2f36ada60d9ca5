"""What was read of a .skel file: skeletons, each part with its element and line, and nothing left out.

What the file does not say is None here, not a program's default. Every typed part keeps its :class:`Item`, the element as it
stands in the file; :func:`strangers` finds all that is not of the language as it is known here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from simspec.formats.kit.text import finite_numbers
from simspec.formats.kit.xml_elements import Element
from simspec.world.types import Inertial, Pose, Vector3

ONCE: Final = "once"
"""An element that may stand there once."""
OFTEN: Final = "often"
_SHAPE = ((), dict.fromkeys(("transformation", "geometry", "color"), ONCE))
_LEAVES = (
    *("time_step", "gravity", "collision_detector", "mobile", "transformation", "mass", "offset", "color"),
    *("ixx", "iyy", "izz", "ixy", "ixz", "iyz", "radius", "height", "size", "normal", "parent", "child"),
    *(
        "xyz",
        "lower",
        "upper",
        "damping",
        "friction",
        "spring_rest_position",
        "spring_stiffness",
        "init_pos",
        "init_vel",
    ),
    *("file_name", "scale"),
)
LANGUAGE: Final[Mapping[str, tuple[tuple[str, ...], Mapping[str, str]]]] = {
    "skel": (("version",), {"world": ONCE}),
    "world": (("name",), {"physics": ONCE, "skeleton": OFTEN}),
    "physics": ((), dict.fromkeys(("time_step", "gravity", "collision_detector"), ONCE)),
    "skeleton": (("name",), {"mobile": ONCE, "transformation": ONCE, "body": OFTEN, "joint": OFTEN}),
    "body": (
        ("name",),
        {
            **dict.fromkeys(("gravity", "transformation", "inertia"), ONCE),
            **dict.fromkeys(("visualization_shape", "collision_shape"), OFTEN),
        },
    ),
    "inertia": ((), dict.fromkeys(("mass", "moment_of_inertia", "offset"), ONCE)),
    "moment_of_inertia": ((), dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), ONCE)),
    "visualization_shape": _SHAPE,
    "collision_shape": _SHAPE,
    "geometry": ((), dict.fromkeys(("sphere", "box", "cylinder", "capsule", "ellipsoid", "plane", "mesh"), ONCE)),
    "sphere": ((), {"radius": ONCE}),
    "box": ((), {"size": ONCE}),
    "cylinder": ((), {"radius": ONCE, "height": ONCE}),
    "capsule": ((), {"radius": ONCE, "height": ONCE}),
    "ellipsoid": ((), {"size": ONCE}),
    "plane": ((), {"normal": ONCE, "offset": ONCE}),
    "mesh": ((), {"file_name": ONCE, "scale": ONCE}),
    "joint": (
        ("type", "name"),
        dict.fromkeys(("transformation", "parent", "child", "axis", "init_pos", "init_vel"), ONCE),
    ),
    "axis": ((), dict.fromkeys(("xyz", "limit", "dynamics"), ONCE)),
    "limit": ((), {"lower": ONCE, "upper": ONCE}),
    "dynamics": ((), dict.fromkeys(("damping", "friction", "spring_rest_position", "spring_stiffness"), ONCE)),
    **dict.fromkeys(_LEAVES, ((), {})),
}
"""The language, as far as it is known here: of each element its attributes, and the elements in it with how many may stand
there."""


@dataclass(frozen=True, slots=True)
class Item:
    """An element of the file."""

    file: str
    element: Element

    def refused(self, why: str) -> ValueError:
        """The error of something that is wrong with it, with file, line and name."""
        name = self.element.attributes.get("name")
        called = f"<{self.element.tag}>" if name is None else f"<{self.element.tag}> {name[:200]!r}"
        return ValueError(f"{self.file}:{self.element.line}: {called}: {why}")

    def all(self, tag: str) -> tuple[Item, ...]:
        """The elements of this tag in it."""
        return tuple(Item(self.file, child) for child in self.element.children if child.tag == tag)

    def find(self, tag: str) -> Item | None:
        """The one element of this tag in it; None without one. Raises ValueError where there are several."""
        elements = self.all(tag)
        if len(elements) > 1:
            raise self.refused(f"has {len(elements)} <{tag}>, should have one")
        return elements[0] if elements else None

    def attribute(self, name: str) -> str:
        """An attribute. Raises ValueError where it is missing."""
        if name not in self.element.attributes:
            raise self.refused(f"no attribute {name!r}")
        return self.element.attributes[name]

    def text(self, tag: str) -> str | None:
        """The text of an element in it; None without one."""
        item = self.find(tag)
        return None if item is None else item.element.text

    def numbers(self, tag: str, count: int | None = None) -> tuple[float, ...] | None:
        """The numbers of an element in it; None without one. Raises ValueError where they are none, not finite, or not
        ``count``."""
        item = self.find(tag)
        if item is None:
            return None
        try:
            return finite_numbers(item.element.text, count)
        except ValueError as error:
            raise item.refused(str(error)) from None

    def number(self, tag: str) -> float | None:
        """The one number of an element in it; None without one."""
        values = self.numbers(tag, 1)
        return None if values is None else values[0]

    def flag(self, tag: str) -> bool | None:
        """Whether an element in it says true; None without one. Raises ValueError for other words than true and false."""
        text = self.text(tag)
        if text not in ("true", "false", None):
            raise self.refused(f"<{tag}> is {text[:60]!r}, should be true or false")
        return None if text is None else text == "true"


@dataclass(frozen=True, slots=True)
class Shape:
    """A shape with its pose in the body; ``kind`` is the tag of its geometry, ``values`` the numbers in that by their tags,
    ``file`` the name of a mesh's file, None of others."""

    item: Item
    kind: str
    values: Mapping[str, tuple[float, ...]]
    pose: Pose | None
    colour: tuple[float, ...] | None
    file: str | None = None


@dataclass(frozen=True, slots=True)
class Body:
    """A body with its pose in the world at zero configuration."""

    item: Item
    name: str
    pose: Pose | None
    inertial: Inertial | None
    gravity: bool | None
    visual: tuple[Shape, ...]
    collision: tuple[Shape, ...]


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis of a joint, with its limits and its losses."""

    item: Item
    xyz: Vector3 | None
    lower: float | None
    upper: float | None
    damping: float | None
    friction: float | None
    spring_rest_position: float | None
    spring_stiffness: float | None


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint of the file's ``type``; ``pose`` in its child. ``position`` and ``velocity`` are the file's coordinates."""

    item: Item
    name: str
    type: str
    parent: str | None
    child: str
    pose: Pose | None
    axis: Axis | None
    position: tuple[float, ...] | None
    velocity: tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class Skeleton:
    """One tree of bodies."""

    item: Item
    name: str
    mobile: bool | None
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]


@dataclass(frozen=True, slots=True)
class Document:
    """A whole file."""

    item: Item
    """Its root element."""
    timestep: float | None
    gravity: Vector3 | None
    collision_detector: str | None
    skeletons: tuple[Skeleton, ...]
    meshes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """The vertices (flat, m) of the files of convex hulls in the folder, by relative path."""


def strangers(document: Document) -> Iterator[str]:
    """What the file has beyond ``LANGUAGE``: elements and attributes that no typed part holds, each with file and line."""
    for element in document.item.element.walk():
        attributes, children = LANGUAGE.get(element.tag, ((), {}))
        for name in element.attributes:
            if name not in attributes:
                yield str(Item(document.item.file, element).refused(f"the attribute {name!r} is not known here"))
        if element.tag in LANGUAGE:
            for child in element.children:
                if child.tag not in children:
                    yield str(Item(document.item.file, child).refused(f"is not known here in <{element.tag}>"))
