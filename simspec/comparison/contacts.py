"""The contacts of two runs: when a body first touched something, and when other pairs first touch in one than in the other.

``contact.row`` never falls (of an engine's answer and of a stored run that is checked), so that what is of a time is found by
bisection, and all of it is gone through block by block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simspec.comparison.common import Common
from simspec.comparison.sides import Sides, common_sides
from simspec.mapped import block_rows, parts, release
from simspec.runner.run import Run

CONTACT_BYTES = 200
"""Of temporary arrays for each contact."""


def first_touches(runs: Sequence[Run], names: Sequence[str]) -> dict[str, float]:
    """For every body the first time (s) at which any run recorded a contact of it, or of a body of its tree."""
    touched: dict[str, float] = {}
    for run in runs:
        if "contact.row" not in run.arrays:
            continue
        first = _first_rows(run)
        models: dict[str, float] = {}
        for body, row in zip(run.world.bodies, first, strict=True):
            if row >= 0:
                models[body.model] = min(models.get(body.model, np.inf), float(run.time[row]))
        for body in run.world.bodies:
            if body.model in models:
                touched[body.name] = min(touched.get(body.name, np.inf), models[body.model])
    return {name: touched[name] for name in names if name in touched}


def _first_rows(run: Run) -> np.ndarray:
    """The first row with a contact of each body (bodies,); −1 where there is none."""
    row, body = run.arrays["contact.row"], run.arrays["contact.body"]
    first = np.full(len(run.world.bodies), -1, dtype=np.int64)
    for part in parts(len(row), CONTACT_BYTES, row, body):
        touching = body[part].astype(np.int64).ravel()
        new = np.flatnonzero(first[touching] < 0)
        bodies, place = np.unique(touching[new], return_index=True)
        first[bodies] = row[part][new[place] // 2]
        if (first >= 0).all():
            break
    return first


@dataclass(frozen=True, slots=True)
class FirstContactDifference:
    """The first common time (s) at which other pairs touch in one run than in the other: the pairs that touch in the first
    only,
    and in the second only, by the names of :class:`simspec.comparison.sides.Sides`."""

    time: float
    first_only: tuple[tuple[str, str], ...]
    second_only: tuple[tuple[str, str], ...]


def first_difference(common: Common, a: Run, b: Run, by: str = "shape") -> FirstContactDifference | None:
    """The first common time at which other pairs of shapes (or what of them both runs tell) touch in one run than in the other;
    None where the same do at all times, or contacts were not recorded."""
    if "contact.row" not in a.arrays or "contact.row" not in b.arrays:
        return None
    known = common_sides((a, b), by)
    count = len(known.names)
    sides = sides_of((a, b), (common.rows_a, common.rows_b), known)
    first, arrays = 0, [one for side in sides for one in (side.row, side.own, side.rows)]
    while first < common.rows:
        last = min(common.rows, *(side.until(first) for side in sides))
        one, other = (side.pairs(first, last, count) for side in sides)
        different = np.setxor1d(one, other, assume_unique=True)
        if len(different):
            row = different.min() // count**2
            alone = different[different // count**2 == row]
            of_first = np.isin(alone, one)
            time = float(common.time(np.array([row]))[0])
            only = [
                tuple(sorted(named_pair(known.names, int(pair) % count**2) for pair in chosen))
                for chosen in (alone[of_first], alone[~of_first])
            ]
            return FirstContactDifference(time, only[0], only[1])
        first = last
        for array in arrays:
            release(array)
    return None


def named_pair(names: Sequence[str], number: int) -> tuple[str, str]:
    """The names (sorted) of a pair, from its number: one · names + other."""
    one, other = sorted(names[index] for index in divmod(number, len(names)))
    return one, other


def sides_of(runs: Sequence[Run], rows: Sequence[np.ndarray], known: Sides) -> list[Side]:
    """The contacts of each run at the given rows of it (of common times), by the sides that all tell."""
    sides = zip(runs, rows, known.arrays, known.numbers, strict=True)
    return [Side(run, own_rows, array, index) for run, own_rows, array, index in sides]


class Side:
    """The contacts of a run. ``rows``: its rows that are of common times; ``array``: its own sides, ``index``: their
    numbers."""

    def __init__(self, run: Run, rows: np.ndarray, array: str, index: np.ndarray):
        self.row, self.own = run.arrays["contact.row"], run.arrays[array]
        self.rows, self._index, self._force = rows, index, run.arrays["contact.normal_force"]

    def until(self, first: int) -> int:
        """The end of a block of common rows from ``first`` on: one row, or as many as have no more contacts than a block."""
        last = int(np.searchsorted(self.row, self.rows[first])) + block_rows(CONTACT_BYTES)
        if last >= len(self.row):
            return len(self.rows)
        return max(first + 1, int(np.searchsorted(self.rows, self.row[last])))

    def pairs(self, first: int, last: int, count: int) -> np.ndarray:
        """What touches at the common rows ``first`` … ``last − 1``: each pair once for each row, as the number
        (row · count + one) · count + other; ``count``: how many sides there are."""
        at, pair, _ = self._contacts(first, last, count)
        return np.unique(at * count**2 + pair)

    def forces(self, first: int, last: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Every contact at the common rows ``first`` … ``last − 1``: its common row (n,), its pair as the number
        one · count + other (n,), and its normal force (n,), N."""
        at, pair, chosen = self._contacts(first, last, count)
        return at, pair, self._force[chosen]

    def _contacts(self, first: int, last: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Common row, number of the pair, and place in the run's arrays of every contact, (n,) each."""
        begin, end = np.searchsorted(self.row, [self.rows[first], self.rows[last - 1] + 1])
        row = self.row[begin:end]
        at = first + np.searchsorted(self.rows[first:last], row)
        common = self.rows[at] == row
        pair = np.sort(self._index[self.own[begin:end].astype(np.int64)], axis=1)
        return at[common], (pair[:, 0] * count + pair[:, 1])[common], begin + np.flatnonzero(common)
