"""Bodies between the joints of a body that has several: without mass and shapes, they carry the next joint.

A body with the joints `steer` and `spin` stands in the world as two: `wheel.steer`, which the first joint moves, and `wheel`,
which the second one moves against it. No name in a spec has a point, so no other body is called so.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from simspec.world.derived import derived
from simspec.world.tuples import sorted_pair
from simspec.world.types import Body, Follow, Inertial, World

CARRYING: Final = ("hinge", "slide")
"""Joints that further ones of the same body may follow."""


def carrier_name(body: str, joint: str) -> str:
    """The name of what a joint moves that is not the last of its body's."""
    return f"{body}.{joint.rpartition('/')[2]}"


def is_carrier(name: str) -> bool:
    """Whether a body of this name stands between two joints of another."""
    return "." in name


def display_name(name: str, names: Container[str]) -> str:
    """The body that tables show for one of this name: the one whose joint it carries, where ``names`` has that."""
    owner = owner_of(name)
    return owner if owner in names else name


def owner_of(name: str) -> str:
    """The body of the spec that a body of this name belongs to: itself, or the one whose joint it carries."""
    return name.partition(".")[0]


def joined(bodies: Sequence[Body]) -> set[tuple[str, str]]:
    """The sorted pairs of bodies that joints join: each with its parent, and across the carriers between joints of one body."""
    parents: Mapping[str, str | None] = {body.name: body.joint.parent for body in bodies}
    pairs = set()
    for body in bodies:
        above = body.joint.parent
        if above is not None:
            pairs.add(sorted_pair(body.name, above))
        while above is not None and is_carrier(above):
            above = parents[above]
        if above is not None:
            pairs.add(sorted_pair(body.name, above))
    return pairs


@derived
def absorbed(world: World) -> Mapping[str, str]:
    """By the name of each carrier of :func:`carried` the body that it may be one with."""
    return MappingProxyType({carrier.name: body for body, row in carried(world).items() for carrier in row})


@derived
def carried(world: World) -> Mapping[str, tuple[Body, ...]]:
    """By the name of each body with several joints the carriers above it, the parent's side first: those that have nothing but
    their joint, so that they and the body may stand as one body with several joints."""
    known = {body.name: body for body in world.bodies}
    below: dict[str | None, int] = {}
    for body in world.bodies:
        below[body.joint.parent] = below.get(body.joint.parent, 0) + 1
    held = {
        end for one in world.constraints if not isinstance(one, Follow) for end in (one.first, one.second)
    }  # of carriers only in worlds that are made in Python
    rows: dict[str, tuple[Body, ...]] = {}
    for body in world.bodies:
        row: list[Body] = []
        above = body.joint.parent if body.joint.kind in (*CARRYING, "ball") else None
        while above is not None and is_carrier(above) and owner_of(above) == body.name:
            carrier = known[above]
            alone = below[above] == 1 and above not in held and not carrier.shapes
            if not alone or carrier.inertial != Inertial(0.0) or carrier.joint.kind not in CARRYING:
                break
            row.insert(0, carrier)
            above = carrier.joint.parent
        if row:
            rows[body.name] = tuple(row)
    return MappingProxyType(rows)
