"""What must not touch what, from the world's rules alone: for inventories, which tell the filter that an engine holds."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from simspec.contact.plan import ContactPlan
from simspec.world.kinematics import rigid_groups
from simspec.world.types import HeldValue, World

MOST_NAMED = 8
"""A set is told by its names up to this many, else by their number and a digest."""


@dataclass(frozen=True, slots=True)
class Carrier:
    """What an engine filters as one: its name, and the body, material and layer of the shapes that it carries."""

    name: str
    body: str
    material: str
    layer: int


def named_set(names: Iterable[str]) -> str:
    """The names, sorted, with spaces between; of many their number and a digest."""
    return listed(sorted(names))


def listed(names: Sequence[str]) -> str:
    """The names in their order, with spaces between; of many their number and a digest."""
    if len(names) <= MOST_NAMED:
        return " ".join(names)
    return f"{len(names)} in all, {hashlib.sha256(chr(0).join(names).encode()).hexdigest()[:16]}"


def expected_apart(world: World, plan: ContactPlan, carriers: Iterable[Carrier]) -> dict[str, HeldValue]:
    """For every carrier, as ``apart.NAME``, the others that must not touch it: of its own rigid group, or both still, of groups
    that ignore each other, of bodies that the world names, of materials that pass through each other, of other layers."""
    carriers = list(carriers)
    groups = rigid_groups(world)
    collision_group = {body.name: body.collision_group for body in world.bodies}
    ignored = set(world.contact.ignored_groups)
    kinds: dict[tuple[bool, str, str, int], set[str]] = {}
    kind_of: dict[str, tuple[bool, str, str, int]] = {}
    of_body: dict[str, set[str]] = {}
    of_group: dict[str, set[str]] = {}
    for one in carriers:
        kind = (groups[one.body] == "world", collision_group[one.body], one.material, one.layer)
        kind_of[one.name] = kind
        kinds.setdefault(kind, set()).add(one.name)
        of_body.setdefault(one.body, set()).add(one.name)
        of_group.setdefault(groups[one.body], set()).add(one.name)

    def meet(one: tuple[bool, str, str, int], other: tuple[bool, str, str, int]) -> bool:
        pair = (min(one[1], other[1]), max(one[1], other[1]))
        return not (one[0] and other[0]) and pair not in ignored and plan.meet(one[2:], other[2:])

    by_kind = {
        kind: frozenset(name for other, held in kinds.items() if not meet(kind, other) for name in held)
        for kind in kinds
    }
    named = _named_partners(world, of_body)
    return {
        f"apart.{one.name}": named_set(
            (by_kind[kind_of[one.name]] | named.get(one.body, set()) | of_group[groups[one.body]]) - {one.name}
        )
        for one in carriers
    }


def _named_partners(world: World, of_body: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """For each body that the world excludes from touching another the carriers of those."""
    found: dict[str, set[str]] = {}
    for one, other in world.contact.excluded_bodies:
        found.setdefault(one, set()).update(of_body.get(other, ()))
        found.setdefault(other, set()).update(of_body.get(one, ()))
    return found
