"""How far two height fields are apart: by the heights of their surfaces, at the points of the grid and within every triangle.

Within each cell one place is looked at in either of its triangles, so that a surface which is split along the other diagonal
differs there, by a third of what the cell is bent by, though all its points are the same.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from simspec.world.shapes import Field, field_of

Array = NDArray[np.float64]
KEPT = 64
"""Fields whose samples are remembered."""


def field_distance(wanted: tuple[float, ...], held: tuple[float, ...]) -> float:
    """The largest difference of two height fields, of heights, lengths or base, as a share of the extent of the first."""
    field, other = field_of(wanted), field_of(held)
    lengths = max(abs(field.x - other.x), abs(field.y - other.y), abs(field.base - other.base))
    shares, heights = _sampled(wanted)
    apart = float(np.abs(surface(other, shares) - heights).max())
    return max(lengths, apart) / field.extent


def surface(field: Field, shares: Array) -> Array:
    """The heights (n,) of a field at places (n, 2) within its rectangle, as shares of its lengths from the least x and y."""
    rows, columns = field.shape
    along, across = shares[:, 0] * (columns - 1), shares[:, 1] * (rows - 1)
    column = np.clip(np.floor(along).astype(np.int64), 0, columns - 2)
    row = np.clip(np.floor(across).astype(np.int64), 0, rows - 2)
    u, v = along - column, across - row
    z = field.heights
    low, high = z[row, column], z[row + 1, column + 1]
    beside = np.where(u >= v, z[row, column + 1], z[row + 1, column])
    more, less = np.maximum(u, v), np.minimum(u, v)
    made: Array = low + more * (beside - low) + less * (high - beside)
    return made


@functools.lru_cache(maxsize=KEPT)
def _sampled(size: tuple[float, ...]) -> tuple[Array, Array]:
    """Places (n, 2) in the rectangle, as shares, and the heights (n,) of a field there: its points, and the middle of each
    triangle."""
    field = field_of(size)
    rows, columns = field.shape
    inside = [
        (column + du, row + dv)
        for du, dv in ((2.0 / 3.0, 1.0 / 3.0), (1.0 / 3.0, 2.0 / 3.0))
        for row, column in [np.indices((rows - 1, columns - 1)).reshape(2, -1)]
    ]
    row, column = np.indices((rows, columns)).reshape(2, -1)
    along = np.concatenate([column, *(each[0] for each in inside)]) / (columns - 1)
    across = np.concatenate([row, *(each[1] for each in inside)]) / (rows - 1)
    shares = np.stack([along, across], axis=1)
    return shares, surface(field, shares)
