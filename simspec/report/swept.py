"""A sweep as suites of a test report: one for each engine, an entry for each run that was asked for."""

from __future__ import annotations

import math
from collections.abc import Iterable

from simspec.errors import Problem, SpecError, clipped
from simspec.experiments.index import Row
from simspec.experiments.plan import Cell
from simspec.experiments.sweep import Outcome
from simspec.report.tested import Entry, Locate, Status, Suite, error_suites

MOST_ENTRIES = 20_000
"""Entries of one engine: further runs are counted in one. A report of more has tens of megabytes, which no CI system shows."""
UNSUPPORTED = "does not support this world"


def sweep_suites(outcome: Outcome, rows: Iterable[tuple[Cell, Row | None]], locate: Locate) -> list[Suite]:
    """The runs of a sweep by engine, then proofs that failed, and values that make the spec invalid.

    ``locate``: gives the place of a path in the spec.
    """
    spec = outcome.plan.spec.name
    entries: dict[str, list[Entry]] = {}
    left: dict[tuple[str, Status], int] = {}
    for cell, row in rows:
        entry = _entry(cell, row, outcome, locate)
        own = entries.setdefault(cell.engine, [])
        if len(own) < MOST_ENTRIES or entry.status is Status.ERROR:
            own.append(entry)
        else:
            left[cell.engine, entry.status] = left.get((cell.engine, entry.status), 0) + 1
    for (engine, status), number in left.items():
        why = "" if status is Status.PASSED else "more than are listed"
        entries[engine].append(Entry(f"{number:,} more runs", status, why))
    suites = [Suite(spec, engine, tuple(own)) for engine, own in entries.items()]
    if outcome.unproven:
        place = locate("name")
        failed = [Entry("proof", Status.FAILED, why, "", place, excess=math.inf) for why in outcome.unproven.values()]
        suites.append(Suite(spec, "proofs", tuple(failed)))
    if outcome.invalid:
        problems = list(outcome.invalid)
        if outcome.invalid_count > 1:
            problems.append(
                Problem(f"{outcome.invalid_count:,} runs were not done: their values make the spec invalid")
            )
        suites += error_suites(spec, SpecError(problems))
    return suites


def _entry(cell: Cell, row: Row | None, outcome: Outcome, locate: Locate) -> Entry:
    place = locate("sweep")
    name = _name(cell)
    if row is None:
        why = outcome.stopped.get(cell.engine, "not run")
        return Entry(name, Status.SKIPPED, clipped(why), location=place)
    seconds = row.process_seconds or 0.0
    if row.failed is not None:
        status = Status.SKIPPED if row.failed.startswith(UNSUPPORTED) else Status.ERROR
        return Entry(name, status, clipped(row.failed), row.failed, place, seconds, math.inf)
    if row.passed < row.expected:
        message = f"{row.expected - row.passed} of {row.expected} expectations are not met"
        return Entry(name, Status.FAILED, message, "", place, seconds, (row.expected - row.passed) / row.expected)
    return Entry(name, Status.PASSED, seconds=seconds)


def _name(cell: Cell) -> str:
    """What a cell asks for, in a line."""
    words = [f"run {cell.index + 1}"]
    words += [cell.case] if cell.case is not None else []
    words += [f"{path}={clipped(str(value), 60)}" for path, value in cell.overrides]
    words += [f"sample {cell.sample}"] if cell.sample is not None else []
    words += [f"seed {cell.seed}"] if cell.seed is not None else []
    words += [f"repeat {cell.repeat}"] if cell.repeat else []
    return ", ".join(words)
