"""The one place where answers are read: nothing that comes back from an engine's process is believed.

The other side may be damaged, of another version, or hostile: an answer of any other kind, shape or size than declared
(``answer_forms.py``) is a :class:`BadAnswerError` that says what is wrong with it. Runs in the driver only (pydantic, large
arrays on disk).
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from simspec.engines.kit import worker
from simspec.engines.kit.answer_checks import check_contacts, check_motion, check_touching, checked_run, read_back
from simspec.engines.kit.answer_forms import (
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
)
from simspec.errors import clipped
from simspec.mapped import MAPPED_BYTES, RECORDED_BYTES
from simspec.reading import NotReadableError, open_regular, read_bytes

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
    asked = conditions(operation)
    wanted = {name: form for name, form in forms.items() if not form.when or form.when in asked}
    needed = {name for name, form in wanted.items() if not form.optional}
    if not needed <= set(entry.arrays) <= set(wanted):
        odd = ", ".join(sorted((set(entry.arrays) - set(wanted)) | (needed - set(entry.arrays))))
        raise BadAnswerError(clipped(f"missing or unrequested arrays: {odd}"))
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
    result, held = entry.result, None
    if operation.op in ("read_back", "foreign"):
        held = read_back(result, foreign=operation.op == "foreign")
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
    return Answer(result, arrays, entry.load_seconds, entry.seconds, entry.log, held)


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
        dimensions.setdefault(one, shape[k]) if isinstance(one, str) else one
        for k, one in enumerate(form.shape)
        if k < len(shape)
    ]
    if len(shape) != len(form.shape) or list(shape) != expected:
        wanted = ", ".join(str(dimensions.get(one, one)) if isinstance(one, str) else str(one) for one in form.shape)
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
