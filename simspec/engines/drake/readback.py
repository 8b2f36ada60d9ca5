"""The model that Drake stores, in the world's frames and order; and files as Drake's own parser makes them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.engines.drake.building import CONE, NAME, SHAPE, names_of, warnings_into
from simspec.engines.drake.simulation import DrakeSimulation
from simspec.engines.kit.building import bound, inertial_of, merged, pose_of, range_of, vector
from simspec.engines.kit.foreign import (
    MESH,
    REFUSED,
    Effect,
    EngineAddition,
    EngineLink,
    Reads,
    bodies_of_links,
    distinct_names,
    support,
)
from simspec.engines.kit.world_simulation import free_joint
from simspec.errors import EngineError
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, EngineServo, EngineValue, Inertial, Joint, Pose, ReadBack, Shape, Surface

JOINT_KINDS = {
    "weld": "fixed",
    "revolute": "hinge",
    "prismatic": "slide",
    "ball_rpy": "ball",
    "quaternion_floating": "free",
}
"""Drake's types of joints."""
SIZES = {
    "Sphere": ("sphere", ("radius",)),
    "Box": ("box", ("width", "depth", "height")),
    "Cylinder": ("cylinder", ("radius", "length")),
    "Capsule": ("capsule", ("radius", "length")),
    "Ellipsoid": ("ellipsoid", ("a", "b", "c")),
    "HalfSpace": ("plane", ()),
    "Convex": ("mesh", ()),
}
"""Drake's shapes, and the getters of their size; that of a mesh is its vertices."""


def read_back(sim: DrakeSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as Drake stores it, and its present state."""
    q, v = sim.get_state()
    bodies = []
    for row, body in enumerate(sim.built.bodies):
        model, name = names_of(body)
        joint = _joint(sim, row, q[sim.q_places[row]].tolist(), v[sim.v_places[row]].tolist())
        bodies.append(Body(name, model, inertial(body, sim.context), joint, _shapes(sim, row)))
    gravity = vector(sim.plant.gravity_field().gravity_vector())
    read = sim.model(bodies, gravity, sim.timestep, unreadable, CONE)
    servos = []  # one without gains is the same as none in Drake
    for servo in sim.servos.values():
        gains = servo.get_controller_gains()
        servos.append(EngineServo(servo.joint().name(), gains.p, gains.d, bound(servo.effort_limit())))
    return dataclasses.replace(read, servos=tuple(servos))


def transform_pose(transform: Any) -> Pose:
    """A pose of one of Drake's."""
    return pose_of(transform.translation(), transform.rotation().matrix())


def inertial(body: Any, context: Any) -> Inertial:
    """The mass properties of a body of Drake's."""
    about_origin = body.CalcSpatialInertiaInBodyFrame(context)
    if not (mass := float(about_origin.get_mass())):
        return NO_INERTIA
    centre = about_origin.get_com()
    return inertial_of(mass, centre, about_origin.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3())


def axis_fields(joint: Any, kind: str, actuator: Any) -> dict[str, Any]:
    """The axis and the limits of a hinge or a slide; ``actuator`` has its effort limit, if any."""
    return {
        "axis": vector(joint.revolute_axis() if kind == "hinge" else joint.translation_axis()),
        "position_limits": range_of(joint.position_lower_limits()[0], joint.position_upper_limits()[0]),
        "velocity_limit": bound(joint.velocity_upper_limits()[0]),
        "effort_limit": None if actuator is None else bound(actuator.effort_limit()),
    }


def joint_of(sim: DrakeSimulation, row: int) -> Any:
    """Drake's joint of a body; Drake adds those of free bodies."""
    return sim.inboard[int(sim.built.bodies[row].index())]


def actuator_of(sim: DrakeSimulation, joint: Any) -> Any:
    """The actuator with a joint's effort limit; None without one."""
    return sim.actuators.get(int(joint.index()))


def _joint(sim: DrakeSimulation, row: int, position: list[float], velocity: list[float]) -> Joint:
    joint = joint_of(sim, row)
    kind = JOINT_KINDS.get(joint.type_name())
    if kind is None:
        raise EngineError(NAME, f"stores the joint {joint.name()!r} as {joint.type_name()}, unknown here")
    if kind == "free":
        return free_joint(sim.document.bodies[row].joint.name, position, velocity)
    if not joint.frame_on_child().is_body_frame():
        raise EngineError(NAME, f"joint {joint.name()!r} is not at its child's frame")
    above = joint.parent_body()
    parent = None if above.index() == sim.plant.world_body().index() else names_of(above)[1]
    origin = transform_pose(joint.frame_on_parent().GetFixedPoseInBodyFrame())
    found = Joint(joint.name(), kind, parent, origin, position=tuple(position), velocity=tuple(velocity))
    if kind == "fixed":
        return found
    start = sim.v_places[row].start
    native = joint.GetDampingVector(sim.context) if joint.num_velocities() else np.zeros(1)
    damping = float(sim.damping[start]) + float(np.max(np.abs(native)))
    found = dataclasses.replace(found, damping=damping, spring_stiffness=float(sim.stiffness[start]))
    if kind == "ball":
        return found
    actuator = actuator_of(sim, joint)
    last = sim.servos.get(int(joint.index()), actuator)
    return dataclasses.replace(
        found,
        **axis_fields(joint, kind, actuator),
        armature=0.0 if last is None else float(last.calc_reflected_inertia(sim.context)),
        spring_rest=float(sim.rest[start]),
    )


def _named_geometries(sim: DrakeSimulation, row: int, method: str) -> list[tuple[list[str], Any]]:
    """Drake's geometries of a body by the plant's ``method``, with the parts of their names; planes are on the world's body."""
    inspector, query = sim.query().inspector(), getattr(sim.plant, method)

    def named(body: Any) -> list[tuple[list[str], Any]]:
        return [(inspector.GetName(found).rpartition("::")[2].split("."), found) for found in query(body)]

    found, placed = named(sim.built.bodies[row]), sim.built.walk.bodies[row]
    if not placed.moves:
        planes = {shape.name for shape in placed.body.shapes if shape.kind == "plane"}
        found += [(words, plane) for words, plane in named(sim.plant.world_body()) if words[0] in planes]
    return found


def geometries_of(sim: DrakeSimulation, row: int) -> dict[tuple[str, int], dict[str, Any]]:
    """Drake's collision geometries of a body, by shape and layer, and there by part; from their names."""
    found: dict[tuple[str, int], dict[str, Any]] = {}
    for (shape, layer, part), geometry in _named_geometries(sim, row, "GetCollisionGeometriesForBody"):
        found.setdefault((shape, int(layer)), {})[part] = geometry
    return found


def visuals_of(sim: DrakeSimulation, row: int) -> dict[str, Any]:
    """Drake's visual geometries of a body, by shape."""
    return {words[0]: found for words, found in _named_geometries(sim, row, "GetVisualGeometriesForBody")}


def surface(sim: DrakeSimulation, geometry: Any) -> dict[str, float]:
    """The numbers of a geometry's contact."""
    properties = sim.query().inspector().GetProximityProperties(geometry)
    friction = properties.GetProperty("material", "coulomb_friction")
    names = {
        "material": ("point_contact_stiffness", "hunt_crossley_dissipation", "relaxation_time"),
        "hydroelastic": ("hydroelastic_modulus", "resolution_hint"),
    }
    return {
        "static_friction": float(friction.static_friction()),
        "dynamic_friction": float(friction.dynamic_friction()),
        **{name: float(properties.GetProperty(group, name)) for group in names for name in names[group]},
    }


def kind_and_size(sim: DrakeSimulation, geometry: Any) -> tuple[str, tuple[float, ...]]:
    """The kind and size of a geometry; the size of a mesh is the vertices of Drake's convex hull of it, flat."""
    inspector = sim.query().inspector()
    shape = inspector.GetShape(geometry)
    kind, sizes = SIZES[type(shape).__name__]
    if kind != "mesh":
        return kind, tuple(float(getattr(shape, word)()) for word in sizes)
    hull = inspector.GetConvexHull(geometry)
    return kind, tuple(float(value) for index in range(hull.num_vertices()) for value in hull.vertex(index))


def _shapes(sim: DrakeSimulation, row: int) -> tuple[Shape, ...]:
    """The shapes of a body; equal copies, and their visual, are one shape."""
    inspector, body = sim.query().inspector(), sim.built.bodies[row]
    found: dict[str, list[Shape]] = {}

    def add(name: str, geometry: Any, **fields: Any) -> None:
        place = inspector.GetPoseInFrame(geometry)
        if inspector.GetFrameId(geometry) == inspector.world_frame_id():
            place = body.EvalPoseInWorld(sim.context).inverse().multiply(place)
        fields = {"collision": False, "visual": False, **fields}
        found.setdefault(name, []).append(Shape(name, *kind_and_size(sim, geometry), transform_pose(place), **fields))

    for (name, _), parts in sorted(geometries_of(sim, row).items()):
        numbers = surface(sim, parts[SHAPE])
        if numbers["static_friction"] != numbers["dynamic_friction"]:
            raise EngineError(NAME, f"stores two frictions for the shape {name!r}")
        add(name, parts[SHAPE], collision=True, surfaces=(Surface(numbers["dynamic_friction"]),))
    for name, geometry in visuals_of(sim, row).items():
        colour = inspector.GetIllustrationProperties(geometry).GetProperty("phong", "diffuse")
        add(name, geometry, visual=True, colour=(colour.r(), colour.g(), colour.b(), colour.a()))
    return tuple(shape for copies in found.values() for shape in merged(copies))


# A URDF, SDF or MJCF file as Drake's own parser makes it. Facts marked *measured*: Drake 1.51.1.

HOW: Final = "pydrake.multibody.parsing.Parser(plant).AddModels(file)"
MEASURED: Final = "1.51.1"
FRICTION: Final = Effect("joint.dry_friction", "dry friction", "drops the dry friction of joints")
SPRINGS: Final = Effect("joint.spring_stiffness", "spring of a hinge or a slide", "drops the springs of joints")
CRASH: Final = Effect(
    REFUSED,
    "a plane and 14 or more moving shapes",
    "ends the process (SIGSEGV) where a plane comes before 14 moving shapes",
)
STEP: Final = Effect("timestep", "timestep other than 1 ms", "reads no timestep: the plant has its own")
URDF_EFFECTS: Final = (
    FRICTION,
    Effect("joint.effort_limit", "effort limit", "drops effort limits: URDF without <transmission> has no actuators"),
)
SDF_EFFECTS: Final = (
    CRASH,
    Effect(
        REFUSED, "a loop", "refuses files whose joints form a loop; --profile 1.6 leaves loops out", profiles=("1.9",)
    ),
    FRICTION,
    SPRINGS,
    STEP,
    Effect("gravity", "gravity other than 9.81 m/s² down", "reads no gravity: 9.81 m/s² along -z"),
)
MJCF_EFFECTS: Final = (
    CRASH,
    FRICTION,
    Effect(
        "joint.effort_limit", "effort limit without a controller", "drops the effort limits of joints without actuators"
    ),
    Effect(
        "joint.effort_limit",
        "other effort limit of the controller",
        "takes the actuator's effort limit for the joint's",
    ),
    SPRINGS,
    STEP,
    Effect("joint.damping", "damping of a ball joint", "drops the damping of ball joints"),
)
"""Drake's changes to plain files."""
FOREIGN: Final[Mapping[str, Reads]] = {
    "urdf": Reads(HOW, (".urdf",), "robot", version=MEASURED, effects=URDF_EFFECTS),
    "sdf": Reads(HOW, (".sdf", ".world"), "sdf", version=MEASURED, effects=SDF_EFFECTS),
    "mjcf": Reads(HOW, (".xml", ".mjcf"), "mujoco", version=MEASURED, effects=MJCF_EFFECTS),
}
FOREIGN_ADDITIONS: Final[Mapping[str, EngineAddition]] = {
    "timestep": EngineAddition(None, "default", "1 ms here; the plant is made with a step of the user's choice"),
    "couplings": EngineAddition(None, "default", "joints that follow others, as constraints of the contact solver"),
}
"""Drake's additions to a file."""
TIMESTEP: Final = 1e-3
MOVES: Final = {**JOINT_KINDS, "planar": "planar", "universal": "universal", "rpy_floating": "free", "screw": "screw"}
FLOATING: Final = ("quaternion_floating", "rpy_floating")


def parser_parts() -> tuple[Any, Any, Any]:
    """Drake's parser, the function that makes a plant, and the builder of diagrams."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
    from pydrake.systems.framework import DiagramBuilder

    return Parser, AddMultibodyPlantSceneGraph, DiagramBuilder


def load(file: Path, packages: Mapping[str, str], log: list[str]) -> ReadBack:
    """A file as Drake stores it. Raises EngineError where it refuses it."""
    Parser, AddMultibodyPlantSceneGraph, DiagramBuilder = parser_parts()
    with warnings_into(log):
        try:
            builder = DiagramBuilder()
            plant, _ = AddMultibodyPlantSceneGraph(builder, TIMESTEP)
            parser = Parser(plant)
            for name, folder in packages.items():
                if not parser.package_map().Contains(name):
                    parser.package_map().Add(name, Path(folder))
            parser.AddModels(file)
            plant.Finalize()
            diagram = builder.Build()
        except (RuntimeError, ValueError) as error:
            raise EngineError(NAME, f"refuses the file: {error}") from error
        return _ParsedPlant(plant, diagram, log).read_back()


class _ParsedPlant:
    def __init__(self, plant: Any, diagram: Any, log: list[str]):
        self._log = log
        self._plant = plant
        root = diagram.CreateDefaultContext()
        self._context = plant.GetMyMutableContextFromRoot(root)
        positions = plant.GetPositions(self._context)
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        for joint in joints:
            if joint.type_name() not in FLOATING:
                positions[joint.position_start() : joint.position_start() + joint.num_positions()] = 0.0
        plant.SetPositions(self._context, positions)
        self._inboard = {int(joint.child_body().index()): joint for joint in joints}
        graph = diagram.GetSubsystemByName("scene_graph")
        self._inspector = graph.get_query_output_port().Eval(graph.GetMyContextFromRoot(root)).inspector()
        actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
        self._actuators = {int(actuator.joint().index()): actuator for actuator in actuators}

    def read_back(self) -> ReadBack:
        from pydrake.multibody.tree import BodyIndex

        plant = self._plant
        world = plant.world_body()
        indices = [BodyIndex(number) for number in range(plant.num_bodies())]
        bodies = [plant.get_body(index) for index in indices if index != world.index()]
        names = dict(
            zip([int(body.index()) for body in bodies], distinct_names([body.name() for body in bodies]), strict=True)
        )
        links = [self._link(body, names) for body in bodies]
        shapes = self._shapes(world)
        if shapes:
            links.insert(0, EngineLink("world", None, Pose(), Inertial(0.0), Joint("", "fixed"), shapes=shapes))
        inventory: dict[str, EngineValue] = {
            "timestep": float(plant.time_step()),
            "couplings": int(plant.num_constraints()),
        }
        gravity = vector(plant.gravity_field().gravity_vector())
        return ReadBack(bodies_of_links(links), gravity, float(plant.time_step()), CONE, inventory=inventory)

    def _link(self, body: Any, names: Mapping[int, str]) -> EngineLink:
        joint = self._inboard[int(body.index())]
        above = joint.parent_body().index()
        anchor = transform_pose(joint.frame_on_child().GetFixedPoseInBodyFrame())
        floating = joint.type_name() in FLOATING
        return EngineLink(
            names[int(body.index())],
            names.get(int(above)),
            transform_pose(body.EvalPoseInWorld(self._context)),
            inertial(body, self._context),
            self._joint(joint, anchor),
            (0.0, 0.0, 0.0) if floating else anchor.position,
            self._shapes(body),
        )

    def _joint(self, joint: Any, anchor: Pose) -> Joint:
        kind = MOVES.get(joint.type_name(), joint.type_name())
        if kind not in SCALAR_JOINTS:
            return Joint(joint.name(), kind)
        actuator = self._actuators.get(int(joint.index()))
        found = Joint(
            joint.name(),
            kind,
            **axis_fields(joint, kind, actuator),
            damping=float(joint.GetDampingVector(self._context)[0]),
            armature=0.0 if actuator is None else float(actuator.calc_reflected_inertia(self._context)),
        )
        return dataclasses.replace(found, axis=frames.rotate(anchor.quaternion, found.axis))

    def _shapes(self, body: Any) -> tuple[Shape, ...]:
        plant = self._plant
        solid = [self._shape(geometry, True) for geometry in plant.GetCollisionGeometriesForBody(body)]
        visual = [self._shape(geometry, False) for geometry in plant.GetVisualGeometriesForBody(body)]
        return (*solid, *visual)

    def _hull(self, geometry: Any) -> tuple[float, ...]:
        """The support function of a mesh's convex hull; none of a file that Drake does not read, and so does not collide
        with."""
        try:
            hull = self._inspector.GetConvexHull(geometry)
        except RuntimeError as error:
            self._log.append(str(error))
            return ()
        return () if hull is None else support(np.array([hull.vertex(i) for i in range(hull.num_vertices())]))

    def _shape(self, geometry: Any, solid: bool) -> Shape:
        inspector = self._inspector
        shape = inspector.GetShape(geometry)
        kind, sizes = SIZES.get(type(shape).__name__, (type(shape).__name__, ()))
        size = tuple(float(getattr(shape, word)()) for word in sizes)
        if kind in ("Mesh", "Convex"):
            kind, size = MESH, self._hull(geometry) if solid else ()
        surfaces: tuple[Surface, ...] = ()
        if solid:
            properties = inspector.GetProximityProperties(geometry)
            friction = properties.GetProperty("material", "coulomb_friction")
            surfaces = (Surface(float(friction.dynamic_friction())),)
        pose = transform_pose(inspector.GetPoseInFrame(geometry))
        return Shape(
            inspector.GetName(geometry), kind, size, pose, collision=solid, visual=not solid, surfaces=surfaces
        )
