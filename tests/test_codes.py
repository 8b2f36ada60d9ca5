"""Codes of problems: every place that constructs a problem gives a code of the table, and every code is used."""

from __future__ import annotations

import ast
import collections

import pytest

from simspec.codes import CODES, GROUPS
from simspec.errors import EngineError, Problem, not_importable
from tests.modules import MODULES, name_of, parsed

CONSTRUCTORS = {
    **dict.fromkeys(("Problem", "EngineRefusal", "Fault"), ""),
    "fault": "language",
    "problem": "",
    "_problem": "",
    "_report": "language",
    "error": "imports",
}
"""Functions that make problems, and the part of simspec where the name means that."""
FORMS = ("Name", "Attribute", "Subscript")
"""Expressions that forward a code."""
ANOTHER_MEANING = {
    ("report/problems.py", "_problem"): "the text of a problem",
    ("resolve/stability.py", "_problem"): "has one code, within",
}
FORWARDED = ("*more", "**more", "**details", "**at_entry", "**stop.more")
"""Parts of problems that contain the code."""


def sites():
    """(place, the argument ``code`` or None) of each construction; those of values that are reported already need none."""
    for path in MODULES:
        name = name_of(path)
        for node in ast.walk(parsed(path)):
            if not isinstance(node, ast.Call):
                continue
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if called not in CONSTRUCTORS or not name.startswith(CONSTRUCTORS[called]):
                continue
            keywords = {keyword.arg or f"**{ast.unparse(keyword.value)}": keyword.value for keyword in node.keywords}
            if (name, called) in ANOTHER_MEANING or "reported" in keywords or any(key in FORWARDED for key in keywords):
                continue
            yield f"{name}:{node.lineno}", keywords.get("code")


def codes_of(value: ast.expr) -> list[str]:
    return [node.value for node in ast.walk(value) if isinstance(node, ast.Constant) and isinstance(node.value, str)]


def test_each_problem_has_a_code_of_the_table():
    found = dict(sites())
    assert len(found) > 600
    assert not [place for place, code in found.items() if code is None]
    literal = {place: code.value for place, code in found.items() if isinstance(code, ast.Constant)}
    assert not {place: code for place, code in literal.items() if code not in CODES}
    others = {type(code).__name__ for place, code in found.items() if place not in literal}
    assert others <= set(FORMS)


def test_each_code_is_used():
    used = collections.Counter(
        node.value
        for path in MODULES
        if name_of(path) != "codes.py"
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in CODES
    )
    assert not CODES.keys() - used.keys()


def test_each_code_is_in_a_group_and_titles_are_unlike():
    assert not [code for code in CODES if code[:2] not in GROUPS]
    assert list(CODES) == sorted(CODES, key=lambda code: (list(GROUPS).index(code[:2]), code))
    assert len(set(CODES.values())) == len(CODES)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (EngineError("toys", "not installed: pip install toys"), "E201"),
        (not_importable("toys", "toys", ImportError("no such symbol")), "E201"),
        (EngineError("toys", "is version 2, not 1"), "E201"),
        (EngineError("toys", "ended with code 7"), "E202"),
        (EngineError("toys", "no result within its deadline of 1 s; killed"), "E203"),
    ],
)
def test_errors_of_engines_have_codes(error, code):
    assert error.code == code


def test_a_problem_says_the_same_with_and_without_its_code():
    assert str(Problem("wrong", "a.b", code="S101")) == str(Problem("wrong", "a.b")) == "a.b: wrong"
