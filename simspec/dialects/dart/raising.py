"""From a .skel document and its sidecar back to the model they mean to DART, in the world's frames (proof level L0).

Nothing here is shared with ``dialect.py``: a joint's place in its parent follows from the two bodies' poses at zero
configuration, and rotations are put together from the file's own numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from simspec.dialects.dart.contact import check_filter
from simspec.dialects.dart.sidecar import DartShapeEntry, DartSidecar
from simspec.dialects.kit.sidecar import UNREADABLE, add_springs, fluid_of, with_passive
from simspec.formats.kit.contract import restore_frames
from simspec.formats.kit.text import XmlElement
from simspec.formats.skel import reading as skel
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.rotations import exponential_of
from simspec.world.types import Body, Inertial, Joint, Pose, ReadBack, Shape, Surface

KINDS = {"weld": "fixed", "revolute": "hinge", "prismatic": "slide", "ball": "ball", "free": "free"}
COORDINATES = {"fixed": 0, "hinge": 1, "slide": 1, "ball": 3, "free": 6}
"""Numbers in a joint's position in the file, and in its velocity."""
SIZES: Mapping[str, tuple[tuple[str, ...], int, float]] = {
    "sphere": (("radius",), 1, 1.0),
    "box": (("size",), 3, 1.0),
    "cylinder": (("radius", "height"), 2, 1.0),
    "capsule": (("radius", "height"), 2, 1.0),
    "ellipsoid": (("size",), 3, 0.5),
}
"""Of each geometry the elements that give the size, how many numbers that is, and their factor."""
PLANE = {"normal": (0.0, 0.0, 1.0), "offset": (0.0,)}
RENAMED = {"world": "world."}
"""A body that is called "world" goes by another name in the file."""
BACK = {there: here for here, there in RENAMED.items()}
IMPLICIT = ("damping", "spring_stiffness", "spring_rest_position")
"""Of an axis what DART computes in a way of its own: zero in the file."""

Value = TypeVar("Value")


def raised(document: skel.SkelDocument, sidecar: DartSidecar) -> ReadBack:
    """The model of a document. Raises ValueError, which names the place, for what is missing, for what simspec does not say to
    DART, and where document and sidecar do not fit together."""
    for complaint in skel.unknown_parts(document):
        raise ValueError(complaint)
    _check_meshes(document)
    elements = {body.name: body for body in _distinct(document)}
    places = {name: _needed(body.item, body.pose, "transformation") for name, body in elements.items()}
    welded = {copy.node: RENAMED.get(copy.body, copy.body) for copy in sidecar.copies}
    if sorted([RENAMED.get(body.name, body.name) for body in sidecar.bodies] + list(welded)) != sorted(elements):
        raise ValueError("the bodies of world.skel differ from those that the sidecar names")
    joints = _joints(document, places)
    nodes: dict[str, list[str]] = {}
    for node, body in welded.items():
        _check_welded(elements[node], elements[body], joints[node])
        nodes.setdefault(body, []).append(node)
    check_filter(sidecar, set(elements), {BACK.get(name, name) for name in _fixed(joints)})
    shapes: dict[str, list[DartShapeEntry]] = {}
    for shape in sidecar.shapes:
        shapes.setdefault(shape.body, []).append(shape)
    bodies: dict[str, Body] = {}
    for entry, model in zip(sidecar.bodies, sidecar.models, strict=True):
        name = RENAMED.get(entry.name, entry.name)
        joint = joints[name]
        if joint.parent is not None:
            joint = replace(joint, parent=BACK.get(joint.parent, joint.parent))
        body_nodes = {node: elements[node] for node in (name, *nodes.get(name, ()))}
        inertial = _needed(elements[name].item, elements[name].inertial, "inertia")
        bodies[entry.name] = Body(
            entry.name, model, inertial, joint, _shapes(body_nodes, name, shapes.get(entry.name, ()), document.meshes)
        )
    _complete_joints(bodies, sidecar)
    physics = document.item
    return ReadBack(
        restore_frames(
            with_passive(tuple(bodies[entry.name] for entry in sidecar.bodies), sidecar.passive), sidecar.offsets
        ),
        _needed(physics, document.gravity, "gravity"),
        _needed(physics, document.timestep, "time_step"),
        sidecar.friction_cone,
        dict(UNREADABLE),
        constraints=sidecar.constraints or (),
        sums=sidecar.sums or (),
        fluid=fluid_of(sidecar.passive),
    )


def _needed(item: XmlElement, value: Value | None, tag: str) -> Value:
    """A value that every file of this dialect states. Raises ValueError where it is missing."""
    if value is None:
        raise item.refused(f"has no <{tag}>")
    return value


def _distinct(document: skel.SkelDocument) -> list[skel.SkelBodyItem]:
    """All bodies. Raises ValueError where two have one name, which DART would leave out, or gravity does not act on one."""
    bodies = [body for skeleton in document.skeletons for body in skeleton.bodies]
    names: set[str] = set()
    for body in bodies:
        if body.name in names:
            raise body.item.refused("is there twice")
        if body.gravity is not True:
            raise body.item.refused("should have the <gravity> true")
        names.add(body.name)
    return bodies


# --- joints -------------------------------------------------------------------------------------------------------


def _joints(document: skel.SkelDocument, places: Mapping[str, Pose]) -> dict[str, Joint]:
    """The joint of every body, by its name."""
    joints: dict[str, Joint] = {}
    for skeleton in document.skeletons:
        for joint in skeleton.joints:
            if joint.child in joints or joint.child not in places:
                raise joint.item.refused(f"the body {joint.child!r} is missing, or has another joint")
            joints[joint.child] = _joint(joint, places)
    without = sorted(set(places) - set(joints))
    if without:
        raise ValueError(f"the joints of {without} are missing")
    return joints


def _joint(joint: skel.SkelJointItem, places: Mapping[str, Pose]) -> Joint:
    item = joint.item
    kind = KINDS.get(joint.type)
    if kind is None:
        raise item.refused(f"the type {joint.type!r} is not known here")
    if any(item.numbers_of("transformation", 6) or (1.0,)):
        raise item.refused("is not at its child's frame")
    above = _needed(item, joint.parent, "parent")
    parent = None if above == "world" else above
    start = places[joint.child]
    if parent is not None:
        if parent not in places:
            raise item.refused(f"the parent {parent!r} is missing")
        start = frames.compose(frames.inverse(places[parent]), start)
    read = Joint(joint.name, kind, parent, start)
    if kind in SCALAR_JOINTS:
        read = _about_axis(read, _needed(item, joint.axis, "axis"))
    elif joint.axis is not None:
        raise item.refused("has an axis")
    return _with_state(read, joint)


def _about_axis(read: Joint, axis: skel.SkelAxisItem) -> Joint:
    limits = None
    if axis.item.find("limit") is not None:
        limits = (_needed(axis.item, axis.lower, "lower"), _needed(axis.item, axis.upper, "upper"))
    for name in IMPLICIT:
        if _needed(axis.item, getattr(axis, name), name):
            raise axis.item.refused(f"has DART's own, implicit, {name}")
    return replace(
        read,
        axis=_needed(axis.item, axis.xyz, "xyz"),
        position_limits=limits,
        dry_friction=_needed(axis.item, axis.friction, "friction"),
    )


def _with_state(read: Joint, joint: skel.SkelJointItem) -> Joint:
    """The same with its initial state: in the world's coordinates."""
    count = COORDINATES[read.kind]
    if not count:
        return read
    position = _needed(joint.item, joint.item.numbers_of("init_pos", count), "init_pos")
    velocity = _needed(joint.item, joint.item.numbers_of("init_vel", count), "init_vel")
    if read.kind == "ball":
        return replace(read, position=frames.normalise(exponential_of(position)), velocity=velocity)
    if read.kind == "free":
        x, y, z = position[3:]
        placed = frames.compose(read.origin, Pose((x, y, z), frames.normalise(exponential_of(position[:3]))))
        return replace(
            read,
            origin=Pose(),
            position=(*placed.position, *placed.quaternion),
            velocity=(*velocity[3:], *velocity[:3]),
        )
    return replace(read, position=position, velocity=velocity)


def _fixed(joints: Mapping[str, Joint]) -> set[str]:
    """The nodes that cannot move. Raises ValueError where joints go round in a circle."""
    fixed: dict[str | None, bool] = {None: True}
    for start in joints:
        chain: list[str] = []
        name: str | None = start
        while name is not None and name not in fixed:
            if name in chain:
                raise ValueError(f"the joints of {sorted(chain)} go round in a circle")
            chain.append(name)
            name = joints[name].parent
        for below in reversed(chain):
            fixed[below] = joints[below].kind == "fixed" and fixed[joints[below].parent]
    return {name for name, stands in fixed.items() if stands and name is not None}


def _complete_joints(bodies: dict[str, Body], sidecar: DartSidecar) -> None:
    """The joints in the sidecar. Raises ValueError where limits of the file are not enforced, or the reverse."""

    def change(name: str, **values: Any) -> None:
        bodies[name] = replace(bodies[name], joint=replace(bodies[name].joint, **values))

    for entry in sidecar.velocity_limits:
        change(entry.body, velocity_limit=entry.value)
    for entry in sidecar.effort_limits:
        change(entry.body, effort_limit=entry.value)
    for entry in sidecar.damping:
        change(entry.body, damping=entry.value)
    for entry in sidecar.armature:
        change(entry.body, armature=entry.value)
    add_springs(bodies, sidecar.springs)
    limited = {name for name, body in bodies.items() if body.joint.position_limits is not None}
    if limited != set(sidecar.enforce_limits):
        raise ValueError(f"limits of {sorted(limited ^ set(sidecar.enforce_limits))} are not both given and enforced")


# --- shapes -------------------------------------------------------------------------------------------------------


def _check_meshes(document: skel.SkelDocument) -> None:
    """Raise ValueError where no shape names a mesh that is there."""
    bodies = (body for skeleton in document.skeletons for body in skeleton.bodies)
    named = {shape.file for body in bodies for shape in (*body.visual, *body.collision)}
    if unused := document.meshes.keys() - named:
        raise ValueError(f"no shape is the mesh of {', '.join(sorted(unused))}")


def _shapes(
    nodes: Mapping[str, skel.SkelBodyItem],
    name_of_first: str,
    entries: Sequence[DartShapeEntry],
    meshes: Mapping[str, tuple[float, ...]],
) -> tuple[Shape, ...]:
    """The shapes of a body in the order of the sidecar, which says which of them are visual and on which nodes they are
    solid. ``nodes`` are the body's, ``name_of_first`` the name of the one that has the visual shapes."""
    solid = {name: list(node.collision) for name, node in nodes.items()}
    visual = list(nodes[name_of_first].visual)
    shapes = []
    for entry in entries:
        name = entry.name
        read: list[Shape] = []
        for copy in entry.surfaces:
            if not solid.get(copy.node):
                raise ValueError(f"node {copy.node!r} has too few collision shapes for {name!r}")
            read.append(_shape(name, solid[copy.node].pop(0), meshes))
        if entry.visual:
            if not visual:
                raise ValueError(f"body {name_of_first!r} has too few visual shapes for {name!r}")
            element = visual.pop(0)
            red, green, blue, opacity = _needed(element.item, element.item.numbers_of("color", 4), "color")
            read.append(replace(_shape(name, element, meshes), colour=(red, green, blue, opacity)))
        if not read:
            raise ValueError(f"shape {name!r} is neither visual nor collision")
        if any((part.kind, part.size, part.pose) != (read[0].kind, read[0].size, read[0].pose) for part in read):
            raise ValueError(f"visual and collision of shape {name!r}, or two of its copies, differ")
        surfaces = tuple(Surface(copy.friction, restitution=copy.restitution) for copy in entry.surfaces)
        shapes.append(replace(read[-1], visual=entry.visual, collision=bool(surfaces), surfaces=surfaces))
    left = [name for name, elements in (*solid.items(), (name_of_first, visual)) if elements]
    if left:
        raise ValueError(f"nodes {left} have shapes that the sidecar does not name")
    return tuple(shapes)


def _shape(name: str, shape: skel.SkelShapeItem, meshes: Mapping[str, tuple[float, ...]]) -> Shape:
    pose = _needed(shape.item, shape.pose, "transformation")
    if shape.kind == "mesh":
        if shape.file is None or shape.file not in meshes or shape.values != {"scale": (1.0, 1.0, 1.0)}:
            raise shape.item.refused(
                f"the mesh {str(shape.file)[:60]!r} is missing, or is scaled, which is not read here"
            )
        return Shape(name, "mesh", meshes[shape.file], pose)
    if shape.kind == "plane":
        if shape.values != PLANE:
            raise shape.item.refused("is a plane that is not the x-y plane of its own frame")
        return Shape(name, "plane", (), pose)
    if shape.kind not in SIZES:
        raise shape.item.refused(f"the geometry <{shape.kind}> is not known here")
    tags, count, factor = SIZES[shape.kind]
    size = tuple(value * factor for tag in tags for value in shape.values.get(tag, ()))
    if len(size) != count:
        raise shape.item.refused(f"a <{shape.kind}> has {len(size)} numbers, should have {count}")
    return Shape(name, shape.kind, size, pose)


def _check_welded(node: skel.SkelBodyItem, body: skel.SkelBodyItem, joint: Joint) -> None:
    """A further node of a body is its own but for the name: in the same place, without mass, held by a weld."""
    if joint.kind != "fixed" or joint.parent != body.name:
        raise node.item.refused(f"is not welded to {body.name!r}")
    if node.pose != body.pose:
        raise node.item.refused(f"is not where {body.name!r} is")
    inertial = _needed(node.item, node.inertial, "inertia")
    if inertial != Inertial(0.0) or node.visual:
        raise node.item.refused(f"has a mass or can be seen, which its body {body.name!r} should")
