"""Which shapes touch, in MJCF: bit masks of shapes, and excluded pairs of bodies where the masks do not suffice."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from simspec.errors import Problem, UnsupportedError
from simspec.formats.mjcf.tree import Attributes
from simspec.world.contact_pairs import solid_shapes
from simspec.world.types import World

Kind = tuple[str, str]
"""What decides whom a shape may touch: the collision group of its body, and its material."""

FILTER_BITS = 31
"""Kinds of shapes that ``contype`` and ``conaffinity`` can tell apart (the sign bit left alone)."""


def collision_masks(world: World) -> tuple[dict[Kind, Attributes], list[tuple[str, str]]]:
    """``contype`` and ``conaffinity`` of each kind of shape, and pairs of bodies to exclude where masks do not suffice.

    Two shapes touch when (type1 & affinity2) or (type2 & affinity1). Each class of kinds that must not touch
    some other has a bit of its own as its type, and the bits of all classes that it may touch as its affinity: both
    terms are then the same, and their "or" is exactly the wanted matrix. All that touches everything shares the first bit.

    Raises UnsupportedError where there are more classes than bits, and some shapes of two bodies may touch and others not.
    """
    apart = _apart(world)
    kinds = sorted({(body.collision_group, shape.material) for body in world.bodies for shape in solid_shapes(body)})
    rows = {kind: frozenset(other for other in kinds if apart(kind, other)) for kind in kinds}
    # kinds that keep apart from the same others are one class: they touch each other all or not at all
    classes = sorted({row: kind for kind, row in reversed(rows.items()) if row}.values())
    if not classes:
        return dict.fromkeys(kinds, ()), []
    if len(classes) >= FILTER_BITS:
        return dict.fromkeys(kinds, ()), _bodies_apart(world, rows)
    bit_of_row = {rows[kind]: index for index, kind in enumerate(classes, 1)} | {frozenset(): 0}

    def mask(kind: Kind) -> Attributes:
        # the first bit stands for all that touches everything, and stays set when no such shape is there
        affinity = 1 | sum(1 << bit_of_row[rows[other]] for other in classes if other not in rows[kind])
        return (("contype", 1 << bit_of_row[rows[kind]]), ("conaffinity", affinity))

    return {kind: mask(kind) for kind in kinds}, []


def _apart(world: World) -> Callable[[Kind, Kind], bool]:
    ignored = set(world.contact.ignored_groups)
    passing = {(pair.first, pair.second) for pair in world.contact.pairs if not pair.collide}

    def apart(one: Kind, other: Kind) -> bool:
        groups, materials = (tuple(sorted(names)) for names in zip(one, other, strict=True))
        return groups in ignored or materials in passing

    return apart


def _bodies_apart(world: World, rows: Mapping[Kind, frozenset[Kind]]) -> list[tuple[str, str]]:
    """Pairs of bodies none of whose shapes touch; only bodies that keep apart from some kind are looked at."""
    members: dict[frozenset[Kind], list[str]] = {}
    for body in world.bodies:
        kinds = frozenset((body.collision_group, shape.material) for shape in solid_shapes(body))
        if kinds:
            members.setdefault(kinds, []).append(body.name)
    found: list[tuple[str, str]] = []
    for one, names in members.items():
        for other, others in members.items():
            apart = [b in rows[a] for a in one for b in other]
            if not any(apart):
                continue
            pairs = {(min(a, b), max(a, b)) for a in names for b in others if a != b}
            if pairs and not all(apart):
                raise UnsupportedError([_too_many_classes(*min(pairs))])
            found.extend(pairs)
    return sorted(set(found))


def _too_many_classes(first: str, second: str) -> Problem:
    return Problem(
        f"some shapes of {first!r} and {second!r} may touch and others not, and MJCF's masks distinguish only "
        f"{FILTER_BITS - 1} classes of shapes",
        "contact",
        hint="use fewer groups that ignore others and fewer materials that pass through others, or one material for a body",
    )
