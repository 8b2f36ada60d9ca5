"""A comparison with a baseline, on the terminal and in a job's summary."""

from __future__ import annotations

import math

from rich.console import Console

from simspec.report.baseline import Kind
from simspec.report.compared import Change, Comparison, Row, reasons, table_rows
from simspec.report.kit import table
from simspec.report.summary import table as markdown
from simspec.report.summary import words
from simspec.report.tested import Entry, Status, Suite

SHOWN = 20
"""Regressions that the terminal lists."""
SUMMARISED = 100


def _verdict(comparison: Comparison) -> str:
    worse, better = len(comparison.regressions), comparison.count(Change.BETTER)
    parts = [f"{comparison.compared:,} figures compared", f"{worse:,} regressed" if worse else "none regressed"]
    parts += [f"{better:,} better"] if better else []
    return ", ".join(parts) if comparison.rows else "no figures"


def show_comparison(comparison: Comparison, screen: Console) -> None:
    """Print what regressed, and how much was compared, or not, and why."""
    if comparison.regressions:
        regressed = table("Regressed", "figure", "baseline", "now", "")
        for row in table_rows(comparison, SHOWN):
            regressed.add_row(*row)
        if (left := len(comparison.regressions) - SHOWN) > 0:
            regressed.caption = f"and {left:,} more figures"
        screen.print(regressed)
    screen.print(f"baseline: {_verdict(comparison)}", soft_wrap=True)
    for why, number in reasons(comparison).items():
        screen.print(f"not compared: {number:,} figures: {why}", soft_wrap=True)


def comparison_lines(comparison: Comparison) -> list[str]:
    """The same as Markdown."""
    lines = ["### Baseline", "", f"{_verdict(comparison)}.", ""]
    rows = [[words(cell) for cell in row] for row in table_rows(comparison, SUMMARISED)]
    if rows:
        lines += markdown(("figure", "baseline", "now", ""), rows)
    if (left := len(comparison.regressions) - SUMMARISED) > 0:
        lines += [f"{left:,} more figures regressed.", ""]
    told = [f"- not compared: {number:,} figures: {words(why)}" for why, number in reasons(comparison).items()]
    told += [f"- {words(note)}" for note in comparison.notes]
    return [*lines, *told, ""] if told else lines


def comparison_suite(spec: str, comparison: Comparison) -> Suite:
    """The same as a suite: an entry for each figure that regressed, one for all that did not, one for each reason why figures
    were not compared."""
    entries = [
        Entry(row.key, Status.FAILED, f"{row.why}: {before} in the baseline, now {now}", excess=_excess(row))
        for row, (_, before, now, _) in zip(
            comparison.regressions, table_rows(comparison, len(comparison.regressions)), strict=True
        )
    ]
    good = comparison.compared - sum(row.change is Change.CHANGED for row in comparison.regressions)
    if good:
        entries.append(Entry(f"{good:,} figures did not regress", Status.PASSED))
    if not comparison.compared:
        entries.append(
            Entry("comparison", Status.FAILED, "nothing could be compared with the baseline", excess=math.inf)
        )
    entries += [
        Entry(f"{number:,} figures not compared", Status.SKIPPED, why) for why, number in reasons(comparison).items()
    ]
    return Suite(spec, "baseline", tuple(entries))


def _excess(row: Row) -> float:
    """How many times its noise a figure has moved."""
    if row.before is None or row.now is None or row.before.kind is not Kind.PHYSICS or not row.before.value:
        return math.inf
    noise = max(high - low for low, high in (*row.before.interval, *row.now.interval))
    return math.dist(row.before.value, row.now.value) / noise if noise else math.inf
