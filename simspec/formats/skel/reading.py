"""From a .skel file to a document: poses as rotations, inertias as tensors, everything else as it stands there.

Nothing here is shared with the writer: rotations are put together from the angles' own.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

from simspec.formats.kit.xml_elements import Element, read_xml
from simspec.formats.skel.document import Axis, Body, Document, Item, Joint, Shape, Skeleton
from simspec.world import frames
from simspec.world.types import Inertial, Pose, Quaternion, Vector3

FILE_NAME = "file_name"
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def read_document(path: Path) -> Document:
    """The document of a .skel file. Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file
    and line, where it is no .skel."""
    return document_of(read_xml(path), path.name)


def document_of(root: Element, file: str) -> Document:
    """The document of a parsed file, called ``file`` in errors. Raises ValueError as :func:`read_document`."""
    item = Item(file, root)
    if root.tag != "skel":
        raise item.refused("the root should be <skel>")
    world = item.find("world")
    if world is None:
        raise item.refused("has no <world>")
    physics = world.find("physics")
    timestep = gravity = detector = None
    if physics is not None:
        timestep, gravity = physics.number("time_step"), _vector(physics, "gravity")
        detector = physics.text("collision_detector")
    return Document(item, timestep, gravity, detector, tuple(map(_skeleton, world.all("skeleton"))))


def without_visual_shapes(text: str) -> tuple[str, bool]:
    """A file's text without its visual shapes, and whether there were any. What is no XML is left as it is, for its reader to
    refuse."""
    try:
        tree = ElementTree.fromstring(text)
    except ElementTree.ParseError:
        return text, False
    visual = [(body, shape) for body in tree.iter("body") for shape in body.findall("visualization_shape")]
    for body, shape in visual:
        body.remove(shape)
    return (ElementTree.tostring(tree, encoding="unicode"), True) if visual else (text, False)


def _skeleton(item: Item) -> Skeleton:
    return Skeleton(
        item,
        item.attribute("name"),
        item.flag("mobile"),
        tuple(map(_body, item.all("body"))),
        tuple(map(_joint, item.all("joint"))),
    )


def _body(item: Item) -> Body:
    return Body(
        item,
        item.attribute("name"),
        _pose(item),
        _inertial(item.find("inertia")),
        item.flag("gravity"),
        tuple(map(_shape, item.all("visualization_shape"))),
        tuple(map(_shape, item.all("collision_shape"))),
    )


def _inertial(item: Item | None) -> Inertial | None:
    """Mass properties. Raises ValueError where some of them are missing: a program would invent them."""
    if item is None:
        return None
    mass, centre, tensor = item.number("mass"), _vector(item, "offset"), item.find("moment_of_inertia")
    moments = [] if tensor is None else [tensor.number(name) for name in MOMENTS]
    xx, yy, zz, xy, xz, yz = moments or [None] * 6
    if (
        mass is None
        or centre is None
        or (xx is None or yy is None or zz is None)
        or (xy is None or xz is None or yz is None)
    ):
        raise item.refused("should have a mass, an offset and a whole moment_of_inertia")
    return Inertial(mass, centre, (xx, yy, zz, xy, xz, yz))


def _shape(item: Item) -> Shape:
    geometry = item.find("geometry")
    if geometry is None or len(geometry.element.children) != 1:
        raise item.refused("has no single geometry")
    kind = Item(item.file, geometry.element.children[0])
    file = kind.text(FILE_NAME) if kind.element.tag == "mesh" else None
    tags = (child.tag for child in kind.element.children if file is None or child.tag != FILE_NAME)
    values = {tag: kind.numbers(tag) or () for tag in tags}
    return Shape(item, kind.element.tag, values, _pose(item), item.numbers("color"), file)


def _joint(item: Item) -> Joint:
    parent, child, axis = item.text("parent"), item.text("child"), item.find("axis")
    if not child:
        raise item.refused("has no <child>")
    return Joint(
        item,
        item.attribute("name"),
        item.attribute("type"),
        parent,
        child,
        _pose(item),
        None if axis is None else _axis(axis),
        item.numbers("init_pos"),
        item.numbers("init_vel"),
    )


def _axis(item: Item) -> Axis:
    limit, dynamics = item.find("limit"), item.find("dynamics")
    names = ("damping", "friction", "spring_rest_position", "spring_stiffness")
    lower, upper = (None, None) if limit is None else (limit.number("lower"), limit.number("upper"))
    return Axis(
        item,
        _vector(item, "xyz"),
        lower,
        upper,
        *(None if dynamics is None else dynamics.number(name) for name in names),
    )


def _vector(item: Item, tag: str) -> Vector3 | None:
    values = item.numbers(tag, 3)
    return None if values is None else (values[0], values[1], values[2])


def _pose(item: Item) -> Pose | None:
    """The <transformation> of an element: a position, then rotations about the x, the new y and the new z axis."""
    values = item.numbers("transformation", 6)
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
