"""The model as PhysX stores it, in the world's frames and order.

Masses, poses, shapes with their numbers, gravity and the timestep are queried. The joints, the poses of bodies that are parts
of others, and visual shapes are those that PhysX was built from.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from simspec.contact import ContactPlan
from simspec.engines.kit.building import ShapeUnit
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
from simspec.engines.physx.building import AXES, NAME, SCALE, inertia_of, pose_of, touches
from simspec.engines.physx.simulation import PhysxSimulation
from simspec.errors import EngineError
from simspec.world import frames
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.inertia import NO_INERTIA
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, EngineValue, Inertial, ReadBack, Shape, Surface, World

PREFIX = "PhysxCollisionShape"
KINDS = {"Sphere": "sphere", "Box": "box", "Capsule": "capsule", "Plane": "plane", "ConvexMesh": "mesh"}
"""SAPIEN's names of types of shapes."""


def read_back(sim: PhysxSimulation, unreadable: dict[str, str]) -> ReadBack:
    """The model as PhysX stores it, and its present state."""
    copies: dict[tuple[int, int], list[ShapeUnit]] = {}
    for unit in sim.walk.units:
        copies.setdefault((unit.of.owner.row, unit.of.place), []).append(unit)
    bodies = []
    for row, (body, joint) in enumerate(zip(sim.document.bodies, sim.joints(), strict=True)):
        shapes = tuple(
            _shape(sim, copies[row, place]) if (row, place) in copies else visual_shape(shape)
            for place, shape in enumerate(body.shapes)
        )
        bodies.append(Body(body.name, body.model, inertial(sim, row), joint, shapes))
    x, y, z = sim.gravity.tolist()
    return sim.model(bodies, (x, y, z), float(sim.built.system.timestep), unreadable)


def inertial(sim: PhysxSimulation, row: int) -> Inertial:
    """The mass properties of a body; nothing of a static body or a part of another."""
    if sim.walk.bodies[row].carrier != row:
        return NO_INERTIA
    actor = sim.built.actors[row]
    m, (x, y, z) = inertia_of(actor), (np.array(actor.cmass_local_pose.p, dtype=float) / SCALE).tolist()
    return Inertial(actor.mass, (x, y, z), (m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]))


def _shape(sim: PhysxSimulation, units: Sequence[ShapeUnit]) -> Shape:
    """A collision shape as PhysX stores its copies, with the visual part of the file."""
    solid, copies = units[0].of, [sim.built.shapes[unit.number] for unit in units]
    forms = [(kind_of(copy), size_of(copy), pose_of(copy.local_pose)) for copy in copies]
    if any(form != forms[0] for form in forms):
        raise EngineError(NAME, f"holds copies of {solid.shape.name!r} that differ")
    kind, size, pose = forms[0]
    if kind in AXES:
        pose = frames.compose(pose, frames.inverse(AXES[kind]))
    if solid.owner.moves:
        pose = frames.compose(frames.inverse(solid.owner.pose), pose)
    materials = [copy.physical_material for copy in copies]
    surfaces = tuple(Surface(material.dynamic_friction, restitution=material.restitution) for material in materials)
    visual = visual_shape(solid.shape)
    return dataclasses.replace(visual, kind=kind, size=size, pose=pose, collision=True, surfaces=surfaces)


def kind_of(shape: Any) -> str:
    """The kind of a shape by the world's name; SAPIEN's name of a kind that the world does not have."""
    name = type(shape).__name__.removeprefix(PREFIX)
    return KINDS.get(name, name)


def size_of(shape: Any) -> tuple[float, ...]:
    """The size of a shape as the world has it."""
    match kind_of(shape):
        case "sphere":
            return (float(shape.radius) / SCALE,)
        case "box":
            x, y, z = (2.0 * float(half) / SCALE for half in shape.half_size)
            return (x, y, z)
        case "capsule":
            return (float(shape.radius) / SCALE, 2.0 * float(shape.half_length) / SCALE)
        case "mesh":
            return tuple((np.array(shape.vertices, dtype=float) * shape.scale / SCALE).ravel().tolist())
    return ()


# The values that PhysX stores besides the fields of the read-back, and that can act, and what they must be.
#
# ``expected`` runs without PhysX; it repeats the numbers of ``building.py`` and of the dialect on purpose.

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
        "rigid_dynamic_components": lambda world: sum(body.joint.kind == "free" for body in world.bodies),
        "rigid_static_components": lambda world: sum(group == "world" for group in rigid_groups(world).values()),
        "articulation_link_components": 0,
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
        separate = placed.carrier in (-1, placed.row)
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": separate}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if separate:
            found[f"{at}.units"] = named_set(names[shape] for shape in actor.collision_shapes)
        if placed.carrier == placed.row:
            found |= BODY.read(actor, at)
    for shape, unit in zip(sim.built.shapes, sim.walk.units, strict=True):
        found |= SHAPE.read(shape, f"unit.{names[shape]}") | {f"unit.{names[shape]}.of": unit.of.owner.body.name}
    return found | _filter(sim, units)


def neutral(sim: PhysxSimulation) -> dict[str, EngineValue]:
    """The values of a bare actor and a bare shape."""
    physx = sim.built.physx
    shape = physx.PhysxCollisionShapeSphere(1.0, physx.PhysxMaterial(0.0, 0.0, 0.0))
    return BODY.read(physx.PhysxRigidDynamicComponent(), "dynamic") | SHAPE.read(shape, "shape")


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
    carriers = np.array([unit.of.owner.carrier for unit in sim.walk.units], dtype=np.int64)
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
    groups = rigid_groups(world)
    carriers: list[FilterCarrier] = []
    units_of: dict[str, list[str]] = {}
    for body in world.bodies:
        owner = body.name if groups[body.name] == "world" else groups[body.name]
        for shape in solid_shapes(body):
            for layer in plan.layers(shape.material):
                name, numbers = f"{shape.name}.{layer}", plan.numbers[shape.material, layer]
                carriers.append(FilterCarrier(name, body.name, shape.material, layer))
                units_of.setdefault(owner, []).append(name)
                copy = PhysxShapeCopy(body, shape, numbers.friction or 0.0, numbers.restitution or 0.0)
                found |= SHAPE.expect(copy, f"unit.{name}", below("shape", neutral)) | {f"unit.{name}.of": body.name}
    for body in world.bodies:
        at, free = f"body.{body.name}", body.joint.kind == "free"
        separate = groups[body.name] == "world" or free
        found |= {f"{at}.model": body.model, f"{at}.joint": body.joint.name, f"{at}.held": separate}
        found[f"{at}.shapes"] = tuple(shape.name for shape in body.shapes)
        if separate:
            found[f"{at}.units"] = named_set(units_of.get(body.name, ()))
        if free:
            found |= BODY.expect(settings, at, below("dynamic", neutral))
    return found | expected_separate(world, plan, carriers)
