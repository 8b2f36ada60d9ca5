"""Mutations that are made together are in different elements, and each of them is there."""

from __future__ import annotations

import itertools
import json

from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.dialects.kit.mutating import Together, mutations
from simspec.dialects.kit.mutations import MutationTable

FILES = {
    "model.xml": '<root><a name="one" size="1 0"/><b><a name="two" size="1 2"/><a size="1 2"/></b><m>3</m><m>3</m></root>',
    "sidecar.json": json.dumps(
        {"here": 1.5, "in": [{"x": 1.0, "y": [2.0, 2.0]}, {"x": 1.0, "y": [2.0, 2.0]}], "far": 1.5}
    ),
    "mesh.obj": "o some\nv 1 2 3\nv 4 5 6\nv 7 8 9\nv 7 8 0\nf 1 2 3\nf 1 2 4\n",
}
ALL = list(mutations(FILES, MutationTable()))
TOGETHER = Together(FILES)


def test_a_group_of_a_single_mutation_is_that_mutation():
    for mutation in ALL:
        assert TOGETHER.files([mutation]) == {mutation.file: mutation.text}, mutation.name


def test_the_groups_partition_the_mutations():
    names = [mutation.name for group in TOGETHER.groups(ALL) for mutation in group]
    assert sorted(names) == sorted(mutation.name for mutation in ALL)


def groups_of(*kinds_and_places: tuple[str, str]):
    chosen = [
        next(mutation for mutation in ALL if mutation.kind == kind and mutation.place.startswith(place))
        for kind, place in kinds_and_places
    ]
    return [len(group) for group in TOGETHER.groups(chosen)]


def test_mutations_of_an_element_and_its_parents_are_in_separate_groups():
    assert groups_of(("scaled", "root/a[one]@size"), ("scaled", "root/b/a[two]@size")) == [2]
    assert groups_of(("scaled", "root/a[one]@size"), ("word", "root/a[one]@name")) == [1, 1]
    assert groups_of(("scaled", "root/b/a[two]@size"), ("element removed", "root/b")) == [1, 1]
    assert groups_of(("scaled", "root/m"), ("element doubled", "root/m[0]")) == [1, 1]
    assert groups_of(("scaled", "in.0.x"), ("scaled", "in.1.x")) == [2]
    assert groups_of(("scaled", "in.0.y.0"), ("scaled", "in.0.y.1")) == [1, 1]
    assert groups_of(("scaled", "here"), ("scaled", "far")) == [1, 1], "of one mapping, whatever stands between"
    assert groups_of(("scaled", "v[0]"), ("scaled", "v[2]")) == [2]
    assert groups_of(("scaled", "v[0]"), ("scaled", "v[1]")) == [1, 1], "of two adjacent lines"
    assert groups_of(("scaled", "v[0]"), ("scaled", "here"), ("scaled", "root/m")) == [3]


@settings(max_examples=20)
@given(st.permutations(ALL))
def test_all_changes_of_a_group_are_in_its_files(order):
    """Undoing one of two, by its own text, gives the other: they do not depend on each other."""
    for group in TOGETHER.groups(order[:40]):
        for first, other in itertools.pairwise(group):
            both = TOGETHER.files([first, other])
            if first.file != other.file:
                assert both == {first.file: first.text, other.file: other.text}
            else:
                plain = len(TOGETHER.unchanged(first.file))
                assert len(both[first.file]) - plain == (len(first.text) - plain) + (len(other.text) - plain)
                assert both[first.file] not in (first.text, other.text)
                assert both == TOGETHER.files([other, first])
