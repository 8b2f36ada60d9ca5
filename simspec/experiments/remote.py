"""Execution of a batch of tasks on another machine: each run in a separate process, as on this one. Bytes come in and bytes go
out."""

from __future__ import annotations

import atexit
import contextlib
import dataclasses
import functools
import io
import json
import platform
import re
import time
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO

from pydantic import ValidationError

from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, SimspecError
from simspec.experiments.executors import Supplies, Task, packed
from simspec.experiments.store import TaskResult, Write
from simspec.experiments.timing import versions_of
from simspec.files import NotReadableError, parse_json, scratch_folder
from simspec.outputs.writing import Artifacts
from simspec.runner.execution import failed_run, run_case
from simspec.runner.run import Case, shared_world
from simspec.stored import SweptRequest, SweptResult
from simspec.world.canonical import canonical_json, from_plain, sha256
from simspec.world.types import World

# Messages to another machine and back, as bytes: JSON, and contents that it names. They contain no code: unpacking any bytes
# yields data.

MARK = b"simspec parcel 1\n"
LENGTH = 8
"""Bytes of the length of the JSON, which follows the mark."""
LARGEST_CONTENT = 2**31
"""Bytes that one content may have unpacked."""
_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")


class ParcelError(ValueError):
    """The received bytes are no parcel, or not the expected one. The message is the reason."""

    code = "E204"


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
    facts = {"key": result.key, "result": result.result, "asked": result.request, "circumstances": result.circumstances}
    return {**facts, "rows": rows}, tables


def result_from(data: Any, contents: Mapping[str, bytes], prefix: str) -> TaskResult:
    """The inverse of :func:`result_data`. Raises ParcelError where that is not what a run comes to."""
    try:
        SweptResult.model_validate({**data["result"], "tables": {}})
        SweptRequest.model_validate(data["asked"])
        rows, circumstances = dict(data["rows"]), dict(data["circumstances"])
        unexpected = [name for name, count in rows.items() if not _NAME.fullmatch(name) or type(count) is not int]
        tables = {name: _writer(contents[f"{prefix}{name}"], count) for name, count in rows.items()}
        key = str(data["key"])
    except (ValidationError, KeyError, TypeError, ValueError) as error:
        raise ParcelError(f"not the result of a run: {str(error)[:200]}") from None
    if unexpected:
        raise ParcelError(f"not the result of a run: a table {unexpected[0]!r}")
    return TaskResult(key, data["result"], data["asked"], circumstances, tables)


def _writer(content: bytes, rows: int) -> Write:
    def write(file: BinaryIO) -> int:
        file.write(content)
        return rows

    return write


TABLES = "pyarrow"
"""The writer of tables: their bytes, and so their hashes, depend on it."""

DemandAlive = Callable[[], None]
"""Called where an engine gave no result. Raises EndedError where this process is being ended: then its engines are, too, and
that is no result of theirs."""


class RefusedTaskError(SimspecError):
    """A worker cannot do its task, or failed as a machine does. The message is the reason."""


class EndedError(Exception):
    """A worker is being ended: its batch is to be done by another one."""


def wanted_versions(versions: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, str]]:
    """By label, what a worker must have: ``versions``, and what this machine writes tables with."""
    return {label: {**of_label, TABLES: version(TABLES)} for label, of_label in versions.items()}


def batch_parcel(tasks: Sequence[Task], supplies: Supplies, wanted: Mapping[str, str]) -> bytes:
    """Tasks of one engine with all that they need; worlds and compiled files that several share are sent once."""
    contents: dict[str, bytes] = {}
    for task in tasks:
        if f"world/{task.world}" not in contents:
            contents[f"world/{task.world}"] = canonical_json(supplies.case(task).resolved).encode()
        if not any(name.startswith(f"files/{task.artifacts}/") for name in contents):
            for name, content in Artifacts.read(supplies.folder(task)).items():
                contents[f"files/{task.artifacts}/{name}"] = content
    return Parcel({"tasks": [task_data(task) for task in tasks], "wanted": dict(wanted)}, contents).pack(compress=True)


def do_batch(request: bytes, demand_alive: DemandAlive = lambda: None) -> bytes:
    """Do the tasks of a parcel, one after the other. A failure of an engine is a result; a failure of this machine is reported
    in place of all results."""
    started = time.perf_counter()
    try:
        parcel = Parcel.unpack(request)
        tasks = [task_from(data) for data in parcel.facts["tasks"]]
        _demand_versions(tasks, parcel.facts["wanted"])
        facts, contents = _do(tasks, parcel, demand_alive)
    except EndedError:
        return Parcel({"host": platform.node(), "ended": True}, {}).pack()
    except (SimspecError, ParcelError, OSError, TypeError, KeyError) as error:
        return Parcel({"host": platform.node(), "error": f"{type(error).__name__}: {error}"[:2000]}, {}).pack()
    seconds = time.perf_counter() - started
    return Parcel({"host": platform.node(), "results": facts, "seconds": seconds}, contents).pack()


def results_of(reply: Any, tasks: Sequence[Task], supplies: Supplies) -> tuple[list[TaskResult], float]:
    """Results of :func:`do_batch` for ``tasks``, and the seconds that it took. Raises RefusedTaskError where it refused them,
    EndedError where another worker should do them."""
    try:
        parcel = Parcel.unpack(reply)
        host = str(parcel.facts["host"])
        if parcel.facts.get("ended"):
            raise EndedError(host)
        if "error" in parcel.facts:
            raise RefusedTaskError(f"{host}: {parcel.facts['error']}")
        seconds = float(parcel.facts["seconds"])
        results = [
            result_from(data, parcel.contents, f"{place}/") for place, data in enumerate(parcel.facts["results"])
        ]
    except (ParcelError, KeyError, TypeError, ValueError) as error:
        raise RefusedTaskError(f"a worker's answer is {error}") from None
    if len(results) != len(tasks):
        raise RefusedTaskError(f"{host}: {len(results)} results of {len(tasks)} tasks")
    for task, result in zip(tasks, results, strict=True):
        world = sha256(shared_world(supplies.case(task).resolved))
        if (result.key, result.result["world"], result.result["engine"]) != (task.key, world, task.engine):
            raise RefusedTaskError(f"{host}: its answer is of another run than the requested one")
    return results, seconds


def _demand_versions(tasks: Iterable[Task], wanted: Mapping[str, str]) -> None:
    """Raise RefusedTaskError where other versions are at work here: runs would be stored under a key that is not theirs."""
    for label in {task.engine for task in tasks}:
        try:
            here = _versions_here(label)
        except SimspecError as error:
            raise RefusedTaskError(str(error)) from None
        for name, value in wanted.items():
            if here.get(name) != value:
                version = "engine" if name == "engine_version" else name.removesuffix("_version")
                raise RefusedTaskError(
                    f"{label}: {version} is {here.get(name)} here, and {value} where the sweep was started"
                )


@functools.cache
def _versions_here(label: str) -> Mapping[str, str]:
    return wanted_versions(versions_of([label], {}))[label]


def _do(
    tasks: Sequence[Task], parcel: Parcel, demand_alive: DemandAlive
) -> tuple[list[dict[str, Any]], dict[str, bytes]]:
    worlds: dict[str, World] = {}
    facts, contents = [], {}
    with contextlib.ExitStack() as stack:
        folders: dict[str, Path] = {}
        for place, task in enumerate(tasks):
            if task.world not in worlds:
                worlds[task.world] = _world(parcel.contents[f"world/{task.world}"], task.world)
            if task.artifacts not in folders:
                folder = stack.enter_context(scratch_folder("batch")) / "compiled"
                _files(parcel, task.artifacts).write(folder)
                folders[task.artifacts] = folder
            case = Case(worlds[task.world], task.engine, perturb=task.perturb, seed=task.seed)
            result = _result(task, case, folders[task.artifacts], demand_alive)
            data, tables = result_data(result, f"{place}/")
            facts.append(data)
            contents.update(tables)
    return facts, contents


def _result(task: Task, case: Case, folder: Path, demand_alive: DemandAlive) -> TaskResult:
    try:
        run = run_case(case, artifacts=folder, deadline=task.deadline, source=task.source, warm=_warm())
    except EngineError as error:
        demand_alive()
        run = failed_run(case.resolved, task.engine, error)
    return packed(task, run, {"host": platform.node()})


def _world(content: bytes, wanted: str) -> World:
    try:
        world: World = from_plain(World, parse_json(content))
    except (ValueError, AttributeError, RecursionError) as error:
        raise ParcelError(f"no world: {str(error)[:200]}") from None
    if sha256(world) != wanted:
        raise ParcelError("damaged: a world does not match its hash")
    return world


def _files(parcel: Parcel, wanted: str) -> Artifacts:
    start = f"files/{wanted}/"
    files = Artifacts(
        {name[len(start) :]: content for name, content in parcel.contents.items() if name.startswith(start)}
    )
    if files.sha256 != wanted:
        raise ParcelError("damaged: compiled files do not match their hash")
    return files


@functools.cache
def _warm() -> WarmProcesses:
    """The processes that this process's runs are forked from, as long as it lives."""
    warm = WarmProcesses()
    atexit.register(warm.close)
    return warm
