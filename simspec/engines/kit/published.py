"""The folder contract as JSON Schemas (draft 2020-12), for whoever writes an engine in another language."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from pydantic import TypeAdapter

from simspec.engines.kit.answer_forms import FORMS, RESULTS, Form, Refusal, Result
from simspec.engines.kit.request import request_schema

DIALECT = "https://json-schema.org/draft/2020-12/schema"
TITLES = {
    "engine-request": "simspec: what an engine's process is asked",
    "engine-result": "simspec: what an engine's process answers",
}


def _result_schema() -> dict[str, Any]:
    """``result.json``; ``operations`` says for each operation the arrays and the plain result that it must answer."""
    arrays = {
        op: {name: {"kind": form.kind, "shape": list(form.shape), **_needed(form)} for name, form in forms.items()}
        for op, forms in FORMS.items()
    }
    plain = {op: model.model_json_schema(by_alias=True) for op, model in RESULTS.items()}
    about = {op: {"arrays": arrays[op], **({"result": plain[op]} if op in plain else {})} for op in FORMS}
    return {**TypeAdapter(Result | Refusal).json_schema(by_alias=True), "x-operations": about}


def _needed(form: Form) -> dict[str, Any]:
    """When an array must be there, where that is not always."""
    return {**({"when": form.when} if form.when else {}), **({"optional": True} if form.optional else {})}


SCHEMAS: Mapping[str, Callable[[], Mapping[str, Any]]] = {
    "engine-request": request_schema,
    "engine-result": _result_schema,
}


def schema_text(name: str) -> str:
    """One of ``SCHEMAS`` as the text of a file."""
    return json.dumps({"$schema": DIALECT, **SCHEMAS[name](), "title": TITLES[name]}, indent=2) + "\n"


def is_schema(name: str, content: bytes) -> bool:
    """Whether a file is that schema, of whatever version: by its title, as JSON."""
    try:
        given = json.loads(content)
    except (ValueError, RecursionError):
        return False
    return isinstance(given, dict) and given.get("title") == TITLES[name] and given.get("$schema") == DIALECT
