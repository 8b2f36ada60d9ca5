"""The input of an engine's process: ``request.json``, ``request.bin``, and the artifacts below ``artifacts/``.

The folder is all that the process needs: the artifacts are copied into it, and every path in the request is relative to it. The
form is published as a JSON Schema (``schema/engine-request.schema.json``); ``docs/design/engine-process.md`` says
what it means.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from simspec.engines.kit import worker
from simspec.engines.kit.answer_forms import FORMS, RESULTS, Form, Operation, Refusal, Result
from simspec.engines.kit.contract import Engine
from simspec.outputs.files import files_below, read_bytes

ARTIFACTS = "artifacts"
Name = Annotated[str, Field(max_length=200)]
Count = Annotated[int, Field(ge=0)]


class ArrayForm(BaseModel):
    """An array of an operation: its kind, little-endian, and its shape. Arrays stand in ``request.bin`` by rows, without gaps,
    in the order of the operations, and in each in the order of its ``arrays``."""

    model_config = ConfigDict(extra="forbid", strict=True)

    kind: Literal["f8", "i8"]
    shape: Annotated[list[Count], Field(max_length=4)]


class RequestedOperation(BaseModel):
    """One thing to do, after the artifacts are loaded anew. Its other fields are the operation's parameters."""

    model_config = ConfigDict(extra="allow", strict=True)

    op: Literal[tuple(sorted(FORMS))] = Field(description="The name of the operation.")  # type: ignore[valid-type]
    artifacts: Name = Field(description="The folder of the artifacts to load, relative to that of the request.")
    arrays: dict[Name, ArrayForm] = Field(description="Its arrays, by name.")
    attempt: bool = Field(
        default=False, description="Whether a failure is an answer to this operation, after which the next one follows."
    )
    cpu_seconds: float = Field(default=0.0, ge=0.0, description="CPU time limit of an attempt (s); 0: unlimited.")


class Request(BaseModel):
    """``request.json``: the operations of a process, one after the other."""

    model_config = ConfigDict(extra="forbid", strict=True)

    schema_: Literal[worker.SCHEMA] = Field(alias="schema", description="The version of this form.")  # type: ignore[valid-type]
    engine: Name = Field(description="Name of the engine in the artifacts.")
    program: Name = Field(description="Module and class of the engine, for simspec's own worker.")
    operations: list[RequestedOperation]


def write_request(folder: Path, engine: type[Engine], artifacts: Path, operations: Sequence[Operation]) -> None:
    """Write a request into ``folder``, with copies of the artifacts. Raises SpecError for artifacts that are no files."""
    places: dict[Path, str] = {}
    listed: list[dict[str, Any]] = []
    with open(folder / worker.REQUEST_ARRAYS, "wb") as file:
        for operation in operations:
            given = dict(operation.parameters)
            source = Path(given.pop("artifacts", artifacts)).resolve()
            if source not in places:
                places[source] = f"{ARTIFACTS}/{len(places)}"
                _copy(source, folder / places[source])
            listed.append(
                {
                    "op": operation.op,
                    "artifacts": places[source],
                    "arrays": {name: _write(value, file) for name, value in operation.arrays.items()},
                    **given,
                }
            )
    request = {"schema": worker.SCHEMA, "engine": engine.NAME, "operations": listed}
    request["program"] = f"{engine.__module__}:{engine.__qualname__}"
    (folder / worker.REQUEST).write_text(json.dumps(request), encoding="utf-8")


def _copy(source: Path, target: Path) -> None:
    target.mkdir(parents=True)
    for name in files_below(source):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        (target / name).write_bytes(read_bytes(source / name))


def _write(value: Any, file: Any) -> dict[str, Any]:
    array = np.asarray(value)
    kind = worker.KINDS.get(array.dtype.kind)
    if kind is None:
        raise TypeError(f"an array of {array.dtype}, not of numbers")
    file.write(np.ascontiguousarray(array, dtype=f"<{kind}").data)
    return {"kind": kind, "shape": list(array.shape)}


def request_schema() -> Mapping[str, Any]:
    """The form of ``request.json`` as a JSON Schema."""
    return Request.model_json_schema(by_alias=True)


# The folder contract as JSON Schemas (draft 2020-12), for whoever writes an engine in another language.

DIALECT = "https://json-schema.org/draft/2020-12/schema"
TITLES = {
    "engine-request": "simspec: the request to an engine's process",
    "engine-result": "simspec: the answer of an engine's process",
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
