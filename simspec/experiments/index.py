"""The index of a store: a row for each run, and which cell requested which case. Both files may be deleted at any time.

A run whose files have the names, sizes and times that its row says was checked before, and is not read again; every other is
checked against its hashes.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from simspec.errors import Problem, SpecError
from simspec.experiments.store import RUN_FILE, Store, place_of
from simspec.outputs.files import open_regular
from simspec.runner.tables import open_parquet
from simspec.stored import SweptRun

if TYPE_CHECKING:
    import pyarrow as pa

INDEX_FILE, CELLS_FILE = "index.parquet", "cells.parquet"
SCHEMA = b"1"
VERSION_FIELD, HASH_FIELD = b"simspec.schema", b"simspec.sha256"
LARGEST_DERIVED = 4 * 2**30
"""Bytes: a million runs take 500 MB."""
DAMAGED = (OSError, ValueError, KeyError, TypeError, MemoryError)
"""Errors that a derived file makes which is not what it should be; pyarrow's are ValueErrors."""


@dataclass(frozen=True, slots=True)
class RunRow:
    """One run. ``fingerprint`` and ``world_stamp``: of its files when they were checked; ``content``: the hash of what a
    repetition gives again; ``summary``: quantities at the end as JSON; ``passed`` of ``expected`` expectations, those of the
    hash ``expectations``; seconds are of the step calls (wall and processor) and of the whole process."""

    key: str
    cell: str
    fingerprint: str
    world: str
    world_stamp: str
    content: str
    name: str
    engine: str
    engine_version: str
    failed: str | None
    timestep: float
    steps: int
    step_seconds: float | None
    cpu_seconds: float | None
    process_seconds: float | None
    perturb: float
    seed: int | None
    repeat: int
    expectations: str
    passed: int
    expected: int
    bytes: int
    summary: str

    @property
    def quantities(self) -> dict[str, float]:
        """The quantities at the end of the run, by name."""
        return {name: float(value) for name, value in json.loads(self.summary).items()}


TYPES: Mapping[str, str] = {entry.name: str(entry.type) for entry in fields(RunRow)}


def row_of(store: Store, key: str, facts: SweptRun, timestep: float) -> RunRow:
    """The row of a run whose files are those of its hashes. Raises SpecError where its facts are not those of a run."""
    result, requested = facts.result, facts.request
    provenance: Mapping[str, Any] = result.provenance
    try:
        seconds = facts.circumstances.get("seconds", {})
        row = RunRow(
            key=key,
            cell=str((requested.cell or {}).get("key", "")),
            fingerprint=store.fingerprint(key),
            world=result.world,
            world_stamp=store.world_stamp(result.world),
            content=facts.result_sha256,
            name=requested.name,
            engine=result.engine,
            engine_version=str(provenance.get("engine_version", "")),
            failed=result.failed,
            timestep=timestep,
            steps=int(provenance.get("steps", 0)),
            step_seconds=_seconds(seconds.get("step")),
            cpu_seconds=_seconds(seconds.get("cpu")),
            process_seconds=_seconds(seconds.get("process")),
            perturb=float(provenance.get("perturb", 0.0)),
            seed=None if provenance.get("seed") is None else int(provenance["seed"]),
            repeat=int(provenance.get("repeat", 0)),
            expectations=expectations_hash(requested.expectations),
            passed=sum(bool(outcome.get("passed")) for outcome in requested.outcomes),
            expected=len(requested.outcomes),
            bytes=store.size(key),
            summary=json.dumps(dict(result.summary), sort_keys=True),
        )
        _ = row.quantities
    except (ValueError, TypeError, AttributeError, OverflowError) as error:
        message = f"{store.shown / place_of(key) / RUN_FILE} does not describe a run: {str(error)[:200]}"
        raise SpecError([Problem(message)]) from None
    return row


def _seconds(value: Any) -> float | None:
    return None if value is None else float(value)


def expectations_hash(plain: Any) -> str:
    """A hash that distinguishes lists of expectations, as plain data."""
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()[:16]


@dataclass
class Index:
    """The rows of a store's runs by key, the case of each cell by the cell's key, and the certificate of its model.

    ``notes``: remarks on the rows; ``lost_worlds``: worlds that are missing or were damaged, although their runs are whole.
    """

    rows: dict[str, RunRow] = field(default_factory=dict)
    cells: dict[str, str] = field(default_factory=dict)
    certificates: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    lost_worlds: set[str] = field(default_factory=set)
    changed: bool = False

    def add(self, row: RunRow) -> None:
        """Know a run."""
        self.rows[row.key] = row
        if row.cell:
            self.cells[row.cell] = row.key
        self.changed = True

    def know(self, cell: str, key: str) -> None:
        """Know which case a cell requests."""
        if self.cells.get(cell) != key:
            self.cells[cell] = key
            self.changed = True

    def certify(self, cell: str, certificate: str) -> None:
        """Know which certificate a cell's model has."""
        if self.certificates.get(cell) != certificate:
            self.certificates[cell] = certificate
            self.changed = True

    def done(self, cell: str) -> RunRow | None:
        """The run that a cell requests, where it is known to be there."""
        return self.rows.get(self.cells.get(cell, ""))

    def save(self, store: Store) -> None:
        """Write both files, where something has changed. The store's lock must be held."""
        if not self.changed:
            return
        rows = [self.rows[key] for key in sorted(self.rows)]
        columns = {name: [getattr(row, name) for row in rows] for name in TYPES}
        _save(store, INDEX_FILE, columns, _schema())
        cells = sorted(self.cells.items())
        columns = {"cell": [name for name, _ in cells], "key": [key for _, key in cells]}
        columns["certificate"] = [self.certificates.get(name, "") for name, _ in cells]
        _save(store, CELLS_FILE, columns, _cell_schema())
        self.changed = False


def refresh(store: Store, repair: bool, tell: Callable[[str, float | None], None] = lambda text, share: None) -> Index:
    """The index of what is in the store now: rows that still hold are taken over, other runs are checked against their hashes.

    A damaged run is no run: with ``repair`` (the lock must be held) it is moved below ``damaged/``. It is named in ``notes``.
    """
    index = Index()
    known = {str(row["key"]): row for row in _read(store, INDEX_FILE, _schema(), index, repair)}
    keys = list(store.keys())
    worlds: dict[str, float | None] = {}
    fresh = 0
    for number, key in enumerate(keys):
        if number % 1000 == 0:
            tell("looking through the store", number / len(keys))
        row = known.get(key)
        if row is not None and row["fingerprint"] == store.fingerprint(key):
            stamp = store.world_stamp(row["world"])
            if stamp and stamp == row["world_stamp"]:
                index.rows[key] = RunRow(**row)
                continue
        fresh += 1
        _check(store, key, repair, worlds, index)
    lost = len(known.keys() - set(keys))
    if known and fresh:
        index.notes.append(f"{INDEX_FILE} did not have {fresh:,} of {len(keys):,} runs as they are: they were checked")
    if lost:
        index.notes.append(f"{INDEX_FILE} lists {lost:,} runs that are not there any more: they were dropped")
    index.changed = bool(fresh or lost or (keys and not known))
    for pair in _read(store, CELLS_FILE, _cell_schema(), index, repair):
        if pair["key"] in index.rows:
            index.cells[pair["cell"]] = pair["key"]
            if pair["certificate"]:
                index.certificates[pair["cell"]] = pair["certificate"]
    for row_now in index.rows.values():
        if row_now.cell:
            index.cells.setdefault(row_now.cell, row_now.key)
    return index


def _check(store: Store, key: str, repair: bool, worlds: dict[str, float | None], index: Index) -> None:
    """Check one run against its hashes: a row, or a note."""
    try:
        facts = store.check(key)
        world = facts.result.world
        if world not in worlds:
            worlds[world] = _timestep(store, world, repair, index)
        timestep = worlds[world]
        if timestep is not None:
            index.add(row_of(store, key, facts, timestep))
    except (SpecError, OSError) as error:
        message = error.problems[0].message if isinstance(error, SpecError) else f"{error.filename}: {error.strerror}"
        moved = f"; moved to {_shown(store, store.set_aside(key))}, to be run again" if repair else ""
        index.notes.append(f"{_shorter(store, message)}{moved}")


def _timestep(store: Store, world: str, repair: bool, index: Index) -> float | None:
    """The timestep of a stored world; None, and a note, where the world is missing or damaged."""
    try:
        return store.world(world).physics.timestep
    except SpecError as error:
        moved = ""
        if repair and store.world_stamp(world):
            moved = f"; moved to {_shown(store, store.set_world_aside(world))}"
        again = ", it will be stored again" if repair else ""
        index.notes.append(f"{_shorter(store, error.problems[0].message)}{moved}{again}")
        index.lost_worlds.add(world)
        return None


def _shown(store: Store, path: Path) -> str:
    return str(store.shown / path.relative_to(store.path))


def _shorter(store: Store, text: str) -> str:
    """A message with the store's path as the user gave it."""
    return text.replace(str(store.path), str(store.shown))


def _schema() -> pa.Schema:
    import pyarrow as pa

    kinds = {"str": pa.string(), "float": pa.float64(), "int": pa.int64()}
    return pa.schema([(name, kinds[kind.removesuffix(" | None")]) for name, kind in TYPES.items()])


def _cell_schema() -> pa.Schema:
    import pyarrow as pa

    return pa.schema([(name, pa.string()) for name in ("cell", "key", "certificate")])


def _save(store: Store, name: str, columns: Mapping[str, list[Any]], schema: pa.Schema) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    given = {VERSION_FIELD: SCHEMA, HASH_FIELD: _hash(columns)}
    table = pa.table(dict(columns), schema=schema.with_metadata(given))

    def write(file: BinaryIO) -> None:
        parquet.write_table(table, file, compression="zstd")

    store.put_derived(name, write)


def _hash(columns: Mapping[str, list[Any]]) -> bytes:
    digest = hashlib.sha256()
    for name, values in columns.items():
        digest.update(f"{name} {json.dumps(values)}\n".encode())
    return digest.hexdigest().encode()


def _read(store: Store, name: str, schema: pa.Schema, index: Index, repair: bool) -> list[dict[str, Any]]:
    """The rows of a derived file; none where there is none, and with a note where it is damaged."""
    path = store.path / name
    try:
        with os.fdopen(open_regular(path, LARGEST_DERIVED, store.path), "rb") as file:
            source = open_parquet(file, os.fstat(file.fileno()).st_size)
            metadata = source.schema_arrow.metadata or {}
            if metadata.get(VERSION_FIELD) != SCHEMA or source.schema_arrow.names != schema.names:
                raise ValueError("it is of another form")
            table = source.read(use_threads=False)
            columns = {column: table[column].to_pylist() for column in schema.names}
            if not table.schema.equals(schema) or metadata.get(HASH_FIELD) != _hash(columns):
                raise ValueError("its content does not match its hash")
    except FileNotFoundError:
        return []
    except (SpecError, *DAMAGED) as error:
        why = error.problems[0].message if isinstance(error, SpecError) else str(error).splitlines()[0][:200]
        if repair and not path.is_dir():
            store.drop_damaged(name)
        index.notes.append(f"{store.shown / name} is damaged ({_shorter(store, why)}): it is made anew from the runs")
        index.changed = True
        return []
    return [dict(zip(schema.names, values, strict=True)) for values in zip(*columns.values(), strict=True)]
