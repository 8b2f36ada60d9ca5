"""What was read: robots of the URDF language, each element with its line, and nothing left out.

An absent element or attribute is None here, not its default: what a file does not say, it does not say. Every typed part keeps
its :class:`Node`, the element as it stands in the file; :func:`strangers` finds all that is not of the language.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from simspec import numerals
from simspec.world.types import Vector3

SINGLE: Final = "single"
"""An element that may stand there once."""
SEVERAL: Final = "several"
Language = Mapping[str, tuple[tuple[str, ...], Mapping[str, str]]]
LANGUAGE: Final[Language] = {
    "robot": (("name", "version"), {"link": SEVERAL, "joint": SEVERAL, "material": SEVERAL}),
    "link": (("name",), {"inertial": SINGLE, "visual": SEVERAL, "collision": SEVERAL}),
    "inertial": ((), {"origin": SINGLE, "mass": SINGLE, "inertia": SINGLE}),
    "mass": (("value",), {}),
    "inertia": (("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), {}),
    "visual": (("name",), {"origin": SINGLE, "geometry": SINGLE, "material": SINGLE}),
    "collision": (("name",), {"origin": SINGLE, "geometry": SINGLE}),
    "origin": (("xyz", "rpy"), {}),
    "geometry": ((), {"box": SINGLE, "cylinder": SINGLE, "sphere": SINGLE, "mesh": SINGLE}),
    "box": (("size",), {}),
    "cylinder": (("radius", "length"), {}),
    "sphere": (("radius",), {}),
    "mesh": (("filename", "scale"), {}),
    "material": (("name",), {"color": SINGLE, "texture": SINGLE}),
    "color": (("rgba",), {}),
    "texture": (("filename",), {}),
    "joint": (
        ("name", "type"),
        dict.fromkeys(
            ("origin", "parent", "child", "axis", "calibration", "dynamics", "limit", "mimic", "safety_controller"),
            SINGLE,
        ),
    ),
    "parent": (("link",), {}),
    "child": (("link",), {}),
    "axis": (("xyz",), {}),
    "calibration": (("rising", "falling"), {}),
    "dynamics": (("damping", "friction"), {}),
    "limit": (("lower", "upper", "effort", "velocity"), {}),
    "mimic": (("joint", "multiplier", "offset"), {}),
    "safety_controller": (("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"), {}),
}
"""The language: of each element its attributes, and the elements in it with how many there may be."""
UNWRITTEN: Final = ("robot/material", "material/texture", "joint/calibration", "joint/mimic", "joint/safety_controller")
WRITTEN: Final[Language] = {
    tag: (attributes, {name: how for name, how in elements.items() if f"{tag}/{name}" not in UNWRITTEN})
    for tag, (attributes, elements) in LANGUAGE.items()
}
"""The part of the language that simspec writes; what else stands in a file of simspec's, somebody has added."""


@dataclass(frozen=True, slots=True)
class Place:
    """The line of a file that an element begins in, or ends in where it is longer than one."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass(frozen=True, slots=True)
class Node:
    """An element as it stands in the file; comments are left out."""

    tag: str
    place: Place
    attributes: Mapping[str, str]
    children: tuple[Node, ...] = ()
    text: str = ""

    def child(self, tag: str) -> Node | None:
        """The first element of this tag; None where there is none."""
        return next((child for child in self.children if child.tag == tag), None)

    def all(self, tag: str) -> tuple[Node, ...]:
        """All elements of this tag."""
        return tuple(child for child in self.children if child.tag == tag)

    def need(self, tag: str) -> Node:
        """The first element of this tag. Raises ValueError where there is none."""
        found = self.child(tag)
        if found is None:
            raise self.error(f"<{self.tag}> has no <{tag}>")
        return found

    def word(self, name: str) -> str:
        """The text of an attribute. Raises ValueError where there is none."""
        if name not in self.attributes:
            raise self.error(f"<{self.tag}> has no attribute {name!r}")
        return self.attributes[name]

    def numbers(self, name: str, count: int) -> tuple[float, ...] | None:
        """``count`` finite numbers of an attribute; None where there is no such attribute. Raises ValueError for others."""
        text = self.attributes.get(name)
        if text is None:
            return None
        try:
            return numerals.numbers(text, count)
        except numerals.NumeralError:
            what = "a finite number" if count == 1 else f"{count} finite numbers"
            raise self.error(f"{name}={text[:60]!r} of <{self.tag}>, should be {what}") from None

    def number(self, name: str) -> float | None:
        """One finite number of an attribute; None where there is no such attribute. Raises ValueError for others."""
        values = self.numbers(name, 1)
        return None if values is None else values[0]

    def need_number(self, name: str) -> float:
        """One finite number of an attribute. Raises ValueError where there is none."""
        self.word(name)
        value = self.number(name)
        assert value is not None
        return value

    def error(self, why: str) -> ValueError:
        """The error of this element."""
        return ValueError(f"{self.place}: {why}")


@dataclass(frozen=True, slots=True)
class Origin:
    """Position (m) and fixed-axis angles (rad); each None where the file does not say it."""

    node: Node
    xyz: Vector3 | None
    rpy: Vector3 | None


@dataclass(frozen=True, slots=True)
class Inertial:
    """Mass (kg) and inertia (ixx, iyy, izz, ixy, ixz, iyz; kg m²) about ``origin``, in its axes."""

    node: Node
    origin: Origin | None
    mass: float
    inertia: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class Material:
    """The material of a visual: its name, and its colour where it stands there."""

    node: Node
    name: str | None
    rgba: tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class Shape:
    """A ``visual`` or a ``collision``; ``geometry`` is the one element in its ``geometry``, of the language or not."""

    node: Node
    name: str | None
    origin: Origin | None
    geometry: Node
    material: Material | None = None


@dataclass(frozen=True, slots=True)
class Link:
    """A link, with its shapes in the order of the file."""

    node: Node
    name: str
    inertial: Inertial | None
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]


@dataclass(frozen=True, slots=True)
class Limit:
    """A joint's ``limit``: position (rad, m), effort (N m, N), velocity (rad/s, m/s)."""

    node: Node
    lower: float | None
    upper: float | None
    effort: float | None
    velocity: float | None


@dataclass(frozen=True, slots=True)
class Dynamics:
    """A joint's damping (N m s/rad, N s/m) and dry friction (N m, N)."""

    node: Node
    damping: float | None
    friction: float | None


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint; its ``type`` may be one that the language does not have."""

    node: Node
    name: str
    type: str
    parent: str
    child: str
    origin: Origin | None
    axis: Vector3 | None
    dynamics: Dynamics | None
    limit: Limit | None


@dataclass(frozen=True, slots=True)
class Robot:
    """One file: links and joints in its order; ``root``: the link that is no joint's child."""

    node: Node
    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    root: str


@dataclass(frozen=True, slots=True)
class Document:
    """All URDF files of a folder, by name; ``meshes``: the vertices (flat, m) of the files of convex hulls, by path."""

    robots: Mapping[str, Robot]
    meshes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Stranger:
    """What is not of the language: an element, or an attribute (``name``) of one; ``path``: the tags from the root to it."""

    node: Node
    path: str
    name: str | None = None


def strangers(robot: Robot, language: Language = LANGUAGE) -> Iterator[Stranger]:
    """All elements and attributes of a file that the language does not have, and elements that stand there once too often.
    What is inside a strange element is not looked at."""
    yield from _strangers(robot.node, robot.node.tag, language)


def _strangers(node: Node, path: str, language: Language) -> Iterator[Stranger]:
    attributes, elements = language[node.tag]
    yield from (Stranger(node, path, name) for name in node.attributes if name not in attributes)
    seen: set[str] = set()
    for child in node.children:
        below = f"{path}/{child.tag}"
        how = elements.get(child.tag)
        if how is None or (how == SINGLE and child.tag in seen):
            yield Stranger(child, below)
        else:
            yield from _strangers(child, below, language)
        seen.add(child.tag)
