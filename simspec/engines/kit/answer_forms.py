"""The required answer of each operation: a table of its arrays, and models of the plain data around them. Driver only
(pydantic)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from simspec.control.reference import driven_joints
from simspec.engines.kit import worker
from simspec.engines.kit.arrays import SECONDS
from simspec.engines.kit.registry import STATED
from simspec.world.kinematics import layout_of
from simspec.world.types import ReadBack, World


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
    if operation.op in ("kinematics", "dynamics", "trials", "stopped", "windows"):
        return len(operation.arrays["q"])
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
