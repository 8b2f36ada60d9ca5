"""The JSON Schema: draft 07, accepts what simspec accepts, refuses what an editor can see to be wrong."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from simspec.language.document import read
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
