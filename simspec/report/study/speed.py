"""Speed and load by timestep, beside figures from elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from rich.table import Table

from simspec.analysis.speed import Speed
from simspec.report.kit import number, table
from simspec.report.study.done import Done, Record, Shown, elsewhere, figure_at, figure_records, milliseconds, speeds_of

FACTORS = {
    "real_time_factor": "Real-time factor: simulated time over the wall time of the steps",
    "cpu_factor": "The same over the steps' processor time",
}
LOADS = ("step_load", "process_load", "peak_memory")


def speed_tables(done: Done) -> list[Shown]:
    """``speed.real_time_factor`` and ``speed.cpu_factor``."""
    speeds = speeds_of(done)
    return [
        Shown(f"speed.{name}", _by_timestep(done, speeds, name, title), _records(done, speeds, [name]))
        for name, title in FACTORS.items()
    ]


def _by_timestep(done: Done, speeds: Mapping[float, Mapping[str, Speed]], name: str, title: str) -> Table:
    figures = [figure for figure in done.figures if figure.quantity == name and figure.timesteps is not None]
    heads = [*done.engines, *(elsewhere(figure) for figure in figures)]
    made = table(f"{done.sweep.name}: {title}", "timestep", *heads, right=range(1 + len(heads)))
    for timestep, own in speeds.items():
        cells = [
            str(own[engine][name]) if engine in own and name in own[engine].figures else "–" for engine in done.engines
        ]
        made.add_row(milliseconds(timestep), *cells, *(number(figure_at(figure, timestep)) for figure in figures))
    made.caption = "Median, interval of the mean (95 %), and over how many processes"
    return made


def load_tables(done: Done) -> list[Shown]:
    """``load``."""
    columns = ("timestep", "engine", "load of the steps", "load of the process", "peak memory")
    made = table(f"{done.sweep.name}: Load of the processor and memory", *columns, right=(0, 2, 3, 4))
    speeds = speeds_of(done)
    for timestep, engines in speeds.items():
        for engine, own in engines.items():
            loads = [
                f"{own[name].median:.0%}" if name in own.figures else "–" for name in ("step_load", "process_load")
            ]
            memory = f"{own['peak_memory'].median / 2**20:.0f} MiB" if "peak_memory" in own.figures else "–"
            made.add_row(milliseconds(timestep), engine, *loads, memory)
    made.caption = (
        "Processor time over wall time: 100 % is one processor that was never taken away. Medians over processes"
    )
    return [Shown("load", made, _records(done, speeds, LOADS))]


def _records(done: Done, speeds: Mapping[float, Mapping[str, Speed]], names: Iterable[str]) -> list[Record]:
    """The figures ``names`` of each timestep and engine, with their interval and the values of the processes; and those from
    elsewhere."""
    records: list[Record] = []
    for timestep, engines in speeds.items():
        for engine, own in engines.items():
            for name in names:
                if name in own.figures:
                    spread = own[name]
                    interval = spread.mean
                    records.append(
                        {"timestep": timestep, "engine": engine, "quantity": name, "median": spread.median}
                        | {"lower": interval.lower if interval else None, "upper": interval.upper if interval else None}
                        | {"values": list(spread.values)}
                    )
    return records + figure_records(figure for figure in done.figures if figure.quantity in names)
