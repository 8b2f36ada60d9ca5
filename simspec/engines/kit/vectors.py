"""Arithmetic of few vectors, as a row of a small world's recording has them."""

from __future__ import annotations

import numpy as np

FEW_VECTORS = 100
"""Up to so many, ``numpy.cross`` spends most of its time (some 20 µs) on its arguments: more than a step of a small world."""
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Cross products (n, 3) of vectors (n, 3): to the last bit those of ``numpy.cross``, in a tenth of the time for few."""
    if len(one) > FEW_VECTORS:
        return np.cross(one, other)
    product: np.ndarray = one.take(_NEXT, -1) * other.take(_LAST, -1) - one.take(_LAST, -1) * other.take(_NEXT, -1)
    return product
