"""The nodes of shapes, joints and laws of contact."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from simspec.formats.wbt.tree import Node
from simspec.world import frames
from simspec.world.meeting import solid_shapes
from simspec.world.types import Body, Joint, PairContact, Pose, Quaternion, Shape, Vector3

COMMON_ERROR_REDUCTION: Final = 0.01
"""Of the common law of contact: the share of an overlap that each step takes back."""
DRAWN_PLANE: Final = (100.0, 100.0)
"""The size (m) at which a plane is drawn, which is infinite where it is solid."""


def turn(q: Quaternion) -> tuple[float, float, float, float]:
    """A rotation as the language has it: a unit axis and an angle (rad)."""
    w, x, y, z = q
    sine = math.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return (0.0, 0.0, 1.0, 0.0)
    return (x / sine, y / sine, z / sine, 2.0 * frames.angle(sine, w))


def downwards(gravity: Vector3) -> tuple[float, Quaternion]:
    """The strength of gravity (m/s²), and the smallest turn that brings its direction to -z."""
    strength = math.sqrt(frames.dot(gravity, gravity))
    x, y, z = gravity
    if strength == 0.0 or (x == y == 0.0 and z < 0.0):
        return strength, frames.IDENTITY
    if x == y == 0.0:
        return strength, (0.0, 1.0, 0.0, 0.0)
    return strength, frames.normalise((strength - z, -y, x, 0.0))


def turned_all(nodes: Sequence[Node], turned: Quaternion) -> Sequence[Node]:
    """Nodes in a Pose that turns them, where they are turned."""
    if turned == frames.IDENTITY:
        return nodes
    return (Node("Pose", {"rotation": turn(turned), "children": tuple(nodes)}, "turned"),)


def seen(body: Body) -> tuple[Node, ...]:
    """What is drawn of a body, each shape in its place."""
    return tuple(_placed(shape, _drawn(shape)) for shape in body.shapes if shape.visual)


def bounding(body: Body) -> Node | None:
    """The solid shapes of a body."""
    solid = tuple(_placed(shape, _geometry(shape)) for shape in solid_shapes(body))
    return Node("Group", {"children": solid}) if solid else None


def _placed(shape: Shape, node: Node) -> Node:
    place = {"translation": shape.pose.position, "rotation": turn(shape.pose.quaternion), "children": (node,)}
    return Node("Pose", place)


def _drawn(shape: Shape) -> Node:
    red, green, blue, opacity = shape.colour
    look = {"baseColor": (red, green, blue), "transparency": 1.0 - opacity, "roughness": 1.0, "metalness": 0.0}
    return Node("Shape", {"appearance": Node("PBRAppearance", look), "geometry": _geometry(shape)})


def _geometry(shape: Shape) -> Node:
    match shape.kind:
        case "sphere":
            return Node("Sphere", {"radius": shape.size[0], "subdivision": 3})
        case "box":
            return Node("Box", {"size": shape.size})
        case "plane":
            return Node("Plane", {"size": DRAWN_PLANE})
    kind = {"cylinder": "Cylinder", "capsule": "Capsule"}[shape.kind]
    return Node(kind, {"radius": shape.size[0], "height": shape.size[1]})


def joint_node(joint: Joint, solid: Node, place: Pose, label: str) -> Node:
    """A joint around the Solid that it moves; ``place`` is where that stands in the node around the joint."""
    axis = frames.rotate(place.quaternion, joint.axis)
    common: dict[str, object] = {"staticFriction": joint.dry_friction}
    if joint.kind == "ball":
        parameters = Node("BallJointParameters", {**common, "anchor": place.position})
        return Node("BallJoint", {"jointParameters": parameters, "endPoint": solid}, label)
    common |= {"axis": axis, "position": joint.position[0]}
    if joint.position_limits is not None and stops(joint):
        lower, upper = joint.position_limits
        common |= {"minStop": lower, "maxStop": upper}
    if joint.kind == "slide":
        return Node("SliderJoint", {"jointParameters": Node("JointParameters", common), "endPoint": solid}, label)
    parameters = Node("HingeJointParameters", {**common, "anchor": place.position})
    return Node("HingeJoint", {"jointParameters": parameters, "endPoint": solid}, label)


def stops(joint: Joint) -> bool:
    """Whether Webots has stops at a joint's position limits: around zero, and of hinges within ±π, but not both zero."""
    if joint.position_limits is None:
        return False
    lower, upper = joint.position_limits
    most = math.pi if joint.kind == "hinge" else math.inf
    return -most <= lower <= 0.0 <= upper <= most and lower < upper


def contact_properties(law: PairContact, settings: Mapping[str, bool | int | float | str]) -> Node:
    """The law of two materials. Torque about the normal and across it is bound by so many metres times the normal force."""
    rolling = law.rolling_friction
    softness = settings["softness"]
    fields = {
        "material1": law.first,
        "material2": law.second,
        "coulombFriction": (law.friction,),
        "rollingFriction": (rolling, rolling, law.torsional_friction),
        "bounce": law.restitution,
        "bounceVelocity": law.restitution_threshold,
        "forceDependentSlip": (softness,),
        "softERP": COMMON_ERROR_REDUCTION,
        "softCFM": softness,
        "maxContactJoints": settings["contact_points"],
    }
    return Node("ContactProperties", fields)
