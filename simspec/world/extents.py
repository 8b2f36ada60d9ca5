"""How far shapes reach from their centres."""

from __future__ import annotations

import math
from collections.abc import Sequence


def outer_radius(kind: str, size: Sequence[float]) -> float:
    """The radius (m) of the smallest sphere about the shape's centre that holds it; infinite for a plane."""
    if kind == "plane":
        return math.inf
    if kind == "sphere":
        return size[0]
    if kind == "box":
        return 0.5 * math.hypot(*size)
    if kind == "cylinder":
        return math.hypot(size[0], 0.5 * size[1])
    if kind == "capsule":
        return size[0] + 0.5 * size[1]
    if kind == "ellipsoid":
        return max(size)
    raise ValueError(f"no shape of kind {kind!r}")


def inner_radius(kind: str, size: Sequence[float]) -> float:
    """The radius (m) of the largest sphere about the shape's centre inside it; infinite for a plane."""
    if kind == "plane":
        return math.inf
    if kind == "box":
        return 0.5 * min(size)
    if kind == "cylinder":
        return min(size[0], 0.5 * size[1])
    if kind in ("sphere", "capsule"):
        return size[0]
    if kind == "ellipsoid":
        return min(size)
    raise ValueError(f"no shape of kind {kind!r}")
