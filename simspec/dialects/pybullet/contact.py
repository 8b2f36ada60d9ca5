"""Contact in URDF for PyBullet: the part of the law on each link, copies of shapes on separate links, and the filter.

PyBullet holds friction, restitution and hardness once per link, multiplies two links' numbers, and filters links. So the
shapes of a body are split by material, and copied where a table of pairs needs it (``contact/plan.py``): the first
part stays on the body's own link, every other gets a massless link on a fixed joint.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final

from simspec.contact.plan import CollisionPart, ContactPlan, parts
from simspec.dialects.pybullet.sidecar import FilterClass, PybulletCollisionFilter
from simspec.errors import Problem
from simspec.world.contact_pairs import excluded_pairs, meeting_laws
from simspec.world.hull import hull_within_margin, thickened
from simspec.world.kinematics import rigid_groups
from simspec.world.types import Body, Hardness, Shape, Surface, World

FILTER_BITS = 31
"""Collision classes that PyBullet's 32-bit group masks can distinguish (the sign bit left alone)."""
LARGEST_FRICTION = 10.0
"""PyBullet clamps the friction of a pair to ±10 (measured)."""
NATIVE = "native"

Key = tuple[bool, str, frozenset[tuple[str, int]]]
"""A class of the filter: whether its links cannot move, the collision group (where it matters), and which (material, layer)
they meet."""


def split(body: Body, plan: ContactPlan) -> tuple[CollisionPart, ...]:
    """The parts of a body; one without collision shapes for a body that has none."""
    return parts(body, plan) or (CollisionPart(body.name, "", 0, (), Surface(hardness=Hardness())),)


def copy_name(part: CollisionPart) -> str:
    """The name of the link of a part beyond the first; no spec can give it, since names have no dots."""
    return f"{part.body}__{part.material}.{part.layer}"


def link_name(part: CollisionPart, first: CollisionPart) -> str:
    """The name of a part's link."""
    return part.body if part is first else copy_name(part)


def contact_values(surface: Surface) -> tuple[tuple[str, float], ...]:
    """The children of a link's ``contact`` element, by name. A pair's springs stand in series and its dampers add up, so that
    each link has twice the stiffness and half the damping (measured)."""
    found = [
        ("lateral_friction", surface.friction or 0.0),
        ("rolling_friction", surface.rolling_friction or 0.0),
        ("spinning_friction", surface.torsional_friction or 0.0),
        ("restitution", surface.restitution or 0.0),
    ]
    if surface.hardness is not None and surface.hardness.kind == "stiffness":
        found += [("stiffness", 2.0 * surface.hardness.stiffness), ("damping", surface.hardness.damping / 2.0)]
    return tuple(found)


def native_contact(world: World) -> bool:
    """Whether contact is as hard as PyBullet makes it; all pairs that meet then are (see :func:`problems`)."""
    return any(law.hardness.kind == NATIVE for law in meeting_laws(world).values())


def restitution_threshold(world: World) -> float:
    """The speed below which nothing bounces: PyBullet has one for all pairs (see :func:`problems`)."""
    return max((law.restitution_threshold for law in meeting_laws(world).values() if law.restitution), default=0.0)


def problems(world: World) -> list[Problem]:
    """Parameters that PyBullet stores once for all pairs, and that differ between pairs of the world."""
    laws = meeting_laws(world)
    found = []
    bouncing = {pair: law for pair, law in laws.items() if law.restitution}
    if len({law.restitution_threshold for law in bouncing.values()}) > 1:
        found.append(
            _differing(
                "one restitution_threshold for all pairs that bounce",
                {pair: f"{law.restitution_threshold:g} m/s" for pair, law in bouncing.items()},
                "restitution_threshold",
            )
        )
    kinds = {pair: law.hardness.kind for pair, law in laws.items()}
    if NATIVE in kinds.values() and len(set(kinds.values())) > 1:
        found.append(_differing("its native hardness for all pairs or none", kinds, "hardness"))
    for (first, second), law in laws.items():
        if law.friction > LARGEST_FRICTION:
            found.append(
                Problem(
                    f"PyBullet does not support friction above {LARGEST_FRICTION:g}",
                    f"contact.pairs.{first}.{second}.friction",
                    found=f"{law.friction:g}",
                    allowed=f"up to {LARGEST_FRICTION:g}",
                )
            )
    return found


def _differing(what: str, values: Mapping[tuple[str, str], str], field: str) -> Problem:
    first, second = next(iter(values))
    text = "; ".join(f"{name}, {other}: {value}" for (name, other), value in values.items())
    return Problem(
        f"PyBullet supports only {what}",
        f"contact.pairs.{first}.{second}.{field}",
        found=text,
        hint="make them equal, or run without this engine",
    )


def collision_filter(world: World, plan: ContactPlan) -> PybulletCollisionFilter:
    """Classes of links (a group bit and a mask each) and pairs of links that do not touch besides.

    Links are of one class when they are in groups that ignore the same, both can move or both cannot (those never touch each
    other), and meet the same materials in the same layers. More classes than bits: exclusions are written as pairs.
    """
    groups = rigid_groups(world)
    ignored = set(world.contact.ignored_groups)
    named = {name for pair in ignored for name in pair}
    meets = _meeting(plan)
    links: dict[Key, list[str]] = {}
    of: dict[str, Key] = {}
    holds: dict[Key, set[tuple[str, int]]] = {}
    by_body: dict[str, list[str]] = {}
    for body in world.bodies:
        some = parts(body, plan)
        for part in some:
            group = body.collision_group if body.collision_group in named else ""
            key = (groups[body.name] == "world", group, meets.get((part.material, part.layer), frozenset()))
            name = link_name(part, some[0])
            links.setdefault(key, []).append(name)
            of[name] = key
            holds.setdefault(key, set()).add((part.material, part.layer))
            by_body.setdefault(body.name, []).append(name)
    classes = sorted(links, key=lambda key: (key[0], key[1], sorted(key[2])))

    def touch(key: Key, other: Key) -> bool:
        if (key[0] and other[0]) or (min(key[1], other[1]), max(key[1], other[1])) in ignored:
            return False
        return not key[2].isdisjoint(holds[other])

    excluded = {
        (min(a, b), max(a, b))
        for first, second in excluded_pairs(world)
        for a in by_body.get(first, ())
        for b in by_body.get(second, ())
    }
    for names in by_body.values():  # a body does not touch itself
        excluded.update((min(a, b), max(a, b)) for a, b in itertools.combinations(names, 2) if touch(of[a], of[b]))
    if len(classes) > FILTER_BITS:
        excluded |= _excluded_of(of, touch)
        return PybulletCollisionFilter((FilterClass(1, 1, tuple(of)),), tuple(sorted(excluded)))
    bits = {key: 1 << index for index, key in enumerate(classes)}
    return PybulletCollisionFilter(
        tuple(
            FilterClass(bits[key], sum(bit for other, bit in bits.items() if touch(key, other)), tuple(links[key]))
            for key in classes
        ),
        tuple(sorted(excluded)),
    )


def _meeting(plan: ContactPlan) -> dict[tuple[str, int], frozenset[tuple[str, int]]]:
    """For each (material, layer) the others that it meets."""
    found: dict[tuple[str, int], set[tuple[str, int]]] = {}
    for (first, second), layer in plan.layer_of.items():
        found.setdefault((first, layer), set()).add((second, layer))
        found.setdefault((second, layer), set()).add((first, layer))
    return {key: frozenset(others) for key, others in found.items()}


def _excluded_of(of: Mapping[str, Key], touch: Callable[[Key, Key], bool]) -> set[tuple[str, str]]:
    names: Iterable[str] = sorted(of)
    ordered = list(names)
    return {
        (name, other)
        for index, name in enumerate(ordered)
        for other in ordered[index + 1 :]
        if not touch(of[name], of[other])
    }


# Meshes within the margin that PyBullet keeps around hulls.
#
# On the base of a tree the margin is the setting ``collision_margin``; on every other link PyBullet keeps 1 mm, whatever it
# is requested (measured, 3.2.7). It is outside of the hull, so that hulls are written with their faces that much further in:
# faces are then where they should be, and edges are rounded by the margin, as PyBullet's own boxes and cylinders are there. A
# hull that is too thin for that is written as far in as it goes (``world/hull.py``), and is thicker in PyBullet. In boxes and
# cylinders the margin is within: a thinner shape is written as thick as both margins, since Bullet overlooks contacts of cores
# of less than nothing (measured: of a sole of 16 × 7 cm and 1 mm, 11 of 93 pairs of a robot's shapes).

LINK_MARGIN: Final = 1e-3
"""m, around hulls on links other than bases."""


def written_shapes(body: Body, parts: Sequence[CollisionPart], local_margin: float) -> dict[str, Shape]:
    """The shapes of a body by name, those that touch within the margin of the link that carries them: ``own_margin`` on its
    own."""
    margins = {shape.name: LINK_MARGIN for part in parts[1:] for shape in part.shapes}
    margins |= {shape.name: local_margin for shape in parts[0].shapes}
    return {shape.name: _within(shape, margins.get(shape.name, 0.0)) for shape in body.shapes}


def faces_meet(world: World, plan: ContactPlan, base_margin: float) -> bool:
    """Whether hulls get the features by which PyBullet finds all contact points of two faces in one step.

    It then looks at hulls without their margin (measured: one on a link is 1 mm deep in another), so that no hull may have one:
    all meshes that touch are on bases of trees, whose margin is ``base_margin`` (m).
    """
    margins = [margin for body in world.bodies for _, margin in margins_of("mesh", body, plan, base_margin)]
    return bool(margins) and not any(margins)


def margins_of(kind: str, body: Body, plan: ContactPlan, base_margin: float) -> Iterator[tuple[Shape, float]]:
    """The shapes of a ``kind`` of a body that touch, each with the margin (m) of a link that carries it; a copied one more than
    once."""
    local, *carried = parts(body, plan) or (None,)
    root = body.joint.parent is None and body.joint.kind in ("free", "fixed")
    on_base = root and (body.joint.kind == "free" or not body.inertial.mass)
    for part in () if local is None else (local, *carried):
        for shape in part.shapes:
            if shape.kind == kind:
                yield shape, base_margin if part is local and on_base else LINK_MARGIN


def _within(shape: Shape, margin: float) -> Shape:
    if not shape.collision or not margin:
        return shape
    if shape.kind in ("box", "cylinder"):
        return dataclasses.replace(shape, size=thickened(shape.kind, shape.size, margin))
    if shape.kind != "mesh":
        return shape
    return dataclasses.replace(shape, size=hull_within_margin(shape.size, margin))
