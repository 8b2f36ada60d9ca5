"""Cross products are to the last bit those of numpy."""

from __future__ import annotations

import numpy as np
import pytest

from simspec.engines.kit.vectors import FEW_VECTORS, cross


@pytest.mark.parametrize("count", [0, 1, 7, FEW_VECTORS, FEW_VECTORS + 1])
def test_cross_products(count):
    one, other = np.random.default_rng(count).normal(size=(2, count, 3))
    other[::3] *= 1e200
    assert cross(one, other).tobytes() == np.cross(one, other).tobytes()
    assert cross(one[:1], other).tobytes() == np.cross(one[:1], other).tobytes()
