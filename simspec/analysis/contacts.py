"""Contacts of two runs, matched by pair of bodies: how long each pair touched, at the same times or not, and with which
impulse.

Runs record bodies of a contact, not shapes: shapes of one body count together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.comparison.common import common_rows
from simspec.comparison.contacts import CONTACT_BYTES, Side
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


def pair_numbers(run: Run, part: slice) -> NDArray[np.int64]:
    """For contacts ``part`` of a run the number of the pair (n,): smaller index times the number of bodies, plus the
    larger."""
    pair = np.sort(run.arrays["contact.body"][part].astype(np.int64), axis=1)
    result: NDArray[np.int64] = pair[:, 0] * len(run.world.bodies) + pair[:, 1]
    return result


def named_pair(run: Run, number: int) -> Pair:
    """The names (sorted) of a pair's bodies, from its number."""
    first, second = divmod(int(number), len(run.world.bodies))
    one, other = sorted((run.world.bodies[first].name, run.world.bodies[second].name))
    return one, other


def touches(run: Run) -> dict[Pair, Touch]:
    """Every pair of bodies that touched in a run. The impulse is the time integral of the normal force, Σ F Δt over the
    recorded
    rows: exact where every step is recorded, a sample of it otherwise. Raises SpecError where contacts were not recorded."""
    demand_contacts(run)
    row, force = run.arrays["contact.row"], run.arrays["contact.normal_force"]
    lasting = durations(run)
    seconds: dict[int, float] = {}
    impulse: dict[int, float] = {}
    first: dict[int, float] = {}
    last_row: dict[int, int] = {}
    for part in parts(len(row), CONTACT_BYTES, row, force, run.arrays["contact.body"]):
        number, at = pair_numbers(run, part), row[part].astype(np.int64)
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
    return {named_pair(run, kind): Touch(seconds[kind], impulse[kind], first[kind]) for kind in impulse}


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


def compare_contacts(a: Run, b: Run) -> tuple[PairComparison, ...]:
    """The contacts of two runs at the times that both recorded, by pair, that with the largest impulse first.

    Raises SpecError where a run did not record contacts, or the runs have no common time.
    """
    for run in (a, b):
        demand_contacts(run)
    rows_a, rows_b = common_rows(a, b)
    lasting = np.diff(a.time[rows_a], prepend=a.time[rows_a[:1]])
    numbers: dict[str, int] = {}
    sides = []
    for run, rows in ((a, rows_a), (b, rows_b)):
        index = np.array([numbers.setdefault(body.name, len(numbers)) for body in run.world.bodies], dtype=np.int64)
        sides.append(Side(run, rows, index))
    count = len(numbers)
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
    names = list(numbers)
    compared = [PairComparison(_pair(names, number), *values) for number, values in totals.items()]
    return tuple(sorted(compared, key=lambda one: (-max(one.first_impulse, one.second_impulse), one.pair)))


def _add(totals: dict[int, list[float]], column: int, pair: NDArray[np.int64], amount: NDArray[np.float64]) -> None:
    kinds, place = np.unique(pair, return_inverse=True)
    for kind, total in zip(kinds.tolist(), np.bincount(place, amount, len(kinds)).tolist(), strict=True):
        totals.setdefault(kind, [0.0] * 5)[column] += total


def _pair(names: list[str], number: int) -> Pair:
    first, second = sorted(names[index] for index in divmod(number, len(names)))
    return first, second


def total_jaccard(compared: tuple[PairComparison, ...]) -> float | None:
    """The share for all pairs together: time in contact in both runs over that in either; None where nothing touched."""
    both = sum(one.both_seconds for one in compared)
    either = sum(one.first_seconds + one.second_seconds for one in compared) - both
    return both / either if either else None
