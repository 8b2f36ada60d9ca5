"""What Drake says it holds, in the world's frames and order."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from simspec.engines.drake.building import CONE, NAME
from simspec.engines.drake.simulation import Simulation
from simspec.errors import EngineError
from simspec.formats.passes import restore_frames
from simspec.world import frames
from simspec.world.types import Body, Inertial, Joint, Pose, ReadBack, Shape, Surface, Vector3

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
}
"""Drake's shapes, and what gives their size."""
SHAPE = "shape"
"""The part of a shape's geometries that is the shape itself."""


def read_back(sim: Simulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as Drake holds it, and its present state."""
    q, v = sim.get_state()
    bodies = []
    for index, held in enumerate(sim.built.bodies):
        model = sim.plant.GetModelInstanceName(held.model_instance()).removeprefix("model.")
        bodies.append(Body(held.name(), model, inertial(sim, held), _joint(sim, index, q, v), _shapes(sim, held)))
    moved = zip(sim.names, sim.offsets.tolist(), strict=True)
    offsets = {name: tuple(offset) for name, offset in moved if any(offset)}
    return ReadBack(
        restore_frames(tuple(bodies), offsets),
        _vector(sim.plant.gravity_field().gravity_vector()),
        float(sim.plant.time_step()),
        CONE,
        dict(unreadable),
    )


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
    if sim.built.joints[index] is not None:
        return sim.built.joints[index]
    held = sim.built.bodies[index]
    every = (sim.plant.get_joint(one) for one in sim.plant.GetJointIndices(held.model_instance()))
    return next(one for one in every if one.child_body().index() == held.index())


def actuator_of(sim: Simulation, joint: Any) -> Any:
    """The actuator of a joint; None without one."""
    every = (sim.plant.get_joint_actuator(one) for one in sim.plant.GetJointActuatorIndices())
    return next((one for one in every if one.joint().index() == joint.index()), None)


def _joint(sim: Simulation, index: int, q: np.ndarray, v: np.ndarray) -> Joint:
    joint = joint_of(sim, index)
    kind = JOINT_KINDS.get(joint.type_name())
    if kind is None:
        raise EngineError(NAME, f"holds the joint {joint.name()!r} as {joint.type_name()}, unknown here")
    at = sim.coordinates.v_places[index]
    position, velocity = q[sim.coordinates.q_places[index]].tolist(), v[at].tolist()
    if kind == "free":
        turn = frames.normalise(tuple(position[3:]))
        angular = frames.rotate(turn, tuple(velocity[3:]))
        name = sim.content["bodies"][index]["joint"]["name"]
        return Joint(name, kind, position=(*position[:3], *turn), velocity=(*velocity[:3], *angular))
    if not joint.frame_on_child().is_body_frame():
        raise EngineError(NAME, f"joint {joint.name()!r} is not at its child's frame")
    above = joint.parent_body()
    parent = None if above.index() == sim.plant.world_body().index() else above.name()
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
    effort = math.inf if actuator is None else float(actuator.effort_limit())
    return dataclasses.replace(
        held,
        axis=_vector(joint.revolute_axis() if kind == "hinge" else joint.translation_axis()),
        position_limits=(lower, upper) if math.isfinite(lower) or math.isfinite(upper) else None,
        velocity_limit=speed if math.isfinite(speed) else None,
        effort_limit=effort if math.isfinite(effort) else None,
        armature=0.0 if actuator is None else float(actuator.calc_reflected_inertia(sim.context)),
        spring_rest=float(sim.rest[at.start]),
    )


def geometries_of(sim: Simulation, held: Any) -> dict[tuple[str, int], dict[str, Any]]:
    """Drake's geometries of a body, by shape and layer, and there by part; from their names. Planes are on the world's body."""
    inspector = sim.query().inspector()
    found: dict[tuple[str, int], dict[str, Any]] = {}
    own = sim.plant.GetCollisionGeometriesForBody(held)
    if held.name() in sim.built.places:
        planes = {name for body, name in sim.built.shapes if sim.built.bodies[body].name() == held.name()}
        for one in sim.plant.GetCollisionGeometriesForBody(sim.plant.world_body()):
            if inspector.GetName(one).rpartition("::")[2].split(".")[0] in planes:
                own.append(one)
    for one in own:
        shape, layer, part = inspector.GetName(one).rpartition("::")[2].split(".")
        found.setdefault((shape, int(layer)), {})[part] = one
    return found


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
    }


def _shapes(sim: Simulation, held: Any) -> tuple[Shape, ...]:
    """The collision shapes of a body; copies that are alike are one shape's."""
    inspector = sim.query().inspector()
    found: dict[str, list[Shape]] = {}
    for (name, _), parts in sorted(geometries_of(sim, held).items()):
        shape = inspector.GetShape(parts[SHAPE])
        kind, sizes = SIZES[type(shape).__name__]
        size = tuple(float(getattr(shape, word)()) for word in sizes)
        numbers = surface(sim, parts[SHAPE])
        if numbers["static_friction"] != numbers["dynamic_friction"]:
            raise EngineError(NAME, f"holds two frictions for the shape {name!r}")
        pose = pose_of(place_of(sim, held, parts[SHAPE]))
        copy = Shape(name, kind, size, pose, visual=False, surfaces=(Surface(numbers["dynamic_friction"]),))
        same = [one for one in found.get(name, ()) if (one.kind, one.size, one.pose) == (kind, size, pose)]
        if same:
            joined = dataclasses.replace(same[0], surfaces=same[0].surfaces + copy.surfaces)
            found[name][found[name].index(same[0])] = joined
        else:
            found.setdefault(name, []).append(copy)
    return tuple(shape for copies in found.values() for shape in copies)
