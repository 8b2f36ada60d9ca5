"""The contact law in the language: allowed and rejected entries, and the equality of all ways to write them."""

from __future__ import annotations

import pytest

from simspec.errors import SpecError
from simspec.language.contact import Contact, Pair
from simspec.language.formatting import format_text
from simspec.language.load import Spec, load
from simspec.language.models import Body, File
from simspec.language.reference import json_schema
from simspec.language.shapes import Shape, Sphere
from tests.language.contact_specs import written


def only_pair(text: str) -> str:
    return f"  pairs:\n    - {{between: [rubber, steel], {text}}}"


BAD = {
    "negative friction": (only_pair("friction: -1"), 6, "contact.pairs.0.friction", "at least 0", "≥ 0", None),
    "restitution above one": (
        only_pair("restitution: 1.01"),
        6,
        "contact.pairs.0.restitution",
        "at most 1",
        "≤ 1",
        None,
    ),
    "negative arm": (
        only_pair("rolling_friction: -1 mm"),
        6,
        "contact.pairs.0.rolling_friction",
        "at least 0",
        "in m",
        None,
    ),
    "arm without a length": (
        only_pair("torsional_friction: 1 N"),
        6,
        "contact.pairs.0.torsional_friction",
        "wrong unit",
        "in m",
        None,
    ),
    "threshold without a speed": (
        only_pair("restitution_threshold: 1 s"),
        6,
        "contact.pairs.0.restitution_threshold",
        "expected a velocity",
        "in m/s",
        None,
    ),
    "unknown material": (
        "  pairs:\n    - {between: [rubber, stele], friction: 1}",
        6,
        "contact.pairs.0.between.1",
        "no material 'stele'",
        "rubber, steel",
        "'steel'",
    ),
    "two values in other order": (
        f"{only_pair('friction: 1')}\n    - {{between: [steel, rubber], friction: 1}}",
        7,
        "contact.pairs.1",
        "is duplicated",
        None,
        "remove one",
    ),
    "two values in one pair": (
        only_pair("friction: 1, friction: 2"),
        6,
        "contact.pairs.0.friction",
        "'friction' is duplicated",
        None,
        None,
    ),
    "half a compliance": (
        "  hardness: {time_constant: 5 ms}",
        5,
        "contact.hardness",
        "incomplete compliance",
        "{stiffness, damping}",
        "add damping_ratio",
    ),
    "half of a pair's": (
        only_pair("hardness: {damping: 5}"),
        6,
        "contact.pairs.0.hardness",
        "incomplete compliance",
        "{stiffness, damping}",
        "add stiffness",
    ),
    "mixed compliance": (
        "  hardness: {time_constant: 5 ms, damping: 5}",
        5,
        "contact.hardness",
        "incomplete compliance",
        "common, native",
        "go together",
    ),
    "empty compliance": (
        "  hardness: {}",
        5,
        "contact.hardness",
        "incomplete compliance",
        "common, native",
        "go together",
    ),
    "unknown hardness": (
        "  hardness: comon",
        5,
        "contact.hardness",
        "not an allowed word",
        "common, native",
        "'common'",
    ),
    "number for hardness": ("  hardness: 5", 5, "contact.hardness", "a word or a compliance", "common, native", None),
    "list for hardness": (
        "  hardness: [common, []]",
        5,
        "contact.hardness",
        "a word or a compliance",
        "common, native",
        None,
    ),
    "unknown part of a compliance": (
        "  hardness: {stifness: 5, damping: 5}",
        5,
        "contact.hardness.stifness",
        "no such key",
        "{stiffness, damping}",
        "'stiffness'",
    ),
    "no stiffness at all": (
        "  hardness: {stiffness: 0, damping: 5}",
        5,
        "contact.hardness.stiffness",
        "above 0",
        "> 0",
        None,
    ),
    "endless stiffness": (
        "  hardness: {stiffness: .inf, damping: 5}",
        5,
        "contact.hardness.stiffness",
        "finite",
        "finite",
        None,
    ),
    "passing with a law": (
        only_pair("collide: false, friction: 1"),
        6,
        "contact.pairs.0.friction",
        "cannot have another law",
        None,
        "remove one",
    ),
    "pair without a law": (
        "  pairs:\n    - {between: [rubber, steel]}",
        6,
        "contact.pairs.0",
        "needs at least one law",
        "hardness, margin, collide",
        None,
    ),
    "unknown key of a pair": (
        only_pair("fricton: 1"),
        6,
        "contact.pairs.0.fricton",
        "unknown key",
        "friction",
        "'friction'",
    ),
    "unknown rule of one quantity": (
        "  combine: {rolling_friction: maxi}",
        5,
        "contact.combine.rolling_friction",
        "not an allowed word",
        "geometric-mean",
        "'max'",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_law_is_reported_once_with_its_place_and_a_hint(name, tmp_path):
    contact, line, path, message, allowed, hint = BAD[name]
    with pytest.raises(SpecError) as caught:
        load(written(tmp_path, contact))
    (problem,) = caught.value.problems
    assert problem.path == path
    assert message in problem.message
    assert problem.location.line == line
    assert problem.location.column > 1
    assert allowed is None or allowed in problem.allowed
    assert hint is None or hint in problem.hint
    assert "object at" not in str(problem)


def test_the_second_of_two_entries_names_the_place_of_the_first(tmp_path):
    contact = f"{only_pair('friction: 1')}\n    - {{between: [steel, rubber], restitution: 0.5}}"
    with pytest.raises(SpecError, match=r"first as pair 0 at .*law\.yaml:6:7"):
        load(written(tmp_path, contact))


def test_both_numbers_of_a_compliance_are_reported(tmp_path):
    with pytest.raises(SpecError) as caught:
        load(written(tmp_path, "  hardness: {time_constant: 5 m, damping_ratio: -1}"))
    assert [problem.path.rpartition(".")[2] for problem in caught.value.problems] == ["time_constant", "damping_ratio"]


PAD = """bodies:
  floor: {fixed: true, shapes: [{box: {size: [4, 4, 0.2]}, material: steel}]}
  finger: {pose: {xyz: [0, 0, 1]}, mass: MASS, inertia: {principal: [1, 1, 1]}}
  pad:
    parent: finger
    mass: 0.5 kg
    joint: {type: fixed}
    shapes: [{sphere: {radius: 0.1}, material: rubber}]
"""


def test_rigidly_connected_bodies_move_with_their_total_mass(tmp_path):
    """√(m/k) counts the pad with its finger: 1 kg on 2.4e5 N/m is two steps of 1 ms and a little, half a kilogram is not."""
    spring = "  hardness: {stiffness: 2.4e5 N/m, damping: 1}"
    load(written(tmp_path, spring, PAD.replace("MASS", "0.5 kg"))).resolve()
    with pytest.raises(SpecError, match=r"√\(m/k\) of 'pad' \(0\.9 kg\)"):
        load(written(tmp_path, spring, PAD.replace("MASS", "0.4 kg"))).resolve()


def test_an_override_changes_a_single_number_of_a_pair(tmp_path):
    path = written(tmp_path, only_pair("friction: 0.3, hardness: {stiffness: 1e4, damping: 5}"))
    sets = ["contact.pairs.0.friction=0.7", "contact.pairs.0.hardness.stiffness=2e4 N/m", "contact.hardness=native"]
    pairs = {(pair.first, pair.second): pair for pair in load(path, sets=sets).resolve().contact.pairs}
    assert pairs["rubber", "steel"].friction == 0.7
    assert (pairs["rubber", "steel"].hardness.kind, pairs["rubber", "steel"].hardness.stiffness) == ("stiffness", 2e4)
    assert pairs["rubber", "rubber"].hardness.kind == "native"
    with pytest.raises(SpecError, match="at most 1"):
        load(path, sets=["contact.pairs.0.restitution=2"])


LAW = Contact(
    hardness={"time_constant": "5 ms", "damping_ratio": 1},
    materials={"m": {"friction": 0.5, "rolling_friction": "1 mm"}, "n": {"restitution_threshold": "10 cm/s"}},
    combine="mean",
    pairs=[
        Pair(between=("m", "n"), hardness={"stiffness": "10 kN/m", "damping": 3}),
        Pair(between=("m", "m"), hardness="native"),
        Pair(between=("n", "n"), collide=False),
    ],
)


def test_a_law_that_is_made_in_python_is_the_law_of_its_yaml(tmp_path):
    ball = Body(mass=1, shapes=[Shape(sphere=Sphere(radius=1), material="m")])
    made = Spec.from_data(File(simspec=1, name="made", contact=LAW, bodies={"ball": ball}))
    path = tmp_path / "made.yaml"
    path.write_text(made.to_yaml(), encoding="utf-8")
    assert load(path).resolve() == made.resolve()
    assert load(path).data == made.data
    kinds = {(pair.first, pair.second): pair.hardness.kind for pair in made.resolve().contact.pairs if pair.collide}
    assert kinds == {("m", "m"): "native", ("m", "n"): "stiffness"}
    assert made.resolve().contact.pairs[0].rolling_friction == 0.001


def test_the_canonical_layout_keeps_a_law(tmp_path):
    contact = f"  hardness:   {{damping_ratio: 1, time_constant: 5 ms}}\n{only_pair('hardness: native')}   # soft"
    path = written(tmp_path, contact)
    before = load(path).resolve()
    text = format_text(path.read_text(encoding="utf-8"), str(path))
    path.write_text(text, encoding="utf-8")
    assert load(path).resolve() == before
    assert "# soft" in text
    assert format_text(text, str(path)) == text


def test_the_schema_names_every_way_to_say_hardness():
    jsonschema = pytest.importorskip("jsonschema")
    schema = json_schema()
    hardness = schema["definitions"]["Contact"]["properties"]["hardness"]
    assert hardness["default"] == "common"
    jsonschema.validate(hardness["default"], hardness)
    jsonschema.validate({"stiffness": "1 kN/m", "damping": 5}, hardness)
    for wrong in ("soft", {"stiffness": 5}, {"stiffness": 5, "damping_ratio": 1}, ["common", []]):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, hardness)
