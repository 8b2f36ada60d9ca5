"""Everything that Drake holds beside the fields of the read-back, and that can act; what it must be says ``expected.py``.

The filter of contacts is Drake's own answer for every two geometries. What cannot be asked for: the stiction tolerance, which
is what Drake was told.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

from simspec.contact.plan import ContactPlan
from simspec.control.reference import natives
from simspec.engines.drake.approximations import ANY_RESOLUTION, FACED, Part, corners, held_at, hydroelastic, reach_of
from simspec.engines.drake.building import ERROR_REDUCTION, told_name
from simspec.engines.drake.readback import (
    SHAPE,
    SIZES,
    actuator_of,
    geometries_of,
    inertial,
    joint_of,
    kind_and_size,
    properties,
    seen_of,
    surface,
)
from simspec.engines.drake.simulation import Simulation
from simspec.engines.kit.inventory import Carrier, expected_apart, listed, named_set, sidecar_labels
from simspec.formats.kit.contract import recentre_free_roots
from simspec.world import frames
from simspec.world.contact_pairs import solid_shapes
from simspec.world.inertia import NO_INERTIA
from simspec.world.kinematics import rigid_groups
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Body, EngineValue, Shape, World

BIG = 1e308
"""Stands for infinity, which is no number in JSON."""
CONFIG = (
    *("compliance_type", "hydroelastic_modulus", "resolution_hint", "slab_thickness", "margin", "dynamic_friction"),
    *("static_friction", "hunt_crossley_dissipation", "relaxation_time", "point_stiffness"),
)


def finite(values: Any) -> tuple[float, ...]:
    """Numbers with ``BIG`` for infinity."""
    return tuple(max(-BIG, min(BIG, float(value))) for value in values)


def inventory(sim: Simulation) -> dict[str, EngineValue]:
    """Everything else that is held, by name."""
    found = of_plant(sim.built.drake, sim.plant, sim.built.scene)
    found["stiction_tolerance"] = sim.settings["stiction_tolerance"]
    found |= sidecar_labels(sim.sidecar)
    found["sidecar.bodies"] = listed([told_name(body)[1] for body in sim.built.bodies])
    every = [sim.plant.get_input_port(index) for index in range(sim.plant.num_input_ports())]
    found["ports"] = listed([port.get_name() for port in every if port.HasValue(sim.context)])
    found["port.actuation"] = bool(sim.plant.get_actuation_input_port().HasValue(sim.context))
    found["port.wrenches"] = bool(sim.plant.get_applied_spatial_force_input_port().HasValue(sim.context))
    groups: dict[str, dict[str, Any]] = {}
    for index, held in enumerate(sim.built.bodies):
        found |= _body(sim, index, held)
        for (shape, layer), parts in geometries_of(sim, held).items():
            groups[f"{shape}.{layer}"] = parts
            found |= _surface(sim, f"{shape}.{layer}", parts)
    return found | _filter(sim, groups)


def neutral(sim: Simulation) -> dict[str, EngineValue]:
    """What an empty plant of Drake's holds."""
    drake = sim.built.drake
    builder = drake.framework.DiagramBuilder()  # owns both
    plant, scene = drake.plant.AddMultibodyPlantSceneGraph(builder, drake.plant.MultibodyPlant(sim.timestep))
    plant.Finalize()
    return of_plant(drake, plant, scene)


def of_plant(drake: Any, plant: Any, scene: Any) -> dict[str, EngineValue]:
    """A plant's own numbers."""
    update = plant.GetUniquePeriodicDiscreteUpdateAttribute()
    frames = [plant.get_frame(drake.tree.FrameIndex(index)) for index in range(plant.num_frames())]
    found: dict[str, EngineValue] = {
        "contact.model": plant.get_contact_model().name,
        "contact.approximation": plant.get_discrete_contact_approximation().name,
        "contact.solver": plant.get_discrete_contact_solver().name,
        "contact.near_rigid_threshold": plant.get_sap_near_rigid_threshold(),
        "contact.representation": plant.get_contact_surface_representation().name,
        "contact.adjacent_filter": plant.get_adjacent_bodies_collision_filters(),
        "sampled_outputs": plant.has_sampled_output_ports(),
        "update.period": "none" if update is None else update.period_sec(),
        "update.offset": "none" if update is None else update.offset_sec(),
        "count.continuous_states": plant.num_continuous_states(),
        "count.abstract_states": plant.num_abstract_states(),
        "count.deformable_bodies": plant.deformable_model().num_bodies(),
        "scene.sources": scene.model_inspector().num_sources(),
        "scene.deformable_geometries": len(scene.model_inspector().GetAllDeformableGeometryIds()),
        "scene.renderers": scene.RendererCount(),
        "count.bodies": plant.num_bodies() - 1,
        "count.joints": plant.num_joints(),
        "count.actuators": plant.num_actuators(),
        "count.force_elements": plant.num_force_elements(),
        "count.constraints": plant.num_constraints(),
        "count.frames": sum(not (one.is_body_frame() or one.is_ephemeral()) for one in frames),
        "count.geometries": plant.num_collision_geometries(),
        "count.models": plant.num_model_instances() - 2,
    }
    defaults = scene.get_config().default_proximity_properties
    for name in CONFIG:
        value = getattr(defaults, name)
        found[f"scene.{name}"] = "none" if value is None else value
    return found


def _body(sim: Simulation, index: int, held: Any) -> dict[str, EngineValue]:
    joint, (model, name) = joint_of(sim, index), told_name(held)
    found: dict[str, EngineValue] = {
        "model": model,
        "instance": sim.plant.GetModelInstanceName(held.model_instance()),
        "gravity": sim.plant.is_gravity_enabled(held.model_instance()),
        "joint": sim.document.bodies[index].joint.name,
        "joint.own_name": "" if joint.is_ephemeral() else joint.name(),
        "joint.locked": joint.is_locked(sim.context),
        "joint.damping": tuple(map(float, joint.GetDampingVector(sim.context))),
        "joint.position_limits": finite((*joint.position_lower_limits(), *joint.position_upper_limits())),
        "joint.velocity_limits": finite((*joint.velocity_lower_limits(), *joint.velocity_upper_limits())),
        "joint.acceleration_limits": finite((*joint.acceleration_lower_limits(), *joint.acceleration_upper_limits())),
        "shapes": tuple(dict.fromkeys(shape for shape, _ in geometries_of(sim, held))),
        "seen": tuple(seen_of(sim, held)),
    }
    actuator = actuator_of(sim, joint)
    if actuator is not None:
        found |= {
            "actuator": actuator.name(),
            "actuator.gear": float(actuator.gear_ratio(sim.context)),
            "actuator.rotor": float(actuator.rotor_inertia(sim.context)),
            "actuator.effort_limit": finite((actuator.effort_limit(),)),
            "actuator.controller": actuator.has_controller(),
        }
    servo = sim.servos.get(int(joint.index()))
    if servo is not None:
        found |= {
            "servo": servo.name(),
            "servo.gear": float(servo.gear_ratio(sim.context)),
            "servo.rotor": float(servo.rotor_inertia(sim.context)),
            "servo.controller": servo.has_controller(),
        }
    if sim.plant.IsAnchored(held):
        mass = inertial(sim, held)
        found |= {"mass": mass.mass, "centre_of_mass": mass.centre_of_mass, "inertia": mass.inertia}
    return {f"body.{name}.{field}": value for field, value in found.items()}


def _surface(sim: Simulation, name: str, parts: dict[str, Any]) -> dict[str, EngineValue]:
    """The numbers of a copy of a shape, which its corners have too, and where these are."""
    inspector = sim.query().inspector()
    numbers: dict[str, dict[str, float | str]] = {part: {**surface(sim, one)} for part, one in parts.items()}
    for part, one in parts.items():
        # Python cannot read the compliance type: the mesh that was made of it tells, which planes do not have
        numbers[part]["hydroelastic_mesh"] = type(inspector.maybe_get_hydroelastic_mesh(one)).__name__
    found: dict[str, EngineValue] = {
        f"surface.{name}.{key}": tuple(held[key] for held in numbers.values()) for key in numbers[SHAPE]
    }
    found[f"surface.{name}.parts"] = tuple(parts)
    found[f"surface.{name}.properties"] = named_set({word for one in parts.values() for word in properties(sim, one)})
    reach = reach_of(inspector.GetPoseInFrame(parts[SHAPE]).translation().tolist())
    for part, one in parts.items():
        if part != SHAPE:
            kind, size = kind_and_size(sim, one)
            found[f"surface.{name}.{part}"] = (
                kind,
                *held_at(inspector.GetPoseInFrame(one).translation().tolist()),
                *size,
                reach,
            )
    return found


def _filter(sim: Simulation, groups: dict[str, dict[str, Any]]) -> dict[str, EngineValue]:
    """For every copy of a shape the others that it does not touch, itself not counted; and whether its corners are kept from
    touching the same, each other, and what its faces touch by hydroelastic contact."""
    filtered = sim.query().inspector().CollisionFiltered
    apart: dict[str, set[str]] = {name: set() for name in groups}
    for (one, parts), (other, others) in itertools.combinations(groups.items(), 2):
        if filtered(parts[SHAPE], others[SHAPE]):
            apart[one].add(other)
            apart[other].add(one)
    found: dict[str, EngineValue] = {f"apart.{name}": named_set(names) for name, names in apart.items()}
    small = [(name, part, one) for name, parts in groups.items() for part, one in parts.items() if part != SHAPE]
    by_pressure = {name for name, parts in groups.items() if _by_pressure(sim, parts[SHAPE])}
    odd = [
        f"{name}.{part} {other}"
        for name, part, one in small
        for other, parts in groups.items()
        if filtered(one, parts[SHAPE]) != (other in apart[name] or other == name or {name, other} <= by_pressure)
    ]
    odd += [
        f"{a}.{part} {b}.{other}"
        for (a, part, one), (b, other, two) in itertools.combinations(small, 2)
        if not filtered(one, two)
    ]
    return found | {"apart.corners": len(small), "apart.odd_corners": listed(odd)}


def _by_pressure(sim: Simulation, geometry: Any) -> bool:
    """Whether a shape touches others of its sort by hydroelastic contact."""
    kind, _ = SIZES[type(sim.query().inspector().GetShape(geometry)).__name__]
    return kind in FACED and sim.plant.get_contact_model().name == "kHydroelasticWithFallback"


# What Drake's inventory must be (``inventory.py``), from the world and the settings that follow from it alone.
#
# Runs outside the engine's process, without Drake.

APPROXIMATIONS = {"sap": "kSap", "tamsi": "kTamsi"}
PROPERTIES = {
    "material.coulomb_friction",
    "material.hunt_crossley_dissipation",
    "material.point_contact_stiffness",
    "material.relaxation_time",
    # which the scene's defaults add to every geometry; point contact does not use them
    "hydroelastic.compliance_type",
    "hydroelastic.hydroelastic_modulus",
    "hydroelastic.resolution_hint",
}
"""What is said of every collision geometry."""
Settings = Mapping[str, bool | int | float | str]
Gains = Mapping[str, bool]
"""By natively driven joint, whether its controller has any gains."""


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """What the inventory must be under the ``settings`` that follow from ``world``; ``neutral`` are Drake's own values."""
    groups = rigid_groups(world)
    moved, _ = recentre_free_roots(world)
    found = dict(neutral)
    chosen = str(settings["contact_approximation"])
    turned = sum(body.joint.kind != "free" for body in world.bodies)
    balls = sum(body.joint.kind == "ball" for body in world.bodies)
    gains = {
        joint: bool(kp or kd)
        for one in natives(world)
        for joint, kp, kd in zip(one.joints, one.kp, one.kd, strict=True)
    }
    found |= {
        "contact.model": "kHydroelasticWithFallback" if hydroelastic(settings) else "kPoint",
        "contact.approximation": APPROXIMATIONS[chosen],
        "contact.solver": APPROXIMATIONS[chosen],
        "contact.near_rigid_threshold": 0.0,
        "contact.adjacent_filter": False,
        "sampled_outputs": False,
        "update.period": world.physics.timestep,
        "update.offset": 0.0,
        "count.abstract_states": 0,
        "ports": listed(["geometry_query", "applied_generalized_force"]),
        "stiction_tolerance": settings["stiction_tolerance"],
        "sidecar.bodies": listed([body.name for body in world.bodies]),
        "port.actuation": False,
        "port.wrenches": False,
        "count.bodies": len(world.bodies),
        "count.joints": len(world.bodies),
        "count.actuators": sum(_limited(body, gains) for body in world.bodies) + len(gains),
        "count.force_elements": 1,
        "count.constraints": 0,
        "count.frames": turned + balls,
        "count.models": 0,
    }
    carriers, count, small = [], 0, 0
    for body in moved.bodies:
        found |= _body_expected(body, groups[body.name] == "world", gains) | _servo(body, gains)
        for shape in solid_shapes(body):
            balls_of = corners(shape.kind, shape.size)
            for layer in plan.layers(shape.material):
                name = f"{shape.name}.{layer}"
                carriers.append(Carrier(name, body.name, shape.material, layer))
                friction = float(plan.numbers[shape.material, layer].friction or 0.0)
                found |= _surface_expected(name, shape, balls_of, friction, settings, world.physics.timestep)
                by_pressure = hydroelastic(settings) and shape.kind in FACED
                still = groups[body.name] == "world"
                found |= _pressure(name, shape, len(balls_of), by_pressure, still, settings, neutral)
                count, small = count + 1 + len(balls_of), small + len(balls_of)
    found["count.geometries"] = count
    found |= {"apart.corners": small, "apart.odd_corners": ""}
    return found | expected_apart(world, plan, carriers)


def _limited(body: Body, gains: Gains) -> bool:
    """Whether the joint has an actuator beside that of a controller, which then has the armature."""
    return body.joint.effort_limit is not None or (bool(body.joint.armature) and body.joint.name not in gains)


def _body_expected(body: Body, still: bool, gains: Gains) -> dict[str, EngineValue]:
    joint = body.joint
    q, v = POSITION_SIZE[joint.kind], VELOCITY_SIZE[joint.kind]
    q -= joint.kind == "ball"
    lower, upper = joint.position_limits or (-math.inf, math.inf)
    speed = math.inf if joint.velocity_limit is None else joint.velocity_limit
    # planes are on the world's own body, and told last
    told = sorted(body.shapes, key=lambda shape: shape.kind == "plane" and shape.collision)
    found: dict[str, EngineValue] = {
        "instance": "DefaultModelInstance",
        "model": body.model,
        "gravity": True,
        "joint": joint.name,
        "joint.own_name": "" if joint.kind == "free" else joint.name,
        "joint.locked": False,
        "joint.damping": (0.0,) * v,
        "joint.position_limits": finite((lower,) * q + (upper,) * q),
        "joint.velocity_limits": finite((-speed,) * v + (speed,) * v),
        "joint.acceleration_limits": finite((-math.inf,) * v + (math.inf,) * v),
        "shapes": tuple(shape.name for shape in told if shape.collision),
        "seen": tuple(shape.name for shape in told if shape.visual),
    }
    if _limited(body, gains):
        effort = math.inf if joint.effort_limit is None else joint.effort_limit
        found |= {
            "actuator": f"actuator.{joint.name}",
            "actuator.gear": 1.0,
            "actuator.rotor": 0.0 if joint.name in gains else joint.armature,
            "actuator.effort_limit": finite((effort,)),
            "actuator.controller": False,
        }
    if still:
        mass = body.inertial if body.inertial.mass else NO_INERTIA
        found |= {"mass": mass.mass, "centre_of_mass": mass.centre_of_mass, "inertia": mass.inertia}
    return {f"body.{body.name}.{field}": value for field, value in found.items()}


def _servo(body: Body, gains: Gains) -> dict[str, EngineValue]:
    """The actuator of a natively driven joint. Drake has no controller without gains."""
    name = body.joint.name
    if name not in gains:
        return {}
    held: dict[str, EngineValue] = {
        "": f"servo.{name}",
        ".gear": 1.0,
        ".rotor": body.joint.armature,
        ".controller": gains[name],
    }
    return {f"body.{body.name}.servo{field}": value for field, value in held.items()}


def _surface_expected(
    name: str, shape: Shape, balls: Sequence[Part], friction: float, settings: Settings, timestep: float
) -> dict[str, EngineValue]:
    numbers = {
        "static_friction": friction,
        "dynamic_friction": friction,
        "point_contact_stiffness": float(settings["stiffness"]),
        "hunt_crossley_dissipation": float(settings["dissipation"]),
        "relaxation_time": 0.5 * timestep * (1.0 - ERROR_REDUCTION) / ERROR_REDUCTION,
    }
    parts = ("shape", *(f"corner{index}" for index in range(len(balls))))
    found: dict[str, EngineValue] = {f"surface.{name}.{key}": (value,) * len(parts) for key, value in numbers.items()}
    found[f"surface.{name}.parts"] = parts
    found[f"surface.{name}.properties"] = named_set(PROPERTIES)
    for index, (kind, size, centre) in enumerate(balls):
        place = frames.add(shape.pose.position, frames.rotate(shape.pose.quaternion, centre))
        found[f"surface.{name}.corner{index}"] = (kind, *held_at(place), *size, reach_of(shape.pose.position))
    return found


def _pressure(
    name: str,
    shape: Shape,
    balls: int,
    by_pressure: bool,
    still: bool,
    settings: Settings,
    neutral: Mapping[str, EngineValue],
) -> dict[str, EngineValue]:
    """The numbers of hydroelastic contact: Drake's own in the corners and in shapes without it. Planes have no mesh."""
    modulus, hint = (float(neutral[f"scene.{word}"]) for word in ("hydroelastic_modulus", "resolution_hint"))  # type: ignore[arg-type]
    mesh = "NoneType"
    first = modulus, hint, mesh
    if by_pressure:
        solid = "TriangleSurfaceMesh" if still else "VolumeMesh"
        own = modulus if still else float(settings["hydroelastic_modulus"])
        first = own, ANY_RESOLUTION, mesh if shape.kind == "plane" else solid
    words = ("hydroelastic_modulus", "resolution_hint", "hydroelastic_mesh")
    columns = zip(first, *[(modulus, hint, mesh)] * balls, strict=True)
    return {f"surface.{name}.{word}": column for word, column in zip(words, columns, strict=True)}
