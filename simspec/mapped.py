"""Arrays that are larger than memory should be: mapped from a file, and looked at block by block."""

from __future__ import annotations

import mmap
from collections.abc import Iterator

import numpy as np

RECORDED_BYTES = 16 * 2**30
"""Most bytes that a run may record: 10 million rows of seven free bodies. More would fill a disk before it is noticed."""
BLOCK_BYTES = 8_000_000
"""Of one block of rows."""


def blocks(rows: int, row_bytes: int) -> Iterator[slice]:
    """Slices of ``rows`` rows that are together all of them, each of about ``BLOCK_BYTES``; one, empty, of no rows."""
    count = max(1, BLOCK_BYTES // max(1, row_bytes))
    for first in range(0, max(rows, 1), count):
        yield slice(first, min(first + count, rows))


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
    for part in blocks(len(array), array[:1].nbytes):
        if not np.isfinite(array[part]).all():
            return False
        release(array)
    return True
