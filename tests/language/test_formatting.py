"""The canonical layout: stable, the same meaning, every comment."""

# ruff: noqa: E501 (tables of cases)
from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simspec.errors import SpecError
from simspec.language.document import parse
from simspec.language.formatting import WIDTH, format_data, format_file, format_text

ROOT = Path(__file__).parents[2]
FILES = sorted([*(ROOT / "specs").rglob("*.yaml"), *(Path(__file__).parent / "data").rglob("*.yaml")])

UNTIDY = """\
# about the file
# twice

# about the name
name: x   # the name
simspec:   1
expect:
- energy_conserved: {tolerance: 1 %}  # e
-   energy_never_rises:   # f
      tolerance: "2 %"
bodies:

  # first
  a: # the a
    shapes: [ {material: s, # why
       sphere: {radius: 1.50}}]  # list
    # after the shapes
  # the end of the bodies


  b: {mass: 1, inertia: {principal: [1, 1, 1]}, array: {poses: [{xyz: [1,2,3]}, {}]}}
description: >-
  folded text: with # no comment,
  and 'quotes'
# the end
"""
TIDY = """\
# about the file
# twice

# about the name
simspec: 1
name: x  # the name
description: |-
  folded text: with # no comment, and 'quotes'
bodies:
  # first
  a:  # the a
    shapes:  # why
      - sphere: {radius: 1.50}  # list
        material: s
    # after the shapes
  # the end of the bodies

  b:
    array:
      poses:
        - {xyz: [1, 2, 3]}
        - {}
    mass: 1
    inertia: {principal: [1, 1, 1]}
expect:
  - energy_conserved: {tolerance: 1 %}  # e
  - energy_never_rises: {tolerance: "2 %"}  # f
# the end
"""


def comments(text):
    """The comments of a text; those of the example are all that begin with # after a space, but one in a value."""
    return sorted(re.findall(r"(?:(?<=\s)|^)#(?! no comment).*", text))


def test_the_canonical_layout():
    assert format_text(UNTIDY, "f") == TIDY
    assert comments(TIDY) == comments(UNTIDY)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_committed_specs_are_laid_out(path):
    before, after = format_file(path)
    assert before == after


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
@pytest.mark.parametrize("mangle", ["reversed", "wide", "flow"])
def test_any_layout_leads_to_the_same(path, mangle):
    text = path.read_text(encoding="utf-8")
    data = parse(text, "f").data
    if mangle == "reversed":  # keys of the language have an order, names of the user's keep theirs
        untidy = json.dumps({key: data[key] for key in reversed(data)}, ensure_ascii=False, indent=7)
        straight = json.dumps(data, ensure_ascii=False)
        assert format_text(untidy, "f") == format_text(straight, "f")
    elif mangle == "wide":
        # the keys of a list's item stay below each other
        untidy = re.sub(r"(?m)^( *)(- )?(?=\S)", lambda match: match[1] * 3 + ("-     " if match[2] else ""), text)
        untidy = untidy.replace("\n", "\n\n\n")
        tidy = format_text(untidy, "f")
        assert [line for line in tidy.splitlines() if line] == [line for line in text.splitlines() if line]
    else:
        assert parse(format_text(json.dumps(data), "f"), "f").data == data


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_data_are_laid_out_as_files_are(path):
    text = path.read_text(encoding="utf-8")
    made = format_data(parse(text, "f").data)
    assert format_text(made, "f") == made
    assert parse(made, "f").data == parse(text, "f").data


@pytest.mark.parametrize("text", ["a: 1\na: 2", "a: &x 1", "a: !t 1", "- 1", "", "a: [", "a: .nan"])
def test_files_that_are_not_specs_stay_unchanged(text):
    with pytest.raises(SpecError):
        format_text(text, "f")


@pytest.mark.parametrize("text", ["[" * 5000, "{" * 5000, "- " * 5000, "{a: " * 5000])
def test_deep_nesting_is_refused_early(text):
    with pytest.raises(SpecError, match=r"f:1:\d+: .*nested deeper than 40 levels"):
        format_text(text, "f")


def test_a_text_that_moves_into_brackets_is_quoted():
    text = "simspec: 1\nengines:\n  e:\n    settings:\n      a: x, y\n      b: no {mapping}\n      c: 'it''s'\n      d: plain\n"
    tidy = format_text(text, "f")
    assert tidy.endswith("""    settings: {a: "x, y", b: "no {mapping}", c: 'it''s', d: plain}\n""")


def test_lines_that_do_not_fit_are_broken():
    settings_ = ", ".join(f"setting_{n}: {n}" for n in range(40))
    tidy = format_text(f"simspec: 1\nengines: {{e: {{settings: {{{settings_}}}}}}}\n", "f")
    assert max(map(len, tidy.splitlines())) <= WIDTH
    assert tidy.count("\n") > 40


@pytest.mark.parametrize(
    "value",
    ["", " x", "x ", "1", "1.0", "true", "null", "~", "- x", "a: b", "a #b", "#", "[x", "{", "'", '"', "x\ny", "x\n", "\n x",
     "é", "😀", "@x", "%x", "*x", "&x", "!x", "|", ">", "?", "x" * 300, "\t", "\\", "1e5", "0x1", ".5", "-", "--- x", "x:", ","],
)  # fmt: skip
def test_any_text_survives(value):
    for wrapped in ({"name": value}, {"description": value, "physics": {"timestep": value}}, {value or "k": [value]}):
        made = format_data(wrapped)
        assert parse(made, "f").data == wrapped
        assert format_text(made, "f") == made


_LINES = st.lists(
    st.sampled_from(
        [
            "# c", "  # d", "      # e", "", "  ", "name: x  # n", "physics: {timestep: 1 ms}", "physics:  # p",
            "  timestep: 1 ms  # t", "  gravity: [0,  # g", "    0, 0]  # h", "bodies:", "  a: {mass: 1}  # m", "  b:",
            "    mass: 2", "    shapes:", "      - {sphere: {radius: 1}}  # s", "      - sphere:", "          radius: 1  # r",
            "      # before the dash", "      -", "        box: {}", "description: |", "  # no comment", "  text", "description: '# no",
            "  comment'", "expect: [", "  {energy_conserved: {tolerance: 1 %}},  # ec", "  # in brackets", "  ]",
        ]
    ),
    max_size=14,
)  # fmt: skip


@settings(max_examples=400)
@given(_LINES)
def test_comments_and_meaning_survive_wherever_they_stand(lines):
    """format_text refuses texts that it cannot keep; its output is the same data, with all comments, and stable."""
    text = "\n".join(["simspec: 1", *lines, ""])
    tidy = attempt(text)
    if isinstance(tidy, SpecError):  # a key twice, or no YAML
        assert "without a change of meaning" not in str(tidy)
        return
    assert parse(tidy, "f").data == parse(text, "f").data
    assert format_text(tidy, "f") == tidy


def attempt(text):
    try:
        return format_text(text, "f")
    except SpecError as error:
        return error
