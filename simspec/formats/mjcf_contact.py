"""Contact in MJCF: the one law, the surfaces of materials, explicit pairs, and which bodies touch."""

from __future__ import annotations

from typing import Any

from simspec.errors import Problem, UnsupportedError
from simspec.formats.base import Target, number, numbers
from simspec.formats.passes import meeting_materials, solid_shapes
from simspec.world.kinematics import CollisionFilter
from simspec.world.types import PairContact, Shape, World

Attributes = tuple[tuple[str, str], ...]
"""Attributes of an XML element, in the order in which they are printed."""

MATERIAL_CLASS = "material/"
"""Prefix of the class of a material; shapes that only show are of class ``visual``."""
VISUAL_CLASS = "visual"
FILTER_BITS = 31
"""Collision classes that ``contype`` and ``conaffinity`` can tell apart (the sign bit left alone)."""
LARGEST_FRICTION_RATE = 0.3
"""Share of a slip that friction's reference may take back in one step. MuJoCo's friction cone is associated: where friction
cannot stop the slip, the normal velocity rises by μ times what the reference asked for. At 1, which stops a slip in
one step, a box of μ = 1 sliding at 5 m/s hops 319 mm; at 0.3, 29 mm; at 0.1, 3.6 mm (measured)."""


def _impedance(value: float) -> str:
    return numbers((value, value, 0.001, 0.5, 2.0))


def reference(error_reduction: float, restitution: float, timestep: float) -> tuple[float, float]:
    """``solref`` of the law v' = −e v + β r / dt over one step."""
    return (0.0 - error_reduction / (timestep * timestep), 0.0 - (1.0 + restitution) / timestep)


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


def friction_reference(world: World, target: Target) -> tuple[float, float]:
    """``solreffriction`` of explicit pairs: slip is taken back at ``friction_rate``, without a spring."""
    dt = world.physics.timestep
    return (0.0, 0.0 - min(float(target.settings["friction_rate"]), LARGEST_FRICTION_RATE / dt))


def pair_defaults(world: World, target: Target) -> Attributes:
    return (
        ("condim", "3"),
        ("margin", "0"),
        ("gap", "0"),
        *contact_reference(world, target, 0.0),
        ("solreffriction", numbers(friction_reference(world, target))),
    )


def classes(world: World, target: Target) -> list[dict[str, Any]]:
    """One class for each material, and the class of shapes that only show."""
    found: list[dict[str, Any]] = [
        {"name": VISUAL_CLASS, "geom": (("contype", "0"), ("conaffinity", "0"), ("group", "2"))}
    ]
    for material in world.contact.materials:
        held = target.plan.numbers[material.name, 0]
        mu = held.friction
        surface = (("condim", "3" if mu else "1"), ("friction", f"{number(mu)} 0 0"))
        solref = contact_reference(world, target, held.restitution)
        found.append({"name": MATERIAL_CLASS + material.name, "geom": (*surface, *solref)})
    return found


def explicit_pairs(world: World, target: Target) -> list[dict[str, str]] | None:
    """Every two shapes that may touch with friction, or None when there may be more than ``explicit_pairs_limit``.

    None are needed under the pyramid, where MuJoCo ignores their reference for friction.
    Raises UnsupportedError in that case where one of the pairs has restitution too: without an explicit pair it would bounce
    sideways.
    """
    if world.contact.friction_cone != "elliptic":
        return []
    met = meeting_materials(world)
    laws = {(p.first, p.second): p for p in world.contact.pairs if p.friction and (p.first, p.second) in met}
    shapes: dict[str, list[tuple[int, str, Shape]]] = {}
    for index, body in enumerate(world.bodies):
        for shape in solid_shapes(body):
            shapes.setdefault(shape.material, []).append((index, body.name, shape))
    limit = int(target.settings["explicit_pairs_limit"])
    # an upper bound that needs no look at single bodies, so that a pile of thousands costs nothing
    if sum(len(shapes[first]) * len(shapes[second]) / (1 + (first == second)) for first, second in laws) > limit:
        bouncing = [law for law in laws.values() if law.restitution]
        if bouncing:
            raise UnsupportedError([_too_many_pairs(law, limit) for law in bouncing])
        return None
    allowed = CollisionFilter(world)
    beta, dt = float(target.settings["contact_error_reduction"]), world.physics.timestep
    rows = []
    for (first, second), law in laws.items():
        surface = {
            "friction": numbers((law.friction, law.friction, 0.0, 0.0, 0.0)),
            "solref": numbers(reference(beta, law.restitution, dt)),
        }
        for index, body, shape in shapes[first]:
            for other_index, other_body, other in shapes[second]:
                once = first != second or index < other_index
                if once and allowed.may_touch(body, other_body):
                    rows.append({"geom1": shape.name, "geom2": other.name, **surface})
    return rows


def _too_many_pairs(law: PairContact, limit: int) -> Problem:
    return Problem(
        "in MuJoCo every two shapes that have both restitution and friction need an explicit pair, and here these may be "
        f"more than explicit_pairs_limit ({limit})",
        f"contact.pairs.{law.first}.{law.second}.restitution",
        hint="set the restitution or the friction of the many bodies' material to zero, or raise "
        "engines.mujoco.settings.explicit_pairs_limit",
    )


SAME_NUMBER = 1e-12
"""Relative and absolute, as proof level L0's: how far an explicit pair may be from what its shapes give together."""


def pair_problem(names: tuple[str, str], held: tuple[float, float], of_shapes: tuple[float, float]) -> str | None:
    """What is wrong with an explicit pair: its friction and restitution are not what its shapes' numbers give; or None."""
    if all(abs(a - b) <= SAME_NUMBER * max(1.0, abs(b)) for a, b in zip(held, of_shapes, strict=True)):
        return None
    return (
        f"the explicit pair of {names[0]!r} and {names[1]!r} holds friction {held[0]:g} and restitution {held[1]:g}, "
        f"their own numbers give {of_shapes[0]:g} and {of_shapes[1]:g}"
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
