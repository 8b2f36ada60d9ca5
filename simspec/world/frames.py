"""Rotations and frames in plain floats, giving the same bits on every machine.

Only +, −, ×, ÷ and square roots of IEEE doubles are used, plus :func:`sine_cosine` and :func:`angle`, which round
correctly from integer arithmetic: the C library's sin, cos and atan2 differ in the last bit between machines, and a
world's hash and a file's bytes must not. Quaternions are w x y z; matrices are rows of tuples.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable

from simspec.world.types import Pose, Quaternion, Vector3

Matrix3 = tuple[Vector3, Vector3, Vector3]

IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)
_BITS = 256
"""Fixed-point bits: 53 for the result, up to 60 lost to reducing angles below 1e15, the rest to spare."""


@functools.cache
def _half_pi() -> int:
    """π/2 in fixed point, by Machin's formula π/4 = 4 atan(1/5) − atan(1/239)."""

    def atan_inverse(n: int) -> int:
        total, term, k = 0, (1 << (_BITS + 16)) // n, 1
        while term:
            total += term // k if k % 4 == 1 else -(term // k)
            term //= n * n
            k += 2
        return total

    return (2 * (4 * atan_inverse(5) - atan_inverse(239))) >> 16


def _fixed(x: float) -> int:
    numerator, denominator = x.as_integer_ratio()
    return (numerator << _BITS) // denominator


def _sine_cosine_fixed(angle_fixed: int) -> tuple[int, int]:
    quarter = _half_pi()
    turns = (2 * angle_fixed + quarter) // (2 * quarter)
    x = angle_fixed - turns * quarter
    x2 = (x * x) >> _BITS
    sine, cosine, term, k = 0, 0, 1 << _BITS, 0
    while term:
        cosine += term if k % 4 == 0 else -term
        number = (term * x) >> _BITS
        number //= k + 1
        sine += number if k % 4 == 0 else -number
        term = ((term * x2) >> _BITS) // ((k + 1) * (k + 2))
        k += 2
    return ((sine, cosine), (cosine, -sine), (-sine, -cosine), (-cosine, sine))[turns % 4]


@functools.lru_cache(maxsize=65536)
def sine_cosine(x: float) -> tuple[float, float]:
    """Sine and cosine of ``x`` (rad, |x| < 1e15), each correctly rounded; π/2 given as a double gives cosine 0.

    A double is never exactly a multiple of π/2, so a right angle written in degrees would leave a cosine of 6e-17 in
    every matrix; the value at the double nearest to k π/2 is taken as that of k π/2 itself.
    """
    quarter_turns = round(x / (math.pi / 2))
    if abs(quarter_turns) <= 8 and x == quarter_turns * (math.pi / 2):
        return ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[quarter_turns % 4]
    sine, cosine = _sine_cosine_fixed(_fixed(x))
    return sine / (1 << _BITS), cosine / (1 << _BITS)


def angle(y: float, x: float) -> float:
    """The angle of the point (x, y), as atan2, correctly rounded."""
    if y == 0.0 or x == 0.0:
        return math.atan2(y, x)
    return _angle(y, x)


@functools.lru_cache(maxsize=65536)
def _angle(y: float, x: float) -> float:
    guess = math.atan2(y, x)
    sine, cosine = _sine_cosine_fixed(_fixed(guess))
    scale = max(abs(x), abs(y))
    y_fixed, x_fixed = _fixed(y / scale), _fixed(x / scale)
    across = (y_fixed * cosine - x_fixed * sine) >> _BITS
    along = (x_fixed * cosine + y_fixed * sine) >> _BITS
    return (_fixed(guess) + (across << _BITS) // along) / (1 << _BITS)


def add(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vector3, b: Vector3) -> Vector3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def cross(a: Vector3, b: Vector3) -> Vector3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def normalise(q: Quaternion) -> Quaternion:
    """Unit length, first non-zero component positive. Raises ValueError for a zero quaternion."""
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if length == 0.0:
        raise ValueError("a zero quaternion is no rotation")
    if abs(length - 1.0) < 4e-16:  # already of unit length to rounding: dividing would only walk in the last bit
        length = 1.0
    w, x, y, z = q if length == 1.0 else (q[0] / length, q[1] / length, q[2] / length, q[3] / length)
    # the sign is judged after dividing: a component of 1e-323 may have gone to zero
    if next(component for component in (w, x, y, z) if component != 0.0) < 0.0:
        w, x, y, z = -w, -x, -y, -z
    return (w + 0.0, x + 0.0, y + 0.0, z + 0.0)


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """The rotation ``a`` after ``b``; normalised."""
    if b == IDENTITY:
        return a
    if a == IDENTITY:
        return b
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return normalise(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        )
    )


def conjugate(q: Quaternion) -> Quaternion:
    return normalise((q[0], -q[1], -q[2], -q[3]))


def matrix(q: Quaternion) -> Matrix3:
    """Rotation matrix of a unit quaternion."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def from_matrix(m: Matrix3) -> Quaternion:
    """Unit quaternion of a rotation matrix, by its largest component (Shepperd's method)."""
    trace = m[0][0] + m[1][1] + m[2][2]
    largest = max(range(4), key=lambda k: trace if k == 0 else m[k - 1][k - 1])
    if largest == 0:
        q = (1.0 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1])
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        parts = [0.0] * 4
        parts[0] = m[k][j] - m[j][k]
        parts[1 + i] = 1.0 + m[i][i] - m[j][j] - m[k][k]
        parts[1 + j] = m[i][j] + m[j][i]
        parts[1 + k] = m[i][k] + m[k][i]
        q = (parts[0], parts[1], parts[2], parts[3])
    return normalise(q)


def rotate(q: Quaternion, v: Vector3) -> Vector3:
    """The vector ``v`` turned by ``q``."""
    if q == IDENTITY:
        return v
    m = matrix(q)
    return (dot(m[0], v), dot(m[1], v), dot(m[2], v))


def from_rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Fixed-axis roll, pitch, yaw (R = Rz Ry Rx): first about x, then y, then z of the parent's frame; rad."""
    (sr, cr), (sp, cp), (sy, cy) = (sine_cosine(x / 2.0) for x in (roll, pitch, yaw))
    return normalise(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )


def to_rpy(q: Quaternion) -> Vector3:
    """Fixed-axis roll, pitch, yaw of ``q``.

    Roll is taken from the matrix turned back by yaw, which keeps full precision near pitch = ±90° (measured: the
    common formula atan2(R21, R22) loses up to 2e-2 there).
    """
    if q == IDENTITY:
        return (0.0, 0.0, 0.0)
    r = matrix(q)
    horizontal = math.sqrt(r[0][0] * r[0][0] + r[1][0] * r[1][0])
    yaw = angle(r[1][0], r[0][0]) if horizontal > 0.0 else 0.0
    pitch = angle(-r[2][0], horizontal)
    sy, cy = sine_cosine(yaw)
    roll = angle(sy * r[0][2] - cy * r[1][2], cy * r[1][1] - sy * r[0][1])
    return (roll + 0.0, pitch + 0.0, yaw + 0.0)


def to_euler_xyz(q: Quaternion) -> Vector3:
    """Intrinsic X-Y-Z Euler angles (R = Rx Ry Rz); rad."""
    if q == IDENTITY:
        return (0.0, 0.0, 0.0)
    # R = Rx(a) Ry(b) Rz(c) means Rᵀ = Rz(−c) Ry(−b) Rx(−a): the roll, pitch and yaw of the inverse, negated.
    roll, pitch, yaw = to_rpy(conjugate(q))
    return (0.0 - roll, 0.0 - pitch, 0.0 - yaw)


def from_axis_angle(axis: Vector3, turn: float) -> Quaternion:
    """Rotation by ``turn`` (rad) about the unit vector ``axis``."""
    s, c = sine_cosine(turn / 2.0)
    return normalise((c, axis[0] * s, axis[1] * s, axis[2] * s))


def compose(a: Pose, b: Pose) -> Pose:
    """The pose of C in A, from the pose ``a`` of B in A and ``b`` of C in B."""
    return Pose(add(a.position, rotate(a.quaternion, b.position)), multiply(a.quaternion, b.quaternion))


def inverse(a: Pose) -> Pose:
    """The pose of A in B, from that of B in A."""
    back = conjugate(a.quaternion)
    x, y, z = rotate(back, a.position)
    return Pose((0.0 - x, 0.0 - y, 0.0 - z), back)


def rotate_inertia(q: Quaternion, inertia: tuple[float, ...]) -> tuple[float, float, float, float, float, float]:
    """R I Rᵀ for an inertia (xx, yy, zz, xy, xz, yz)."""
    if q == IDENTITY:
        return tuple(inertia)  # type: ignore[return-value]
    r = matrix(q)
    xx, yy, zz, xy, xz, yz = inertia
    full = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    # no sum(): from Python 3.12 on it compensates, and would give other last bits
    left = [[r[i][0] * full[0][j] + r[i][1] * full[1][j] + r[i][2] * full[2][j] for j in range(3)] for i in range(3)]

    def element(i: int, j: int) -> float:
        return left[i][0] * r[j][0] + left[i][1] * r[j][1] + left[i][2] * r[j][2]

    return (element(0, 0), element(1, 1), element(2, 2), element(0, 1), element(0, 2), element(1, 2))


# Sequences of numbers and names as the tuples of fixed length that the world's types hold.


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


def direction(vector: Vector3) -> Vector3:
    """The unit vector along a vector that is not zero."""
    scale = max(map(abs, vector))  # a tiny vector's squares would vanish
    x, y, z = vector[0] / scale, vector[1] / scale, vector[2] / scale
    squared = x * x + y * y + z * z
    if squared == 1.0:
        return (x + 0.0, y + 0.0, z + 0.0)
    length = math.sqrt(squared)
    return (x / length + 0.0, y / length + 0.0, z / length + 0.0)
