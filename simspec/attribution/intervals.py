"""Intervals of shares: how far a share depends on which windows a run happens to have.

Windows are drawn again with replacement, class by class, in blocks of neighbours, since what one window shows the next one
shows again; a share is computed from each draw. The generator's seed is fixed: the same windows give the same intervals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from simspec.attribution.windows import ALL, CLASSES, Windows

Floats = NDArray[np.float64]
DRAWS = 400
"""Draws of an interval: the limits of 95 % then stand on ten draws at each end."""
LIMITS = (0.025, 0.975)
"""Quantiles of the draws that an interval lies between: 95 % of them are inside."""
SEED = 12
FEWEST = 4
"""Windows of a class below which nothing is drawn: their share has no interval."""
Interval = tuple[float, float]


class Draws:
    """Weights of windows in draws with replacement, by class: (DRAWS, k), rows that sum to one."""

    def __init__(self, windows: Windows, counting: NDArray[np.bool_]):
        generator = np.random.default_rng(SEED)
        self._weights: dict[str, Floats] = {}
        shares, totals = windows.weights(counting), np.zeros((DRAWS, len(counting)))
        drawn = True
        for index, name in enumerate(CLASSES):
            places = np.flatnonzero((windows.kinds == index) & windows.counted(counting))
            if not len(places):
                continue
            weights = np.zeros((DRAWS, len(counting)))
            np.add.at(weights, (np.arange(DRAWS)[:, None], places[_blocks(generator, len(places))]), 1.0 / len(places))
            if len(places) >= FEWEST:
                self._weights[name] = weights
            else:
                drawn = False
            totals += shares[name] * weights
        if drawn:
            self._weights[ALL] = totals

    def share(self, gap: Floats, whole: Floats) -> dict[str, Interval]:
        """By class the interval of 1 − mean(gap)/mean(whole), of gaps (k,) of the same windows."""
        intervals = {}
        for name, weights in self._weights.items():
            means = weights @ whole
            if (means > 0.0).all():
                low, high = np.quantile(1.0 - (weights @ gap) / means, LIMITS)
                intervals[name] = (float(low), float(high))
        return intervals


def _blocks(generator: np.random.Generator, count: int) -> NDArray[np.int64]:
    """Indices (DRAWS, count) of ``count`` things: blocks of neighbours that begin anywhere, the last continued by the first."""
    size = max(1, round(count ** (1.0 / 3.0)))
    number = -(-count // size)
    begins = generator.integers(0, count, size=(DRAWS, number, 1))
    return ((begins + np.arange(size)) % count).reshape(DRAWS, -1)[:, :count].astype(np.int64)


def above(interval: Interval | None) -> bool:
    """Whether a share with this interval may be claimed: all of it is on one side of zero. Without an interval it may."""
    return interval is None or interval[0] > 0.0 or interval[1] < 0.0
