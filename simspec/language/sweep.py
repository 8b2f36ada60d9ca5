"""The words of ``sweep:``, many runs of one scenario, by what changes from run to run; and of a study file.

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
from simspec.language.quantities import Number, Vector, Whole
from simspec.language.shapes import NameOf, Switch
from simspec.language.strict import ABSENT, Fault, Maybe, Strict, show
from simspec.language.sweep_values import Axis, Distribution, EngineLabel, PathOf, Plain, Values, same
from simspec.language.words import FileName, Text, Word

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
            yield Fault(("values",), "no values", "{}", "{PATH: {uniform: [..., ...]}}", code="S804")


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
                yield Fault((name,), f"{name} is empty", show(data[name]), None, "remove it", code="S804")
        engines = listed(data.get("engines"))
        for index, name in enumerate(engines):
            if isinstance(name, str) and name in engines[:index]:
                yield Fault(("engines", index), f"the engine {name} is duplicated", code="S804")
        yield from _rows(data.get("together"))
        cases = data.get("cases")
        yield from _cases(cases, data.get("only_cases") is True)
        if data.get("only_cases") is True and not cases:
            yield Fault(("only_cases",), "only_cases without cases", code="S804")
        yield from _paths_twice(data)
        yield from _too_many(data)


def _rows(together: Any) -> Iterator[Fault]:
    """Entries of ``together`` whose lists differ in length."""
    for index, entry in enumerate(together if isinstance(together, list) else ()):
        if not isinstance(entry, Mapping):
            continue
        if not entry:
            yield Fault(("together", index), "no paths", "{}", "{PATH: [...], PATH: [...]}", code="S804")
        lengths = {path: len(values) for path, values in entry.items() if isinstance(values, (list, tuple))}
        first = next(iter(lengths), None)
        for path, length in lengths.items():
            if length != lengths[first]:
                message = "values that are moved together are equally many"
                yield Fault(
                    ("together", index, path), message, f"{length}", f"{lengths[first]}, as {first} has", code="S804"
                )
        if len(lengths) == len(entry) and len(set(lengths.values())) == 1:
            yield from _equal_rows(("together", index), entry)


def _equal_rows(loc: tuple[str | int, ...], entry: Mapping[str, Sequence[Any]]) -> Iterator[Fault]:
    first: dict[str, int] = {}
    path = next(iter(entry))
    for row, values in enumerate(zip(*entry.values(), strict=True)):
        if (before := first.setdefault(same(list(values)), row)) != row:
            yield Fault((*loc, path, row), "this row is duplicated", f"row {row + 1}, as row {before + 1}", code="S804")


def _cases(cases: Any, only: bool) -> Iterator[Fault]:
    """Cases that say the same."""
    seen = {} if only else {same({}): "the scenario without a case"}
    for name, values in mapping(cases).items():
        if isinstance(values, Mapping):
            text = same(values)
            if text in seen:
                hint = "only_cases: true leaves the scenario without a case out" if not values else None
                yield Fault(
                    ("cases", name),
                    f"the case {name} is the same as {seen[text]}",
                    show(values),
                    None,
                    hint,
                    code="S804",
                )
            seen.setdefault(text, name)


def _paths_twice(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Paths that two parts of a sweep change, one of them perhaps as a part of what the other one replaces."""
    shared = _Paths()
    for loc, path in _moved(data):
        if (other := shared.overlap(path)) is not None:
            yield Fault(loc, _TWICE, f"{path}, and {other}", code="S804")
        shared.add(path)
    for name, values in mapping(data.get("cases")).items():
        of_case = _Paths()
        for path in mapping(values):
            if isinstance(path, str):
                if (other := shared.overlap(path) or of_case.overlap(path)) is not None:
                    yield Fault(("cases", name, path), _TWICE, f"{path}, and {other}", code="S804")
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
        yield Fault((), "too many runs in one sweep", f"{cells:,} = {shown}", f"up to {MOST_CELLS:,}", code="S805")


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


# A study: sweeps of several scenarios, figures to hold them against, and what is shown of them. Each sweep has a scenario
# (``spec``), values that are put into it (``set``), and the words of its ``sweep``, which replace those that the spec has.
# How a study becomes specs is in :mod:`simspec.language.load`.

VERSION = 1
SHOWN = (
    *("speed", "load", "validity", "over_time", "determinism", "playback", "quantities", "unequal", "contact"),
    *("certified", "failures", "cases", "cost", "displacement", "case_cost"),
    *("divergence", "distributions", "consistency", "conservation", "penetration", "attribution"),
)
"""The parts of a page that a sweep can have."""
QUANTITIES = ("real_time_factor", "cpu_factor", "largest_valid_timestep", "spread_at_the_end")
"""Quantities of figures from elsewhere."""
MOST_GAP_SEEDS = 100
MOST_FIGURES = 1000
"""Numbers of one series."""

Times = Annotated[tuple[float, ...], Vector(Number("time", 0, above=True), 1, MOST_FIGURES)]
Numbers = Annotated[tuple[float, ...], Vector(Number("number"), 1, MOST_FIGURES)]
Label = Annotated[str, EngineLabel()]
Words = Annotated[str, Text()]


class Small(Strict):
    """The differences of the small study (`--small`)."""

    set: dict[PathOf, Annotated[Any, Plain()]] = Field({}, description="Values besides those of the whole study")
    sweep: Maybe[Sweep] = Field(ABSENT, description="Words of the sweep that replace those of the whole study")


class StudySweep(Strict):
    """One sweep of a study."""

    spec: Annotated[str, FileName()] = Field(..., description="The scenario; relative to the study's file")
    set: dict[PathOf, Annotated[Any, Plain()]] = Field({}, description="Values that are put into the scenario, by path")
    sweep: Maybe[Sweep] = Field(ABSENT, description="Words of the sweep; each replaces that of the scenario's sweep")
    small: Maybe[Small] = Field(
        ABSENT, description="The differences with `--small`; without it, the sweep is no part of the small study"
    )
    unequal: dict[NameOf, dict[Label, NameOf]] = Field(
        {},
        description="Named comparisons of models that are NOT equal: the case that an engine has; the other engines have the "
        "scenario itself",
    )
    fails: list[NameOf] = Field(
        [],
        description="Cases that are expected to fail (controls): the study fails if a run of one of them does not fail",
    )
    gap_seeds: Annotated[int, Whole(0, MOST_GAP_SEEDS)] = Field(
        0,
        description="A second pass: number of runs of each engine that are perturbed by the size of the "
        "engines' first gap, known after the first runs; for `show: [divergence]`",
    )
    show: list[Annotated[str, Word(SHOWN)]] = Field(["speed"], description="The parts of the page about the sweep")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        sweeps, shown = mapping(data.get("sweep")), listed(data.get("show"))
        for index, word in enumerate(shown):
            if word in shown[:index]:
                yield Fault(("show", index), "this word is duplicated", show(word), code="S806")
        if data.get("show") == []:
            yield Fault(("show",), "nothing is shown of the sweep", "[]", ", ".join(SHOWN), code="S806")
        yield from _unequal(data.get("unequal"), sweeps)
        yield from _fails(data.get("fails"), sweeps, shown)
        if "unequal" in shown and not data.get("unequal"):
            yield Fault(
                ("show",),
                "there are no unequal models to show",
                None,
                None,
                "unequal: {NAME: {ENGINE: CASE}}",
                code="S806",
            )
        if data.get("unequal") and "unequal" not in shown:
            yield Fault(("unequal",), "unequal models are not shown", None, "show: [unequal]", code="S806")
        if data.get("gap_seeds") and "divergence" not in shown:
            yield Fault(
                ("gap_seeds",),
                "the second pass is for a chart of divergence",
                None,
                None,
                "show: [divergence]",
                code="S806",
            )
        if "determinism" in shown and sweeps.get("repeat", 1) == 1:
            yield Fault(
                ("show",), "determinism is shown by repeated runs", None, None, "sweep: {repeat: 2}", code="S806"
            )


def _unequal(unequal: Any, sweep: Mapping[str, Any]) -> Iterator[Fault]:
    engines = sweep.get("engines")
    for name, models in mapping(unequal).items():
        if models == {}:
            yield Fault(("unequal", name), "no engine has a case of its own", "{}", "{ENGINE: CASE}", code="S806")
        for engine, case in mapping(models).items():
            yield from _no_case(("unequal", name, engine), case, sweep)
            if isinstance(engines, list) and engine not in engines:
                yield Fault(
                    ("unequal", name, engine), "the sweep has no such engine", engine, ", ".join(engines), code="S806"
                )
    if unequal and sweep.get("only_cases") is True:
        yield Fault(
            ("sweep", "only_cases"),
            "the scenario itself is run, to compare unequal models with equal ones",
            code="S806",
        )


def _no_case(loc: tuple[str | int, ...], case: Any, sweep: Mapping[str, Any]) -> list[Fault]:
    known = list(mapping(sweep.get("cases")))
    allowed = ", ".join(known) or "none: the sweep has no cases"
    return [] if case in known else [Fault(loc, "the sweep has no case of this name", show(case), allowed, code="S806")]


def _fails(fails: Any, sweep: Mapping[str, Any], shown: Sequence[Any]) -> Iterator[Fault]:
    for index, case in enumerate(listed(fails)):
        if unknown := _no_case(("fails", index), case, sweep):
            yield from unknown
        elif case in fails[:index]:
            yield Fault(("fails", index), "this case is duplicated", show(case), code="S806")
    if fails and "cases" not in shown:
        yield Fault(("fails",), "the cases are not shown", None, None, "show: [cases]", code="S806")


class StudyFile(Strict):
    """A study."""

    simspec_study: Annotated[int, Whole(VERSION, VERSION)] = Field(
        ..., description="Version of the language of studies"
    )
    name: NameOf = Field(..., description="Name of the study, and of the folder of its results")
    description: Words = Field("", description="The subject of the study, in a sentence")
    figures: Maybe[Annotated[str, FileName()]] = Field(
        ABSENT, description="File of figures from elsewhere, to hold the results against; relative to the study's file"
    )
    sweeps: dict[NameOf, StudySweep] = Field(
        ..., description="The sweeps, by name, in the order in which they are done"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if data.get("sweeps") == {}:
            yield Fault(("sweeps",), "a study has at least one sweep", "{}", code="S806")


class Figure(Strict):
    """Figures of one engine from elsewhere: a series over the timestep, or a single one."""

    sweep: NameOf = Field(..., description="The sweep of the study with which the figures are compared")
    quantity: Annotated[str, Word(QUANTITIES)] = Field(..., description="The measured quantity")
    engine: NameOf = Field(..., description="Engine of the measurement; any name")
    models: NameOf = Field(
        "as-published", description="Models: a case of the sweep, a comparison of its `unequal`, or any name"
    )
    timesteps: Maybe[Times] = Field(ABSENT, description="The timesteps of the values")
    values: Numbers = Field(..., description="The values, one for each timestep")
    unit: Words = Field("1", description="Unit of the values; 1 for none")
    source: Words = Field(..., description="Place of the figures in the source")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        steps, values = data.get("timesteps"), data.get("values")
        wanted = len(steps) if isinstance(steps, (list, tuple)) else 1
        if isinstance(values, (list, tuple)) and len(values) != wanted:
            message = "there is one value for each timestep" if steps is not None else "a series needs its timesteps"
            yield Fault(("values",), message, f"{len(values)}", f"{wanted}", code="S806")


class FiguresFile(Strict):
    """Figures from elsewhere, such as a paper, with their source."""

    simspec_figures: Annotated[int, Whole(VERSION, VERSION)] = Field(
        ..., description="Version of the form of this file"
    )
    source: Words = Field(..., description="The work that they are from")
    figures: list[Figure] = Field(..., description="The figures")
