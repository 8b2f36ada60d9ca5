"""A world as Drake holds it: a MultibodyPlant and its SceneGraph, built by calls from the document of ``world.json``.

Facts marked *measured*: Drake 1.51.1. Names of a spec have no point, so that names with one are free for what is added:
frames of joints (``joint.NAME``, ``turn.NAME``), geometries (``SHAPE.LAYER.PART``), bodies (``MODEL.BODY``).

All bodies are in Drake's default model instance. Every instance has ports of its own, and ``DiagramBuilder.Build`` takes time
that grows with the square of their number: with an instance for each model, 300 free bodies took 12 s to load, 2,000 more than
600 s (measured).
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simspec.engines.drake.approximations import ANY_RESOLUTION, FACED, corners, hydroelastic, too_large
from simspec.errors import EngineError, not_importable
from simspec.formats.world import AxisJoint, BallJoint, FixedJoint, FreeJoint, Joint, JsonBody, JsonShape, JsonWorld
from simspec.world.types import VELOCITY_SIZE, Pose

NAME = "drake"
ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""
SERVO = "servo"
"""How the names of actuators that hold the gains of a PD controller begin."""
CONE = "elliptic"
"""The only one that Drake has."""
LACKING = ("torsional_friction", "rolling_friction", "restitution", "hardness")
"""Numbers of shapes that Drake does not have."""
MOST_PLANES = 8
"""Half spaces on the world's own body that Drake's tree of boxes around geometries takes; 20 of them, or one beside bodies that
move, crash the process, since the boxes have no end (measured)."""
HALF_SPACES = "half spaces are not currently supported for deformable contact"
"""Drake warns of every plane beside deformable bodies, which simspec does not have: that is no news."""


def import_drake() -> Drake:
    """Drake's modules. Raises EngineError where it is not installed."""
    try:
        return Drake()
    except ImportError as error:
        raise not_importable(NAME, "pydrake", error) from error


class Drake:
    """The modules of Drake that are used."""

    def __init__(self) -> None:
        from pydrake import geometry, math
        from pydrake.common import eigen_geometry
        from pydrake.multibody import plant, tree
        from pydrake.systems import framework

        self.geometry, self.math, self.plant, self.tree, self.framework = geometry, math, plant, tree, framework
        self.quaternion = eigen_geometry.Quaternion

    def transform(self, position: Any, quaternion: Any) -> Any:
        """A pose as Drake's."""
        return self.math.RigidTransform(self.quaternion(quaternion), position)

    def place(self, pose: Pose) -> Any:
        """The same of a :class:`Pose`."""
        return self.transform(pose.position, pose.quaternion)


@contextmanager
def warnings_into(lines: list[str]) -> Iterator[None]:
    """Collect meanwhile what Drake warns of."""
    logger = logging.getLogger("drake")

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            text = record.getMessage()
            if HALF_SPACES not in text:
                lines.append(text)

    handler, spread = Collector(), logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = spread


def body_name(body: JsonBody) -> str:
    """What a body is called in Drake."""
    return f"{body.model}.{body.name}"


def told_name(held: Any) -> tuple[str, str]:
    """The (model, name) that a body of Drake's has by its name."""
    model, _, name = held.name().partition(".")
    return model, name


def is_servo(actuator: Any) -> bool:
    """Whether one of Drake's actuators holds the gains of a PD controller; else the joint's effort limit."""
    return bool(actuator.name().startswith(f"{SERVO}."))


@dataclass(frozen=True, slots=True)
class Geometry:
    """One geometry of a collision shape: ``id`` Drake's, ``shape`` the shape's place among all collision shapes, ``part`` what
    it stands for: the shape itself ("shape") or one of its corners."""

    id: Any
    body: int
    shape: int
    material: str
    layer: int
    part: str
    kind: str
    """Of the shape."""


@dataclass
class Built:
    """What was built: ``bodies`` in the world's order, ``joints`` theirs (None: free), ``turns`` of ball joints the frame whose
    pose is the joint's rotation."""

    drake: Drake
    diagram: Any = None
    plant: Any = None
    scene: Any = None
    bodies: list[Any] = field(default_factory=list)
    joints: list[Any] = field(default_factory=list)
    turns: dict[int, Any] = field(default_factory=dict)
    places: dict[str | None, Any] = field(default_factory=dict)
    """Where bodies that cannot move are in the world."""
    geometries: list[Geometry] = field(default_factory=list)
    shapes: list[tuple[int, str]] = field(default_factory=list)
    """(body, name) of every collision shape."""


def build(document: JsonWorld, settings: Mapping[str, Any]) -> Built:
    """Build the world. Raises EngineError for what Drake does not have, or refuses."""
    _check(document, settings)
    drake = import_drake()
    builder = drake.framework.DiagramBuilder()
    plant, scene = drake.plant.AddMultibodyPlantSceneGraph(builder, drake.plant.MultibodyPlant(document.timestep))
    built = Built(drake, plant=plant, scene=scene)
    try:
        plant.SetUseSampledOutputPorts(False)
        plant.set_adjacent_bodies_collision_filters(False)
        plant.mutable_gravity_field().set_gravity_vector(document.gravity)
        models = drake.plant.ContactModel
        plant.set_contact_model(models.kHydroelasticWithFallback if hydroelastic(settings) else models.kPoint)
        kinds = drake.plant.DiscreteContactApproximation
        plant.set_discrete_contact_approximation(
            {"sap": kinds.kSap, "tamsi": kinds.kTamsi}[settings["contact_approximation"]]
        )
        plant.set_sap_near_rigid_threshold(0.0)
        frames: dict[str | None, Any] = {None: plant.world_body()}
        built.places[None] = drake.math.RigidTransform()
        for index, body in enumerate(document.bodies):
            held = plant.AddRigidBody(body_name(body), _inertia(drake, body))
            frames[body.name] = held
            built.bodies.append(held)
            built.joints.append(_joint(built, index, body.joint, frames, held))
            if isinstance(body.joint, FixedJoint) and body.joint.parent in built.places:
                built.places[body.name] = built.places[body.joint.parent].multiply(drake.place(body.joint.origin))
            for shape in body.shapes:
                _shape(built, index, shape, document.timestep, settings)
        _filter(built, document, settings)
        plant.Finalize()
        plant.set_stiction_tolerance(settings["stiction_tolerance"])
        built.diagram = builder.Build()
    except (RuntimeError, ValueError) as error:
        raise EngineError(NAME, f"refuses the world: {error}") from error
    except ImportError as error:
        raise EngineError(NAME, f"meshes need scipy beside Drake: {error}") from error
    return built


def _check(document: JsonWorld, settings: Mapping[str, Any]) -> None:
    """Raise EngineError for what Drake does not have."""
    driven = any(isinstance(body.joint, AxisJoint) and body.joint.servo is not None for body in document.bodies)
    if driven and settings["contact_approximation"] != "sap":
        raise EngineError(NAME, "supports its PD controllers by SAP alone")
    if document.friction_cone != CONE:
        raise EngineError(NAME, f"does not support the friction cone {document.friction_cone}")
    planes = sum(len(shape.copies) for body in document.bodies for shape in body.shapes if shape.kind == "plane")
    if planes > MOST_PLANES:
        raise EngineError(NAME, f"does not support more than {MOST_PLANES} planes, copies included; here are {planes}")
    geometries = (
        len(shape.copies) * (1 + len(corners(shape.kind, shape.size)))
        for body in document.bodies
        for shape in body.shapes
    )
    large = too_large(sum(geometries), sum(VELOCITY_SIZE[body.joint.kind] for body in document.bodies))
    if large is not None:
        raise EngineError(NAME, large)
    for body in document.bodies:
        if isinstance(body.joint, AxisJoint) and body.joint.dry_friction:
            raise EngineError(NAME, f"does not support dry friction, which joint {body.joint.name!r} has")
        for shape in body.shapes:
            for copy in shape.copies:
                lacking = [name for name in LACKING if getattr(copy, name)]
                if lacking:
                    raise EngineError(NAME, f"does not support {lacking[0]}, which shape {shape.name!r} has")


def _inertia(drake: Drake, body: JsonBody) -> Any:
    if body.mass == 0.0:
        if any(body.centre_of_mass) or any(body.inertia):
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no mass")
        return drake.tree.SpatialInertia.Zero()
    return drake.tree.SpatialInertia.MakeFromCentralInertia(
        body.mass, body.centre_of_mass, drake.tree.RotationalInertia(*body.inertia)
    )


def _joint(built: Built, index: int, joint: Joint, bodies: Mapping[str | None, Any], held: Any) -> Any:
    """Add the joint of a body. A free body has none: Drake gives it one."""
    if isinstance(joint, FreeJoint):
        return None
    drake, plant, tree = built.drake, built.plant, built.drake.tree
    name, own = joint.name, held.body_frame()
    place = drake.place(joint.origin)
    frame = plant.AddFrame(tree.FixedOffsetFrame(f"joint.{name}", bodies[joint.parent].body_frame(), place))
    nothing = drake.math.RigidTransform()
    if isinstance(joint, FixedJoint):
        return plant.AddJoint(tree.WeldJoint(name, frame, own, nothing))
    if isinstance(joint, BallJoint):
        built.turns[index] = turn = plant.AddFrame(tree.FixedOffsetFrame(f"turn.{name}", frame, nothing))
        return plant.AddJoint(tree.BallRpyJoint(name, turn, own))
    kind = {"hinge": tree.RevoluteJoint, "slide": tree.PrismaticJoint}[joint.kind]
    found = plant.AddJoint(kind(name, frame, own, joint.axis))
    if joint.position_limits is not None:
        found.set_position_limits(*([value] for value in joint.position_limits))
    if joint.velocity_limit is not None:
        found.set_velocity_limits([-joint.velocity_limit], [joint.velocity_limit])
    # a controller has an actuator of its own, since its effort limit is not the joint's. Of several actuators Drake takes the
    # rotor inertia of the last for the joint's, whatever the others have (measured)
    driven = joint.servo is not None
    if joint.effort_limit is not None or (joint.armature and not driven):
        actuator = plant.AddJointActuator(f"actuator.{name}", found)
        actuator.set_default_rotor_inertia(0.0 if driven else joint.armature)
        if joint.effort_limit is not None:
            actuator.set_effort_limit(joint.effort_limit)
    if joint.servo is not None:
        limit = math.inf if joint.servo.effort_limit is None else joint.servo.effort_limit
        servo = plant.AddJointActuator(f"{SERVO}.{name}", found, limit)
        servo.set_default_rotor_inertia(joint.armature)
        servo.set_controller_gains(tree.PdControllerGains(p=joint.servo.kp, d=joint.servo.kd))
    return found


# --- contact --------------------------------------------------------------------------------------------------


def solid(drake: Drake, kind: str, size: Sequence[float]) -> Any:
    """A shape as Drake's. Of a mesh the convex hull, which Drake makes of the vertices, each of which it keeps to the last bit
    (measured)."""
    geometry = drake.geometry
    if kind == "mesh":
        return geometry.Convex(np.array(size, dtype=float).reshape(-1, 3).T, "hull")
    made = {
        "sphere": geometry.Sphere,
        "box": geometry.Box,
        "cylinder": geometry.Cylinder,
        "capsule": geometry.Capsule,
        "ellipsoid": geometry.Ellipsoid,
        "plane": geometry.HalfSpace,
    }
    return made[kind](*size)


def relaxation(timestep: float) -> float:
    """The relaxation time τ (s) of two rigid shapes: SAP makes φ + (dt + τ) v = 0, and the common law is v = −β φ/dt."""
    return timestep * (1.0 / ERROR_REDUCTION - 1.0)


def _shape(built: Built, index: int, shape: JsonShape, timestep: float, settings: Mapping[str, Any]) -> None:
    """Add the geometries of a shape: one to be seen, and where it is solid, in each of its layers itself, and its corners."""
    drake, number = built.drake, len(built.shapes)
    place = drake.place(shape.pose)
    body = built.bodies[index]
    still = told_name(body)[1] in built.places
    if shape.kind == "plane" and shape.copies:
        name = told_name(body)[1]
        if name not in built.places:
            raise EngineError(NAME, f"does not support planes on bodies that move, as {shape.name!r}")
        body, place = built.plant.world_body(), built.places[name].multiply(place)
    if shape.colour is not None:
        name, kind = f"{shape.name}.seen", solid(drake, shape.kind, shape.size)
        built.plant.RegisterVisualGeometry(body, place, kind, name, shape.colour)
    if not shape.copies:
        return
    built.shapes.append((index, shape.name))
    parts = [("shape", solid(drake, shape.kind, shape.size), place)]
    for order, (kind, size, centre) in enumerate(corners(shape.kind, shape.size)):
        at = drake.math.RigidTransform(drake.math.RotationMatrix(), centre)
        parts.append((f"corner{order}", solid(drake, kind, size), place.multiply(at)))
    for copy in shape.copies:
        for part, kind, pose in parts:
            name = f"{shape.name}.{copy.layer}.{part}"
            properties = drake.geometry.ProximityProperties()
            friction = drake.plant.CoulombFriction(copy.friction, copy.friction)
            drake.geometry.AddContactMaterial(settings["dissipation"], settings["stiffness"], friction, properties)
            # Drake adds the relaxation times of two shapes
            properties.AddProperty("material", "relaxation_time", 0.5 * relaxation(timestep))
            if part == "shape" and shape.kind in FACED and hydroelastic(settings):
                _by_pressure(drake, still, settings, properties)
            held = built.plant.RegisterCollisionGeometry(body, pose, kind, name, properties)
            built.geometries.append(Geometry(held, index, number, shape.material, copy.layer, part, shape.kind))


def _by_pressure(drake: Drake, still: bool, settings: Mapping[str, Any], properties: Any) -> None:
    """Hydroelastic contact of a shape: rigid where its body cannot move, so that its size does not matter; two of those never
    meet, of which Drake computes no contact."""
    if still:
        drake.geometry.AddRigidHydroelasticProperties(ANY_RESOLUTION, properties)
    else:
        drake.geometry.AddCompliantHydroelasticProperties(ANY_RESOLUTION, settings["hydroelastic_modulus"], properties)


def _filter(built: Built, document: JsonWorld, settings: Mapping[str, Any]) -> None:
    """Keep apart what does not touch: bodies that are named, groups, materials and layers that do not meet, corners, and
    corners of shapes whose faces touch by hydroelastic contact from such faces."""
    declared = built.drake.geometry.CollisionFilterDeclaration()
    bodies: dict[str, list[Any]] = {}
    groups: dict[str, list[Any]] = {}
    classes: dict[tuple[str, int], list[Any]] = {}
    between: list[tuple[list[Any], list[Any]]] = []
    names = [body.name for body in document.bodies]
    group_of = [body.group for body in document.bodies]
    small = []
    for geometry in built.geometries:
        bodies.setdefault(names[geometry.body], []).append(geometry.id)
        groups.setdefault(group_of[geometry.body], []).append(geometry.id)
        classes.setdefault((geometry.material, geometry.layer), []).append(geometry.id)
        if geometry.part != "shape":
            small.append(geometry.id)
    between += [(bodies[one], bodies[other]) for one, other in document.apart.bodies]
    between += [(groups[one], groups[other]) for one, other in document.apart.groups]
    meets = {(frozenset((one, other)), layer) for one, other, layer in document.meets}
    for (one, layer), (other, other_layer) in itertools.combinations_with_replacement(classes, 2):
        if layer != other_layer or (frozenset((one, other)), layer) not in meets:
            between.append((classes[one, layer], classes[other, other_layer]))
    if small:
        between.append((small, small))
    faced = [one for one in built.geometries if hydroelastic(settings) and one.kind in FACED]
    faces, at_faces = ([one.id for one in faced if (one.part == "shape") is whole] for whole in (True, False))
    if at_faces:
        between.append((faces, at_faces))
    sets = built.drake.geometry.GeometrySet
    for ids, other_ids in between:
        if ids is other_ids:
            declared.ExcludeWithin(sets(ids))
        else:
            declared.ExcludeBetween(sets(ids), sets(other_ids))
    built.scene.collision_filter_manager().Apply(declared)
