"""What Drake's memory grows with: worlds that need too much are refused before they are built.

Drake's collision filter keeps an entry for every two geometries, whether they are filtered or not, in the model and in each
context; the steps and the mass matrix are dense in the velocities, of however many bodies that do not act on each other.
"""

from __future__ import annotations

PAIR_BYTES = 400
"""Of two geometries: 1,945 of them (216 boxes) take 740 MB, 2,029 spheres 840 MB (measured)."""
MOST_GIGABYTES = 4.0
"""Of 2,860 free spheres, or 490 boxes with their corners. 2,029 spheres take 2.0 GB and load in 7 s, 344 boxes 1.9 GB and 17 s
(measured)."""


def gigabytes(geometries: int, velocities: int) -> float:
    """The memory (GB) that Drake needs for so many collision geometries, corners counted, and velocities."""
    return 1e-9 * (PAIR_BYTES * geometries * (geometries - 1) / 2 + 8 * velocities**2)


def too_large(geometries: int, velocities: int) -> str | None:
    """Why a world is refused; None where it is not."""
    needed = gigabytes(geometries, velocities)
    if needed <= MOST_GIGABYTES:
        return None
    return (
        f"Drake needs {needed:.1f} GB, and more than {MOST_GIGABYTES:g} GB are not given to it: its collision filter keeps "
        f"every pair of {geometries:,} geometries (a box is nine, itself and its corners; a cylinder 19, a mesh up to 49), and "
        f"its mass matrix of {velocities:,} velocities is dense"
    )
