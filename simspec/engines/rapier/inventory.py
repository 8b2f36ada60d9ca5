"""Everything that Rapier holds beside the fields of the read-back, and that can act; what it must be says ``expected.py``."""

from __future__ import annotations

from typing import Any

from simspec.engines.kit.inventory import named_set
from simspec.engines.kit.labels import sidecar_labels
from simspec.engines.rapier.readback import inertial, kind_of
from simspec.engines.rapier.simulation import Simulation
from simspec.engines.rapier.units import SCALE
from simspec.world.types import HeldValue

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


def inventory(sim: Simulation) -> dict[str, HeldValue]:
    """Everything else that is held, by name."""
    world = sim.world
    found: dict[str, HeldValue] = {**sidecar_labels(sim.sidecar), **_world(world)}
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


def _world(world: Any) -> dict[str, HeldValue]:
    held = world.integration_parameters
    found: dict[str, HeldValue] = {f"parameters.{name}": getattr(held, name) for name in NUMBERS}
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


def of_body(body: Any) -> dict[str, HeldValue]:
    """Of one of Rapier's bodies."""
    found: dict[str, HeldValue] = {name: getattr(body, name) for name in BODY}
    found["type"] = word(body.body_type)
    found["locked_axes"] = tuple(float(free) for free in (*body.enabled_translations, *body.enabled_rotations))
    found["sleeps"] = bool(body.is_sleeping) or body.activation.linear_threshold >= 0.0
    return found


def of_collider(collider: Any) -> dict[str, HeldValue]:
    """Of one of Rapier's colliders."""
    found: dict[str, HeldValue] = {name: getattr(collider, name) for name in COLLIDER}
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


def neutral(sim: Simulation) -> dict[str, HeldValue]:
    """What an empty world, a bare body of each type and a bare collider hold."""
    rapier = sim.rapier
    world = rapier.PhysicsWorld()
    found: dict[str, HeldValue] = {f"world.{name}": value for name, value in _world(world).items()}
    for name, builder in (("fixed", rapier.RigidBody.fixed()), ("dynamic", rapier.RigidBody.dynamic())):
        held = world.rigid_bodies[world.add_body(builder)]
        found |= {f"{name}.{key}": value for key, value in of_body(held).items()}
    collider = world.colliders[world.add_collider(rapier.Collider.ball(1.0))]
    return found | {f"collider.{key}": value for key, value in of_collider(collider).items()}


def _filter(sim: Simulation) -> dict[str, HeldValue]:
    """For every shape the others that it does not touch, itself not counted: as the hook answers, asked or not."""
    held = sim.built.laws
    names = [f"{name}.0" for _, name in sim.built.shapes]  # as carriers are called: in one layer
    return {
        f"apart.{name}": named_set(
            other for column, other in enumerate(names) if column != row and held.apart(row, column)
        )
        for row, name in enumerate(names)
    }
