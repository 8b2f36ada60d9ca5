"""What Drake's inventory must be (``inventory.py``), from the world and the settings that follow from it alone.

Runs outside the engine's process, without Drake.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from simspec.contact.plan import ContactPlan
from simspec.control.native import natives
from simspec.engines.drake.building import ERROR_REDUCTION
from simspec.engines.drake.corners import ANY_RESOLUTION, FACED, Part, corners, held_at, hydroelastic, reach_of
from simspec.engines.drake.inventory import finite
from simspec.engines.kit.inventory import Carrier, expected_apart, listed, named_set
from simspec.formats.kit.passes import recentre_free_roots
from simspec.world import frames
from simspec.world.gathering import NOTHING
from simspec.world.kinematics import rigid_groups
from simspec.world.meeting import solid_shapes
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Body, EngineValue, Shape, World

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
        found |= _body(body, groups[body.name] == "world", gains) | _servo(body, gains)
        for shape in solid_shapes(body):
            balls_of = corners(shape.kind, shape.size)
            for layer in plan.layers(shape.material):
                name = f"{shape.name}.{layer}"
                carriers.append(Carrier(name, body.name, shape.material, layer))
                friction = float(plan.numbers[shape.material, layer].friction or 0.0)
                found |= _surface(name, shape, balls_of, friction, settings, world.physics.timestep)
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


def _body(body: Body, still: bool, gains: Gains) -> dict[str, EngineValue]:
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
        mass = body.inertial if body.inertial.mass else NOTHING
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


def _surface(
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
