"""Every change that a mesh file can suffer, one at a time; see ``mutations.py``.

A file of a hull is a list of lines: those of one kind (``v``, ``f``) are one site, since each is as good as any other. Numbers
are changed in every vertex; of triangles, which follow from the vertices, in the first.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from simspec.dialects.kit.mutations import Inert, Mutation, MutationTable, text_values

SPIKE = "v 0.9 0.8 0.7"
"""A vertex outside every hull of the self-test's worlds."""

INERT = (
    Inert(
        "obj/f",
        "the same triangles in another order, whose sums differ by round-off",
        ("swapped",),
        "*.obj",
        within=1e-9,
    ),
    Inert("obj/o", "a name that nothing refers to", ("word", "element removed", "element doubled"), "*.obj"),
)
"""Changes that no engine moves differently for: rows of every dialect that has mesh files."""


def obj_mutations(file: str, text: str, table: MutationTable) -> Iterator[Mutation]:
    """Every mutation of one OBJ file: numbers of lines, lines removed, doubled and swapped, and lines added."""
    lines = text.splitlines()

    def made(kind: str, site: str, place: str, change: str, changed: list[str]) -> Mutation:
        return Mutation(file, kind, site, place, change, "\n".join(changed) + "\n")

    for word in dict.fromkeys(line.split()[0] for line in lines if line and not line.startswith("#")):
        at = [index for index, line in enumerate(lines) if line.split()[0] == word]
        for order, index in enumerate(at):
            place, values = f"{word}[{order}]", lines[index].partition(" ")[2]
            if word == "v" or order == 0:
                for kind, what, new in text_values(values, f"obj/{word}", (), table):
                    yield made(kind, f"obj/{word}", place, what, [*lines[:index], f"{word} {new}", *lines[index + 1 :]])
            yield made("element removed", f"obj/{word}", place, "", [*lines[:index], *lines[index + 1 :]])
            yield made("element doubled", f"obj/{word}", place, "", [*lines[: index + 1], *lines[index:]])
        for one, other in itertools.pairwise(at):
            swapped = list(lines)
            swapped[one], swapped[other] = lines[other], lines[one]
            yield made("swapped", f"obj/{word}", word, f"lines {one + 1} and {other + 1}", swapped)
    yield made("element added", "obj/v", "v", SPIKE, [*lines, SPIKE])
    spike = sum(line.startswith("v ") for line in lines) + 1
    used = [SPIKE, f"f 1 2 {spike}", f"f 2 3 {spike}", f"f 3 1 {spike}"]
    yield made("element added", "obj/v", "v", f"{SPIKE} with triangles", [*lines, *used])
    yield made("element added", "obj/o", "o", "a second object", [*lines, "o more", "v 0.9 0.8 0.7", "v 0.9 0.8 0.8"])
