"""How fast an engine was: factors of real time, load and memory of processes, and their spread over repeats.

Each run was a process of its own. Figures of two machines are never put together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from simspec.analysis.intervals import LEVEL, Interval, Spread, ratio, spread
from simspec.errors import Problem, SpecError
from simspec.runner.run import Run

FIGURES = {
    "real_time_factor": "",
    "cpu_factor": "",
    "end_to_end_factor": "",
    "step_load": "",
    "process_load": "",
    "peak_memory": "bytes",
}
"""Figures of a process, with their units.

real_time_factor   simulated time over the wall time of the step calls (Körber et al. 2021)
cpu_factor         simulated time over the processor time of the step calls, of all threads
end_to_end_factor  simulated time over the wall time of the whole process: start, load, steps, records, end
step_load          processor time over wall time of the step calls: 1 is one core that was never taken away
process_load       processor time (user and system) over wall time of the whole process
peak_memory        largest resident memory of the process
"""
MACHINE = ("platform", "machine")
"""Entries of the provenance that tell one machine from another, of a run that was not timed by itself."""
TIMED, HARDWARE = "timed", ("cpu", "architecture", "cores", "threads", "governor")
"""Where the provenance of a run that was timed alone describes the machine, and what of that must be equal."""


@dataclass(frozen=True, slots=True)
class ProcessFigures:
    """The figures of one process (:data:`FIGURES`); None where it was not measured."""

    real_time_factor: float | None
    cpu_factor: float | None
    end_to_end_factor: float | None
    step_load: float | None
    process_load: float | None
    peak_memory: float | None


def process_figures(run: Run) -> ProcessFigures:
    """The figures of the process of a run, from its provenance."""
    seconds: Mapping[str, float] = run.provenance.get("seconds", {})
    usage: Mapping[str, float] = run.provenance.get("usage", {})
    both = [usage.get(name) for name in ("cpu_user", "cpu_system")]
    processor = sum(value for value in both if value is not None) if None not in both else None
    return ProcessFigures(
        run.real_time_factor,
        run.cpu_factor,
        run.end_to_end_factor,
        _load(seconds.get("cpu"), seconds.get("step")),
        _load(processor, seconds.get("process")),
        usage.get("peak_memory"),
    )


def _load(processor: float | None, wall: float | None) -> float | None:
    return processor / wall if processor is not None and wall else None


def machine_of(provenance: Mapping[str, Any]) -> str:
    """What a run's provenance says of the machine that it ran on: its hardware where the run was timed alone,
    otherwise its system and architecture."""
    timed = provenance.get(TIMED)
    if timed is not None:
        return ", ".join(f"{name} {timed['machine'][name]}" for name in HARDWARE)
    return ", ".join(str(provenance.get(name, "unknown")) for name in MACHINE)


@dataclass(frozen=True)
class Speed:
    """One world in one engine on one machine, over processes.

    ``figures``: by name (:data:`FIGURES`), of the processes that measured it; a name is missing where none did.
    ``failed``: processes without a whole result, which have no figures.
    """

    engine: str
    timestep: float
    machine: str
    figures: Mapping[str, Spread]
    processes: int
    failed: int

    def __getitem__(self, name: str) -> Spread:
        """The spread of one figure. Raises KeyError where no process measured it."""
        return self.figures[name]


def speed(runs: Sequence[Run], level: float = LEVEL) -> Speed:
    """The speed of one engine from repeated runs of one world, each in a process of its own.

    Raises SpecError for no runs, for runs of several engines or timesteps, for runs on several machines, and where a
    figure was
    measured in some processes only.
    """
    if not runs:
        raise SpecError([Problem("there are no runs to take the speed of")])
    _demand_one("engines", {run.label for run in runs})
    _demand_one("timesteps", {f"{run.world.physics.timestep:g} s" for run in runs})
    _demand_one("machines", {machine_of(run.provenance) for run in runs})
    whole = [process_figures(run) for run in runs if run.failed is None]
    figures = {}
    for name in FIGURES:
        values = [getattr(one, name) for one in whole]
        measured = [value for value in values if value is not None]
        if not measured:
            continue
        if len(measured) < len(values):
            missing = f"{len(values) - len(measured)} of {len(values)} processes"
            raise SpecError([Problem(f"{runs[0].label}: {name} was not measured in {missing}")])
        figures[name] = spread(measured, level)
    first = runs[0]
    where = machine_of(first.provenance)
    return Speed(first.label, first.world.physics.timestep, where, figures, len(whole), len(runs) - len(whole))


def _demand_one(what: str, values: Iterable[str]) -> None:
    told = sorted(values)
    if len(told) > 1:
        hint = "take the speed of each alone"
        raise SpecError([Problem(f"runs of several {what} have no common speed", found=" / ".join(told), hint=hint)])


def speed_ratio(first: Speed, second: Speed, name: str = "real_time_factor", level: float = LEVEL) -> Interval | None:
    """How many times larger a figure of the first is than of the second, with Welch's interval over processes; None
    where either has fewer than two processes. Raises SpecError for two machines."""
    _demand_one("machines", {first.machine, second.machine})
    return ratio(first[name], second[name], level)
