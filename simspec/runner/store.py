"""A run on disk: Parquet tables for the arrays, JSON for the world and the provenance.

``bodies.parquet`` and ``contacts.parquet`` are long tables with the bodies' names, ready for pandas, polars or DuckDB;
``states.parquet`` has a column for each generalised coordinate, by its name (``q.elbow``, ``v.base.wx``), and
``control.parquet`` one for each driven joint's target and effort (``target.elbow``). :func:`load_run` gives back every array
bit for bit.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simspec.engines.base import CONTACT_FIELDS
from simspec.errors import Problem, SpecError
from simspec.outputs.marker import RUN
from simspec.outputs.reading import read_bytes
from simspec.outputs.writing import build_folder, put
from simspec.runner.run import SCHEMA, Run
from simspec.stored import parse
from simspec.world.canonical import canonical_json, from_plain, sha256
from simspec.world.coordinates import coordinates
from simspec.world.types import World

if TYPE_CHECKING:
    import pyarrow

PROVENANCE_FILE = "provenance.json"
WORLD_FILE = "world.json"
POSE_COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")
VELOCITY_COLUMNS = ("vx", "vy", "vz", "wx", "wy", "wz")
AXES = ("x", "y", "z")
MOST_COLUMNS = 4096
"""Columns of q and v by name: each costs 1 kB in the file and 15 kB of memory beside its values. Beyond that (300 free bodies)
q and v are two columns of lists, and the names stand in the table's metadata under ``simspec.coordinates``."""
COORDINATES = b"simspec.coordinates"


LARGEST_FACTS = 16 * 2**20
"""Bytes of a provenance: a few kB, and an engine's warnings."""


def save_run(run: Run, folder: Path) -> Path:
    """Write ``run`` as what simspec has in ``folder``, whole or not at all.

    Raises SpecError when the folder may not be written (:mod:`simspec.outputs.targets`).
    """
    import pyarrow.parquet

    def build(fresh: Path) -> Iterator[str]:
        for table_name, table in _tables(run).items():
            pyarrow.parquet.write_table(table, fresh / f"{table_name}.parquet", compression="zstd")
            yield f"{table_name}.parquet"
        put(fresh / WORLD_FILE, canonical_json(run.world) + "\n")
        yield WORLD_FILE
        facts = {**run.provenance, "failed": run.failed}
        text = json.dumps(facts, indent=2, sort_keys=True, allow_nan=False, ensure_ascii=False)
        put(fresh / PROVENANCE_FILE, text + "\n")
        yield PROVENANCE_FILE

    build_folder(build, folder, RUN)
    return folder.absolute()


def _tables(run: Run) -> dict[str, pyarrow.Table]:
    import pyarrow as pa

    arrays = run.arrays
    if not run.recorded:
        return {}
    step, time, pose = arrays["step"].astype(np.int64), arrays["time"], arrays["pose"]
    rows, bodies = pose.shape[:2]
    names = pa.array([body.name for body in run.world.bodies], pa.string())

    def named(indices: np.ndarray) -> pa.Array:
        return pa.DictionaryArray.from_arrays(pa.array(indices.astype(np.int32)), names)

    found = {
        "states": _states(run),
        "bodies": pa.table(
            {
                "step": np.repeat(step, bodies),
                "time": np.repeat(time, bodies),
                "body": named(np.tile(np.arange(bodies), rows)),
                **{column: pose[..., k].ravel() for k, column in enumerate(POSE_COLUMNS)},
                **{column: arrays["velocity"][..., k].ravel() for k, column in enumerate(VELOCITY_COLUMNS)},
            }
        ),
    }
    if "energy" in arrays:
        kinetic, potential = arrays["energy"].T
        found["energy"] = pa.table({"step": step, "time": time, "kinetic": kinetic, "potential": potential})
    if "control.target" in arrays:
        joints = run.provenance["control"]["joints"]
        named_columns = {
            f"{part}.{joint}": arrays[f"control.{part}"][:, k]
            for part in ("target", "effort")
            for k, joint in enumerate(joints)
        }
        found["control"] = pa.table({"step": step, "time": time, **named_columns})
    if "contact.row" in arrays:
        row, pair = arrays["contact.row"].astype(np.int64), arrays["contact.body"]
        found["contacts"] = pa.table(
            {
                "row": row,
                "step": step[row],
                "time": time[row],
                "first": named(pair[:, 0]),
                "second": named(pair[:, 1]),
                **{axis: arrays["contact.position"][:, k] for k, axis in enumerate(AXES)},
                **{f"n{axis}": arrays["contact.normal"][:, k] for k, axis in enumerate(AXES)},
                "distance": arrays["contact.distance"],
                "normal_force": arrays["contact.normal_force"],
            }
        )
    return found


def _states(run: Run) -> pyarrow.Table:
    import pyarrow as pa

    names, arrays = run.coordinates, run.arrays
    when = {"step": arrays["step"].astype(np.int64), "time": arrays["time"]}
    if len(names.q) + len(names.v) > MOST_COLUMNS:
        told = json.dumps({"q": names.q, "v": names.v})
        table = pa.table({**when, "q": _lists(arrays["q"]), "v": _lists(arrays["v"])})
        return table.replace_schema_metadata({COORDINATES: told})
    columns = {f"q.{name}": arrays["q"][:, k] for k, name in enumerate(names.q)}
    columns |= {f"v.{name}": arrays["v"][:, k] for k, name in enumerate(names.v)}
    return pa.table({**when, **columns})


def _lists(values: np.ndarray) -> Any:
    import pyarrow as pa

    return (
        pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
        if values.shape[1]
        else pa.array([[] for _ in range(len(values))], pa.list_(pa.float64()))
    )


def is_run(folder: Path) -> bool:
    """Whether ``folder`` looks like a saved run."""
    return (folder / PROVENANCE_FILE).is_file()


def stored_runs(folder: Path) -> dict[str, str | None]:
    """The runs below a folder: the hash of the world that each is of, by the folder's name; None where that cannot be read."""
    found: dict[str, str | None] = {}
    for place in sorted(folder.iterdir()):
        if place.is_symlink() or not place.is_dir() or not is_run(place):
            continue
        try:
            facts = parse(read_bytes(place / PROVENANCE_FILE, LARGEST_FACTS), str(place))
        except SpecError:
            facts = None
        known = facts.get("world_sha256") if isinstance(facts, dict) else None
        found[place.name] = known if isinstance(known, str) else None
    return found


def load_run(folder: Path | str) -> Run:
    """The run saved in ``folder``. Raises SpecError when it is not one, or is damaged."""
    folder = Path(folder)
    try:
        provenance = json.loads((folder / PROVENANCE_FILE).read_text(encoding="utf-8"))
        world = from_plain(World, json.loads((folder / WORLD_FILE).read_text(encoding="utf-8")))
    except FileNotFoundError as error:
        raise SpecError([Problem(f"{folder} is no saved run: {Path(error.filename).name} is missing")]) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SpecError([Problem(f"the run in {folder} cannot be read: {error}")]) from None
    if provenance.get("schema") != SCHEMA:
        message = f"the run in {folder} has schema {provenance.get('schema')!r}, this simspec reads {SCHEMA}"
        raise SpecError([Problem(message, hint="run it again: simspec run")])
    if provenance["world_sha256"] != sha256(world):
        message = f"the world in {folder} is not the one that was run: its hash differs from the provenance"
        raise SpecError([Problem(message)])
    failed = provenance.pop("failed")
    try:
        arrays = _read_arrays(folder, world, provenance)
    except (OSError, ValueError, KeyError) as error:  # pyarrow's errors are ValueErrors
        raise SpecError([Problem(f"the run in {folder} cannot be read: {error}")]) from None
    if not arrays and failed is None:
        raise SpecError([Problem(f"{folder} is no whole run: bodies.parquet is missing")])
    return Run(world, provenance["engine"], arrays, provenance, failed)


def _columns(table: pyarrow.Table, names: tuple[str, ...], shape: tuple[int, ...]) -> np.ndarray:
    return np.stack([table[name].to_numpy() for name in names], axis=-1).reshape(*shape, len(names))


def _unlisted(column: pyarrow.ChunkedArray) -> np.ndarray:
    import pyarrow.compute

    flat = pyarrow.compute.list_flatten(column).to_numpy()
    return flat.reshape(len(column), -1) if len(flat) else np.zeros((len(column), 0))


def _named(table: pyarrow.Table, part: str, names: Sequence[str]) -> np.ndarray:
    """The columns ``part.NAME`` of the table as one array (rows, names); KeyError for one that is missing."""
    columns = [table[f"{part}.{name}"].to_numpy() for name in names]
    return np.stack(columns, axis=-1) if columns else np.zeros((len(table), 0))


def _read_states(table: pyarrow.Table, world: World) -> dict[str, np.ndarray]:
    names = coordinates(world)
    if len(names.q) + len(names.v) <= MOST_COLUMNS:
        return {"q": _named(table, "q", names.q), "v": _named(table, "v", names.v)}
    told = json.loads((table.schema.metadata or {}).get(COORDINATES, b"{}"))
    if told != {"q": list(names.q), "v": list(names.v)}:
        raise ValueError("states.parquet has other coordinates than the world")
    return {name: _unlisted(table[name]) for name in ("q", "v")}


def _read_arrays(folder: Path, world: World, provenance: Mapping[str, Any]) -> dict[str, np.ndarray]:
    from pyarrow import parquet

    if not (folder / "bodies.parquet").is_file():
        return {}
    states = parquet.read_table(folder / "states.parquet")
    bodies = parquet.read_table(folder / "bodies.parquet")
    shape = (len(states), len(world.bodies))
    arrays = {"step": states["step"].to_numpy(), "time": states["time"].to_numpy()}
    arrays |= _read_states(states, world)
    arrays["pose"] = _columns(bodies, POSE_COLUMNS, shape)
    arrays["velocity"] = _columns(bodies, VELOCITY_COLUMNS, shape)
    if (folder / "energy.parquet").is_file():
        energy = parquet.read_table(folder / "energy.parquet")
        arrays["energy"] = _columns(energy, ("kinetic", "potential"), (len(energy),))
    if (folder / "control.parquet").is_file():
        control = parquet.read_table(folder / "control.parquet")
        for name in ("target", "effort"):
            arrays[f"control.{name}"] = _named(control, name, provenance["control"]["joints"])
    if (folder / "contacts.parquet").is_file():
        contacts = parquet.read_table(folder / "contacts.parquet")
        index = {body.name: k for k, body in enumerate(world.bodies)}
        pair = [[index[name] for name in contacts[side].to_pylist()] for side in ("first", "second")]
        arrays["contact.row"] = contacts["row"].to_numpy()
        arrays["contact.body"] = np.array(pair, dtype=np.int64).reshape(2, -1).T
        arrays["contact.position"] = _columns(contacts, AXES, (len(contacts),))
        arrays["contact.normal"] = _columns(contacts, tuple(f"n{axis}" for axis in AXES), (len(contacts),))
        for name in ("distance", "normal_force"):
            arrays[f"contact.{name}"] = contacts[name].to_numpy()
        assert {f"contact.{name}" for name in CONTACT_FIELDS} <= set(arrays)
    return arrays
