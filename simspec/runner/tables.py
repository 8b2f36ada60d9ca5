"""The tables of a saved run: what columns they have, writing them block by block, and reading them with nothing believed.

``bodies`` and ``contacts`` are long tables with the bodies' names; ``states`` has a column for each generalised coordinate, by
its name (``q.elbow``, ``v.base.wx``), ``control`` one for each driven joint's target and effort (``target.elbow``).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simspec.mapped import block_rows, parts
from simspec.world.coordinates import coordinates
from simspec.world.types import World

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow import parquet

POSE_COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")
VELOCITY_COLUMNS = ("vx", "vy", "vz", "wx", "wy", "wz")
AXES = ("x", "y", "z")
MOST_COLUMNS = 4096
"""Columns of q and v by name: each costs 1 kB in the file and 15 kB of memory beside its values. Beyond that (300 free bodies)
q and v are two columns of lists, and the names stand in the table's metadata under ``simspec.coordinates``."""
COORDINATES = b"simspec.coordinates"
LARGEST_TABLE = 4 * 2**30
"""Bytes that a table may have in memory, by its own metadata, which is looked at first: what is larger is no run to compare."""
LARGEST_FOOTER = 64 * 2**20
"""Bytes of a Parquet file's own metadata."""


def schemas(world: World, arrays: Sequence[str], joints: Sequence[str]) -> dict[str, pa.Schema]:
    """The columns of every table of a run of ``world`` that recorded ``arrays``; ``joints``: those with controllers."""
    import pyarrow as pa

    number, whole, name = pa.float64(), pa.int64(), pa.dictionary(pa.int32(), pa.string())
    when = [("step", whole), ("time", number)]
    known = coordinates(world)
    found = {"states": pa.schema([*when, *_coordinate_fields(world)])}
    if len(known.q) + len(known.v) > MOST_COLUMNS:
        told = json.dumps({"q": known.q, "v": known.v})
        found["states"] = found["states"].with_metadata({COORDINATES: told})
    placed = [(column, number) for column in (*POSE_COLUMNS, *VELOCITY_COLUMNS)]
    found["bodies"] = pa.schema([*when, ("body", name), *placed])
    if "energy" in arrays:
        found["energy"] = pa.schema([*when, ("kinetic", number), ("potential", number)])
    if "control.target" in arrays:
        driven = [(f"{part}.{joint}", number) for part in ("target", "effort") for joint in joints]
        found["control"] = pa.schema([*when, *driven])
    if "contact.row" in arrays:
        measured = [*AXES, *(f"n{axis}" for axis in AXES), "distance", "normal_force"]
        pair = [("first", name), ("second", name)]
        found["contacts"] = pa.schema([("row", whole), *when, *pair, *((column, number) for column in measured)])
    return found


def _coordinate_fields(world: World) -> list[tuple[str, Any]]:
    import pyarrow as pa

    known, number = coordinates(world), pa.float64()
    parts = {"q": known.q, "v": known.v}
    if len(known.q) + len(known.v) <= MOST_COLUMNS:
        return [(f"{part}.{name}", number) for part, names in parts.items() for name in names]
    return [(part, pa.list_(number, len(names)) if names else pa.list_(number)) for part, names in parts.items()]


def write_tables(
    world: World, arrays: Mapping[str, np.ndarray], joints: Sequence[str], folder: Path
) -> Iterator[tuple[str, int]]:
    """Write every table into ``folder``, a block at a time, and give its name and number of rows."""
    from pyarrow import parquet

    for name, schema in schemas(world, list(arrays), joints).items():
        rows = 0
        with parquet.ParquetWriter(folder / f"{name}.parquet", schema, compression="zstd") as writer:
            for columns in _COLUMNS[name](world, arrays):
                table = _table(columns, schema, world)
                rows += len(table)
                writer.write_table(table)
        yield name, rows


def _table(columns: Sequence[np.ndarray], schema: pa.Schema, world: World) -> pa.Table:
    import pyarrow as pa

    names = pa.array([body.name for body in world.bodies], pa.string())
    found = []
    for values, field in zip(columns, schema, strict=True):
        if pa.types.is_dictionary(field.type):
            found.append(pa.DictionaryArray.from_arrays(pa.array(values.astype(np.int32)), names))
        elif pa.types.is_fixed_size_list(field.type):
            found.append(pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1]))
        elif pa.types.is_list(field.type):
            found.append(pa.array([[] for _ in range(len(values))], field.type))
        else:
            found.append(pa.array(np.ascontiguousarray(values), field.type))
    return pa.Table.from_arrays(found, schema=schema)


def _parts(arrays: Mapping[str, np.ndarray], *names: str, more: int = 0) -> Iterator[list[np.ndarray]]:
    """Blocks of rows of some arrays, whose memory is given back after each; ``more``: bytes that a row costs beside them."""
    some = [arrays[name] for name in names]
    for part in parts(len(some[0]), more + sum(one[:1].nbytes for one in some), *some, arrays["step"], arrays["time"]):
        yield [np.asarray(one[part]) for one in some]


def _states(world: World, arrays: Mapping[str, np.ndarray]) -> Iterator[list[np.ndarray]]:
    known = coordinates(world)
    for step, time, q, v in _parts(arrays, "step", "time", "q", "v"):
        named = [q, v] if len(known.q) + len(known.v) > MOST_COLUMNS else [*q.T, *v.T]
        yield [step, time, *named]


def _bodies(world: World, arrays: Mapping[str, np.ndarray]) -> Iterator[list[np.ndarray]]:
    count = len(world.bodies)
    for step, time, pose, velocity in _parts(arrays, "step", "time", "pose", "velocity", more=32 * count):
        index = np.tile(np.arange(count), len(step))
        numbers = [*pose.reshape(-1, len(POSE_COLUMNS)).T, *velocity.reshape(-1, len(VELOCITY_COLUMNS)).T]
        yield [np.repeat(step, count), np.repeat(time, count), index, *numbers]


def _energy(world: World, arrays: Mapping[str, np.ndarray]) -> Iterator[list[np.ndarray]]:
    for step, time, energy in _parts(arrays, "step", "time", "energy"):
        yield [step, time, *energy.T]


def _control(world: World, arrays: Mapping[str, np.ndarray]) -> Iterator[list[np.ndarray]]:
    for step, time, target, effort in _parts(arrays, "step", "time", "control.target", "control.effort"):
        yield [step, time, *target.T, *effort.T]


def _contacts(world: World, arrays: Mapping[str, np.ndarray]) -> Iterator[list[np.ndarray]]:
    names = [f"contact.{name}" for name in ("row", "body", "position", "normal", "distance", "normal_force")]
    for row, pair, position, normal, distance, force in _parts(arrays, *names):
        row = row.astype(np.int64)
        step, time = arrays["step"][row], arrays["time"][row]
        yield [row, step, time, *pair.T, *position.T, *normal.T, distance, force]


_COLUMNS = {"states": _states, "bodies": _bodies, "energy": _energy, "control": _control, "contacts": _contacts}


# --- reading --------------------------------------------------------------------------------------------------------------


def open_parquet(file: Any, size: int) -> parquet.ParquetFile:
    """An open file of ``size`` bytes as Parquet, of which only the metadata has been read. Raises ValueError, or OSError."""
    from pyarrow import parquet

    if size < 12:
        raise ValueError("no Parquet file: shorter than its frame")
    file.seek(size - 8)
    footer, magic = struct.unpack("<I4s", file.read(8))
    if magic != b"PAR1" or footer > min(LARGEST_FOOTER, size):
        raise ValueError(f"no Parquet file, or its metadata ({footer:,} bytes) is larger than such a file's")
    file.seek(0)
    return parquet.ParquetFile(file, thrift_string_size_limit=LARGEST_FOOTER, thrift_container_size_limit=1_000_000)


def read_checked(source: parquet.ParquetFile, schema: pa.Schema, rows: int) -> pa.Table:
    """The table of a Parquet file, which must have these columns and this many rows.

    What it would take in memory is told by its metadata and looked at before anything is unpacked. Raises ValueError with what
    is wrong (pyarrow's errors are ValueErrors or OSErrors).
    """
    _check(source, schema, rows)
    table = source.read(use_threads=False)
    _demand_whole(table)
    return table


def read_blocks(
    source: parquet.ParquetFile, schema: pa.Schema, rows: int, row_bytes: int
) -> Iterator[tuple[slice, pa.Table]]:
    """The same, one block of rows after the other; ``row_bytes``: of one row, unpacked."""
    import pyarrow as pa

    _check(source, schema, rows)
    done = 0
    for batch in source.iter_batches(block_rows(row_bytes), use_threads=False):
        table = pa.Table.from_batches([batch])
        _demand_whole(table)
        if done + len(table) > rows:
            break
        yield slice(done, done + len(table)), table
        done += len(table)
    if done != rows:
        raise ValueError(f"{rows:,} rows by its metadata, and others in it")


def _check(source: parquet.ParquetFile, schema: pa.Schema, rows: int) -> None:
    facts = source.metadata
    unpacked = sum(facts.row_group(index).total_byte_size for index in range(facts.num_row_groups))
    needed = max(unpacked, 8 * facts.num_rows * facts.num_columns)
    if facts.num_rows != rows:
        raise ValueError(f"{facts.num_rows:,} rows, should be {rows:,}")
    if needed > LARGEST_TABLE:
        raise ValueError(f"{needed / 1e9:.3g} GB in memory, more than the {LARGEST_TABLE / 1e9:.3g} GB that are read")
    found = source.schema_arrow
    if not found.equals(schema, check_metadata=False):
        raise ValueError(_differing(found, schema))
    wanted = (schema.metadata or {}).get(COORDINATES)
    if wanted is not None and (found.metadata or {}).get(COORDINATES) != wanted:
        raise ValueError("it has other coordinates than the world")


def _demand_whole(table: pa.Table) -> None:
    if gaps := [name for name in table.column_names if table[name].null_count]:
        raise ValueError(f"the column {gaps[0]!r} has gaps")


def _differing(found: pa.Schema, wanted: pa.Schema) -> str:
    """Which columns are missing, too many, or of another type: the first of each."""
    missing = [name for name in wanted.names if name not in found.names]
    more = [name for name in found.names if name not in wanted.names]
    if missing:
        return f"the column {missing[0]!r} is missing"
    if more:
        return f"the column {more[0][:80]!r} is not of such a table"
    for name, field in zip(wanted.names, wanted, strict=True):
        if found.names.count(name) > 1:
            return f"the column {name!r} is there twice"
        if not found.field(name).type.equals(field.type):
            return f"the column {name!r} holds {found.field(name).type}, should be {field.type}"
    return "its columns are in another order"


def columns(table: pa.Table, names: Sequence[str], shape: tuple[int, ...]) -> np.ndarray:
    """Some columns as one array of ``shape`` and their number."""
    if not names:
        return np.zeros((*shape, 0))
    return np.stack([table[name].to_numpy() for name in names], axis=-1).reshape(*shape, len(names))


def lists(table: pa.Table, name: str) -> np.ndarray:
    """A column of lists of one length as an array (rows, length)."""
    import pyarrow.compute

    flat = pyarrow.compute.list_flatten(table[name]).to_numpy()
    return flat.reshape(len(table), -1) if len(flat) else np.zeros((len(table), 0))


def indices(table: pa.Table, name: str, world: World) -> np.ndarray:
    """A column of bodies' names as indices (rows,). Raises ValueError for a name that is no body's."""
    places = {body.name: index for index, body in enumerate(world.bodies)}
    found = [np.zeros(0, dtype=np.int64)]
    for chunk in table[name].chunks:
        words = chunk.dictionary.to_pylist()
        strange = [word for word in words if word not in places]
        if strange or chunk.null_count:
            raise ValueError(
                f"the column {name!r} names {str(strange[:1] or 'nothing')[:80]}, which is no body of the world"
            )
        found.append(np.array([places[word] for word in words], dtype=np.int64)[chunk.indices.to_numpy()])
    return np.concatenate(found)


def read_arrays(world: World, joints: Sequence[str], tables: Mapping[str, pa.Table]) -> dict[str, np.ndarray]:
    """The arrays of a run from its tables. Raises ValueError where tables contradict each other."""
    known, states = coordinates(world), tables["states"]
    rows, count = len(states), len(world.bodies)
    arrays = {name: states[name].to_numpy() for name in ("step", "time")}
    if len(known.q) + len(known.v) > MOST_COLUMNS:
        arrays |= {part: lists(states, part) for part in ("q", "v")}
    else:
        for part, names in (("q", known.q), ("v", known.v)):
            arrays[part] = columns(states, [f"{part}.{name}" for name in names], (rows,))
    bodies = tables["bodies"]
    if not np.array_equal(indices(bodies, "body", world), np.tile(np.arange(count), rows)):
        raise ValueError("bodies.parquet: the bodies are not the world's, in the world's order, at every time")
    _same_times(arrays, tables, count)
    arrays["pose"] = columns(bodies, POSE_COLUMNS, (rows, count))
    arrays["velocity"] = columns(bodies, VELOCITY_COLUMNS, (rows, count))
    if "energy" in tables:
        arrays["energy"] = columns(tables["energy"], ("kinetic", "potential"), (rows,))
    if "control" in tables:
        for part in ("target", "effort"):
            arrays[f"control.{part}"] = columns(tables["control"], [f"{part}.{name}" for name in joints], (rows,))
    if "contacts" in tables:
        contacts = tables["contacts"]
        row = contacts["row"].to_numpy()
        if len(row) and (row.min() < 0 or row.max() >= rows or (np.diff(row) < 0).any()):
            raise ValueError("contacts.parquet: its rows are none of the run's, or out of order")
        if not np.array_equal(contacts["step"].to_numpy(), arrays["step"][row]):
            raise ValueError("contacts.parquet: its steps are not those of its rows")
        arrays["contact.row"] = row
        arrays["contact.body"] = np.stack([indices(contacts, side, world) for side in ("first", "second")], axis=-1)
        arrays["contact.position"] = columns(contacts, AXES, (len(row),))
        arrays["contact.normal"] = columns(contacts, [f"n{axis}" for axis in AXES], (len(row),))
        for name in ("distance", "normal_force"):
            arrays[f"contact.{name}"] = contacts[name].to_numpy()
    return arrays


def _same_times(arrays: Mapping[str, np.ndarray], tables: Mapping[str, pa.Table], bodies: int) -> None:
    step = arrays["step"]
    if len(step) and (step[0] < 0 or (np.diff(step) <= 0).any()):
        raise ValueError("states.parquet: its steps do not rise")
    for name, repeated in (("bodies", bodies), ("energy", 1), ("control", 1)):
        if name in tables:
            for column in ("step", "time"):
                if not np.array_equal(tables[name][column].to_numpy(), np.repeat(arrays[column], repeated)):
                    raise ValueError(f"{name}.parquet: its {column}s are not those of states.parquet")
