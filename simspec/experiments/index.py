"""The index of a store: a row for each run, and which cell requested which case; and costs predicted from stored ones. Both
files may be deleted at any time.

A run whose files have the names, sizes and times that its row says was checked before, and is not read again; every other is
checked against its hashes.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, BinaryIO

from simspec.errors import Problem, SpecError
from simspec.experiments.plan import Cell, Plan
from simspec.experiments.store import RUN_FILE, Store, place_of
from simspec.language.contact import WHOLE
from simspec.language.quantities import UnitError, parse
from simspec.language.sweep import ROUND_UP
from simspec.outputs.files import open_regular
from simspec.runner.tables import open_parquet
from simspec.stored import StoredCertificate, SweptRun, read_as

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
        raise SpecError([Problem(message, code="R106")]) from None
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


# Predicted costs of runs: for each engine a time to start and end, and a time for each step.

USUAL_START = 0.5
"""s that a run is taken to need besides its steps where nothing was measured: a process that imports an engine."""
USUAL_STEP = 2e-5
"""s for each step there: a small world. Both weigh the progress shown, and are not printed."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Seconds of wall time that an engine's runs took: ``start`` besides the steps, and ``step`` for each; ``runs``:
    measured."""

    start: float
    step: float
    runs: int

    def seconds(self, steps: int) -> float:
        """Predicted time (s) of a run of ``steps`` steps."""
        return self.start + self.step * steps


def costs(rows: Iterable[RunRow], name: str) -> dict[str, Cost]:
    """By engine, what runs of the spec ``name`` took (medians); of other specs where there are none of it."""
    whole = [row for row in rows if row.failed is None and row.steps and row.step_seconds and row.process_seconds]
    found = {}
    for engine in dict.fromkeys(row.engine for row in whole):
        of_engine = [row for row in whole if row.engine == engine]
        used = [row for row in of_engine if row.name == name] or of_engine
        start = median((row.process_seconds or 0.0) - (row.step_seconds or 0.0) for row in used)
        step = median((row.step_seconds or 0.0) / row.steps for row in used)
        found[engine] = Cost(start, step, len(used))
    return found


USUAL = Cost(USUAL_START, USUAL_STEP, 0)


class Steps:
    """Numbers of steps of the cells of a plan, from their values without resolving them."""

    def __init__(self, plan: Plan):
        physics, trajectory = plan.spec.data.physics, plan.spec.data.trajectory
        self._usual = {"physics.timestep": physics.timestep, "physics.duration": physics.duration}
        until = None if trajectory is None else trajectory.until
        self._usual["trajectory.until"] = math.inf if until is None else until
        self._up = plan.sweep.times == ROUND_UP
        self._known: dict[Any, float] = {}

    def of(self, cell: Cell) -> int:
        """The steps of one cell."""
        times = {**self._usual, **{path: self._time(value) for path, value in cell.overrides if path in self._usual}}
        if times["physics.timestep"] <= 0.0:
            return 0
        steps = min(times["physics.duration"], times["trajectory.until"]) / times["physics.timestep"]
        return math.ceil(steps * (1.0 - WHOLE)) if self._up else round(steps)

    def _time(self, value: Any) -> float:
        """A time (s); 0 for what is none: the cell is an error where it is resolved."""
        if value not in self._known:
            try:
                self._known[value] = parse(value, "time") if isinstance(value, str) else float(value)
            except (UnitError, ValueError, TypeError):
                self._known[value] = 0.0
        return self._known[value]


@dataclass(frozen=True, slots=True)
class Estimate:
    """Remaining work: runs, steps, and seconds of wall time one after the other, by engine. Seconds are None for an engine
    without measurements."""

    runs: Mapping[str, int]
    steps: Mapping[str, int]
    seconds: Mapping[str, float | None]

    @property
    def total(self) -> float | None:
        """Seconds of all engines; None where one is not known."""
        known = [second for name, second in self.seconds.items() if self.runs[name]]
        return None if None in known else sum(entry for entry in known if entry is not None)


def estimate(plan: Plan, to_do: Iterable[Cell], measured: Mapping[str, Cost]) -> Estimate:
    """Predicted cost of the cells ``to_do``."""
    steps_of = Steps(plan)
    runs, steps = dict.fromkeys(plan.engines, 0), dict.fromkeys(plan.engines, 0)
    for cell in to_do:
        runs[cell.engine] += 1
        steps[cell.engine] += steps_of.of(cell)
    seconds = {
        name: measured[name].start * runs[name] + measured[name].step * steps[name] if name in measured else None
        for name in plan.engines
    }
    return Estimate(runs, steps, seconds)


# Predicted costs of the proofs of a sweep, from the costs of stored proofs.

MOST_READ = 200
"""Certificates of a store that are read for it, the last ones by name."""


@dataclass(frozen=True, slots=True)
class ProofsLeft:
    """Proofs that are still to be made: ``models`` by engine, at most (sets of values that differ in what no proof looks at
    share one); ``seconds`` of wall time of one by engine, None where none was made."""

    models: Mapping[str, int]
    seconds: Mapping[str, float | None]

    @property
    def count(self) -> int:
        """Models of all engines."""
        return sum(self.models.values())

    @property
    def total(self) -> float | None:
        """Seconds of all, one after the other; None where those of an engine are not known."""
        total = 0.0
        for engine, count in self.models.items():
            each = self.seconds[engine]
            if count and each is None:
                return None
            total += count * (each or 0.0)
        return total


def proof_seconds(index: Index, store: Store | None) -> dict[str, float]:
    """By engine, the median wall time of the proofs in a store; those that cannot be read are made anew by the sweep."""
    seconds: dict[str, list[float]] = {}
    for key in sorted(set(index.certificates.values()))[-MOST_READ:] if store is not None else ():
        text = store.certificate_text(key) if store is not None else None
        try:
            certificate = None if text is None else read_as(StoredCertificate, text, key)
        except SpecError:
            continue
        for engine, proof in certificate.engines.items() if certificate is not None else ():
            seconds.setdefault(engine, []).append(proof.seconds)
    return {engine: median(took) for engine, took in seconds.items()}


def proofs_left(cells: Iterable[Cell], index: Index, seconds: Mapping[str, float]) -> ProofsLeft:
    """The proofs that cells still need; ``seconds``: of one, by engine, where that is known."""
    proven: set[tuple[str, str]] = set()
    needed: set[tuple[str, str]] = set()
    engines: dict[str, None] = {}
    for cell in cells:
        engines[cell.engine] = None
        (proven if cell.key in index.certificates else needed).add((cell.engine, repr(cell.overrides)))
    left = needed - proven
    models = {engine: sum(model[0] == engine for model in left) for engine in engines}
    return ProofsLeft(models, {engine: seconds.get(engine) for engine in engines})
