"""Read a folder of .skel and its sidecar with the standard library's XML parser (proof level L0).

Nothing here is shared with the emitter but the names of the files: poses are put together from the angles' own rotations,
and a joint's place in its parent follows from the two bodies' poses at zero configuration.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from simspec.dialects.dart.filter import check_filter
from simspec.dialects.dart.sidecar import check_sidecar
from simspec.dialects.kit.sidecar import read_sidecar
from simspec.formats.kit.passes import restore_frames
from simspec.world import frames
from simspec.world.types import Body, Inertial, Joint, Pose, Quaternion, ReadBack, Shape, Surface, Vector3

KINDS = {"weld": "fixed", "revolute": "hinge", "prismatic": "slide", "ball": "ball", "free": "free"}
SIZES: Mapping[str, tuple[tuple[str, ...], float]] = {
    "sphere": (("radius",), 1.0),
    "box": (("size",), 1.0),
    "cylinder": (("radius", "height"), 1.0),
    "capsule": (("radius", "height"), 1.0),
    "ellipsoid": (("size",), 0.5),
}
"""Of each geometry the elements that give the size, and their factor."""

PICTURE = "visualization_shape"
"""A body's element for a shape that is there to be seen."""

UNREADABLE = {
    "collision_group": "the files carry what touches what, not the names of groups",
    "control.native": "the engine's own controllers are switched on when a run begins",
}


def without_pictures(text: str) -> tuple[str, bool]:
    """A file's text without its shapes for the eye, and whether there were any. What is no XML is left as it is, for its
    reader to refuse."""
    try:
        tree = ElementTree.fromstring(text)
    except ElementTree.ParseError:
        return text, False
    seen = [(body, shape) for body in tree.iter("body") for shape in body.findall(PICTURE)]
    for body, shape in seen:
        body.remove(shape)
    return (ElementTree.tostring(tree, encoding="unicode"), True) if seen else (text, False)


def _text(element: ElementTree.Element, path: str) -> str:
    found = element.find(path)
    if found is None or found.text is None:
        raise ValueError(f"a <{element.tag}> has no <{path}>")
    return found.text.strip()


def _numbers(element: ElementTree.Element, path: str, count: int) -> tuple[float, ...]:
    found = tuple(float(word) for word in _text(element, path).split())
    if len(found) != count:
        raise ValueError(f"<{path}> of a <{element.tag}> has {len(found)} numbers, not {count}")
    return found


def _about(axis: int, turn: float) -> Quaternion:
    parts = [math.cos(turn / 2.0), 0.0, 0.0, 0.0]
    parts[1 + axis] = math.sin(turn / 2.0)
    return (parts[0], parts[1], parts[2], parts[3])


def _pose(element: ElementTree.Element) -> Pose:
    """The <transformation> of an element: a position, then rotations about the x, the new y and the new z axis."""
    x, y, z, *angles = _numbers(element, "transformation", 6)
    turn = frames.IDENTITY
    for axis, angle in enumerate(angles):
        turn = frames.multiply(turn, _about(axis, angle))
    return Pose((x, y, z), frames.normalise(turn))


def _turn(vector: Sequence[float]) -> Quaternion:
    """The rotation of a rotation vector."""
    angle = math.sqrt(sum(x * x for x in vector))
    if angle == 0.0:
        return frames.IDENTITY
    share = math.sin(angle / 2.0) / angle
    return frames.normalise((math.cos(angle / 2.0), *(share * x for x in vector)))  # type: ignore[arg-type]


def _inertial(body: ElementTree.Element) -> Inertial:
    inertia = body.find("inertia")
    if inertia is None:
        raise ValueError(f"body {body.get('name')!r} has no <inertia>")
    moments = tuple(
        _numbers(inertia, f"moment_of_inertia/{name}", 1)[0] for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    return Inertial(
        _numbers(inertia, "mass", 1)[0],
        _numbers(inertia, "offset", 3),  # type: ignore[arg-type]
        moments,  # type: ignore[arg-type]
    )


def _geometry(element: ElementTree.Element) -> tuple[str, tuple[float, ...]]:
    geometry = element.find("geometry")
    if geometry is None or len(geometry) != 1:
        raise ValueError(f"a <{element.tag}> has no single geometry")
    kind = geometry[0]
    if kind.tag == "plane":
        if _numbers(kind, "normal", 3) != (0.0, 0.0, 1.0) or any(_numbers(kind, "offset", 1)):
            raise ValueError("a <plane> is not the x-y plane of its own frame")
        return "plane", ()
    if kind.tag not in SIZES:
        raise ValueError(f"a geometry <{kind.tag}> is not known here")
    names, factor = SIZES[kind.tag]
    return kind.tag, tuple(float(word) * factor for name in names for word in _text(kind, name).split())


def _shapes(
    nodes: Mapping[str, ElementTree.Element], own: str, given: Sequence[Mapping[str, Any]]
) -> tuple[Shape, ...]:
    """The shapes of a body in the order of the sidecar, which says which of them are visual and on which nodes they are
    solid. ``nodes`` are the body's, ``own`` the name of the one that has the visual shapes."""
    solid = {name: node.findall("collision_shape") for name, node in nodes.items()}
    seen = nodes[own].findall(PICTURE)
    found = []
    for entry in given:
        name = entry["name"]
        read: list[Shape] = []
        for copy in entry["surfaces"]:
            if not solid.get(copy["node"]):
                raise ValueError(f"node {copy['node']!r} has too few collision shapes for {name!r}")
            read.append(_shape(name, solid[copy["node"]].pop(0)))
        if entry["visual"]:
            if not seen:
                raise ValueError(f"body {own!r} has too few visual shapes for {name!r}")
            element = seen.pop(0)
            read.append(dataclasses.replace(_shape(name, element), colour=_numbers(element, "color", 4)))
        if not read:
            raise ValueError(f"shape {name!r} is neither visual nor collision")
        if any((one.kind, one.size, one.pose) != (read[0].kind, read[0].size, read[0].pose) for one in read):
            raise ValueError(f"visual and collision of shape {name!r}, or two of its copies, differ")
        surfaces = tuple(Surface(copy["friction"], restitution=copy["restitution"]) for copy in entry["surfaces"])
        found.append(
            dataclasses.replace(read[-1], visual=entry["visual"], collision=bool(entry["surfaces"]), surfaces=surfaces)
        )
    left = [name for name, elements in (*solid.items(), (own, seen)) if elements]
    if left:
        raise ValueError(f"nodes {left} have shapes that the sidecar does not name")
    return tuple(found)


def _shape(name: str, element: ElementTree.Element) -> Shape:
    kind, size = _geometry(element)
    return Shape(name, kind, size, _pose(element))


def _check_copy(node: str, body: str, elements: Mapping[str, ElementTree.Element], joint: Joint) -> None:
    """A further node of a body is its own but for the name: in the same place, without mass, held by a weld."""
    held, own = elements[node], elements[body]
    if joint.kind != "fixed" or joint.parent != body:
        raise ValueError(f"node {node!r} is not welded to {body!r}")
    if _text(held, "transformation") != _text(own, "transformation"):
        raise ValueError(f"node {node!r} is not where {body!r} is")
    inertial = _inertial(held)
    if inertial.mass or any(inertial.inertia) or held.findall(PICTURE):
        raise ValueError(f"node {node!r} has a mass or can be seen, which its body {body!r} should")


def _joint(joint: ElementTree.Element, places: Mapping[str, Pose]) -> Joint:
    kind = KINDS[joint.attrib["type"]]
    above, child = _text(joint, "parent"), _text(joint, "child")
    if any(_numbers(joint, "transformation", 6)):
        raise ValueError(f"joint {joint.get('name')!r} is not at its child's frame")
    start = places[child]
    parent = None if above == "world" else above
    if parent is not None:
        start = frames.compose(frames.inverse(places[parent]), start)
    axis: Vector3 = (0.0, 0.0, 0.0)
    limits = None
    friction = 0.0
    if kind in ("hinge", "slide"):
        axis = _numbers(joint, "axis/xyz", 3)  # type: ignore[assignment]
        if joint.find("axis/limit") is not None:
            limits = (_numbers(joint, "axis/limit/lower", 1)[0], _numbers(joint, "axis/limit/upper", 1)[0])
        friction = _numbers(joint, "axis/dynamics/friction", 1)[0]
        for name in ("damping", "spring_stiffness", "spring_rest_position"):
            if _numbers(joint, f"axis/dynamics/{name}", 1)[0]:
                raise ValueError(f"joint {joint.get('name')!r} has DART's own, implicit, {name}")
    position: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    if kind != "fixed":
        count = {"hinge": 1, "slide": 1, "ball": 3, "free": 6}[kind]
        position, velocity = _numbers(joint, "init_pos", count), _numbers(joint, "init_vel", count)
    if kind == "ball":
        position = _turn(position)
    elif kind == "free":
        placed = frames.compose(start, Pose(position[3:], _turn(position[:3])))  # type: ignore[arg-type]
        position = (*placed.position, *placed.quaternion)
        velocity = (*velocity[3:], *velocity[:3])
        start = Pose()
    return Joint(
        joint.attrib["name"],
        kind,
        parent,
        start,
        axis,
        limits,
        dry_friction=friction,
        position=position,
        velocity=velocity,
    )


def read_folder(folder: Path) -> ReadBack:
    """The model that ``world.skel`` and the sidecar in ``folder`` say, in the world's frames and order.

    Raises ValueError where the file and the sidecar do not fit together.
    """
    content = read_sidecar(folder)
    check_sidecar(content)
    root = ElementTree.fromstring((folder / "world.skel").read_bytes())
    held = root.find("world")
    if held is None:
        raise ValueError("world.skel has no <world>")
    elements = {body.attrib["name"]: body for body in held.iterfind("skeleton/body")}
    places = {name: _pose(body) for name, body in elements.items()}
    entries = content["bodies"]
    # a body that is called "world" goes by another name in the file
    own = {"world": "world."}
    back = {there: here for here, there in own.items()}
    copies = {copy["node"]: own.get(copy["body"], copy["body"]) for copy in content["copies"]}
    if sorted([own.get(entry["name"], entry["name"]) for entry in entries] + list(copies)) != sorted(elements):
        raise ValueError("the bodies of world.skel are not those that the sidecar names")
    joints = {}
    for element in held.iterfind("skeleton/joint"):
        joints[_text(element, "child")] = _joint(element, places)
    if set(joints) != set(elements):
        raise ValueError(f"the joints of {sorted(set(joints) ^ set(elements))} are missing, or have no body")
    shapes: dict[str, list[Mapping[str, Any]]] = {}
    for shape in content["shapes"]:
        shapes.setdefault(shape["body"], []).append(shape)
    nodes: dict[str, list[str]] = {}
    for node, body in copies.items():
        _check_copy(node, body, elements, joints[node])
        nodes.setdefault(body, []).append(node)
    check_filter(content, set(elements), {back.get(name, name) for name in _fixed(joints)})
    found: dict[str, Body] = {}
    for entry, model in zip(entries, content["models"], strict=True):
        name = own.get(entry["name"], entry["name"])
        joint = joints[name]
        if joint.parent is not None:
            joint = dataclasses.replace(joint, parent=back.get(joint.parent, joint.parent))
        held_nodes = {node: elements[node] for node in (name, *nodes.get(name, ()))}
        found[entry["name"]] = Body(
            entry["name"],
            model,
            _inertial(elements[name]),
            joint,
            _shapes(held_nodes, name, shapes.get(entry["name"], ())),
        )
    for key, field in (
        ("velocity_limits", "velocity_limit"),
        ("effort_limits", "effort_limit"),
        ("damping", "damping"),
        ("armature", "armature"),
    ):
        for value in content[key]:
            _set_joint(found, value["body"], **{field: value["value"]})
    for spring in content["springs"]:
        _set_joint(found, spring["body"], spring_stiffness=spring["stiffness"], spring_rest=spring["rest"])
    limited = {name for name, body in found.items() if body.joint.position_limits is not None}
    if limited != set(content["enforce_limits"]):
        raise ValueError(
            f"limits of {sorted(limited ^ set(content['enforce_limits']))} are not both given and enforced"
        )
    offsets = {entry["name"]: tuple(entry["frame_offset"]) for entry in entries if any(entry["frame_offset"])}
    return ReadBack(
        restore_frames(tuple(found[entry["name"]] for entry in entries), offsets),
        _numbers(held, "physics/gravity", 3),  # type: ignore[arg-type]
        _numbers(held, "physics/time_step", 1)[0],
        content["friction_cone"],
        dict(UNREADABLE),
    )


def _fixed(joints: Mapping[str, Joint]) -> set[str]:
    """The nodes that cannot move."""

    def stands(name: str | None) -> bool:
        while name is not None:
            if joints[name].kind != "fixed":
                return False
            name = joints[name].parent
        return True

    return {name for name in joints if stands(name)}


def _set_joint(bodies: dict[str, Body], name: str, **changes: float) -> None:
    bodies[name] = dataclasses.replace(bodies[name], joint=dataclasses.replace(bodies[name].joint, **changes))
