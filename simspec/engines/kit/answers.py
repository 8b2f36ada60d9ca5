"""The one place where answers are read: nothing that comes back from an engine's process is believed.

The other side may be damaged, of another version, or hostile: an answer of any other kind, shape or size than declared
(``answer_forms.py``) is a :class:`BadAnswerError` that says what is wrong with it. Runs in the driver only (pydantic, large
arrays on disk).
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from simspec.control.reference import driven_joints
from simspec.engines.kit import worker
from simspec.engines.kit.arrays import SECONDS
from simspec.engines.kit.request import (
    FORMS,
    RESULTS,
    Answer,
    BadAnswerError,
    Described,
    Entry,
    Form,
    Operation,
    Refusal,
    Result,
    conditions,
    dimensions_of,
    planned_rows,
)
from simspec.errors import clipped
from simspec.files import (
    MAPPED_BYTES,
    RECORDED_BYTES,
    NotReadableError,
    all_finite,
    open_regular,
    parts,
    read_bytes,
    release,
    zeros,
)
from simspec.language.vocabulary import JOINT_KINDS, QUATERNION_JOINTS, SHAPE_KINDS
from simspec.world.canonical import from_plain
from simspec.world.types import POSITION_SIZE, VELOCITY_SIZE, ReadBack

# Requirements on the answers of single operations beyond kinds and shapes. Driver only.

UNIT = 1e-6
"""How far from 1 the length of a quaternion that was read back may be: that of a single-precision one is 1e-7."""


def read_back(value: Mapping[str, Any], foreign: bool = False) -> ReadBack:
    """The read-back from plain data; of a foreign file (``foreign``) with joints and shapes of kinds that simspec does
    not have. Raises BadAnswerError where it is none, or is not finite where it must be."""
    try:
        back: ReadBack = from_plain(ReadBack, value)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        raise BadAnswerError(clipped(f"no read-back: {type(error).__name__}: {error}")) from None
    seen = set()
    for body in back.bodies:
        joint, place = body.joint, clipped(f"body {body.name!r}")
        if body.name in seen:
            raise BadAnswerError(f"{place} is duplicated")
        seen.add(body.name)
        if joint.kind not in JOINT_KINDS and not foreign:
            raise BadAnswerError(clipped(f"{place}: unknown kind of joint: {joint.kind!r}"))
        sizes = ((joint.position, POSITION_SIZE, "position"), (joint.velocity, VELOCITY_SIZE, "velocity"))
        for numbers, table, what in sizes:
            if joint.kind in table and len(numbers) not in (0, table[joint.kind]):
                raise BadAnswerError(f"{place}: {what} has {len(numbers)} numbers, should have {table[joint.kind]}")
        turns: list[tuple[float, ...]] = [joint.origin.quaternion, *(shape.pose.quaternion for shape in body.shapes)]
        if joint.kind in QUATERNION_JOINTS and joint.position:
            turns.append(joint.position[-4:])
        if not all(abs(math.hypot(*turn) - 1.0) <= UNIT for turn in turns):
            raise BadAnswerError(f"{place}: the orientation is not a unit quaternion")
        for shape in body.shapes:
            if shape.kind not in SHAPE_KINDS and not foreign:
                raise BadAnswerError(clipped(f"{place}: unknown kind of shape: {shape.kind!r}"))
    for name in ("unreadable", "inventory", "neutral"):
        for key, entry in getattr(back, name).items():
            if not _plain_value(entry) or (name == "unreadable" and not isinstance(entry, str)):
                raise BadAnswerError(clipped(f"{name}: {key} is a {type(entry).__name__}"))
    return back


def _plain_value(value: Any) -> bool:
    items = value if isinstance(value, list) else [value]
    # a whole number that no double holds would end every comparison of numbers
    return all(isinstance(item, (float, str)) or (isinstance(item, int) and abs(item) < 2**63) for item in items)


def check_touching(result: Mapping[str, Any], arrays: Mapping[str, np.ndarray], dimensions: Mapping[str, int]) -> None:
    """Each row names a state, and two bodies or units, that there are; units are of bodies that there are, or of none."""
    states, bodies = dimensions.get("states"), dimensions.get("bodies")
    for name, things in (("touching", bodies), ("units", len(result["units"]))):
        for column, bound in enumerate((states, things, things)):
            values = arrays[name][:, column]
            if len(values) and (values.min() < 0 or (bound is not None and values.max() >= bound)):
                raise BadAnswerError(f"{name} names {'things' if column else 'states'} that there are not")
    if bodies is not None and any(unit["body"] >= bodies for unit in result["units"]):
        raise BadAnswerError("units contain unknown bodies")


def check_motion(operation: Operation, result: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """All rows are there, unless the motion stopped being finite."""
    rows, planned = len(arrays["pose"]), planned_rows(operation)
    if not 1 <= rows <= planned or (rows < planned and np.isfinite(arrays["pose"][-1]).all()):  # type: ignore[operator]
        raise BadAnswerError(f"{rows} rows, should be {planned}")
    if result["steps"] != min((rows - 1) * operation.parameters["every"], operation.parameters["steps"]):
        raise BadAnswerError(f"{rows} rows of {result['steps']} steps")


def checked_run(operation: Operation, result: dict[str, Any], arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of a run, ``step`` as whole numbers: all rows there and finite, or, where it failed, all but the last."""
    requested, failed, rows = operation.parameters, result["failed"], len(arrays["step"])
    planned, same = zeros((rows,), int), True
    for part in parts(rows, 8, planned, arrays["step"]):
        planned[part] = np.minimum(np.arange(part.start, part.stop) * requested["every"], requested["steps"])
        same = same and np.array_equal(arrays["step"][part], planned[part])
    if not rows or (rows != planned_rows(operation) and not failed):
        raise BadAnswerError(f"{rows} rows, should be {planned_rows(operation)}, one every {requested['every']} steps")
    if not same:
        raise BadAnswerError(
            f"the steps of its {rows} rows are not one every {requested['every']} of {requested['steps']}"
        )
    if result["steps"] != planned[-1]:
        raise BadAnswerError(f"its last row is of step {planned[-1]}, and it reports {result['steps']} steps")
    if failed is not None and (failed["channel"] not in arrays or failed["step"] != result["steps"]):
        raise BadAnswerError("it reports a failure, but not after its last step")
    certain = rows - (failed is not None)
    for name in ("q", "v", "pose", "velocity", "energy", "control.target"):
        if name in arrays and not all_finite(arrays[name][:certain]):
            raise BadAnswerError(f"{name} is not finite, and the run is not reported as failed")
    if "control" in requested:
        _check_control(operation, result, arrays, certain)
    elif result["control"] is not None:
        raise BadAnswerError("controllers that were not requested")
    if "contact.row" in arrays:
        check_contacts(arrays, rows, certain)
    if "seconds" in arrays:
        _check_seconds(result, arrays["seconds"])
    _check_units(operation, result["contact_units"], arrays)
    return {**arrays, "step": planned}


ROUNDING = 1e-9
"""s, and relative: by how much the last row of ``seconds`` may exceed the totals, which may be added up in another order."""


def _check_seconds(result: Mapping[str, Any], seconds: np.ndarray) -> None:
    """Seconds never fall, and the last row is within the totals."""
    last = np.zeros(len(SECONDS))
    for part in parts(len(seconds), seconds[:1].nbytes, seconds):
        rows = np.vstack([last, seconds[part]])
        if not (np.isfinite(rows).all() and (np.diff(rows, axis=0) >= 0.0).all()):
            raise BadAnswerError("seconds are not finite, or fall from one row to the next")
        last = rows[-1]
    totals = {
        "step": "step_seconds",
        "step_cpu": "cpu_seconds",
        "control": "control_seconds",
        "record": "record_seconds",
    }
    for name, total in totals.items():
        if last[SECONDS.index(name)] > result[total] * (1.0 + ROUNDING) + ROUNDING:
            raise BadAnswerError(f"seconds: more in {name} than {total}")


def _check_control(
    operation: Operation, result: Mapping[str, Any], arrays: Mapping[str, np.ndarray], certain: int
) -> None:
    control = result["control"]
    if control is None:
        raise BadAnswerError("the controllers are missing")
    joints, columns = control["joints"], arrays["control.target"].shape[1]
    if not len(joints) == len(control["error"]) == len(control["clipped"]) == columns or len(set(joints)) != columns:
        raise BadAnswerError(f"{len(joints)} driven joints, and {columns} columns of them")
    if operation.world is not None:
        unknown = set(joints) - {body.joint.name for body in operation.world.bodies}
        missing = set(driven_joints(operation.world)) - set(joints)
        if unknown or missing:
            text = ", ".join(sorted(unknown | missing))
            raise BadAnswerError(clipped(f"driven joints that are missing, or not the world's: {text}"))
    # the efforts of the engine's own controllers are not known: None in the count of clipped steps, NaN in the rows
    known = np.array([entry is not None for entry in control["clipped"]], dtype=bool)
    effort = arrays["control.effort"][:certain]
    for part in parts(len(effort), effort[:1].nbytes, effort):
        if not np.isfinite(effort[part][:, known]).all():
            raise BadAnswerError("control.effort is not finite, and the run is not reported as failed")


def _check_units(
    operation: Operation, units: Sequence[Mapping[str, Any]] | None, arrays: Mapping[str, np.ndarray]
) -> None:
    """Units of contacts are there with their list or not at all; each is of its contact's body, and of shapes of that body."""
    if (units is None) != ("contact.unit" not in arrays):
        raise BadAnswerError("contact.unit and contact_units come together or not at all")
    if units is None:
        return
    values, body = arrays["contact.unit"], arrays["contact.body"]
    bodies = np.array([unit["body"] for unit in units], dtype=np.int64)
    used = np.zeros(len(units), dtype=bool)
    for part in parts(len(values), 64, values, body):
        if ((values[part] < 0) | (values[part] >= len(units))).any():
            raise BadAnswerError("contact.unit names units that are not in contact_units")
        if (bodies[values[part]] != body[part]).any():
            raise BadAnswerError("contact.unit names units of other bodies than contact.body")
        used[values[part]] = True
    for number in np.flatnonzero(used).tolist():
        unit = units[number]
        if not unit["shapes"]:
            raise BadAnswerError(f"contact_units: unit {number} touches, and has no shapes")
        if operation.world is not None:
            body = operation.world.bodies[unit["body"]]
            if unexpected := set(unit["shapes"]) - {shape.name for shape in body.shapes}:
                message = f"contact_units: {sorted(unexpected)[0]!r} is no shape of {body.name!r}"
                raise BadAnswerError(clipped(message))


def check_contacts(arrays: Mapping[str, np.ndarray], rows: int, certain: int) -> None:
    """Contacts are of bodies that there are, in the order of the rows, and finite in the first ``certain`` of them."""
    row, body = arrays["contact.row"], arrays["contact.body"]
    bodies = arrays["pose"].shape[1]
    last = 0
    for part in parts(len(row), 24, row, body):
        some = row[part]
        if len(some) and (some[0] < last or some[-1] >= rows or (np.diff(some) < 0).any()):
            raise BadAnswerError("contact.row does not match the rows")
        if len(some):
            last = int(some[-1])
        if ((body[part] < 0) | (body[part] >= bodies)).any():
            raise BadAnswerError("contact.body contains unknown bodies")
    count = int(np.searchsorted(row, certain))
    release(row)
    for name in ("position", "normal", "distance", "normal_force"):
        if not all_finite(arrays[f"contact.{name}"][:count]):
            raise BadAnswerError(f"contact.{name} is not finite, and the run is not reported as failed")


JSON_BYTES = 64_000_000
"""Largest result.json. The largest of the library's is below 1 MB; 2,000 bodies with explicit pairs need 20 MB."""

Model = TypeVar("Model", bound=BaseModel)


def read_answers(folder: Path, operations: Sequence[Operation]) -> tuple[list[Answer], dict[str, str], str | None]:
    """The answers in ``folder``, the versions, and None; or nothing, and the error that the engine answered.

    Raises FileNotFoundError when there is no result.json, BadAnswerError for everything that is not an answer.
    """
    try:
        content = read_bytes(folder / "result.json", JSON_BYTES)
    except (NotReadableError, PermissionError, IsADirectoryError, NotADirectoryError) as error:
        raise BadAnswerError(f"its result.json cannot be read: {error}") from None
    refused = _parsed(Refusal, content) if b'"error"' in content[:64] else None
    if isinstance(refused, Refusal):
        return [], {}, refused.error
    result = _parsed(Result, content)
    del content
    if len(result.operations) != len(operations):
        raise BadAnswerError(f"{len(result.operations)} answers to {len(operations)} operations")
    names = ("engine_version", "python_version", "numpy_version", "platform", "machine")
    versions = {name: str(getattr(result, name)) for name in names}
    offset, answers = 0, []
    total = sum(_bytes(array) for entry in result.operations for array in entry.arrays.values() if array.stored)
    try:
        for index, (operation, entry) in enumerate(zip(operations, result.operations, strict=True)):
            try:
                answers.append(_answer(folder, index, operation, entry, offset, total))
            except (BadAnswerError, NotReadableError) as error:
                message = f"answer {index} ({operation.op}): {error}"
                if not operation.parameters.get("attempt", False):
                    raise BadAnswerError(message) from None
                answers.append(_refused(entry, message))
            offset += sum(_bytes(array) for array in entry.arrays.values() if array.stored)
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


def _bytes(described: Described) -> int:
    return 8 * math.prod(described.shape)


def _refused(entry: Entry, message: str) -> Answer:
    """The answer to an attempt that came to nothing."""
    return Answer({"refused": message}, {}, entry.load_seconds, entry.seconds, entry.log)


def _answer(folder: Path, index: int, operation: Operation, entry: Entry, offset: int, total: int) -> Answer:
    """One answer; its arrays begin at ``offset`` in result.bin, which is ``total`` bytes long."""
    refusal = entry.result.get("refused")
    if operation.parameters.get("attempt", False) and entry.op == operation.op and isinstance(refusal, str):
        return _refused(entry, clipped(refusal, worker.MESSAGE))
    if entry.op != operation.op:
        raise BadAnswerError(f"answers {clipped(repr(entry.op))}")
    forms = FORMS[operation.op]
    requested = conditions(operation)
    wanted = {name: form for name, form in forms.items() if not form.when or form.when in requested}
    needed = {name for name, form in wanted.items() if not form.optional}
    if not needed <= set(entry.arrays) <= set(wanted):
        text = ", ".join(sorted((set(entry.arrays) - set(wanted)) | (needed - set(entry.arrays))))
        raise BadAnswerError(clipped(f"missing or unrequested arrays: {text}"))
    dimensions = dimensions_of(operation)
    arrays = {}
    for name, described in entry.arrays.items():
        _fit(name, described, wanted[name], dimensions)
        size = _bytes(described)
        if described.stored:
            arrays[name] = _read(folder / "result.bin", described, offset, total)
            offset += size
        else:
            arrays[name] = _read(folder / f"{index}.{name}.bin", described, 0, size)
    result, back = entry.result, None
    if operation.op in ("read_back", "foreign"):
        back = read_back(result, foreign=operation.op == "foreign")
    elif operation.op in RESULTS:
        result = _plain(RESULTS[operation.op], result)
    elif result:
        raise BadAnswerError("more than was requested")
    if operation.op == "run":
        arrays = checked_run(operation, result, arrays)
    elif operation.op in ("motion", "pushed", "prescribed"):
        check_motion(operation, result, arrays)
    elif operation.op == "windows" and "contact.row" in arrays:
        check_contacts(arrays, len(arrays["pose"]), 0)
    elif operation.op == "touching":
        check_touching(result, arrays, dimensions)
    return Answer(result, arrays, entry.load_seconds, entry.seconds, entry.log, back)


def _plain(model: type[BaseModel], value: dict[str, Any]) -> dict[str, Any]:
    try:
        return model.model_validate(value).model_dump()
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise BadAnswerError(clipped(f"its result is wrong: {where}: {first['msg']}")) from None


def _fit(name: str, described: Described, form: Form, dimensions: dict[str, int]) -> None:
    """Hold an array against its form; dimensions that are not known yet become this array's."""
    if described.kind != form.kind:
        raise BadAnswerError(f"{name} is of kind {described.kind}, should be {form.kind}")
    shape = described.shape
    expected = [
        dimensions.setdefault(entry, shape[k]) if isinstance(entry, str) else entry
        for k, entry in enumerate(form.shape)
        if k < len(shape)
    ]
    if len(shape) != len(form.shape) or list(shape) != expected:
        wanted = ", ".join(
            str(dimensions.get(entry, entry)) if isinstance(entry, str) else str(entry) for entry in form.shape
        )
        raise BadAnswerError(f"{name} has shape ({', '.join(map(str, shape))}), should be ({wanted})")


def _read(path: Path, described: Described, offset: int, total: int) -> np.ndarray:
    """The array at ``offset`` of a file that must be ``total`` bytes long; mapped, and not to be written, when it is large."""
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
