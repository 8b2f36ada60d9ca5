"""The tables of a saved run: their columns, writing them, and reading them as untrusted data, block by block.

``bodies`` and ``contacts`` are long tables with the names of bodies, and of shapes that touch; ``states`` has a column for each
generalised coordinate, by its name (``q.elbow``, ``v.base.wx``), ``control`` one for each driven joint's target and effort
(``target.elbow``).
"""

from __future__ import annotations

import functools
import json
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simspec.engines.kit.arrays import SECONDS
from simspec.errors import Problem, SpecError
from simspec.files import RECORDED_BYTES, block_rows, parts, release, zeros
from simspec.runner.labels import Labels, side_names
from simspec.world.kinematics import Coordinates, coordinates
from simspec.world.types import World

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow import parquet

    Blocks = Iterator[tuple[slice, pa.Table]]

POSE_COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")
VELOCITY_COLUMNS = ("vx", "vy", "vz", "wx", "wy", "wz")
AXES = ("x", "y", "z")
MOST_COLUMNS = 256
"""Columns of q and v by name: each costs 1 kB in the file, 15 kB of memory, 60 µs of processor time in addition to its values.
Beyond that (19 free bodies) q and v are two columns of lists, and the names stand in the table's metadata under
``simspec.coordinates``: 216 spheres then take 10 ms instead of 180 to write, and a quarter less room. Tables with more columns,
which simspec wrote before, are read as they are."""
COORDINATES = b"simspec.coordinates"
SECONDS_COLUMNS = tuple(f"{name}_seconds" for name in SECONDS)
LARGEST_TABLE = RECORDED_BYTES
"""Bytes that a table may have unpacked, by its own metadata, which is looked at first."""
LARGEST_FOOTER = 64 * 2**20
"""Bytes of a Parquet file's own metadata."""


def schemas(world: World, arrays: Sequence[str], labels: Labels) -> dict[str, pa.Schema]:
    """The columns of every table of a run of ``world`` that recorded ``arrays``; ``labels``: names of columns."""
    import pyarrow as pa

    number, integer, name = pa.float64(), pa.int64(), pa.dictionary(pa.int32(), pa.string())
    when = [("step", integer), ("time", number)]
    tables = {"states": states_schema(world, _as_lists(world))}
    placed = [(column, number) for column in (*POSE_COLUMNS, *VELOCITY_COLUMNS)]
    tables["bodies"] = pa.schema([*when, ("body", name), *placed])
    if "energy" in arrays:
        tables["energy"] = pa.schema([*when, ("kinetic", number), ("potential", number)])
    if "control.target" in arrays:
        driven = [(f"{part}.{joint}", number) for part in ("target", "effort") for joint in labels.joints]
        tables["control"] = pa.schema([*when, *driven])
    if "contact.row" in arrays:
        measured = [*AXES, *(f"n{axis}" for axis in AXES), "distance", "normal_force"]
        pair = [("first", name), ("second", name)]
        if labels.groups is not None:
            pair += [("first_shape", name), ("second_shape", name)]
        tables["contacts"] = pa.schema([("row", integer), *when, *pair, *((column, number) for column in measured)])
    if "seconds" in arrays:
        tables["seconds"] = pa.schema([*when, *((column, number) for column in SECONDS_COLUMNS)])
    return tables


def _as_lists(world: World) -> bool:
    known = coordinates(world)
    return len(known.q) + len(known.v) > MOST_COLUMNS


def states_schema(world: World, as_lists: bool) -> pa.Schema:
    """The columns of ``states``: one for each coordinate, or ``as_lists``, one for q and one for v."""
    import pyarrow as pa

    known, number = coordinates(world), pa.float64()
    fields: list[tuple[str, Any]] = [("step", pa.int64()), ("time", number)]
    parts = {"q": known.q, "v": known.v}
    if not as_lists:
        return pa.schema([*fields, *((f"{part}.{name}", number) for part, names in parts.items() for name in names)])
    fields += [(part, pa.list_(number, len(names)) if names else pa.list_(number)) for part, names in parts.items()]
    return pa.schema(fields).with_metadata({COORDINATES: json.dumps({"q": known.q, "v": known.v})})


def as_stored(source: parquet.ParquetFile, schema: pa.Schema, world: World) -> pa.Schema:
    """``schema``, or that of states with a column for each coordinate, where the file has such columns and needs none."""
    if COORDINATES in (schema.metadata or {}) and "q" not in source.schema_arrow.names:
        return states_schema(world, as_lists=False)
    return schema


def write_tables(
    world: World, arrays: Mapping[str, np.ndarray], labels: Labels, folder: Path
) -> Iterator[tuple[str, int]]:
    """Write every table into ``folder``, a block at a time, and give its name and number of rows."""
    for name, schema in schemas(world, list(arrays), labels).items():
        yield name, _write(name, schema, world, labels, arrays, folder / f"{name}.parquet")


def table_writers(world: World, arrays: Mapping[str, np.ndarray], labels: Labels) -> dict[str, Callable[[Any], int]]:
    """For every table, by name, what writes it into an open file, a block at a time, and gives its number of rows."""
    return {
        name: functools.partial(_write, name, schema, world, labels, arrays)
        for name, schema in schemas(world, list(arrays), labels).items()
    }


def arrow_table(world: World, arrays: Mapping[str, np.ndarray], labels: Labels, name: str) -> pa.Table:
    """A table of a run in memory, with the columns of its file. Raises SpecError where the run did not record it."""
    import pyarrow as pa

    known = schemas(world, list(arrays), labels)
    if name not in known:
        hint = f"recorded are {', '.join(known)}"
        raise SpecError([Problem(f"the run recorded no table {name!r}", found=name, hint=hint, code="R107")])
    schema = known[name]
    return pa.concat_tables([_table(columns, schema, world, labels) for columns in _COLUMNS[name](world, arrays)])


def _write(
    name: str, schema: pa.Schema, world: World, labels: Labels, arrays: Mapping[str, np.ndarray], target: Any
) -> int:
    from pyarrow import parquet

    rows = 0
    # statistics are for finding rows in files of many blocks; they take a twentieth of the room
    with parquet.ParquetWriter(
        target, schema, compression="zstd", write_statistics=False, **_encodings(schema)
    ) as writer:
        for columns in _COLUMNS[name](world, arrays):
            table = _table(columns, schema, world, labels)
            rows += len(table)
            writer.write_table(table)
    return rows


def _encodings(schema: pa.Schema) -> dict[str, list[str]]:
    """How the columns are packed, to the bit. Measured numbers hardly repeat: split by bytes they take a third less room than
    by a dictionary, and half the time. Names, steps and times repeat with each body."""
    import pyarrow as pa

    numbers: list[str] = []
    words: list[str] = []
    for field in schema:
        if pa.types.is_fixed_size_list(field.type) or pa.types.is_list(field.type):
            numbers.append(f"{field.name}.list.element")
        else:
            (numbers if pa.types.is_floating(field.type) and field.name != "time" else words).append(field.name)
    return {"use_dictionary": words, "use_byte_stream_split": numbers}


def _table(columns: Sequence[np.ndarray], schema: pa.Schema, world: World, labels: Labels) -> pa.Table:
    import pyarrow as pa

    bodies = _texts([body.name for body in world.bodies])
    sides = _texts(side_names(world, labels) if "first_shape" in schema.names else [])
    filled = []
    for values, field in zip(columns, schema, strict=True):
        if pa.types.is_dictionary(field.type):
            names = sides if field.name.endswith("_shape") else bodies
            filled.append(pa.DictionaryArray.from_arrays(numbers_array(values, pa.int32()), names))
        elif pa.types.is_fixed_size_list(field.type):
            filled.append(
                pa.FixedSizeListArray.from_arrays(numbers_array(values.ravel(), pa.float64()), values.shape[1])
            )
        elif pa.types.is_list(field.type):
            filled.append(_no_numbers(len(values), field.type))
        else:
            filled.append(numbers_array(values, field.type))
    return pa.Table.from_arrays(filled, schema=schema)


# Arrays from buffers: ``pyarrow.array`` imports pandas where it is installed, which takes longer than the rest of a short run.


def numbers_array(values: np.ndarray, kind: pa.DataType) -> pa.Array:
    """Numbers (n,) of one type."""
    import pyarrow as pa

    stored = np.ascontiguousarray(values, kind.to_pandas_dtype())
    return pa.Array.from_buffers(kind, len(stored), [None, pa.py_buffer(stored)])


def _texts(texts: Sequence[str]) -> pa.Array:
    """Texts (n,), in UTF-8."""
    import pyarrow as pa

    encoded = [text.encode() for text in texts]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.Array.from_buffers(pa.string(), len(encoded), [None, pa.py_buffer(ends), pa.py_buffer(b"".join(encoded))])


def _no_numbers(count: int, kind: pa.DataType) -> pa.Array:
    """``count`` lists without numbers."""
    import pyarrow as pa

    starts = numbers_array(np.zeros(count + 1), pa.int32())
    return pa.ListArray.from_arrays(starts, numbers_array(np.zeros(0), pa.float64()), type=kind)


def _parts(arrays: Mapping[str, np.ndarray], *names: str, more: int = 0) -> Iterator[list[np.ndarray]]:
    """Blocks of rows of some arrays, whose memory is given back after each; ``more``: further bytes that a row costs."""
    named = [arrays[name] for name in names]
    for part in parts(
        len(named[0]), more + sum(array[:1].nbytes for array in named), *named, arrays["step"], arrays["time"]
    ):
        yield [np.asarray(array[part]) for array in named]


def _states(world: World, arrays: Mapping[str, np.ndarray]) -> Iterator[list[np.ndarray]]:
    as_lists = _as_lists(world)
    for step, time, q, v in _parts(arrays, "step", "time", "q", "v"):
        named = [q, v] if as_lists else [*q.T, *v.T]
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


def _seconds(world: World, arrays: Mapping[str, np.ndarray]) -> Iterator[list[np.ndarray]]:
    for step, time, seconds in _parts(arrays, "step", "time", "seconds"):
        yield [step, time, *seconds.T]


def _contacts(world: World, arrays: Mapping[str, np.ndarray]) -> Iterator[list[np.ndarray]]:
    names = [f"contact.{name}" for name in ("row", "body", "position", "normal", "distance", "normal_force")]
    if "contact.shape" in arrays:
        names.insert(2, "contact.shape")
    for row, *pairs, position, normal, distance, force in _parts(arrays, *names):
        row = row.astype(np.int64)
        step, time = arrays["step"][row], arrays["time"][row]
        yield [row, step, time, *(side for pair in pairs for side in pair.T), *position.T, *normal.T, distance, force]


_COLUMNS = {
    "states": _states,
    "bodies": _bodies,
    "energy": _energy,
    "control": _control,
    "contacts": _contacts,
    "seconds": _seconds,
}


# --- reading --------------------------------------------------------------------------------------------------------------


def open_parquet(file: Any, size: int) -> parquet.ParquetFile:
    """An open file of ``size`` bytes as Parquet, of which only the metadata has been read. Raises ValueError, or OSError."""
    from pyarrow import parquet

    if size < 12:
        raise ValueError("not a Parquet file: too short")
    file.seek(size - 8)
    footer, magic = struct.unpack("<I4s", file.read(8))
    if magic != b"PAR1" or footer > min(LARGEST_FOOTER, size):
        raise ValueError(f"not a Parquet file, or its metadata ({footer:,} bytes) is larger than such a file's")
    file.seek(0)
    return parquet.ParquetFile(file, thrift_string_size_limit=LARGEST_FOOTER, thrift_container_size_limit=1_000_000)


def read_blocks(source: parquet.ParquetFile, schema: pa.Schema, rows: int) -> Iterator[tuple[slice, pa.Table]]:
    """The table of a Parquet file, which must have these columns and this many rows, one block of rows after the other.

    Its metadata says how much it would be, and is read before anything is unpacked. Raises ValueError with what is wrong
    (pyarrow's errors are ValueErrors or OSErrors).
    """
    import pyarrow as pa

    check(source, schema, rows)
    numbers = sum(entry.type.list_size if pa.types.is_fixed_size_list(entry.type) else 1 for entry in schema)
    done, size, groups = 0, block_rows(8 * numbers), range(source.num_row_groups)
    # of one group of rows after the other: of several, the reader would keep what it has read of the file
    for batch in (batch for group in groups for batch in source.iter_batches(size, [group], use_threads=False)):
        table = pa.Table.from_batches([batch])
        if gaps := [name for name in table.column_names if table[name].null_count]:
            raise ValueError(f"the column {gaps[0]!r} has missing values")
        if done + len(table) > rows:
            break
        yield slice(done, done + len(table)), table
        done += len(table)
    if done != rows:
        raise ValueError(f"{rows:,} rows by its metadata, and others in it")


def check(source: parquet.ParquetFile, schema: pa.Schema, rows: int) -> None:
    """Raise ValueError unless a Parquet file says that it has these columns and this many rows, and is not too large."""
    facts = source.metadata
    unpacked = sum(facts.row_group(index).total_byte_size for index in range(facts.num_row_groups))
    needed = max(unpacked, 8 * facts.num_rows * facts.num_columns)
    if facts.num_rows != rows:
        raise ValueError(f"{facts.num_rows:,} rows, should be {rows:,}")
    if needed > LARGEST_TABLE:
        raise ValueError(f"{needed / 1e9:.3g} GB unpacked, more than the {LARGEST_TABLE / 1e9:.3g} GB that are read")
    stored = source.schema_arrow
    if not stored.equals(schema, check_metadata=False):
        raise ValueError(_differing(stored, schema))
    wanted = (schema.metadata or {}).get(COORDINATES)
    if wanted is not None and (stored.metadata or {}).get(COORDINATES) != wanted:
        raise ValueError("it has other coordinates than the world")


def _differing(stored: pa.Schema, wanted: pa.Schema) -> str:
    """Which columns are missing, too many, or of another type: the first of each."""
    missing = [name for name in wanted.names if name not in stored.names]
    more = [name for name in stored.names if name not in wanted.names]
    if missing:
        return f"the column {missing[0]!r} is missing"
    if more:
        return f"the column {more[0][:80]!r} is unknown"
    for name, field in zip(wanted.names, wanted, strict=True):
        if stored.names.count(name) > 1:
            return f"the column {name!r} is duplicated"
        if not stored.field(name).type.equals(field.type):
            return f"the column {name!r} holds {stored.field(name).type}, should be {field.type}"
    return "its columns are in another order"


def columns(table: pa.Table, names: Sequence[str]) -> np.ndarray:
    """Some columns as one array (rows, columns)."""
    if not names:
        return np.zeros((len(table), 0))
    return np.stack([table[name].to_numpy() for name in names], axis=-1)


def lists(table: pa.Table, name: str) -> np.ndarray:
    """A column of lists of one length as an array (rows, length)."""
    import pyarrow.compute

    flat = pyarrow.compute.list_flatten(table[name]).to_numpy()
    return flat.reshape(len(table), -1) if len(flat) else np.zeros((len(table), 0))


def indices(table: pa.Table, name: str, names: Sequence[str]) -> np.ndarray:
    """A column of ``names`` as indices (rows,). Raises ValueError for another name."""
    places = {name: index for index, name in enumerate(names)}
    blocks = [np.zeros(0, dtype=np.int64)]
    for chunk in table[name].chunks:
        words = chunk.dictionary.to_pylist()
        unexpected = [word for word in words if word not in places]
        if unexpected or chunk.null_count:
            raise ValueError(
                f"the column {name!r} names {str(unexpected[:1] or 'nothing')[:80]}, which the world does not have"
            )
        blocks.append(np.array([places[word] for word in words], dtype=np.int64)[chunk.indices.to_numpy()])
    return np.concatenate(blocks)


def read_arrays(
    world: World, labels: Labels, rows: Mapping[str, int], read: Mapping[str, Blocks]
) -> dict[str, np.ndarray]:
    """The arrays of a run from its tables, each given block by block, and the number of rows of each. Raises ValueError where
    tables contradict each other."""
    known, count, times = coordinates(world), len(world.bodies), rows["states"]
    bodies = [body.name for body in world.bodies]
    arrays = {"step": zeros((times,), int), "time": zeros((times,))}
    arrays |= {"q": zeros((times, len(known.q))), "v": zeros((times, len(known.v)))}
    _read_states(known, arrays, read["states"])
    pose, velocity = zeros((times * count, len(POSE_COLUMNS))), zeros((times * count, len(VELOCITY_COLUMNS)))
    for part, table in read["bodies"]:
        place = np.arange(part.start, part.stop)
        if not np.array_equal(indices(table, "body", bodies), place % count):
            raise ValueError("bodies.parquet: the bodies are not the world's, in the world's order, at every time")
        _demand_times(arrays, "bodies", table, place // count)
        _put(part, (pose, columns(table, POSE_COLUMNS)), (velocity, columns(table, VELOCITY_COLUMNS)))
    arrays["pose"], arrays["velocity"] = (values.reshape(times, count, values.shape[1]) for values in (pose, velocity))
    by_table = {"energy": {"energy": ["kinetic", "potential"]}, "seconds": {"seconds": list(SECONDS_COLUMNS)}}
    by_table["control"] = {
        f"control.{part}": [f"{part}.{name}" for name in labels.joints] for part in ("target", "effort")
    }
    for name, wanted in by_table.items():
        if name not in read:
            continue
        arrays |= {array: zeros((times, len(names))) for array, names in wanted.items()}
        for part, table in read[name]:
            _demand_times(arrays, name, table, np.arange(part.start, part.stop))
            _put(part, *((arrays[array], columns(table, names)) for array, names in wanted.items()))
    if "contacts" in read:
        sides = None if labels.groups is None else side_names(world, labels)
        arrays |= _read_contacts(bodies, sides, arrays, rows["contacts"], read["contacts"])
    return arrays


def _put(part: slice, *pairs: tuple[np.ndarray, np.ndarray]) -> None:
    """Put a block's values into arrays of all rows."""
    for array, values in pairs:
        array[part] = values
        release(array)


def _read_states(known: Coordinates, arrays: Mapping[str, np.ndarray], read: Blocks) -> None:
    last = -1
    for part, table in read:
        step = table["step"].to_numpy()
        if len(step) and (step[0] <= last or (np.diff(step) <= 0).any()):
            raise ValueError("states.parquet: its steps do not rise")
        last = step[-1] if len(step) else last
        if "q" in table.column_names:  # a coordinate's column has a name after a dot
            q, v = lists(table, "q"), lists(table, "v")
        else:
            q, v = (
                columns(table, [f"{kind}.{name}" for name in names]) for kind, names in (("q", known.q), ("v", known.v))
            )
        values = {"step": step, "time": table["time"].to_numpy(), "q": q, "v": v}
        _put(part, *((arrays[name], kind) for name, kind in values.items()))


def _demand_times(arrays: Mapping[str, np.ndarray], name: str, table: pa.Table, row: np.ndarray) -> None:
    """Raise ValueError unless the rows of a table are of the steps and times of these rows of the run."""
    for column in ("step", "time"):
        if not np.array_equal(table[column].to_numpy(), arrays[column][row]):
            raise ValueError(f"{name}.parquet: its {column}s are not those of states.parquet")
        release(arrays[column])


def _read_contacts(
    bodies: Sequence[str], sides: Sequence[str] | None, arrays: Mapping[str, np.ndarray], count: int, read: Blocks
) -> dict[str, np.ndarray]:
    """``bodies``, ``sides``: the names of bodies and of contacts' sides, None where those were not recorded."""
    shapes: dict[str, tuple[int, ...]] = {"row": (), "body": (2,), "position": (3,), "normal": (3,)}
    shapes |= {"distance": (), "normal_force": ()}
    if sides is not None:
        shapes["shape"] = (2,)
    contacts = {
        name: zeros((count, *shape), int if name in ("row", "body", "shape") else float)
        for name, shape in shapes.items()
    }
    last, rows = 0, len(arrays["step"])
    for part, table in read:
        row = table["row"].to_numpy()
        if len(row) and (row[0] < last or row.max() >= rows or (np.diff(row) < 0).any()):
            raise ValueError("contacts.parquet: its rows are not of this run, or are out of order")
        last = row[-1] if len(row) else last
        if not np.array_equal(table["step"].to_numpy(), arrays["step"][row]):
            raise ValueError("contacts.parquet: its steps are not those of its rows")
        release(arrays["step"])
        values = {"row": row, "position": columns(table, AXES), "normal": columns(table, [f"n{axis}" for axis in AXES])}
        values |= {name: table[name].to_numpy() for name in ("distance", "normal_force")}
        values["body"] = np.stack([indices(table, side, bodies) for side in ("first", "second")], axis=-1)
        if sides is not None:
            values["shape"] = np.stack(
                [indices(table, f"{side}_shape", sides) for side in ("first", "second")], axis=-1
            )
        _put(part, *((contacts[name], column) for name, column in values.items()))
    return {f"contact.{name}": values for name, values in contacts.items()}
