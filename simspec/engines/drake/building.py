"""A MultibodyPlant and its SceneGraph, built by calls from the document of ``world.json``.

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
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from simspec.engines.drake.approximations import ANY_RESOLUTION, FACED, corners, hydroelastic, too_large
from simspec.engines.drake.integrators import native, scheme
from simspec.engines.kit.building import STATIC, PlacedBody, ShapeUnit, Walk, refuse
from simspec.errors import EngineError, not_importable
from simspec.formats.world import AxisJoint, BallJoint, FixedJoint, FreeJoint, JsonBody, JsonShape
from simspec.world.types import VELOCITY_SIZE, Pose

NAME = "drake"
ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""
SERVO = "servo"
"""The prefix of the names of actuators that hold the gains of a PD controller."""
SHAPE = "shape"
"""The part of a shape's geometries that is the shape itself."""
CONE = "elliptic"
"""Drake's only friction cone."""
LACKING = ("torsional_friction", "rolling_friction", "restitution", "hardness")
"""Numbers of shapes that Drake does not have."""
MOST_PLANES = 8
"""Half spaces on the world's body that Drake's tree of boxes around geometries takes. 20 of them, or one on a body that moves,
crash the process, since the boxes have no end (measured)."""
HALF_SPACES = "half spaces are not currently supported for deformable contact"
"""Part of a warning that Drake prints for every plane, about deformable bodies, which simspec does not have."""


def import_drake() -> DrakeModules:
    """Drake's modules. Raises EngineError where it is not installed."""
    try:
        return DrakeModules()
    except ImportError as error:
        raise not_importable(NAME, "pydrake", error) from error


class DrakeModules:
    """The modules of Drake that are used."""

    def __init__(self) -> None:
        from pydrake import geometry, math
        from pydrake.common import eigen_geometry
        from pydrake.multibody import plant, tree
        from pydrake.systems import analysis, framework

        self.geometry, self.math, self.plant, self.tree, self.framework = geometry, math, plant, tree, framework
        self.analysis = analysis
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

    class LogCollector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            text = record.getMessage()
            if HALF_SPACES not in text:
                lines.append(text)

    handler, spread = LogCollector(), logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = spread


def names_of(body: Any) -> tuple[str, str]:
    """The names of the model and of the body of one of Drake's bodies."""
    model, _, name = body.name().partition(".")
    return model, name


def is_servo(actuator: Any) -> bool:
    """Whether one of Drake's actuators holds the gains of a PD controller; else the joint's effort limit."""
    return bool(actuator.name().startswith(f"{SERVO}."))


class Geometry(NamedTuple):
    """Drake's ``id`` of a geometry, and the ``part`` of a copy of a shape that it is: the shape itself or a corner."""

    id: Any
    unit: ShapeUnit
    part: str


class DrakeBuild:
    """``bodies``: Drake's, in the world's order; ``joints``: theirs (None: free); ``turns``: by the row of a ball joint the
    frame with the joint's rotation. ``efforts``: of a continuous plant the system that applies efforts at every stage, by the
    function ``efforts_at`` of the state and an effort."""

    def __init__(self, walk: Walk, settings: Mapping[str, Any], timestep: float):
        """Raises EngineError for what Drake does not support, or refuses."""
        _check(walk, settings)
        self.timestep, self.continuous, self.native = timestep, bool(scheme(settings)), native(settings)
        self.efforts: Any = None
        self.efforts_at: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
        self.walk, self.settings, self.drake = walk, settings, import_drake()
        document, drake = walk.document, self.drake
        builder = drake.framework.DiagramBuilder()
        plant = drake.plant.MultibodyPlant(0.0 if self.continuous else timestep)
        self.plant, self.scene = drake.plant.AddMultibodyPlantSceneGraph(builder, plant)
        plant = self.plant
        self.bodies: list[Any] = []
        self.joints: list[Any] = []
        self.turns: dict[int, Any] = {}
        self.geometries: list[Geometry] = []
        try:
            plant.SetUseSampledOutputPorts(False)
            plant.set_adjacent_bodies_collision_filters(False)
            plant.mutable_gravity_field().set_gravity_vector(document.gravity)
            models, kinds = drake.plant.ContactModel, drake.plant.DiscreteContactApproximation
            plant.set_contact_model(models.kHydroelasticWithFallback if hydroelastic(settings) else models.kPoint)
            approximations = {"sap": kinds.kSap, "tamsi": kinds.kTamsi}
            if not self.continuous:
                plant.set_discrete_contact_approximation(approximations[settings["contact_approximation"]])
                plant.set_sap_near_rigid_threshold(0.0)
            for placed in walk.bodies:
                body = placed.body
                self.bodies.append(plant.AddRigidBody(f"{body.model}.{body.name}", self._inertia(body)))
                self.joints.append(self._joint(placed))
            units: dict[tuple[int, int], list[ShapeUnit]] = {}
            for unit in walk.units:
                units.setdefault((unit.of.owner.row, unit.of.place), []).append(unit)
            for placed in walk.bodies:
                for place, shape in enumerate(placed.body.shapes):
                    self._shape(placed, shape, units.get((placed.row, place), []))
            self._filter()
            plant.Finalize()
            plant.set_stiction_tolerance(settings["stiction_tolerance"])
            if self.continuous:
                self._stages(builder)
            self.diagram = builder.Build()
        except (RuntimeError, ValueError) as error:
            raise EngineError(NAME, f"refuses the world: {error}") from error
        except ImportError as error:
            raise EngineError(NAME, f"meshes need scipy in addition to Drake: {error}") from error

    def _stages(self, builder: Any) -> None:
        """Add the system that applies efforts at every stage of an integrator."""
        plant, framework = self.plant, self.drake.framework
        system = builder.AddSystem(framework.LeafSystem())
        state = system.DeclareVectorInputPort("state", plant.num_multibody_states())
        effort = system.DeclareVectorInputPort("effort", plant.num_velocities())

        def calculate(context: Any, output: Any) -> None:
            if self.efforts_at is None:
                raise EngineError(NAME, "has efforts of no simulation")
            output.SetFromVector(self.efforts_at(state.Eval(context), effort.Eval(context)))

        force = system.DeclareVectorOutputPort("force", plant.num_velocities(), calculate)
        builder.Connect(plant.get_state_output_port(), state)
        builder.Connect(force, plant.get_applied_generalized_force_input_port())
        self.efforts = system

    def _damping(self, joint: AxisJoint | BallJoint) -> float:
        """The damping that Drake applies; that of the common method is an effort of simspec."""
        return joint.damping if self.native else 0.0

    def _inertia(self, body: JsonBody) -> Any:
        tree = self.drake.tree
        if body.mass:
            moments = tree.RotationalInertia(*body.inertia)
            return tree.SpatialInertia.MakeFromCentralInertia(body.mass, body.centre_of_mass, moments)
        if any(body.centre_of_mass) or any(body.inertia):
            raise EngineError(NAME, f"does not support the inertia of {body.name!r}, which has no mass")
        return tree.SpatialInertia.Zero()

    def _joint(self, placed: PlacedBody) -> Any:
        """Add the joint of a body. Drake adds those of free bodies itself: None."""
        joint, plant, tree = placed.body.joint, self.plant, self.drake.tree
        if isinstance(joint, FreeJoint):
            return None
        name, child, identity = joint.name, self.bodies[placed.row].body_frame(), self.drake.math.RigidTransform()
        parent = plant.world_body() if placed.parent == STATIC else self.bodies[placed.parent]
        origin = self.drake.place(joint.origin)
        frame = plant.AddFrame(tree.FixedOffsetFrame(f"joint.{name}", parent.body_frame(), origin))
        if isinstance(joint, FixedJoint):
            return plant.AddJoint(tree.WeldJoint(name, frame, child, identity))
        if isinstance(joint, BallJoint):
            turn = plant.AddFrame(tree.FixedOffsetFrame(f"turn.{name}", frame, identity))
            self.turns[placed.row] = turn
            return plant.AddJoint(tree.BallRpyJoint(name, turn, child, self._damping(joint)))
        kind = {"hinge": tree.RevoluteJoint, "slide": tree.PrismaticJoint}[joint.kind]
        found = plant.AddJoint(kind(name, frame, child, joint.axis, damping=self._damping(joint)))
        if joint.position_limits is not None:
            found.set_position_limits(*([value] for value in joint.position_limits))
        if joint.velocity_limit is not None:
            found.set_velocity_limits([-joint.velocity_limit], [joint.velocity_limit])
        # a controller has a separate actuator, since its effort limit is not the joint's. Of several actuators Drake takes the
        # rotor inertia of the last for the joint's, whichever the others have (measured)
        if joint.effort_limit is not None or (joint.armature and joint.servo is None):
            actuator = plant.AddJointActuator(f"actuator.{name}", found)
            actuator.set_default_rotor_inertia(joint.armature if joint.servo is None else 0.0)
            if joint.effort_limit is not None:
                actuator.set_effort_limit(joint.effort_limit)
        if joint.servo is not None:
            limit = math.inf if joint.servo.effort_limit is None else joint.servo.effort_limit
            servo = plant.AddJointActuator(f"{SERVO}.{name}", found, limit)
            servo.set_default_rotor_inertia(joint.armature)
            servo.set_controller_gains(tree.PdControllerGains(p=joint.servo.kp, d=joint.servo.kd))
        return found

    def _shape(self, placed: PlacedBody, shape: JsonShape, units: Sequence[ShapeUnit]) -> None:
        """Add the geometries of a shape: its visual, and for each of its copies the shape itself and its corners."""
        drake, body, place = self.drake, self.bodies[placed.row], self.drake.place(shape.pose)
        if shape.kind == "plane" and units:
            body, place = self.plant.world_body(), drake.place(placed.pose).multiply(place)
        if shape.colour is not None:
            visual = solid(drake, shape.kind, shape.size)
            self.plant.RegisterVisualGeometry(body, place, visual, f"{shape.name}.seen", shape.colour)
        if not units:
            return
        parts = [(SHAPE, solid(drake, shape.kind, shape.size), place)]
        for order, (kind, size, centre) in enumerate(corners(shape.kind, shape.size)):
            at = drake.math.RigidTransform(drake.math.RotationMatrix(), centre)
            parts.append((f"corner{order}", solid(drake, kind, size), place.multiply(at)))
        for unit in units:
            for part, geometry, pose in parts:
                name, properties = f"{shape.name}.{unit.copy.layer}.{part}", self._properties(unit, part)
                made = self.plant.RegisterCollisionGeometry(body, pose, geometry, name, properties)
                self.geometries.append(Geometry(made, unit, part))

    def _properties(self, unit: ShapeUnit, part: str) -> Any:
        geometry, settings = self.drake.geometry, self.settings
        properties = geometry.ProximityProperties()
        friction = self.drake.plant.CoulombFriction(unit.copy.friction, unit.copy.friction)
        geometry.AddContactMaterial(settings["dissipation"], settings["stiffness"], friction, properties)
        # Drake adds the relaxation times of two shapes
        properties.AddProperty("material", "relaxation_time", 0.5 * relaxation(self.timestep))
        if part == SHAPE and unit.of.shape.kind in FACED and hydroelastic(settings):
            # rigid where its body is static, so that its size does not matter; two rigid shapes do not touch in Drake
            if unit.of.owner.moves:
                modulus = settings["hydroelastic_modulus"]
                geometry.AddCompliantHydroelasticProperties(ANY_RESOLUTION, modulus, properties)
            else:
                geometry.AddRigidHydroelasticProperties(ANY_RESOLUTION, properties)
        return properties

    def _filter(self) -> None:
        """Exclude contact between units of kinds that do not touch and of excluded bodies, between corners, and between the
        faces that touch by hydroelastic contact and the corners of such faces."""
        bodies: dict[int, list[Any]] = {}
        kinds: dict[tuple[str, str, int], list[Any]] = {}
        for geometry in self.geometries:
            bodies.setdefault(geometry.unit.of.owner.row, []).append(geometry.id)
            kinds.setdefault(geometry.unit.kind, []).append(geometry.id)
        excluded = [(bodies.get(row, []), bodies.get(other, [])) for row, other in self.walk.excluded]
        for kind, other in itertools.combinations_with_replacement(kinds, 2):
            if not self.walk.meet(kind, other):
                excluded.append((kinds[kind], kinds[other]))
        small = [geometry.id for geometry in self.geometries if geometry.part != SHAPE]
        excluded.append((small, small))
        if hydroelastic(self.settings):
            faced = [geometry for geometry in self.geometries if geometry.unit.of.shape.kind in FACED]
            at_faces = [geometry.id for geometry in faced if geometry.part != SHAPE]
            excluded.append(([geometry.id for geometry in faced if geometry.part == SHAPE], at_faces))
        sets, declared = self.drake.geometry.GeometrySet, self.drake.geometry.CollisionFilterDeclaration()
        for ids, others in excluded:
            if ids is others:
                declared.ExcludeWithin(sets(ids))
            elif ids and others:
                declared.ExcludeBetween(sets(ids), sets(others))
        self.scene.collision_filter_manager().Apply(declared)


def _check(walk: Walk, settings: Mapping[str, Any]) -> None:
    """Raise EngineError for what Drake does not support."""
    refuse(walk, NAME, cones=(CONE,), moving_planes=False)
    joints = [body.body.joint for body in walk.bodies]
    axes = [joint for joint in joints if isinstance(joint, AxisJoint)]
    if settings["contact_approximation"] != "sap" and any(joint.servo is not None for joint in axes):
        raise EngineError(NAME, "supports its PD controllers by SAP alone")
    if rough := [joint.name for joint in axes if joint.dry_friction]:
        raise EngineError(NAME, f"does not support dry friction, which joint {rough[0]!r} has")
    shapes = [unit.of.shape for unit in walk.units]
    planes = sum(shape.kind == "plane" for shape in shapes)
    if planes > MOST_PLANES:
        raise EngineError(NAME, f"does not support more than {MOST_PLANES} planes, copies included; here are {planes}")
    geometries = sum(1 + len(corners(shape.kind, shape.size)) for shape in shapes)
    large = too_large(geometries, sum(VELOCITY_SIZE[joint.kind] for joint in joints))
    if large is not None:
        raise EngineError(NAME, large)
    for unit in walk.units:
        if lacking := [name for name in LACKING if getattr(unit.copy, name)]:
            raise EngineError(NAME, f"does not support {lacking[0]}, which shape {unit.of.shape.name!r} has")


def solid(drake: DrakeModules, kind: str, size: Sequence[float]) -> Any:
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
