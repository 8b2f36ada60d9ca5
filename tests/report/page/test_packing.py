"""Packed numbers come back as the page's program reads them."""

from __future__ import annotations

import base64
import gzip

import numpy as np
import pytest

from simspec.report.page.packing import PackedNumbers, coded, decoded, resolution, turns
from simspec.world.rotations import unit


def unpacked(content: str) -> bytes:
    return gzip.decompress(base64.b64decode(content))


def joined(content: bytes) -> np.ndarray:
    """Codes as ``page/src/packing.ts`` puts them together."""
    planes = np.frombuffer(content, np.uint8).reshape(2, -1).astype(np.uint16)
    return (planes[0] | planes[1] << 8).astype(np.uint16).view(np.int16)


def test_trajectories_come_back_code_for_code():
    # jumps from end to end: differences leave the range of 16 bits
    codes = np.array([[0, 1, 2, 2], [32767, -32767, 32767, 0], [-5, 300, -300, 32000]], dtype=np.int16)
    packed = PackedNumbers()
    name = packed.series(codes)
    differences = joined(unpacked(packed.entries[name])).reshape(codes.shape)
    with np.errstate(over="ignore"):
        assert np.array_equal(np.cumsum(differences, axis=1, dtype=np.int16), codes)


def test_the_same_numbers_give_the_same_text():
    entries = []
    for _ in range(2):
        packed = PackedNumbers()
        packed.floats(np.array([1.0, np.nan, np.inf]))
        entries.append(packed.entries)
    assert entries[0] == entries[1]
    assert np.array_equal(
        np.frombuffer(unpacked(entries[0]["d0"]), "<f4"), np.array([1, np.nan, np.inf], "<f4"), equal_nan=True
    )


@pytest.mark.parametrize("size", [1e-3, 1.0, 300.0])
def test_positions_are_within_half_a_step(size):
    values = np.random.default_rng(1).uniform(-size, size, (50, 4, 3))
    low, high = values.min(axis=(0, 1)), values.max(axis=(0, 1))
    off = np.abs(decoded(coded(values, low, high), low, high) - values)
    assert off.max() <= 0.5001 * resolution(low, high)
    assert off.max() > 0.3 * resolution(low, high)


def test_values_beyond_the_box_are_clamped_to_its_edge():
    low, high = np.zeros(3), np.full(3, 1.0)
    assert coded(np.array([[-9.0, 0.5, 7.0]]), low, high).tolist() == [[-32767, 0, 32767]]


def test_turns_do_not_jump_to_the_other_sign():
    angle = np.linspace(0.0, 4 * np.pi, 200)
    quaternions = unit(np.stack([np.cos(angle / 2), 0 * angle, np.sin(angle / 2), 0 * angle], axis=-1))[:, None]
    assert np.abs(np.diff(quaternions, axis=0)).max() > 1.0  # as they are stored, with w ≥ 0, they do jump
    assert np.abs(np.diff(turns(quaternions).astype(float), axis=0)).max() < 0.1 * 32767
