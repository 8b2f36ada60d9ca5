"""How far an engine repeats itself: the floor below which two engines are indistinguishable.

An engine is run again unchanged, and once more with its initial state moved in the last bits (1e-15, of doubles). The
difference of these runs is unrelated to physics or models: in a chaotic scenario it grows without bound, and a difference of
that size between two engines has no meaning.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

import numpy as np

from simspec.engines.kit.capabilities import DOUBLE
from simspec.engines.kit.registry import find_engine
from simspec.errors import Problem, SpecError
from simspec.files import parts, release, zeros
from simspec.outputs.files import open_regular
from simspec.outputs.targets import RUN
from simspec.outputs.writing import add_file
from simspec.runner import tables
from simspec.runner.run import Run
from simspec.runner.store import read_provenance
from simspec.stored import FloorFacts, read_as
from simspec.world.rotations import logarithm, relative

if TYPE_CHECKING:
    import pyarrow as pa


PERTURBATION = 1e-15
"""Relative change of the initial state: 4.5 times the spacing of doubles at 1, the smallest that reaches every number."""
OF_SINGLES = 5e-7
"""The same of numbers in single precision."""

FLOOR_FACTOR = 3.0
"""Differences up to this many times the floor are indistinguishable from round-off. A floor comes from one perturbed run,
in one direction, once, whereas two engines round differently at every step: their difference is of the floor's size, not
below it. Where a floor grows, it grows exponentially, and a factor of 3 moves the horizon by a fraction of one e-folding."""


def perturbation_of(engine: str) -> float:
    """By how much initial states of an engine (name or label) are moved, by the numbers that it computes with."""
    return PERTURBATION if find_engine(engine).PRECISION == DOUBLE else OF_SINGLES


@dataclass(frozen=True)
class Floor:
    """An engine's own noise: for every recorded time and body the largest position (m) and angle (rad) deviation so far
    of the repeats from the run, (rows, bodies).

    ``bitwise``: whether the unchanged repeat gave the same bits everywhere; None when there was none. ``cached``: whether
    it was measured for an earlier run with the same bits.
    """

    engine: str
    time: np.ndarray = field(repr=False)
    position: np.ndarray = field(repr=False)
    angle: np.ndarray = field(repr=False)
    bitwise: bool | None
    perturbation: float | None
    cached: bool = False

    @property
    def largest(self) -> float:
        """The largest position deviation (m) over all bodies and times: that at the end, as it never falls."""
        return float(self.position[-1].max()) if self.position.size else 0.0


DEVIATION_BYTES = 512
"""Of temporary arrays for each body and row, in :func:`deviations`."""


def deviations(values: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (m) and angles (rad) (rows, bodies) between two arrays of poses (rows, bodies, 7)."""
    position = np.linalg.norm(values[..., :3] - other[..., :3], axis=-1)
    angle = np.linalg.norm(logarithm(relative(values[..., 3:7], other[..., 3:7])), axis=-1)
    return position, angle


STATES = ("step", "q", "v", "pose", "velocity")
"""Arrays that two runs must share bit for bit to be the same."""


def same_bits(entry: Run, other: Run) -> bool:
    """Whether two runs have the same recorded states, bit for bit (NaN counts as itself)."""
    pairs = [(entry.arrays[name], other.arrays[name]) for name in STATES]
    return all(a.shape == b.shape for a, b in pairs) and all(
        a[part].tobytes() == b[part].tobytes() for a, b in pairs for part in parts(len(a), 2 * a[:1].nbytes, a, b)
    )


def measure_floor(run: Run, repeats: Sequence[Run]) -> Floor | None:
    """The floor of an engine from a run and its repeats (unchanged ones, and ones whose provenance says ``perturb``).

    Rows after the end of a repeat that stopped early are infinite: nothing can be said there. None when there are no
    repeats, or the run has no arrays.
    """
    usable = [other for other in repeats if other.recorded]
    if not usable or not run.recorded:
        return None
    bitwise: bool | None = None
    perturbation: float | None = None
    for other in usable:
        if other.provenance.get("perturb"):
            perturbation = other.provenance["perturb"]
        else:
            bitwise = (bitwise is not False) and same_bits(run, other)
    position, angle = _departures(run.arrays["pose"], [other.arrays["pose"] for other in usable])
    return Floor(run.engine, run.time, position, angle, bitwise, perturbation)


def _departures(poses: np.ndarray, repeats: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The largest deviations so far of some repeats, in position and angle (rows, bodies); infinite where one has ended."""
    rows, bodies = poses.shape[:2]
    largest_so_far = zeros((rows, bodies)), zeros((rows, bodies))
    largest = [np.zeros(bodies), np.zeros(bodies)]
    for part in parts(rows, DEVIATION_BYTES * bodies, poses, *repeats, *largest_so_far):
        for other in repeats:
            both = slice(part.start, max(part.start, min(part.stop, len(other))))
            for array, values in zip(largest_so_far, deviations(poses[both], other[both]), strict=True):
                array[both] = np.fmax(array[both], values)
                array[both.stop : part.stop] = np.inf
        # the largest so far: two trajectories that part and cross again have not become comparable again
        for k, array in enumerate(largest_so_far):
            if part.stop > part.start:
                array[part] = np.maximum.accumulate(np.maximum(array[part], largest[k]))
                largest[k] = np.array(array[part.stop - 1])
    return largest_so_far


FLOOR_FILE = "floor.parquet"


LARGEST_FLOOR = 4 * 2**30
"""Bytes of a floor's table, packed and unpacked: two numbers for each body and time of the longest recording."""


def save_floor(floor: Floor, folder: Path) -> Path:
    """Write a floor into its run's folder: ``floor.parquet``, time and, as lists over the bodies, position and angle.

    It carries a hash of its content, and that of the run that it is of.
    """
    import pyarrow as pa
    from pyarrow import parquet

    def stored(values: np.ndarray) -> pa.Array:
        flat = tables.numbers_array(values.ravel(), pa.float64())
        return flat if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, values.shape[1])

    facts = {"engine": floor.engine, "bitwise": floor.bitwise, "perturbation": floor.perturbation}
    facts |= {"run": _run_of(folder), "sha256": _digest(floor)}
    columns = {"time": floor.time, "position": floor.position, "angle": floor.angle}
    rows, bodies = floor.position.shape
    schema = _schema(bodies).with_metadata({"simspec": json.dumps(facts)})

    def write(file: BinaryIO) -> None:
        with parquet.ParquetWriter(file, schema) as writer:
            for part in parts(rows, _row_bytes(bodies), *columns.values()):
                block = [stored(values[part]) for values in columns.values()]
                writer.write_table(pa.Table.from_arrays(block, schema=schema))

    return add_file(folder, RUN, FLOOR_FILE, write)


def _schema(bodies: int) -> pa.Schema:
    import pyarrow as pa

    listed = pa.list_(pa.float64(), bodies)
    return pa.schema([("time", pa.float64()), ("position", listed), ("angle", listed)])


def _row_bytes(bodies: int) -> int:
    return 8 * (1 + 2 * bodies)


def _run_of(folder: Path) -> str:
    """The hash of the run in a folder; "" where there is none."""
    try:
        return read_provenance(folder).sha256
    except FileNotFoundError:
        return ""


def _digest(floor: Floor) -> str:
    digest = hashlib.sha256(json.dumps([floor.engine, floor.bitwise, floor.perturbation]).encode())
    for values in (floor.time, floor.position, floor.angle):
        for part in parts(len(values), values[:1].nbytes, values):
            digest.update(np.ascontiguousarray(values[part], dtype=np.float64).data)
    return digest.hexdigest()


def load_floor(folder: Path) -> Floor | None:
    """The floor saved with a run; None when none was measured.

    Raises SpecError when it cannot be read, was edited, or belongs to another run than the one next to it.
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
        raise SpecError([Problem(f"{path} cannot be read: {str(error)[:300]}", code="R101")]) from None
    if facts.sha256 != _digest(floor):
        raise SpecError(
            [Problem(f"{path}: was edited or is damaged: its content does not match its hash", code="R102")]
        )
    if facts.run != _run_of(folder):
        raise SpecError([Problem(f"{path}: belongs to another run than the one next to it", code="R101")])
    return floor


def _read(file: Any, size: int, path: Path) -> tuple[Floor, FloorFacts]:
    import pyarrow as pa

    source = tables.open_parquet(file, size)
    schema, rows = source.schema_arrow, source.metadata.num_rows
    kinds = {name: schema.field(name).type for name in ("time", "position", "angle")}
    listed = pa.types.is_fixed_size_list(kinds["position"])
    width = kinds["position"].list_size if listed else 0
    if not listed or rows * _row_bytes(width) > LARGEST_FLOOR:
        raise ValueError(f"not a noise floor, or larger than {LARGEST_FLOOR / 1e9:.3g} GB")
    facts = read_as(FloorFacts, (schema.metadata or {})[b"simspec"], str(path))
    time, position, angle = zeros((rows,)), zeros((rows, width)), zeros((rows, width))
    for part, table in tables.read_blocks(source, _schema(width), rows):
        time[part] = table["time"].to_numpy()
        for name, array in (("position", position), ("angle", angle)):
            array[part] = tables.lists(table, name).reshape(len(table), width)
        for array in (time, position, angle):
            release(array)
    return Floor(facts.engine, time, position, angle, facts.bitwise, facts.perturbation), facts


# Horizon: the time up to which two runs can be compared. Noise that grows is chaos: past that time two runs of the
# *same* engine differ without bound. Noise that stays at a level ends nothing: differences above that level count.

DECADE = 10.0
"""Noise that grows by less than this until the end of the run has stopped growing, if it had the time to (see PATIENCE)."""
PATIENCE = 2.0
"""How long noise must stay within a decade, in units of the time that it took for the decade before: exponential growth takes
as long for each. Linear and quadratic drift pass (9 and 3 times as long), and so does one jump."""
FEWEST_ROWS = 5
"""Records that must show it: fewer show nothing."""
SATURATED = 0.02
"""Share of the scene's size (and of half a turn) from which noise that has stopped growing is chaos that has run its course,
not a level above which a difference has a meaning. Noise of contact (an impact one step earlier or later) is some v dt: 1e-3 of
it."""


class Noise(Protocol):
    """The noise of two runs at their common times, evaluated where it is requested: there may be very many rows."""

    rows: int
    bodies: int

    def time(self, rows: np.ndarray) -> np.ndarray:
        """Times (n,) of some rows, s."""

    def noise(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each body at a row of its own, in position (bodies,), m, and angle, rad: never falling with the row; infinite
        where nothing was measured."""

    def size(self) -> float:
        """Of the scene, m."""


def first_row(holds: Callable[[np.ndarray], np.ndarray], rows: int, bodies: int) -> np.ndarray:
    """For each body the first row (bodies,) at which something holds that holds at all later rows too; ``rows`` where it
    never does. ``holds`` is called with a separate row for each body."""
    low, high = np.zeros(bodies, dtype=np.int64), np.full(bodies, rows)
    while (searching := low < high).any():
        middle = (low + high) // 2
        holding = holds(np.minimum(middle, rows - 1))
        high = np.where(searching & holding, middle, high)
        low = np.where(searching & ~holding, middle + 1, low)
    return low


def horizon(of: Noise, factor: float, tolerance: float, angle_tolerance: float) -> int:
    """The row from which no position says anything, because ``factor`` times the noise of some body has grown past the
    tolerance (m; and rad); the number of rows when there is none."""
    bodies = of.bodies

    def noise(rows: np.ndarray) -> np.ndarray:
        return factor * np.stack(of.noise(rows))

    def unmeasured(rows: np.ndarray) -> np.ndarray:
        result: np.ndarray = ~np.isfinite(noise(rows)).all(axis=0)
        return result

    rows = int(first_row(unmeasured, of.rows, bodies).min())
    if not rows:
        return 0

    def ratio(at: np.ndarray) -> np.ndarray:
        """Noise over the tolerance, of each body at a row of its own."""
        position, angle = noise(at)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.fmax(position / tolerance, angle / angle_tolerance)
        # a tolerance of 0 is below any noise, and no noise is within it
        result: np.ndarray = np.nan_to_num(share, posinf=np.finfo(float).max)
        return result

    def first_above(limit: np.ndarray | float) -> np.ndarray:
        return first_row(lambda at: ratio(at) > limit, rows, bodies)

    last = np.full(bodies, rows - 1)
    ends = ratio(last)
    outgrown = ends > 1.0
    if not outgrown.any():
        return rows
    position, angle = noise(last)
    saturated = (position > SATURATED * of.size()) | (angle > SATURATED * np.pi)
    # the first row from which the noise stays within a decade, and the time that the decade before took
    settled = np.minimum(first_above(ends / DECADE), rows - 1)
    before = np.minimum(first_above(ratio(settled) / DECADE), rows - 1)
    stayed, took = of.time(last) - of.time(settled), of.time(settled) - of.time(before)
    at_level = ~saturated & (rows - settled >= FEWEST_ROWS) & (stayed >= PATIENCE * took)
    return int(np.where(at_level, rows, first_above(1.0))[outgrown].min())
