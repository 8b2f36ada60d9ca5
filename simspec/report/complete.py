"""What became of every change of a complete self-test: as a table, and as data."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from simspec.report.kit import table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from simspec.proof.complete import CompleteTest

COLUMNS = ("planted", "caught", "refused", "inert", "missed")
SHOWN = 40
"""Missed changes that the terminal lists; ``--json`` has all."""


def complete_data(found: CompleteTest) -> dict[str, Any]:
    """A complete self-test as plain data."""
    rows = [
        {"engine": engine, "kind": kind, **dict(zip(COLUMNS, counts, strict=True))}
        for engine, kind, counts in found.rows()
    ]
    return {
        "passed": found.passed,
        "versions": found.versions,
        "seconds": found.seconds,
        "skipped": found.skipped,
        "rows": rows,
        "inert": [{"engine": engine, "reason": why, "count": count} for engine, why, count in inert_reasons(found)],
        "unused": found.unused,
        "mutations": found.verdicts,
    }


def show_complete(found: CompleteTest, screen: Console) -> None:
    """Print the table, and what was missed and skipped."""
    screen.print(complete_table(found))
    for one in found.missed[:SHOWN]:
        screen.print(
            f"MISSED {one.engine}, {one.world}: {one.file} {one.place}: {one.kind} {one.change} {one.why}",
            markup=False,
        )
    if len(found.missed) > SHOWN:
        screen.print(f"and {len(found.missed) - SHOWN} more (--json lists all)")
    for where, why in found.skipped.items():
        screen.print(f"{where}: {why}", markup=False)
    for engine, rows in found.unused.items():
        for row in rows:
            screen.print(f"{engine}: declared inert, and no change needs it: {row}", markup=False)
    planted, missed = found.count(), len(found.missed)
    screen.print(f"missed {missed} of {planted} changes, in {found.seconds / 60.0:.0f} min")


def complete_table(found: CompleteTest) -> Table:
    """A row for each engine and kind of change."""
    made = table("Complete self-test", "engine", "change", *COLUMNS, right=range(2, 7))
    for engine, kind, counts in found.rows():
        made.add_row(engine, kind, *(str(count) for count in counts))
    return made


def inert_reasons(found: CompleteTest) -> list[tuple[str, str, int]]:
    """(engine, reason, how many) of what is declared inert and was seen to be."""
    counts = Counter((one.engine, one.why) for one in found.verdicts if one.verdict == "inert")
    return [
        (engine, why, count) for (engine, why), count in sorted(counts.items(), key=lambda row: (row[0][0], -row[1]))
    ]
