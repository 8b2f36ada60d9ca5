"""Whether an engine gives the same bits again, and where it first does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simspec.comparison.floor import STATES, same_bits
from simspec.errors import Problem, SpecError
from simspec.mapped import parts
from simspec.runner.run import Run

SAME = ("world_sha256", "engine_version", "artifacts_sha256", "perturb", "seed")
"""Entries of the provenance in which repeats are equal."""


@dataclass(frozen=True, slots=True)
class Departure:
    """Where a repeat first differs from the first run: its number (from 1), the array, the recorded time (s), and the largest
    difference there, in the array's own units (0.0: other bits of the same number). ``time`` and ``size`` are None where one
    simply recorded fewer rows."""

    repeat: int
    array: str
    time: float | None
    size: float | None


@dataclass(frozen=True)
class Determinism:
    """Repeats of one run: ``runs`` of them were compared; ``departures``: the first difference of each that differs."""

    engine: str
    runs: int
    departures: tuple[Departure, ...]

    @property
    def bitwise(self) -> bool:
        """Whether every repeat has the bits of the first run."""
        return not self.departures

    def __str__(self) -> str:
        if self.bitwise:
            return f"{self.runs} runs, bitwise equal"
        first = self.departures[0]
        when = "in its number of records" if first.time is None else f"from {first.time:.4g} s on, in {first.array}"
        return f"{len(self.departures)} of {self.runs - 1} repeats differ, the first {when}"


def determinism(runs: Sequence[Run]) -> Determinism:
    """Hold repeats of one run against the first, bit for bit: step, q, v, poses and velocities.

    Raises SpecError for fewer than two runs, for runs that are not repeats of each other, and for runs that recorded nothing.
    """
    if len(runs) < 2:
        raise SpecError([Problem("determinism needs at least two runs")])
    first = runs[0]
    for run in runs:
        if not run.recorded:
            raise SpecError([Problem(f"{run.label} recorded nothing to compare: {run.failed}")])
        other = [name for name in SAME if run.provenance.get(name) != first.provenance.get(name)]
        if run.engine != first.engine or other:
            why = ", ".join(other) or "engine"
            raise SpecError(
                [Problem(f"{first.label} and {run.label} are not repeats of one run", found=f"other {why}")]
            )
    departures = [_departure(first, run, number) for number, run in enumerate(runs[1:], 1) if not same_bits(first, run)]
    return Determinism(first.label, len(runs), tuple(departures))


def _departure(one: Run, other: Run, number: int) -> Departure:
    """The earliest difference; of several arrays at one row, that of the first in :data:`STATES`."""
    rows = min(len(one.time), len(other.time))
    earliest, array = rows, ""
    for name in STATES:
        a, b = one.arrays[name], other.arrays[name]
        for part in parts(earliest, 2 * a[:1].nbytes, a, b):
            differs = _bits(a[part]) != _bits(b[part])
            if differs.any():
                earliest, array = part.start + int(differs.any(axis=1).argmax()), name
                break
    if not array:
        return Departure(number, "step", None, None)
    a, b = (np.asarray(run.arrays[array][earliest], dtype=np.float64) for run in (one, other))
    return Departure(number, array, float(one.time[earliest]), float(np.abs(a - b).max()))


def _bits(values: np.ndarray) -> np.ndarray:
    """Each row as its bytes (rows, bytes)."""
    return np.frombuffer(values.tobytes(), dtype=np.uint8).reshape(len(values), -1)
