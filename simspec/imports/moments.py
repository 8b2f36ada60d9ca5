"""Tensors of inertia that no body has: the rule of repair that all languages share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

Six = tuple[float, float, float, float, float, float]
"""A symmetric tensor: xx, yy, zz, xy, xz, yz."""

RULE: Final = "triangle-inequality"
NOT_POSITIVE: Final = "not-positive"
"""The rule of repair of moments that are not above 0."""
MEANING: Final = "a tensor that no body has becomes the nearest one that a body can have"


def nearest(tensor: Sequence[float]) -> Six:
    """The tensor nearest to a positive one (by the sum of squares) that obeys the triangle inequality. It has the same
    principal axes: what the largest moment is too large by is shared by all three."""
    import numpy as np

    xx, yy, zz, xy, xz, yz = tensor
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    excess = max(0.0, (moments[2] - moments[0] - moments[1]) / 3.0)
    moved = moments + excess * np.array([1.0, 1.0, -1.0])
    full = (axes * moved) @ axes.T
    return tuple(float(full[index]) for index in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))  # type: ignore[return-value]


def shown(moments: Sequence[float]) -> str:
    """Moments in a message."""
    return ", ".join(f"{value:.6g}" for value in moments)


def became(before: Sequence[float], after: Sequence[float]) -> str:
    """What the rule did, by the principal moments."""
    return f"the principal moments {shown(before)} kg m² became {shown(after)} kg m²"
