"""Every mutation of a folder's files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from simspec.dialects.kit.file_mutations import (
    MutableTree,
    json_mutations,
    obj_mutations,
    printed,
    vrml_mutations,
    xml_mutations,
)
from simspec.dialects.kit.mutations import Files, Mutation, MutationTable


def mutations(files: Files, table: MutationTable) -> Iterator[Mutation]:
    """Every mutation of ``files``, each once; those that change no byte are left out. Raises ValueError for a file that is
    neither XML, JSON, OBJ nor of VRML's manner."""
    for name, text in sorted(files.items()):
        seen = {unchanged_text(name, text)}
        for mutation in _made(name, text)(name, text, table):
            if mutation.text not in seen:
                seen.add(mutation.text)
                yield mutation


def unchanged_text(name: str, text: str) -> str:
    """The text of a file as its mutations have it where they do not change it. Raises ValueError as :func:`mutations`."""
    made = _made(name, text)
    if made is json_mutations:
        return printed(json.loads(text))
    return text if made in (obj_mutations, vrml_mutations) else MutableTree(text).text()


def _made(name: str, text: str) -> Callable[[str, str, MutationTable], Iterator[Mutation]]:
    if name.endswith(".json"):
        return json_mutations
    if name.endswith(".obj"):
        return obj_mutations
    if text.startswith("#VRML"):
        return vrml_mutations
    if text.lstrip().startswith("<"):
        return xml_mutations
    raise ValueError(f"{name} is neither XML, JSON, OBJ nor VRML")


# Several mutations of the same files at once, where they are in different elements.

BRACKETS: Mapping[str, tuple[str, str]] = {".json": ("[{", "]}"), ".obj": ("\n", "\n")}
"""By the end of a file's name what begins and ends the innermost part that a change belongs to; of XML files the tag."""
TAG = ("<", ">")


@dataclass(frozen=True, slots=True)
class Edit:
    """A mutation as an edit of the unchanged text: ``text`` replaces the range from ``start`` to ``stop``. The range from
    ``low`` to ``high`` is the tag, list, mapping or line that contains the edit, or all that it touches."""

    mutation: Mutation
    start: int
    stop: int
    text: str
    low: int
    high: int


class Together:
    """Mutations of ``files`` that are made together."""

    def __init__(self, files: Files):
        self._unchanged = {name: unchanged_text(name, text) for name, text in files.items()}

    def unchanged(self, file: str) -> str:
        """The text of a file as mutations have it where they do not change it."""
        return self._unchanged[file]

    def groups(self, mutations: Iterable[Mutation]) -> list[list[Mutation]]:
        """Each of ``mutations`` in the first group of which none changes the same element, or one around it."""
        groups: list[list[Edit]] = []
        for mutation in mutations:
            edit = self._edit(mutation)
            fitting = (group for group in groups if all(_are_disjoint(edit, other) for other in group))
            group = next(fitting, None)
            if group is None:
                groups.append(group := [])
            group.append(edit)
        return [[edit.mutation for edit in group] for group in groups]

    def files(self, group: Sequence[Mutation]) -> dict[str, str]:
        """The texts of the files that a group changes."""
        texts: dict[str, str] = {}
        edits = sorted((self._edit(mutation) for mutation in group), key=lambda edit: edit.start, reverse=True)
        for edit in edits:
            file = edit.mutation.file
            text = texts.get(file, self._unchanged[file])
            texts[file] = text[: edit.start] + edit.text + text[edit.stop :]
        return texts

    def _edit(self, mutation: Mutation) -> Edit:
        before, after = self._unchanged[mutation.file], mutation.text
        start = _same(before, after)
        most = min(len(before), len(after)) - start
        end = _same(before[::-1], after[::-1], most)
        stop = len(before) - end
        ending = next((ending for ending in BRACKETS if mutation.file.endswith(ending)), "")
        opening, closing = BRACKETS.get(ending, TAG)
        # where something is doubled, the same text may come from several places
        first = min(start, min(len(before), len(after)) - _same(before[::-1], after[::-1]))
        low = _outwards(before, range(first - 1, -1, -1), opening, closing, 0)
        high = _outwards(before, range(stop, len(before)), closing, opening, len(before))
        return Edit(mutation, start, stop, after[start : len(after) - end], low, high)


def _outwards(text: str, way: range, closing: str, opening: str, end: int) -> int:
    """Where the part that a way begins in is left, by the first mark of ``closing`` that closes none of ``opening`` on the way;
    ``end`` where it is not."""
    depth = 0
    nested = closing not in TAG  # between two tags the part is that from the one to the other
    for at in way:
        if text[at] in closing:
            if depth == 0:
                return at
            depth -= 1
        elif nested and text[at] in opening:
            depth += 1
    return end


def _are_disjoint(edit: Edit, other: Edit) -> bool:
    return edit.mutation.file != other.mutation.file or edit.high < other.low or other.high < edit.low


def _same(name: str, other: str, most: int | None = None) -> int:
    """How many characters two texts begin with in common, of at most so many."""
    low, high = 0, min(len(name), len(other)) if most is None else most
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if name[low:middle] == other[low:middle] else (low, middle - 1)
    return low
