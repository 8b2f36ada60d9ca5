"""Times that are rounded up to whole steps: what ``times: round_up`` of a sweep means, for one run.

`physics.duration`, `record.every` and `trajectory.until` become the next whole number of timesteps. A time of an expectation
becomes that of the next record, or the end of the run where that is earlier.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from simspec.language.engine_options import WHOLE
from simspec.language.expectations import TIMES
from simspec.language.models import MOST_STEPS, Physics
from simspec.language.quantities import Number
from simspec.language.strict import Faults

PARTS = (("physics", "timestep"), ("physics", "duration"), ("record", "every"), ("trajectory", "until"), ("expect",))
"""Places of a spec that roundings follow from."""


@dataclass(frozen=True, slots=True)
class Rounded:
    """A time of a run that is not what the spec says: its dotted path, what is written and what is taken (s)."""

    path: str
    written: float
    taken: float


def concerned(path: str) -> bool:
    """Whether roundings may depend on the value at a dotted path."""
    steps = tuple(path.split("."))
    return any(steps[: len(part)] == part[: len(steps)] for part in PARTS)


def rounded_up(data: Mapping[str, Any]) -> tuple[Rounded, ...]:
    """The times of a spec, as plain data, that are rounded up at its timestep, in the order of the spec's parts. Times that
    are none, or lie after the end of the run, are left to the spec's checks."""
    timestep = _time(data, "physics", "timestep", default=Physics.model_fields["timestep"].default)
    duration = _time(data, "physics", "duration", default=Physics.model_fields["duration"].default)
    if timestep is None or duration is None or timestep <= 0.0 or duration / timestep > MOST_STEPS:
        return ()
    every, until = _time(data, "record", "every"), _time(data, "trajectory", "until")
    grid = _Grid(timestep, duration, every, until)
    made = [grid.rounded(path, time) for path, time in _parts(duration, every, until)]
    made += [grid.recorded(path, time) for path, time in _expected(data.get("expect"))]
    return tuple(one for one in made if one is not None)


def _parts(duration: float, every: float | None, until: float | None) -> Iterator[tuple[str, float]]:
    times = (("physics.duration", duration), ("record.every", every), ("trajectory.until", until))
    yield from ((path, time) for path, time in times if time)


def _expected(entries: Any) -> Iterator[tuple[str, float]]:
    """The times of expectations, by path."""
    for index, entry in enumerate(entries if isinstance(entries, list) else ()):
        for kind, parameters in entry.items() if isinstance(entry, Mapping) else ():
            for name in TIMES:
                time = _time({kind: parameters}, kind, name)
                if time is not None:
                    yield f"expect.{index}.{kind}.{name}", time


def _time(data: Mapping[str, Any], part: str, name: str, default: float | None = None) -> float | None:
    """A time (s) as a spec says it; ``default`` where it does not, None for what is no time."""
    holder = data.get(part, {})
    if not isinstance(holder, Mapping):
        return None
    if name not in holder:
        return default
    try:
        time: float = Number("time", 0).read(holder[name])
    except Faults:
        return None  # reported where the spec is validated
    return time


class _Grid:
    """The steps of a run, those that are recorded, and its end. ``until``: the end of a run that is cut short."""

    def __init__(self, timestep: float, duration: float, every: float | None, until: float | None):
        self._timestep, self._duration = timestep, duration
        self._cut = duration if until is None else min(duration, until)
        self._every = 1 if not every else self._up(every)

    def _up(self, time: float) -> int:
        """The step at a time, or the next one."""
        steps = min(time / self._timestep, 2.0 * MOST_STEPS)
        return math.ceil(steps - WHOLE * max(1.0, steps))

    def _at(self, path: str, time: float, step: int) -> Rounded | None:
        if abs(step - time / self._timestep) <= WHOLE * max(1, step):
            return None
        return Rounded(path, time, float(f"{step * self._timestep:.12g}"))

    def rounded(self, path: str, time: float) -> Rounded | None:
        """A time at the next step."""
        return self._at(path, time, self._up(time))

    def recorded(self, path: str, time: float) -> Rounded | None:
        """A time of the run at the next record, or at the end."""
        if time > self._duration * (1.0 + WHOLE):
            return None
        record = -(-self._up(time) // self._every) * self._every
        end = self._cut if time <= self._cut * (1.0 + WHOLE) else self._duration
        return self._at(path, time, min(record, self._up(end)))
