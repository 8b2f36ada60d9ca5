"""Rotations in double precision: of many bodies at once as arrays, and of one as plain floats.

Conventions, here and in all of simspec. A quaternion is (w, x, y, z), of unit length unless a function says otherwise, and
active: it turns a vector given in the axes of the turned body into the axes that the body is turned in, so that R v is
``rotate(q, v)`` and ``multiply(a, b)`` is ``a`` after ``b``. q and −q are one rotation. A rotation vector is log R: the unit
axis times the angle (rad). Programs that have x y z w are converted where they are called (:func:`to_xyzw`, :func:`from_xyzw`).

Arrays hold quaternions (..., 4), vectors (..., 3) and matrices (..., 3, 3) in their last axes; leading axes broadcast, and
nothing is normalised unless said. The functions whose names end in ``_of`` do the same for one rotation as plain floats: in the
step of a small world an array costs more than what is computed with it. All digits are kept down to angles of 1e-150, below
which squares leave the range of doubles.

Values in files and hashes are computed in :mod:`simspec.world.frames`, which gives the same bits on every machine; here are
numpy's and the C library's own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from simspec.world.types import Quaternion, Vector3

FEW_VECTORS = 100
"""Up to so many, ``numpy.cross`` spends most of its time (some 20 µs) on its arguments: more than a step of a small world."""
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])
_TO_XYZW, _FROM_XYZW = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2])


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (..., 3) of vectors (..., 3): to the last bit those of ``numpy.cross``, in a tenth of the time for few."""
    if len(a) > FEW_VECTORS:
        return np.cross(a, b)
    product: np.ndarray = a.take(_NEXT, -1) * b.take(_LAST, -1) - a.take(_LAST, -1) * b.take(_NEXT, -1)
    return product


def to_xyzw(q: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) with w last."""
    return q.take(_TO_XYZW, -1)


def from_xyzw(q: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) from those with w last."""
    return q.take(_FROM_XYZW, -1)


def to_xyzw_of(q: Sequence[float]) -> list[float]:
    """One quaternion with w last."""
    return [q[1], q[2], q[3], q[0]]


def from_xyzw_of(q: Sequence[float]) -> Quaternion:
    """One quaternion from one with w last, as it is: neither its length nor its sign changes."""
    return (q[3], q[0], q[1], q[2])


def conjugate(q: np.ndarray) -> np.ndarray:
    """The inverse rotations (..., 4)."""
    inverted: np.ndarray = q * _INVERSE
    return inverted


def positive(q: np.ndarray) -> np.ndarray:
    """The same rotations (..., 4) with w ≥ 0."""
    return np.where(q[..., :1] < 0.0, -q, q)


def unit(q: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) of any length but zero brought to length 1, with w ≥ 0."""
    return positive(q / np.sqrt(np.sum(q * q, axis=-1, keepdims=True)))


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The rotations ``a`` after ``b`` (..., 4)."""
    w, u, x, v = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    return np.concatenate([w * x - np.sum(u * v, axis=-1, keepdims=True), w * v + x * u + cross(u, v)], axis=-1)


def multiply_of(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """The rotation ``a`` after ``b``, brought back to unit length."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    w = aw * bw - ax * bx - ay * by - az * bz
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length)


def relative(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The rotations (..., 4) of ``b`` seen from ``a``, a⁻¹ b: without cancellation, so that small ones keep their digits."""
    return multiply(conjugate(a), b)


def rotation_error(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles (...) in rad between orientations (..., 4), as 2 |sin(angle / 2)|, without loss of digits near zero."""
    error: np.ndarray = 2.0 * np.linalg.norm(relative(a, b)[..., 1:], axis=-1)
    return error


def rotate(q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    across = cross(q[..., 1:], vectors)
    turned: np.ndarray = vectors + 2.0 * (q[..., :1] * across + cross(q[..., 1:], across))
    return turned


def matrices(q: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4); the columns are the turned axes."""
    q = np.asarray(q, dtype=float)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    wx, wy, wz = w * x, w * y, w * z
    found = np.empty((*q.shape[:-1], 3, 3))
    found[..., 0, 0], found[..., 0, 1], found[..., 0, 2] = 1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)
    found[..., 1, 0], found[..., 1, 1], found[..., 1, 2] = 2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)
    found[..., 2, 0], found[..., 2, 1], found[..., 2, 2] = 2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)
    return found


def exponential(vectors: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4), with w ≥ 0, of rotation vectors (..., 3) of any length."""
    angle = np.sqrt(np.sum(vectors * vectors, axis=-1, keepdims=True))
    share = np.where(angle == 0.0, 0.5, np.sin(angle / 2.0) / np.where(angle == 0.0, 1.0, angle))
    return positive(np.concatenate([np.cos(angle / 2.0), share * vectors], axis=-1))


def exponential_of(vector: Sequence[float]) -> Quaternion:
    """The quaternion, with w ≥ 0, of one rotation vector."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return (1.0, 0.5 * x, 0.5 * y, 0.5 * z)
    share, w = math.sin(angle / 2.0) / angle, math.cos(angle / 2.0)
    if w < 0.0:
        w, share = -w, -share
    return (w, x * share, y * share, z * share)


def logarithm(q: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3), of at most π, of quaternions (..., 4); to full precision at small angles."""
    turned = positive(q)
    vector = turned[..., 1:]
    sine = np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True))
    angle = 2.0 * np.arctan2(sine, turned[..., :1])
    # at zero the ratio angle / sin(angle / 2) is 2; the division is done only where there is something to divide
    ratio = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)
    vectors: np.ndarray = turned[..., 1:] * ratio
    return vectors


def logarithm_of(q: Sequence[float]) -> Vector3:
    """The rotation vector, of at most π, of one quaternion."""
    w, x, y, z = q
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * math.atan2(sine, w) / sine if sine > 0.0 else 2.0
    return (x * factor, y * factor, z * factor)
