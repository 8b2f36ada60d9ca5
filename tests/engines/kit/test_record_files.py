"""Recordings are the same whatever the size of the buffers in which their rows are collected."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simspec.engines.kit import recorder
from simspec.engines.kit.arrays import CONTACT_FIELDS
from simspec.engines.kit.recorder import ColumnBuffer, Contacts


def read(folder, name, described):
    values = np.fromfile(f"{folder}/0.{name}.bin", dtype=f"<{described['kind']}")
    return values.reshape(described["shape"])


@given(rows=st.integers(0, 40), bodies=st.integers(1, 5), chunk=st.integers(1, 2000))
def test_rows_are_stored_once_and_in_order(rows, bodies, chunk):
    shapes = {"pose": (bodies, 7), "time": ()}
    wanted = np.arange(rows * (7 * bodies + 1), dtype=float).reshape(rows, 7 * bodies + 1)
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorder, "CHUNK_BYTES", chunk)
        columns = ColumnBuffer(shapes, Path(f"{folder}/0."))
        for row in wanted:
            columns.row()[:] = row
            columns.done()
        close = columns.close()
        pose, time = (read(folder, name, close[name]) for name in ("pose", "time"))
    assert pose.reshape(rows, 7 * bodies).tolist() == wanted[:, :-1].tolist()
    assert time.tolist() == wanted[:, -1].tolist()


@given(counts=st.lists(st.integers(0, 7), max_size=30), chunk=st.integers(1, 20))
def test_contacts_are_stored_once_and_with_their_rows(counts, chunk):
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorder, "CONTACT_CHUNK", chunk)
        contacts = Contacts(Path(f"{folder}/0."))
        begun = 0
        for row, count in enumerate(counts):
            numbers = np.arange(begun, begun + count)
            begun += count
            found = {
                name: np.broadcast_to(numbers.reshape(count, *(1,) * len(shape)), (count, *shape))
                for name, shape in CONTACT_FIELDS.items()
            }
            contacts.add(row, found)
        close = contacts.close()
        row_of = read(folder, "contact.row", close["contact.row"])
        distance = read(folder, "contact.distance", close["contact.distance"])
    assert row_of.tolist() == [row for row, count in enumerate(counts) for _ in range(count)]
    assert distance.tolist() == list(range(begun))
