"""Numbers for an engine of single precision, which takes zero or infinity in silence for those that it has not."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from simspec.errors import EngineError

LARGEST, SMALLEST = float(np.finfo(np.float32).max), float(np.finfo(np.float32).tiny)
"""Numbers of single precision."""


def held_by(engine: str, values: Iterable[float], what: str) -> tuple[float, ...]:
    """Numbers that ``engine`` can hold. Raises EngineError for others."""
    found = tuple(values)
    for value in found:
        if not math.isfinite(value) or abs(value) > LARGEST or 0.0 < abs(value) < SMALLEST:
            raise EngineError(engine, f"has single precision, in which there is no {value!r} ({what})")
    return found


def demand_held(engine: str, values: np.ndarray, what: str) -> None:
    """Raise EngineError for a state or an effort that ``engine`` cannot hold. What is below its smallest number becomes zero
    there, which is right to 1e-38 of its unit: other engines' states have such rests."""
    held_by(engine, np.where(np.abs(values) < SMALLEST, 0.0, values).tolist(), what)
