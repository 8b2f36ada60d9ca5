"""The nodes of shapes, joints and laws of contact."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from simspec.dialects.kit.sidecar import JointSpring, JointValue, OfBody, Sidecar, check_of_bodies
from simspec.formats.kit.forms import check_distinct, check_known
from simspec.formats.wbt.format import WbtNodeTree
from simspec.formats.wbt.reading import WbtField, WbtNode
from simspec.world import frames
from simspec.world.contact_pairs import solid_shapes
from simspec.world.types import Body, Joint, PairContact, Pose, Quaternion, Shape, Vector3

# The sidecar of a .wbt: the data that simspec passes to Webots at run time, and the names that its nodes have no place for.


@dataclass(frozen=True, slots=True)
class WebotsShapeEntry:
    """A shape of a body, in the body's order; whether it is seen, and whether it is solid."""

    name: str
    body: str
    visual: bool
    solid: bool


@dataclass(frozen=True, slots=True)
class Range:
    """Position limits of a body's joint (rad, m)."""

    body: str
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class BallStart:
    """How a ball is turned at the beginning: its frame in its joint's."""

    body: str
    turn: Quaternion


@dataclass(frozen=True, slots=True, kw_only=True)
class WebotsSidecar(Sidecar):
    """The node of body i is ``DEF body_i``, that of its joint ``DEF joint_i``; i counts ``bodies`` from zero."""

    models: tuple[str, ...]
    """Of the bodies, in their order."""
    joints: tuple[str, ...]
    """Of the bodies, in their order."""
    shapes: tuple[WebotsShapeEntry, ...]
    velocity_limits: tuple[JointValue, ...]
    effort_limits: tuple[JointValue, ...]
    damping: tuple[JointValue, ...]
    springs: tuple[JointSpring, ...]
    untold_limits: tuple[Range, ...]
    """Position limits that are not written for Webots: its stops have no such angles."""
    starts: tuple[BallStart, ...]

    def check(self) -> None:
        """Raise ValueError, which names the place, where its lists do not fit together."""
        bodies = [body.name for body in self.bodies]
        for name in ("models", "joints"):
            if len(getattr(self, name)) != len(bodies):
                raise ValueError(f"sidecar.{name} has {len(getattr(self, name))} entries for {len(bodies)} bodies")
        check_distinct(self.joints, "sidecar.joints")
        lists: Mapping[str, Iterable[OfBody]] = {
            "velocity_limits": self.velocity_limits,
            "effort_limits": self.effort_limits,
            "damping": self.damping,
            "springs": self.springs,
            "untold_limits": self.untold_limits,
            "starts": self.starts,
        }
        check_of_bodies(lists, bodies)
        check_known((shape.body for shape in self.shapes), bodies, "sidecar.shapes")
        check_distinct((shape.name for shape in self.shapes), "sidecar.shapes")
        for index, shape in enumerate(self.shapes):
            if not (shape.visual or shape.solid):
                raise ValueError(f"sidecar.shapes.{index} is neither seen nor solid")
        balls = {body.name for body in self.bodies if body.kind == "ball"}
        if {start.body for start in self.starts} != balls:
            raise ValueError(f"sidecar.starts are not of the balls {sorted(balls)}")
        for index, start in enumerate(self.starts):
            if abs(sum(part * part for part in start.turn) - 1.0) > 1e-9:
                raise ValueError(f"sidecar.starts.{index}.turn should be of length 1")


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


def turned_all(nodes: Sequence[WbtNodeTree], turned: Quaternion) -> Sequence[WbtNodeTree]:
    """Nodes in a Pose that turns them, where they are turned."""
    if turned == frames.IDENTITY:
        return nodes
    return (WbtNodeTree("Pose", {"rotation": turn(turned), "children": tuple(nodes)}, "turned"),)


def seen(body: Body) -> tuple[WbtNodeTree, ...]:
    """The visual shapes of a body, each in its place."""
    return tuple(_placed(shape, _drawn(shape)) for shape in body.shapes if shape.visual)


def bounding(body: Body) -> WbtNodeTree | None:
    """The solid shapes of a body."""
    solid = tuple(_placed(shape, _geometry(shape)) for shape in solid_shapes(body))
    return WbtNodeTree("Group", {"children": solid}) if solid else None


def _placed(shape: Shape, node: WbtNodeTree) -> WbtNodeTree:
    place = {"translation": shape.pose.position, "rotation": turn(shape.pose.quaternion), "children": (node,)}
    return WbtNodeTree("Pose", place)


def _drawn(shape: Shape) -> WbtNodeTree:
    red, green, blue, opacity = shape.colour
    look = {"baseColor": (red, green, blue), "transparency": 1.0 - opacity, "roughness": 1.0, "metalness": 0.0}
    return WbtNodeTree("Shape", {"appearance": WbtNodeTree("PBRAppearance", look), "geometry": _geometry(shape)})


def _geometry(shape: Shape) -> WbtNodeTree:
    match shape.kind:
        case "sphere":
            return WbtNodeTree("Sphere", {"radius": shape.size[0], "subdivision": 3})
        case "box":
            return WbtNodeTree("Box", {"size": shape.size})
        case "plane":
            return WbtNodeTree("Plane", {"size": DRAWN_PLANE})
    kind = {"cylinder": "Cylinder", "capsule": "Capsule"}[shape.kind]
    return WbtNodeTree(kind, {"radius": shape.size[0], "height": shape.size[1]})


def joint_node(joint: Joint, solid: WbtNodeTree, place: Pose, label: str) -> WbtNodeTree:
    """A joint around the Solid that it moves; ``place`` is where that stands in the node around the joint."""
    axis = frames.rotate(place.quaternion, joint.axis)
    common: dict[str, object] = {"staticFriction": joint.dry_friction}
    if joint.kind == "ball":
        parameters = WbtNodeTree("BallJointParameters", {**common, "anchor": place.position})
        return WbtNodeTree("BallJoint", {"jointParameters": parameters, "endPoint": solid}, label)
    common |= {"axis": axis, "position": joint.position[0]}
    if joint.position_limits is not None and stops(joint):
        lower, upper = joint.position_limits
        common |= {"minStop": lower, "maxStop": upper}
    if joint.kind == "slide":
        return WbtNodeTree(
            "SliderJoint", {"jointParameters": WbtNodeTree("JointParameters", common), "endPoint": solid}, label
        )
    parameters = WbtNodeTree("HingeJointParameters", {**common, "anchor": place.position})
    return WbtNodeTree("HingeJoint", {"jointParameters": parameters, "endPoint": solid}, label)


def stops(joint: Joint) -> bool:
    """Whether Webots has stops at a joint's position limits: around zero, and of hinges within ±π, but not both zero."""
    if joint.position_limits is None:
        return False
    lower, upper = joint.position_limits
    most = math.pi if joint.kind == "hinge" else math.inf
    return -most <= lower <= 0.0 <= upper <= most and lower < upper


def contact_properties(law: PairContact, settings: Mapping[str, bool | int | float | str]) -> WbtNodeTree:
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
    return WbtNodeTree("ContactProperties", fields)


# Values of those fields of a .wbt that mean nothing to simspec's model: with them Webots adds nothing, and draws what is
# there. Another value is refused when a file is read, as a field that is not listed or is missing is.

Values = tuple[object, ...]
LIST: Final = "list"
"""After values that stand in brackets."""
NOTHING: Final[Values] = (LIST,)
NULL: Final[Values] = (None,)
ZERO: Final[Values] = (0.0,)
ORIGIN: Final[Values] = (0.0, 0.0, 0.0)

_STEPS: Final[Mapping[str, Values]] = {"translationStep": (0.01,), "rotationStep": (0.261799387,)}
_SOLID: Final[Mapping[str, Values]] = {
    **_STEPS,
    "description": ("",),
    "immersionProperties": NOTHING,
    "locked": (False,),
    "radarCrossSection": ZERO,
    "recognitionColors": NOTHING,
}
_PASSIVE: Final[Mapping[str, Values]] = {"springConstant": ZERO, "dampingConstant": ZERO}
_WHOLE: Final[Mapping[str, Values]] = {"bottom": (True,), "side": (True,), "top": (True,)}

NEUTRAL: Final[Mapping[str, Mapping[str, Values]]] = {
    "WorldInfo": {
        "info": NOTHING,
        "window": ("<none>",),
        "physics": ("",),
        "FPS": (60.0,),
        "optimalThreadCount": (1.0,),
        "physicsDisableTime": (1e9,),
        "physicsDisableLinearThreshold": (0.01,),
        "physicsDisableAngularThreshold": (0.01,),
        "defaultDamping": NULL,
        "inkEvaporation": ZERO,
        "coordinateSystem": ("ENU",),
        "gpsCoordinateSystem": ("local",),
        "gpsReference": ORIGIN,
        "lineScale": (0.1,),
        "dragForceScale": (30.0,),
        "dragTorqueScale": (5.0,),
        "randomSeed": ZERO,
    },
    "ContactProperties": {
        "frictionRotation": (0.0, 0.0),
        "softERP": (0.01,),
        "bumpSound": ("",),
        "rollSound": ("",),
        "slideSound": ("",),
    },
    "Viewpoint": {
        "fieldOfView": (0.785398,),
        "orientation": (0.0, 0.0, 1.0, 0.0),
        "position": (-10.0, 0.0, 0.0),
        "description": ("",),
        "near": (0.05,),
        "far": ZERO,
        "exposure": (1.0,),
        "follow": ("",),
        "followType": ("Tracking Shot",),
        "followSmoothness": (0.5,),
        "lensFlare": NULL,
        "ambientOcclusionRadius": (2.0,),
        "bloomThreshold": (21.0,),
    },
    "DirectionalLight": {
        "ambientIntensity": ZERO,
        "castShadows": (False,),
        "color": (1.0, 1.0, 1.0),
        "direction": (0.0, 0.0, -1.0),
        "intensity": (1.0,),
        "on": (True,),
    },
    "Solid": _SOLID,
    "Robot": {
        **_SOLID,
        "translation": ORIGIN,
        "rotation": (0.0, 0.0, 1.0, 0.0),
        "children": NOTHING,
        "name": ("simspec supervisor",),
        "model": ("",),
        "contactMaterial": ("default",),
        "boundingObject": NULL,
        "physics": NULL,
        "linearVelocity": ORIGIN,
        "angularVelocity": ORIGIN,
        "controller": ("<extern>",),
        "controllerArgs": NOTHING,
        "customData": ("",),
        "supervisor": (True,),
        "synchronization": (True,),
        "battery": NOTHING,
        "cpuConsumption": (10.0,),
        "selfCollision": (False,),
        "window": ("<none>",),
        "remoteControl": ("<none>",),
    },
    "Physics": {"density": (-1.0,), "damping": NULL},
    "HingeJoint": {"device": NOTHING},
    "SliderJoint": {"device": NOTHING},
    "BallJoint": {
        "jointParameters2": NULL,
        "jointParameters3": NULL,
        "device": NOTHING,
        "device2": NOTHING,
        "device3": NOTHING,
    },
    "HingeJointParameters": {
        **_PASSIVE,
        "suspensionSpringConstant": ZERO,
        "suspensionDampingConstant": ZERO,
        "suspensionAxis": (1.0, 0.0, 0.0),
        "stopERP": (-1.0,),
        "stopCFM": (-1.0,),
    },
    "JointParameters": _PASSIVE,
    "BallJointParameters": {**_PASSIVE, "position": ZERO, "minStop": ZERO, "maxStop": ZERO, "staticFriction": ZERO},
    "Group": {},
    "Pose": _STEPS,
    "Shape": {"castShadows": (True,), "isPickable": (True,)},
    "PBRAppearance": {
        **dict.fromkeys(("baseColorMap", "roughnessMap", "metalnessMap", "normalMap", "occlusionMap"), NULL),
        **dict.fromkeys(("emissiveColorMap", "textureTransform"), NULL),
        **dict.fromkeys(("roughness", "IBLStrength", "normalMapFactor", "occlusionMapStrength"), (1.0,)),
        "metalness": ZERO,
        "emissiveColor": ORIGIN,
        "emissiveIntensity": (1.0,),
        "name": ("PBRAppearance",),
    },
    "Sphere": {"subdivision": (3.0,), "ico": (True,)},
    "Box": {},
    "Cylinder": {**_WHOLE, "subdivision": (36.0,)},
    "Capsule": {**_WHOLE, "subdivision": (12.0,)},
    "Plane": {"size": (100.0, 100.0)},
}
"""By type of node; fields that are not here are those of the model."""

MODEL: Final[Mapping[str, tuple[str, ...]]] = {
    "WorldInfo": ("title", "gravity", "CFM", "ERP", "basicTimeStep", "contactProperties"),
    "ContactProperties": (
        *("material1", "material2", "coulombFriction", "rollingFriction", "bounce", "bounceVelocity"),
        *("forceDependentSlip", "softCFM", "maxContactJoints"),
    ),
    "Solid": (
        *("translation", "rotation", "children", "name", "model", "contactMaterial", "boundingObject", "physics"),
        *("linearVelocity", "angularVelocity"),
    ),
    "Physics": ("mass", "centerOfMass", "inertiaMatrix"),
    **dict.fromkeys(("HingeJoint", "SliderJoint", "BallJoint"), ("jointParameters", "endPoint")),
    "HingeJointParameters": ("position", "axis", "anchor", "minStop", "maxStop", "staticFriction"),
    "JointParameters": ("position", "axis", "minStop", "maxStop", "staticFriction"),
    "BallJointParameters": ("anchor",),
    "Group": ("children",),
    "Pose": ("translation", "rotation", "children"),
    "Shape": ("appearance", "geometry"),
    "PBRAppearance": ("baseColor", "transparency"),
    "Sphere": ("radius",),
    "Box": ("size",),
    **dict.fromkeys(("Cylinder", "Capsule"), ("radius", "height")),
}
"""The fields that say the model."""


def check_neutral(nodes: Iterable[WbtNode]) -> None:
    """Raise ValueError, with file and line, for the first node of an unknown type, the first field that is unknown or missing,
    and the first of ``NEUTRAL`` that says something else."""
    for node in nodes:
        neutral, model = NEUTRAL.get(node.kind), MODEL.get(node.kind, ())
        if neutral is None:
            raise node.refused("is no node that simspec writes")
        there = {field.name for field in node.fields}
        if missing := sorted({*neutral, *model} - there):
            raise node.refused(f"has no {', '.join(missing)}: Webots would choose")
        for field in node.fields:
            if field.name in neutral:
                if not _is(field, neutral[field.name]):
                    text = _text_of(neutral[field.name])
                    raise node.refused(f"{field.name} should be {text}", field.line)
            elif field.name not in model:
                raise node.refused(f"the field {field.name[:60]} is not one that simspec writes", field.line)


def _is(field: WbtField, wanted: Values) -> bool:
    listed = bool(wanted) and wanted[-1] == LIST
    values = wanted[:-1] if listed else wanted
    same = len(values) == len(field.values) and all(
        type(entry) is type(other) and entry == other for entry, other in zip(field.values, values, strict=True)
    )
    return same and field.listed is listed


def _text_of(values: Values) -> str:
    words = {None: "NULL", True: "TRUE", False: "FALSE", LIST: ""}
    text = " ".join(f"{value:g}" if type(value) is float else words.get(value, repr(value)) for value in values)  # type: ignore[call-overload]
    return text.strip() or "empty"
