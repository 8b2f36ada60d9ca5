"""How far two runs can be compared: until the engines' own noise grows past the tolerance.

Noise that grows is chaos: past that time two runs of the *same* engine differ without bound, and positions say nothing.
Noise that stays at a level is not: a difference above that level is one, and a tolerance below it cannot be told.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

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


class Noise(Protocol):
    """The noise of two runs at their common times, looked at where it is asked for: there may be very many rows."""

    rows: int
    bodies: int

    def time(self, rows: np.ndarray) -> np.ndarray:
        """Times (n,) of some rows, s."""

    def noise(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of each body at a row of its own, in position (bodies,), m, and angle, rad: never falling with the row; infinite
        where nothing was measured."""

    def size(self) -> float:
        """Of the scene, m."""


def first_row(holds: Callable[[np.ndarray], np.ndarray], rows: int, bodies: int) -> np.ndarray:
    """For each body the first row (bodies,) at which something holds that holds at all later rows too; ``rows`` where it
    never does. ``holds`` is asked for each body at a row of its own."""
    low, high = np.zeros(bodies, dtype=np.int64), np.full(bodies, rows)
    while (searching := low < high).any():
        middle = (low + high) // 2
        holding = holds(np.minimum(middle, rows - 1))
        high = np.where(searching & holding, middle, high)
        low = np.where(searching & ~holding, middle + 1, low)
    return low


def horizon(of: Noise, factor: float, tolerance: float, angle_tolerance: float) -> int:
    """The row from which no position says anything, because ``factor`` times the noise of some body has grown past the
    tolerance (m; and rad); the number of rows when there is none."""
    bodies = of.bodies

    def noise(rows: np.ndarray) -> np.ndarray:
        return factor * np.stack(of.noise(rows))

    def unmeasured(rows: np.ndarray) -> np.ndarray:
        result: np.ndarray = ~np.isfinite(noise(rows)).all(axis=0)
        return result

    rows = int(first_row(unmeasured, of.rows, bodies).min())
    if not rows:
        return 0

    def ratio(at: np.ndarray) -> np.ndarray:
        """Noise over the tolerance, of each body at a row of its own."""
        position, angle = noise(at)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.fmax(position / tolerance, angle / angle_tolerance)
        # a tolerance of 0 is below any noise, and no noise is within it
        result: np.ndarray = np.nan_to_num(share, posinf=np.finfo(float).max)
        return result

    def first_above(limit: np.ndarray | float) -> np.ndarray:
        return first_row(lambda at: ratio(at) > limit, rows, bodies)

    last = np.full(bodies, rows - 1)
    ends = ratio(last)
    outgrown = ends > 1.0
    if not outgrown.any():
        return rows
    position, angle = noise(last)
    saturated = (position > SATURATED * of.size()) | (angle > SATURATED * np.pi)
    # the first row from which the noise stays within a decade, and the time that the decade before took
    settled = np.minimum(first_above(ends / DECADE), rows - 1)
    before = np.minimum(first_above(ratio(settled) / DECADE), rows - 1)
    stayed, took = of.time(last) - of.time(settled), of.time(settled) - of.time(before)
    at_level = ~saturated & (rows - settled >= FEWEST_ROWS) & (stayed >= PATIENCE * took)
    return int(np.where(at_level, rows, first_above(1.0))[outgrown].min())
