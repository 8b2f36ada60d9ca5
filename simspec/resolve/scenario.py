"""The rest of the world: time, what to record, what to expect, what to say to engines."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from simspec.errors import Problem
from simspec.spec.expectations import BODIES, KINDS, TIMES, Kind
from simspec.spec.models import EngineOptions as SpecOptions
from simspec.spec.models import Physics as SpecPhysics
from simspec.spec.models import Record as SpecRecord
from simspec.spec.models import whole_steps
from simspec.spec.sources import Source
from simspec.spec.strict import near
from simspec.world.types import Body, EngineOptions, Expectation, Physics, Record


def physics(given: SpecPhysics) -> Physics:
    """Gravity and time, in steps."""
    steps = whole_steps(given.duration, given.timestep)
    if steps is None:
        raise ValueError("a validated duration is a whole number of steps")
    return Physics(given.gravity, given.timestep, steps)


def shortened(time: Physics, until: float | None) -> Physics:
    """The time of a run that ends at ``until`` (s; `trajectory.until`), where that is earlier than its own end."""
    if until is None:
        return time
    steps = whole_steps(until, time.timestep)
    if steps is None:
        raise ValueError("a validated end is a whole number of steps")
    return dataclasses.replace(time, steps=min(time.steps, steps))


def record(given: SpecRecord, time: Physics) -> Record:
    """What to record, and every how many steps."""
    every = 1 if given.every is None else whole_steps(given.every, time.timestep)
    if not every:
        raise ValueError("a validated recording interval is a whole number of steps")
    return Record(every, tuple(sorted(set(given.channels))))


def engines(given: Mapping[str, SpecOptions]) -> tuple[EngineOptions, ...]:
    """Options by engine, sorted."""
    return tuple(
        EngineOptions(
            name,
            tuple(sorted(options.settings.items())),
            tuple(sorted(set(options.accept))),
            tuple(sorted(set(options.outside))),
        )
        for name, options in sorted(given.items())
    )


def expectations(
    source: Source, bodies: Sequence[Body], whole: Physics, time: Physics, recorded: Record
) -> tuple[tuple[Expectation, ...], list[Problem]]:
    """The expectations in the order of the file, and the problems of those that no run could answer.

    ``whole`` is the time of the whole scenario, ``time`` that of the run, which `trajectory.until` may cut short: what looks
    at a later time, or at the end of the whole, is then checked, but not asked of the run.
    """
    names = {body.name for body in bodies}
    found, problems = [], []
    for index, entry in enumerate(source.file.expect):
        kind = next(kind for kind in KINDS if getattr(entry, kind) is not None)
        given = getattr(entry, kind)
        values = {name: getattr(given, name) for name in KINDS[kind].parameters}
        values = {name: value for name, value in values.items() if value is not None}
        path = ("expect", index, kind)
        named = [(values[name], (*path, name), False) for name in BODIES if name in values]
        named += [(body, (*path, "targets", body), True) for body, _ in values.get("targets", ())]
        for body, place, key in named:
            if body not in names:
                message = f"there is no body {body!r}"
                hint = near(body, sorted(names))
                problems.append(source.document.problem(place, message, key=key, found=body, hint=hint))
        asked = time == whole or not _later(KINDS[kind], values, time)
        for name in TIMES:
            if name in values and (why := _not_recorded(values[name], time if asked else whole, recorded)):
                problems.append(
                    source.document.problem((*path, name), why[0], found=f"{values[name]:g} s", allowed=why[1])
                )
        if kind == "momentum_conserved" and any(time.gravity):
            shown = ", ".join(f"{value:g}" for value in time.gravity)
            message = "momentum is conserved without gravity only"
            problems.append(source.document.problem(path, message, found=f"gravity [{shown}] m/s²"))
        if asked:
            found.append(Expectation(kind, tuple(sorted(values.items()))))
    return tuple(found), problems


def _later(kind: Kind, values: Mapping[str, Any], time: Physics) -> bool:
    """Whether an expectation looks at what comes after the run's last step, of a scenario that goes on."""
    if kind.of_end and kind.of_end not in values:
        return True
    return any(round(values[name] / time.timestep) > time.steps for name in TIMES if name in values)


def _not_recorded(at: float, time: Physics, recorded: Record) -> tuple[str, str] | None:
    """Why nothing is recorded at a time, and what would do; every ``every_steps`` steps are, and the last step."""
    end = time.steps * time.timestep
    step = at / time.timestep
    nearest = round(step)
    if nearest > time.steps:
        return "this time is after the end of the run", f"0 to {end:g} s"
    # half a step: what a run is asked for is the record nearest to the time
    every = recorded.every_steps
    if nearest == time.steps or (abs(step - nearest) < 0.5 and nearest % every == 0):
        return None
    lower = (nearest // every) * every * time.timestep
    upper = min((nearest // every + 1) * every, time.steps) * time.timestep
    return "nothing is recorded at this time", f"the nearest: {lower:.12g} s or {upper:.12g} s"
