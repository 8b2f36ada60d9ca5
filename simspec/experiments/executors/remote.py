"""What is done with a batch of tasks on another machine: each run in a process of its own, as on this one. Bytes come in and
bytes go out (``parcel.py``)."""

from __future__ import annotations

import atexit
import contextlib
import functools
import platform
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EngineError, SimspecError
from simspec.experiments.executors.contract import Supplies, Task
from simspec.experiments.executors.local import packed
from simspec.experiments.executors.parcel import (
    Parcel,
    ParcelError,
    result_data,
    result_from,
    task_data,
    task_from,
)
from simspec.experiments.result import TaskResult
from simspec.experiments.versions import versions_of
from simspec.files import parse_json, scratch_folder
from simspec.outputs.writing import Artifacts
from simspec.runner.case import Case, shared_world
from simspec.runner.execution import failed_run, run_case
from simspec.world.canonical import canonical_json, from_plain, sha256
from simspec.world.types import World

TABLES = "pyarrow"
"""What writes tables: their bytes, and so their hashes, are its own."""

DemandAlive = Callable[[], None]
"""Called where an engine gave no result. Raises EndedError where this process is being ended: then its engines are, too, and
that is no result of theirs."""


class RefusedError(SimspecError):
    """A worker cannot do what it was asked for, or failed as a machine does. The message is the reason."""


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
    """Do the tasks of a parcel, one after the other. What an engine fails at is a result; what this machine fails at is said
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
    """What :func:`do_batch` made of ``tasks``, and the seconds that it took. Raises RefusedError where it made nothing of
    them, EndedError where another one should."""
    try:
        parcel = Parcel.unpack(reply)
        host = str(parcel.facts["host"])
        if parcel.facts.get("ended"):
            raise EndedError(host)
        if "error" in parcel.facts:
            raise RefusedError(f"{host}: {parcel.facts['error']}")
        seconds = float(parcel.facts["seconds"])
        results = [
            result_from(data, parcel.contents, f"{place}/") for place, data in enumerate(parcel.facts["results"])
        ]
    except (ParcelError, KeyError, TypeError, ValueError) as error:
        raise RefusedError(f"a worker's answer is {error}") from None
    if len(results) != len(tasks):
        raise RefusedError(f"{host}: {len(results)} results of {len(tasks)} tasks")
    for task, result in zip(tasks, results, strict=True):
        world = sha256(shared_world(supplies.case(task).resolved))
        if (result.key, result.result["world"], result.result["engine"]) != (task.key, world, task.engine):
            raise RefusedError(f"{host}: its answer is of another run than it was asked for")
    return results, seconds


def _demand_versions(tasks: Iterable[Task], wanted: Mapping[str, str]) -> None:
    """Raise RefusedError where other versions are at work here: runs would be stored under a key that is not theirs."""
    for label in {task.engine for task in tasks}:
        try:
            here = _versions_here(label)
        except SimspecError as error:
            raise RefusedError(str(error)) from None
        for name, value in wanted.items():
            if here.get(name) != value:
                told = "engine" if name == "engine_version" else name.removesuffix("_version")
                raise RefusedError(f"{label}: {told} is {here.get(name)} here, and {value} where the sweep was started")


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
