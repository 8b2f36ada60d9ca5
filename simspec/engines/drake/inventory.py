"""The values that Drake stores besides the fields of the read-back, and that can act, and what they must be (``expected``,
which runs without Drake).

The filter of contacts is Drake's answer for every two geometries. The stiction tolerance cannot be queried: it is the one that
simspec passed to Drake.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from simspec.contact import ContactPlan
from simspec.control.reference import natives
from simspec.engines.drake.approximations import (
    ANY_RESOLUTION,
    FACED,
    Part,
    corners,
    hydroelastic,
    reach_of,
    rounded_place,
)
from simspec.engines.drake.building import ERROR_REDUCTION, SHAPE, names_of
from simspec.engines.drake.integrators import native, scheme
from simspec.engines.drake.readback import (
    SIZES,
    actuator_of,
    geometries_of,
    inertial,
    joint_of,
    kind_and_size,
    surface,
    visuals_of,
)
from simspec.engines.drake.simulation import DrakeSimulation
from simspec.engines.kit.inventory import (
    NEUTRAL,
    FilterCarrier,
    Items,
    below,
    excluded_carriers,
    expected_separate,
    finite,
    listed,
    named_set,
    sidecar_labels,
)
from simspec.formats.kit.contract import recentre_free_roots
from simspec.world import frames
from simspec.world.contact_pairs import solid_shapes
from simspec.world.inertia import NO_INERTIA
from simspec.world.kinematics import rigid_groups
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, Body, EngineValue, Inertial, Shape, World

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
"""The properties of every collision geometry."""
OF_DISCRETE = ("contact.approximation", "contact.solver", "contact.near_rigid_threshold")
"""The values that continuous plants have by default, and do not use."""
Settings = Mapping[str, bool | int | float | str]
Gains = Mapping[str, bool]
"""By natively driven joint, whether its controller has any gains."""


class EnginePlant(NamedTuple):
    drake: Any
    plant: Any
    scene: Any


class ExpectedPlant(NamedTuple):
    """A world, its settings and gains."""

    world: World
    settings: Settings
    gains: Gains

    @property
    def continuous_states(self) -> int:
        """The size of the state of a continuous plant; 0 of a discrete one."""
        if not scheme(self.settings):
            return 0
        bodies = (DrakeExpectedBody(body, self.gains) for body in self.world.bodies)
        return sum(body.positions + body.velocities for body in bodies)

    @property
    def approximation(self) -> str:
        return APPROXIMATIONS[str(self.settings["contact_approximation"])]


class EngineBody(NamedTuple):
    """Drake's body at a row, its joint, its actuator and the actuator of its controller."""

    sim: DrakeSimulation
    row: int
    body: Any
    joint: Any
    actuator: Any
    servo: Any


class DrakeExpectedBody(NamedTuple):
    body: Body
    gains: Gains
    damped: bool = False
    """Whether Drake applies the damping of joints."""

    @property
    def positions(self) -> int:
        kind = self.body.joint.kind
        return POSITION_SIZE[kind] - (kind == "ball")

    @property
    def velocities(self) -> int:
        return VELOCITY_SIZE[self.body.joint.kind]

    @property
    def driven(self) -> bool:
        return self.body.joint.name in self.gains

    @property
    def limited(self) -> bool:
        """Whether the joint has an actuator in addition to that of a controller, which then has the armature."""
        return self.body.joint.effort_limit is not None or (bool(self.body.joint.armature) and not self.driven)

    @property
    def shapes(self) -> list[Shape]:
        """The shapes in Drake's order: planes are on the world's body, and come last."""
        return sorted(self.body.shapes, key=lambda shape: shape.kind == "plane" and shape.collision)


def _finite(*values: float) -> tuple[float, ...]:
    return tuple(map(finite, values))


def _update(plant: Any, part: str) -> float | str:
    update = plant.GetUniquePeriodicDiscreteUpdateAttribute()
    return "none" if update is None else float(getattr(update, part)())


def _frames(of: EnginePlant) -> int:
    """The number of frames besides those of bodies."""
    stored = [of.plant.get_frame(of.drake.tree.FrameIndex(index)) for index in range(of.plant.num_frames())]
    return sum(not (frame.is_body_frame() or frame.is_ephemeral()) for frame in stored)


def _scene(of: EnginePlant, name: str) -> EngineValue:
    value: EngineValue | None = getattr(of.scene.get_config().default_proximity_properties, name)
    return "none" if value is None else value


PLANT = Items[EnginePlant, ExpectedPlant](
    {
        "contact.model": (
            lambda of: of.plant.get_contact_model().name,
            lambda of: "kHydroelasticWithFallback" if hydroelastic(of.settings) else "kPoint",
        ),
        "contact.approximation": (
            lambda of: of.plant.get_discrete_contact_approximation().name,
            lambda of: of.approximation,
        ),
        "contact.solver": (lambda of: of.plant.get_discrete_contact_solver().name, lambda of: of.approximation),
        "contact.near_rigid_threshold": (lambda of: of.plant.get_sap_near_rigid_threshold(), 0.0),
        "contact.representation": (lambda of: of.plant.get_contact_surface_representation().name, NEUTRAL),
        "contact.adjacent_filter": (lambda of: of.plant.get_adjacent_bodies_collision_filters(), False),
        "sampled_outputs": (lambda of: of.plant.has_sampled_output_ports(), False),
        "update.period": (
            lambda of: _update(of.plant, "period_sec"),
            lambda of: "none" if scheme(of.settings) else of.world.physics.timestep,
        ),
        "update.offset": (
            lambda of: _update(of.plant, "offset_sec"),
            lambda of: "none" if scheme(of.settings) else 0.0,
        ),
        "count.continuous_states": (lambda of: of.plant.num_continuous_states(), lambda of: of.continuous_states),
        "count.abstract_states": (lambda of: of.plant.num_abstract_states(), 0),
        "count.deformable_bodies": (lambda of: of.plant.deformable_model().num_bodies(), NEUTRAL),
        "scene.sources": (lambda of: of.scene.model_inspector().num_sources(), NEUTRAL),
        "scene.deformable_geometries": (
            lambda of: len(of.scene.model_inspector().GetAllDeformableGeometryIds()),
            NEUTRAL,
        ),
        "scene.renderers": (lambda of: of.scene.RendererCount(), NEUTRAL),
        "count.bodies": (lambda of: of.plant.num_bodies() - 1, lambda of: len(of.world.bodies)),
        "count.joints": (lambda of: of.plant.num_joints(), lambda of: len(of.world.bodies)),
        "count.actuators": (
            lambda of: of.plant.num_actuators(),
            lambda of: sum(DrakeExpectedBody(body, of.gains).limited for body in of.world.bodies) + len(of.gains),
        ),
        "count.force_elements": (lambda of: of.plant.num_force_elements(), 1),
        "count.constraints": (lambda of: of.plant.num_constraints(), 0),
        "count.frames": (
            _frames,
            lambda of: sum((body.joint.kind != "free") + (body.joint.kind == "ball") for body in of.world.bodies),
        ),
        "count.geometries": (lambda of: of.plant.num_collision_geometries(), NEUTRAL),
        "count.models": (lambda of: of.plant.num_model_instances() - 2, 0),
    }
)
SCENE = Items[EnginePlant, ExpectedPlant].named(
    _scene,
    {
        **dict.fromkeys(("compliance_type", "hydroelastic_modulus", "resolution_hint", "slab_thickness"), NEUTRAL),
        **dict.fromkeys(("margin", "dynamic_friction", "static_friction", "hunt_crossley_dissipation"), NEUTRAL),
        **dict.fromkeys(("relaxation_time", "point_stiffness"), NEUTRAL),
    },
)


def _ports(sim: DrakeSimulation) -> str:
    ports = (sim.plant.get_input_port(index) for index in range(sim.plant.num_input_ports()))
    return listed([port.get_name() for port in ports if port.HasValue(sim.context)])


SIMULATION = Items[DrakeSimulation, ExpectedPlant](
    {
        "stiction_tolerance": (
            lambda sim: sim.settings["stiction_tolerance"],
            lambda of: of.settings["stiction_tolerance"],
        ),
        "integrator": (
            lambda sim: "discrete" if sim.continuous is None else sim.continuous.described(),
            lambda of: (name, True, of.world.physics.timestep) if (name := scheme(of.settings)) else "discrete",
        ),
        "sidecar.bodies": (
            lambda sim: listed([names_of(body)[1] for body in sim.built.bodies]),
            lambda of: listed([body.name for body in of.world.bodies]),
        ),
        "ports": (_ports, listed(["geometry_query", "applied_generalized_force"])),
        "port.actuation": (lambda sim: sim.plant.get_actuation_input_port().HasValue(sim.context), False),
        "port.wrenches": (lambda sim: sim.plant.get_applied_spatial_force_input_port().HasValue(sim.context), False),
    }
)


def _limits(joint: Any, name: str) -> tuple[float, ...]:
    return _finite(*getattr(joint, f"{name}_lower_limits")(), *getattr(joint, f"{name}_upper_limits")())


def _range(lower: float, upper: float, size: int) -> tuple[float, ...]:
    return _finite(*(lower,) * size, *(upper,) * size)


def _position_range(of: DrakeExpectedBody) -> tuple[float, ...]:
    return _range(*(of.body.joint.position_limits or (-math.inf, math.inf)), of.positions)


def _speed_range(of: DrakeExpectedBody) -> tuple[float, ...]:
    speed = math.inf if of.body.joint.velocity_limit is None else of.body.joint.velocity_limit
    return _range(-speed, speed, of.velocities)


BODY = Items[EngineBody, DrakeExpectedBody](
    {
        "model": (lambda of: names_of(of.body)[0], lambda of: of.body.model),
        "instance": (
            lambda of: of.sim.plant.GetModelInstanceName(of.body.model_instance()),
            "DefaultModelInstance",
        ),
        "gravity": (lambda of: of.sim.plant.is_gravity_enabled(of.body.model_instance()), True),
        "joint": (lambda of: of.sim.document.bodies[of.row].joint.name, lambda of: of.body.joint.name),
        "joint.own_name": (
            lambda of: "" if of.joint.is_ephemeral() else of.joint.name(),
            lambda of: "" if of.body.joint.kind == "free" else of.body.joint.name,
        ),
        "joint.locked": (lambda of: of.joint.is_locked(of.sim.context), False),
        "joint.damping": (
            lambda of: tuple(map(float, of.joint.GetDampingVector(of.sim.context))),
            lambda of: (of.body.joint.damping if of.damped and of.body.joint.kind != "free" else 0.0,) * of.velocities,
        ),
        "joint.position_limits": (lambda of: _limits(of.joint, "position"), _position_range),
        "joint.velocity_limits": (lambda of: _limits(of.joint, "velocity"), _speed_range),
        "joint.acceleration_limits": (
            lambda of: _limits(of.joint, "acceleration"),
            lambda of: _range(-math.inf, math.inf, of.velocities),
        ),
        "shapes": (
            lambda of: tuple(dict.fromkeys(shape for shape, _ in geometries_of(of.sim, of.row))),
            lambda of: tuple(shape.name for shape in of.shapes if shape.collision),
        ),
        "seen": (
            lambda of: tuple(visuals_of(of.sim, of.row)),
            lambda of: tuple(shape.name for shape in of.shapes if shape.visual),
        ),
    }
)
ACTUATOR = Items[EngineBody, DrakeExpectedBody](
    {
        "actuator": (lambda of: of.actuator.name(), lambda of: f"actuator.{of.body.joint.name}"),
        "actuator.gear": (lambda of: float(of.actuator.gear_ratio(of.sim.context)), 1.0),
        "actuator.rotor": (
            lambda of: float(of.actuator.rotor_inertia(of.sim.context)),
            lambda of: 0.0 if of.driven else of.body.joint.armature,
        ),
        "actuator.effort_limit": (
            lambda of: _finite(of.actuator.effort_limit()),
            lambda of: _finite(math.inf if (effort := of.body.joint.effort_limit) is None else effort),
        ),
        "actuator.controller": (lambda of: of.actuator.has_controller(), False),
    }
)
SERVO = Items[EngineBody, DrakeExpectedBody](
    {
        "servo": (lambda of: of.servo.name(), lambda of: f"servo.{of.body.joint.name}"),
        "servo.gear": (lambda of: float(of.servo.gear_ratio(of.sim.context)), 1.0),
        "servo.rotor": (lambda of: float(of.servo.rotor_inertia(of.sim.context)), lambda of: of.body.joint.armature),
        # Drake has no controller without gains
        "servo.controller": (lambda of: of.servo.has_controller(), lambda of: of.gains[of.body.joint.name]),
    }
)
STATIC_MASS = Items[Inertial, Inertial].named(
    getattr,
    {
        "mass": lambda mass: mass.mass,
        "centre_of_mass": lambda mass: mass.centre_of_mass,
        "inertia": lambda mass: mass.inertia,
    },
)
"""Of static bodies, whose mass is not in the read-back."""


def inventory(sim: DrakeSimulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    found = _plant(EnginePlant(sim.built.drake, sim.plant, sim.built.scene))
    found |= sidecar_labels(sim.sidecar) | SIMULATION.read(sim)
    units: dict[str, dict[str, Any]] = {}
    for row, body in enumerate(sim.built.bodies):
        joint, at = joint_of(sim, row), f"body.{names_of(body)[1]}"
        of = EngineBody(sim, row, body, joint, actuator_of(sim, joint), sim.servos.get(int(joint.index())))
        found |= BODY.read(of, at)
        found |= ACTUATOR.read(of, at) if of.actuator is not None else {}
        found |= SERVO.read(of, at) if of.servo is not None else {}
        if sim.plant.IsAnchored(body):
            found |= STATIC_MASS.read(inertial(body, sim.context), at)
        for (shape, layer), parts in geometries_of(sim, row).items():
            units[f"{shape}.{layer}"] = parts
            found |= _surface(sim, f"surface.{shape}.{layer}", parts)
    return found | _filter(sim, units)


def neutral(sim: DrakeSimulation) -> dict[str, EngineValue]:
    """The values of an empty plant."""
    drake = sim.built.drake
    builder = drake.framework.DiagramBuilder()  # owns both
    plant, scene = drake.plant.AddMultibodyPlantSceneGraph(
        builder, drake.plant.MultibodyPlant(0.0 if sim.continuous else sim.timestep)
    )
    plant.Finalize()
    return _plant(EnginePlant(drake, plant, scene))


def _plant(of: EnginePlant) -> dict[str, EngineValue]:
    return PLANT.read(of) | SCENE.read(of, "scene")


def _surface(sim: DrakeSimulation, name: str, parts: dict[str, Any]) -> dict[str, EngineValue]:
    """The numbers of a copy of a shape, which its corners have too, and the places of these."""
    inspector = sim.query().inspector()
    columns: dict[str, list[float | str]] = {}
    found: dict[str, EngineValue] = {f"{name}.parts": tuple(parts)}
    properties: set[str] = set()
    reach = reach_of(inspector.GetPoseInFrame(parts[SHAPE]).translation().tolist())
    for part, geometry in parts.items():
        # Python cannot read the compliance type: the class of the mesh says it, which planes do not have
        mesh = type(inspector.maybe_get_hydroelastic_mesh(geometry)).__name__
        numbers: dict[str, float | str] = {**surface(sim, geometry), "hydroelastic_mesh": mesh}
        for key, value in numbers.items():
            columns.setdefault(key, []).append(value)
        stored = inspector.GetProximityProperties(geometry)
        groups = stored.GetGroupNames()
        properties |= {f"{group}.{word}" for group in groups for word in stored.GetPropertiesInGroup(group)}
        if part != SHAPE:
            kind, size = kind_and_size(sim, geometry)
            place = rounded_place(inspector.GetPoseInFrame(geometry).translation().tolist())
            found[f"{name}.{part}"] = (kind, *place, *size, reach)
    found |= {f"{name}.{key}": tuple(values) for key, values in columns.items()}
    return found | {f"{name}.properties": named_set(properties)}


def _filter(sim: DrakeSimulation, units: dict[str, dict[str, Any]]) -> dict[str, EngineValue]:
    """For every copy of a shape the others that it does not touch; and the corners that are not excluded from touching these,
    each other, and what their faces touch by hydroelastic contact."""
    filtered, names = sim.query().inspector().CollisionFiltered, list(units)
    shapes = [parts[SHAPE] for parts in units.values()]
    found = excluded_carriers(names, lambda index, other: bool(filtered(shapes[index], shapes[other])))
    small = [(name, part, ball) for name, parts in units.items() for part, ball in parts.items() if part != SHAPE]
    by_pressure = {name for name, shape in zip(names, shapes, strict=True) if _by_pressure(sim, shape)}
    unexpected = []
    for name, part, ball in small:
        for other, shape in zip(names, shapes, strict=True):
            excluded = name == other or {name, other} <= by_pressure or filtered(units[name][SHAPE], shape)
            if filtered(ball, shape) != excluded:
                unexpected.append(f"{name}.{part} {other}")
    for (a, part, first), (b, other, second) in itertools.combinations(small, 2):
        if not filtered(first, second):
            unexpected.append(f"{a}.{part} {b}.{other}")
    return found | {"apart.corners": len(small), "apart.odd_corners": listed(unexpected)}


def _by_pressure(sim: DrakeSimulation, geometry: Any) -> bool:
    """Whether a shape touches others of its sort by hydroelastic contact."""
    kind, _ = SIZES[type(sim.query().inspector().GetShape(geometry)).__name__]
    return kind in FACED and sim.plant.get_contact_model().name == "kHydroelasticWithFallback"


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``; ``neutral`` are Drake's defaults."""
    groups = rigid_groups(world)
    moved, _ = recentre_free_roots(world)
    gains = {
        joint: bool(kp or kd)
        for controller in natives(world)
        for joint, kp, kd in zip(controller.joints, controller.kp, controller.kd, strict=True)
    }
    of = ExpectedPlant(world, settings, gains)
    found = PLANT.expect(of, "", neutral) | SCENE.expect(of, "scene", below("scene", neutral)) | SIMULATION.expect(of)
    if scheme(settings):
        found |= {name: neutral[name] for name in OF_DISCRETE}
    carriers, small = [], 0
    for body in moved.bodies:
        at, static = f"body.{body.name}", groups[body.name] == "world"
        source = DrakeExpectedBody(body, gains, native(settings))
        found |= BODY.expect(source, at)
        found |= ACTUATOR.expect(source, at) if source.limited else {}
        found |= SERVO.expect(source, at) if source.driven else {}
        if static:
            found |= STATIC_MASS.expect(body.inertial if body.inertial.mass else NO_INERTIA, at)
        for shape in solid_shapes(body):
            balls = corners(shape.kind, shape.size)
            for layer in plan.layers(shape.material):
                carriers.append(FilterCarrier(f"{shape.name}.{layer}", body.name, shape.material, layer))
                friction = float(plan.numbers[shape.material, layer].friction or 0.0)
                name = f"surface.{shape.name}.{layer}"
                found |= _surface_expected(name, shape, balls, friction, settings, world.physics.timestep)
                found |= _pressure(name, shape, len(balls), static, settings, neutral)
                small += len(balls)
    found |= {"count.geometries": len(carriers) + small, "apart.corners": small, "apart.odd_corners": ""}
    return found | expected_separate(world, plan, carriers)


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
    found: dict[str, EngineValue] = {f"{name}.{key}": (value,) * len(parts) for key, value in numbers.items()}
    found |= {f"{name}.parts": parts, f"{name}.properties": named_set(PROPERTIES)}
    for index, (kind, size, centre) in enumerate(balls):
        place = frames.add(shape.pose.position, frames.rotate(shape.pose.quaternion, centre))
        found[f"{name}.corner{index}"] = (kind, *rounded_place(place), *size, reach_of(shape.pose.position))
    return found


def _pressure(
    name: str, shape: Shape, balls: int, static: bool, settings: Settings, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The numbers of hydroelastic contact: Drake's defaults in the corners and in shapes without it. Planes have no mesh."""
    default: dict[str, Any] = {
        "hydroelastic_modulus": neutral["scene.hydroelastic_modulus"],
        "resolution_hint": neutral["scene.resolution_hint"],
        "hydroelastic_mesh": "NoneType",
    }
    first = dict(default)
    if hydroelastic(settings) and shape.kind in FACED:
        first["resolution_hint"] = ANY_RESOLUTION
        if shape.kind != "plane":
            first["hydroelastic_mesh"] = "TriangleSurfaceMesh" if static else "VolumeMesh"
        if not static:
            first["hydroelastic_modulus"] = settings["hydroelastic_modulus"]
    return {f"{name}.{word}": (first[word], *(default[word],) * balls) for word in default}
