"""The words of a study file: sweeps of several scenarios, figures to hold them against, and what is shown of them.

A study lists sweeps. Each has a scenario (``spec``), values that are put into it (``set``), and the words of its ``sweep``,
which replace those that the spec has. How a study becomes specs is in :mod:`simspec.language.study_specs`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field

from simspec.language.document import listed, mapping
from simspec.language.quantities import Number, Vector, Whole
from simspec.language.shapes import NameOf
from simspec.language.strict import ABSENT, Fault, Maybe, Strict, show
from simspec.language.sweep import Sweep
from simspec.language.sweep_values import EngineLabel, PathOf, Plain
from simspec.language.words import FileName, Text, Word

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
                yield Fault(("show", index), "this word is duplicated", show(word))
        if data.get("show") == []:
            yield Fault(("show",), "nothing is shown of the sweep", "[]", ", ".join(SHOWN))
        yield from _unequal(data.get("unequal"), sweeps)
        yield from _fails(data.get("fails"), sweeps, shown)
        if "unequal" in shown and not data.get("unequal"):
            yield Fault(("show",), "there are no unequal models to show", None, None, "unequal: {NAME: {ENGINE: CASE}}")
        if data.get("unequal") and "unequal" not in shown:
            yield Fault(("unequal",), "unequal models are not shown", None, "show: [unequal]")
        if data.get("gap_seeds") and "divergence" not in shown:
            yield Fault(
                ("gap_seeds",),
                "the second pass is for a chart of divergence",
                None,
                None,
                "show: [divergence]",
            )
        if "determinism" in shown and sweeps.get("repeat", 1) == 1:
            yield Fault(("show",), "determinism is shown by repeated runs", None, None, "sweep: {repeat: 2}")


def _unequal(unequal: Any, sweep: Mapping[str, Any]) -> Iterator[Fault]:
    engines = sweep.get("engines")
    for name, models in mapping(unequal).items():
        if models == {}:
            yield Fault(("unequal", name), "no engine has a case of its own", "{}", "{ENGINE: CASE}")
        for engine, case in mapping(models).items():
            yield from _no_case(("unequal", name, engine), case, sweep)
            if isinstance(engines, list) and engine not in engines:
                yield Fault(("unequal", name, engine), "the sweep has no such engine", engine, ", ".join(engines))
    if unequal and sweep.get("only_cases") is True:
        yield Fault(("sweep", "only_cases"), "the scenario itself is run, to compare unequal models with equal ones")


def _no_case(loc: tuple[str | int, ...], case: Any, sweep: Mapping[str, Any]) -> list[Fault]:
    known = list(mapping(sweep.get("cases")))
    allowed = ", ".join(known) or "none: the sweep has no cases"
    return [] if case in known else [Fault(loc, "the sweep has no case of this name", show(case), allowed)]


def _fails(fails: Any, sweep: Mapping[str, Any], shown: Sequence[Any]) -> Iterator[Fault]:
    for index, case in enumerate(listed(fails)):
        if unknown := _no_case(("fails", index), case, sweep):
            yield from unknown
        elif case in fails[:index]:
            yield Fault(("fails", index), "this case is duplicated", show(case))
    if fails and "cases" not in shown:
        yield Fault(("fails",), "the cases are not shown", None, None, "show: [cases]")


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
            yield Fault(("sweeps",), "a study has at least one sweep", "{}")


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
            yield Fault(("values",), message, f"{len(values)}", f"{wanted}")


class FiguresFile(Strict):
    """Figures from elsewhere, such as a paper, with their source."""

    simspec_figures: Annotated[int, Whole(VERSION, VERSION)] = Field(
        ..., description="Version of the form of this file"
    )
    source: Words = Field(..., description="The work that they are from")
    figures: list[Figure] = Field(..., description="The figures")
