"""Sequences of numbers and names as the tuples of fixed length that the world's types hold."""

from __future__ import annotations

from collections.abc import Iterable

from simspec.world.types import Quaternion, Vector3


def vector3(values: Iterable[float]) -> Vector3:
    """Three numbers. Raises ValueError for another count."""
    x, y, z = values
    return (x, y, z)


def quaternion(values: Iterable[float]) -> Quaternion:
    """Four numbers w x y z, as they are. Raises ValueError for another count."""
    w, x, y, z = values
    return (w, x, y, z)


def vector6(values: Iterable[float]) -> tuple[float, float, float, float, float, float]:
    """Six numbers: an inertia, or the velocity of a body. Raises ValueError for another count."""
    a, b, c, d, e, f = values
    return (a, b, c, d, e, f)


def sorted_pair(first: str, second: str) -> tuple[str, str]:
    """Two names, the smaller one first."""
    return (first, second) if first <= second else (second, first)
