"""The input of an engine's process, ``request.json``, ``request.bin``, and the artifacts below ``artifacts/``; and the form of
its answers.

The folder is all that the process needs: the artifacts are copied into it, and every path in the request is relative to it. The
form is published as a JSON Schema (``schema/engine-request.schema.json``); ``docs/design/engine-process.md`` says
what it means.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, TypeAdapter

from simspec.control.reference import driven_joints
from simspec.engines.kit import worker
from simspec.engines.kit.arrays import SECONDS
from simspec.engines.kit.contract import Engine
from simspec.engines.kit.registry import STATED
from simspec.outputs.files import files_below, read_bytes
from simspec.world.kinematics import layout_of
from simspec.world.types import ReadBack, World

# The required answer of each operation: a table of its arrays, and models of the plain data around them.


class BadAnswerError(ValueError):
    """The received data are not an answer to the request."""


@dataclass(frozen=True, slots=True)
class Form:
    """An array that an operation answers: the names or numbers of its dimensions, and its kind (f8, i8).

    A dimension is a name in :func:`dimensions_of` of the request, or, where that has none, one that all arrays of the answer
    share. ``when``: the condition (see :func:`conditions`) under which it must be there, and else must not; ``optional``: it
    may be missing also then.
    """

    shape: tuple[str | int, ...]
    kind: Literal["f8", "i8"] = "f8"
    when: str = ""
    optional: bool = False


STATE = {
    "q": Form(("rows", "nq")),
    "v": Form(("rows", "nv")),
    "pose": Form(("rows", "bodies", 7)),
    "velocity": Form(("rows", "bodies", 6)),
}
CONTACTS = {
    "contact.row": Form(("contacts",), "i8", when="contacts"),
    "contact.body": Form(("contacts", 2), "i8", when="contacts"),
    "contact.position": Form(("contacts", 3), when="contacts"),
    "contact.normal": Form(("contacts", 3), when="contacts"),
    "contact.distance": Form(("contacts",), when="contacts"),
    "contact.normal_force": Form(("contacts",), when="contacts"),
}
FORMS: Mapping[str, Mapping[str, Form]] = {
    "read_back": {},
    "foreign": {},
    "kinematics": {**STATE, "frame": Form(("rows", "frames", 7), optional=True)},
    "dynamics": {
        "mass": Form(("rows", "packed"), when="mass_matrix"),
        "bias_force": Form(("rows", "nv"), when="bias_force"),
        "gravity_force": Form(("rows", "nv"), when="bias_force"),
    },
    "motion": STATE,
    "pushed": STATE,
    "prescribed": STATE,
    "trials": {"v": STATE["v"]},
    "stopped": {"v": STATE["v"]},
    "accelerations": {"v": STATE["v"]},
    "limit": {"pose": STATE["pose"]},
    "drive": {"time": Form(("rows",)), "pose": STATE["pose"], "velocity": STATE["velocity"]},
    "respond": {"positions": Form(("rows", "joints"))},
    "touching": {"touching": Form(("pairs", 3), "i8"), "units": Form(("unit_pairs", 3), "i8")},
    "windows": {**STATE, **CONTACTS},
    "run": {
        "step": Form(("rows",)),
        **STATE,
        "energy": Form(("rows", 2), when="energy"),
        "control.target": Form(("rows", "joints"), when="control"),
        "control.effort": Form(("rows", "joints"), when="control"),
        **CONTACTS,
        "seconds": Form(("rows", len(SECONDS)), optional=True),
        "contact.unit": Form(("contacts", 2), "i8", when="contacts", optional=True),
    },
}
"""The arrays of each operation of ``operations.OPERATIONS``. Numbers may be NaN or infinite where the proof judges them."""


@dataclass(frozen=True)
class Operation:
    """One thing to do in the engine's process (see ``worker.py``): name, parameters, arrays, and the world of the artifacts
    it is about, where the caller knows it: the answer is held against its sizes and names."""

    op: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    world: World | None = None


@dataclass(frozen=True)
class Answer:
    """The result of an operation: plain data, arrays (large ones mapped from a file), seconds for loading and for the work, the
    engine's warnings; and of ``read_back`` and ``foreign`` the engine's model."""

    result: dict[str, Any]
    arrays: dict[str, np.ndarray]
    load_seconds: float
    seconds: float
    log: list[str]
    read_back: ReadBack | None = None


def conditions(operation: Operation) -> set[str]:
    """The optional parts of an answer that are requested: the channels, the quantities of ``dynamics``, and ``control``."""
    found = set(operation.parameters.get("channels", ())) & {"energy", "contacts"}
    found |= set(operation.parameters.get("quantities", ()))
    return found | ({"control"} if "control" in operation.parameters else set())


def _rows_of(steps: int, every: int) -> int:
    """Rows after ``steps`` steps, one after each ``every`` and one at the end."""
    return -(-steps // every)


def planned_rows(operation: Operation) -> int | None:
    """How many rows an operation gives when it does all its steps; None where that is the engine's to say."""
    parameters = operation.parameters
    if operation.op in ("kinematics", "dynamics", "trials", "stopped", "accelerations", "windows"):
        return len(operation.arrays["q"])
    if operation.op == "limit":
        return len(parameters["timesteps"]) * (1 + _rows_of(parameters["steps"], parameters["every"]))
    if operation.op in ("motion", "pushed", "prescribed", "respond", "run"):
        return 1 + _rows_of(parameters["steps"], parameters["every"])
    if operation.op == "drive":
        return 1 + sum(_rows_of(steps, every) for steps, every in parameters["phases"])
    return None


def dimensions_of(operation: Operation) -> dict[str, int]:
    """The dimensions that the request knows. ``rows`` is left to the answer where it may end before its time."""
    found = {}
    for name, size in (("q", "nq"), ("v", "nv")):
        if name in operation.arrays:
            found[size] = int(operation.arrays[name].shape[-1])
    if "q" in operation.arrays and operation.op == "touching":
        found["states"] = len(operation.arrays["q"])
    if operation.op == "dynamics":
        found["packed"] = sum(size * size for size in operation.parameters["sizes"])
    rows = planned_rows(operation)
    if rows is not None and operation.op not in ("motion", "pushed", "prescribed", "run"):
        found["rows"] = rows
    world = operation.world
    if world is not None:
        places = layout_of(world)
        found |= {"bodies": len(world.bodies), "nq": places.nq, "nv": places.nv}
        if operation.op == "respond":
            found["joints"] = len(driven_joints(world))
    return found


# --- the envelope ---------------------------------------------------------------------------------------------------

Seconds = Annotated[float, Field(ge=0.0, le=1e9, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=2**53)]
Name = Annotated[str, Field(max_length=200)]


class StrictAnswer(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Described(StrictAnswer):
    kind: Literal["f8", "i8"]
    shape: Annotated[list[Count], Field(max_length=4)]
    stored: bool


class Entry(StrictAnswer):
    op: Name
    load_seconds: Seconds
    seconds: Seconds
    log: Annotated[list[Annotated[str, Field(max_length=worker.LINE)]], Field(max_length=worker.LINES)]
    result: dict[str, Any]
    arrays: dict[Name, Described]


def _stated(version: str) -> str:
    if STATED.fullmatch(version) is None:
        raise ValueError("not a version: at most 64 letters, digits and marks, with a digit")
    return version


class Result(StrictAnswer):
    schema_: Literal[worker.SCHEMA] = Field(alias="schema")  # type: ignore[valid-type]
    status: Literal["ok"]
    engine: Name
    engine_version: Annotated[str, AfterValidator(_stated)] | None
    numpy_version: Name
    python_version: Name
    platform: Name
    machine: Name
    operations: list[Entry]


class Refusal(StrictAnswer):
    schema_: Literal[worker.SCHEMA] = Field(alias="schema")  # type: ignore[valid-type]
    status: Literal["error"]
    error: Annotated[str, Field(max_length=worker.MESSAGE)]
    traceback: Annotated[str, Field(max_length=worker.MESSAGE)]


class NotFinite(StrictAnswer):
    step: Count
    channel: Name
    place: Annotated[list[Count], Field(max_length=3)]


class ControlResult(StrictAnswer):
    joints: list[Name]
    error: list[Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None]
    clipped: list[Count | None]


class Unit(StrictAnswer):
    body: Annotated[int, Field(ge=-1, le=2**31)]
    shapes: list[Name]


class RunResult(StrictAnswer):
    steps: Count
    step_seconds: Seconds
    cpu_seconds: Seconds
    control_seconds: Seconds
    record_seconds: Seconds
    run_seconds: Seconds
    failed: NotFinite | None
    control: ControlResult | None = None
    contact_units: list[Unit] | None = None


class MotionResult(StrictAnswer):
    steps: Count


class TouchingResult(StrictAnswer):
    units: list[Unit]


RESULTS: Mapping[str, type[BaseModel]] = {
    "run": RunResult,
    "motion": MotionResult,
    "pushed": MotionResult,
    "prescribed": MotionResult,
    "touching": TouchingResult,
}
"""The plain result of an operation, where it has one; ``read_back``'s is a ReadBack."""

ARTIFACTS = "artifacts"
Dimension = Annotated[int, Field(ge=0)]


class ArrayForm(BaseModel):
    """An array of an operation: its kind, little-endian, and its shape. Arrays stand in ``request.bin`` by rows, without gaps,
    in the order of the operations, and in each in the order of its ``arrays``."""

    model_config = ConfigDict(extra="forbid", strict=True)

    kind: Literal["f8", "i8"]
    shape: Annotated[list[Dimension], Field(max_length=4)]


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
