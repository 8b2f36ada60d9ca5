"""Single numbers of a run by name: its quantities at the end, what its expectations measured, and its last coordinates.

Names are those that tables, baselines and runs have: ``deepest penetration``, ``expectation 1 displacement``, ``arm.z``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from simspec.comparison.floor import FLOOR_FACTOR
from simspec.comparison.runs import QUANTITIES, summary
from simspec.errors import Problem, SpecError
from simspec.language.strict import near
from simspec.runner.expectations import evaluate
from simspec.runner.run import Run
from simspec.world.kinematics import coordinates
from simspec.world.types import World

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
    expected = [_expected(number, one.kind) for number, one in enumerate(world.expectations, 1)]
    return [*expected, *(name for name, _ in QUANTITIES), *known.q, *known.v]


def find_figure(world: World, word: str) -> str:
    """The figure that ``word`` names: its name, the name with ``_`` or ``-`` for blanks, an expectation by its number or, where
    there is one of the kind, by its kind. Raises SpecError with the names that there are."""
    names = figure_names(world)
    if word in names:
        return word
    kinds = [one.kind for one in world.expectations]
    found = {_plain(name): name for name in reversed(names)}
    for number, kind in enumerate(kinds, 1):
        found[_plain(f"expectation {number}")] = _expected(number, kind)
        if kinds.count(kind) == 1:
            found.setdefault(_plain(kind), _expected(number, kind))
    if (name := found.get(_plain(word))) is not None:
        return name
    told = ", ".join(names[:MOST_NAMED]) + (f", and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")
    problem = Problem(f"no run of {world.name} has a figure {word!r}", found=word, allowed=told, hint=near(word, names))
    raise SpecError([problem])


def read_figure(run: Run, name: str) -> RunFigure:
    """The figure ``name`` (:func:`figure_names`) of a run. Raises SpecError where the run does not have it."""
    if name in run.coordinates.q_columns or name in run.coordinates.v_columns:
        return _coordinate(run, name)
    for number, outcome in enumerate(evaluate(run), 1):
        if name != _expected(number, outcome.kind):
            continue
        if outcome.measured is None:
            raise SpecError([Problem(f"{name} was not measured: {outcome.detail}")])
        return RunFigure(outcome.measured, outcome.unit, _largest(run, outcome.unit, outcome.measured))
    values, units = summary(run), dict(QUANTITIES)
    if name not in values:
        raise SpecError(
            [Problem(f"this run has no {name}: what it follows from was not recorded", hint="record.channels")]
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
