"""Everything that PhysX holds beside the fields of the read-back, and that can act; what it must be says ``expected.py``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from simspec.contact.plan import ContactPlan
from simspec.engines.kit.inventory import Carrier, expected_apart, named_set
from simspec.engines.kit.labels import sidecar_labels
from simspec.engines.physx.building import SCALE, touches
from simspec.engines.physx.readback import kind_of
from simspec.engines.physx.simulation import Simulation
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import EngineValue, World

SCENE = (
    *("bounce_threshold", "enable_ccd", "enable_enhanced_determinism", "enable_friction_every_iteration"),
    *("enable_pcm", "enable_tgs"),
)
"""Settings of the scene, beside gravity."""
BODY = (
    *("linear_damping", "angular_damping", "disable_gravity", "kinematic", "max_angular_velocity"),
    *("max_linear_velocity", "max_contact_impulse", "sleep_threshold", "solver_position_iterations"),
    *("solver_velocity_iterations", "auto_compute_mass", "is_sleeping", "is_enabled"),
)
"""The same of a body that moves; the bound of the speed that undoes overlaps is another in every step."""
SHAPE, LENGTHS = ("density",), ("contact_offset", "rest_offset", "patch_radius", "min_patch_radius")
"""The same of a shape; the latter in m."""


def unit_names(sim: Simulation) -> list[str]:
    """What copies of shapes are called: by the shape's name and the layer."""
    return [f"{unit.shape.name}.{unit.copy.layer}" for unit in sim.built.units]


def inventory(sim: Simulation) -> dict[str, EngineValue]:
    """Everything else that is held, by name."""
    system = sim.built.system
    found: dict[str, EngineValue] = {**sidecar_labels(sim.sidecar)}
    found |= {f"scene.{name}": getattr(system.config, name) for name in SCENE}
    found["scene.bounce_threshold"] = system.config.bounce_threshold / SCALE
    found["count.dynamic"] = len(system.rigid_dynamic_components)
    found["count.static"] = len(system.rigid_static_components)
    found["count.links"] = len(system.articulation_link_components)
    names = dict(zip(sim.built.shapes, unit_names(sim), strict=True))
    for row, body in enumerate(sim.document.bodies):
        carrier = sim.built.carrier[row]
        found |= {f"body.{body.name}.model": body.model, f"body.{body.name}.joint": body.joint.name}
        found[f"body.{body.name}.held"] = carrier in (-1, row)
        found[f"body.{body.name}.shapes"] = tuple(shape.name for shape in body.shapes)
        if carrier in (-1, row):
            held = sim.built.actors[row]
            found[f"body.{body.name}.units"] = named_set(names[shape] for shape in held.collision_shapes)
        if carrier == row:
            found |= {f"body.{body.name}.{name}": value for name, value in of_body(held).items()}
    for shape, unit in zip(sim.built.shapes, sim.built.units, strict=True):
        at = f"unit.{names[shape]}"
        found |= {f"{at}.{name}": value for name, value in of_shape(shape).items()}
        found[f"{at}.of"] = sim.names[unit.body]
    return found | _filter(sim)


def of_body(body: Any) -> dict[str, EngineValue]:
    """Of one of PhysX's actors that move."""
    found: dict[str, EngineValue] = {name: getattr(body, name) for name in BODY}
    found["locked"] = tuple(float(locked) for locked in body.locked_motion_axes)
    return found


def of_shape(shape: Any) -> dict[str, EngineValue]:
    """Of one of PhysX's shapes."""
    found: dict[str, EngineValue] = {name: getattr(shape, name) for name in SHAPE}
    found |= {name: getattr(shape, name) / SCALE for name in LENGTHS}
    held = shape.physical_material
    # the read-back has the friction of what slides
    found |= {"static_friction": held.static_friction, "restitution": held.restitution, "kind": kind_of(shape)}
    return found


def neutral(sim: Simulation) -> dict[str, EngineValue]:
    """What a bare actor and a bare shape hold."""
    physx = sim.built.physx
    body = physx.PhysxRigidDynamicComponent()
    shape = physx.PhysxCollisionShapeSphere(1.0, physx.PhysxMaterial(0.0, 0.0, 0.0))
    found = {f"dynamic.{name}": value for name, value in of_body(body).items()}
    return found | {f"shape.{name}": value for name, value in of_shape(shape).items()}


def _filter(sim: Simulation) -> dict[str, EngineValue]:
    """For every copy of a shape the others that it does not touch, itself not counted: as SAPIEN's rule makes it of the words
    that PhysX holds. Of one actor, or of two static ones, PhysX looks for no contacts."""
    names, words = unit_names(sim), [shape.get_collision_groups() for shape in sim.built.shapes]
    carriers = [sim.built.carrier[unit.body] for unit in sim.built.units]
    apart = np.zeros((len(names), len(names)), dtype=bool)
    kinds: dict[tuple[int, ...], list[int]] = {}
    for row, own in enumerate(words):
        kinds.setdefault(tuple(own), []).append(row)
    for one, rows in kinds.items():
        for other, columns in kinds.items():
            if not touches(one, other):
                apart[np.ix_(rows, columns)] = True
    held = np.array(carriers, dtype=np.int64)
    apart |= held[:, None] == held[None, :]
    np.fill_diagonal(apart, False)
    return {
        f"apart.{name}": named_set(names[other] for other in np.nonzero(row)[0].tolist())
        for name, row in zip(names, apart, strict=True)
    }


# What PhysX's inventory must be (``inventory.py``), from the world and the settings that follow from it alone.
#
# Runs outside the engine's process, without PhysX.

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
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """What the inventory must be under the ``settings`` that follow from ``world``; ``neutral`` are PhysX's own values."""
    bouncing = [law for law in meeting_laws(world).values() if law.restitution]
    step = math.sqrt(sum(part * part for part in world.physics.gravity)) * world.physics.timestep
    resting = [min(FASTEST, STEPS * step / (1.0 - min(LIVELIEST, law.restitution))) for law in bouncing]
    found: dict[str, EngineValue] = {
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


def _of(owner: str, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
    return {name.removeprefix(f"{owner}."): value for name, value in neutral.items() if name.startswith(f"{owner}.")}
