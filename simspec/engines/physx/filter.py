"""SAPIEN's collision filter: the words of bits by which shapes touch, from the pairs that meet and those that are excluded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

# Collision filter. Each shape has four words of bits; shapes with the words a and b touch where ``(a₀ & b₁ or a₁ & b₀) and
# not (a₂ & b₂ and a₃ = b₃)``. Shapes that touch the same others share a bit of the first two words, up to 32 kinds. Bodies
# that must not touch share a bit of the third: those connected by such pairs have a number in the fourth, and up to 32 bits.

BITS = 32
"""Of a word."""
MOST_NUMBERS = 0xFFFF
"""Of the fourth word only the lower half counts."""
Words = tuple[int, int, int, int]
K = TypeVar("K")


def kinds(keys: Sequence[K], meet: Callable[[K, K], bool]) -> Mapping[K, tuple[int, int]]:
    """The first two words of each of the distinct ``keys``, of which ``meet`` says whether shapes of two touch. Raises
    ValueError where these are more kinds than bits."""
    rows = {key: tuple(meet(key, other) for other in keys) for key in keys}
    number: dict[tuple[bool, ...], int] = {}
    for key in keys:
        if any(rows[key]):
            number.setdefault(rows[key], len(number))
    if len(number) > BITS:
        raise ValueError(f"distinguishes {BITS} kinds of shapes by what they touch, and here are {len(number)}")
    found = {}
    for key in keys:
        if not any(rows[key]):
            found[key] = (0, 0)
            continue
        others = {number[rows[other]] for other, touched in zip(keys, rows[key], strict=True) if touched}
        found[key] = (1 << number[rows[key]], sum(1 << other for other in others))
    return found


def exclusions(pairs: Iterable[tuple[str, str]]) -> Mapping[str, tuple[int, int]]:
    """The last two words of each name of ``pairs``, of bodies that must not touch. Raises ValueError where bits do not do."""
    neighbours: dict[str, set[str]] = {}
    for entry, other in pairs:
        neighbours.setdefault(entry, set()).add(other)
        neighbours.setdefault(other, set()).add(entry)
    found: dict[str, tuple[int, int]] = {}
    number = 0
    for start in sorted(neighbours):
        if start in found:
            continue
        number += 1
        if number > MOST_NUMBERS:
            raise ValueError(f"distinguishes {MOST_NUMBERS} sets of bodies that must not touch, and here are more")
        cliques = _cliques(_reached(start, neighbours), neighbours)
        if len(cliques) > BITS:
            raise ValueError(
                f"has {BITS} bits for bodies that must not touch each other and hang together by such pairs, as {start!r} "
                f"does; here it takes {len(cliques)}"
            )
        for bit, clique in enumerate(cliques):
            for name in clique:
                found[name] = (found.get(name, (0, number))[0] | 1 << bit, number)
    return found


def _reached(start: str, neighbours: Mapping[str, set[str]]) -> list[str]:
    found, queue = {start}, [start]
    for name in queue:
        for other in sorted(neighbours[name] - found):
            found.add(other)
            queue.append(other)
    return queue


def _cliques(names: Sequence[str], neighbours: Mapping[str, set[str]]) -> list[set[str]]:
    """Sets of names, each of which are all neighbours of each other, in which every two neighbours are together once."""
    left = {frozenset((name, other)) for name in names for other in neighbours[name]}
    cliques = []
    for name in names:
        for other in sorted(neighbours[name]):
            if frozenset((name, other)) not in left:
                continue
            clique = {name, other}
            for more in names:
                if more not in clique and clique <= neighbours[more]:
                    clique.add(more)
            left -= {frozenset((a, b)) for a in clique for b in clique if a != b}
            cliques.append(clique)
    return cliques


def touches(a: Sequence[int], b: Sequence[int]) -> bool:
    """Whether shapes with these words touch, of different bodies of which one moves."""
    if a[2] & b[2] and (a[3] & MOST_NUMBERS) == (b[3] & MOST_NUMBERS):
        return False
    return bool(a[0] & b[1] or a[1] & b[0])
