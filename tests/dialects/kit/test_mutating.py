"""The mutators change everything that stands in a file, one thing at a time, and put it back."""

from __future__ import annotations

import json
from collections import Counter

import pytest

from simspec.dialects.kit.mutating import mutations
from simspec.dialects.kit.mutations import KINDS, FileAddition, Inert, MutationTable

XML = '<root name="r"><a name="one" size="1 0" on="true"/><a name="two" size="1 2" on="true"/><m> 3 </m></root>'
SIDE = {"flag": True, "list": [1.5, 2.5], "word": "x", "empty": None, "count": 0}


NOTHING = MutationTable()


def made(table: MutationTable = NOTHING, files: dict[str, str] | None = None):
    return list(mutations(files or {"model.xml": XML, "sidecar.json": json.dumps(SIDE)}, table))


def changes(found, site):
    return Counter(entry.kind for entry in found if entry.site == site)


def test_every_number_of_xml_is_changed_in_every_way():
    found = made()
    assert changes(found, "a@size") == {
        "scaled": 3,
        "moved": 1,
        "sign": 3,
        "swapped": 3,  # within each of the lists, and one list with the other
        "number dropped": 2,
        "attribute removed": 2,
    }
    assert changes(found, "m/text()") == {"scaled": 1, "sign": 1}
    assert changes(found, "a@on") == {"flag": 2, "attribute removed": 2}
    assert changes(found, "a") == {"element removed": 2, "element doubled": 2}
    assert changes(found, "a@name") == {"word": 4, "attribute removed": 2, "swapped": 1}


def test_every_field_of_json_is_changed_in_every_way():
    found = made()
    assert changes(found, "list.*") == {
        "scaled": 2,
        "sign": 2,
        "element doubled": 2,
        "element removed": 2,
        "swapped": 1,
    }
    assert changes(found, "flag") == {"flag": 1, "field removed": 1}
    assert changes(found, "word") == {"word": 1, "field removed": 1}
    assert changes(found, "empty") == {"moved": 1, "field removed": 1}
    assert changes(found, "count") == {"moved": 1, "field removed": 1}


def test_each_mutation_is_a_distinct_single_change_of_the_file():
    found = made()
    assert len({(entry.file, entry.text) for entry in found}) == len(found)
    assert len({entry.name for entry in found}) == len(found)
    assert {entry.kind for entry in found} <= set(KINDS)
    unchanged = json.loads(json.dumps(SIDE))
    for entry in found:
        if entry.file == "sidecar.json":
            differing = [key for key in unchanged if json.loads(entry.text).get(key, "gone") != unchanged[key]]
            assert len(differing) == 1, entry


def test_words_integers_and_zeros_are_as_the_table_says():
    table = MutationTable(words={"a@on": ("perhaps",)}, integers=frozenset({"m/text()"}), moved={"a@size": "7"})
    found = made(table)
    assert [entry.change for entry in found if entry.site == "m/text()"] == ["[0] 3 to 4", "[0] 3 to -3"]
    assert changes(found, "a@on")["word"] == 2
    assert '"1 7"' in next(entry.text for entry in found if entry.kind == "moved" and entry.site == "a@size")


def test_possible_elements_and_attributes_are_added_to_each_place():
    rows = (
        FileAddition("a", "5", "more"),
        FileAddition("a", "5", "size"),
        FileAddition("root", '<b of="{a[1]}"/>'),
        FileAddition("root", '<b of="{a[2]}"/>'),
        FileAddition("a", "<c/>", once=True),
    )
    alongside = (FileAddition("", "1", "fresh"), FileAddition("list", "3.5"))
    found = made(MutationTable(additions={"*.xml": rows, "sidecar.json": alongside}))
    added = [(entry.kind, entry.site, entry.change) for entry in found if "added" in entry.kind]
    assert Counter(added) == {
        ("attribute added", "a@more", "5"): 2,
        ("element added", "root/b", '<b of="two"/>'): 1,
        ("element added", "a/c", "<c/>"): 1,
        ("field added", "fresh", "1"): 1,
        ("field added", "list", "3.5"): 1,
    }


@pytest.mark.parametrize(
    ("row", "declared"),
    [
        (Inert("a@*", "why"), True),
        (Inert("a@size", "why", ("scaled",)), True),
        (Inert("a@size", "why", ("sign",)), False),
        (Inert("m*", "why"), False),
        (Inert("a@size", "why", file="other.xml"), False),
        (Inert("a@size", "why", without=".//m"), False),
        (Inert("a@size", "why", without=".//q"), True),
    ],
)
def test_mutations_match_their_inert_declaration(row, declared):
    mutation = next(entry for entry in made() if entry.site == "a@size" and entry.kind == "scaled")
    assert (MutationTable(inert=(row,)).inertness(mutation) is row) == declared


def test_other_files_are_refused():
    with pytest.raises(ValueError, match=r"notes\.txt is neither"):
        made(files={"notes.txt": "plain"})
