"""What Drake says it holds, in the world's frames and order."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from simspec.engines.drake.building import CONE, NAME, told_name
from simspec.engines.drake.simulation import Simulation
from simspec.engines.kit.world_simulation import free_joint
from simspec.errors import EngineError
from simspec.world import frames
from simspec.world.types import Body, EngineServo, Inertial, Joint, Pose, ReadBack, Shape, Surface, Vector3

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
"""Drake's shapes, and what gives their size; of a hull its vertices do."""
SHAPE = "shape"
"""The part of a shape's geometries that is the shape itself."""


def read_back(sim: Simulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as Drake holds it, and its present state."""
    q, v = sim.get_state()
    bodies = []
    for index, held in enumerate(sim.built.bodies):
        model, name = told_name(held)
        bodies.append(Body(name, model, inertial(sim, held), _joint(sim, index, q, v), _shapes(sim, held)))
    gravity = _vector(sim.plant.gravity_field().gravity_vector())
    read = sim.model(bodies, gravity, float(sim.plant.time_step()), unreadable, CONE)
    return dataclasses.replace(read, servos=_servos(sim))


def _servos(sim: Simulation) -> tuple[EngineServo, ...]:
    """Drake's PD controllers; one without gains is held as none, which is the same."""
    found = []
    for servo in sim.servos.values():
        limit, gains = float(servo.effort_limit()), servo.get_controller_gains()
        found.append(EngineServo(servo.joint().name(), gains.p, gains.d, limit if math.isfinite(limit) else None))
    return tuple(found)


def _vector(values: Any) -> Vector3:
    x, y, z = np.asarray(values, dtype=float).tolist()
    return (x + 0.0, y + 0.0, z + 0.0)


def pose_of(transform: Any) -> Pose:
    """A pose from Drake's."""
    matrix = tuple(map(tuple, transform.rotation().matrix().tolist()))
    return Pose(_vector(transform.translation()), frames.from_matrix(matrix))  # type: ignore[arg-type]


def inertial(sim: Simulation, held: Any) -> Inertial:
    """The mass properties of a body."""
    about_origin = held.CalcSpatialInertiaInBodyFrame(sim.context)
    mass = float(about_origin.get_mass())
    if mass == 0.0:
        return Inertial(0.0)
    centre = about_origin.get_com()
    m = about_origin.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3().tolist()
    return Inertial(mass, _vector(centre), (m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2]))


def joint_of(sim: Simulation, index: int) -> Any:
    """Drake's joint of a body; that of a free one it made itself."""
    return sim.inboard[int(sim.built.bodies[index].index())]


def actuator_of(sim: Simulation, joint: Any) -> Any:
    """The actuator with a joint's effort limit; None without one."""
    return sim.actuators.get(int(joint.index()))


def _joint(sim: Simulation, index: int, q: np.ndarray, v: np.ndarray) -> Joint:
    joint = joint_of(sim, index)
    kind = JOINT_KINDS.get(joint.type_name())
    if kind is None:
        raise EngineError(NAME, f"holds the joint {joint.name()!r} as {joint.type_name()}, unknown here")
    at = sim.coordinates.v_places[index]
    position, velocity = q[sim.coordinates.q_places[index]].tolist(), v[at].tolist()
    if kind == "free":
        return free_joint(sim.document.bodies[index].joint.name, position, velocity)
    if not joint.frame_on_child().is_body_frame():
        raise EngineError(NAME, f"joint {joint.name()!r} is not at its child's frame")
    above = joint.parent_body()
    parent = None if above.index() == sim.plant.world_body().index() else told_name(above)[1]
    origin = pose_of(joint.frame_on_parent().GetFixedPoseInBodyFrame())
    held = Joint(joint.name(), kind, parent, origin, position=tuple(position), velocity=tuple(velocity))
    if kind == "fixed":
        return held
    own = joint.GetDampingVector(sim.context) if joint.num_velocities() else np.zeros(1)
    damping = float(sim.damping[at.start]) + float(np.max(np.abs(own)))
    held = dataclasses.replace(held, damping=damping, spring_stiffness=float(sim.stiffness[at.start]))
    if kind == "ball":
        return held
    lower, upper = float(joint.position_lower_limits()[0]), float(joint.position_upper_limits()[0])
    speed = float(joint.velocity_upper_limits()[0])
    actuator = actuator_of(sim, joint)
    last = sim.servos.get(int(joint.index()), actuator)
    effort = math.inf if actuator is None else float(actuator.effort_limit())
    return dataclasses.replace(
        held,
        axis=_vector(joint.revolute_axis() if kind == "hinge" else joint.translation_axis()),
        position_limits=(lower, upper) if math.isfinite(lower) or math.isfinite(upper) else None,
        velocity_limit=speed if math.isfinite(speed) else None,
        effort_limit=effort if math.isfinite(effort) else None,
        armature=0.0 if last is None else float(last.calc_reflected_inertia(sim.context)),
        spring_rest=float(sim.rest[at.start]),
    )


def _names(sim: Simulation, held: Any, of: str) -> list[tuple[list[str], Any]]:
    """Drake's geometries of a body, each with the parts of its name; ``of`` is the plant's method. Planes are on the world's
    body."""
    inspector = sim.query().inspector()
    ask = getattr(sim.plant, of)
    own = [(inspector.GetName(one).rpartition("::")[2].split("."), one) for one in ask(held)]
    name = told_name(held)[1]
    if name in sim.built.places:
        planes = {shape.name for shape in sim.by_name[name].shapes if shape.kind == "plane"}
        every = ((inspector.GetName(one).rpartition("::")[2].split("."), one) for one in ask(sim.plant.world_body()))
        own += [(words, one) for words, one in every if words[0] in planes]
    return own


def geometries_of(sim: Simulation, held: Any) -> dict[tuple[str, int], dict[str, Any]]:
    """Drake's collision geometries of a body, by shape and layer, and there by part; from their names."""
    found: dict[tuple[str, int], dict[str, Any]] = {}
    for (shape, layer, part), one in _names(sim, held, "GetCollisionGeometriesForBody"):
        found.setdefault((shape, int(layer)), {})[part] = one
    return found


def seen_of(sim: Simulation, held: Any) -> dict[str, Any]:
    """Drake's visual geometries of a body, by shape."""
    return {words[0]: one for words, one in _names(sim, held, "GetVisualGeometriesForBody")}


def place_of(sim: Simulation, held: Any, geometry: Any) -> Any:
    """The pose of a geometry on its body."""
    inspector = sim.query().inspector()
    place = inspector.GetPoseInFrame(geometry)
    if inspector.GetFrameId(geometry) == inspector.world_frame_id():
        return held.EvalPoseInWorld(sim.context).inverse().multiply(place)
    return place


def surface(sim: Simulation, geometry: Any) -> dict[str, float]:
    """The numbers of a geometry."""
    held = sim.query().inspector().GetProximityProperties(geometry)
    friction = held.GetProperty("material", "coulomb_friction")
    names = ("point_contact_stiffness", "hunt_crossley_dissipation", "relaxation_time")
    return {
        "static_friction": float(friction.static_friction()),
        "dynamic_friction": float(friction.dynamic_friction()),
        **{name: float(held.GetProperty("material", name)) for name in names},
        **{name: float(held.GetProperty("hydroelastic", name)) for name in ("hydroelastic_modulus", "resolution_hint")},
    }


def kind_and_size(sim: Simulation, geometry: Any) -> tuple[str, tuple[float, ...]]:
    """What a geometry is; of a hull the vertices that Drake's own hull of it has, flat."""
    inspector = sim.query().inspector()
    shape = inspector.GetShape(geometry)
    kind, sizes = SIZES[type(shape).__name__]
    if kind != "mesh":
        return kind, tuple(float(getattr(shape, word)()) for word in sizes)
    hull = inspector.GetConvexHull(geometry)
    return kind, tuple(float(value) for index in range(hull.num_vertices()) for value in hull.vertex(index))


def properties(sim: Simulation, geometry: Any) -> list[str]:
    """The names of everything that is said of a geometry's contact, as ``group.name``."""
    told = sim.query().inspector().GetProximityProperties(geometry)
    return sorted(f"{group}.{name}" for group in told.GetGroupNames() for name in told.GetPropertiesInGroup(group))


def _shape(sim: Simulation, held: Any, name: str, geometry: Any) -> Shape:
    """A geometry as a shape that is neither seen nor solid."""
    kind, size = kind_and_size(sim, geometry)
    return Shape(name, kind, size, pose_of(place_of(sim, held, geometry)), collision=False, visual=False)


def _shapes(sim: Simulation, held: Any) -> tuple[Shape, ...]:
    """The shapes of a body; copies that are alike, and what is seen of them, are one shape's."""
    found: dict[str, list[Shape]] = {}

    def add(one: Shape) -> None:
        held_so_far = found.setdefault(one.name, [])
        for index, other in enumerate(held_so_far):
            if (other.kind, other.size, other.pose) == (one.kind, one.size, one.pose):
                held_so_far[index] = dataclasses.replace(
                    other,
                    collision=other.collision or one.collision,
                    visual=other.visual or one.visual,
                    colour=one.colour if one.visual else other.colour,
                    surfaces=other.surfaces + one.surfaces,
                )
                return
        held_so_far.append(one)

    for (name, _), parts in sorted(geometries_of(sim, held).items()):
        numbers = surface(sim, parts[SHAPE])
        if numbers["static_friction"] != numbers["dynamic_friction"]:
            raise EngineError(NAME, f"holds two frictions for the shape {name!r}")
        surfaces = (Surface(numbers["dynamic_friction"]),)
        add(dataclasses.replace(_shape(sim, held, name, parts[SHAPE]), collision=True, surfaces=surfaces))
    for name, geometry in seen_of(sim, held).items():
        held_colour = sim.query().inspector().GetIllustrationProperties(geometry).GetProperty("phong", "diffuse")
        colour = (held_colour.r(), held_colour.g(), held_colour.b(), held_colour.a())
        add(dataclasses.replace(_shape(sim, held, name, geometry), visual=True, colour=colour))
    return tuple(shape for copies in found.values() for shape in copies)
