"""Reading YAML: places, YAML 1.2 values, and hostile input."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from simspec.errors import SpecError
from simspec.language.document import DEEPEST, LARGEST_FILE, parse, read, scalar


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1), ("-7", -7), ("0x10", 16), ("0o17", 15), ("1.5", 1.5), (".5", 0.5), ("1e3", 1000.0), ("1.", 1.0),
        ("true", True), ("False", False), ("null", None), ("~", None), ("", None),
        ("yes", "yes"), ("on", "on"), ("1 ms", "1 ms"), ("1:30", "1:30"), ("1_000", "1_000"), ("-", "-"), ("1e", "1e"),
    ],
)  # fmt: skip
def test_scalars_of_yaml_1_2(text, value):
    found = scalar(text)
    assert found == value
    assert type(found) is type(value)


@given(st.integers(-(10**30), 10**30) | st.floats(allow_nan=False, allow_infinity=False) | st.booleans())
def test_scalars_agree_with_an_independent_reader(value):
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    assert scalar(text) == YAML(typ="safe", pure=True).load(text)


def test_places_of_keys_and_values():
    document = parse("a: 1\nb:\n  c: [1, 2]\n  d: {e: 5}\n", "f")
    assert str(document.locate(("a",))) == "f:1:4"
    assert str(document.locate(("a",), key=True)) == "f:1:1"
    assert str(document.locate(("b", "c", 1))) == "f:3:10"
    assert str(document.locate(("b", "d", "e"))) == "f:4:10"
    assert str(document.locate(("b", "d", "missing", "deeper"))) == "f:4:3"


@pytest.mark.parametrize(
    ("text", "message", "place"),
    [
        ("a: 1\nb: 2\na: 3", "the key 'a' is duplicated", "3:1"),
        ("a: &x 1", "anchors are not allowed", "1:4"),
        ("a: [1]\nb: *x", "not YAML|aliases are not allowed", "2:4"),
        ("a: !!python/object:os.system 1", "tags are not allowed", "1:4"),
        ("a: !mine {b: 1}", "tags are not allowed", "1:4"),
        ("a: .nan", "numbers must be finite", "1:4"),
        ("a: -.inf", "numbers must be finite", "1:4"),
        ("a: 1e999", "numbers must be finite", "1:4"),
        ("a: " + "9" * 5000, "numbers must be finite", "1:4"),
        ("? [a]\n: 1", "a key must be a string", "1:3"),
        ("? {a: 1}\n: 1", "a key must be a string", "1:3"),
        ("a: 1\n---\nb: 1", "only one YAML document per file", "2:1"),
        ("a:\n\t- 1", "tab", "2:1"),
        ("a: [1, 2", r"not YAML: the \[ of line 1 is not closed", "1:9"),
        ("a: {b: 1\nc: 2\n", "not YAML: the { of line 1 is not closed", "2:2"),
        ("a: 'x", "not YAML: the quote that begins in line 1 does not end", "1:6"),
        ("a:\n    b: 1\n  c: 2\n", "not YAML: this line is indented by 2 spaces, the lines above by 0, 4", "3:3"),
        ("a: b: c", "not YAML: a second colon in a line", "1:5"),
        (
            "a:\n  b: 1\nc:\n  d: 1\n e: 1\n",
            "not YAML: this line is indented by 1 spaces, the lines above by 0, 2",
            "5:2",
        ),
        (
            "a:\n  b: {}\nc:\n    d: 1\n  e: 1\n",
            "the block before it in line 3 by 0\n.*indent line 3, c, and its",
            "5:3",
        ),
        ("a:\n  b: x\n   c: 1\n", "indented by 3 spaces, line 2 above it, which is complete, by 2", "3:5"),
        ("a:\n  b: 1\nc\nd:\n  e: 1\n", "not YAML: line 3 has no colon after its key", None),
        ("a:\n\tb: 1", "not YAML: a tab in the indentation", "2:1"),
        ("a: \x01", "does not allow: U\\+0001", "1:4"),
        ("[" * (DEEPEST + 1), "nested deeper", None),
        ("{a: " * 100_000, "nested deeper", None),
        ("- " * 100_000, "nested deeper", None),
    ],
)
def test_refused_with_its_place(text, message, place):
    try:
        problems = parse(text, "f").problems
    except SpecError as error:
        problems = error.problems
    found = next(problem for problem in problems if re.search(message, str(problem)))
    assert found.location is not None
    if place is not None:
        assert str(found.location) == f"f:{place}"


def test_a_bomb_of_aliases_is_refused_before_it_grows():
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 30)]
    document = parse("\n".join(lines), "f")
    assert len(document.problems) == 30 + 290
    assert len(document.data["a29"]) == 10


def test_a_file_that_is_too_large_is_not_read(tmp_path):
    path = tmp_path / "big.yaml"
    with path.open("wb") as file:
        file.truncate(LARGEST_FILE + 40_000_000)
    with pytest.raises(SpecError, match="too large"):
        read(path)


@pytest.mark.parametrize("kind", ["a FIFO", "a device", "a folder"])
def test_only_regular_files_are_read(kind, tmp_path):
    path = tmp_path / "some.yaml"
    {"a FIFO": os.mkfifo, "a device": lambda at: at.symlink_to("/dev/zero"), "a folder": os.mkdir}[kind](path)
    with pytest.raises(SpecError, match=f"some.yaml: cannot be read: {kind}, not a regular file"):
        read(path)


def test_not_utf8_names_the_byte(tmp_path):
    path = tmp_path / "latin.yaml"
    path.write_bytes("simspec: 1\nname: caf\xe9\n".encode("latin-1"))
    with pytest.raises(SpecError, match="not UTF-8 at byte 20") as error:
        read(path)
    assert str(error.value.problems[0].location) == f"{path}:2:10"


def test_a_byte_order_mark_and_windows_line_ends_are_read(tmp_path):
    path = tmp_path / "windows.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    document = read(path)
    assert document.data == {"a": 1, "b": 2}
    assert str(document.locate(("b",))) == f"{path}:2:4"


def test_missing_file_and_folder(tmp_path):
    for path in (tmp_path / "no.yaml", tmp_path):
        with pytest.raises(SpecError, match="cannot be read"):
            read(path)


_SCALARS = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()


_KEYS = st.text(max_size=50)  # YAML allows no key of more than 1,024 characters on the line of its value
_DATA = st.recursive(_SCALARS, lambda inner: st.lists(inner, max_size=5) | st.dictionaries(_KEYS, inner, max_size=5))


@given(st.dictionaries(_KEYS, _DATA, max_size=5))
def test_plain_data_comes_back(data):
    """JSON is YAML: the reader reads the output of json."""
    document = parse(json.dumps(data), "f")
    found = [problem for problem in document.problems if "finite" not in str(problem)]
    assert not found
    assert _same(document.data, data)


def _same(found, wanted):
    if isinstance(wanted, float):
        return found == wanted or math.isclose(found, wanted)
    if isinstance(wanted, dict):
        return found.keys() == wanted.keys() and all(_same(found[key], wanted[key]) for key in wanted)
    if isinstance(wanted, list):
        return len(found) == len(wanted) and all(map(_same, found, wanted))
    return found == wanted or (isinstance(wanted, int) and len(str(wanted)) > 300)


@given(st.text(alphabet="ab:-[]{},#&*!|>'\"%@` \n\t?0123.\\\x00é"))
def test_no_text_makes_it_crash(text):
    """Either a document, or a SpecError with a problem; nothing else."""
    with contextlib.suppress(SpecError):
        parse(text, "f")


def test_half_a_surrogate_pair_is_refused():
    assert parse('a: "\\ud83d\\ude00"', "f").data == {"a": "😀"}
    document = parse('a: "x\\ud83d"', "f")
    assert "surrogate" in str(document.problems[0])
    assert str(document.problems[0].location) == "f:1:4"
