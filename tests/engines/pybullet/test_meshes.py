"""Which hulls PyBullet's own code takes for the same."""

from __future__ import annotations

import numpy as np

from simspec.engines.pybullet.meshes import KEPT, alike


def test_hulls_are_alike_as_far_as_whole_numbers_tell_them_apart():
    flat = np.random.default_rng(1).normal(size=(200, 3))
    points = flat / np.linalg.norm(flat, axis=1, keepdims=True) * [0.06, 0.055, 0.04]
    step = KEPT * np.ptp(points, axis=0).max()
    assert alike(points.ravel().tolist(), np.add(points, (0.7 * step, 0.0, 0.0)).ravel().tolist())
    assert not alike(points.ravel().tolist(), np.add(points, (1.5 * step, 0.0, 0.0)).ravel().tolist())
    assert not alike([], points.ravel().tolist())
