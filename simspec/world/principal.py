"""Principal moments and axes of a tensor of inertia, in plain floats: the same bits on every machine."""

from __future__ import annotations

import functools
import math

from simspec.world import frames
from simspec.world.types import Quaternion, Vector3

FLAT_MARGIN = 1.0 - 2.0**-40
"""Share of λ1 + λ2 that the largest principal moment may reach. An inertia with λmax > λ1 + λ2, even by round-off, is
zeroed by one engine and refused by another (measured: 77 of 200 flat bodies); 2⁻⁴⁰ ≈ 9e-13 is inside the 1e-12 of proof
level L0."""


@functools.lru_cache(maxsize=65536)
def principal_axes(inertia: tuple[float, ...]) -> tuple[Vector3, Quaternion]:
    """Principal moments and axes of an inertia (xx, yy, zz, xy, xz, yz): I = R diag(moments) Rᵀ.

    Cyclic Jacobi rotations to the last bit. A diagonal tensor is returned as it is, unturned. The largest moment is
    clipped to ``FLAT_MARGIN`` × the sum of the other two, and a flat direction's round-off below zero to zero.
    """
    xx, yy, zz, xy, xz, yz = inertia
    a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    for _ in range(60):
        if a[0][1] == 0.0 and a[0][2] == 0.0 and a[1][2] == 0.0:
            break
        for p, q in ((0, 1), (0, 2), (1, 2)):
            _jacobi_rotation(a, r, p, q)
    else:
        raise ArithmeticError(f"Jacobi rotations did not converge on the inertia {inertia}")
    moments = clip_flat((a[0][0], a[1][1], a[2][2]))
    turn = frames.from_matrix((tuple(r[0]), tuple(r[1]), tuple(r[2])))  # type: ignore[arg-type]
    return moments, turn


def _jacobi_rotation(a: list[list[float]], r: list[list[float]], p: int, q: int) -> None:
    """Turn the plane (p, q) so that a[p][q] becomes zero; ``r`` collects the rotations."""
    if a[p][q] == 0.0:
        return
    if abs(a[p][q]) < 1e-18 * math.sqrt(
        abs(a[p][p] * a[q][q])
    ):  # below the last bit of both diagonals: nothing to turn
        a[p][q] = a[q][p] = 0.0
        return
    theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q])
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    a[p][p], a[q][q] = a[p][p] - t * a[p][q], a[q][q] + t * a[p][q]
    a[p][q] = a[q][p] = 0.0
    k = 3 - p - q
    akp, akq = a[k][p], a[k][q]
    a[k][p] = a[p][k] = c * akp - s * akq
    a[k][q] = a[q][k] = s * akp + c * akq
    for i in range(3):
        rip, riq = r[i][p], r[i][q]
        r[i][p], r[i][q] = c * rip - s * riq, s * rip + c * riq


def clip_flat(moments: Vector3) -> Vector3:
    """Principal moments of which none is below zero, and the largest at most ``FLAT_MARGIN`` × the sum of the others."""
    clipped = [max(moment, 0.0) for moment in moments]
    largest = max(range(3), key=lambda i: clipped[i])
    bound = (sum(clipped) - clipped[largest]) * FLAT_MARGIN
    clipped[largest] = min(clipped[largest], bound)
    return (clipped[0], clipped[1], clipped[2])
