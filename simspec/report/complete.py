"""What became of every change of a complete self-test: as a table, and as data."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from simspec.report.kit import table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from simspec.proof.complete_verdicts import CompleteTest

COLUMNS = ("planted", "caught", "refused", "inert", "missed")
SHOWN = 40
"""Missed changes that the terminal lists; ``--json`` has all."""


def complete_data(result: CompleteTest) -> dict[str, Any]:
    """A complete self-test as plain data."""
    rows = [
        {"engine": engine, "kind": kind, **dict(zip(COLUMNS, counts, strict=True))}
        for engine, kind, counts in result.rows()
    ]
    return {
        "passed": result.passed,
        "versions": result.versions,
        "seconds": result.seconds,
        "skipped": result.skipped,
        "rows": rows,
        "inert": [{"engine": engine, "reason": why, "count": count} for engine, why, count in inert_reasons(result)],
        "unused": result.unused,
        "mutations": result.verdicts,
    }


def show_complete(result: CompleteTest, screen: Console) -> None:
    """Print the table, and what was missed and skipped."""
    screen.print(complete_table(result))
    for verdict in result.missed[:SHOWN]:
        screen.print(
            f"MISSED {verdict.engine}, {verdict.world}: {verdict.file} {verdict.place}: "
            f"{verdict.kind} {verdict.change} {verdict.why}",
            markup=False,
        )
    if len(result.missed) > SHOWN:
        screen.print(f"and {len(result.missed) - SHOWN} more (--json lists all)")
    for where, why in result.skipped.items():
        screen.print(f"{where}: {why}", markup=False)
    for engine, rows in result.unused.items():
        for row in rows:
            screen.print(f"{engine}: declared inert, and no change needs it: {row}", markup=False)
    planted, missed = result.count(), len(result.missed)
    screen.print(f"missed {missed} of {planted} changes, in {result.seconds / 60.0:.0f} min")


def complete_table(result: CompleteTest) -> Table:
    """A row for each engine and kind of change."""
    made = table("Complete self-test", "engine", "change", *COLUMNS, right=range(2, 7))
    for engine, kind, counts in result.rows():
        made.add_row(engine, kind, *(str(count) for count in counts))
    return made


def inert_reasons(result: CompleteTest) -> list[tuple[str, str, int]]:
    """(engine, reason, how many) of what is declared inert and was seen to be."""
    counts = Counter((verdict.engine, verdict.why) for verdict in result.verdicts if verdict.verdict == "inert")
    return [
        (engine, why, count) for (engine, why), count in sorted(counts.items(), key=lambda row: (row[0][0], -row[1]))
    ]
