"""Bodies between the joints of a body that has several: without mass and shapes, they carry the next joint.

A body with the joints `steer` and `spin` stands in the world as two: `wheel.steer`, which the first joint moves, and `wheel`,
which the second one moves against it. No name in a spec has a point, so no other body is called so.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence

from simspec.world.tuples import ordered
from simspec.world.types import Body


def carrier_name(body: str, joint: str) -> str:
    """The name of what a joint moves that is not the last of its body's."""
    return f"{body}.{joint.rpartition('/')[2]}"


def is_carrier(name: str) -> bool:
    """Whether a body of this name stands between two joints of another."""
    return "." in name


def shown_as(name: str, names: Container[str]) -> str:
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
            pairs.add(ordered(body.name, above))
        while above is not None and is_carrier(above):
            above = parents[above]
        if above is not None:
            pairs.add(ordered(body.name, above))
    return pairs
