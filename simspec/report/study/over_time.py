"""Speed over simulated time, with the number of contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from simspec.analysis.pace import Paced, over_time, paced
from simspec.report.kit import number, table
from simspec.report.study.done import Done, Record, Shown, milliseconds


def over_time_tables(done: Done) -> list[Shown]:
    """``over_time``; of runs of several timesteps or durations a table each, ``over_time.4ms.2s``."""
    runs: dict[tuple[float, float], dict[str, list[Paced]]] = {}
    for cell, row in done.runs(whole=True):
        about = (row.timestep, row.steps * row.timestep)
        own = runs.setdefault(about, {}).setdefault(cell.engine, [])
        own.append(paced(done.store.load(row.key)))
    several = len(runs) > 1
    return [
        _shown(done, about[0], own, f"over_time.{1e3 * about[0]:g}ms.{about[1]:g}s" if several else "over_time")
        for about, own in sorted(runs.items(), key=lambda item: item[0])
    ]


def _shown(done: Done, timestep: float, runs: Mapping[str, Sequence[Paced]], name: str) -> Shown:
    paces = {engine: over_time(runs[engine]) for engine in done.engines if engine in runs}
    heads = [head for engine in paces for head in (f"{engine}, real time", "contacts")]
    title = f"{done.sweep.name}: Real-time factor over time, timestep {milliseconds(timestep)}"
    made = table(title, "time", *heads, right=range(1 + len(heads)))
    records: list[Record] = []
    for index, (begin, end) in enumerate(next(iter(paces.values())).intervals):
        cells = []
        for engine, pace in paces.items():
            factor, contacts = pace.cpu_factors[index], pace.contacts[index]
            cells += [number(factor), "–" if contacts is None else f"{contacts:.0f}"]
            records.append(
                {"timestep": timestep, "begin": begin, "end": end, "engine": engine, "contacts": contacts}
                | {"cpu_factor": factor, "real_time_factor": pace.real_time_factors[index]}
                | {f"{kind}_seconds": values[index] for kind, values in pace.seconds.items()}
            )
        made.add_row(f"{begin:g} to {end:g} s", *cells)
    counts = sorted({len(own) for own in runs.values()})
    made.caption = (
        f"Simulated time over processor time of the steps, median of {', '.join(map(str, counts))} runs; – where it was not "
        "measured. Contacts: points, the mean of the records"
    )
    return Shown(name, made, records)
