"""A run on disk: Parquet tables for the arrays (``runner/tables.py``), JSON for the world and the provenance.

The provenance carries the hash of every table, and one of itself: a run whose parts were edited, mixed or damaged is an error
that names the file. :func:`load_run` gives back every array bit for bit.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec.errors import Problem, SpecError
from simspec.outputs.files import open_regular, read_bytes
from simspec.outputs.targets import RUN
from simspec.outputs.writing import build_folder, put
from simspec.runner import tables
from simspec.runner.labels import Labels, labels_of
from simspec.runner.looks import looks_of, with_looks
from simspec.runner.run import SCHEMA, Run
from simspec.stored import Provenance, StoredTable, parse, read_as
from simspec.world.canonical import canonical_json, from_plain, sha256
from simspec.world.types import World

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from pyarrow import parquet

PROVENANCE_FILE = "provenance.json"
WORLD_FILE = "world.json"
LOOKS_FILE = "looks.json"
"""The surfaces of meshes, for pictures alone."""
LARGEST_FACTS = 16 * 2**20
"""Bytes of a provenance: a few kB, and an engine's warnings."""
LARGEST_LOOKS = 64 * 2**20
LARGEST_WORLD = 64 * 2**20
"""Bytes of a world; the largest of the library has 1 MB."""
NONE = StoredTable(sha256="", rows=0)
BLOCK = 2**20
UNREADABLE = (OSError, ValueError, KeyError, TypeError, IndexError, MemoryError)
"""Errors that a file makes which is not what it should be; pyarrow's are ValueErrors."""


def save_run(run: Run, folder: Path) -> Path:
    """Write ``run`` as what simspec has in ``folder``, whole or not at all.

    Raises SpecError when the folder may not be written (:mod:`simspec.outputs.targets`).
    """

    def build(fresh: Path) -> Iterator[str]:
        written = {}
        if run.recorded:
            for name, rows in tables.write_tables(run.world, run.columns, labels_of(run.provenance), fresh):
                file = f"{name}.parquet"
                with open(fresh / file, "rb") as content:
                    written[name] = {"sha256": digest(content), "rows": rows}
                yield file
        put(fresh / WORLD_FILE, canonical_json(run.world) + "\n")
        yield WORLD_FILE
        facts = {**run.provenance, "failed": run.failed, "tables": written}
        try:
            looks = looks_of(run.world)
        except UNREADABLE:
            looks = (
                None  # a result is not lost for the way it is drawn: pages draw hulls, as of files that cannot be read
            )
        if looks is not None:
            put(fresh / LOOKS_FILE, looks)
            yield LOOKS_FILE
            facts["looks"] = hashlib.sha256(looks.encode()).hexdigest()
        facts["sha256"] = content_hash(facts)
        text = json.dumps(facts, indent=2, sort_keys=True, allow_nan=False, ensure_ascii=False)
        put(fresh / PROVENANCE_FILE, text + "\n")
        yield PROVENANCE_FILE

    build_folder(build, folder, RUN)
    return folder.absolute()


def driven_joints(provenance: Any) -> list[str]:
    """The joints with controllers, in the order of their columns."""
    return list((provenance.get("control") or {}).get("joints", ()))


def content_hash(facts: Any) -> str:
    """The hash of a provenance without its own hash."""
    return sha256({key: value for key, value in facts.items() if key != "sha256"})


def digest(file: Any) -> str:
    """Hexadecimal SHA-256 of an open file, from where it stands."""
    state = hashlib.sha256()
    while block := file.read(BLOCK):
        state.update(block)
    return state.hexdigest()


def is_run(folder: Path) -> bool:
    """Whether ``folder`` looks like a saved run."""
    return (folder / PROVENANCE_FILE).is_file()


def stored_runs(folder: Path) -> dict[str, str | None]:
    """The runs below a folder: the hash of the world that each is of, by the folder's name; None where that cannot be read."""
    hashes: dict[str, str | None] = {}
    for place in sorted(folder.iterdir()):
        if place.is_symlink() or not place.is_dir() or not is_run(place):
            continue
        try:
            hashes[place.name] = read_provenance(place).world_sha256
        except (SpecError, OSError):
            hashes[place.name] = None
    return hashes


def read_provenance(folder: Path) -> Provenance:
    """The provenance of a saved run. Raises FileNotFoundError, and SpecError where it was damaged or edited."""
    path = folder / PROVENANCE_FILE
    content = read_bytes(path, LARGEST_FACTS, folder)
    plain = parse(content, str(path))
    schema = plain.get("schema") if isinstance(plain, dict) else None
    if schema != SCHEMA:
        message = f"{path}: schema {schema!r}, this simspec reads {SCHEMA}"
        raise SpecError([Problem(message, hint="run it again: simspec run", code="R104")])
    provenance = read_as(Provenance, content, str(path))
    if provenance.sha256 != content_hash(plain):
        raise SpecError(
            [Problem(f"{path}: was edited or is damaged: its content does not match its hash", code="R102")]
        )
    return provenance


def load_run(folder: Path | str) -> Run:
    """The run saved in ``folder``. Raises SpecError, which names the file, when it is none, or is damaged or mixed."""
    folder = Path(folder)
    try:
        facts = read_provenance(folder)
        path = folder / WORLD_FILE
        plain = parse(read_bytes(path, LARGEST_WORLD, folder), str(path))
    except (FileNotFoundError, NotADirectoryError) as error:
        raise SpecError(
            [Problem(f"{folder} is not a saved run: {Path(error.filename).name} is missing", code="R101")]
        ) from None
    try:
        world = from_plain(World, plain)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise _unreadable(path, error) from None
    if facts.world_sha256 != sha256(world):
        message = f"{path}: this is not the world that was run: its hash differs from the provenance"
        raise SpecError([Problem(message, code="R101")])
    if facts.looks is not None:
        world = _with_looks(world, folder, facts.looks)
    provenance = facts.plain()
    arrays = load_tables(folder, world, facts.tables, labels_of(provenance))
    if not arrays and facts.failed is None:
        raise SpecError(
            [Problem(f"{folder} is not a complete run: it has no tables, and is not marked as failed", code="R103")]
        )
    spent = arrays.pop("seconds", None)
    return Run(world, facts.engine, arrays, provenance, facts.failed, spent)


def _with_looks(world: World, folder: Path, wanted: str) -> World:
    """The world with the surfaces that are stored with it. Raises SpecError where they are not those of the hash."""
    path = folder / LOOKS_FILE
    try:
        content = read_bytes(path, LARGEST_LOOKS, folder)
    except (FileNotFoundError, NotADirectoryError):
        raise SpecError([Problem(f"{folder} is not a complete run: {LOOKS_FILE} is missing", code="R103")]) from None
    if hashlib.sha256(content).hexdigest() != wanted:
        message = f"{path}: was edited or is damaged: its hash differs from the provenance"
        raise SpecError([Problem(message, code="R102")])
    try:
        return with_looks(world, parse(content, str(path)))
    except UNREADABLE as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: BaseException) -> SpecError:
    why = str(error).splitlines()[0][:300] if str(error) else type(error).__name__
    if isinstance(error, KeyError):
        why = f"{why} is missing"
    return SpecError([Problem(f"{path} cannot be read: {why}", code="R101")])


def load_tables(folder: Path, world: World, stored: Mapping[str, StoredTable], labels: Labels) -> dict[str, np.ndarray]:
    """The arrays of a run of ``world`` from its tables in ``folder``, and ``seconds`` where they are stored; ``labels``: names
    of columns. Raises SpecError where a table is not the one of its hash, or tables contradict each other."""
    if not stored:
        return {}
    try:
        wanted = _wanted(world, stored, labels)
        times = stored["states"].rows
        counts = {"bodies": times * len(world.bodies), "contacts": stored.get("contacts", NONE).rows}
        rows = {name: counts.get(name, times) for name in wanted}
        with contextlib.ExitStack() as opened:
            sources = {}
            for name, schema in wanted.items():
                path = folder / f"{name}.parquet"
                table = _opened(path, folder, stored[name].sha256, world, schema, rows[name])
                source, local_schema = opened.enter_context(table)
                sources[name] = _blocks(path, source, local_schema, rows[name])
            return tables.read_arrays(world, labels, rows, sources)
    except UNREADABLE as error:
        raise _unreadable(folder, error) from None


def _wanted(world: World, stored: Mapping[str, StoredTable], labels: Labels) -> dict[str, pa.Schema]:
    """The columns of the stored tables. Raises ValueError where they cannot be those of a run."""
    extra = {"energy": "energy", "control": "control.target", "contacts": "contact.row", "seconds": "seconds"}
    wanted = tables.schemas(world, [extra[name] for name in stored if name in extra], labels)
    if set(wanted) != set(stored):
        raise ValueError(f"tables {', '.join(sorted(stored))[:200]}, should be {', '.join(sorted(wanted))}")
    if stored["states"].rows > world.physics.steps + 1:
        raise ValueError(f"{stored['states'].rows} rows of {world.physics.steps} steps")
    return wanted


@contextlib.contextmanager
def _opened(
    path: Path, folder: Path, wanted: str, world: World, schema: pa.Schema, rows: int
) -> Iterator[tuple[parquet.ParquetFile, pa.Schema]]:
    """A table, which is the one of its hash, and has the columns of ``schema`` and this many rows; and the columns that it has
    (``tables.as_stored``). Raises SpecError that names the file."""
    try:
        with contextlib.ExitStack() as opened:
            file = opened.enter_context(os.fdopen(open_regular(path, tables.LARGEST_TABLE, folder), "rb"))
            if digest(file) != wanted:
                raise SpecError(
                    [
                        Problem(
                            f"{path}: was edited, damaged, or is of another run: its hash differs from the provenance",
                            code="R102",
                        )
                    ]
                )
            source = tables.open_parquet(file, file.tell())
            schema = tables.as_stored(source, schema, world)
            tables.check(source, schema, rows)
            kept = opened.pop_all()
    except FileNotFoundError:
        raise SpecError([Problem(f"{folder} is not a complete run: {path.name} is missing", code="R103")]) from None
    except UNREADABLE as error:
        raise _unreadable(path, error) from None
    with kept:
        yield source, schema


def _blocks(path: Path, source: parquet.ParquetFile, schema: pa.Schema, rows: int) -> Iterator[tuple[slice, pa.Table]]:
    """Its rows, block by block. Raises SpecError that names the file."""
    try:
        yield from tables.read_blocks(source, schema, rows)
    except UNREADABLE as error:
        raise _unreadable(path, error) from None
