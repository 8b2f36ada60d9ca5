"""Everything that PhysX holds beside the fields of the read-back, and that can act; what it must be says ``expected.py``."""

from __future__ import annotations

from typing import Any

import numpy as np

from simspec.engines.kit.inventory import named_set
from simspec.engines.kit.labels import sidecar_labels
from simspec.engines.physx.building import SCALE
from simspec.engines.physx.filters import touches
from simspec.engines.physx.readback import kind_of
from simspec.engines.physx.simulation import Simulation
from simspec.world.types import HeldValue

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


def inventory(sim: Simulation) -> dict[str, HeldValue]:
    """Everything else that is held, by name."""
    system = sim.built.system
    found: dict[str, HeldValue] = {**sidecar_labels(sim.sidecar)}
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


def of_body(body: Any) -> dict[str, HeldValue]:
    """Of one of PhysX's actors that move."""
    found: dict[str, HeldValue] = {name: getattr(body, name) for name in BODY}
    found["locked"] = tuple(float(locked) for locked in body.locked_motion_axes)
    return found


def of_shape(shape: Any) -> dict[str, HeldValue]:
    """Of one of PhysX's shapes."""
    found: dict[str, HeldValue] = {name: getattr(shape, name) for name in SHAPE}
    found |= {name: getattr(shape, name) / SCALE for name in LENGTHS}
    held = shape.physical_material
    # the read-back has the friction of what slides
    found |= {"static_friction": held.static_friction, "restitution": held.restitution, "kind": kind_of(shape)}
    return found


def neutral(sim: Simulation) -> dict[str, HeldValue]:
    """What a bare actor and a bare shape hold."""
    physx = sim.built.physx
    body = physx.PhysxRigidDynamicComponent()
    shape = physx.PhysxCollisionShapeSphere(1.0, physx.PhysxMaterial(0.0, 0.0, 0.0))
    found = {f"dynamic.{name}": value for name, value in of_body(body).items()}
    return found | {f"shape.{name}": value for name, value in of_shape(shape).items()}


def _filter(sim: Simulation) -> dict[str, HeldValue]:
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
