"""Rotations as PyBullet has them (x y z w), and those of many bodies at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from simspec.engines.kit.vectors import cross
from simspec.world import frames
from simspec.world.types import Quaternion


def to_xyzw(q: Sequence[float]) -> list[float]:
    return [q[1], q[2], q[3], q[0]]


def from_xyzw(q: Sequence[float]) -> Quaternion:
    return frames.normalise((q[3], q[0], q[1], q[2]))


def conjugate(q: np.ndarray) -> np.ndarray:
    """The inverse rotations of unit quaternions (n, 4)."""
    inverted: np.ndarray = q * np.array([1.0, -1.0, -1.0, -1.0])
    return inverted


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The rotations ``a`` after ``b``, quaternions (n, 4) with w ≥ 0."""
    w, u, x, v = a[:, :1], a[:, 1:], b[:, :1], b[:, 1:]
    found = np.concatenate([w * x - np.sum(u * v, axis=1, keepdims=True), w * v + x * u + cross(u, v)], axis=1)
    return np.where(found[:, :1] < 0.0, -found, found)


def rotate(q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) turned by unit quaternions (n, 4)."""
    first = cross(q[:, 1:], vectors)
    turned: np.ndarray = vectors + 2.0 * (q[:, :1] * first + cross(q[:, 1:], first))
    return turned
