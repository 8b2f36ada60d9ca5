"""What each operation must answer, and the one place where answers are read: nothing of an engine's process is believed.

The other side may be damaged, of another version, or hostile: an answer of any other kind, shape or size than declared here is
a :class:`BadAnswerError` that says what is wrong with it. Runs in the driver only (pydantic, large arrays on disk).
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from simspec.control.reference import driven_joints
from simspec.engines import worker
from simspec.errors import clipped
from simspec.mapped import all_finite, blocks, release
from simspec.reading import NotReadableError, open_regular, read_bytes
from simspec.world.canonical import from_plain
from simspec.world.kinematics import layout
from simspec.world.types import JOINT_KINDS, POSITION_SIZE, SHAPE_KINDS, VELOCITY_SIZE, ReadBack, World

JSON_BYTES = 64_000_000
"""Largest result.json. The largest of the library's is below 1 MB; 2,000 bodies with explicit pairs need 20 MB."""
MAPPED_BYTES = 16_000_000
"""Arrays larger than this stay on disk, mapped."""
RECORDED_BYTES = 16 * 2**30
"""Most bytes that a run may record: 10 million rows of seven free bodies. More would fill a disk before it is noticed."""
FREE_BYTES = 2**30
"""Size of arrays whose length is the engine's to choose (which bodies touch), at most."""


UNIT = 1e-6
"""How far from 1 the length of a quaternion that was read back may be: that of a single-precision one is 1e-7."""


class BadAnswerError(ValueError):
    """What came back is not an answer to what was asked."""


# --- what is declared -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Form:
    """An array that an operation answers: the names or numbers of its dimensions, and its kind (f8, i8).

    A dimension is a name in :func:`_dimensions` of the request, or, where that has none, one that all arrays of the answer
    share. ``when``: the condition (see :func:`_conditions`) under which it must be there, and else must not.
    """

    shape: tuple[str | int, ...]
    kind: Literal["f8", "i8"] = "f8"
    when: str = ""


STATE = {
    "q": Form(("rows", "nq")),
    "v": Form(("rows", "nv")),
    "pose": Form(("rows", "bodies", 7)),
    "velocity": Form(("rows", "bodies", 6)),
}
FORMS: Mapping[str, Mapping[str, Form]] = {
    "read_back": {},
    "kinematics": STATE,
    "dynamics": {
        "mass_matrix": Form(("rows", "nv", "nv")),
        "bias_force": Form(("rows", "nv")),
        "energy": Form(("rows", 2)),
    },
    "motion": STATE,
    "trials": {"v": STATE["v"]},
    "drive": {"time": Form(("rows",)), "pose": STATE["pose"], "velocity": STATE["velocity"]},
    "respond": {"positions": Form(("rows", "joints"))},
    "touching": {"touching": Form(("pairs", 3), "i8")},
    "run": {
        "step": Form(("rows",)),
        **STATE,
        "energy": Form(("rows", 2), when="energy"),
        "control.target": Form(("rows", "joints"), when="control"),
        "control.effort": Form(("rows", "joints"), when="control"),
        "contact.row": Form(("contacts",), "i8", when="contacts"),
        "contact.body": Form(("contacts", 2), "i8", when="contacts"),
        "contact.position": Form(("contacts", 3), when="contacts"),
        "contact.normal": Form(("contacts", 3), when="contacts"),
        "contact.distance": Form(("contacts",), when="contacts"),
        "contact.normal_force": Form(("contacts",), when="contacts"),
    },
}
"""The arrays of each operation of ``worker.OPERATIONS``. Numbers may be NaN or infinite where the proof judges them."""


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
    """What an operation gave: plain data, arrays (large ones mapped from a file), seconds for loading and for the work, the
    engine's warnings; and of ``read_back`` what the engine holds."""

    result: dict[str, Any]
    arrays: dict[str, np.ndarray]
    load_seconds: float
    seconds: float
    log: list[str]
    held: ReadBack | None = None


# --- the envelope -----------------------------------------------------------------------------------------------------

Seconds = Annotated[float, Field(ge=0.0, le=1e9, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=2**53)]
Name = Annotated[str, Field(max_length=200)]


Model = TypeVar("Model", bound=BaseModel)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _Array(_Strict):
    kind: Literal["f8", "i8"]
    shape: Annotated[list[Count], Field(max_length=4)]
    stored: bool


class _Entry(_Strict):
    op: Name
    load_seconds: Seconds
    seconds: Seconds
    log: Annotated[list[Annotated[str, Field(max_length=worker.LINE)]], Field(max_length=worker.LINES)]
    result: dict[str, Any]
    arrays: dict[Name, _Array]


class _Result(_Strict):
    schema_: Literal[worker.SCHEMA] = Field(alias="schema")  # type: ignore[valid-type]
    status: Literal["ok"]
    engine: Name
    engine_version: Name | None
    numpy_version: Name
    python_version: Name
    platform: Name
    machine: Name
    operations: list[_Entry]


class _Error(_Strict):
    schema_: Literal[worker.SCHEMA] = Field(alias="schema")  # type: ignore[valid-type]
    status: Literal["error"]
    error: Annotated[str, Field(max_length=worker.MESSAGE)]
    traceback: Annotated[str, Field(max_length=worker.MESSAGE)]


class _Failed(_Strict):
    step: Count
    channel: Name
    place: Annotated[list[Count], Field(max_length=3)]


class _Control(_Strict):
    joints: list[Name]
    error: list[Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None]
    clipped: list[Count | None]


class _Run(_Strict):
    steps: Count
    step_seconds: Seconds
    cpu_seconds: Seconds
    control_seconds: Seconds
    record_seconds: Seconds
    run_seconds: Seconds
    failed: _Failed | None
    control: _Control | None = None


class _Motion(_Strict):
    steps: Count


RESULTS: Mapping[str, type[BaseModel]] = {"run": _Run, "motion": _Motion}
"""What an operation's plain result is, where it is more than nothing; ``read_back``'s is a ReadBack."""


# --- reading ----------------------------------------------------------------------------------------------------------


def read_answers(folder: Path, operations: Sequence[Operation]) -> tuple[list[Answer], dict[str, str], str | None]:
    """The answers in ``folder``, the versions, and None; or nothing, and the error that the engine answered.

    Raises FileNotFoundError when there is no result.json, BadAnswerError for everything that is not an answer.
    """
    try:
        content = read_bytes(folder / "result.json", JSON_BYTES)
    except (NotReadableError, PermissionError, IsADirectoryError, NotADirectoryError) as error:
        raise BadAnswerError(f"its result.json cannot be read: {error}") from None
    refused = _parsed(_Error, content) if b'"error"' in content[:64] else None
    if isinstance(refused, _Error):
        return [], {}, refused.error
    result = _parsed(_Result, content)
    del content
    if len(result.operations) != len(operations):
        raise BadAnswerError(f"{len(result.operations)} answers to {len(operations)} operations")
    names = ("engine_version", "python_version", "numpy_version", "platform", "machine")
    versions = {name: str(getattr(result, name)) for name in names}
    offset, answers = 0, []
    total = sum(_bytes(one) for entry in result.operations for one in entry.arrays.values() if one.stored)
    try:
        for index, (operation, entry) in enumerate(zip(operations, result.operations, strict=True)):
            try:
                answers.append(_answer(folder, index, operation, entry, offset, total))
            except (BadAnswerError, NotReadableError) as error:
                message = f"answer {index} ({operation.op}): {error}"
                if not operation.parameters.get("attempt", False):
                    raise BadAnswerError(message) from None
                answers.append(_refused(entry, message))
            offset += sum(_bytes(one) for one in entry.arrays.values() if one.stored)
    except OSError as error:
        raise BadAnswerError(f"its arrays cannot be read: {error.strerror or error}") from None
    return answers, versions, None


def _parsed(model: type[Model], content: bytes) -> Model:
    try:
        return model.model_validate_json(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise BadAnswerError(
            clipped(f"its result.json is wrong: {where}: {first['msg']}".replace(": : ", ": "))
        ) from None


def _bytes(described: _Array) -> int:
    return 8 * math.prod(described.shape)


def _refused(entry: _Entry, message: str) -> Answer:
    """The answer to an attempt that came to nothing."""
    return Answer({"refused": message}, {}, entry.load_seconds, entry.seconds, entry.log)


def _answer(folder: Path, index: int, operation: Operation, entry: _Entry, offset: int, total: int) -> Answer:
    """One answer; its arrays begin at ``offset`` in result.bin, which is ``total`` bytes long."""
    refusal = entry.result.get("refused")
    if operation.parameters.get("attempt", False) and entry.op == operation.op and isinstance(refusal, str):
        return _refused(entry, clipped(refusal, worker.MESSAGE))
    if entry.op != operation.op:
        raise BadAnswerError(f"answers {clipped(repr(entry.op))}")
    forms = FORMS[operation.op]
    asked = _conditions(operation)
    wanted = {name: form for name, form in forms.items() if not form.when or form.when in asked}
    if set(entry.arrays) != set(wanted):
        odd = ", ".join(sorted(set(entry.arrays) ^ set(wanted)))
        raise BadAnswerError(clipped(f"arrays that are missing, or were not asked for: {odd}"))
    dimensions = _dimensions(operation)
    arrays = {}
    for name, described in entry.arrays.items():
        _fit(name, described, wanted[name], dimensions)
        size = _bytes(described)
        if described.stored:
            arrays[name] = _read(folder / "result.bin", described, offset, total)
            offset += size
        else:
            arrays[name] = _read(folder / f"{index}.{name}.bin", described, 0, size)
    result, held = entry.result, None
    if operation.op == "read_back":
        held = read_back(result)
    elif operation.op in RESULTS:
        result = _plain(RESULTS[operation.op], result)
    elif result:
        raise BadAnswerError("more than was asked for")
    if operation.op == "run":
        arrays = _run(operation, result, arrays)
    elif operation.op == "motion":
        _motion(operation, result, arrays)
    elif operation.op == "touching":
        _touching(arrays["touching"], dimensions)
    return Answer(result, arrays, entry.load_seconds, entry.seconds, entry.log, held)


def _plain(model: type[BaseModel], value: dict[str, Any]) -> dict[str, Any]:
    try:
        return model.model_validate(value).model_dump()
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise BadAnswerError(clipped(f"its result is wrong: {where}: {first['msg']}")) from None


def _conditions(operation: Operation) -> set[str]:
    """What is asked for beside what is always answered: the channels, and ``control``."""
    found = set(operation.parameters.get("channels", ())) & {"energy", "contacts"}
    return found | ({"control"} if "control" in operation.parameters else set())


def _planned(operation: Operation) -> int | None:
    """How many rows an operation gives when it does all its steps; None where that is the engine's to say."""
    asked = operation.parameters
    if operation.op in ("kinematics", "dynamics", "trials"):
        return len(operation.arrays["q"])
    if operation.op in ("motion", "respond", "run"):
        return 1 + -(-asked["steps"] // asked["every"])
    if operation.op == "drive":
        return 1 + sum(-(-steps // every) for steps, every in asked["phases"])
    return None


def _dimensions(operation: Operation) -> dict[str, int]:
    """The dimensions that the request knows. ``rows`` is left to the answer where it may end before its time."""
    found = {}
    for name, size in (("q", "nq"), ("v", "nv")):
        if name in operation.arrays:
            found[size] = int(operation.arrays[name].shape[-1])
    if "q" in operation.arrays and operation.op == "touching":
        found["states"] = len(operation.arrays["q"])
    rows = _planned(operation)
    if rows is not None and operation.op not in ("motion", "run"):
        found["rows"] = rows
    world = operation.world
    if world is not None:
        places = layout(world.bodies)
        found |= {"bodies": len(world.bodies), "nq": places.nq, "nv": places.nv}
        if operation.op == "respond":
            found["joints"] = len(driven_joints(world))
    return found


def _fit(name: str, described: _Array, form: Form, dimensions: dict[str, int]) -> None:
    """Hold an array against its form; dimensions that are not known yet become this array's."""
    if described.kind != form.kind:
        raise BadAnswerError(f"{name} is of kind {described.kind}, should be {form.kind}")
    shape = described.shape
    expected = [
        dimensions.setdefault(one, shape[k]) if isinstance(one, str) else one
        for k, one in enumerate(form.shape)
        if k < len(shape)
    ]
    if len(shape) != len(form.shape) or list(shape) != expected:
        wanted = ", ".join(str(dimensions.get(one, one)) if isinstance(one, str) else str(one) for one in form.shape)
        raise BadAnswerError(f"{name} has shape ({', '.join(map(str, shape))}), should be ({wanted})")


def _read(path: Path, described: _Array, offset: int, total: int) -> np.ndarray:
    """The array at ``offset`` of a file that must be ``total`` bytes long; mapped when it is large."""
    kind, shape = np.dtype(f"<{described.kind}"), tuple(described.shape)
    size = _bytes(described)
    if total > RECORDED_BYTES:
        raise BadAnswerError(f"{path.name} is {total:,} bytes, more than the {RECORDED_BYTES:,} that are read")
    with os.fdopen(open_regular(path, RECORDED_BYTES), "rb") as file:
        there = os.fstat(file.fileno()).st_size
        if there != total:
            raise BadAnswerError(f"{path.name} has {there:,} bytes, should have {total:,}")
        if not size:
            return np.zeros(shape, kind)
        if size > MAPPED_BYTES:
            return np.memmap(file, kind, "r", offset, shape)
        file.seek(offset)
        content = file.read(size)
    if len(content) != size:
        raise BadAnswerError(f"{path.name} ends at {offset + len(content):,} bytes, should have {total:,}")
    return np.frombuffer(content, kind).reshape(shape).copy()


# --- what single operations must give ---------------------------------------------------------------------------------


def read_back(value: Mapping[str, Any]) -> ReadBack:
    """The read-back from plain data. Raises BadAnswerError where it is none, or holds no numbers where numbers must be."""
    try:
        held = from_plain(ReadBack, value)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        raise BadAnswerError(clipped(f"no read-back: {type(error).__name__}: {error}")) from None
    seen = set()
    for body in held.bodies:
        joint, place = body.joint, clipped(f"body {body.name!r}")
        if body.name in seen:
            raise BadAnswerError(f"{place} is there twice")
        seen.add(body.name)
        if joint.kind not in JOINT_KINDS:
            raise BadAnswerError(clipped(f"{place}: no joint is a {joint.kind!r}"))
        sizes = ((joint.position, POSITION_SIZE, "position"), (joint.velocity, VELOCITY_SIZE, "velocity"))
        for numbers, table, what in sizes:
            if len(numbers) not in (0, table[joint.kind]):
                raise BadAnswerError(f"{place}: {what} has {len(numbers)} numbers, should have {table[joint.kind]}")
        turns = [joint.origin.quaternion, *(shape.pose.quaternion for shape in body.shapes)]
        if joint.kind in ("ball", "free") and joint.position:
            turns.append(joint.position[-4:])  # type: ignore[arg-type]
        if not all(abs(math.hypot(*turn) - 1.0) <= UNIT for turn in turns):
            raise BadAnswerError(f"{place}: an orientation that is no unit quaternion")
        for shape in body.shapes:
            if shape.kind not in SHAPE_KINDS:
                raise BadAnswerError(clipped(f"{place}: no shape is a {shape.kind!r}"))
    for name in ("unreadable", "inventory", "neutral"):
        for key, one in getattr(held, name).items():
            if not _plain_value(one) or (name == "unreadable" and not isinstance(one, str)):
                raise BadAnswerError(clipped(f"{name}: {key} is a {type(one).__name__}"))
    return held


def _plain_value(value: Any) -> bool:
    items = value if isinstance(value, list) else [value]
    # a whole number that no double holds would end every comparison of numbers
    return all(isinstance(item, (float, str)) or (isinstance(item, int) and abs(item) < 2**63) for item in items)


def _touching(found: np.ndarray, dimensions: Mapping[str, int]) -> None:
    bounds = (dimensions.get("states"), dimensions.get("bodies"), dimensions.get("bodies"))
    for column, (bound, what) in enumerate(zip(bounds, ("states", "bodies", "bodies"), strict=True)):
        values = found[:, column]
        if len(values) and (values.min() < 0 or (bound is not None and values.max() >= bound)):
            raise BadAnswerError(f"touching names {what} that there are not")


def _motion(operation: Operation, result: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """All rows are there, unless the motion stopped being finite."""
    rows, planned = len(arrays["pose"]), _planned(operation)
    if not 1 <= rows <= planned or (rows < planned and np.isfinite(arrays["pose"][-1]).all()):  # type: ignore[operator]
        raise BadAnswerError(f"{rows} rows, should be {planned}")
    if result["steps"] != min((rows - 1) * operation.parameters["every"], operation.parameters["steps"]):
        raise BadAnswerError(f"{rows} rows of {result['steps']} steps")


def _run(operation: Operation, result: dict[str, Any], arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of a run, ``step`` as whole numbers: all rows there and finite, or, where it failed, all but the last."""
    asked, failed, rows = operation.parameters, result["failed"], len(arrays["step"])
    planned = np.minimum(np.arange(rows) * asked["every"], asked["steps"])
    whole = rows == _planned(operation)
    if not (rows and np.array_equal(arrays["step"], planned) and result["steps"] == planned[-1] and (whole or failed)):
        raise BadAnswerError(f"{rows} rows, should be {_planned(operation)}, one every {asked['every']} steps")
    release(arrays["step"])
    if failed is not None and (failed["channel"] not in arrays or failed["step"] != result["steps"]):
        raise BadAnswerError("it says that it failed, but not after its last step")
    certain = rows - (failed is not None)
    for name in ("q", "v", "pose", "velocity", "energy", "control.target"):
        if name in arrays and not all_finite(arrays[name][:certain]):
            raise BadAnswerError(f"{name} is not finite, and the run is not said to have failed")
    if "control" in asked:
        _check_control(operation, result, arrays, certain)
    elif result["control"] is not None:
        raise BadAnswerError("controllers where none were asked for")
    if "contact.row" in arrays:
        _check_contacts(operation, arrays, rows, certain)
    return {**arrays, "step": planned}


def _check_control(
    operation: Operation, result: Mapping[str, Any], arrays: Mapping[str, np.ndarray], certain: int
) -> None:
    told = result["control"]
    if told is None:
        raise BadAnswerError("no word of the controllers")
    joints, columns = told["joints"], arrays["control.target"].shape[1]
    if not len(joints) == len(told["error"]) == len(told["clipped"]) == columns or len(set(joints)) != columns:
        raise BadAnswerError(f"{len(joints)} driven joints, and {columns} columns of them")
    if operation.world is not None:
        unknown = set(joints) - {body.joint.name for body in operation.world.bodies}
        missing = set(driven_joints(operation.world)) - set(joints)
        if unknown or missing:
            odd = ", ".join(sorted(unknown | missing))
            raise BadAnswerError(clipped(f"driven joints that are missing, or not the world's: {odd}"))
    # the efforts of the engine's own controllers are not known: None in the count of clipped steps, NaN in the rows
    known = np.array([one is not None for one in told["clipped"]], dtype=bool)
    effort = arrays["control.effort"][:certain]
    for part in blocks(len(effort), effort[:1].nbytes):
        if not np.isfinite(effort[part][:, known]).all():
            raise BadAnswerError("control.effort is not finite, and the run is not said to have failed")
    release(effort)


def _check_contacts(operation: Operation, arrays: Mapping[str, np.ndarray], rows: int, certain: int) -> None:
    row, body = arrays["contact.row"], arrays["contact.body"]
    bodies = arrays["pose"].shape[1]
    last = 0
    for part in blocks(len(row), 8):
        some = row[part]
        if len(some) and (some[0] < last or some[-1] >= rows or (np.diff(some) < 0).any()):
            raise BadAnswerError("contact.row does not go through the rows")
        if len(some):
            last = int(some[-1])
        if ((body[part] < 0) | (body[part] >= bodies)).any():
            raise BadAnswerError("contact.body names bodies that there are not")
    release(body)
    count = int(np.searchsorted(row, certain))
    for name in ("position", "normal", "distance", "normal_force"):
        if not all_finite(arrays[f"contact.{name}"][:count]):
            raise BadAnswerError(f"contact.{name} is not finite, and the run is not said to have failed")
