"""Speed over time, from runs of several durations, with the number of contacts."""

from __future__ import annotations

import itertools
from statistics import median

import numpy as np

from simspec.experiments.index import Row
from simspec.report.kit import number, table
from simspec.report.study.done import Done, Record, Shown


def over_time_tables(done: Done) -> list[Shown]:
    """``over_time``: the cost of each interval is the difference of the costs of two runs that end at its ends."""
    costs: dict[str, dict[float, list[float]]] = {engine: {} for engine in done.engines}
    longest: dict[str, Row] = {}
    for cell, row in done.runs(whole=True):
        if row.cpu_seconds is not None:
            costs[cell.engine].setdefault(round(row.steps * row.timestep, 9), []).append(row.cpu_seconds)
        if cell.engine not in longest or row.steps > longest[cell.engine].steps:
            longest[cell.engine] = row
    heads = [head for engine in done.engines for head in (f"{engine}, real time", "contacts")]
    made = table(f"{done.sweep.name}: Real-time factor over time", "time", *heads, right=range(1 + len(heads)))
    times = sorted({time for own in costs.values() for time in own})
    counted = {engine: _contacts(done, row) for engine, row in longest.items()}
    records: list[Record] = []
    for begin, end in itertools.pairwise([0.0, *times]):
        cells = []
        for engine in done.engines:
            own = {0.0: [0.0], **costs[engine]}
            spent = median(own[end]) - median(own[begin]) if begin in own and end in own else 0.0
            factor = (end - begin) / spent if spent > 0.0 else None
            contacts = _mean(counted.get(engine), begin, end)
            cells += [number(factor), "–" if contacts is None else f"{contacts:.0f}"]
            records.append({"begin": begin, "end": end, "engine": engine, "cpu_factor": factor, "contacts": contacts})
        made.add_row(f"{begin:g} to {end:g} s", *cells)
    made.caption = (
        "Simulated time over processor time, from the difference of runs of two durations (medians); – where noise hides it. "
        "Contacts: points, the mean of the records"
    )
    return [Shown("over_time", made, records)]


def _contacts(done: Done, row: Row) -> tuple[np.ndarray, np.ndarray] | None:
    """The recorded times of a run, and how many points of contact there were; None where they were not recorded."""
    arrays = done.store.load(row.key).arrays
    if "contact.row" not in arrays:
        return None
    return arrays["time"], np.bincount(np.asarray(arrays["contact.row"]), minlength=len(arrays["time"]))


def _mean(counted: tuple[np.ndarray, np.ndarray] | None, begin: float, end: float) -> float | None:
    if counted is None:
        return None
    time, count = counted
    inside = (time > begin + 1e-9) & (time <= end + 1e-9)
    return float(count[inside].mean()) if inside.any() else None
