"""The store of sweeps: every run once, under the key of its case.

    STORE/store.json                      version of the store's form
    STORE/lock                            held by the one sweep that writes
    STORE/worlds/SHA256.json.gz           each world once
    STORE/runs/KK/KEY/                    run.json and Parquet tables; an existing run is done
    STORE/certificates/SHA256.json        proofs, by the hash of the proven model
    STORE/index.parquet, cells.parquet    derived from the rest (``index.py``)
    STORE/tmp/, STORE/damaged/            unfinished files; files that did not match their names

A run is there, whole, or it is not: there is no state between. See :mod:`simspec.outputs.collection`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gzip
import hashlib
import json
import math
import os
import platform
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from simspec.comparison.runs import summary
from simspec.errors import Problem, SpecError
from simspec.outputs.collection import Collection, open_collection
from simspec.outputs.files import open_regular, read_bytes, read_gzip
from simspec.outputs.targets import STORE, read_marker
from simspec.outputs.writing import put
from simspec.plugins import simspec_version
from simspec.runner.expectations import evaluate
from simspec.runner.labels import labels_of
from simspec.runner.run import SCHEMA as RUN_SCHEMA
from simspec.runner.run import Run, shared_world
from simspec.runner.store import LARGEST_FACTS, LARGEST_WORLD, digest, load_tables
from simspec.runner.tables import LARGEST_TABLE, table_writers
from simspec.stored import StoreFacts, SweptRun, parse, read_as
from simspec.world.canonical import canonical_json, from_plain, sha256, to_plain
from simspec.world.types import World

CIRCUMSTANCES = ("started", "seconds", "usage", "timed", "warnings", "python_version", "platform", "machine")
"""Parts of a run's provenance that are not the same when it is repeated (warnings: an engine's own output)."""
CIRCUMSTANCE_TABLES = ("seconds",)
"""Tables that are not the same when a run is repeated."""
REQUEST_KEYS = ("spec", "world_sha256", "artifacts_sha256")
"""Parts that are of the sweep that requested the run first: another one may request the same run."""
LEFT_OUT = ("schema", "case", "engine")
"""Parts that are stored elsewhere: the key of the case is the run's name."""
LAST_OUTPUT = "; its last output:"
"""From here on, the error of an engine's process quotes the engine's own output."""

Write = Callable[[BinaryIO], int]
"""Writes a table into an open file, and gives its number of rows."""


@dataclass(frozen=True)
class TaskResult:
    """One run to be stored under ``key``. ``result``: the part that a repetition gives to the bit; ``request``: that of the
    sweep; ``circumstances``: when, how long, on which machine; ``tables``: the writer of each, by name."""

    key: str
    result: Mapping[str, Any]
    request: Mapping[str, Any]
    circumstances: Mapping[str, Any]
    tables: Mapping[str, Write]


def whole_world(shared: World, requested: Mapping[str, Any]) -> World:
    """The world that was run: the shared one, with what was left out of it."""
    plain = {**to_plain(shared), **{name: requested[name] for name in ("name", "expectations", "engines")}}
    world: World = from_plain(World, plain)
    return world


def result_of(
    run: Run, key: str, *, repeat: int = 0, cell: Mapping[str, Any] | None = None, more: Mapping[str, Any] | None = None
) -> TaskResult:
    """The stored result of ``run`` under ``key``, the repetition ``repeat`` of its case; ``cell``: the requesting cell (its
    key, and its changes of the spec); ``more``: further circumstances."""
    given = {**run.provenance, "repeat": repeat}
    circumstances = {name: given.pop(name) for name in CIRCUMSTANCES if name in given} | dict(more or {})
    requested = {name: given.pop(name) for name in REQUEST_KEYS if name in given}
    for name in LEFT_OUT:
        given.pop(name, None)
    failed = run.failed
    if failed is not None and (LAST_OUTPUT in failed or "\n" in failed):
        circumstances["error"] = failed
        failed = failed.partition(LAST_OUTPUT)[0].splitlines()[0]
    world = run.world
    return TaskResult(
        key,
        {
            "world": sha256(shared_world(world)),
            "engine": run.engine,
            "failed": failed,
            "provenance": given,
            "summary": {name: _number(value) for name, value in summary(run).items()},
        },
        {
            "cell": dict(cell) if cell is not None else None,
            "name": world.name,
            "world_sha256": requested.get("world_sha256", sha256(world)),
            "expectations": to_plain(world.expectations),
            "outcomes": [_outcome(outcome) for outcome in evaluate(run)],
            "engines": to_plain(world.engines),
            "spec": requested.get("spec", {}),
            "artifacts_sha256": requested.get("artifacts_sha256"),
        },
        circumstances,
        table_writers(world, run.columns, labels_of(run.provenance)) if run.recorded else {},
    )


def _outcome(outcome: Any) -> dict[str, Any]:
    plain: dict[str, Any] = dataclasses.asdict(outcome)
    return {name: _number(value) if isinstance(value, float) else value for name, value in plain.items()}


def _number(value: float) -> float | str:
    """For JSON, which has no infinity: ``float`` reads the word back."""
    return value if math.isfinite(value) else repr(value)


SCHEMA = 1
"""Version of the store's form, and of the runs in it."""
STORE_FILE, RUN_FILE = "store.json", "run.json"
RUNS, WORLDS, CERTIFICATES = "runs", "worlds", "certificates"
KEY = re.compile(r"[0-9a-f]{64}")
LARGEST_STORE_FILE = 65536


def place_of(key: str) -> str:
    """Where a run is, below the store."""
    return f"{RUNS}/{key[:2]}/{key}"


class Store:
    """A store that is there. Reading takes no lock; writers hold :meth:`writing`."""

    def __init__(self, collection: Collection):
        self.path = collection.path
        self.shown = collection.shown
        self._collection = collection

    @classmethod
    def open(cls, folder: Path, create: bool = False) -> Store:
        """The store in ``folder``, made there with ``create``.

        Raises SpecError for a folder that is no store, that another program made, or of a newer simspec.
        """
        if create:
            facts = {"simspec_store": SCHEMA, "made_by": simspec_version()}
            collection = open_collection(folder, STORE, {STORE_FILE: json.dumps(facts) + "\n"})
        else:
            marker = read_marker(folder) if folder.is_dir() else None
            if marker is None or marker.kind != STORE:
                raise SpecError(
                    [Problem(f"{folder} is not a store of sweeps", hint="simspec sweep SPEC makes one", code="R101")]
                )
            collection = Collection(folder.resolve(), folder)
        store = cls(collection)
        store._check_schema()
        return store

    def _check_schema(self) -> None:
        path = self.shown / STORE_FILE
        try:
            content = read_bytes(self.path / STORE_FILE, LARGEST_STORE_FILE, self.path)
        except FileNotFoundError:
            raise SpecError(
                [Problem(f"{path} is missing: the store is damaged", hint="use a new --store", code="R101")]
            ) from None
        plain = parse(content, str(path))
        schema = plain.get("simspec_store") if isinstance(plain, dict) else None
        if schema != SCHEMA:
            newer = "a newer simspec wrote it: " if isinstance(schema, int) and schema > SCHEMA else ""
            message = f"{path}: {newer}schema {schema!r}, this simspec reads {SCHEMA}"
            raise SpecError([Problem(message, hint="use the simspec that wrote it, or a new --store", code="R104")])
        read_as(StoreFacts, content, str(path))

    @contextlib.contextmanager
    def writing(self, wait: bool = False) -> Iterator[None]:
        """Be the one that writes. Raises SpecError when another process does, unless ``wait``."""
        with self._collection.alone(f"process {os.getpid()} on {platform.node()}", wait):
            yield

    def has(self, key: str) -> bool:
        """Whether the run is there."""
        return self._collection.has(place_of(key))

    def keys(self) -> Iterator[str]:
        """The keys of all runs, sorted. Names that are not keys are ignored."""
        root = self.path / RUNS
        for part in _names(root):
            yield from (name for name in _names(root / part) if KEY.fullmatch(name) and name[:2] == part)

    def publish(self, result: TaskResult, world: World) -> bool:
        """Store a run, and its world before it; False where it is there already. Raises OSError, which names the store, where
        the disk is full: nothing of the run is there then."""
        if result.result["world"] != self.put_world(world):
            raise ValueError("the result is of another world")
        return self._collection.place(place_of(result.key), lambda fresh: _write(result, fresh))

    def facts(self, key: str) -> SweptRun:
        """``run.json`` of a run. Raises SpecError, which names it, where it is missing, damaged, or of another key."""
        path = self.path / place_of(key) / RUN_FILE
        try:
            content = read_bytes(path, LARGEST_FACTS, self.path)
        except (FileNotFoundError, NotADirectoryError):
            raise SpecError([Problem(f"{path} is missing", code="R101")]) from None
        plain = parse(content, str(path))
        schema = plain.get("schema") if isinstance(plain, dict) else None
        if schema != SCHEMA:
            raise SpecError([Problem(f"{path}: schema {schema!r}, this simspec reads {SCHEMA}", code="R104")])
        facts = read_as(SweptRun, content, str(path))
        whole = {name: value for name, value in plain.items() if name != "sha256"}
        if facts.sha256 != sha256(whole) or facts.result_sha256 != sha256(plain["result"]):
            raise SpecError(
                [Problem(f"{path}: was edited or is damaged: its content does not match its hash", code="R102")]
            )
        if facts.key != key:
            raise SpecError([Problem(f"{path}: is the run of another key, {facts.key[:16]}…", code="R102")])
        return facts

    def check(self, key: str) -> SweptRun:
        """The facts of a run, all of whose files are those of their hashes. Raises SpecError, which names the file."""
        facts = self.facts(key)
        folder = self.path / place_of(key)
        tables = facts.tables
        unexpected = set(_names(folder)) - {RUN_FILE, *(f"{name}.parquet" for name in tables)}
        if unexpected:
            raise SpecError([Problem(f"{folder / min(unexpected)}: is not a file of this run", code="R101")])
        for name, table in tables.items():
            path = folder / f"{name}.parquet"
            try:
                with os.fdopen(open_regular(path, LARGEST_TABLE, self.path), "rb") as file:
                    same = digest(file) == table.sha256
            except FileNotFoundError:
                raise SpecError([Problem(f"{path} is missing", code="R101")]) from None
            if not same:
                raise SpecError(
                    [Problem(f"{path}: was edited or is damaged: its hash is not that of {RUN_FILE}", code="R102")]
                )
        return facts

    def fingerprint(self, key: str) -> str:
        """A stamp that changes when a file of a run is touched: names, sizes and times of its files. Cheap: nothing is read."""
        with contextlib.suppress(FileNotFoundError, NotADirectoryError), os.scandir(self.path / place_of(key)) as found:
            lines = sorted(f"{entry.name} {_stamp(entry.stat(follow_symlinks=False))}" for entry in found)
            return hashlib.sha256("\n".join(lines).encode()).hexdigest()
        return ""

    def world_stamp(self, key: str) -> str:
        """The same for a world; empty where it is missing."""
        try:
            return _stamp(os.lstat(self.path / WORLDS / f"{key}.json.gz"))
        except (FileNotFoundError, NotADirectoryError):
            return ""

    def size(self, key: str) -> int:
        """Bytes of a run's files."""
        with os.scandir(self.path / place_of(key)) as entries:
            return sum(entry.stat(follow_symlinks=False).st_size for entry in entries)

    def set_aside(self, key: str) -> Path:
        """Move a run below ``damaged/``; its new path."""
        return self._collection.set_aside(place_of(key))

    def drop(self, key: str) -> None:
        """Remove a run, which is done again."""
        self._collection.drop(place_of(key))

    def load(self, key: str, tables: bool = True) -> Run:
        """The run of a key, every array bit for bit; without ``tables`` it has no arrays, and is read faster. Raises SpecError,
        which names the file, where something is damaged."""
        facts = self.facts(key)
        path = self.path / place_of(key) / RUN_FILE
        try:
            world = whole_world(self.world(facts.result.world), facts.request.model_dump())
            labels = labels_of(facts.result.provenance)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise SpecError([Problem(f"{path} does not describe a run: {str(error)[:200]}", code="R101")]) from None
        if sha256(world) != facts.request.world_sha256:
            raise SpecError([Problem(f"{path}: its world is not the one that was run", code="R101")])
        result, requested = facts.result, facts.request
        provenance = {
            **result.provenance,
            **facts.circumstances,
            "schema": RUN_SCHEMA,
            "engine": result.engine,
            "case": key,
            "spec": requested.spec,
            "world_sha256": requested.world_sha256,
        }
        if requested.artifacts_sha256 is not None:
            provenance["artifacts_sha256"] = requested.artifacts_sha256
        arrays = load_tables(self.path / place_of(key), world, facts.tables, labels) if tables else {}
        spent = arrays.pop("seconds", None)
        if tables and not arrays and result.failed is None:
            raise SpecError([Problem(f"{path}: has no tables, and is not marked as failed", code="R101")])
        failed = facts.circumstances.get("error", result.failed)
        return Run(world, result.engine, arrays, provenance, failed, spent)

    def world(self, key: str) -> World:
        """A stored world. Raises SpecError, which names its file, where it is missing or damaged."""
        path = self.path / WORLDS / f"{key}.json.gz"
        try:
            content = read_gzip(path, LARGEST_WORLD, self.path)
        except FileNotFoundError:
            raise SpecError([Problem(f"{path} is missing", code="R101")]) from None
        try:
            world: World = from_plain(World, parse(content, str(path)))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise SpecError([Problem(f"{path} is not a world: {str(error)[:200]}", code="R101")]) from None
        if sha256(world) != key:
            raise SpecError(
                [Problem(f"{path}: was edited or is damaged: its content does not match its name", code="R102")]
            )
        return world

    def put_world(self, world: World) -> str:
        """Store what the runs of ``world`` share (:func:`shared_world`), once; its hash."""
        shared = shared_world(world)
        key = sha256(shared)
        name = f"{WORLDS}/{key}.json.gz"
        if not self._collection.has(name):
            self._collection.place_file(name, gzip.compress(canonical_json(shared).encode(), mtime=0))
        return key

    def set_world_aside(self, key: str) -> Path:
        """Move a damaged world below ``damaged/``; its new path."""
        return self._collection.set_aside(f"{WORLDS}/{key}.json.gz")

    def certificate_text(self, key: str) -> str | None:
        """The text of the proof that is stored under ``key``; None where there is none."""
        path = self.path / CERTIFICATES / f"{key}.json"
        try:
            return read_bytes(path, root=self.path).decode(errors="replace")
        except FileNotFoundError:
            return None

    def put_certificate(self, key: str, text: str) -> None:
        """Store a proof; one that is there is replaced."""
        self._collection.replace_file(f"{CERTIFICATES}/{key}.json", text)

    # --- what is derived ------------------------------------------------------------------------------------------------

    def put_derived(self, name: str, content: Any) -> None:
        """Write a file that follows from the rest of the store."""
        self._collection.replace_file(name, content)

    def drop_damaged(self, name: str) -> Path:
        """Move such a file aside."""
        return self._collection.set_aside(name)


def _write(result: TaskResult, fresh: Path) -> None:
    tables: dict[str, Mapping[str, Any]] = {}
    for name, write in result.tables.items():
        rows: list[int] = []
        path = fresh / f"{name}.parquet"
        put(path, lambda file, write=write, rows=rows: rows.append(write(file)))  # type: ignore[misc]
        with open(path, "rb") as file:
            tables[name] = {"sha256": digest(file), "rows": rows[0]}
    measured = {name: tables.pop(name) for name in CIRCUMSTANCE_TABLES if name in tables}
    stored = {**result.result, "tables": tables}
    facts = {
        "schema": SCHEMA,
        "key": result.key,
        "result": stored,
        "asked": dict(result.request),
        "circumstances": dict(result.circumstances),
        "circumstance_tables": measured,
        "result_sha256": sha256(stored),
    }
    facts["sha256"] = sha256(facts)
    # a line for each part: with more indentation, Python writes JSON ten times slower
    lines = [f"{json.dumps(name)}: {canonical_json(facts[name])}" for name in sorted(facts)]
    put(fresh / RUN_FILE, "{\n" + ",\n".join(lines) + "\n}\n")


def _stamp(status: os.stat_result) -> str:
    return f"{status.st_mode} {status.st_size} {status.st_mtime_ns} {status.st_ino}"


def _names(folder: Path) -> list[str]:
    """The names in a folder, sorted; none where there is no folder, or only a link to one."""
    try:
        return [] if folder.is_symlink() else sorted(os.listdir(folder))
    except (FileNotFoundError, NotADirectoryError):
        return []
