"""What a sweep rounds up to whole steps (``times: round_up``), cell by cell and as a whole. Nothing is resolved for it."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from typing import Any

from simspec.experiments.asked import digest
from simspec.experiments.plan import Cell, Plan
from simspec.language.overrides import Override, overridden
from simspec.language.rounding import Rounded, concerned, rounded_up
from simspec.language.sweep import ROUND_UP

MOST_KEPT = 1000
"""Sets of values of one plan whose roundings are kept."""
MOST_LINES = 40
"""Sets of values whose roundings are told one by one."""

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
        document, _ = overridden(plan.spec.source.document, [Override(*one, None, None) for one in values])
        kept[name] = rounded_up(document.data)
    return kept[name]


def rounded_data(rounded: Sequence[Rounded]) -> list[list[Any]]:
    """Roundings as plain data: path, what is written and what is taken (s)."""
    return [[one.path, one.written, one.taken] for one in rounded]


def rounding_sets(plan: Plan) -> dict[str, tuple[Rounded, ...]]:
    """What is rounded, by the values that times depend on (the scenario's name where the sweep changes none); only those where
    something is."""
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
    expected = [one for one in rounded if one.path.startswith("expect.")]
    words = [f"{one.path} {one.written:g} s to {one.taken:.9g} s" for one in rounded if one not in expected]
    if expected:
        later = max(one.taken - one.written for one in expected)
        count = f"{len(expected)} times of expectations" if len(expected) > 1 else "a time of an expectation"
        words.append(f"{count} by up to {later:.3g} s, to the next record")
    return ", ".join(words)
