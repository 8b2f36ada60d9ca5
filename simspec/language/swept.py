"""What is wrong with the paths and values of a sweep, held against the rest of the spec."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from simspec.errors import Problem
from simspec.language.document import Document, Key
from simspec.language.overrides import kind_at
from simspec.language.reader import Reader
from simspec.language.strict import Faults, show
from simspec.language.sweep import Sweep
from simspec.language.sweep_values import Distribution, same

MOST_REPORTED = 20
"""Values of one path that are reported: more of them have the same cause."""
SWEEP = "sweep"

Placed = list[tuple[tuple[Key, ...], Any]]
"""Values, each with its place below that of its path."""


def check_sweep(document: Document, sweep: Sweep | None) -> Iterator[Problem]:
    """Every problem of a sweep's paths, checked as ``--set`` checks them, and of the values whose type is known before the spec
    is resolved. What shows only in a world that a value makes is a problem of that run."""
    if sweep is None:
        return
    for place, path, values, alike in _axes(document, sweep):
        location = document.locate(place, key=True)
        kind = kind_at(document, path, location)
        if isinstance(kind, Problem):
            yield kind
        elif isinstance(kind, Reader):
            yield from _values(document, place, path, kind, values, alike)


def _axes(document: Document, sweep: Sweep) -> Iterator[tuple[tuple[Key, ...], str, Placed, bool]]:
    """Every path of a sweep: its place, the path, its values with their places below it, and whether they may be alike."""
    for path, values in sweep.over.items():
        written = document.data[SWEEP]["over"][path]
        ranged = isinstance(written, dict)
        ends: Placed = [(("from",), values[0]), (("to",), values[-1])]
        yield (SWEEP, "over", path), path, ends if ranged else _listed(values), ranged
    for row, entry in enumerate(sweep.together):
        for path, values in entry.items():
            yield (SWEEP, "together", row, path), path, _listed(values), True
    for name, case in sweep.cases.items():
        for path, value in case.items():
            yield (SWEEP, "cases", name, path), path, [((), value)], True
    if sweep.samples is not None:
        for path, distribution in sweep.samples.values.items():
            yield (SWEEP, "samples", "values", path), path, list(_drawn(distribution)), True


def _listed(values: Iterable[Any]) -> Placed:
    return [((index,), value) for index, value in enumerate(values)]


def _drawn(distribution: Distribution) -> Iterator[tuple[tuple[Key, ...], Any]]:
    """Values that a distribution may give: the bounds, the mean, each choice."""
    if distribution.choice is not None:
        yield from ((("choice", index), value) for index, value in enumerate(distribution.choice))
    elif distribution.normal is not None:
        yield ("normal", 0), distribution.normal[0]
    else:
        name = "uniform" if distribution.uniform is not None else "log_uniform"
        yield from (((name, index), bound) for index, bound in enumerate(getattr(distribution, name)))


def _values(
    document: Document,
    place: tuple[Key, ...],
    path: str,
    kind: Reader,
    values: Placed,
    alike: bool,
) -> Iterator[Problem]:
    first: dict[str, Any] = {}
    reported = 0
    for below, value in values:
        at = (*place, *below)
        try:
            read = same(kind.read(value))
        except Faults as error:
            for one in error.faults:
                yield document.problem(
                    (*at, *one.loc), one.message, found=one.found, allowed=one.allowed, hint=one.hint
                )
            reported += 1
        else:
            if not alike and read in first:
                found = f"{show(value)}, which is {show(first[read])}"
                yield document.problem(at, f"this value of {path} is duplicated", found=found)
                reported += 1
            first.setdefault(read, value)
        if reported >= MOST_REPORTED:
            return
