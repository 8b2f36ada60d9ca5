"""Contact in MJCF: the one law, the surfaces of materials, explicit pairs, and which bodies touch."""

from __future__ import annotations

from typing import Any

from simspec.errors import Problem, UnsupportedError
from simspec.formats.base import Target, number, numbers
from simspec.formats.passes import meeting_materials, solid_shapes, surface_numbers
from simspec.world.kinematics import CollisionFilter
from simspec.world.types import World

Attributes = tuple[tuple[str, str], ...]
"""Attributes of an XML element, in the order in which they are printed."""

MATERIAL_CLASS = "material/"
"""Prefix of the class of a material; shapes that only show are of class ``visual``."""
VISUAL_CLASS = "visual"
FILTER_BITS = 31
"""Collision classes that ``contype`` and ``conaffinity`` can tell apart (the sign bit left alone)."""
LARGEST_PAIR_LIST = 20000
"""Explicit pairs of shapes that a file may hold; more would make a file of megabytes that MuJoCo reads for seconds."""


def _impedance(value: float) -> str:
    return numbers((value, value, 0.001, 0.5, 2.0))


def reference(error_reduction: float, restitution: float, timestep: float) -> tuple[float, float]:
    """``solref`` of the law v' = −e v + β r / dt over one step."""
    return (0.0 - error_reduction / (timestep * timestep), 0.0 - (1.0 + restitution) / timestep)


def restitution_of(solref: tuple[float, float], timestep: float) -> float:
    """The inverse of :func:`reference` for the restitution."""
    return 0.0 - solref[1] * timestep - 1.0


def contact_reference(world: World, target: Target, restitution: float) -> Attributes:
    beta, dt = float(target.settings["contact_error_reduction"]), world.physics.timestep
    return (
        ("solref", numbers(reference(beta, restitution, dt))),
        ("solimp", _impedance(float(target.settings["contact_impedance"]))),
    )


def joint_references(world: World, target: Target) -> Attributes:
    """How hard position limits and dry friction are; a stop is inelastic, and dry friction has no spring."""
    dt = world.physics.timestep
    return (
        ("solreflimit", numbers(reference(float(target.settings["limit_error_reduction"]), 0.0, dt))),
        ("solimplimit", _impedance(float(target.settings["limit_impedance"]))),
        ("solreffriction", numbers(reference(0.0, 0.0, dt))),
        ("solimpfriction", _impedance(float(target.settings["dry_friction_impedance"]))),
    )


def pair_defaults(world: World, target: Target) -> Attributes:
    return (
        ("condim", "3"),
        ("margin", "0"),
        ("gap", "0"),
        *contact_reference(world, target, 0.0),
        ("solreffriction", numbers(reference(0.0, 0.0, world.physics.timestep))),
    )


def classes(world: World, target: Target) -> list[dict[str, Any]]:
    """One class for each material, and the class of shapes that only show."""
    friction, _ = surface_numbers(world, "friction", target.friction_rule)
    restitution, _ = surface_numbers(world, "restitution", target.restitution_rule)
    found: list[dict[str, Any]] = [
        {"name": VISUAL_CLASS, "geom": (("contype", "0"), ("conaffinity", "0"), ("group", "2"))}
    ]
    for material in world.contact.materials:
        mu = friction[material.name]
        surface = (("condim", "3" if mu else "1"), ("friction", f"{number(mu)} 0 0"))
        solref = contact_reference(world, target, restitution[material.name])
        found.append({"name": MATERIAL_CLASS + material.name, "geom": (*surface, *solref)})
    return found


def explicit_pairs(world: World, target: Target) -> list[dict[str, str]]:
    """Pairs of shapes with both restitution and friction (see :class:`Mjcf`).

    Raises UnsupportedError when there are more than ``LARGEST_PAIR_LIST``.
    """
    laws = {
        (pair.first, pair.second): pair
        for pair in world.contact.pairs
        if pair.friction and pair.restitution and (pair.first, pair.second) in meeting_materials(world)
    }
    if not laws:
        return []
    allowed = CollisionFilter(world)
    concerned = {name for pair in laws for name in pair}
    shapes = [
        (body.name, shape) for body in world.bodies for shape in solid_shapes(body) if shape.material in concerned
    ]
    rows = []
    for index, (body, shape) in enumerate(shapes):
        for other_body, other in shapes[index + 1 :]:
            law = laws.get((min(shape.material, other.material), max(shape.material, other.material)))
            if law is None or not allowed.may_touch(body, other_body):
                continue
            if len(rows) == LARGEST_PAIR_LIST:
                raise UnsupportedError([_too_many_pairs(law.first, law.second)])
            beta, dt = float(target.settings["contact_error_reduction"]), world.physics.timestep
            rows.append(
                {
                    "geom1": shape.name,
                    "geom2": other.name,
                    "friction": numbers((law.friction, law.friction, 0.0, 0.0, 0.0)),
                    "solref": numbers(reference(beta, law.restitution, dt)),
                }
            )
    return rows


def _too_many_pairs(first: str, second: str) -> Problem:
    return Problem(
        "in MuJoCo every two shapes with both restitution and friction need an explicit pair, and there are more "
        f"than {LARGEST_PAIR_LIST}",
        f"contact.pairs.{first}.{second}.restitution",
        hint="set the restitution or the friction of the many bodies' material to zero",
    )


def collision_masks(world: World) -> tuple[dict[str, Attributes], list[tuple[str, str]]]:
    """``contype`` and ``conaffinity`` of each collision group, and pairs to exclude where masks do not suffice.

    MuJoCo lets two shapes touch when (type1 & affinity2) or (type2 & affinity1). Each group that ignores another has a
    bit of its own as its type, and the bits of all groups that it may touch as its affinity: both terms are then
    the same, and their "or" is exactly the wanted matrix. Groups that ignore nothing share the first bit.
    """
    ignored = set(world.contact.ignored_groups)
    groups = sorted({body.collision_group for body in world.bodies})
    special = [group for group in groups if any(group in pair for pair in ignored)]
    if not special:
        return dict.fromkeys(groups, ()), []
    if len(special) >= FILTER_BITS:
        return dict.fromkeys(groups, ()), _ignored_bodies(world)
    bits = dict.fromkeys(groups, 0) | {group: index for index, group in enumerate(special, 1)}

    def affinity(group: str) -> int:
        # the first bit stands for all that ignore nothing, and stays set when no such group is there
        return 1 | sum(1 << bits[o] for o in special if (min(group, o), max(group, o)) not in ignored)

    masks = {group: (("contype", str(1 << bits[group])), ("conaffinity", str(affinity(group)))) for group in groups}
    return masks, []


def _ignored_bodies(world: World) -> list[tuple[str, str]]:
    members: dict[str, list[str]] = {}
    for body in world.bodies:
        if solid_shapes(body):
            members.setdefault(body.collision_group, []).append(body.name)
    return [
        (min(one, other), max(one, other))
        for first, second in world.contact.ignored_groups
        for one in members.get(first, ())
        for other in members.get(second, ())
        if one != other
    ]
