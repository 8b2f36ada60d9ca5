"""What goes to another machine and comes back, as bytes: JSON, and contents that it names. Nothing in it is code: whoever
unpacks it gets data, whatever was sent."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

from pydantic import ValidationError

from simspec.experiments.executors.contract import Task
from simspec.experiments.result import TaskResult, Write
from simspec.files import NotReadableError, parse_json
from simspec.stored import SweptAsked, SweptResult

MARK = b"simspec parcel 1\n"
LENGTH = 8
"""Bytes of the length of the JSON, which follows the mark."""
LARGEST_CONTENT = 2**31
"""Bytes that one content may have unpacked."""
_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")


class ParcelError(ValueError):
    """What came is no parcel, or not the one that was expected. The message is the reason."""


@dataclass(frozen=True)
class Parcel:
    """``facts``: plain data; ``contents``: bytes by name."""

    facts: Mapping[str, Any]
    contents: Mapping[str, bytes]

    def pack(self, compress: bool = False) -> bytes:
        """All of it in one piece; ``compress``: contents that are not compressed already."""
        packed = {name: zlib.compress(content, 6) if compress else content for name, content in self.contents.items()}
        sizes = [[name, len(content)] for name, content in packed.items()]
        head = json.dumps({"facts": self.facts, "contents": sizes, "compressed": compress}, allow_nan=False).encode()
        return b"".join([MARK, len(head).to_bytes(LENGTH, "big"), head, *packed.values()])

    @classmethod
    def unpack(cls, packed: bytes) -> Parcel:
        """The inverse of :meth:`pack`. Raises ParcelError for anything else."""
        start = len(MARK) + LENGTH
        if not isinstance(packed, bytes) or packed[: len(MARK)] != MARK:
            raise ParcelError("not a parcel of this simspec")
        end = start + int.from_bytes(packed[len(MARK) : start], "big")
        try:
            head = parse_json(packed[start:end])
            facts, compressed = head["facts"], head["compressed"]
            contents: dict[str, bytes] = {}
            for name, size in head["contents"]:
                contents[_new(name, contents)] = _content(packed[end : end + size], size, compressed)
                end += size
        except (NotReadableError, KeyError, TypeError, ValueError, zlib.error) as error:
            raise ParcelError(f"damaged: {str(error)[:200]}") from None
        if end != len(packed) or not isinstance(facts, dict):
            raise ParcelError("damaged: it has another length than it says")
        return cls(facts, contents)


def _new(name: Any, contents: Mapping[str, bytes]) -> str:
    """The name of another content. Raises ValueError where it is none, or taken."""
    if type(name) is not str or name in contents:
        raise ValueError(f"a content {str(name)[:80]!r}")
    return name


def _content(packed: bytes, size: int, compressed: bool) -> bytes:
    """Raises ValueError where it is not whole, or too large."""
    if type(size) is not int or size < 0 or len(packed) != size:
        raise ValueError("it ends early")
    if not compressed:
        return packed
    unpacker = zlib.decompressobj()
    content = unpacker.decompress(packed, LARGEST_CONTENT)
    if not unpacker.eof or unpacker.unused_data:
        raise ValueError("a content is too large, or not whole")
    return content


def task_data(task: Task) -> dict[str, Any]:
    """A task as plain data."""
    return {field.name: getattr(task, field.name) for field in dataclasses.fields(task)}


def task_from(data: Mapping[str, Any]) -> Task:
    """The inverse of :func:`task_data`. Raises TypeError where fields are missing or unknown."""
    return Task(**data)


def result_data(result: TaskResult, prefix: str) -> tuple[dict[str, Any], dict[str, bytes]]:
    """A result as plain data, and its tables as they will be stored, by names that begin with ``prefix``."""
    tables, rows = {}, {}
    for name, write in result.tables.items():
        file = io.BytesIO()
        rows[name] = write(file)
        tables[f"{prefix}{name}"] = file.getvalue()
    facts = {"key": result.key, "result": result.result, "asked": result.asked, "circumstances": result.circumstances}
    return {**facts, "rows": rows}, tables


def result_from(data: Any, contents: Mapping[str, bytes], prefix: str) -> TaskResult:
    """The inverse of :func:`result_data`. Raises ParcelError where that is not what a run comes to."""
    try:
        SweptResult.model_validate({**data["result"], "tables": {}})
        SweptAsked.model_validate(data["asked"])
        rows, circumstances = dict(data["rows"]), dict(data["circumstances"])
        strange = [name for name, count in rows.items() if not _NAME.fullmatch(name) or type(count) is not int]
        tables = {name: _writer(contents[f"{prefix}{name}"], count) for name, count in rows.items()}
        key = str(data["key"])
    except (ValidationError, KeyError, TypeError, ValueError) as error:
        raise ParcelError(f"not the result of a run: {str(error)[:200]}") from None
    if strange:
        raise ParcelError(f"not the result of a run: a table {strange[0]!r}")
    return TaskResult(key, data["result"], data["asked"], circumstances, tables)


def _writer(content: bytes, rows: int) -> Write:
    def write(file: BinaryIO) -> int:
        file.write(content)
        return rows

    return write
