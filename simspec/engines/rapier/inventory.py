"""Everything that Rapier holds beside the fields of the read-back, and that can act; what it must be says ``expected.py``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from simspec.contact.plan import ContactPlan
from simspec.engines.kit.inventory import Carrier, expected_apart, named_set
from simspec.engines.kit.labels import sidecar_labels
from simspec.engines.rapier.building import SCALE
from simspec.engines.rapier.readback import inertial, kind_of
from simspec.engines.rapier.simulation import Simulation
from simspec.world.contact_pairs import excluded_pairs, meeting_laws, solid_shapes
from simspec.world.inertia import NO_INERTIA
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, EngineValue, PairContact, World

NUMBERS = (
    *("min_ccd_dt", "warmstart_coefficient", "length_unit", "normalized_allowed_linear_error"),
    *("num_solver_iterations", "num_internal_pgs_iterations", "num_internal_stabilization_iterations"),
    *("contact_clustering", "contact_recycling", "normalized_contact_recycle_distance", "max_ccd_substeps"),
    *("friction_in_bias_pass", "warmstart_joints"),
)
LENGTHS = ("normalized_max_corrective_velocity", "normalized_prediction_distance", "normalized_max_linear_velocity")
"""Parameters of the integration, beside the timestep and those that are read apart; the latter in m and m/s."""
APART = ("dt", "friction_model", "contact_softness", "static_contact_softness", "soft_bodies")
BODY = (
    *("gravity_scale", "linear_damping", "angular_damping", "dominance_group", "additional_solver_iterations"),
    *("additional_pgs_iterations", "is_enabled", "ccd_enabled", "soft_ccd_prediction", "allow_fast_rotation"),
    *("gyroscopic_forces_enabled", "is_soft_frame", "user_data"),
)
"""The same of a body."""
COLLIDER = (
    *("density", "friction", "restitution", "is_sensor", "is_enabled", "contact_skin", "user_data"),
    "contact_force_event_threshold",
)
"""The same of a collider."""
WORDS = ("friction_combine_rule", "restitution_combine_rule", "active_events", "active_hooks", "active_collision_types")
GROUPS = ("collision_groups", "solver_groups")


def inventory(sim: Simulation) -> dict[str, EngineValue]:
    """Everything else that is held, by name."""
    world = sim.world
    found: dict[str, EngineValue] = {**sidecar_labels(sim.sidecar), **_world(world)}
    number = {handle: index for index, handle in enumerate(sim.built.colliders)}
    for row, body in enumerate(sim.document.bodies):
        own = sim.built.carrier[row] in (-1, row)
        found |= {f"body.{body.name}.model": body.model, f"body.{body.name}.joint": body.joint.name}
        found[f"body.{body.name}.held"] = own
        found[f"body.{body.name}.shapes"] = tuple(shape.name for shape in body.shapes)
        if own:
            held = world.rigid_bodies[sim.built.bodies[row]]
            found |= {f"body.{body.name}.{name}": value for name, value in of_body(held).items()}
            told = " ".join(sorted(sim.built.shapes[number[handle]][1] for handle in held.colliders))
            found[f"body.{body.name}.colliders"] = told
        if sim.built.carrier[row] < 0:
            mass = inertial(sim, row)
            found[f"body.{body.name}.mass"] = mass.mass
            found[f"body.{body.name}.centre_of_mass"] = mass.centre_of_mass
            found[f"body.{body.name}.inertia"] = mass.inertia
    for handle, (row, name) in zip(sim.built.colliders, sim.built.shapes, strict=True):
        collider = world.colliders[handle]
        found |= {f"shape.{name}.{key}": value for key, value in of_collider(collider).items()}
        found[f"shape.{name}.of"] = sim.names[row]
    return found | _filter(sim)


def _world(world: Any) -> dict[str, EngineValue]:
    held = world.integration_parameters
    found: dict[str, EngineValue] = {f"parameters.{name}": getattr(held, name) for name in NUMBERS}
    found |= {f"parameters.{name}": getattr(held, name) / SCALE for name in LENGTHS}
    found["parameters.friction_model"] = word(held.friction_model)
    for name in ("contact_softness", "static_contact_softness"):
        soft = getattr(held, name)
        found[f"parameters.{name}"] = (soft.natural_frequency, soft.damping_ratio)
    counts = {
        "bodies": len(world.rigid_bodies),
        "colliders": len(world.colliders),
        "impulse_joints": len(world.impulse_joints),
        "multibody_joints": len(world.multibody_joints),
        "soft_bodies": len(world.soft_bodies),
    }
    found |= {f"count.{name}": count for name, count in counts.items()}
    found["threads"] = world.num_threads
    return found


def of_body(body: Any) -> dict[str, EngineValue]:
    """Of one of Rapier's bodies."""
    found: dict[str, EngineValue] = {name: getattr(body, name) for name in BODY}
    found["type"] = word(body.body_type)
    found["locked_axes"] = tuple(float(free) for free in (*body.enabled_translations, *body.enabled_rotations))
    found["sleeps"] = bool(body.is_sleeping) or body.activation.linear_threshold >= 0.0
    return found


def of_collider(collider: Any) -> dict[str, EngineValue]:
    """Of one of Rapier's colliders."""
    found: dict[str, EngineValue] = {name: getattr(collider, name) for name in COLLIDER}
    found |= {name: word(getattr(collider, name)) for name in WORDS}
    for name in GROUPS:
        held = getattr(collider, name)
        found[name] = f"{held.memberships.bits:x} {held.filter.bits:x} {word(held.test_mode)}"
    found["kind"] = kind_of(collider)
    return found


def word(value: Any) -> str:
    """One of Rapier's own values, as it prints it without its class."""
    text = str(value)
    return text.rpartition(".")[2] if "(" not in text else text


def neutral(sim: Simulation) -> dict[str, EngineValue]:
    """What an empty world, a bare body of each type and a bare collider hold."""
    rapier = sim.rapier
    world = rapier.PhysicsWorld()
    found: dict[str, EngineValue] = {f"world.{name}": value for name, value in _world(world).items()}
    for name, builder in (("fixed", rapier.RigidBody.fixed()), ("dynamic", rapier.RigidBody.dynamic())):
        held = world.rigid_bodies[world.add_body(builder)]
        found |= {f"{name}.{key}": value for key, value in of_body(held).items()}
    collider = world.colliders[world.add_collider(rapier.Collider.ball(1.0))]
    return found | {f"collider.{key}": value for key, value in of_collider(collider).items()}


def _filter(sim: Simulation) -> dict[str, EngineValue]:
    """For every shape the others that it does not touch, itself not counted: as the hook answers, asked or not."""
    held = sim.built.laws
    names = [f"{name}.0" for _, name in sim.built.shapes]  # as carriers are called: in one layer
    return {
        f"apart.{name}": named_set(
            other for column, other in enumerate(names) if column != row and held.apart(row, column)
        )
        for row, name in enumerate(names)
    }


# What Rapier's inventory must be (``inventory.py``), from the world and the settings that follow from it alone.
#
# Runs outside the engine's process, without Rapier.

Settings = Mapping[str, bool | int | float | str]
FILTER, MODIFY = 0b1, 0b100
"""Bits of Rapier's flags of hooks."""
RIGID, SHARE = 1000.0, 0.01
"""ω dt of contacts, and the share of an overlap that a step takes away."""


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """What the inventory must be under the ``settings`` that follow from ``world``; ``neutral`` are Rapier's own values."""
    found = _of("world", neutral)
    frequency = RIGID / (2.0 * math.pi * world.physics.timestep)
    softness = (frequency, 0.5 * RIGID * (1.0 - SHARE) / SHARE)
    found |= {
        "parameters.num_solver_iterations": 1,
        "parameters.num_internal_pgs_iterations": settings["iterations"],
        "parameters.num_internal_stabilization_iterations": 0,
        "parameters.friction_model": "SIMPLIFIED",
        "parameters.contact_softness": softness,
        "parameters.static_contact_softness": softness,
        "parameters.normalized_allowed_linear_error": 0.0,
        "parameters.normalized_prediction_distance": 1e-6,
        "parameters.normalized_max_corrective_velocity": 1e6,
        "parameters.normalized_max_linear_velocity": 1e6,
        "parameters.contact_recycling": False,
        "parameters.contact_clustering": False,
        "parameters.warmstart_coefficient": 1.0,
        "threads": 1,
    }
    groups = rigid_groups(world)
    carriers, colliders = [], 0
    asked = _asked(world)
    one_law = _one_law(world)
    owns: dict[str, list[str]] = {}
    for body in world.bodies:
        for shape in solid_shapes(body):
            owner = body.name if groups[body.name] == "world" else groups[body.name]
            owns.setdefault(owner, []).append(shape.name)
    for body in world.bodies:
        still = groups[body.name] == "world"
        held = still or body.joint.kind == "free"
        at = f"body.{body.name}"
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": held}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if held:
            own = _of("fixed" if still else "dynamic", neutral)
            if not still:
                own |= {"gyroscopic_forces_enabled": False, "allow_fast_rotation": True, "sleeps": False}
            else:
                # Rapier keeps no moments without a mass; those of a fixed body have no effect
                mass = body.inertial if body.inertial.mass else NO_INERTIA
                own |= {"mass": mass.mass, "centre_of_mass": mass.centre_of_mass, "inertia": mass.inertia}
            own["colliders"] = " ".join(sorted(owns.get(body.name, ())))
            found |= {f"{at}.{name}": value for name, value in own.items()}
        for shape in solid_shapes(body):
            carriers.append(Carrier(f"{shape.name}.0", body.name, shape.material, 0))
            found |= {f"shape.{shape.name}.{name}": value for name, value in _of("collider", neutral).items()}
            flags = (0 if one_law else MODIFY) | (FILTER if asked(body, shape.material) else 0)
            found |= {
                f"shape.{shape.name}.kind": shape.kind,
                f"shape.{shape.name}.of": body.name,
                f"shape.{shape.name}.density": 0.0,
                f"shape.{shape.name}.user_data": colliders,
                f"shape.{shape.name}.friction": one_law.friction if one_law else 0.0,
                f"shape.{shape.name}.restitution": one_law.restitution if one_law else 0.0,
                f"shape.{shape.name}.active_hooks": f"ActiveHooks(bits=0b{flags:08b})",
            }
            colliders += 1
    found["count.bodies"] = sum(bool(found[f"body.{body.name}.held"]) for body in world.bodies)
    found["count.colliders"] = colliders
    return found | expected_apart(world, plan, carriers)


def _of(owner: str, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
    return {name.removeprefix(f"{owner}."): value for name, value in neutral.items() if name.startswith(f"{owner}.")}


def _used(world: World) -> set[str]:
    return {shape.material for body in world.bodies for shape in solid_shapes(body)}


def _one_law(world: World) -> PairContact | None:
    """The law of all that meets, where there is one and nothing bounces."""
    used = _used(world)
    laws = [law for pair, law in meeting_laws(world).items() if set(pair) <= used]
    numbers = {(law.friction, law.restitution) for law in laws}
    asked = any(law.restitution_threshold or law.restitution for law in laws)
    return laws[0] if len(numbers) == 1 and not asked else None


def _asked(world: World) -> Callable[[Body, str], bool]:
    """Whether Rapier must ask before a shape of a body and a material touches another: of a material that some pass through, of
    a group that another ignores, or of a body that must not touch one."""
    meets, used = set(meeting_laws(world)), _used(world)
    meets |= {(other, one) for one, other in meets}
    passed = {one for one in used for other in used if (one, other) not in meets}
    groups = {one.collision_group for one in world.bodies if solid_shapes(one)}
    ignored = {name for pair in world.contact.ignored_groups if set(pair) <= groups for name in pair}
    excluded = {name for pair in excluded_pairs(world) for name in pair}
    return lambda body, material: material in passed or body.collision_group in ignored or body.name in excluded
