"""How fast an engine was: factors of real time, load and memory of processes, and their spread over repeats.

Each run was a process of its own. Figures of two machines are never put together.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.analysis.tables import LEVEL, Interval, Spread, ratio, spread
from simspec.comparison.floor import FLOOR_FACTOR
from simspec.comparison.runs import QUANTITIES, summary
from simspec.engines.kit.arrays import SECONDS
from simspec.errors import Problem, SpecError
from simspec.language.strict import near
from simspec.runner.expectations import evaluate
from simspec.runner.metrics import contact_counts
from simspec.runner.run import Run
from simspec.world.kinematics import coordinates
from simspec.world.types import World

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
    """The machine of a run by its provenance: its hardware where the run was timed alone,
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

    Raises SpecError for no runs, for runs of several engines or timesteps, for runs on several machines, and where a figure
    was measured in some processes only.
    """
    if not runs:
        raise SpecError([Problem("there are no runs to take the speed of", code="R106")])
    _demand_single("engines", {run.label for run in runs})
    _demand_single("timesteps", {f"{run.world.physics.timestep:g} s" for run in runs})
    _demand_single("machines", {machine_of(run.provenance) for run in runs})
    whole = [process_figures(run) for run in runs if run.failed is None]
    figures = {}
    for name in FIGURES:
        values = [getattr(figures, name) for figures in whole]
        measured = [value for value in values if value is not None]
        if not measured:
            continue
        if len(measured) < len(values):
            missing = f"{len(values) - len(measured)} of {len(values)} processes"
            raise SpecError([Problem(f"{runs[0].label}: {name} was not measured in {missing}", code="R106")])
        figures[name] = spread(measured, level)
    first = runs[0]
    where = machine_of(first.provenance)
    return Speed(first.label, first.world.physics.timestep, where, figures, len(whole), len(runs) - len(whole))


def _demand_single(what: str, values: Iterable[str]) -> None:
    given = sorted(values)
    if len(given) > 1:
        hint = "take the speed of each alone"
        raise SpecError(
            [Problem(f"runs of several {what} have no common speed", found=" / ".join(given), hint=hint, code="R105")]
        )


def speed_ratio(first: Speed, second: Speed, name: str = "real_time_factor", level: float = LEVEL) -> Interval | None:
    """How many times larger a figure of the first is than of the second, with Welch's interval over processes; None
    where either has fewer than two processes. Raises SpecError for two machines."""
    _demand_single("machines", {first.machine, second.machine})
    return ratio(first[name], second[name], level)


# Speed over simulated time: cost of the steps between records, and contacts there.

Numbers = NDArray[np.float64]
INTERVALS = 20
"""Intervals of a table, at most."""


@dataclass(frozen=True)
class Paced:
    """The data of a run that costs follow from, without its states: recorded times (rows,), s; ``seconds`` (rows,
    ``SECONDS``), None where the engine's program does not say; number of contact points (rows,), None where not recorded."""

    label: str
    time: Numbers
    seconds: Numbers | None
    contacts: NDArray[np.int64] | None


def paced(run: Run) -> Paced:
    """That of a run. Raises SpecError where it recorded nothing."""
    if not run.recorded:
        raise SpecError([Problem(f"{run.label} recorded nothing: {run.failed}", code="R106")])
    contacts = contact_counts(run.arrays) if "contact.row" in run.arrays else None
    seconds = None if run.seconds is None else np.array(run.seconds)
    return Paced(run.label, np.array(run.time), seconds, contacts)


@dataclass(frozen=True)
class Pace:
    """Speed over simulated time. ``intervals``: begin and end of each, s. For each the median over runs: ``seconds`` that were
    spent in it, by the names of ``SECONDS``; simulated time over wall and processor time of the steps; the mean number of
    contact points in its records. None where it was not measured in every run, or was too short for the clock."""

    label: str
    intervals: tuple[tuple[float, float], ...]
    seconds: dict[str, tuple[float | None, ...]]
    real_time_factors: tuple[float | None, ...]
    cpu_factors: tuple[float | None, ...]
    contacts: tuple[float | None, ...]


def over_time(runs: Sequence[Paced], intervals: int = INTERVALS) -> Pace:
    """The speed over time of repeats of one run, in at most so many ``intervals`` of equally many records (the last may have
    fewer).

    Raises SpecError for no runs, for runs of several engines, and for runs that recorded at different times.
    """
    _demand_repeats(runs)
    first = runs[0]
    rows = len(first.time) - 1
    each = max(1, -(-rows // intervals))
    edges = [*range(0, rows, each), rows]
    parts = list(itertools.pairwise(edges))
    spent = {
        name: tuple(_median([_spent(run, column, part) for run in runs]) for part in parts)
        for column, name in enumerate(SECONDS)
    }
    passed = [float(first.time[end] - first.time[begin]) for begin, end in parts]
    return Pace(
        first.label,
        tuple((float(first.time[begin]), float(first.time[end])) for begin, end in parts),
        spent,
        tuple(_factor(*pair) for pair in zip(passed, spent["step"], strict=True)),
        tuple(_factor(*pair) for pair in zip(passed, spent["step_cpu"], strict=True)),
        tuple(_median([_contacts(run, part) for run in runs]) for part in parts),
    )


def _demand_repeats(runs: Sequence[Paced]) -> None:
    if not runs:
        raise SpecError([Problem("there are no runs to take the speed of", code="R106")])
    first = runs[0]
    for run in runs:
        if run.label != first.label or not np.array_equal(run.time, first.time):
            raise SpecError(
                [Problem("speed over time needs runs of one engine that recorded at the same times", code="R106")]
            )


def _spent(run: Paced, column: int, part: tuple[int, int]) -> float | None:
    return None if run.seconds is None else float(run.seconds[part[1], column] - run.seconds[part[0], column])


def _contacts(run: Paced, part: tuple[int, int]) -> float | None:
    return None if run.contacts is None else float(run.contacts[part[0] + 1 : part[1] + 1].mean())


def _median(values: Sequence[float | None]) -> float | None:
    measured = [value for value in values if value is not None]
    return median(measured) if len(measured) == len(values) else None


def _factor(passed: float, spent: float | None) -> float | None:
    return passed / spent if spent else None


@dataclass(frozen=True)
class StepCost:
    """The cost of a step, in seconds by the names of ``SECONDS``, over repeats of one run, which do the same arithmetic.

    quiet   of each interval between two records the fastest repeat: a disturbance of the machine for a while affects one of
    them median  of the repeats as they were
    """

    label: str
    steps: int
    repeats: int
    quiet: dict[str, float]
    median: dict[str, float]


def step_cost(runs: Sequence[Paced], steps: int) -> StepCost | None:
    """The cost of a step of runs of so many ``steps``; None where a run was not measured, or has no step.

    Raises SpecError for no runs, for runs of several engines, and for runs that recorded at different times: they are not the
    same arithmetic.
    """
    _demand_repeats(runs)
    measured = [run.seconds for run in runs if run.seconds is not None]
    if len(measured) < len(runs) or not steps:
        return None
    spent = np.stack([np.diff(seconds, axis=0) for seconds in measured])
    fastest, whole = spent.min(axis=0).sum(axis=0), np.median(spent.sum(axis=1), axis=0)
    quiet, usual = (
        {name: float(value) / steps for name, value in zip(SECONDS, entry, strict=True)} for entry in (fastest, whole)
    )
    return StepCost(runs[0].label, steps, len(runs), quiet, usual)


# Figures of a run by name, as in tables, baselines and runs: ``deepest penetration``, ``expectation 1 displacement``,
# ``arm.z``.

MOST_NAMED = 40
"""Names that an error lists; the others are counted."""


@dataclass(frozen=True, slots=True)
class RunFigure:
    """``value`` in ``unit``; ``size``: of the numbers that it was computed from, which says what round-off can be in it."""

    value: float
    unit: str
    size: float


def figure_names(world: World) -> list[str]:
    """The names of the figures that runs of ``world`` may have."""
    known = coordinates(world)
    expected = [_expected(number, expectation.kind) for number, expectation in enumerate(world.expectations, 1)]
    return [*expected, *(name for name, _ in QUANTITIES), *known.q, *known.v]


def find_figure(world: World, word: str) -> str:
    """The figure that ``word`` names: its name, the name with ``_`` or ``-`` for blanks, an expectation by its number or, where
    there is one of the kind, by its kind. Raises SpecError with the names that there are."""
    names = figure_names(world)
    if word in names:
        return word
    kinds = [expectation.kind for expectation in world.expectations]
    found = {_plain(name): name for name in reversed(names)}
    for number, kind in enumerate(kinds, 1):
        found[_plain(f"expectation {number}")] = _expected(number, kind)
        if kinds.count(kind) == 1:
            found.setdefault(_plain(kind), _expected(number, kind))
    if (name := found.get(_plain(word))) is not None:
        return name
    text = ", ".join(names[:MOST_NAMED]) + (f", and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")
    problem = Problem(
        f"no run of {world.name} has a figure {word!r}", found=word, allowed=text, hint=near(word, names), code="R108"
    )
    raise SpecError([problem])


def read_figure(run: Run, name: str) -> RunFigure:
    """The figure ``name`` (:func:`figure_names`) of a run. Raises SpecError where the run does not have it."""
    if name in run.coordinates.q_columns or name in run.coordinates.v_columns:
        return _coordinate(run, name)
    for number, outcome in enumerate(evaluate(run), 1):
        if name != _expected(number, outcome.kind):
            continue
        if outcome.measured is None:
            raise SpecError([Problem(f"{name} was not measured: {outcome.detail}", code="R106")])
        return RunFigure(outcome.measured, outcome.unit, _largest(run, outcome.unit, outcome.measured))
    values, units = summary(run), dict(QUANTITIES)
    if name not in values:
        raise SpecError(
            [Problem(f"this run has no {name}: its channels were not recorded", hint="record.channels", code="R107")]
        )
    return RunFigure(values[name], units[name], alike_size(values, units[name]))


def half_width(run: Run, size: float, noise: float) -> float:
    """Half of the interval of numbers that are not distinguished from one of this ``size``: between two of them lies
    ``FLOOR_FACTOR`` times the ``noise`` of repeats, and at least :func:`rounding` on each side."""
    return max(0.5 * FLOOR_FACTOR * noise, rounding(run, size))


def rounding(run: Run, size: float) -> float:
    """Round-off that another processor may add: one rounding in each step, of a number of this size."""
    return float(run.provenance.get("steps", len(run.time))) * 2.0**-52 * size


def alike_size(values: Mapping[str, float], unit: str) -> float:
    """The largest of all quantities of one unit: a small one of them may be the difference of large ones."""
    units = dict(QUANTITIES)
    return max(
        (abs(value) for name, value in values.items() if units[name] == unit and math.isfinite(value)), default=0.0
    )


def _expected(number: int, kind: str) -> str:
    return f"expectation {number} {kind}"


def _plain(word: str) -> str:
    return " ".join(word.replace("_", " ").replace("-", " ").replace(",", " ").casefold().split())


def _coordinate(run: Run, name: str) -> RunFigure:
    position = name in run.coordinates.q_columns
    array, columns = ("q", run.coordinates.q_columns) if position else ("v", run.coordinates.v_columns)
    value = float(run.arrays[array][-1, columns[name]][0])
    unit = dict(_units(run.world, position)).get(columns[name].start, "")
    return RunFigure(value, unit, _largest(run, unit, value))


def _units(world: World, position: bool) -> Iterator[tuple[int, str]]:
    """The unit of each column of q, or of v."""
    known = coordinates(world)
    columns = known.q_columns if position else known.v_columns
    kinds = {body.joint.name: body.joint.kind for body in world.bodies}
    for joint, kind in kinds.items():
        if joint not in columns:
            continue
        part = columns[joint]
        for offset, column in enumerate(range(part.start, part.stop)):
            linear = kind == "slide" or (kind == "free" and offset < 3)
            angle = "rad" if kind == "hinge" or not position else ""
            yield column, ("m" if linear else angle) + ("" if position else "/s")


def _largest(run: Run, unit: str, value: float) -> float:
    """The largest number in a run that a figure of ``unit`` may be computed from."""
    last = {"m": ("pose", slice(0, 3)), "m/s": ("velocity", slice(0, 3)), "rad/s": ("velocity", slice(3, 6))}
    if unit not in last or not run.recorded:
        return max(1.0, abs(value)) if unit in ("", "rad") else abs(value)
    array, part = last[unit]
    return max(abs(value), float(np.abs(run.arrays[array][-1, :, part]).max(initial=0.0)))
