"""Confidence intervals: of a share of trials, and of a positive figure that several processes gave.

A process is the unit. Within one process speed hardly varies; between processes it does, and often has two modes (where
memory
and code came to lie), so that steps or seconds of one process say nothing about the spread.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LEVEL = 0.95
"""Of every interval, unless another is asked for."""
FEWEST = 2
"""Processes from which a spread can be estimated."""


@dataclass(frozen=True, slots=True)
class Interval:
    """``lower`` ≤ ``value`` ≤ ``upper`` at the confidence ``level``; ``trials``: the number of independent values."""

    value: float
    lower: float
    upper: float
    trials: int
    level: float = LEVEL

    def __str__(self) -> str:
        return f"{self.value:.3g} [{self.lower:.3g}, {self.upper:.3g}]"


def share(successes: int, trials: int, level: float = LEVEL) -> Interval:
    """The share of successes with its exact interval (Clopper and Pearson 1934): with 10 of 10 it begins at 0.69.

    Raises ValueError without trials, or where there are more successes than trials.
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"{successes} successes of {trials} trials")
    from scipy.stats import beta

    tail = (1.0 - level) / 2.0
    lower = float(beta.ppf(tail, successes, trials - successes + 1)) if successes else 0.0
    upper = float(beta.ppf(1.0 - tail, successes + 1, trials - successes)) if successes < trials else 1.0
    return Interval(successes / trials, lower, upper, trials, level)


@dataclass(frozen=True, slots=True)
class Spread:
    """A positive figure of several processes: ``values`` in the order of the processes.

    ``mean``: the geometric mean with Student's t interval of the logarithms (what disturbs a process makes it slower by a
    factor); None of fewer than two processes, which have no spread.
    """

    values: tuple[float, ...]
    mean: Interval | None

    @property
    def processes(self) -> int:
        """The number of processes."""
        return len(self.values)

    @property
    def median(self) -> float:
        """The middle value."""
        return float(np.median(self.values))

    @property
    def least(self) -> float:
        """The smallest value."""
        return min(self.values)

    @property
    def most(self) -> float:
        """The largest value."""
        return max(self.values)

    def __str__(self) -> str:
        """The median, the interval of the mean, and how many processes there were."""
        if self.mean is None:
            return f"{self.median:.3g} (1 process, spread unknown)"
        return f"{self.median:.3g} [{self.mean.lower:.3g}, {self.mean.upper:.3g}] ({self.processes} processes)"


def spread(values: Sequence[float], level: float = LEVEL) -> Spread:
    """The spread of a positive figure over processes. Raises ValueError without values, or where one is not positive."""
    told = tuple(float(value) for value in values)
    if not told or not all(math.isfinite(value) and value > 0.0 for value in told):
        raise ValueError(f"a spread needs positive values: {told}")
    if len(told) < FEWEST:
        return Spread(told, None)
    logarithms = np.log(told)
    half = _t(level, len(told) - 1) * float(logarithms.std(ddof=1)) / math.sqrt(len(told))
    return Spread(told, _of_logarithm(float(logarithms.mean()), half, len(told), level))


def ratio(first: Spread, second: Spread, level: float = LEVEL) -> Interval | None:
    """How many times larger the first figure is than the second: ratio of the geometric means, with Welch's interval.
    None where either has fewer than two processes."""
    if first.processes < FEWEST or second.processes < FEWEST:
        return None
    logarithms = [np.log(one.values) for one in (first, second)]
    errors = [float(values.var(ddof=1)) / len(values) for values in logarithms]
    centre = float(logarithms[0].mean() - logarithms[1].mean())
    total = sum(errors)
    half = 0.0
    if total > 0.0:  # equal values in every process have no spread
        freedom = total**2 / sum(error**2 / (len(values) - 1) for error, values in zip(errors, logarithms, strict=True))
        half = _t(level, freedom) * math.sqrt(total)
    return _of_logarithm(centre, half, first.processes + second.processes, level)


def _t(level: float, freedom: float) -> float:
    from scipy.stats import t

    return float(t.ppf(0.5 + level / 2.0, freedom))


def _of_logarithm(centre: float, half: float, trials: int, level: float) -> Interval:
    return Interval(math.exp(centre), math.exp(centre - half), math.exp(centre + half), trials, level)
