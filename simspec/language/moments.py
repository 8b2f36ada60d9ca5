"""Principal moments of an inertia tensor, and whether a body can have them."""

from __future__ import annotations

import math
from collections.abc import Sequence

SLACK = 1e-9
"""Relative excess of the triangle inequality that is let through: figures of flat bodies are written with some ten
digits, and a tensor turned into other axes carries round-off of 1e-16; a wrong tensor is off by far more."""


def principal_moments(tensor: Sequence[float]) -> tuple[float, float, float]:
    """The eigenvalues, ascending, of (xx, yy, zz, xy, xz, yz), by cyclic Jacobi rotations."""
    xx, yy, zz, xy, xz, yz = tensor
    scale = max(map(abs, tensor)) or 1.0
    a = [
        [xx / scale, xy / scale, xz / scale],
        [xy / scale, yy / scale, yz / scale],
        [xz / scale, yz / scale, zz / scale],
    ]
    for _ in range(60):
        if abs(a[0][1]) + abs(a[0][2]) + abs(a[1][2]) < 1e-20:  # far below the last bit of moments of size 1
            break
        for p, q in ((0, 1), (0, 2), (1, 2)):
            if a[p][q] == 0.0:
                continue
            theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q])
            t = math.copysign(1.0, theta) / (abs(theta) + math.hypot(theta, 1.0))
            c = 1.0 / math.hypot(t, 1.0)
            s = t * c
            for k in range(3):
                a[k][p], a[k][q] = c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]
            for k in range(3):
                a[p][k], a[q][k] = c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]
    low, middle, high = sorted(a[i][i] * scale for i in range(3))
    return low, middle, high


def impossible(moments: Sequence[float]) -> str | None:
    """Why no body has these principal moments; None when one can: none negative, none above the sum of the others."""
    low, middle, high = sorted(moments)
    shown = ", ".join(f"{moment:.6g}" for moment in moments)
    if low < -SLACK * max(high, -low):
        return f"a principal moment is negative: {shown} kg m²"
    if high > (low + middle) * (1.0 + SLACK):
        return (
            f"breaks the triangle inequality: the principal moments are {shown} kg m², and "
            f"{high:.6g} > {low:.6g} + {middle:.6g} = {low + middle:.6g}"
        )
    return None
