"""How far two runs can be compared: until the engines' own noise grows past the tolerance.

Noise that grows is chaos: past that time two runs of the *same* engine differ without bound, and positions say nothing.
Noise that stays at a level is not: a difference above that level is one, and a tolerance below it cannot be told.
"""

from __future__ import annotations

import numpy as np

DECADE = 10.0
"""Noise that grows by less than this until the end of the run has stopped growing, if it had the time to (see PATIENCE)."""
PATIENCE = 2.0
"""How long noise must stay within a decade, in units of the time that it took for the decade before: exponential growth takes
as long for each. Linear and quadratic drift pass (9 and 3 times as long), and so does one jump."""
FEWEST_ROWS = 5
"""Records that must show it: fewer show nothing."""
SATURATED = 0.02
"""Share of the scene's size (and of half a turn) from which noise that has stopped growing is chaos that has run its course,
not a level that anything can be told above. Noise of contact (an impact one step earlier or later) is some v dt: 1e-3 of it."""


def growth_begins(ratio: np.ndarray, time: np.ndarray, saturated: bool) -> int:
    """The row from which noise has outgrown the tolerance; the number of rows when it never does, or stays at a level.

    ratio      noise over the tolerance (rows,), never falling, finite
    time       of the rows, s
    saturated  whether the noise at the end is of the size of the whole scene
    """
    rows = len(ratio)
    above = int(np.searchsorted(ratio, 1.0, side="right"))
    if above == rows:
        return rows
    if saturated:
        return above
    # the first row from which the noise stays within a decade, and the time that the decade before took
    settled = int(np.searchsorted(ratio, ratio[-1] / DECADE, side="right"))
    before = int(np.searchsorted(ratio, ratio[settled] / DECADE, side="right"))
    stayed, took = time[-1] - time[settled], time[settled] - time[before]
    enough = rows - settled >= FEWEST_ROWS
    return rows if enough and stayed >= PATIENCE * took else above


def horizon(
    position: np.ndarray,
    angle: np.ndarray,
    time: np.ndarray,
    size: float,
    tolerance: float,
    angle_tolerance: float,
) -> int:
    """The row from which no position says anything, because the noise of some body has grown past the tolerance; the
    number of rows when there is none.

    position, angle             noise (rows, bodies), m and rad, never falling; infinite where nothing was measured
    time                        of the rows, s
    size                        of the scene, m
    tolerance, angle_tolerance  m and rad
    """
    measured = np.isfinite(position).all(axis=1) & np.isfinite(angle).all(axis=1)
    rows = len(time) if measured.all() else int(measured.argmin())
    if not rows:
        return 0
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.fmax(position[:rows] / tolerance, angle[:rows] / angle_tolerance)
    # a tolerance of 0 is below any noise, and no noise is within it
    ratio = np.nan_to_num(ratio, posinf=np.finfo(float).max)
    saturated = (position[rows - 1] > SATURATED * size) | (angle[rows - 1] > SATURATED * np.pi)
    found = rows
    for k in np.flatnonzero(ratio[-1] > 1.0):
        found = min(found, growth_begins(ratio[:, k], time[:rows], bool(saturated[k])))
    return found
