"""URDF files as documents, each part with its element and line. A value that a file does not state is None, not a default.

It shares no code with the templates that write, nor with an engine.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeVar

from simspec.errors import SpecError
from simspec.formats.kit.text import FIELDS, XmlElement, parse_xml
from simspec.outputs.files import files_below, read_bytes
from simspec.world import frames
from simspec.world.types import Inertial as WorldInertial
from simspec.world.types import Pose, Vector3
from simspec.world.types import Shape as WorldShape

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
"""The part of the language that simspec writes; other elements in a file of simspec were added later."""


@dataclass(frozen=True, slots=True)
class UrdfOriginNode:
    """Position (m) and fixed-axis angles (rad); each None where the file does not say it."""

    node: XmlElement
    xyz: Vector3 | None
    rpy: Vector3 | None


@dataclass(frozen=True, slots=True)
class UrdfInertialNode:
    """Mass (kg) and inertia (ixx, iyy, izz, ixy, ixz, iyz; kg m²) about ``origin``, in its axes."""

    node: XmlElement
    origin: UrdfOriginNode | None
    mass: float
    inertia: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class UrdfMaterialNode:
    """The material of a visual: its name, and its colour where it stands there."""

    node: XmlElement
    name: str | None
    rgba: tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class UrdfShapeNode:
    """A ``visual`` or a ``collision``; ``geometry`` is the one element in its ``geometry``, of the language or not."""

    node: XmlElement
    name: str | None
    origin: UrdfOriginNode | None
    geometry: XmlElement
    material: UrdfMaterialNode | None = None


@dataclass(frozen=True, slots=True)
class UrdfLinkNode:
    """A link, with its shapes in the order of the file."""

    node: XmlElement
    name: str
    inertial: UrdfInertialNode | None
    visuals: tuple[UrdfShapeNode, ...]
    collisions: tuple[UrdfShapeNode, ...]


@dataclass(frozen=True, slots=True)
class UrdfLimitNode:
    """A joint's ``limit``: position (rad, m), effort (N m, N), velocity (rad/s, m/s)."""

    node: XmlElement
    lower: float | None
    upper: float | None
    effort: float | None
    velocity: float | None


@dataclass(frozen=True, slots=True)
class UrdfDynamicsNode:
    """A joint's damping (N m s/rad, N s/m) and dry friction (N m, N)."""

    node: XmlElement
    damping: float | None
    friction: float | None


@dataclass(frozen=True, slots=True)
class UrdfJointNode:
    """A joint; its ``type`` may be one that the language does not have."""

    node: XmlElement
    name: str
    type: str
    parent: str
    child: str
    origin: UrdfOriginNode | None
    axis: Vector3 | None
    dynamics: UrdfDynamicsNode | None
    limit: UrdfLimitNode | None


@dataclass(frozen=True, slots=True)
class UrdfRobotNode:
    """One file: links and joints in its order; ``root``: the link that is no joint's child."""

    node: XmlElement
    name: str
    links: tuple[UrdfLinkNode, ...]
    joints: tuple[UrdfJointNode, ...]
    root: str


@dataclass(frozen=True, slots=True)
class UrdfDocument:
    """All URDF files of a folder, by name; ``meshes``: the vertices (flat, m) of the files of convex hulls, by path."""

    robots: Mapping[str, UrdfRobotNode]
    meshes: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class UnknownPart:
    """A part that is not of the language: an element, or an attribute (``name``) of one; ``path``: the tags from the root to
    it."""

    node: XmlElement
    path: str
    name: str | None = None


def unknown_parts(robot: UrdfRobotNode, language: Language = LANGUAGE) -> Iterator[UnknownPart]:
    """All elements and attributes of a file that the language does not have, and elements that stand there once too often.
    The contents of an unknown element are not read."""
    yield from _unknown_elements(robot.node, robot.node.tag, language)


def _unknown_elements(node: XmlElement, path: str, language: Language) -> Iterator[UnknownPart]:
    attributes, elements = language[node.tag]
    yield from (UnknownPart(node, path, name) for name in node.attributes if name not in attributes)
    seen: set[str] = set()
    for child in node.children:
        below = f"{path}/{child.tag}"
        how = elements.get(child.tag)
        if how is None or (how == SINGLE and child.tag in seen):
            yield UnknownPart(child, below)
        else:
            yield from _unknown_elements(child, below, language)
        seen.add(child.tag)


LARGEST_FILE: Final = 64 * 2**20
"""Bytes of one file; that of a tree of 10,000 links has 10 million."""
Part = TypeVar("Part")


def read_folder(folder: Path) -> UrdfDocument:
    """All files of a folder, and of those below it, whose names end in ``.urdf``. Raises ValueError with the place."""
    try:
        names = [name for name in files_below(folder) if name.endswith(".urdf")]
        return UrdfDocument({name: read_robot(read_bytes(folder / name, LARGEST_FILE, folder), name) for name in names})
    except SpecError as error:
        raise ValueError(str(error)) from None


def read_robot(content: bytes, file: str) -> UrdfRobotNode:
    """One file; ``file`` is its name in errors and places. Raises ValueError with the place."""
    try:
        content.decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"{file}:1: not UTF-8 at byte {error.start}") from None
    node = parse_xml(content, file, "utf-8")
    if node.tag != "robot":
        raise node.error(f"<{node.tag[:60]}> is the outermost element, should be <robot>")
    links = _distinct([_link(child) for child in node.all("link")], "links")
    joints = _distinct([_joint(child) for child in node.all("joint")], "joints")
    return UrdfRobotNode(node, node.word("name"), links, joints, _root(node, links, joints))


def _distinct(parts: Sequence[Part], what: str) -> tuple[Part, ...]:
    """The same parts. Raises ValueError where two have one name."""
    seen: set[str] = set()
    for part in parts:
        name: str = part.name  # type: ignore[attr-defined]
        if name in seen:
            raise part.node.error(f"two {what} are called {name!r}")  # type: ignore[attr-defined]
        seen.add(name)
    return tuple(parts)


def _root(node: XmlElement, links: Sequence[UrdfLinkNode], joints: Sequence[UrdfJointNode]) -> str:
    """The one link from which joints lead to all others. Raises ValueError where there is none."""
    names = {link.name for link in links}
    below: dict[str, list[str]] = {}
    children: set[str] = set()
    for joint in joints:
        for name in (joint.parent, joint.child):
            if name not in names:
                raise joint.node.error(f"joint {joint.name!r} names a link {name!r}, which there is not")
        if joint.child in children:
            raise joint.node.error(f"link {joint.child!r} is the child of two joints")
        children.add(joint.child)
        below.setdefault(joint.parent, []).append(joint.child)
    roots = [link.name for link in links if link.name not in children]
    if len(roots) != 1:
        raise node.error(f"{len(roots)} links are no joint's child ({', '.join(roots[:5])}), should be one")
    waiting, reached = [roots[0]], 0
    while waiting:
        reached += 1
        waiting.extend(below.get(waiting.pop(), ()))
    if reached != len(links):
        raise node.error(f"joints lead from {roots[0]!r} to {reached} of {len(links)} links: others are in a circle")
    return roots[0]


# --- parts --------------------------------------------------------------------------------------------------------


def _of(node: XmlElement, tag: str, read: Callable[[XmlElement], Part]) -> Part | None:
    """The first element of this tag, read; None where there is none."""
    child = node.child(tag)
    return None if child is None else read(child)


def _vector(node: XmlElement, name: str) -> Vector3 | None:
    values = node.numbers(name, 3)
    return None if values is None else (values[0], values[1], values[2])


def _origin(node: XmlElement) -> UrdfOriginNode:
    return UrdfOriginNode(node, _vector(node, "xyz"), _vector(node, "rpy"))


def _inertial(node: XmlElement) -> UrdfInertialNode:
    inertia = node.need("inertia")
    values = tuple(inertia.number(name) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    return UrdfInertialNode(node, _of(node, "origin", _origin), node.need("mass").need_number("value"), values)


def _material(node: XmlElement) -> UrdfMaterialNode:
    colour = node.child("color")
    rgba = None if colour is None else colour.numbers("rgba", 4)
    return UrdfMaterialNode(node, node.attributes.get("name"), rgba)


def _shape(node: XmlElement) -> UrdfShapeNode:
    geometry = node.need("geometry")
    if len(geometry.children) != 1:
        raise geometry.error(f"<geometry> has {len(geometry.children)} elements, should have one")
    return UrdfShapeNode(
        node,
        node.attributes.get("name"),
        _of(node, "origin", _origin),
        geometry.children[0],
        _of(node, "material", _material),
    )


def _link(node: XmlElement) -> UrdfLinkNode:
    return UrdfLinkNode(
        node,
        node.word("name"),
        _of(node, "inertial", _inertial),
        tuple(map(_shape, node.all("visual"))),
        tuple(map(_shape, node.all("collision"))),
    )


def _joint(node: XmlElement) -> UrdfJointNode:
    axis = node.child("axis")
    return UrdfJointNode(
        node,
        node.word("name"),
        node.word("type"),
        node.need("parent").word("link"),
        node.need("child").word("link"),
        _of(node, "origin", _origin),
        None if axis is None else _vector(axis, "xyz"),
        _of(node, "dynamics", lambda child: UrdfDynamicsNode(child, child.number("damping"), child.number("friction"))),
        _of(
            node,
            "limit",
            lambda child: UrdfLimitNode(
                child, *(child.number(name) for name in ("lower", "upper", "effort", "velocity"))
            ),
        ),
    )


# --- documents in the world's types; absent values have the default of the language: no rotation, no offset, the axis x ---

Size = tuple[str, tuple[float, ...]]
"""The kind of a shape, and its size as in :class:`simspec.world.types.Shape`."""

DEFAULT_AXIS: Vector3 = (1.0, 0.0, 0.0)


def pose_of(origin: UrdfOriginNode | None) -> Pose:
    """An origin as a pose."""
    if origin is None:
        return Pose()
    return Pose(origin.xyz or (0.0, 0.0, 0.0), frames.from_rpy(*(origin.rpy or (0.0, 0.0, 0.0))))


def inertial_of(inertial: UrdfInertialNode | None) -> WorldInertial:
    """Mass, centre of mass, and the tensor turned into the link's axes. A link without one has no mass."""
    if inertial is None:
        return WorldInertial(0.0)
    pose = pose_of(inertial.origin)
    tensor = tuple(value or 0.0 for value in inertial.inertia)
    return WorldInertial(inertial.mass, pose.position, frames.rotate_inertia(pose.quaternion, tensor))


def check_empty(link: UrdfLinkNode) -> None:
    """Raise ValueError where a link that only stands for the world has a mass or shapes."""
    if inertial_of(link.inertial).mass or link.visuals or link.collisions:
        raise link.node.error(f"link {link.name!r} stands for the world, and has a mass or shapes")


def size_of(geometry: XmlElement, meshes: Mapping[str, tuple[float, ...]] = MappingProxyType({})) -> Size:
    """The kind and size of a geometry of the language. ``meshes``: the vertices of convex hulls, and the sizes of height
    fields, by the name of their file; other meshes are not read. Raises ValueError for others."""
    if geometry.tag == "mesh":
        name = geometry.word("filename")
        if name not in meshes or "scale" in geometry.attributes:
            raise geometry.error(f"the mesh {name[:60]!r} is missing, or is scaled, which is not read here")
        return "heightfield" if name.startswith(f"{FIELDS}/") else "mesh", meshes[name]
    if geometry.tag == "box":
        geometry.word("size")
        return "box", geometry.numbers("size", 3) or ()
    if geometry.tag == "sphere":
        return "sphere", (geometry.need_number("radius"),)
    if geometry.tag == "cylinder":
        return "cylinder", (geometry.need_number("radius"), geometry.need_number("length"))
    raise geometry.error(f"a <{geometry.tag[:60]}> is not read here")


def check_meshes(document: UrdfDocument) -> None:
    """Raise ValueError where no shape names a mesh that is there."""
    shapes = (
        shape
        for robot in document.robots.values()
        for link in robot.links
        for shape in (*link.visuals, *link.collisions)
    )
    named = {shape.geometry.attributes.get("filename") for shape in shapes}
    if unused := document.meshes.keys() - named:
        raise ValueError(f"no shape is the mesh of {', '.join(sorted(unused))}")


def shapes_of(
    link: UrdfLinkNode, size: Callable[[XmlElement], Size] = size_of, unseen: Callable[[Size], bool] | None = None
) -> dict[str, WorldShape]:
    """The shapes of a link by name; a ``visual`` and a ``collision`` of one name are one shape.

    ``size`` reads a geometry; visuals of which ``unseen`` is true are left out. Raises ValueError for shapes without a name or
    colour, and where two of one name are not the same.
    """
    shapes: dict[str, WorldShape] = {}
    for visual, elements in ((False, link.collisions), (True, link.visuals)):
        for element in elements:
            kind, numbers = size(element.geometry)
            if visual and unseen is not None and unseen((kind, numbers)):
                continue
            name = element.node.word("name")
            fresh = WorldShape(name, kind, numbers, pose_of(element.origin), collision=False, visual=False)
            known = shapes.get(name, fresh)
            if (known.kind, known.size, known.pose) != (kind, numbers, fresh.pose):
                raise element.node.error(f"link {link.name!r}: visual and collision of shape {name!r} differ")
            if known.visual if visual else known.collision:
                raise element.node.error(f"link {link.name!r} has two shapes {name!r}")
            if visual:
                shapes[name] = dataclasses.replace(known, visual=True, colour=_colour(element))
            else:
                shapes[name] = dataclasses.replace(known, collision=True)
    return shapes


def _colour(visual: UrdfShapeNode) -> tuple[float, float, float, float]:
    rgba = visual.material.rgba if visual.material is not None else None
    if rgba is None:
        raise visual.node.error(f"the visual {visual.name!r} has no colour")
    return (rgba[0], rgba[1], rgba[2], rgba[3])
