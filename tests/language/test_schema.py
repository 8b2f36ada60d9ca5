"""The JSON Schema: draft 07, accepts what simspec accepts, refuses what an editor can see to be wrong."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from simspec.language.document import read
from simspec.language.editor_hints import SNIPPETS
from simspec.language.load import load
from simspec.language.models import File
from simspec.language.problems import fields, models
from simspec.language.reference import LANGUAGES, json_schema, schema_text

ROOT = Path(__file__).parents[2]
STUDIES = sorted((ROOT / "specs" / "studies").glob("*.yaml"))
FILES = sorted({*(ROOT / "specs").rglob("*.yaml"), *(Path(__file__).parent / "data").rglob("*.yaml")} - set(STUDIES))
SCHEMA = json_schema()
VALIDATOR = jsonschema.Draft7Validator(SCHEMA)


def test_it_is_a_schema_of_draft_07():
    jsonschema.Draft7Validator.check_schema(SCHEMA)
    text = json.dumps(SCHEMA)
    assert not any(
        f'"{word}"' in text for word in ("$defs", "prefixItems", "unevaluatedProperties", "dependentRequired")
    )


def test_the_committed_schema_is_current():
    assert (ROOT / "schema" / "simspec.schema.json").read_text(encoding="utf-8") == schema_text()


@pytest.mark.parametrize("of", LANGUAGES)
def test_schemas_of_studies_are_current_and_describe_every_field(of):
    schema = json_schema(of)
    jsonschema.Draft7Validator.check_schema(schema)
    name = "simspec" if of == "language" else of
    assert (ROOT / "schema" / f"{name}.schema.json").read_text(encoding="utf-8") == schema_text(of)
    for model in (schema, *schema["definitions"].values()):
        assert model["additionalProperties"] is False
        assert all(field.get("description") for field in model["properties"].values())


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_studies_are_valid(path):
    data = read(path).data
    of = "study" if "simspec_study" in data else "figures"
    assert list(jsonschema.Draft7Validator(json_schema(of)).iter_errors(data)) == []
    assert list(jsonschema.Draft7Validator(json_schema(of)).iter_errors({**data, "sweep": {}})) != []


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_specs_are_valid(path):
    assert list(VALIDATOR.iter_errors(read(path).data)) == []


def test_every_model_refuses_unknown_keys_and_every_field_says_what_it_is():
    found = {"File": SCHEMA, **SCHEMA["definitions"]}
    for name, model in models(File).items():
        schema = found[name]
        assert schema["additionalProperties"] is False
        assert schema["description"]
        assert list(schema["properties"]) == list(fields(model))
        assert all(field.get("description") for field in schema["properties"].values()), name


SOLID = {"mass": 1, "inertia": {"principal": [1, 1, 1]}}


def spec(**fields):
    return {"simspec": 1, "name": "x", "bodies": {"a": {**SOLID, **fields}}}


@pytest.mark.parametrize(
    "data",
    [
        spec(mass="3 kg"),
        spec(pose={"xyz": ["1 mm", 0, 0], "rpy": ["90 deg", 0, 0]}),
        spec(joint={"type": "ball", "position": {"quat": [1, 0, 0, 0]}, "velocity": [0, 0, 1]}),
        spec(array={"grid": [1, 2, 3], "spacing": [1, 1, "2 m"]}),
        spec(array={"grid": [1, 2, 3], "spacing": 1}),
        {**spec(), "contact": {"combine": "max"}},
        {**spec(), "contact": {"combine": {"friction": "max"}}},
        {**spec(), "engines": {"any": {"settings": {"a": True, "b": 1, "c": "word"}}}},
    ],
)
def test_accepted(data):
    assert list(VALIDATOR.iter_errors(data)) == []
    File.model_validate(data)


@pytest.mark.parametrize(
    "data",
    [
        {},
        {"simspec": 2, "name": "x", "bodies": {}},
        {"simspec": 1, "name": "x"},
        {"simspec": 1, "name": "a b", "bodies": {}},
        {"simspec": 1, "name": "x", "bodies": {"a<b": {}}},
        spec(mas=1),
        spec(mass=-1),
        spec(mass=True),
        spec(mass=None),
        spec(mass="heavy"),
        spec(pose={"xyz": [1, 2]}),
        spec(pose={"rpy": [0, 0, 0], "quat": [1, 0, 0, 0]}),
        spec(joint={"type": "hinj"}),
        spec(joint={"type": "hinge"}),
        spec(joint={"type": "ball", "axis": [0, 0, 1]}),
        spec(joint={"axis": [0, 0, 1]}),
        spec(shapes=[{"sphere": {"radius": 0}}]),
        spec(shapes=[{"sphere": {"radius": 1}, "box": {"size": [1, 1, 1]}}]),
        spec(shapes=[{}]),
        spec(shapes={"sphere": {"radius": 1}}),
        {**spec(), "contact": {"combine": "average"}},
        {**spec(), "contact": {"friction_cone": "pyramid"}},
        {**spec(), "expect": [{"position": {"body": "a"}}]},
        {**spec(), "expect": [{}]},
        {**spec(), "record": {"channels": ["poses"]}},
    ],
)
def test_refused_by_both(data):
    """The schema and the models agree on what an editor can see to be wrong."""
    assert list(VALIDATOR.iter_errors(data))
    with pytest.raises(ValueError, match="validation error"):
        File.model_validate(data)


def enumerations(part, place=""):
    """Every list of words of a schema with its place, but for those in conditions."""
    if isinstance(part, dict):
        if isinstance(part.get("enum"), list):
            yield place, part
        for key, value in part.items():
            if key != "if":
                yield from enumerations(value, f"{place}/{key}")
    elif isinstance(part, list):
        for value in part:
            yield from enumerations(value, place)


def test_editors_show_a_meaning_of_every_word():
    found = dict(enumerations(SCHEMA))
    assert len(found) > 20
    assert not [place for place, part in found.items() if len(part.get("enumDescriptions", [])) != len(part["enum"])]
    assert all(
        text and text != word
        for part in found.values()
        for word, text in zip(part["enum"], part["enumDescriptions"], strict=True)
    )


def test_editors_show_type_unit_and_default_of_every_field():
    for model in (SCHEMA, *SCHEMA["definitions"].values()):
        for field in model["properties"].values():
            assert field["markdownDescription"].startswith(field["description"])
    timestep = SCHEMA["definitions"]["Physics"]["properties"]["timestep"]
    lines = [line.strip(" *") for line in timestep["markdownDescription"].splitlines()]
    assert lines == ["Length of one step", "a time > 0", "SI unit: s", "default: 0.001"]
    assert len(schema_text()) < 250_000


@pytest.mark.parametrize("model", SNIPPETS)
def test_contents_to_start_from_are_valid(model):
    snippets = SCHEMA["definitions"][model]["defaultSnippets"]
    of_model = jsonschema.Draft7Validator({**SCHEMA["definitions"][model], "definitions": SCHEMA["definitions"]})
    assert {entry["label"] for entry in snippets} == {label for label, *_ in SNIPPETS[model]}
    for entry in snippets:
        assert list(of_model.iter_errors(entry["body"])) == []


@pytest.mark.parametrize(
    "body", [body for _, _, body in SNIPPETS["Body"]], ids=[label for label, *_ in SNIPPETS["Body"]]
)
def test_a_body_to_start_from_resolves(body, tmp_path):
    parent = {"PARENT": {"fixed": True}} if "parent" in body else {}
    path = tmp_path / "x.yaml"
    contact = {"materials": {"MATERIAL": {"friction": 0.5}}}
    path.write_text(json.dumps({"simspec": 1, "name": "x", "contact": contact, "bodies": {**parent, "part": body}}))
    assert any(found.name == "part" for found in load(path).resolve().bodies)


def test_examples_are_values_of_their_fields():
    for name, model in models(File).items():
        properties = (SCHEMA if name == "File" else SCHEMA["definitions"][name])["properties"]
        for key, kind in fields(model).items():
            for example in properties[key].get("examples", []):
                kind.read(example)
    assert SCHEMA["definitions"]["Sphere"]["properties"]["radius"]["examples"] == ["50 mm"]
