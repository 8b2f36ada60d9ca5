"""Arrays that are larger than memory should be: mapped from a file, and looked at block by block."""

from __future__ import annotations

import math
import mmap
import os
import tempfile
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from simspec.files import scratch_folder

RECORDED_BYTES = 16 * 2**30
"""Most bytes that a run may record: 10 million rows of seven free bodies. More would fill a disk before it is noticed."""
BLOCK_BYTES = 8_000_000
"""Of one block of rows."""
MAPPED_BYTES = 4_000_000
"""Arrays larger than this stay on disk, mapped. A study of three engines with repeats holds some hundred arrays."""


def block_rows(row_bytes: int) -> int:
    """Rows of one block."""
    return max(1, BLOCK_BYTES // max(1, row_bytes))


def blocks(rows: int, row_bytes: int, first: int = 0) -> Iterator[slice]:
    """Slices of the rows from ``first`` on that are together all ``rows`` rows, each of about ``BLOCK_BYTES``; one, empty, of
    no rows."""
    count = block_rows(row_bytes)
    for start in range(first, max(rows, first + 1), count):
        yield slice(start, max(start, min(start + count, rows)))


def parts(rows: int, row_bytes: int, *arrays: np.ndarray, first: int = 0) -> Iterator[slice]:
    """The same; after each, the memory is given back that looking at ``arrays`` took."""
    for part in blocks(rows, row_bytes, first):
        try:
            yield part
        finally:
            for array in arrays:
                release(array)


def release(array: np.ndarray) -> None:
    """Give the memory back that looking at a mapped array took (it is read again when it is looked at again); nothing
    for other arrays."""
    base: object = array
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        base.madvise(mmap.MADV_DONTNEED)


def all_finite(array: np.ndarray) -> bool:
    """Whether every number is finite, whatever the array's size."""
    return all(np.isfinite(array[part]).all() for part in parts(len(array), array[:1].nbytes, array))


def zeros(shape: tuple[int, ...], kind: type = float) -> np.ndarray:
    """A new array of zeros. A large one is in a temporary file that has no name: its room on disk is given back with the
    array, or when the process ends. Raises OSError where there is no room."""
    size = np.dtype(kind).itemsize * math.prod(shape)
    if size <= MAPPED_BYTES:
        return np.zeros(shape, kind)
    with scratch_folder("array") as folder, open(folder / "rows.bin", "xb+") as file:
        try:
            _reserve(file, size)
        except OSError as error:
            raise OSError(error.errno or 0, error.strerror or str(error), tempfile.gettempdir()) from error
        return np.memmap(file, kind, "r+", shape=shape).view(np.ndarray)


def _reserve(file: BinaryIO, size: int) -> None:
    """Give a new file its size, with room on disk: where that is missing, writing to a mapped file ends the process."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)
        return
    empty = bytes(min(size, BLOCK_BYTES))
    for part in blocks(size, 1):
        file.write(empty[: part.stop - part.start])
    file.flush()
