"""What ``simspec run`` and ``simspec diff`` print when they are done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from simspec.comparison.runs import Diff
from simspec.comparison.study import Study
from simspec.report import differences, terminal
from simspec.report.screen import console


def show_run(study: Study, folder: Path, notes: Sequence[str], show: Sequence[str], demand_diff: bool) -> None:
    """Print a study that was written to ``folder``. ``demand_diff``: whether its differences decide the exit code."""
    screen = console()
    terminal.show_study(study, screen, show)
    for note in notes:
        screen.print(f"note: {note}", soft_wrap=True, markup=False)
    screen.print(f"written: {folder}", soft_wrap=True)
    _say_untold(study.diffs if demand_diff else ())
    for name, run in study.runs.items():
        if run.failed is not None:
            console(error=True).print(f"{name} failed: {run.failed}", soft_wrap=True, style="bold red")


def show_diff(diff: Diff) -> None:
    """Print the comparison of two runs."""
    screen = console()
    for table in differences.diff_tables(diff):
        screen.print(table)
    for note in diff.notes:
        screen.print(f"note: {note}", soft_wrap=True)
    _say_untold([diff])


def _say_untold(diffs: Sequence[Diff]) -> None:
    for diff in diffs:
        if (why := differences.inconclusive_note(diff)) is not None:
            console(error=True).print(why, soft_wrap=True, style="yellow", markup=False)
