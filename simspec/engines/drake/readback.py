"""The model that Drake stores, in the world's frames and order."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from simspec.engines.drake.building import CONE, NAME, SHAPE, names_of
from simspec.engines.drake.simulation import DrakeSimulation
from simspec.engines.kit.readback import bound, inertial_of, merged, pose_of, range_of, vector
from simspec.engines.kit.world_simulation import free_joint
from simspec.errors import EngineError
from simspec.world.inertia import NO_INERTIA
from simspec.world.types import Body, EngineServo, Inertial, Joint, Pose, ReadBack, Shape, Surface

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
    read = sim.model(bodies, gravity, float(sim.plant.time_step()), unreadable, CONE)
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
