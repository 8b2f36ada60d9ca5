"""What PhysX's inventory must be (``inventory.py``), from the world and the settings that follow from it alone.

Runs outside the engine's process, without PhysX.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from simspec.contact.plan import ContactPlan
from simspec.engines.kit.inventory import Carrier, expected_apart, named_set
from simspec.world.kinematics import rigid_groups
from simspec.world.meeting import meeting_laws, solid_shapes
from simspec.world.types import HeldValue, World

Settings = Mapping[str, bool | int | float | str]
LEAST = 1e-6
"""m/s, of what bounces."""
STEPS, LIVELIEST = 2.0, 0.8
"""Steps of gravity, over 1 − e, that what bounces arrives with at least; e is the largest restitution, or this."""
FASTEST = 0.5
"""m/s: what arrives faster bounces all the same."""
OFFSET = 3.75e-6
"""m by which shapes reach beyond themselves for contacts."""


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, HeldValue]
) -> dict[str, HeldValue]:
    """What the inventory must be under the ``settings`` that follow from ``world``; ``neutral`` are PhysX's own values."""
    bouncing = [law for law in meeting_laws(world).values() if law.restitution]
    step = math.sqrt(sum(part * part for part in world.physics.gravity)) * world.physics.timestep
    resting = [min(FASTEST, STEPS * step / (1.0 - min(LIVELIEST, law.restitution))) for law in bouncing]
    found: dict[str, HeldValue] = {
        "scene.bounce_threshold": max((LEAST, *resting, *(law.restitution_threshold for law in bouncing))),
        "scene.enable_ccd": False,
        "scene.enable_enhanced_determinism": True,
        "scene.enable_friction_every_iteration": True,
        "scene.enable_pcm": False,
        "scene.enable_tgs": False,
    }
    groups = rigid_groups(world)
    carriers: list[Carrier] = []
    owns: dict[str, list[str]] = {}
    for body in world.bodies:
        owner = body.name if groups[body.name] == "world" else groups[body.name]
        for shape in solid_shapes(body):
            for layer in plan.layers(shape.material):
                name = f"{shape.name}.{layer}"
                carriers.append(Carrier(name, body.name, shape.material, layer))
                owns.setdefault(owner, []).append(name)
                numbers = plan.numbers[shape.material, layer]
                found |= {f"unit.{name}.{key}": value for key, value in _of("shape", neutral).items()}
                found |= {
                    f"unit.{name}.contact_offset": OFFSET,
                    f"unit.{name}.static_friction": numbers.friction or 0.0,
                    f"unit.{name}.restitution": numbers.restitution or 0.0,
                    f"unit.{name}.kind": shape.kind,
                    f"unit.{name}.of": body.name,
                }
    for body in world.bodies:
        still, at = groups[body.name] == "world", f"body.{body.name}"
        free = body.joint.kind == "free"
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": still or free}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if still or free:
            found[f"{at}.units"] = named_set(owns.get(body.name, ()))
        if free:
            own = _of("dynamic", neutral) | {
                "angular_damping": 0.0,
                "max_angular_velocity": 1e6,
                "max_linear_velocity": 1e16,
                "sleep_threshold": 0.0,
                "solver_position_iterations": settings["iterations"],
                "solver_velocity_iterations": 1,
                "auto_compute_mass": False,
                "is_sleeping": False,
            }
            found |= {f"{at}.{name}": value for name, value in own.items()}
    found["count.dynamic"] = sum(body.joint.kind == "free" for body in world.bodies)
    found["count.static"] = sum(groups[body.name] == "world" for body in world.bodies)
    found["count.links"] = 0
    return found | expected_apart(world, plan, carriers)


def _of(owner: str, neutral: Mapping[str, HeldValue]) -> dict[str, HeldValue]:
    return {name.removeprefix(f"{owner}."): value for name, value in neutral.items() if name.startswith(f"{owner}.")}
