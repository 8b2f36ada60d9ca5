"""The language as a JSON Schema (draft 07), for editors that complete and check YAML as it is written."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping
from typing import Any

from simspec.language import walk
from simspec.language.contact import Contact
from simspec.language.joints import Joint
from simspec.language.models import File
from simspec.language.reader import Reader
from simspec.language.shapes import Orientation
from simspec.language.strict import Strict
from simspec.language.study import FiguresFile, StudyFile
from simspec.language.sweep_values import Range
from simspec.language.vocabulary import COMBINATIONS, SCALAR_JOINTS

DIALECT = "http://json-schema.org/draft-07/schema#"
TITLE = "simspec: a scenario or a model for every physics engine"
LANGUAGES: Mapping[str, tuple[type[Strict], str]] = {
    "language": (File, TITLE),
    "study": (StudyFile, "simspec: a study, sweeps of several scenarios"),
    "figures": (FiguresFile, "simspec: figures from elsewhere that a study is held against"),
}
"""The model of each kind of file, and the title of its schema."""


def json_schema(of: str = "language") -> dict[str, Any]:
    """The schema of a spec, or of another kind of file (:data:`LANGUAGES`): units are allowed where numbers are, unknown keys
    nowhere."""
    root, title = LANGUAGES[of]
    models = {**walk.models(root), **(beside() if root is not FiguresFile else {})}
    definitions = {name: _model(model) for name, model in sorted(models.items())}
    return {"$schema": DIALECT, "title": title, **definitions.pop(root.__name__), "definitions": definitions}


def beside() -> dict[str, type[Strict]]:
    """Models that stand inside values that readers read, by name."""
    return {model.__name__: model for model in (Orientation, Range)}


def schema_text(of: str = "language") -> str:
    """The schema as the text of a file."""
    return json.dumps(json_schema(of), indent=2, ensure_ascii=False) + "\n"


def is_schema(content: bytes, of: str = "language") -> bool:
    """Whether a file is a schema of this kind of file, of whatever version: by its title, as JSON."""
    try:
        schema = json.loads(content)
    except (ValueError, RecursionError):
        return False
    return isinstance(schema, dict) and schema.get("title") == LANGUAGES[of][1] and schema.get("$schema") == DIALECT


def _model(model: type[Strict]) -> dict[str, Any]:
    properties = {}
    for name, kind in walk.fields(model).items():
        field = model.model_fields[name]
        described = {"description": field.description} if field.description else {}
        default = {} if field.is_required() else _default(walk.default(kind, field))
        # draft 07 ignores what stands beside a $ref
        what = {"allOf": [_kind(kind)]} if walk.is_model(kind) else _kind(kind)
        properties[name] = {**described, **what, **default}
    if model is Contact:
        one_word = {"anyOf": [{"enum": list(COMBINATIONS)}, *properties["combine"].pop("allOf")]}
        properties["combine"].update(one_word)
    schema: dict[str, Any] = {
        "description": " ".join((inspect.getdoc(model) or "").split()),
        "type": "object",
        "additionalProperties": False,
        "properties": properties,
    }
    required = [name for name, field in model.model_fields.items() if field.is_required()]
    if required:
        schema["required"] = required
    if rules := _rules(model):
        schema["allOf"] = rules
    return schema


def _kind(kind: Any) -> dict[str, Any]:
    if isinstance(kind, Reader):
        return kind.schema()
    if isinstance(kind, walk.Free):
        return {
            "type": "object",
            "propertyNames": {"pattern": kind.key.schema()["pattern"]},
            "additionalProperties": _kind(kind.item),
        }
    if isinstance(kind, list):
        return {"type": "array", "items": _kind(kind[0])}
    if walk.is_model(kind):
        return {"$ref": f"#/definitions/{kind.__name__}"}
    return {}


def _default(value: Any) -> dict[str, Any]:
    """The default, where one can be written: None stands for "not given", a model for its own defaults."""
    if value is None or isinstance(value, Strict):
        return {}
    return {"default": list(value) if isinstance(value, tuple) else value}


def _rules(model: type[Strict]) -> list[dict[str, Any]]:
    """What a model says beyond its single fields."""
    rules: list[dict[str, Any]] = []
    if model.ONE_OF:
        rules.append({"oneOf": [{"required": [name]} for name in model.ONE_OF]})
    fields = walk.fields(model)
    if "rpy" in fields and "quat" in fields:
        rules.append({"not": {"required": ["rpy", "quat"]}})
    if model is Joint:
        with_axis = {"properties": {"type": {"enum": list(SCALAR_JOINTS)}}, "required": ["type"]}
        rules.append({"if": with_axis, "then": {"required": ["axis"]}, "else": {"not": {"required": ["axis"]}}})
    if model is File:
        rules.append({"anyOf": [{"required": ["bodies"]}, {"required": ["models"]}, {"required": ["model"]}]})
    return rules
