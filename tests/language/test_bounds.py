"""Reading a spec takes bounded work, whatever is wrong with it, and no size is too small or too large to be answered."""

from __future__ import annotations

import difflib
import math

import pytest

from simspec.errors import SpecError
from simspec.language import strict
from simspec.language.document import parse
from simspec.language.formatting import format_text
from simspec.language.load import Spec, load

BALL = {"sphere": {"radius": 0.1}}


def problems(data):
    with pytest.raises(SpecError) as caught:
        Spec.from_data(data).resolve()
    return caught.value.problems


@pytest.fixture
def compared(monkeypatch):
    """How many words were compared for suggestions."""
    counts = []
    genuine = difflib.get_close_matches

    def counting(word, words, *more):
        counts.append(len(words))
        return genuine(word, words[:50], *more)  # a test needs the count, not the time that it stands for

    monkeypatch.setattr(difflib, "get_close_matches", counting)
    return counts


def many_orphans(count):
    bodies = {f"body{i}": {"parent": f"bod{i}", "joint": {"type": "fixed"}} for i in range(count)}
    return {"name": "orphans", "bodies": bodies}


def many_wrong_exclusions(count):
    bodies = {f"body{i}": {"fixed": True} for i in range(count)}
    return {"name": "x", "bodies": bodies, "contact": {"exclude": [[f"body{i}", f"bod{i}"] for i in range(count)]}}


@pytest.mark.parametrize("make", [many_orphans, many_wrong_exclusions])
def test_suggestions_are_bounded_and_problems_are_not(make, compared):
    count = 1200
    found = problems(make(count))
    assert len(found) == count
    assert sum(compared) <= strict.MOST_COMPARED + count
    assert found[0].hint is not None
    assert found[-1].hint is None


def test_suggestions_are_computed_for_each_spec():
    problems(many_orphans(1200))
    (problem,) = problems({"name": "t", "bodies": {"base": {"fixed": True}, "arm": {**ORPHAN, "parent": "bas"}}})
    assert problem.hint == "did you mean 'base'?"


ORPHAN = {"parent": "gone", "mass": 1, "inertia": {"principal": [1, 1, 1]}, "joint": {"type": "fixed"}}


@pytest.mark.parametrize(
    ("body", "path"),
    [
        ({"mass": 1, "shapes": [{"sphere": {"radius": 1e-300}}]}, "bodies.b.shapes.0.sphere.radius"),
        ({"mass": 1, "shapes": [{"box": {"size": [1, "1e-90 mm", 1]}}]}, "bodies.b.shapes.0.box.size.1"),
        ({"mass": 1e-320, "shapes": [BALL, BALL]}, "bodies.b.mass"),
        ({"shapes": [{**BALL, "density": 1e-320}] * 2}, "bodies.b.shapes.0.density"),
    ],
)
@pytest.mark.parametrize("fixed", [False, True])
def test_values_that_round_to_zero_are_refused(body, path, fixed):
    found = problems({"name": "t", "bodies": {"b": {**body, "fixed": fixed}}, "contact": {"materials": {"m": {}}}})
    assert found[0].path == path
    assert found[0].message == "too small a number"


@pytest.mark.parametrize("solid", ["sphere", "box", "cylinder", "capsule", "ellipsoid"])
@pytest.mark.parametrize("size", [1e-30, 1e30])
@pytest.mark.parametrize("weight", [1e-30, 1e30])
@pytest.mark.parametrize("key", ["mass", "density"])
def test_the_ends_of_the_range_give_finite_mass_properties(solid, size, weight, key):
    fields = {
        "sphere": {"radius": size},
        "box": {"size": [size] * 3},
        "cylinder": {"radius": size, "length": size},
        "capsule": {"radius": size, "length": size},
        "ellipsoid": {"radii": [size] * 3},
    }
    shape = {solid: fields[solid], "collision": True}
    body = {"shapes": [{**shape, **({key: weight} if key == "density" else {})}] * 2}
    if key == "mass":
        body["mass"] = weight
    (built,) = (
        Spec.from_data({"name": "t", "bodies": {"b": body}, "contact": {"materials": {"m": {}}}}).resolve().bodies
    )
    assert 0 < built.inertial.mass < math.inf
    assert all(0 < moment < math.inf for moment in built.inertial.inertia[:3])


def test_nothing_is_a_small_number():
    """Zero is not a small number: a shape of density 0 next to a heavy shape is massless."""
    shapes = [{**BALL, "density": 0}, {**BALL, "density": 1000}]
    data = {"name": "t", "bodies": {"b": {"shapes": shapes}}, "contact": {"materials": {"m": {}}}}
    (built,) = Spec.from_data(data).resolve().bodies
    assert built.inertial.mass == pytest.approx(1000 * 4 / 3 * math.pi * 1e-3, rel=1e-15)


@pytest.mark.parametrize(
    ("contact", "path"),
    [
        ({"groups": {"a": {"ignores": 5}}}, "contact.groups.a.ignores"),
        ({"groups": {"a": {"ignores": [5]}}}, "contact.groups.a.ignores"),
        ({"groups": {"a": 5}}, "contact.groups.a"),
        ({"groups": {5: {"ignores": ["a"]}}}, "contact.groups.5"),
        ({"materials": {5: {}, None: {}}}, "contact.materials.5"),
        ({"materials": 5}, "contact.materials"),
        ({"pairs": [5, {"between": 5}, {"between": [5, None]}]}, "contact.pairs.0"),
        ({"exclude": 5}, "contact.exclude"),
        (5, "contact"),
    ],
)
def test_tables_of_the_wrong_kind_are_problems_also_where_others_refer_to_them(contact, path):
    """Found by random changes to the library's specs: readers of raw tables must check their types."""
    ball = {"mass": 1, "collision_group": "b", "shapes": [{**BALL, "material": "m"}]}
    assert path in [problem.path for problem in problems({"name": "t", "bodies": {"b": ball}, "contact": contact})]


@pytest.mark.parametrize("key", ["[a, b]", "{a: 1}", "[]"])
@pytest.mark.parametrize("text", ["? {}\n: 1\n", "name: {{{}: 1}}\n", "expect:\n  - ? {}\n    : 1\n"])
def test_a_key_that_is_no_text_is_a_problem_to_the_layout_too(key, text):
    with pytest.raises(SpecError, match="a key must be a string"):
        format_text(text.format(key), "spec.yaml")


@pytest.mark.parametrize("content", ["", "\n\n", "# a comment\n"])
def test_an_empty_file_is_named(tmp_path, content):
    path = tmp_path / "spec.yaml"
    path.write_text(content)
    with pytest.raises(SpecError) as caught:
        load(path)
    assert str(caught.value.problems[0].location) == f"{path}:1:1"


@pytest.mark.parametrize("value", ["text", "[]", "{}", "0, 0]"])
@pytest.mark.parametrize("lead", ["", "first: 1\n", "# top\n\n", "first: 1\n\n# above\n"])
@pytest.mark.parametrize("inside", ["{}", "expect:\n  - {}"])
def test_comments_after_a_key_and_after_its_value_stay_separate(value, lead, inside):
    text = lead + inside.format(f"last:  # one\n        {value}  # two\n")
    made = format_text(text, "spec.yaml")
    assert next(line for line in made.split("\n") if "one" in line).endswith("# one")
    assert next(line for line in made.split("\n") if "two" in line).endswith("# two")
    assert parse(made, "f").data == parse(text, "f").data
    assert format_text(made, "spec.yaml") == made
