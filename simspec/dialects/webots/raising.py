"""From a .wbt document and its sidecar back to the model they mean to Webots, in the world's frames (proof level L0).

Nothing here is shared with ``dialect.py``: joints' places and rates follow from the bodies', rotations from axes and angles.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from simspec.dialects.kit.sidecar import UNREADABLE, add_springs, fluid_of, with_passive
from simspec.dialects.webots.nodes import WebotsShapeEntry, WebotsSidecar, check_neutral
from simspec.formats.kit.contract import restore_frames
from simspec.formats.wbt.reading import WbtDocument, WbtNode
from simspec.world import frames
from simspec.world.types import Body, Inertial, Joint, PairContact, Pose, Quaternion, ReadBack, Shape, Surface, Vector3

# Where a node of a .wbt stands, and what is known of a body before its joint's rate is.


@dataclass(slots=True)
class FoundBody:
    """A body as its nodes have it: ``place`` in the node around it and ``pose`` in the world, at the initial state; ``moves``
    whether it can, ``top`` the name of the topmost body of its rigid group."""

    node: WbtNode
    name: str
    model: str
    joint: Joint
    inertial: Inertial
    place: Pose
    pose: Pose
    moves: bool
    top: str


def pose_of(node: WbtNode) -> Pose:
    """Where a node stands in the one around it."""
    *axis, angle = node.numbers("rotation", 4)
    if angle == 0.0 and axis != [0.0, 0.0, 1.0]:
        raise node.refused("a rotation by nothing should be 0 0 1 0")
    length = math.hypot(*axis)
    if abs(length - 1.0) > 1e-9:
        raise node.refused("the axis of its rotation should be of length 1")
    x, y, z = (part / length for part in axis)
    return Pose(vector(node, "translation"), about((x, y, z), angle))


def about(axis: Vector3, angle: float) -> Quaternion:
    """The rotation by an angle (rad) about a unit axis."""
    sine = math.sin(angle / 2.0)
    return frames.normalise((math.cos(angle / 2.0), axis[0] * sine, axis[1] * sine, axis[2] * sine))


def vector(node: WbtNode, name: str) -> Vector3:
    x, y, z = node.numbers(name, 3)
    return (x, y, z)


def unit(node: WbtNode, name: str) -> Vector3:
    x, y, z = vector(node, name)
    length = math.hypot(x, y, z)
    if abs(length - 1.0) > 1e-9:
        raise node.refused(f"{name} should be of length 1")
    return (x / length, y / length, z / length)


# From the nodes of a Solid back to the shapes of its body: those that are drawn, and those of its boundingObject.

KINDS: Final = {"Sphere": "sphere", "Box": "box", "Cylinder": "cylinder", "Capsule": "capsule", "Plane": "plane"}


def shapes_of(solid: WbtNode, entries: Sequence[WebotsShapeEntry]) -> tuple[Shape, ...]:
    """The shapes of a body in the order of the sidecar, which says which of them are seen and which are solid. Raises
    ValueError where the nodes are not those."""
    drawn = [_drawn(node) for node in solid.nodes("children") if node.kind == "Pose"]
    bounding, material = solid.node("boundingObject"), solid.text("contactMaterial")
    stops: list[Shape] = []
    if bounding is not None:
        if bounding.kind != "Group":
            raise bounding.refused("should be a Group")
        stops = [_shape(node, _inside(node)) for node in bounding.nodes("children")]
    elif material != "default":
        raise solid.refused("has a contactMaterial and no boundingObject")
    shapes = []
    for entry in entries:
        if (entry.visual and not drawn) or (entry.solid and not stops):
            raise solid.refused(f"has too few shapes for {entry.name!r} of the sidecar")
        seen = drawn.pop(0) if entry.visual else None
        felt = stops.pop(0) if entry.solid else None
        read = felt or seen
        if read is None:
            raise solid.refused(f"{entry.name!r} is neither seen nor solid")
        if seen and felt and (seen.kind, seen.size, seen.pose) != (felt.kind, felt.size, felt.pose):
            raise solid.refused(f"{entry.name!r} is drawn otherwise than it is solid")
        read = replace(read, name=entry.name, visual=entry.visual, collision=entry.solid)
        if seen is not None:
            read = replace(read, colour=seen.colour)
        if felt is not None:
            read = replace(read, material=material, surfaces=(Surface(),))
        shapes.append(read)
    if drawn or stops:
        raise solid.refused("has shapes that the sidecar does not name")
    return tuple(shapes)


def _drawn(node: WbtNode) -> Shape:
    shape = _inside(node)
    if shape.kind != "Shape":
        raise shape.refused("should be a Shape")
    look, geometry = shape.node("appearance"), shape.node("geometry")
    if look is None or look.kind != "PBRAppearance" or geometry is None:
        raise shape.refused("should have a PBRAppearance and a geometry")
    red, green, blue = look.numbers("baseColor", 3)
    return replace(_shape(node, geometry), colour=(red, green, blue, 1.0 - look.number("transparency")))


def _inside(node: WbtNode) -> WbtNode:
    """The one node in a Pose."""
    if node.kind != "Pose":
        raise node.refused("should be a Pose")
    inside = node.nodes("children")
    if len(inside) != 1:
        raise node.refused(f"has {len(inside)} nodes, should have one")
    return inside[0]


def _shape(pose: WbtNode, geometry: WbtNode) -> Shape:
    kind = KINDS.get(geometry.kind)
    if kind is None:
        raise geometry.refused("is no geometry that simspec writes")
    if kind == "box":
        size = geometry.numbers("size", 3)
    elif kind == "plane":
        size = ()
    else:
        size = (geometry.number("radius"),)
        size += () if kind == "sphere" else (geometry.number("height"),)
    if not all(length > 0.0 for length in size):
        raise geometry.refused("should have sizes above zero")
    return Shape("", kind, size, pose_of(pose))


# The rates of joints from the velocities of bodies, as a .wbt has them: of the centre of mass of each rigid group.

TOGETHER: Final = 1e-9
"""Of the speeds around it: how fast a joint's ends may part, by the round-off of a chain."""
ZERO: Final[Vector3] = (0.0, 0.0, 0.0)


def rates(found: Mapping[str, FoundBody], turned: Quaternion) -> dict[str, tuple[float, ...]]:
    """The velocity of every body's joint, in the world's coordinates of it; ``turned``: the world in the file. Raises
    ValueError where velocities separate a joint, or belong to a node that has none."""
    centres = _centres(found)
    back = frames.conjugate(turned)
    of_group: dict[str, tuple[Vector3, Vector3]] = {}
    for name, item in found.items():
        linear, angular = (vector(item.node, field) for field in ("linearVelocity", "angularVelocity"))
        if item.top == name and item.moves:
            of_group[name] = (frames.rotate(back, linear), frames.rotate(back, angular))
        elif any((*linear, *angular)):
            raise item.node.refused("has a velocity, which is of the topmost Solid of what moves as one")

    def at(name: str | None, point: Vector3) -> tuple[Vector3, Vector3]:
        """Of a body, or the world, at a point of the world."""
        if name is None or not found[name].moves:
            return ZERO, ZERO
        entry = found[name]
        linear, angular = of_group[entry.top]
        return frames.add(linear, frames.cross(angular, frames.subtract(point, centres[entry.top]))), angular

    return {name: _rate(entry, at) for name, entry in found.items()}


def _rate(found: FoundBody, at: Callable[[str | None, Vector3], tuple[Vector3, Vector3]]) -> tuple[float, ...]:
    joint, point = found.joint, found.pose.position
    if joint.kind == "fixed":
        return ()
    linear, angular = at(found.name, point)
    if joint.kind == "free":
        return (*linear, *angular)
    above_linear, above_angular = at(joint.parent, point)
    slip, turn = frames.subtract(linear, above_linear), frames.subtract(angular, above_angular)
    speed = 1.0 + max(math.hypot(*part) for part in (linear, angular, above_linear, above_angular))
    if joint.kind == "ball":
        _check(found, (slip,), speed)
        return frames.rotate(frames.conjugate(found.pose.quaternion), turn)
    x, y, z = frames.rotate(found.pose.quaternion, joint.axis)
    along, other = (turn, slip) if joint.kind == "hinge" else (slip, turn)
    rate = frames.dot((x, y, z), along)
    _check(found, (frames.subtract(along, (x * rate, y * rate, z * rate)), other), speed)
    return (rate,)


def _check(found: FoundBody, parts: tuple[Vector3, ...], speed: float) -> None:
    if any(math.hypot(*part) > TOGETHER * speed for part in parts):
        raise found.node.refused("moves otherwise than its joint lets it")


def _centres(found: Mapping[str, FoundBody]) -> dict[str, Vector3]:
    """The centre of mass of every rigid group that moves, in the world (m)."""
    masses: dict[str, float] = {}
    sums: dict[str, Vector3] = {}
    for entry in found.values():
        mass = entry.inertial.mass
        if entry.moves and mass:
            x, y, z = frames.add(
                entry.pose.position, frames.rotate(entry.pose.quaternion, entry.inertial.centre_of_mass)
            )
            masses[entry.top] = masses.get(entry.top, 0.0) + mass
            sums[entry.top] = frames.add(sums.get(entry.top, ZERO), (mass * x, mass * y, mass * z))
    return {top: (x / masses[top], y / masses[top], z / masses[top]) for top, (x, y, z) in sums.items()}


VERSION: Final = "R2023b"
JOINTS: Final = {"HingeJoint": "hinge", "SliderJoint": "slide", "BallJoint": "ball"}
PARAMETERS: Final = {"hinge": "HingeJointParameters", "slide": "JointParameters", "ball": "BallJointParameters"}
AROUND: Final = ("WorldInfo", "Viewpoint", "DirectionalLight", "Robot")
"""The nodes other than Solids, each once."""
SETTINGS: Final = ("softness", "joint_softness", "joint_error_reduction", "contact_points")
EXACT: Final = 1e-12
"""How far numbers that stand in a file twice may differ (m)."""


def raised(document: WbtDocument, sidecar: WebotsSidecar) -> ReadBack:
    """The model of a document. Raises ValueError, which names the place, for what is missing, for what simspec does not say to
    Webots, and where document and sidecar do not fit together."""
    if document.version != VERSION:
        raise ValueError(f"{document.file}:1: is of {document.version}, should be of {VERSION}")
    check_neutral(document.walk())
    info, *_ = [document.only(kind) for kind in AROUND]
    turned, solids = solids_of(document)
    found = _bodies(solids, sidecar)
    if list(found) != [body.name for body in sidecar.bodies]:
        raise ValueError(f"the bodies of {document.file} are not those of sidecar.bodies")
    velocities = rates(found, turned)
    entries: dict[str, list[WebotsShapeEntry]] = {}
    for entry in sidecar.shapes:
        entries.setdefault(entry.body, []).append(entry)
    bodies = {
        name: Body(
            name,
            entry.model,
            entry.inertial,
            replace(entry.joint, velocity=velocities[name]),
            shapes_of(entry.node, entries.get(name, [])),
        )
        for name, entry in found.items()
    }
    _complete_joints(bodies, sidecar)
    _check_settings(info, sidecar)
    passive = sidecar.passive
    return ReadBack(
        restore_frames(with_passive(tuple(bodies.values()), passive), sidecar.offsets),
        frames.rotate(frames.conjugate(turned), (0.0, 0.0, 0.0 - info.number("gravity"))),
        info.number("basicTimeStep") / 1e3,
        sidecar.friction_cone,
        {**UNREADABLE, "static.inertial": "static bodies have no Physics node in a .wbt"},
        sums=sidecar.sums or (),
        fluid=fluid_of(passive),
        laws=tuple(_law(node, sidecar) for node in info.nodes("contactProperties")),
    )


# --- bodies ---------------------------------------------------------------------------------------------------------


def solids_of(document: WbtDocument) -> tuple[Quaternion, tuple[WbtNode, ...]]:
    """How the world is turned in the file, and the topmost Solids."""
    others = [node for node in document.nodes if node.kind not in AROUND]
    poses = [node for node in others if node.kind == "Pose"]
    if not poses:
        turned, solids = frames.IDENTITY, tuple(others)
    else:
        if len(others) != 1 or poses[0].label != "turned" or any(poses[0].numbers("translation", 3)):
            raise poses[0].refused("should be DEF turned, at the origin, and hold all Solids")
        turned, solids = pose_of(poses[0]).quaternion, poses[0].nodes("children")
    for node in solids:
        if node.kind != "Solid":
            raise node.refused("stands where a Solid should be")
    return turned, solids


def _ground(node: WbtNode) -> WbtNode:
    """The joint in a Solid that is the ground."""
    fields = [node.node(name) for name in ("boundingObject", "physics")]
    numbers = [*node.numbers("translation", 3), *node.numbers("linearVelocity", 3), *node.numbers("angularVelocity", 3)]
    plain = (node.text("model"), node.text("contactMaterial")) == ("", "default")
    children = node.nodes("children")
    if any(fields) or any(numbers) or pose_of(node).quaternion != frames.IDENTITY or not plain or len(children) != 1:
        raise node.refused("should be one joint's ground, at the origin, and nothing else")
    (joint,) = children
    if joint.kind not in JOINTS or node.text("name") != f"ground {joint.label.removeprefix('joint_')}":
        raise node.refused("should be the ground of one joint, by its number")
    if node.label != f"ground_{joint.label.removeprefix('joint_')}":
        raise node.refused("should have the number of its joint")
    return joint


def _end(joint: WbtNode) -> WbtNode:
    end = joint.node("endPoint")
    if end is None or end.kind != "Solid":
        raise joint.refused("endPoint should be a Solid")
    return end


def _bodies(solids: Sequence[WbtNode], sidecar: WebotsSidecar) -> dict[str, FoundBody]:
    """The bodies in the sidecar's order. Raises ValueError where one is there twice or no body of the sidecar."""
    starts = {start.body: start.turn for start in sidecar.starts}
    found: dict[int, FoundBody] = {}
    waiting: list[tuple[WbtNode, WbtNode | None, FoundBody | None]] = []
    for node in solids:
        joint = _ground(node) if node.label.startswith("ground") else None
        waiting.append((node if joint is None else _end(joint), joint, None))
    while waiting:
        node, joint, above = waiting.pop()
        index = _index(node, "body", len(sidecar.bodies))
        if index in found:
            raise node.refused("is there twice")
        name = sidecar.bodies[index].name
        if (node.text("name"), node.text("model")) != (name, sidecar.models[index]):
            raise node.refused(f"is {node.text('name')[:60]!r}, should be {name!r} of {sidecar.models[index]!r}")
        if joint is not None and _index(joint, "joint", len(sidecar.bodies)) != index:
            raise joint.refused(f"moves {node.label}")
        body = _body(node, joint, above, name, sidecar.joints[index], starts)
        if body.joint.kind != sidecar.bodies[index].kind:
            raise node.refused(f"is joined by {body.joint.kind}, and the sidecar has {sidecar.bodies[index].kind}")
        found[index] = body
        for child in node.nodes("children"):
            if child.kind == "Solid":
                waiting.append((child, None, body))
            elif child.kind in JOINTS:
                waiting.append((_end(child), child, body))
            elif child.kind != "Pose":
                raise child.refused("stands in a Solid")
    return {found[index].name: found[index] for index in sorted(found)}


def _index(node: WbtNode, what: str, count: int) -> int:
    """The number in a label ``body_3``."""
    word, _, number = node.label.partition("_")
    if word != what or not number.isdecimal() or str(int(number[:9])) != number or int(number) >= count:
        raise node.refused(f"should be DEF {what}_ with the number of a body in the sidecar")
    return int(number)


def _body(
    node: WbtNode,
    joint: WbtNode | None,
    above: FoundBody | None,
    name: str,
    joint_name: str,
    starts: Mapping[str, Quaternion],
) -> FoundBody:
    place = pose_of(node)
    pose = place if above is None else frames.compose(above.pose, place)
    inertial = _inertial(node.node("physics"))
    parent = None if above is None else above.name
    if joint is not None:
        read = _joint(joint, JOINTS[joint.kind], joint_name, parent, place, starts.get(name))
        moves, top = True, name
    elif above is None and inertial is not None:
        position = (*place.position, *place.quaternion)
        read, moves, top = Joint(joint_name, "free", position=position), True, name
    else:
        read = Joint(joint_name, "fixed", parent, place)
        moves, top = above is not None and above.moves, name if above is None else above.top
    if moves and top == name and inertial is None:
        raise node.refused("moves, and has no Physics")
    if not moves and inertial is not None:
        raise node.refused("has Physics where nothing moves")
    return FoundBody(node, name, node.text("model"), read, inertial or Inertial(0.0), place, pose, moves, top)


def _inertial(node: WbtNode | None) -> Inertial | None:
    if node is None:
        return None
    if node.kind != "Physics":
        raise node.refused("should be a Physics")
    xx, yy, zz, xy, xz, yz = node.numbers("inertiaMatrix", 6)
    mass = node.number("mass")
    if not mass > 0.0:
        raise node.refused("a mass should be above zero")
    return Inertial(mass, vector(node, "centerOfMass"), (xx, yy, zz, xy, xz, yz))


def _joint(node: WbtNode, kind: str, name: str, parent: str | None, place: Pose, start: Quaternion | None) -> Joint:
    """The joint of a Solid that stands at ``place``, joined to the one around it."""
    given = node.node("jointParameters")
    if given is None or given.kind != PARAMETERS[kind]:
        raise node.refused(f"jointParameters should be {PARAMETERS[kind]}")
    if kind != "slide":
        anchor = vector(given, "anchor")
        if math.dist(anchor, place.position) > EXACT * max(1.0, math.hypot(*place.position)):
            raise given.refused("the anchor should be the place of the endPoint")
    if kind == "ball":
        if start is None:
            raise node.refused("has no entry in sidecar.starts")
        origin = Pose(place.position, frames.multiply(place.quaternion, frames.conjugate(start)))
        return Joint(name, kind, parent, origin, position=frames.normalise(start))
    outer = unit(given, "axis")
    axis = frames.rotate(frames.conjugate(place.quaternion), outer)
    position = given.number("position")
    if kind == "hinge":
        origin = Pose(place.position, frames.multiply(place.quaternion, about(axis, -position)))
    else:
        x, y, z = outer
        back = (x * position, y * position, z * position)
        origin = Pose(frames.subtract(place.position, back), place.quaternion)
    limits = (given.number("minStop"), given.number("maxStop"))
    return Joint(
        name,
        kind,
        parent,
        origin,
        axis,
        limits if any(limits) else None,
        dry_friction=given.number("staticFriction"),
        position=(position,),
    )


# --- laws, settings, the sidecar ------------------------------------------------------------------------------------


def _law(node: WbtNode, sidecar: WebotsSidecar) -> PairContact:
    if node.kind != "ContactProperties":
        raise node.refused("should be ContactProperties")
    softness, points = sidecar.settings.get("softness"), sidecar.settings.get("contact_points")
    given = (node.number("softCFM"), *node.numbers("forceDependentSlip", 1), node.number("maxContactJoints"))
    if given != (softness, softness, points):
        raise node.refused(
            f"softCFM, forceDependentSlip and maxContactJoints are {given}, the settings {softness}, {points}"
        )
    first, second = node.text("material1"), node.text("material2")
    if first > second:
        raise node.refused(f"{first[:60]!r} and {second[:60]!r} are not sorted")
    value, other, torsional = node.numbers("rollingFriction", 3)
    if value != other:
        raise node.refused("rollingFriction should be the same across the normal")
    (friction,) = node.numbers("coulombFriction", 1)
    return PairContact(
        first,
        second,
        friction,
        node.number("bounce"),
        torsional_friction=torsional,
        rolling_friction=value,
        restitution_threshold=node.number("bounceVelocity"),
    )


def _check_settings(info: WbtNode, sidecar: WebotsSidecar) -> None:
    """Raise ValueError where the file's numbers are not the settings of the sidecar, which has those and no others."""
    if set(sidecar.settings) != set(SETTINGS):
        raise ValueError(f"sidecar.settings has {sorted(sidecar.settings)}, should have {sorted(SETTINGS)}")
    for field, setting in (("CFM", "joint_softness"), ("ERP", "joint_error_reduction")):
        if info.number(field) != sidecar.settings.get(setting):
            raise info.refused(f"{field} is {info.number(field):g}, {setting} {sidecar.settings.get(setting)}")


def _complete_joints(bodies: dict[str, Body], sidecar: WebotsSidecar) -> None:
    """The values of joints in the sidecar. Raises ValueError where position limits stand in both."""

    def change(name: str, **values: object) -> None:
        bodies[name] = replace(bodies[name], joint=replace(bodies[name].joint, **values))  # type: ignore[arg-type]

    for entry in sidecar.velocity_limits:
        change(entry.body, velocity_limit=entry.value)
    for entry in sidecar.effort_limits:
        change(entry.body, effort_limit=entry.value)
    for entry in sidecar.damping:
        change(entry.body, damping=entry.value)
    add_springs(bodies, sidecar.springs)
    for limits in sidecar.untold_limits:
        if bodies[limits.body].joint.position_limits is not None:
            raise ValueError(f"{limits.body!r} has stops, and limits in sidecar.untold_limits")
        change(limits.body, position_limits=(limits.lower, limits.upper))
