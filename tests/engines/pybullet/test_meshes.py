"""Which hulls PyBullet's own code takes for the same."""

from __future__ import annotations

import tracemalloc

import numpy as np

from simspec.engines.pybullet import geometry
from simspec.engines.pybullet.geometry import KEPT, Alike, alike


def test_hulls_are_equal_up_to_the_resolution_of_their_integers():
    flat = np.random.default_rng(1).normal(size=(200, 3))
    points = flat / np.linalg.norm(flat, axis=1, keepdims=True) * [0.06, 0.055, 0.04]
    step = KEPT * np.ptp(points, axis=0).max()
    assert alike(points.ravel().tolist(), np.add(points, (0.7 * step, 0.0, 0.0)).ravel().tolist())
    assert not alike(points.ravel().tolist(), np.add(points, (1.5 * step, 0.0, 0.0)).ravel().tolist())
    assert not alike([], points.ravel().tolist())


def test_hulls_of_any_number_of_points_are_compared_in_bounded_memory():
    """All products of two hulls of 12,000 points, both ways, would take 2.3 GB."""
    flat = np.random.default_rng(2).normal(size=(12_000, 3))
    points = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    bent = points.copy()
    bent[77] *= 1.0 + 20.0 * KEPT
    assert (np.abs(np.ptp(bent, axis=0) - np.ptp(points, axis=0)) < KEPT).all(), "no axis shows it"
    tracemalloc.start()
    assert not alike(points.ravel(), bent.ravel())
    assert alike(points[:3000].ravel(), points[:3000].ravel())
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


def test_hulls_of_the_same_file_are_not_compared_and_others_once(monkeypatch):
    looked = []
    monkeypatch.setattr(geometry, "alike", lambda entry, other: looked.append((entry, other)) or entry == other)
    same = Alike()
    actual, shown = same.of_file((1.0, 2.0), ("a.stl", 1.0)), same.of_file((1.5, 2.0), ("a.stl", 1.0))
    scaled, other = same.of_file((1.25, 2.0), ("a.stl", 2.0)), (1.0, 2.0, 0.0)
    assert same(actual, shown)
    assert not looked
    for _ in range(3):
        assert not same(actual, scaled)
        assert not same(actual, other)
    assert len(looked) == 2
