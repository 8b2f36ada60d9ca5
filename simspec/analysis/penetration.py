"""How deep bodies overlap in a run: the deepest, over time, by pair, and for how long."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.analysis.contacts import Pair, demand_contacts, durations, pair_numbers
from simspec.comparison.contacts import CONTACT_BYTES, named_pair
from simspec.comparison.sides import common_sides
from simspec.mapped import parts
from simspec.runner.metrics import Penetration, deepest_penetration
from simspec.runner.run import Run


@dataclass(frozen=True)
class Depths:
    """Overlaps of a run.

    deepest  the deepest of all: depth (m), time (s), bodies (:func:`simspec.runner.metrics.deepest_penetration`)
    depth    (rows,) the deepest overlap of each recorded row, m; 0 where nothing overlaps
    pairs    the deepest overlap (m) of each pair that overlapped, of shapes where the run tells them
    mean     the mean depth (m) over the time in which something overlaps; 0 where nothing ever does
    """

    deepest: Penetration
    depth: NDArray[np.float64]
    pairs: dict[Pair, float]
    mean: float
    _lasting: NDArray[np.float64]

    def share_deeper(self, depth: float) -> float:
        """The share of the recorded time in which something overlaps by more than ``depth`` (m)."""
        total = float(self._lasting.sum())
        return float(self._lasting[self.depth > depth].sum()) / total if total else 0.0


def penetration(run: Run) -> Depths:
    """The overlaps of a run. Raises SpecError where contacts were not recorded. A distance that is not a number is infinitely
    deep: it hides any other."""
    demand_contacts(run)
    row, distance = run.arrays["contact.row"], run.arrays["contact.distance"]
    depth = np.zeros(len(run.time))
    pairs: dict[int, float] = {}
    sides = common_sides([run])
    for part in parts(len(row), CONTACT_BYTES, row, distance, run.arrays[sides.arrays[0]]):
        overlap = -distance[part]
        overlap = np.where(np.isnan(overlap), np.inf, overlap)
        np.maximum.at(depth, row[part].astype(np.int64), overlap)
        kinds, place = np.unique(pair_numbers(run, part, sides), return_inverse=True)
        largest = np.zeros(len(kinds))
        np.maximum.at(largest, place, overlap)
        for kind, value in zip(kinds.tolist(), largest.tolist(), strict=True):
            if value > 0.0:
                pairs[kind] = max(pairs.get(kind, 0.0), value)
    lasting = durations(run)
    overlapping = lasting * (depth > 0.0)
    inside = overlapping > 0.0
    mean = float((depth[inside] * overlapping[inside]).sum() / overlapping.sum()) if inside.any() else 0.0
    named = {named_pair(sides.names, kind): value for kind, value in pairs.items()}
    return Depths(deepest_penetration(run.world, run.arrays), depth, named, mean, lasting)
