"""The model as Rapier stores it, in the world's frames and order.

Masses, poses, shapes, gravity and the timestep are queried. The joints, the poses of bodies that are parts of others, visual
shapes and the laws of materials are those that Rapier was built from.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from simspec.contact import ContactPlan
from simspec.engines.kit.inventory import (
    NEUTRAL,
    FilterCarrier,
    Items,
    below,
    expected_separate,
    named_set,
    sidecar_labels,
)
from simspec.engines.kit.world_simulation import visual_shape
from simspec.engines.rapier.building import AXES, SCALE
from simspec.engines.rapier.simulation import RapierSimulation, inertia_of, pose_of
from simspec.world import frames
from simspec.world.contact_pairs import excluded_pairs, meeting_laws, solid_shapes
from simspec.world.inertia import NO_INERTIA
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, EngineValue, Inertial, PairContact, ReadBack, Shape, Surface, World

KINDS = {
    "BALL": "sphere",
    "CUBOID": "box",
    "CAPSULE": "capsule",
    "CYLINDER": "cylinder",
    "HALFSPACE": "plane",
    "CONVEX_POLYHEDRON": "mesh",
}
"""Rapier's names of types of shapes."""


def read_back(sim: RapierSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as Rapier stores it, and its present state."""
    solid = {(shape.owner.row, shape.place): shape.number for shape in sim.walk.shapes}
    bodies = [
        Body(
            body.name,
            body.model,
            inertial(sim, row),
            joint,
            tuple(
                visual_shape(shape) if (row, place) not in solid else _shape(sim, solid[row, place])
                for place, shape in enumerate(body.shapes)
            ),
        )
        for row, (body, joint) in enumerate(zip(sim.document.bodies, sim.joints(), strict=True))
    ]
    x, y, z = (value / SCALE for value in sim.world.gravity)
    timestep = float(sim.world.integration_parameters.dt)
    return sim.model(bodies, (x, y, z), timestep, unreadable, laws=laws(sim))


def inertial(sim: RapierSimulation, row: int) -> Inertial:
    """The mass properties of a body; nothing of a part of another body."""
    if sim.walk.bodies[row].carrier not in (-1, row):
        return NO_INERTIA
    body = sim.world.rigid_bodies[sim.built.bodies[row]]
    mass = body.mass_properties
    if not mass.mass:
        return NO_INERTIA
    m = inertia_of(body)
    x, y, z = (value / SCALE for value in mass.local_com)
    return Inertial(mass.mass, (x, y, z), (m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))


def _shape(sim: RapierSimulation, number: int) -> Shape:
    """A collision shape as Rapier stores it, with the visual part of the file."""
    solid, collider = sim.walk.shapes[number], sim.world.colliders[sim.built.colliders[number]]
    kind, pose = kind_of(collider), pose_of(collider.position_wrt_parent)
    if kind in AXES:
        pose = frames.compose(pose, frames.inverse(AXES[kind]))
    if solid.owner.moves:
        pose = frames.compose(frames.inverse(solid.owner.pose), pose)
    visual, size = visual_shape(solid.shape), size_of(collider, kind)
    return dataclasses.replace(visual, kind=kind, size=size, pose=pose, collision=True, surfaces=(Surface(),))


def kind_of(collider: Any) -> str:
    """The kind of a collider's shape by the world's name; Rapier's name of a kind that the world does not have."""
    name = str(collider.shape.shape_type).rpartition(".")[2]
    return KINDS.get(name, name)


def size_of(collider: Any, kind: str) -> tuple[float, ...]:
    """The size of a collider's shape as the world has it."""
    shape = collider.shape
    match kind:
        case "sphere":
            return (float(shape.as_ball().radius) / SCALE,)
        case "box":
            return tuple(2.0 * edge / SCALE for edge in shape.as_cuboid().half_extents)
        case "capsule" | "cylinder":
            round_shape = shape.as_capsule() if kind == "capsule" else shape.as_cylinder()
            return (float(round_shape.radius) / SCALE, 2.0 * float(round_shape.half_height) / SCALE)
        case "mesh":
            return tuple((shape.as_convex_polyhedron().points.astype(float) / SCALE).ravel().tolist())
    return ()


def laws(sim: RapierSimulation) -> tuple[PairContact, ...]:
    """The table of laws; the numbers of a uniform law are the means of those of the colliders, as Rapier combines them."""
    hook = sim.built.laws
    found = {pair: row for pair, row in hook.table.items() if pair[0] <= pair[1]}
    if hook.uniform is not None and hook.colliders:
        colliders = {
            name: sim.world.colliders[collider] for name, collider in zip(hook.materials, hook.colliders, strict=True)
        }
        for pair in found:
            if set(pair) <= set(colliders):
                entry, other = (colliders[name] for name in pair)
                friction, restitution = entry.friction + other.friction, entry.restitution + other.restitution
                found[pair] = (0.5 * friction, 0.5 * restitution, 0.0)
    return tuple(
        PairContact(name, other, friction, restitution, restitution_threshold=threshold)
        for (name, other), (friction, restitution, threshold) in sorted(found.items())
    )


# The values that Rapier stores besides the fields of the read-back, and that can act, and what they must be.
#
# ``expected`` runs without Rapier; it repeats the numbers of ``building.py`` on purpose.

Settings = Mapping[str, bool | int | float | str]
SEPARATE = ("dt", "soft_bodies")
"""Parameters of the integration that are a field of the read-back, or counted."""


def word(value: Any) -> str:
    """One of Rapier's constants as it prints, without its class."""
    text = str(value)
    return text.rpartition(".")[2] if "(" not in text else text


class Parameters(NamedTuple):
    """A world and its settings, from which the parameters follow."""

    world: World
    settings: Settings


def _softness(of: Parameters) -> tuple[float, float]:
    """ω/2π and the damping ratio with which ω dt is 1000, and a step takes back 0.01 of an overlap."""
    return (1000.0 / (2.0 * math.pi * of.world.physics.timestep), 0.5 * 1000.0 * (1.0 - 0.01) / 0.01)


def _spring(parameters: Any, name: str) -> tuple[float, float]:
    softness = getattr(parameters, name)
    return (softness.natural_frequency, softness.damping_ratio)


PARAMETERS = (
    Items[Any, Parameters].named(
        getattr,
        {
            **dict.fromkeys(("min_ccd_dt", "length_unit", "normalized_contact_recycle_distance"), NEUTRAL),
            **dict.fromkeys(("max_ccd_substeps", "friction_in_bias_pass", "warmstart_joints"), NEUTRAL),
            "num_solver_iterations": 1,
            "num_internal_pgs_iterations": lambda of: of.settings["iterations"],
            "num_internal_stabilization_iterations": 0,
            "normalized_allowed_linear_error": 0.0,
            "contact_recycling": False,
            "contact_clustering": False,
            "warmstart_coefficient": 1.0,
        },
    )
    | Items[Any, Parameters].named(
        lambda parameters, name: getattr(parameters, name) / SCALE,
        {
            "normalized_prediction_distance": 1e-6,
            "normalized_max_corrective_velocity": 1e6,
            "normalized_max_linear_velocity": 1e6,
        },
    )
    | Items[Any, Parameters].named(_spring, {"contact_softness": _softness, "static_contact_softness": _softness})
    | Items[Any, Parameters].named(lambda of, name: word(getattr(of, name)), {"friction_model": "SIMPLIFIED"})
)
COUNTS = Items[Any, World].named(
    lambda world, name: len(getattr(world, "rigid_bodies" if name == "bodies" else name)),
    {
        "bodies": lambda world: sum(_separate(world, body) for body in world.bodies),
        "colliders": lambda world: sum(len(solid_shapes(body)) for body in world.bodies),
        **dict.fromkeys(("impulse_joints", "multibody_joints", "soft_bodies"), 0),
    },
)


BODY = Items[Any, Body].named(
    getattr,
    {
        **dict.fromkeys(("gravity_scale", "linear_damping", "angular_damping", "dominance_group"), NEUTRAL),
        **dict.fromkeys(("additional_solver_iterations", "additional_pgs_iterations", "is_enabled"), NEUTRAL),
        **dict.fromkeys(("ccd_enabled", "soft_ccd_prediction", "is_soft_frame", "user_data"), NEUTRAL),
        "allow_fast_rotation": NEUTRAL,
        "gyroscopic_forces_enabled": NEUTRAL,
    },
) | Items[Any, Body](
    {
        "type": (lambda body: word(body.body_type), NEUTRAL),
        "locked_axes": (lambda body: tuple(map(float, (*body.enabled_translations, *body.enabled_rotations))), NEUTRAL),
        "sleeps": (lambda body: bool(body.is_sleeping) or body.activation.linear_threshold >= 0.0, NEUTRAL),
    }
)
DYNAMIC: Mapping[str, EngineValue] = {"gyroscopic_forces_enabled": False, "allow_fast_rotation": True, "sleeps": False}
"""Values of bodies that move, in place of Rapier's defaults."""


class RapierSolid(NamedTuple):
    """A collision shape of the world: its number, its body, the law of all pairs where there is only one, and whether Rapier
    queries the hook for the others that it touches."""

    number: int
    body: Body
    shape: Shape
    law: PairContact | None
    filtered: bool


def _hooks(solid: RapierSolid) -> str:
    return f"ActiveHooks(bits=0b{(0 if solid.law else 0b100) | (0b1 if solid.filtered else 0):08b})"


def _groups(collider: Any, name: str) -> str:
    groups = getattr(collider, name)
    return f"{groups.memberships.bits:x} {groups.filter.bits:x} {word(groups.test_mode)}"


COLLIDER = (
    Items[Any, RapierSolid].named(
        getattr,
        {
            **dict.fromkeys(("is_sensor", "is_enabled", "contact_skin", "contact_force_event_threshold"), NEUTRAL),
            "density": 0.0,
            "user_data": lambda solid: solid.number,
            "friction": lambda solid: solid.law.friction if solid.law else 0.0,
            "restitution": lambda solid: solid.law.restitution if solid.law else 0.0,
        },
    )
    | Items[Any, RapierSolid].named(
        lambda collider, name: word(getattr(collider, name)),
        {
            **dict.fromkeys(("friction_combine_rule", "restitution_combine_rule", "active_events"), NEUTRAL),
            "active_collision_types": NEUTRAL,
            "active_hooks": _hooks,
        },
    )
    | Items[Any, RapierSolid].named(_groups, dict.fromkeys(("collision_groups", "solver_groups"), NEUTRAL))
    | Items[Any, RapierSolid]({"kind": (kind_of, lambda solid: solid.shape.kind)})
)


def _world(world: Any) -> dict[str, EngineValue]:
    parameters = PARAMETERS.read(world.integration_parameters, "parameters")
    return parameters | COUNTS.read(world, "count") | {"threads": world.num_threads}


def inventory(sim: RapierSimulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    found: dict[str, EngineValue] = {**sidecar_labels(sim.sidecar), **_world(sim.world)}
    solids = dict(zip(sim.built.colliders, sim.walk.shapes, strict=True))
    for placed, body in zip(sim.walk.bodies, sim.document.bodies, strict=True):
        at, separate = f"body.{body.name}", placed.carrier in (-1, placed.row)
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": separate}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if separate:
            rigid = sim.world.rigid_bodies[sim.built.bodies[placed.row]]
            found |= BODY.read(rigid, at)
            found[f"{at}.colliders"] = " ".join(sorted(solids[handle].shape.name for handle in rigid.colliders))
        if not placed.moves:
            mass = inertial(sim, placed.row)
            found |= {f"{at}.mass": mass.mass, f"{at}.centre_of_mass": mass.centre_of_mass}
            found[f"{at}.inertia"] = mass.inertia
    for handle, solid in solids.items():
        found |= COLLIDER.read(sim.world.colliders[handle], f"shape.{solid.shape.name}")
        found[f"shape.{solid.shape.name}.of"] = solid.owner.body.name
    names = [f"{solid.shape.name}.0" for solid in sim.walk.shapes]  # the names of carriers: all in one layer
    for row, name in enumerate(names):
        # the answers of the hook, whether Rapier calls it or not
        others = (other for column, other in enumerate(names) if column != row and sim.built.laws.excluded(row, column))
        found[f"apart.{name}"] = named_set(others)
    return found


def neutral(sim: RapierSimulation) -> dict[str, EngineValue]:
    """The values of an empty world, of a bare body of each type and of a bare collider."""
    rapier = sim.rapier
    world = rapier.PhysicsWorld()
    found: dict[str, EngineValue] = {f"world.{name}": value for name, value in _world(world).items()}
    for name, builder in (("fixed", rapier.RigidBody.fixed()), ("dynamic", rapier.RigidBody.dynamic())):
        found |= BODY.read(world.rigid_bodies[world.add_body(builder)], name)
    return found | COLLIDER.read(world.colliders[world.add_collider(rapier.Collider.ball(1.0))], "collider")


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``; ``neutral`` are Rapier's defaults."""
    defaults = below("world.parameters", neutral)
    found = PARAMETERS.expect(Parameters(world, settings), "parameters", defaults)
    found |= COUNTS.expect(world, "count") | {"threads": 1}
    groups, law = rigid_groups(world), _only_law(world)
    carriers: list[FilterCarrier] = []
    shapes_of: dict[str, list[str]] = {}
    for body in world.bodies:
        owner = body.name if groups[body.name] == "world" else groups[body.name]
        shapes_of.setdefault(owner, []).extend(shape.name for shape in solid_shapes(body))
    for body in world.bodies:
        at, static = f"body.{body.name}", groups[body.name] == "world"
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": _separate(world, body)}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if _separate(world, body):
            found |= BODY.expect(body, at, below("fixed" if static else "dynamic", neutral))
            found[f"{at}.colliders"] = " ".join(sorted(shapes_of.get(body.name, ())))
        if static:
            # Rapier stores no moments without a mass; those of a fixed body have no effect
            mass = body.inertial if body.inertial.mass else NO_INERTIA
            found |= {f"{at}.mass": mass.mass, f"{at}.centre_of_mass": mass.centre_of_mass}
            found[f"{at}.inertia"] = mass.inertia
        elif _separate(world, body):
            found |= {f"{at}.{name}": value for name, value in DYNAMIC.items()}
        for shape in solid_shapes(body):
            solid = RapierSolid(len(carriers), body, shape, law, _filtered(world, body, shape.material))
            carriers.append(FilterCarrier(f"{shape.name}.0", body.name, shape.material, 0))
            found |= COLLIDER.expect(solid, f"shape.{shape.name}", below("collider", neutral))
            found[f"shape.{shape.name}.of"] = body.name
    return found | expected_separate(world, plan, carriers)


def _separate(world: World, body: Body) -> bool:
    """Whether a body is one of Rapier's, not a part of another."""
    return rigid_groups(world)[body.name] == "world" or body.joint.kind == "free"


def _used(world: World) -> set[str]:
    return {shape.material for body in world.bodies for shape in solid_shapes(body)}


def _only_law(world: World) -> PairContact | None:
    """The law of all pairs, where there is only one and nothing bounces."""
    used = _used(world)
    laws = [law for pair, law in meeting_laws(world).items() if set(pair) <= used]
    numbers = {(law.friction, law.restitution) for law in laws}
    bounces = any(law.restitution_threshold or law.restitution for law in laws)
    return laws[0] if len(numbers) == 1 and not bounces else None


def _filtered(world: World, body: Body, material: str) -> bool:
    """Whether some shape must not touch this one: of a material that passes through this one, of a group that this ignores, or
    of an excluded body."""
    laws, used = meeting_laws(world), _used(world)
    passes = any((material, other) not in laws and (other, material) not in laws for other in used)
    groups = {body.collision_group for body in world.bodies if solid_shapes(body)}
    ignores = any(body.collision_group in pair and set(pair) <= groups for pair in world.contact.ignored_groups)
    return passes or ignores or any(body.name in pair for pair in excluded_pairs(world))
