""".skel files as documents: a value that a file does not state is None, not a default of a program. No code of the writer is
used."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from simspec.formats.kit.text import XmlElement, read_xml
from simspec.world import frames
from simspec.world.types import Inertial, Pose, Quaternion, Vector3

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
class SkelShapeItem:
    """A shape with its pose in the body; ``kind`` is the tag of its geometry, ``values`` the numbers in that by their tags,
    ``file`` the name of a mesh's file, None of others."""

    item: XmlElement
    kind: str
    values: Mapping[str, tuple[float, ...]]
    pose: Pose | None
    colour: tuple[float, ...] | None
    file: str | None = None


@dataclass(frozen=True, slots=True)
class SkelBodyItem:
    """A body with its pose in the world at zero configuration."""

    item: XmlElement
    name: str
    pose: Pose | None
    inertial: Inertial | None
    gravity: bool | None
    visual: tuple[SkelShapeItem, ...]
    collision: tuple[SkelShapeItem, ...]


@dataclass(frozen=True, slots=True)
class SkelAxisItem:
    """An axis of a joint, with its limits and its losses."""

    item: XmlElement
    xyz: Vector3 | None
    lower: float | None
    upper: float | None
    damping: float | None
    friction: float | None
    spring_rest_position: float | None
    spring_stiffness: float | None


@dataclass(frozen=True, slots=True)
class SkelJointItem:
    """A joint of the file's ``type``; ``pose`` in its child. ``position`` and ``velocity`` are the file's coordinates."""

    item: XmlElement
    name: str
    type: str
    parent: str | None
    child: str
    pose: Pose | None
    axis: SkelAxisItem | None
    position: tuple[float, ...] | None
    velocity: tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class SkeletonItem:
    """One tree of bodies."""

    item: XmlElement
    name: str
    mobile: bool | None
    bodies: tuple[SkelBodyItem, ...]
    joints: tuple[SkelJointItem, ...]


@dataclass(frozen=True, slots=True)
class SkelDocument:
    """A whole file."""

    item: XmlElement
    """Its root element."""
    timestep: float | None
    gravity: Vector3 | None
    collision_detector: str | None
    skeletons: tuple[SkeletonItem, ...]
    meshes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """The vertices (flat, m) of the files of convex hulls in the folder, by relative path."""


def unknown_parts(document: SkelDocument) -> Iterator[str]:
    """Parts of the file beyond ``LANGUAGE``: elements and attributes that no typed part holds, each with file and line."""
    for element in document.item.walk():
        attributes, children = LANGUAGE.get(element.tag, ((), {}))
        for name in element.attributes:
            if name not in attributes:
                yield str(element.refused(f"the attribute {name!r} is not known here"))
        if element.tag in LANGUAGE:
            for child in element.children:
                if child.tag not in children:
                    yield str(child.refused(f"is not known here in <{element.tag}>"))


FILE_NAME = "file_name"
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def read_document(path: Path) -> SkelDocument:
    """The document of a .skel file. Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file
    and line, where it is no .skel."""
    return document_of(read_xml(path), path.name)


def document_of(root: XmlElement, file: str) -> SkelDocument:
    """The document of a parsed file, called ``file`` in errors. Raises ValueError as :func:`read_document`."""
    item = root
    if root.tag != "skel":
        raise item.refused("the root should be <skel>")
    world = item.find("world")
    if world is None:
        raise item.refused("has no <world>")
    physics = world.find("physics")
    timestep = gravity = detector = None
    if physics is not None:
        timestep, gravity = physics.number_of("time_step"), _vector(physics, "gravity")
        detector = physics.text_of("collision_detector")
    return SkelDocument(item, timestep, gravity, detector, tuple(map(_skeleton, world.all("skeleton"))))


def without_visual_shapes(text: str) -> tuple[str, bool]:
    """A file's text without its visual shapes, and whether there were any. A text that is no XML is left unchanged, for its
    reader to refuse."""
    try:
        tree = ElementTree.fromstring(text)
    except ElementTree.ParseError:
        return text, False
    visual = [(body, shape) for body in tree.iter("body") for shape in body.findall("visualization_shape")]
    for body, shape in visual:
        body.remove(shape)
    return (ElementTree.tostring(tree, encoding="unicode"), True) if visual else (text, False)


def _skeleton(item: XmlElement) -> SkeletonItem:
    return SkeletonItem(
        item,
        item.word("name"),
        item.flag_of("mobile"),
        tuple(map(_body, item.all("body"))),
        tuple(map(_joint, item.all("joint"))),
    )


def _body(item: XmlElement) -> SkelBodyItem:
    return SkelBodyItem(
        item,
        item.word("name"),
        _pose(item),
        _inertial(item.find("inertia")),
        item.flag_of("gravity"),
        tuple(map(_shape, item.all("visualization_shape"))),
        tuple(map(_shape, item.all("collision_shape"))),
    )


def _inertial(item: XmlElement | None) -> Inertial | None:
    """Mass properties. Raises ValueError where some of them are missing: a program would invent them."""
    if item is None:
        return None
    mass, centre, tensor = item.number_of("mass"), _vector(item, "offset"), item.find("moment_of_inertia")
    moments = [] if tensor is None else [tensor.number_of(name) for name in MOMENTS]
    xx, yy, zz, xy, xz, yz = moments or [None] * 6
    if (
        mass is None
        or centre is None
        or (xx is None or yy is None or zz is None)
        or (xy is None or xz is None or yz is None)
    ):
        raise item.refused("should have a mass, an offset and a whole moment_of_inertia")
    return Inertial(mass, centre, (xx, yy, zz, xy, xz, yz))


def _shape(item: XmlElement) -> SkelShapeItem:
    geometry = item.find("geometry")
    if geometry is None or len(geometry.children) != 1:
        raise item.refused("has no single geometry")
    kind = geometry.children[0]
    file = kind.text_of(FILE_NAME) if kind.tag == "mesh" else None
    tags = (child.tag for child in kind.children if file is None or child.tag != FILE_NAME)
    values = {tag: kind.numbers_of(tag) or () for tag in tags}
    return SkelShapeItem(item, kind.tag, values, _pose(item), item.numbers_of("color"), file)


def _joint(item: XmlElement) -> SkelJointItem:
    parent, child, axis = item.text_of("parent"), item.text_of("child"), item.find("axis")
    if not child:
        raise item.refused("has no <child>")
    return SkelJointItem(
        item,
        item.word("name"),
        item.word("type"),
        parent,
        child,
        _pose(item),
        None if axis is None else _axis(axis),
        item.numbers_of("init_pos"),
        item.numbers_of("init_vel"),
    )


def _axis(item: XmlElement) -> SkelAxisItem:
    limit, dynamics = item.find("limit"), item.find("dynamics")
    names = ("damping", "friction", "spring_rest_position", "spring_stiffness")
    lower, upper = (None, None) if limit is None else (limit.number_of("lower"), limit.number_of("upper"))
    return SkelAxisItem(
        item,
        _vector(item, "xyz"),
        lower,
        upper,
        *(None if dynamics is None else dynamics.number_of(name) for name in names),
    )


def _vector(item: XmlElement, tag: str) -> Vector3 | None:
    values = item.numbers_of(tag, 3)
    return None if values is None else (values[0], values[1], values[2])


def _pose(item: XmlElement) -> Pose | None:
    """The <transformation> of an element: a position, then rotations about the x, the new y and the new z axis."""
    values = item.numbers_of("transformation", 6)
    if values is None:
        return None
    turn = frames.IDENTITY
    for axis, angle in enumerate(values[3:]):
        turn = frames.multiply(turn, _about(axis, angle))
    return Pose((values[0], values[1], values[2]), frames.normalise(turn))


def _about(axis: int, turn: float) -> Quaternion:
    parts = [math.cos(turn / 2.0), 0.0, 0.0, 0.0]
    parts[1 + axis] = math.sin(turn / 2.0)
    return (parts[0], parts[1], parts[2], parts[3])
