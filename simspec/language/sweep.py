"""The words of ``sweep:``: many runs of one scenario, by what changes from run to run.

A sweep changes neither the world nor what is compiled: it says which other worlds are run besides. How its paths and values are
held against the rest of the spec stands in :mod:`simspec.language.overrides`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field

from simspec.language.document import listed, mapping
from simspec.language.quantities import Number, Whole
from simspec.language.shapes import NameOf, Switch
from simspec.language.strict import ABSENT, Fault, Maybe, Strict, show
from simspec.language.sweep_values import Axis, Distribution, EngineLabel, PathOf, Plain, Values, same
from simspec.language.words import Word

MOST_CELLS = 10_000_000
"""Runs of one sweep: a thousand workers, ten thousand runs each."""
MOST_REPEATS = 100_000
"""Repetitions of one run."""
MEASURES = ("physics", "speed")
EXACT, ROUND_UP = TIMES = ("exact", "round_up")
"""The treatment of times that are no whole number of a run's timesteps (:mod:`simspec.experiments.cases`)."""


class Samples(Strict):
    """Values drawn at random, the same on every machine. Each path has a separate stream of random numbers, from the
    seed and the path: additional paths, or a larger count, do not change existing samples.
    """

    count: Annotated[int, Whole(1, MOST_CELLS)] = Field(
        ..., description="Number of samples; each draws all values anew"
    )
    seed: Annotated[int, Whole()] = Field(..., description="Seed of the generators (Python's random.Random)")
    values: dict[PathOf, Distribution] = Field(..., description="The distributions, by the dotted path of the value")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if isinstance(values := data.get("values"), Mapping) and not values:
            yield Fault(("values",), "no values", "{}", "{PATH: {uniform: [..., ...]}}")


class Perturb(Strict):
    """An ensemble: runs with slightly perturbed initial states, in addition to the unperturbed run. Coordinate x
    becomes x (1 + δ), a position of exactly zero δ.
    """

    amount: Annotated[float, Number("number", 0, 1, above=True)] = Field(
        ..., description="Largest relative change: each coordinate's δ is drawn evenly from −amount to amount"
    )
    seeds: Annotated[int, Whole(1, MOST_CELLS)] = Field(
        ..., description="Number of perturbed runs; their seeds are 1, 2, …"
    )


class Sweep(Strict):
    """Many runs of one scenario: their number is the product of the numbers of `cases`, `over`, `together`,
    `samples`, `perturb`, `repeat` and `engines`.
    """

    engines: Maybe[list[Annotated[str, EngineLabel()]]] = Field(
        ABSENT, description="Engines; default: those of the command line, else all that support the scenario"
    )
    over: dict[PathOf, Annotated[tuple[Any, ...], Axis()]] = Field(
        {}, description="A grid: every combination of the values of these paths"
    )
    together: list[dict[PathOf, Annotated[tuple[Any, ...], Values(alike=True)]]] = Field(
        [],
        description="Paths that change together: each entry has lists of equal length, whose values of the "
        "same index belong together",
    )
    cases: dict[NameOf, dict[PathOf, Annotated[Any, Plain()]]] = Field(
        {}, description="Named sets of values by path; the scenario without any is one more case"
    )
    only_cases: Switch = Field(False, description="Whether to omit the scenario without any case")
    samples: Maybe[Samples] = Field(ABSENT, description="Values drawn at random")
    perturb: Maybe[Perturb] = Field(ABSENT, description="Runs with slightly perturbed initial states")
    repeat: Annotated[int, Whole(1, MOST_REPEATS)] = Field(1, description="Number of repetitions of each run")
    measure: Annotated[str, Word(MEASURES)] = Field(
        "physics",
        description="physics: the motion, with runs in parallel; speed: the cost, with one run at a time",
    )
    times: Annotated[str, Word(TIMES)] = Field(
        EXACT,
        description="Times that are no whole number of a run's timesteps: exact, an error of that run; round_up, they are "
        "rounded up to the next step, those of expectations to the next record",
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        for name, empty in (("engines", []), ("over", {}), ("together", []), ("cases", {})):
            if data.get(name) == empty and name in data:
                yield Fault((name,), f"{name} is empty", show(data[name]), None, "remove it")
        engines = listed(data.get("engines"))
        for index, name in enumerate(engines):
            if isinstance(name, str) and name in engines[:index]:
                yield Fault(("engines", index), f"the engine {name} is duplicated")
        yield from _rows(data.get("together"))
        cases = data.get("cases")
        yield from _cases(cases, data.get("only_cases") is True)
        if data.get("only_cases") is True and not cases:
            yield Fault(("only_cases",), "only_cases without cases")
        yield from _paths_twice(data)
        yield from _too_many(data)


def _rows(together: Any) -> Iterator[Fault]:
    """Entries of ``together`` whose lists differ in length."""
    for index, entry in enumerate(together if isinstance(together, list) else ()):
        if not isinstance(entry, Mapping):
            continue
        if not entry:
            yield Fault(("together", index), "no paths", "{}", "{PATH: [...], PATH: [...]}")
        lengths = {path: len(values) for path, values in entry.items() if isinstance(values, (list, tuple))}
        first = next(iter(lengths), None)
        for path, length in lengths.items():
            if length != lengths[first]:
                message = "values that are moved together are equally many"
                yield Fault(("together", index, path), message, f"{length}", f"{lengths[first]}, as {first} has")
        if len(lengths) == len(entry) and len(set(lengths.values())) == 1:
            yield from _equal_rows(("together", index), entry)


def _equal_rows(loc: tuple[str | int, ...], entry: Mapping[str, Sequence[Any]]) -> Iterator[Fault]:
    first: dict[str, int] = {}
    path = next(iter(entry))
    for row, values in enumerate(zip(*entry.values(), strict=True)):
        if (before := first.setdefault(same(list(values)), row)) != row:
            yield Fault((*loc, path, row), "this row is duplicated", f"row {row + 1}, as row {before + 1}")


def _cases(cases: Any, only: bool) -> Iterator[Fault]:
    """Cases that say the same."""
    seen = {} if only else {same({}): "the scenario without a case"}
    for name, values in mapping(cases).items():
        if isinstance(values, Mapping):
            text = same(values)
            if text in seen:
                hint = "only_cases: true leaves the scenario without a case out" if not values else None
                yield Fault(("cases", name), f"the case {name} is the same as {seen[text]}", show(values), None, hint)
            seen.setdefault(text, name)


def _paths_twice(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Paths that two parts of a sweep change, one of them perhaps as a part of what the other one replaces."""
    shared = _Paths()
    for loc, path in _moved(data):
        if (other := shared.overlap(path)) is not None:
            yield Fault(loc, _TWICE, f"{path}, and {other}")
        shared.add(path)
    for name, values in mapping(data.get("cases")).items():
        of_case = _Paths()
        for path in mapping(values):
            if isinstance(path, str):
                if (other := shared.overlap(path) or of_case.overlap(path)) is not None:
                    yield Fault(("cases", name, path), _TWICE, f"{path}, and {other}")
                of_case.add(path)


_TWICE = "a sweep changes this value twice"


class _Paths:
    """Dotted paths, by their steps, and by all beginnings of them."""

    def __init__(self) -> None:
        self._paths: dict[tuple[str, ...], str] = {}
        self._beginnings: dict[tuple[str, ...], str] = {}

    def overlap(self, path: str) -> str | None:
        """The first of the paths that ``path`` is, or is a part of; else one that is a part of ``path``."""
        steps = tuple(path.split("."))
        above = (self._paths[steps[:length]] for length in range(1, len(steps) + 1) if steps[:length] in self._paths)
        return next(above, self._beginnings.get(steps))

    def add(self, path: str) -> None:
        steps = tuple(path.split("."))
        self._paths.setdefault(steps, path)
        for length in range(1, len(steps)):
            self._beginnings.setdefault(steps[:length], path)


def _moved(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Every path of ``over``, ``together`` and ``samples``, with its place."""
    parts: list[tuple[tuple[str | int, ...], Any]] = [(("over",), data.get("over"))]
    parts += [(("together", index), entry) for index, entry in enumerate(listed(data.get("together")))]
    parts.append((("samples", "values"), mapping(data.get("samples")).get("values")))
    for loc, entry in parts:
        for path in mapping(entry):
            if isinstance(path, str):
                yield (*loc, path), path


def _too_many(data: Mapping[str, Any]) -> Iterator[Fault]:
    """The fault of a sweep of too many runs; of one engine where it names none."""
    entries = map(mapping, listed(data.get("together")))
    cases, engines = data.get("cases"), listed(data.get("engines"))
    counts = {
        "cases": len(cases) + (data.get("only_cases") is not True) if isinstance(cases, Mapping) else 1,
        "over": math.prod(map(_length, mapping(data.get("over")).values())),
        "together": math.prod(_length(next(iter(entry.values()), ())) for entry in entries),
        "samples": _whole(data.get("samples"), "count"),
        "perturb": 1 + _whole(data["perturb"], "seeds") if "perturb" in data else 1,
        "repeat": _whole(data, "repeat"),
        "engines": len(engines) or 1,
    }
    if (cells := math.prod(counts.values())) > MOST_CELLS:
        shown = " × ".join(f"{count:,} ({name})" for name, count in counts.items() if count > 1)
        yield Fault((), "too many runs in one sweep", f"{cells:,} = {shown}", f"up to {MOST_CELLS:,}")


def _length(axis: Any) -> int:
    if isinstance(axis, Mapping):
        return _whole(axis, "count")
    return max(1, len(axis)) if isinstance(axis, (list, tuple)) else 1


def _whole(holder: Any, name: str) -> int:
    """A whole number of data as they were written; 1 where there is none."""
    value = mapping(holder).get(name)
    return value if type(value) is int and value > 0 else 1


def combinations(sweep: Sweep) -> int:
    """How many different sets of values a sweep puts in, samples aside."""
    cases = len(sweep.cases) + (not sweep.only_cases)
    rows = (len(next(iter(entry.values()))) for entry in sweep.together)
    return math.prod(itertools.chain((cases,), map(len, sweep.over.values()), rows))
