"""A URDF, SDF or MJCF file as Drake's own parser makes it.

Facts marked *measured*: Drake 1.51.1.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from simspec.engines.drake.building import CONE, NAME, warnings_into
from simspec.engines.drake.readback import JOINT_KINDS, SIZES, axis_fields, inertial, transform_pose
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
from simspec.engines.kit.readback import vector
from simspec.errors import EngineError
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.world import frames
from simspec.world.types import EngineValue, Inertial, Joint, Pose, ReadBack, Shape, Surface

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
