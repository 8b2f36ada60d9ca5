"""Contacts of two runs, matched by pair of shapes: how long each pair touched, at the same times or not, and with which
impulse.

What is matched is what both runs tell: shapes that an engine does not tell apart count together, and all of a body where a
run did
not record shapes (:mod:`simspec.comparison.sides`). A pair has the names of its sides: a body's, with shapes in brackets
where they are
not all of its shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.comparison.common import common_rows
from simspec.comparison.contacts import CONTACT_BYTES, named_pair, sides_of
from simspec.comparison.sides import Sides, common_sides
from simspec.errors import Problem, SpecError
from simspec.mapped import parts
from simspec.runner.run import Run

Pair = tuple[str, str]


def demand_contacts(run: Run) -> None:
    """Raises SpecError where a run did not record its contacts."""
    if "contact.row" not in run.arrays:
        hint = "add contacts to record.channels"
        raise SpecError([Problem(f"{run.label} did not record contacts", "record.channels", hint=hint)])


def durations(run: Run) -> NDArray[np.float64]:
    """The time (rows,), s, that each recorded row stands for: the one since the row before; 0 of the initial state."""
    return np.diff(run.time, prepend=run.time[:1])


@dataclass(frozen=True, slots=True)
class Touch:
    """Of one pair in one run: time in contact (s), impulse (N s), and when it first touched (s)."""

    seconds: float
    impulse: float
    first: float


def pair_numbers(run: Run, part: slice, sides: Sides) -> NDArray[np.int64]:
    """For contacts ``part`` of a run the number of the pair (n,): smaller side times the number of sides, plus the larger."""
    pair = np.sort(sides.numbers[0][run.arrays[sides.arrays[0]][part].astype(np.int64)], axis=1)
    result: NDArray[np.int64] = pair[:, 0] * len(sides.names) + pair[:, 1]
    return result


def touches(run: Run, by: str = "shape") -> dict[Pair, Touch]:
    """Every pair of shapes (``by``: or of bodies) that touched in a run. The impulse is the time integral of the normal
    force, Σ F Δt over the
    recorded
    rows: exact where every step is recorded, a sample of it otherwise. Raises SpecError where contacts were not recorded."""
    demand_contacts(run)
    row, force = run.arrays["contact.row"], run.arrays["contact.normal_force"]
    lasting, sides = durations(run), common_sides([run], by)
    seconds: dict[int, float] = {}
    impulse: dict[int, float] = {}
    first: dict[int, float] = {}
    last_row: dict[int, int] = {}
    for part in parts(len(row), CONTACT_BYTES, row, force, run.arrays[sides.arrays[0]]):
        number, at = pair_numbers(run, part, sides), row[part].astype(np.int64)
        pushed = force[part] * lasting[at]
        kinds, place = np.unique(number, return_inverse=True)
        for kind, total in zip(kinds.tolist(), np.bincount(place, pushed, len(kinds)).tolist(), strict=True):
            impulse[kind] = impulse.get(kind, 0.0) + total
        # a pair counts once for each row, however many points it touches at; a block may end within a row
        for index, kind in enumerate(kinds.tolist()):
            own = np.unique(at[place == index])
            first.setdefault(kind, float(run.time[own[0]]))
            begun = 1 if own[0] == last_row.get(kind) else 0
            seconds[kind] = seconds.get(kind, 0.0) + float(lasting[own[begun:]].sum())
            last_row[kind] = int(own[-1])
    return {named_pair(sides.names, kind): Touch(seconds[kind], impulse[kind], first[kind]) for kind in impulse}


@dataclass(frozen=True, slots=True)
class PairComparison:
    """One pair in two runs over their common times: time in contact (s) in each and in both, and impulses (N s) in each."""

    pair: Pair
    first_seconds: float
    second_seconds: float
    both_seconds: float
    first_impulse: float
    second_impulse: float

    @property
    def jaccard(self) -> float:
        """Time in contact in both runs over time in contact in either: 1 where they touch at the same times. NaN where
        the pair
        touches in the initial state alone, which lasts no time."""
        either = self.first_seconds + self.second_seconds - self.both_seconds
        return self.both_seconds / either if either else float("nan")


def compare_contacts(a: Run, b: Run, by: str = "shape") -> tuple[PairComparison, ...]:
    """The contacts of two runs at the times that both recorded, by pair of shapes as far as both tell them (``by``: or of
    bodies),
    that with the largest impulse first. ``common_sides((a, b)).notes`` says what one does not tell.

    Raises SpecError where a run did not record contacts, or the runs have no common time.
    """
    for run in (a, b):
        demand_contacts(run)
    rows_a, rows_b = common_rows(a, b)
    lasting = np.diff(a.time[rows_a], prepend=a.time[rows_a[:1]])
    known = common_sides((a, b), by)
    sides, count = sides_of((a, b), (rows_a, rows_b), known), len(known.names)
    totals: dict[int, list[float]] = {}
    first = 0
    while first < len(rows_a):
        last = min(len(rows_a), *(side.until(first) for side in sides))
        one, other = (side.pairs(first, last, count) for side in sides)
        both = np.intersect1d(one, other, assume_unique=True)
        for column, found in enumerate((one, other, both)):
            _add(totals, column, found % count**2, lasting[found // count**2])
        for column, side in enumerate(sides, 3):
            at, pair, force = side.forces(first, last, count)
            _add(totals, column, pair, force * lasting[at])
        first = last
    compared = [PairComparison(named_pair(known.names, number), *values) for number, values in totals.items()]
    return tuple(sorted(compared, key=lambda one: (-max(one.first_impulse, one.second_impulse), one.pair)))


def _add(totals: dict[int, list[float]], column: int, pair: NDArray[np.int64], amount: NDArray[np.float64]) -> None:
    kinds, place = np.unique(pair, return_inverse=True)
    for kind, total in zip(kinds.tolist(), np.bincount(place, amount, len(kinds)).tolist(), strict=True):
        totals.setdefault(kind, [0.0] * 5)[column] += total


def total_jaccard(compared: tuple[PairComparison, ...]) -> float | None:
    """The share for all pairs together: time in contact in both runs over that in either; None where nothing touched."""
    both = sum(one.both_seconds for one in compared)
    either = sum(one.first_seconds + one.second_seconds for one in compared) - both
    return both / either if either else None
