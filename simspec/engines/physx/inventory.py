"""The values that PhysX stores besides the fields of the read-back, and that can act, and what they must be.

``expected`` runs without PhysX; it repeats the numbers of ``building.py``, ``links.py`` and the dialect on purpose.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

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
from simspec.engines.physx.filter import touches
from simspec.engines.physx.readback import kind_of
from simspec.engines.physx.roles import PhysxLinkRole, links_of, roles
from simspec.engines.physx.simulation import PhysxSimulation
from simspec.engines.physx.units import SCALE
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, EngineValue, Shape, World

Settings = Mapping[str, bool | int | float | str]


def _bounce_threshold(world: World) -> float:
    """2 steps of gravity over 1 - e, e up to 0.8, and 0.5 m/s at most, so that bodies at rest do not hop; or the world's."""
    bouncing = [law for law in meeting_laws(world).values() if law.restitution]
    step = math.sqrt(sum(part * part for part in world.physics.gravity)) * world.physics.timestep
    resting = [min(0.5, 2.0 * step / (1.0 - min(0.8, law.restitution))) for law in bouncing]
    return max((1e-6, *resting, *(law.restitution_threshold for law in bouncing)))


SCENE = Items[Any, World].named(
    lambda config, name: getattr(config, name) / (SCALE if name == "bounce_threshold" else 1),
    {"bounce_threshold": _bounce_threshold},
) | Items[Any, World].named(
    getattr,
    {
        **dict.fromkeys(("enable_ccd", "enable_pcm", "enable_tgs"), False),
        **dict.fromkeys(("enable_enhanced_determinism", "enable_friction_every_iteration"), True),
    },
)
"""Settings of the scene besides gravity."""
COUNTS = Items[Any, World].named(
    lambda system, name: len(getattr(system, name)),
    {
        "rigid_dynamic_components": lambda world: sum(role == "actor" for role, _ in roles(world).values()),
        "rigid_static_components": lambda world: sum(group == "world" for group in rigid_groups(world).values()),
        "articulation_link_components": lambda world: sum(map(len, links_of(world).values())),
    },
)
BODY = Items[Any, Settings].named(
    getattr,
    {
        **dict.fromkeys(
            ("linear_damping", "disable_gravity", "kinematic", "max_contact_impulse", "is_enabled"), NEUTRAL
        ),
        "angular_damping": 0.0,
        "max_angular_velocity": 1e6,
        "max_linear_velocity": 1e16,
        "sleep_threshold": 0.0,
        "solver_position_iterations": lambda settings: settings["iterations"],
        "solver_velocity_iterations": 1,
        "auto_compute_mass": False,
        "is_sleeping": False,
    },
) | Items[Any, Settings]({"locked": (lambda body: tuple(map(float, body.locked_motion_axes)), NEUTRAL)})
"""Values of a dynamic actor; the bound of the speed that takes back overlaps changes in every step."""


LINK = Items[Any, None].named(
    getattr,
    {
        **dict.fromkeys(("disable_gravity", "max_contact_impulse", "is_enabled"), NEUTRAL),
        **dict.fromkeys(("linear_damping", "angular_damping"), 0.0),
        "max_angular_velocity": 1e6,
        "max_linear_velocity": 1e16,
        "auto_compute_mass": False,
    },
)
"""Values of a link."""
ARTICULATION = Items[Any, Settings].named(
    getattr,
    {
        "sleep_threshold": 0.0,
        "solver_position_iterations": lambda settings: settings["iterations"],
        "solver_velocity_iterations": 1,
    },
)
DRIVE = Items[Any, float].named(
    lambda joint, name: float(np.ravel(getattr(joint, name))[0]),
    {
        **dict.fromkeys(("friction", "stiffness", "drive_target", "drive_velocity_target"), 0.0),
        "damping": lambda damping: damping,
        "max_velocity": 1e16,
    },
) | Items[Any, float]({"drive_mode": (lambda joint: str(joint.drive_mode), "force")})
"""Values of a joint of one coordinate; from the damping of its drive."""


class PhysxShapeCopy(NamedTuple):
    """A copy of a collision shape with the numbers of its layer."""

    body: Body
    shape: Shape
    friction: float
    restitution: float


SHAPE = (
    Items[Any, PhysxShapeCopy].named(getattr, {"density": NEUTRAL})
    | Items[Any, PhysxShapeCopy].named(
        lambda shape, name: getattr(shape, name) / SCALE,
        {"contact_offset": 3.75e-6, **dict.fromkeys(("rest_offset", "patch_radius", "min_patch_radius"), NEUTRAL)},
    )
    | Items[Any, PhysxShapeCopy].named(
        # the read-back has the dynamic friction
        lambda shape, name: getattr(shape.physical_material, name),
        {"static_friction": lambda copy: copy.friction, "restitution": lambda copy: copy.restitution},
    )
    | Items[Any, PhysxShapeCopy]({"kind": (kind_of, lambda copy: copy.shape.kind)})
)


def inventory(sim: PhysxSimulation) -> dict[str, EngineValue]:
    """The stored values by name."""
    system = sim.built.system
    found = {**sidecar_labels(sim.sidecar), **SCENE.read(system.config, "scene"), **_counts(COUNTS.read(system))}
    units = [f"{unit.of.shape.name}.{unit.copy.layer}" for unit in sim.walk.units]
    names = dict(zip(sim.built.shapes, units, strict=True))
    for placed, body in zip(sim.walk.bodies, sim.document.bodies, strict=True):
        at, actor = f"body.{body.name}", sim.built.actors[placed.row]
        separate = not placed.moves or sim.built.homes.of[placed.row].row == placed.row
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": separate}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if separate:
            found[f"{at}.units"] = named_set(names[shape] for shape in actor.collision_shapes)
        if placed.row in sim.singles.rows:
            found |= BODY.read(actor, at)
        elif placed.row in sim.built.links.of:
            found |= LINK.read(actor, at) | _joints(sim, placed.row)
    for shape, unit in zip(sim.built.shapes, sim.walk.units, strict=True):
        found |= SHAPE.read(shape, f"unit.{names[shape]}") | {f"unit.{names[shape]}.of": unit.of.owner.body.name}
    for articulation, rows in zip(sim.built.links.articulations, sim.built.homes.trees, strict=True):
        at = f"articulation.{sim.names[rows[0]]}"
        found |= ARTICULATION.read(articulation, at) | {f"{at}.links": len(articulation.links)}
        found[f"{at}.root"] = str(articulation.root.joint.type)
    return found | _filter(sim, units)


def _joints(sim: PhysxSimulation, row: int) -> dict[str, EngineValue]:
    """The joints of a body that is a link, and the links between them."""
    links, name = sim.built.links, sim.names[row]
    found: dict[str, EngineValue] = {}
    for place, joint in enumerate(links.joints[row]):
        if joint in links.coordinates:
            found |= DRIVE.read(joint, f"joint.{name}.{place}")
        if joint.child_link != links.of[row] or not sim.document.bodies[row].mass:
            found |= _massless(joint.child_link, f"massless.{name}.{place}")
    if row in links.spacers:
        found |= _massless(links.spacers[row], f"massless.{name}.spacer")
    return found


def _massless(link: Any, at: str) -> dict[str, EngineValue]:
    """A link that stands for a massless body."""
    values = LINK.read(link, at) | {f"{at}.mass": float(link.mass)}
    return values | {f"{at}.moments": tuple((np.array(link.inertia, dtype=float) / (SCALE * SCALE)).tolist())}


def neutral(sim: PhysxSimulation) -> dict[str, EngineValue]:
    """The values of a bare actor and a bare shape."""
    physx = sim.built.physx
    shape = physx.PhysxCollisionShapeSphere(1.0, physx.PhysxMaterial(0.0, 0.0, 0.0))
    bare = BODY.read(physx.PhysxRigidDynamicComponent(), "dynamic") | SHAPE.read(shape, "shape")
    return bare | LINK.read(physx.PhysxArticulationLinkComponent(), "link")


def _counts(counts: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
    return {f"count.{name}": value for name, value in zip(("dynamic", "static", "links"), counts.values(), strict=True)}


def _filter(sim: PhysxSimulation, names: list[str]) -> dict[str, EngineValue]:
    """For every unit the others that it does not touch, itself excluded: by SAPIEN's rule from the words that PhysX
    stores. PhysX computes no contacts of one actor, or of two static ones."""
    words = [shape.get_collision_groups() for shape in sim.built.shapes]
    excluded = np.zeros((len(names), len(names)), dtype=bool)
    kinds: dict[tuple[int, ...], list[int]] = {}
    for row, word in enumerate(words):
        kinds.setdefault(tuple(word), []).append(row)
    for entry, rows in kinds.items():
        for other, columns in kinds.items():
            if not touches(entry, other):
                excluded[np.ix_(rows, columns)] = True
    homes = sim.built.homes.of
    carriers = np.array(
        [homes[unit.of.owner.row].row if unit.of.owner.moves else -1 for unit in sim.walk.units], dtype=np.int64
    )
    excluded |= carriers[:, None] == carriers[None, :]
    np.fill_diagonal(excluded, False)
    return {
        f"apart.{name}": named_set(names[other] for other in np.nonzero(row)[0].tolist())
        for name, row in zip(names, excluded, strict=True)
    }


def expected(
    world: World, settings: Settings, plan: ContactPlan, neutral: Mapping[str, EngineValue]
) -> dict[str, EngineValue]:
    """The values that follow from ``world`` under its ``settings``; ``neutral`` are PhysX's defaults."""
    found = SCENE.expect(world, "scene") | _counts(COUNTS.expect(world))
    role = roles(world)
    carriers: list[FilterCarrier] = []
    units_of: dict[str, list[str]] = {}
    for body in world.bodies:
        owner = role[body.name][1]
        for shape in solid_shapes(body):
            for layer in plan.layers(shape.material):
                name, numbers = f"{shape.name}.{layer}", plan.numbers[shape.material, layer]
                carriers.append(FilterCarrier(name, body.name, shape.material, layer))
                units_of.setdefault(owner, []).append(name)
                copy = PhysxShapeCopy(body, shape, numbers.friction or 0.0, numbers.restitution or 0.0)
                found |= SHAPE.expect(copy, f"unit.{name}", below("shape", neutral)) | {f"unit.{name}.of": body.name}
    for body in world.bodies:
        at, (kind, _) = f"body.{body.name}", role[body.name]
        separate = kind != "part"
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": separate}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if separate:
            found[f"{at}.units"] = named_set(units_of.get(body.name, ()))
        if kind == "actor":
            found |= BODY.expect(settings, at, below("dynamic", neutral))
        elif kind == "link":
            found |= LINK.expect(None, at, below("link", neutral))
    for top, links in links_of(world).items():
        at = f"articulation.{top}"
        found |= ARTICULATION.expect(settings, at) | {f"{at}.links": len(links), f"{at}.root": "fixed"}
        for link in links:
            found |= _expected_link(world, link, below("link", neutral))
    return found | expected_separate(world, plan, carriers)


def _expected_link(world: World, link: PhysxLinkRole, neutral: Mapping[str, EngineValue]) -> dict[str, EngineValue]:
    """The values of a link and of the joint above it."""
    found: dict[str, EngineValue] = {}
    if not link.body:
        return found
    body = next(body for body in world.bodies if body.name == link.body)
    if link.slides is not None:
        damping = 0.0
        if body.joint.dry_friction:
            damping = 1e12 * (1.0 if link.slides else 512.0**2)
        found |= DRIVE.expect(damping, f"joint.{link.body}.{link.place}")
    if link.mass is not None:
        mass, moment = link.mass
        at = f"massless.{link.body}.{link.place}"
        found |= LINK.expect(None, at, neutral)
        found |= {f"{at}.mass": 1e-10 * mass, f"{at}.moments": (1e-10 * moment,) * 3}
    return found
