"""Arrays on disk: they hold what was written, leave nothing behind, and say when there is no room."""

from __future__ import annotations

import errno
import mmap
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec import files
from simspec import files as mapped


@given(st.integers(0, 50), st.integers(0, 60), st.integers(1, 200), st.integers(1, 500))
def test_blocks_are_all_rows_once(rows, first, row_bytes, block):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapped, "BLOCK_BYTES", block)
        found = list(mapped.blocks(rows, row_bytes, first))
    assert found
    assert [row for part in found for row in range(part.start, part.stop)] == list(range(first, rows))
    assert all(part.stop - part.start <= max(1, block // row_bytes) for part in found)


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A place of its own for temporary files."""
    monkeypatch.setattr(files.tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_large_array_is_on_disk_and_leaves_no_name(room, monkeypatch):
    monkeypatch.setattr(mapped, "MAPPED_BYTES", 1000)
    found = mapped.zeros((100, 3))
    assert type(found) is np.ndarray
    assert isinstance(found.base.base, mmap.mmap)
    assert not found.any()
    assert list(room.iterdir()) == []
    expected = np.random.default_rng(1).random((100, 3))
    for part in mapped.parts(100, 100, found):
        found[part] = expected[part]
    mapped.release(found)
    assert np.array_equal(found, expected)


def test_a_small_array_is_in_memory():
    found = mapped.zeros((10,), int)
    assert found.base is None
    assert (found.dtype, found.tolist()) == (np.dtype(int), [0] * 10)


def test_a_full_disk_is_an_error_and_not_the_end_of_the_process(room, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(mapped.os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space left") as caught:
        mapped.zeros((mapped.MAPPED_BYTES,))
    assert caught.value.filename == str(room)
    assert list(room.iterdir()) == []


def test_room_is_reserved_where_the_system_has_no_call_for_it(room, monkeypatch):
    monkeypatch.delattr(mapped.os, "posix_fallocate")
    monkeypatch.setattr(mapped, "MAPPED_BYTES", 100)
    monkeypatch.setattr(mapped, "BLOCK_BYTES", 300)
    assert mapped.zeros((1000,)).tolist() == [0.0] * 1000


def test_memory_is_given_back_also_when_a_pass_ends_early(monkeypatch):
    released = []
    monkeypatch.setattr(mapped, "release", released.append)
    passing = mapped.parts(1000, mapped.BLOCK_BYTES // 10, "array")
    next(passing)
    next(passing)
    passing.close()
    assert released == ["array", "array"]
