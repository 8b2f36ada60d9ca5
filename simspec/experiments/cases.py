"""From a cell of a plan to the case that is run: values are put into the spec, which is then validated and resolved."""

from __future__ import annotations

import math
import weakref
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from simspec.errors import Problem, SpecError
from simspec.experiments.plan import Cell, Plan, digest
from simspec.language.contact import WHOLE
from simspec.language.document import Key, listed, mapping
from simspec.language.expectations import TIMES
from simspec.language.load import Spec
from simspec.language.overrides import Override, overridden
from simspec.language.physics import MOST_STEPS, Physics
from simspec.language.quantities import Number
from simspec.language.strict import Faults
from simspec.language.sweep import ROUND_UP
from simspec.option_checks import check_options
from simspec.runner.run import Case
from simspec.world.types import World

# ``times: round_up`` of a sweep: `physics.duration`, `record.every` and `trajectory.until` of a run are the next whole number
# of timesteps, a time of an expectation is that of the next record, or the end of the run where that is earlier.

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
    times = (("physics.duration", duration), ("record.every", every), ("trajectory.until", until))
    made = [grid.rounded(path, time) for path, time in times if time]
    made += [
        grid.recorded(f"expect.{index}.{kind}.{name}", time)
        for index, entry in enumerate(listed(data.get("expect")))
        for kind in mapping(entry)
        for name in TIMES
        if (time := _time(entry, kind, name)) is not None
    ]
    return tuple(rounded for rounded in made if rounded is not None)


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


MOST_KEPT = 1000
"""Sets of values of one plan whose roundings are kept."""
MOST_LINES = 40
"""Sets of values whose roundings are listed one by one."""

_KEPT: weakref.WeakKeyDictionary[Plan, dict[bytes, tuple[Rounded, ...]]] = weakref.WeakKeyDictionary()


def roundings(plan: Plan, cell: Cell) -> tuple[Rounded, ...]:
    """The times of a cell that are rounded up; none in a sweep that does not ask for it."""
    if plan.sweep.times != ROUND_UP:
        return ()
    kept = _KEPT.setdefault(plan, {})
    values = _values(cell)
    name = digest(values)
    if name not in kept:
        if len(kept) >= MOST_KEPT:
            kept.clear()
        # a value that does not suit its path is a problem of the case
        document, _ = overridden(plan.spec.source.document, [Override(*entry, None, None) for entry in values])
        kept[name] = rounded_up(document.data)
    return kept[name]


def rounded_data(rounded: Sequence[Rounded]) -> list[list[Any]]:
    """Roundings as plain data: path, what is written and what is taken (s)."""
    return [[entry.path, entry.written, entry.taken] for entry in rounded]


def rounding_sets(plan: Plan) -> dict[str, tuple[Rounded, ...]]:
    """Rounded times, by the values that they depend on (the scenario's name where the sweep changes none); only where there are
    some."""
    sets: dict[str, tuple[Rounded, ...]] = {}
    for cell in plan if plan.sweep.times == ROUND_UP else ():
        if rounded := roundings(plan, cell):
            sets[", ".join(f"{path}={value}" for path, value in _values(cell)) or plan.spec.name] = rounded
    return sets


def rounding_lines(plan: Plan) -> list[str]:
    """The same in words, a line for each set of values."""
    sets = rounding_sets(plan)
    lines = [f"times rounded up at {name}: {_said(rounded)}" for name, rounded in sets.items()]
    more = len(lines) - MOST_LINES
    return [*lines[:MOST_LINES], *([f"times rounded up at {more:,} more sets of values: --json"] if more > 0 else [])]


def _values(cell: Cell) -> list[tuple[str, Any]]:
    """The values of a cell that its times depend on."""
    return [(path, value) for path, value in cell.overrides if concerned(path)]


def _said(rounded: Sequence[Rounded]) -> str:
    """Roundings in words: each time of the run, and how much later expectations look at most."""
    expected = [entry for entry in rounded if entry.path.startswith("expect.")]
    words = [f"{entry.path} {entry.written:g} s to {entry.taken:.9g} s" for entry in rounded if entry not in expected]
    if expected:
        later = max(rounded.taken - rounded.written for rounded in expected)
        count = f"{len(expected)} times of expectations" if len(expected) > 1 else "a time of an expectation"
        words.append(f"{count} by up to {later:.3g} s, to the next record")
    return ", ".join(words)


MOST_KEPT_CASES = 16
"""Worlds of one plan that are kept: engines, repetitions and perturbations of one world follow each other in a plan. A world of
the library takes up to 10 MB."""


@dataclass(frozen=True, slots=True)
class _Made:
    """The result of a set of values: a spec and its world, or the problems."""

    spec: Spec | None
    world: World | None
    problems: tuple[Problem, ...] = ()


_KEPT_CASES: weakref.WeakKeyDictionary[Plan, OrderedDict[bytes, _Made]] = weakref.WeakKeyDictionary()
"""The latest worlds of each plan, by the digest of the values."""


def case_of(plan: Plan, cell: Cell) -> Case:
    """The case of a cell. Raises SpecError, located where the sweep says the values, when they make the spec invalid."""
    return Case(world_of(plan, cell), cell.engine, perturb=cell.perturb, seed=cell.seed)


def world_of(plan: Plan, cell: Cell) -> World:
    """The world of a cell; cells with the same values share it while it is kept. Raises SpecError as :func:`case_of`."""
    world = _made(plan, cell).world
    assert world is not None, "a case without problems has a world"
    return world


def _made(plan: Plan, cell: Cell) -> _Made:
    kept = _KEPT_CASES.setdefault(plan, OrderedDict())
    name = digest(cell.overrides)
    made = kept.get(name)
    if made is None:
        made = kept[name] = _make(plan, cell)
        if len(kept) > MOST_KEPT_CASES:
            kept.popitem(last=False)
    kept.move_to_end(name)
    if made.problems:
        raise SpecError(made.problems)
    return made


def _make(plan: Plan, cell: Cell) -> _Made:
    try:
        overrides = list(_located(plan, cell))
        overrides += (Override(rounding.path, rounding.taken, None, None) for rounding in roundings(plan, cell))
        spec = plan.spec.with_overrides(overrides) if overrides else plan.spec
        world = spec.resolve()
        # an engine refuses such a world, too, but there it would be a run that failed and not values that are wrong
        problems = tuple(check_options(world, spec.locate))
        return _Made(None, None, problems) if problems else _Made(spec, world)
    except SpecError as error:
        return _Made(None, None, error.problems)


def _located(plan: Plan, cell: Cell) -> Iterator[Override]:
    """The values that a cell puts in, with the places where the sweep says them."""
    document = plan.spec.source.document
    for path, value in cell.overrides:
        place = _place(plan, cell, path)
        below = _below(document.data, place, value)
        yield Override(path, value, document.locate(place, key=True), document.locate((*place, *below)))


def _place(plan: Plan, cell: Cell, path: str) -> tuple[Key, ...]:
    """Where the sweep says the values of a path in a cell."""
    sweep = plan.sweep
    if cell.case is not None and path in sweep.cases[cell.case]:
        return ("sweep", "cases", cell.case, path)
    if path in sweep.over:
        return ("sweep", "over", path)
    rows = (("sweep", "together", row, path) for row, entry in enumerate(sweep.together) if path in entry)
    return next(rows, ("sweep", "samples", "values", path))


def _below(data: Any, place: tuple[Key, ...], value: Any) -> tuple[Key, ...]:
    """The place of one value in the list of all values of a path; none where they are worked out."""
    for step in place:
        data = data[step]
    if place[1] == "cases" or not isinstance(data, (list, tuple)):
        return ()
    return next(((index,) for index, entry in enumerate(data) if entry == value), ())
