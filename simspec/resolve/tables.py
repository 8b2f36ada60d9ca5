"""Trajectories in files: CSV with a header, or NPZ with arrays. Both in SI units, both bounded, neither trusted."""

from __future__ import annotations

import csv
import io
import math
import tokenize
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from simspec import numerals
from simspec.errors import SpecError
from simspec.files import read_bytes
from simspec.language.actions import MOST_NUMBERS, MOST_POINTS
from simspec.language.document import LARGEST_FILE, read_text
from simspec.language.quantities import LARGEST

LARGEST_NPZ = 64_000_000
"""Bytes of the file, and of all its arrays together once unpacked: eight for each of the most numbers, in four arrays, and
some more."""
LONGEST_NAME = 200
"""Characters of a joint's or an array's name."""
MOST_ARRAYS = 20
"""Arrays of a file; six mean something."""
SUFFIXES = {"": "positions", "velocity": "velocities", "acceleration": "accelerations", "effort": "efforts"}
"""The suffixes after the colon in a CSV's header, and their quantities."""
QUANTITIES = tuple(SUFFIXES.values())
_UNREADABLE = (
    *(OSError, ValueError, EOFError, KeyError, TypeError, SyntaxError, OverflowError),
    *(RuntimeError, zipfile.BadZipFile, zlib.error, tokenize.TokenError),
)
"""Errors of zipfile and numpy for archives that are damaged, encrypted, or have headers that are not Python."""


@dataclass
class TrajectoryTable:
    """The content of a file: times (n,), joints, and arrays (n, joints) by quantity; ``wrong``: why it cannot be used, where
    the file shows it (message, found, allowed)."""

    times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    joints: tuple[str, ...] = ()
    values: dict[str, np.ndarray] = field(default_factory=dict)
    wrong: list[tuple[str, str | None, str | None]] = field(default_factory=list)

    def refuse(self, message: str, found: str | None = None, allowed: str | None = None) -> TrajectoryTable:
        """Note why it cannot be used."""
        self.wrong.append((message, found, allowed))
        return self


def read_table(path: Path) -> TrajectoryTable:
    """Read a table by its name's ending."""
    readers = {".csv": _read_csv, ".npz": _read_npz}
    if path.suffix not in readers:
        return TrajectoryTable().refuse("not a readable table", path.name, "a file that ends in .csv or .npz")
    try:
        return readers[path.suffix](path)
    except OSError as error:
        return TrajectoryTable().refuse(f"cannot be read: {error.strerror}", path.name)


def _read_csv(path: Path) -> TrajectoryTable:
    table = TrajectoryTable()
    if path.stat().st_size > LARGEST_FILE:
        found, allowed = f"{path.stat().st_size / 1e6:.1f} MB", f"{LARGEST_FILE / 1e6:g} MB"
        return table.refuse("too large a table", found, allowed)
    try:
        text = read_text(path, path.name)
    except SpecError as error:
        for problem in error.problems:
            where = f" in line {problem.location.line}" if problem.location else ""
            table.refuse(f"{problem.message}{where}", problem.found, problem.allowed)
        return table
    lines = csv.reader(text.splitlines())
    try:
        header = [name.strip() for name in next(lines, [])]
    except csv.Error as error:
        return table.refuse(f"not CSV: {error}")
    if not header or header[0] != "time":
        found = ",".join(header)[:80] or "an empty file"
        return table.refuse("a table begins with its header", found, "time,JOINT,...,JOINT:velocity,...")
    columns = _columns(header[1:], table)
    if table.wrong:
        return table
    rows: list[list[float]] = []
    try:
        for fields in lines:
            if not fields:
                continue
            if len(fields) != len(header):
                found = f"{len(fields)} values in line {lines.line_num}"
                return table.refuse("every line has a value for every column", found, str(len(header)))
            row = [_number(value) for value in fields]
            if None in row:
                at = row.index(None)
                found = f"{fields[at].strip()[:40]!r} in line {lines.line_num}, column {header[at]}"
                return table.refuse("a value is not a usable number", found, "SI numbers without units")
            rows.append([value for value in row if value is not None])
            if len(rows) > MOST_POINTS or len(rows) * len(header) > MOST_NUMBERS:
                return table.refuse("too long a table", None, f"{MOST_POINTS} rows and {MOST_NUMBERS} numbers")
    except csv.Error as error:
        return table.refuse(f"not CSV: {error} in line {lines.line_num}")
    if not rows:
        return table.refuse("a table without rows")
    values = np.array(rows)
    table.times = values[:, 0]
    table.joints = tuple(columns["positions"])
    for quantity, places in columns.items():
        table.values[quantity] = values[:, [1 + places[name] for name in table.joints]]
    return table


def _columns(header: list[str], table: TrajectoryTable) -> dict[str, dict[str, int]]:
    """Where each joint's column of each quantity stands behind the time."""
    columns: dict[str, dict[str, int]] = {}
    for place, name in enumerate(header):
        joint, colon, suffix = name.rpartition(":")
        if not colon:
            joint, suffix = name, ""
        quantity = SUFFIXES.get(suffix)
        if quantity is None or not joint:
            table.refuse("unknown column", name[:80], "JOINT, JOINT:velocity, JOINT:acceleration, JOINT:effort")
        elif joint in columns.setdefault(quantity, {}):
            table.refuse("duplicate column", name[:80])
        else:
            columns[quantity][joint] = place
    joints = columns.get("positions", {})
    if not joints and not table.wrong:
        table.refuse("no joint has a position", ",".join(header)[:80] or "time alone", "time,JOINT,...")
    for quantity, places in columns.items():
        if unmatched := sorted(joints.keys() ^ places.keys()):
            suffix = next(ending for ending, name in SUFFIXES.items() if name == quantity)
            table.refuse(
                f"missing columns: every joint has {quantity}, or none", ", ".join(unmatched[:6]), f"JOINT:{suffix}"
            )
    return columns


def _number(text: str) -> float | None:
    """A number that may be used, None for anything else."""
    try:
        value = numerals.number(text)
    except numerals.NumeralError:
        return None
    return value if abs(value) <= LARGEST else None


def _npz_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an NPZ, whose headers are looked at before anything is unpacked. Raises ValueError with the reason."""
    content = read_bytes(path, LARGEST_NPZ, links=True)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        entries = archive.infolist()
        if len(entries) > MOST_ARRAYS:
            raise ValueError(f"{len(entries)} arrays, more than {MOST_ARRAYS}")
        total = 0
        for entry in entries:
            with archive.open(entry) as stream:
                version = np.lib.format.read_magic(stream)
                headers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
                if version not in headers:
                    raise ValueError(f"{entry.filename}: a format of version {version}")
                shape, _, dtype = headers[version](stream)
            if dtype.hasobject:
                raise ValueError(f"{entry.filename[:LONGEST_NAME]} holds Python objects")
            if max(len(entry.filename), dtype.itemsize // 4) > LONGEST_NAME:
                raise ValueError(f"{entry.filename[:40]}: names of more than {LONGEST_NAME} characters")
            total += max(entry.file_size, math.prod(shape) * dtype.itemsize)
            if total > LARGEST_NPZ:
                raise ValueError(f"more than {LARGEST_NPZ / 1e6:g} MB unpacked")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _read_npz(path: Path) -> TrajectoryTable:
    table = TrajectoryTable()
    try:
        arrays = _npz_arrays(path)
    except _UNREADABLE as error:
        why = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        return table.refuse(f"this NPZ cannot be read: {why}", None, "arrays of numbers, no objects")
    unknown = sorted(arrays.keys() - {"time", "joints", *QUANTITIES})
    if unknown:
        table.refuse("unknown arrays", ", ".join(unknown[:6]), f"time, joints, {', '.join(QUANTITIES)}")
    for name in ("time", "joints", "positions"):
        if name not in arrays:
            table.refuse(f"the array {name!r} is missing", None, "time (n,), joints (J,), positions (n, J)")
    if table.wrong:
        return table
    joints = arrays.pop("joints")
    if joints.ndim != 1 or joints.dtype.kind != "U" or not len(joints):
        return table.refuse("joints must be a list of names", f"{joints.dtype} of shape {joints.shape}", "texts (J,)")
    time = arrays.pop("time")
    shape = (len(time) if time.ndim else 0, len(joints))
    for name, values, wanted in (
        ("time", time, shape[:1]),
        *((name, values, shape) for name, values in arrays.items()),
    ):
        if values.dtype.kind not in "fiu" or values.shape != wanted or not len(values):
            found = f"{values.dtype} of shape {values.shape}"
            table.refuse(f"{name} has the wrong shape or kind", found, f"numbers of shape {wanted}")
        elif not (usable := np.abs(values.astype(float)) <= LARGEST).all():
            place = np.argwhere(~usable)[0]
            found = f"{values[tuple(place)]!s} in {name}, row {place[0] + 1}"
            table.refuse("a value is not a usable number", found, f"finite, of magnitude up to {LARGEST:g}")
    if shape[0] > MOST_POINTS or shape[0] * shape[1] > MOST_NUMBERS:
        table.refuse("too long a table", f"{shape[0]} rows", f"{MOST_POINTS} rows and {MOST_NUMBERS} numbers")
    names = tuple(map(str, joints))
    if len(set(names)) != len(names):
        table.refuse("duplicate joint", ", ".join(sorted({name for name in names if names.count(name) > 1})[:6]))
    if not table.wrong:
        table.times, table.joints = time.astype(float), names
        table.values = {name: values.astype(float) for name, values in arrays.items()}
    return table
