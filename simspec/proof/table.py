"""A table of the laws of materials, as an engine holds it, against the world's."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from simspec.language.vocabulary import LAW_QUANTITIES
from simspec.proof.distances import relative
from simspec.world.types import PairContact

Difference = tuple[str, float | None, str, str]
"""What is compared, how far it is off (None: of another kind), where, and what was found."""
HARDNESS_NUMBERS = ("time_constant", "damping_ratio", "stiffness", "damping")


def table_differences(
    laws: Mapping[tuple[str, str], PairContact], table: Sequence[PairContact]
) -> Iterator[Difference]:
    """What a table says of every two materials that meet, whose laws are ``laws`` by their sorted names: one row for each and
    none beside them."""
    names = [(law.first, law.second) for law in table]
    whole = sorted(names) == sorted(laws)  # a pair that is held twice is one too many
    found = "" if whole else f"{sorted(names)}, should be {sorted(laws)}"
    yield "laws of materials", 0.0 if whole else None, "contact.pairs", found
    for held in table:
        law = laws.get((held.first, held.second))
        if law is None:
            continue
        at = f"contact.pairs.{held.first}.{held.second}"
        for quantity in LAW_QUANTITIES:
            wanted, actual = getattr(law, quantity), getattr(held, quantity)
            yield quantity.replace("_", " "), relative(wanted, actual), at, f"{actual!r}, should be {wanted!r}"
        same = (law.collide, law.margin, law.hardness.kind) == (held.collide, held.margin, held.hardness.kind)
        yield "kind of law", 0.0 if same else None, at, "" if same else f"{held}, should be {law}"
        for name in HARDNESS_NUMBERS:
            wanted, actual = getattr(law.hardness, name), getattr(held.hardness, name)
            yield "hardness", relative(wanted, actual), at, f"{actual!r}, should be {wanted!r}"
