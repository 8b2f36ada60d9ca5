"""Numbers of tables that are compared at a glance."""

from __future__ import annotations

import math

SMALLEST = 1e-3
"""Numbers below this are shown as 0: nobody asks for more than three digits after the point."""


def two_digits(value: float) -> str:
    """Two digits that count, at most three places; of a number that is none or infinite, its name."""
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "∞"
    if abs(value) < SMALLEST:
        return "0"
    places = max(0, 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{min(places, 3)}f}"
