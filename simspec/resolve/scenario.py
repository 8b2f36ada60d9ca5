"""The rest of the world: time, what to record, what to expect, what to say to engines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from simspec.errors import Problem
from simspec.spec.expectations import BODIES, KINDS, TIMES
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
    source: Source, bodies: Sequence[Body], time: Physics, recorded: Record
) -> tuple[tuple[Expectation, ...], list[Problem]]:
    """The expectations in the order of the file, and the problems of those that no run could answer."""
    names = {body.name for body in bodies}
    found, problems = [], []
    for index, entry in enumerate(source.file.expect):
        kind = next(kind for kind in KINDS if getattr(entry, kind) is not None)
        given = getattr(entry, kind)
        values = {name: getattr(given, name) for name in KINDS[kind].parameters}
        values = {name: value for name, value in values.items() if value is not None}
        path = ("expect", index, kind)
        for name in BODIES:
            body = values.get(name)
            if body is not None and body not in names:
                message = f"there is no body {body!r}"
                hint = near(body, sorted(names))
                problems.append(source.document.problem((*path, name), message, found=body, hint=hint))
        for name in TIMES:
            if name in values and (why := _not_recorded(values[name], time, recorded)):
                problems.append(
                    source.document.problem((*path, name), why[0], found=f"{values[name]:g} s", allowed=why[1])
                )
        if kind == "momentum_conserved" and any(time.gravity):
            shown = ", ".join(f"{value:g}" for value in time.gravity)
            message = "momentum is conserved without gravity only"
            problems.append(source.document.problem(path, message, found=f"gravity [{shown}] m/s²"))
        found.append(Expectation(kind, tuple(sorted(values.items()))))
    return tuple(found), problems


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
