"""Names of the columns of a run's tables: joints with controllers, and the shapes that touch.

A contact's side is a shape of the world, by its number, or, where an engine does not distinguish several shapes of a body, a
group of them: numbers from the count of the world's shapes on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.files import parts, zeros
from simspec.world.types import World

SEPARATOR = "|"
"""Between the names of a group's shapes; no name contains it."""
GROUPS = "contact_groups"
"""The entry of a provenance with the groups of shapes. It is missing where a run did not record shapes."""


@dataclass(frozen=True)
class Labels:
    """``joints``: those with controllers, in the order of their columns; ``groups``: the groups of shapes that contacts are of
    in addition to single shapes, None where shapes were not recorded."""

    joints: tuple[str, ...] = ()
    groups: tuple[tuple[str, ...], ...] | None = None


def labels_of(provenance: Mapping[str, Any]) -> Labels:
    """The labels of a run, from its provenance. Raises ValueError, TypeError or AttributeError where they are none."""
    joints = tuple(str(name) for name in (provenance.get("control") or {}).get("joints", ()))
    given = provenance.get(GROUPS)
    if given is None:
        return Labels(joints)
    if isinstance(given, str) or not all(isinstance(group, (list, tuple)) for group in given):
        raise ValueError(f"{GROUPS} must be lists of names")
    return Labels(joints, tuple(tuple(str(name) for name in group) for group in given))


def shapes_of(world: World) -> list[tuple[str, str]]:
    """Body and name of every shape of the world, by its number."""
    return [(body.name, shape.name) for body in world.bodies for shape in body.shapes]


def side_names(world: World, labels: Labels) -> list[str]:
    """The label of every number of a contact's side: names of shapes, then of groups. Raises ValueError for groups of shapes
    that there are not, of several bodies, or that are given twice."""
    body_of = {name: body for body, name in shapes_of(world)}
    names = list(body_of)
    for group in labels.groups or ():
        bodies = {body_of.get(name) for name in group}
        if len(group) < 2 or len(bodies) != 1 or None in bodies:
            raise ValueError(f"{GROUPS}: {', '.join(group)[:200] or 'an empty one'} are not several shapes of one body")
        names.append(SEPARATOR.join(group))
    if len(set(names)) < len(names):
        raise ValueError(f"{GROUPS}: the same group twice")
    return names


def contact_sides(
    world: World, units: Sequence[Mapping[str, Any]], values: NDArray[np.int64]
) -> tuple[NDArray[np.int64], list[list[str]]]:
    """The sides (contacts, 2) of contacts, and the groups that they refer to, from the collision units (``body``, ``shapes``)
    that an engine reports and its indices ``reported`` (contacts, 2)."""
    order = {name: number for number, (_, name) in enumerate(shapes_of(world))}
    number: dict[tuple[str, ...], int] = {(name,): place for name, place in order.items()}
    groups: list[list[str]] = []
    used = np.zeros(len(units), dtype=bool)
    for part in parts(len(values), 16, values):
        used[values[part]] = True
    side = np.full(len(units), -1, dtype=np.int64)
    for index in np.flatnonzero(used).tolist():
        shapes = tuple(sorted(set(units[index]["shapes"]), key=order.__getitem__))
        if shapes not in number:
            number[shapes] = len(order) + len(groups)
            groups.append(list(shapes))
        side[index] = number[shapes]
    sides = zeros(values.shape, int)
    for part in parts(len(values), 32, values, sides):
        sides[part] = side[values[part]]
    return sides, groups
