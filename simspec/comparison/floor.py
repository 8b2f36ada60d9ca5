"""How far an engine repeats itself: the floor below which two engines cannot be told apart.

An engine is run again unchanged, and once more with its initial state moved in the last bits (1e-15). What these runs
differ by is not about physics or models: in a chaotic scenario it grows without bound, and a difference between two
engines that is of its size says nothing.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from simspec.errors import Problem, SpecError
from simspec.outputs.marker import RUN
from simspec.outputs.reading import open_regular
from simspec.outputs.writing import add_file
from simspec.runner import tables
from simspec.runner.metrics import rotation_vectors
from simspec.runner.run import Run
from simspec.runner.store import read_provenance
from simspec.stored import FloorFacts, read_as

PERTURBATION = 1e-15
"""Relative change of the initial state: 4.5 times the spacing of doubles at 1, the smallest that reaches every number."""

FLOOR_FACTOR = 3.0
"""Differences up to this many times the floor are not told apart from round-off. A floor comes from one perturbed run,
in one direction, once, whereas two engines round differently at every step: their difference is of the floor's size, not
below it. Where a floor grows, it grows exponentially, and a factor of 3 moves the horizon by a fraction of one e-folding."""


@dataclass(frozen=True)
class Floor:
    """An engine's own noise: for every recorded time and body the largest position (m) and angle (rad) deviation so far
    of the repeats from the run, (rows, bodies).

    ``bitwise``: whether the unchanged repeat gave the same bits everywhere; None when there was none.
    """

    engine: str
    time: np.ndarray = field(repr=False)
    position: np.ndarray = field(repr=False)
    angle: np.ndarray = field(repr=False)
    bitwise: bool | None
    perturbation: float | None

    @property
    def largest(self) -> float:
        """The largest position deviation (m) over all bodies and times."""
        return float(self.position.max()) if self.position.size else 0.0


def deviations(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (m) and angles (rad) (rows, bodies) between two arrays of poses (rows, bodies, 7)."""
    position = np.linalg.norm(one[..., :3] - other[..., :3], axis=-1)
    a, b = one[..., 3:7], other[..., 3:7]
    # of conj(a) b: the vector part without cancellation, so that small angles keep their digits
    scalar = np.einsum("tni,tni->tn", a, b)
    vector = a[..., :1] * b[..., 1:] - b[..., :1] * a[..., 1:] - np.cross(a[..., 1:], b[..., 1:])
    angle = np.linalg.norm(rotation_vectors(np.concatenate([scalar[..., None], vector], axis=-1)), axis=-1)
    return position, angle


def same_bits(one: Run, other: Run) -> bool:
    """Whether two runs have the same recorded states, bit for bit (NaN counts as itself)."""
    names = ("step", "q", "v", "pose", "velocity")
    return all(
        one.arrays[name].shape == other.arrays[name].shape
        and one.arrays[name].tobytes() == other.arrays[name].tobytes()
        for name in names
    )


def measure_floor(run: Run, repeats: Sequence[Run]) -> Floor | None:
    """The floor of an engine from a run and its repeats (unchanged ones, and ones whose provenance says ``perturb``).

    Rows after the end of a repeat that stopped early are infinite: nothing can be said there. None when there are no
    repeats, or the run has no arrays.
    """
    usable = [other for other in repeats if other.recorded]
    if not usable or not run.recorded:
        return None
    shape = run.arrays["pose"].shape[:2]
    position, angle = np.zeros(shape), np.zeros(shape)
    bitwise: bool | None = None
    perturbation: float | None = None
    for other in usable:
        rows = min(shape[0], len(other.time))
        away, turned = deviations(run.arrays["pose"][:rows], other.arrays["pose"][:rows])
        position[:rows] = np.fmax(position[:rows], away)
        angle[:rows] = np.fmax(angle[:rows], turned)
        position[rows:] = angle[rows:] = np.inf
        if other.provenance.get("perturb"):
            perturbation = other.provenance["perturb"]
        else:
            bitwise = (bitwise is not False) and same_bits(run, other)
    # the largest so far: two trajectories that part and cross again have not become comparable again
    position, angle = np.maximum.accumulate(position), np.maximum.accumulate(angle)
    return Floor(run.engine, run.time, position, angle, bitwise, perturbation)


FLOOR_FILE = "floor.parquet"


LARGEST_FLOOR = 2**30
"""Bytes of a floor's table, packed and unpacked: two numbers for each body and time."""


def save_floor(floor: Floor, folder: Path) -> Path:
    """Write a floor into its run's folder: ``floor.parquet``, time and, as lists over the bodies, position and angle.

    It carries a hash of its content, and that of the run that it is of.
    """
    import pyarrow as pa
    from pyarrow import parquet

    def lists(values: np.ndarray) -> pa.Array:
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])

    facts = {"engine": floor.engine, "bitwise": floor.bitwise, "perturbation": floor.perturbation}
    facts |= {"run": _run_of(folder), "sha256": _digest(floor)}
    table = pa.table({"time": floor.time, "position": lists(floor.position), "angle": lists(floor.angle)})
    sink = pa.BufferOutputStream()
    parquet.write_table(table.replace_schema_metadata({"simspec": json.dumps(facts)}), sink)
    return add_file(folder, RUN, FLOOR_FILE, sink.getvalue().to_pybytes())


def _run_of(folder: Path) -> str:
    """The hash of the run in a folder; "" where there is none."""
    try:
        return read_provenance(folder).sha256
    except FileNotFoundError:
        return ""


def _digest(floor: Floor) -> str:
    digest = hashlib.sha256(json.dumps([floor.engine, floor.bitwise, floor.perturbation]).encode())
    for values in (floor.time, floor.position, floor.angle):
        digest.update(np.ascontiguousarray(values, dtype=np.float64).tobytes())
    return digest.hexdigest()


def load_floor(folder: Path) -> Floor | None:
    """The floor saved with a run; None when none was measured.

    Raises SpecError when it cannot be read, was edited, or is of another run than the one beside it.
    """
    path = folder / FLOOR_FILE
    try:
        descriptor = open_regular(path, LARGEST_FLOOR, folder)
    except FileNotFoundError:
        return None
    try:
        with os.fdopen(descriptor, "rb") as file:
            floor, facts = _read(file, os.fstat(descriptor).st_size, path)
    except (OSError, ValueError, KeyError, TypeError, MemoryError) as error:  # pyarrow's errors are ValueErrors
        raise SpecError([Problem(f"{path} cannot be read: {str(error)[:300]}")]) from None
    if facts.sha256 != _digest(floor):
        raise SpecError([Problem(f"{path}: was edited, or is damaged: its content is not that of its hash")])
    if facts.run != _run_of(folder):
        raise SpecError([Problem(f"{path}: is of another run than the one beside it")])
    return floor


def _read(file: Any, size: int, path: Path) -> tuple[Floor, FloorFacts]:
    import pyarrow as pa

    number, listed = pa.float64(), pa.types.is_fixed_size_list
    source = tables.open_parquet(file, size)
    schema, rows = source.schema_arrow, source.metadata.num_rows
    kinds = {name: schema.field(name).type for name in ("time", "position", "angle")}
    width = kinds["position"].list_size if listed(kinds["position"]) else 0
    wanted = pa.schema([("time", number), *((name, pa.list_(number, width)) for name in ("position", "angle"))])
    if not listed(kinds["position"]) or rows * (1 + 2 * width) * 8 > LARGEST_FLOOR:
        raise ValueError("it is no floor, or one of more than 1 GB")
    facts = read_as(FloorFacts, (schema.metadata or {})[b"simspec"], str(path))
    table = tables.read_checked(source, wanted, rows)
    position, angle = (tables.lists(table, name).reshape(rows, width) for name in ("position", "angle"))
    found = Floor(facts.engine, table["time"].to_numpy(), position, angle, facts.bitwise, facts.perturbation)
    return found, facts
