"""What Rapier's inventory must be (``inventory.py``), from the world and the settings that follow from it alone.

Runs outside the engine's process, without Rapier.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from simspec.contact.plan import ContactPlan
from simspec.engines.kit.inventory import Carrier, expected_apart
from simspec.world.gathering import NOTHING
from simspec.world.kinematics import rigid_groups
from simspec.world.meeting import excluded_pairs, meeting_laws, solid_shapes
from simspec.world.types import Body, HeldValue, PairContact, World

Settings = Mapping[str, bool | int | float | str]
FILTER, MODIFY = 0b1, 0b100
"""Bits of Rapier's flags of hooks."""
RIGID, SHARE = 1000.0, 0.01
"""ω dt of contacts, and the share of an overlap that a step takes away."""


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, HeldValue]
) -> dict[str, HeldValue]:
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
                mass = body.inertial if body.inertial.mass else NOTHING
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


def _of(owner: str, neutral: Mapping[str, HeldValue]) -> dict[str, HeldValue]:
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
