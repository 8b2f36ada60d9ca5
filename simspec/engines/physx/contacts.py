"""Contacts as PhysX reports them, and the speed at which it may undo each body's overlaps, by the common law."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.engines.kit.arrays import ContactRow, contact_arrays
from simspec.engines.physx.units import LEAST, SCALE

# Contacts as PhysX reports them, in its unit of length: of the beginning of its last step, with that step's impulses.

ERROR_REDUCTION = 0.01
"""β of the common law (:class:`simspec.world.types.Hardness`)."""


@dataclass(frozen=True)
class PhysxDepths:
    """Overlaps of pairs of bodies. ``rows`` (n, 2), sorted, of those that move, −1 of what cannot; ``depth`` (n,) in m, above
    zero: the deepest of each pair."""

    rows: np.ndarray
    depth: np.ndarray


class PhysxRecovery:
    """How fast each of ``count`` bodies may be pushed out of what it overlaps in the next step, by the common law.

    By the law an overlap d is (1 − β) d after the step. A deeper overlap is left over by PhysX's sweeps: it begins
    each step anew, so that a stack would sink in by a hundred times that. So the speed is (β d + what is left over) / dt, of
    the most demanding pair of each body. PhysX takes the slower of two bodies'.
    """

    def __init__(self, count: int, timestep: float):
        self._count, self._timestep = count, timestep
        self._pairs, self._owed = np.zeros(0, dtype=np.int64), np.zeros(0)
        self.speeds = np.full(count, LEAST)
        """m/s, of each body."""

    def begin(self, found: PhysxDepths) -> None:
        """Go by overlaps of the present state: all of them are as the law has them."""
        self._pairs, self._owed = self._keys(found.rows), found.depth
        self._set(found.rows, ERROR_REDUCTION * found.depth)

    def go_on(self, found: PhysxDepths) -> None:
        """Go by the overlaps ``found`` where the last step began."""
        keys = self._keys(found.rows)
        owed, known = found.depth.copy(), np.zeros(len(keys), dtype=bool)
        if len(self._pairs):
            at = np.minimum(np.searchsorted(self._pairs, keys), len(self._pairs) - 1)
            known = self._pairs[at] == keys
            owed[known] = np.minimum(self._owed[at[known]], owed[known])
        left = found.depth - owed
        # the last step has undone as much of what was not known as it was allowed to
        undone = np.append(self.speeds, np.inf)[found.rows].min(axis=1, initial=np.inf) * self._timestep
        owed = np.where(known, (1.0 - ERROR_REDUCTION) * owed, np.maximum(0.0, owed - undone))
        self._pairs, self._owed = keys, owed
        self._set(found.rows, ERROR_REDUCTION * owed + left)

    def _keys(self, rows: np.ndarray) -> np.ndarray:
        found: np.ndarray = (rows[:, 0] + 1) * (self._count + 1) + rows[:, 1] + 1
        return found

    def _set(self, rows: np.ndarray, way: np.ndarray) -> None:
        speeds = np.zeros(self._count + 1)
        np.maximum.at(speeds, rows[:, 0], way)
        np.maximum.at(speeds, rows[:, 1], way)
        self.speeds = np.maximum(LEAST, speeds[: self._count] / self._timestep)


def depths(contacts: Sequence[Any], rows: Mapping[Any, int]) -> PhysxDepths:
    """The overlaps among contacts; ``rows``: of the actors that move."""
    # most of a step's time after PhysX's: each call of SAPIEN costs 0.1 to 0.8 µs
    ends: list[int] = []
    least: list[float] = []
    row_of = rows.get
    for contact in contacts:
        deepest = 0.0
        for point in contact.points:
            deepest = min(deepest, point.separation)
        if deepest < 0.0:
            entry, other = contact.bodies
            ends += row_of(entry, -1), row_of(other, -1)
            least.append(deepest)
    pairs = np.sort(np.array(ends, dtype=np.int64).reshape(-1, 2), axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, separations = pairs[order], np.array(least, dtype=float)[order]
    if len(pairs) < 2:
        return PhysxDepths(pairs, -separations / SCALE)
    begins = np.flatnonzero(np.append(True, (pairs[1:] != pairs[:-1]).any(axis=1)))
    return PhysxDepths(pairs[begins], -np.minimum.reduceat(separations, begins) / SCALE)


def pressed(contacts: Sequence[Any], rows: Mapping[Any, int], requested: Collection[int]) -> set[int]:
    """Those of the ``asked`` rows on which some contact acts."""
    found: set[int] = set()
    open_rows = set(requested)
    for contact in contacts:
        mine = [row for body in contact.bodies if (row := rows.get(body, -1)) in open_rows]
        if mine and any(any(point.impulse.tolist()) for point in contact.points):
            found.update(mine)
            open_rows.difference_update(mine)
    return found


def contact_rows(
    contacts: Sequence[Any], units: Mapping[Any, int], bodies: Sequence[int], timestep: float
) -> dict[str, np.ndarray]:
    """The arrays of :meth:`Engine.contacts`; ``units``: the number of each shape, ``bodies``: by that, the row of its body."""
    rows: list[ContactRow] = []
    for contact in contacts:
        index, other = (units[shape] for shape in contact.shapes)
        for point in contact.points:
            normal = np.array(point.normal, dtype=float)
            force = max(0.0, float(normal @ np.array(point.impulse, dtype=float))) / (SCALE * timestep)
            if point.separation > 0.0 and not force > 0.0:
                continue
            towards = normal if index < other else -normal  # from the second to the first
            at = np.array(point.position, dtype=float) / SCALE
            rows.append(((min(index, other), max(index, other)), at, towards, point.separation / SCALE, force))
    return contact_arrays(rows, bodies)


def touching_pairs(contacts: Sequence[Any], units: Mapping[Any, int]) -> np.ndarray:
    """Pairs (n, 2) of the numbers of shapes that touch."""
    found = [
        tuple(units[shape] for shape in contact.shapes)
        for contact in contacts
        if any(point.separation <= 0.0 for point in contact.points)
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2)
