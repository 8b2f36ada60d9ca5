"""The runs of a sweep by what tells them apart besides the timestep: engine, case and values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from rich.table import Table

from simspec.errors import clipped
from simspec.experiments.index import Row
from simspec.experiments.plan import Cell
from simspec.experiments.sweep import REFUSED
from simspec.report.kit import table
from simspec.report.study.done import Done

TIMESTEP = "physics.timestep"
PLAIN = "–"
"""What the scenario itself is called beside its cases."""
LONGEST = 60
"""Characters of a value."""


@dataclass
class Variant:
    """What one engine made of a case with the same values: ``runs`` by timestep (s), in the order of the plan."""

    engine: str
    case: str | None
    values: tuple[tuple[str, Any], ...]
    runs: dict[float, list[tuple[Cell, Row]]] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The case and the values in words."""
        told = self.told_values
        return ", ".join([*([self.case] if self.case is not None else []), *([told] if told != PLAIN else [])]) or PLAIN

    @property
    def told_values(self) -> str:
        """The values in words."""
        told = [f"{path.rpartition('.')[2]} {clipped(str(value), LONGEST)}" for path, value in self.values]
        return ", ".join(told) or PLAIN

    @property
    def keys(self) -> tuple[str, ...]:
        """Which runs these are."""
        return tuple(row.key for runs in self.runs.values() for _, row in runs)

    def all_runs(self) -> Iterator[tuple[Cell, Row]]:
        """The runs of all timesteps."""
        for runs in self.runs.values():
            yield from runs

    @staticmethod
    def refused(row: Row) -> bool:
        """Whether the engine does not support what was asked of it."""
        return row.failed is not None and row.failed.startswith(REFUSED)

    @property
    def supported(self) -> bool:
        """Whether the engine supports it at any timestep."""
        return not all(self.refused(row) for _, row in self.all_runs())

    def refusals(self) -> list[str]:
        """Why the engine does not support the scenario with these values, each reason once."""
        told = [row.failed for _, row in self.all_runs() if row.failed is not None and self.refused(row)]
        return list(dict.fromkeys(why.removeprefix(REFUSED).removeprefix(": ") for why in told))


def variants(done: Done) -> list[Variant]:
    """The variants of a sweep that have runs, in the order of the plan.

    A case that changes nothing for an engine (it has settings of another one) has the very runs of a variant before it, and is
    left out.
    """
    cases: Mapping[str, Mapping[str, Any]] = done.outcome.plan.sweep.cases
    samples = done.outcome.plan.sweep.samples
    drawn = set(samples.values) if samples is not None else set()
    found: dict[tuple[str, str | None, str], Variant] = {}
    for cell, row in done.outcome.rows():
        if row is None:
            continue
        aside = {TIMESTEP, *drawn, *(cases[cell.case] if cell.case is not None else ())}
        values = tuple((path, value) for path, value in cell.overrides if path not in aside)
        variant = found.setdefault((cell.engine, cell.case, repr(values)), Variant(cell.engine, cell.case, values))
        variant.runs.setdefault(row.timestep, []).append((cell, row))
    known: set[tuple[str, ...]] = set()
    kept = []
    for variant in found.values():
        if variant.keys not in known:
            kept.append(variant)
        known.add(variant.keys)
    return kept


def timesteps_of(made: list[Variant]) -> list[float]:
    """All timesteps (s) of some variants, the smallest first."""
    return sorted({timestep for variant in made for timestep in variant.runs})


def unsupported_table(done: Done, made: list[Variant]) -> Table:
    """Which engines do not support which variants, and why."""
    reasons: dict[tuple[str, str], dict[str, None]] = {}
    for variant in made:
        for why in variant.refusals():
            reasons.setdefault((variant.engine, why), {})[variant.label] = None
    shown = table(f"{done.sweep.name}: Not supported", "engine", "settings", "why")
    if not reasons:
        shown.add_row("none", PLAIN, "every engine supports everything that was asked")
    for (engine, why), labels in reasons.items():
        shown.add_row(engine, ", ".join(labels), why)
    return shown
