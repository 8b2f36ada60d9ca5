""".wbt as a language of its own: written whole, read again with lines, and refused by file and line where it is none."""

from __future__ import annotations

import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.formats.wbt import reading
from simspec.formats.wbt.format import NODES, WORLD, Wbt, WbtNodeTree, WbtWorld, quoted
from simspec.formats.wbt.reading import WbtNode, parse

HEAD = "#VRML_SIM R2023b utf8\n"
TREE = WbtWorld(
    (
        WbtNodeTree("WorldInfo", {"title": 'a "b" \\ c', "info": ("x", "y z"), "gravity": 9.81}),
        WbtNodeTree(
            "Solid",
            {
                "name": "body",
                "translation": (1.0, -2.5e-17, 3.0),
                "children": (
                    WbtNodeTree("Pose", {"children": (WbtNodeTree("Shape", {"geometry": WbtNodeTree("Sphere")}),)}),
                    WbtNodeTree("Solid"),
                ),
                "physics": WbtNodeTree("Physics", {"centerOfMass": ((1.0, 2.0, 3.0),)}),
            },
            "body_0",
        ),
    )
)


def test_written_files_are_read(tmp_path):
    (tmp_path / WORLD).write_text(Wbt().write(TREE)[WORLD], encoding="utf-8")
    document = Wbt().read(tmp_path)
    info, solid = document.nodes
    assert (document.version, info.kind, solid.label) == ("R2023b", "WorldInfo", "body_0")
    assert (info.text("title"), info.field("info").values) == ('a "b" \\ c', ("x", "y z"))
    assert solid.numbers("translation", 3) == (1.0, -2.5e-17, 3.0)
    pose, inner = solid.nodes("children")
    assert (pose.kind, inner.kind, inner.text("name")) == ("Pose", "Solid", "solid")
    assert solid.node("physics").numbers("centerOfMass", 3) == (1.0, 2.0, 3.0)
    assert solid.node("boundingObject") is None
    assert solid.flag("locked") is False
    lines = Wbt().write(TREE)[WORLD].split("\n")
    for node in document.walk():
        assert node.kind in lines[node.line - 1]
        for field in node.fields:
            assert lines[field.line - 1].split()[0] == field.name


def test_every_field_of_every_node_is_written():
    text = Wbt().write(WbtWorld(tuple(WbtNodeTree(kind) for kind in NODES)))[WORLD]
    read = {node.kind: {field.name for field in node.fields} for node in parse(text, WORLD).nodes}
    assert read == {kind: set(fields) for kind, fields in NODES.items()}


def test_unknown_fields_numbers_and_texts_are_not_written():
    with pytest.raises(KeyError, match="Solid has no field colour"):
        Wbt().write(WbtWorld((WbtNodeTree("Solid", {"colour": 1.0}),)))
    with pytest.raises(ValueError, match="cannot be written"):
        Wbt().write(WbtWorld((WbtNodeTree("Sphere", {"radius": float("nan")}),)))
    with pytest.raises(ValueError, match="letters that no text"):
        quoted("two\nlines")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", r"world\.wbt:1: should begin with"),
        ("Solid {\n}\n", r"world\.wbt:1: should begin with"),
        ("#VRML V2.0 utf8\nSolid {\n}\n", r"world\.wbt:1: should begin with"),
        (HEAD + "Solid {\n  name", r"world\.wbt:3: Solid of line 2 does not end"),
        (HEAD + 'Solid {\n  name "a\n', r"world\.wbt:3: a text that does not end"),
        (HEAD + "Solid {\n  mass 1e999\n}\n", r"world\.wbt:3: mass has 1e999, which is not finite"),
        (HEAD + "Solid {\n  mass 1\n  mass 2\n}\n", r"world\.wbt:4: Solid has the field mass twice"),
        (HEAD + 'EXTERNPROTO "a.proto"\n', r"world\.wbt:2: EXTERNPROTO takes a node from another file"),
        (HEAD + "PROTO A [\n]\n", r"world\.wbt:2: PROTO defines a node"),
        (HEAD + "Solid {\n  physics USE A\n}\n", r"world\.wbt:3: USE repeats a node"),
        (HEAD + "Solid {\n  mass IS mass\n}\n", r"world\.wbt:3: IS is of a PROTO"),
        (HEAD + "DEF 7 Solid {\n}\n", r"world\.wbt:2: '7', should be a name after DEF"),
        (HEAD + "DEF", r"world\.wbt:2: the end, should be a name after DEF"),
        (HEAD + "Solid", r"world\.wbt:2: 'Solid' is no value and no node"),
        (HEAD + "Solid {\n  mass one\n}\n", r"world\.wbt:3: 'one' is no value and no node"),
        (HEAD + "Solid {\n  children [ [ 1 ] ]\n}\n", r"world\.wbt:3: '\[', should be a value or a node"),
        (HEAD + "Solid {\n  ]\n}\n", r"world\.wbt:3: '\]' stands where a field of Solid should be"),
        (HEAD + "}\n", r"world\.wbt:2: '}', should be a value or a node"),
        (HEAD + "Solid {\n  1 2\n}\n", r"world\.wbt:3: '1' stands where a field of Solid should be"),
    ],
)
def test_damaged_wbt_files_are_refused_with_the_line(text, said, tmp_path):
    (tmp_path / WORLD).write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=said):
        Wbt().read(tmp_path)


def test_unreadable_files_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError):
        Wbt().read(tmp_path)
    (tmp_path / WORLD).write_bytes(HEAD.encode() + b'Solid {\n name "\xff"\n}')
    with pytest.raises(ValueError, match=r"world\.wbt:3: is not UTF-8"):
        Wbt().read(tmp_path)
    (tmp_path / WORLD).unlink()
    (tmp_path / WORLD).mkdir()
    with pytest.raises(SpecError, match=r"world\.wbt"):
        Wbt().read(tmp_path)


@pytest.mark.parametrize(
    ("bound", "most", "text", "said"),
    [
        ("MOST_NODES", 3, "A {\n}\n" * 4, "more than 3 nodes"),
        ("MOST_DEPTH", 3, "A { a " * 4 + "1" + " }" * 4, "more than 3 nodes in one another"),
        ("MOST_VALUES", 3, 'A { a [ 1 2 TRUE "b" ] }', "more than 3 values"),
    ],
)
def test_hostile_files_end_at_a_bound(bound, most, text, said, monkeypatch):
    monkeypatch.setattr(reading, bound, most)
    with pytest.raises(ValueError, match=said):
        parse(HEAD + text, WORLD)


def test_depth_costs_no_recursion_and_little_memory():
    depth = reading.MOST_DEPTH
    tracemalloc.start()
    document = parse(HEAD + "A { a " * depth + "NULL" + " }" * depth, WORLD)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert sum(1 for _ in document.walk()) == depth
    assert peak < 2000 * depth


_TEXT = st.text(st.sampled_from('#VRML_SIMR2023bu \n[]{}"\\.,0123456789eE+-DEFUSENULTRAaz'), max_size=200)


@given(_TEXT)
@settings(max_examples=150, deadline=None)
def test_any_text_is_read_or_refused_with_a_line(text):
    said = ""
    try:
        document = parse(HEAD + text, WORLD)
    except ValueError as error:
        said = str(error)
    assert said.startswith(f"{WORLD}:") if said else all(isinstance(node, WbtNode) for node in document.walk())
