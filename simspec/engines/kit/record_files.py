"""The files of a recording, written while it grows: memory does not grow with the number of rows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simspec.engines.kit.arrays import CONTACT_FIELDS, CONTACT_UNIT

CHUNK_BYTES = 1_000_000
"""Size of the buffer that rows are collected in before they are written."""
CONTACT_CHUNK = 20_000
"""Contacts that are collected before they are written."""


class _Files:
    """One file for each array, ``<place><prefix><name>.bin``: little-endian numbers, row after row. ``kinds`` and ``shapes``
    are those of a row, by the arrays' names."""

    def __init__(self, place: Path, prefix: str, kinds: Mapping[str, str], shapes: Mapping[str, tuple[int, ...]]):
        self._prefix, self._kinds, self._shapes = prefix, kinds, shapes
        self._files = {name: open(f"{place}{prefix}{name}.bin", "wb") for name in shapes}  # noqa: SIM115 (closed in close())
        self._rows = dict.fromkeys(shapes, 0)

    def write(self, name: str, rows: np.ndarray) -> int:
        """Add rows to an array's file; returns their size in bytes."""
        block = np.ascontiguousarray(rows, dtype=f"<{self._kinds[name]}")
        self._files[name].write(block.data)
        self._rows[name] += len(block)
        return block.nbytes

    def close(self) -> dict[str, dict[str, Any]]:
        """Returns kind and shape of each array, by its name with the prefix."""
        for file in self._files.values():
            file.close()
        return {
            f"{self._prefix}{name}": {"kind": self._kinds[name], "shape": [self._rows[name], *shape]}
            for name, shape in self._shapes.items()
        }


class Columns:
    """Rows of float64 of several channels, side by side in one buffer that is written when it is full: one file for each
    channel. Memory does not grow with the number of rows."""

    def __init__(self, shapes: dict[str, tuple[int, ...]], place: Path):
        sizes = {name: int(np.prod(shape, dtype=int)) for name, shape in shapes.items()}
        width = sum(sizes.values())
        self._rows = max(1, CHUNK_BYTES // max(1, 8 * width))
        self._block = np.empty((self._rows, width))
        self.views: dict[str, np.ndarray] = {}
        """The buffer of each channel (rows, ...)."""
        self.ends: dict[str, int] = {}
        """The column after each channel's last."""
        self._files = _Files(place, "", dict.fromkeys(shapes, "f8"), shapes)
        first = 0
        for name, shape in shapes.items():
            last = first + sizes[name]
            self.views[name] = self._block[:, first:last].reshape(self._rows, *shape)
            self.ends[name] = first = last
        self.at = 0
        """The row to be filled."""

    def row(self) -> np.ndarray:
        """The row that is being filled, all channels."""
        row: np.ndarray = self._block[self.at]
        return row

    def done(self) -> int:
        """The row is filled. Returns the bytes that were written because of it."""
        self.at += 1
        return self.write() if self.at == self._rows else 0

    def write(self) -> int:
        """Write what is collected; returns its size in bytes."""
        size = sum(self._files.write(name, view[: self.at]) for name, view in self.views.items())
        self.at = 0
        return size

    def close(self) -> dict[str, dict[str, Any]]:
        """Write the rest; returns kind and shape of each channel's array."""
        self.write()
        return self._files.close()


class Contacts:
    """Ragged contacts, written as :class:`Columns` are; with the units that touch where the engine tells them."""

    def __init__(self, place: Path):
        self._place = place
        self._files = self._opened({"row": (), **CONTACT_FIELDS})
        self._units: _Files | None = None
        self._told: bool | None = None
        """Whether the engine tells the units, of contacts that there were; None as long as there were none."""
        self._empty_told = False
        self._blocks: dict[str, list[np.ndarray]] = {name: [] for name in ("row", *CONTACT_FIELDS, CONTACT_UNIT)}
        self._collected = 0

    def _opened(self, shapes: Mapping[str, tuple[int, ...]]) -> _Files:
        kinds = {name: "i8" if name in ("row", "body", CONTACT_UNIT) else "f8" for name in shapes}
        return _Files(self._place, "contact.", kinds, shapes)

    def add(self, row: int, found: dict[str, np.ndarray]) -> int:
        """Add the contacts of a row. Returns the bytes that were written because of it. Raises ValueError where units are told
        of some rows only."""
        count, told = len(found["distance"]), CONTACT_UNIT in found
        if not count:
            self._empty_told = told
            return 0
        if self._told is not None and told != self._told:
            raise ValueError("the units of contacts are told of some rows only")
        self._told = told
        if told:
            self._blocks[CONTACT_UNIT].append(np.asarray(found[CONTACT_UNIT]).reshape(count, 2))
        self._blocks["row"].append(np.full(count, row, dtype=np.int64))
        for name, shape in CONTACT_FIELDS.items():
            self._blocks[name].append(np.asarray(found[name]).reshape(count, *shape))
        self._collected += count
        return self.write() if self._collected >= CONTACT_CHUNK else 0

    def write(self) -> int:
        """Write what is collected; returns its size in bytes."""
        size = 0
        for name, blocks in self._blocks.items():
            if blocks:
                size += self._of(name).write(name, np.concatenate(blocks))
                blocks.clear()
        self._collected = 0
        return size

    def _of(self, name: str) -> _Files:
        if name != CONTACT_UNIT:
            return self._files
        if self._units is None:
            self._units = self._opened({CONTACT_UNIT: (2,)})
        return self._units

    def close(self) -> dict[str, dict[str, Any]]:
        """Write the rest; returns kind and shape of each array, that of the units where the engine tells them."""
        self.write()
        arrays = self._files.close()
        if self._told or (self._told is None and self._empty_told):
            arrays |= self._of(CONTACT_UNIT).close()
        return arrays
