"""``simspec run`` and ``simspec diff``: do the work, write the results, print the tables; each returns the exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from simspec.comparison.floor import load_floor
from simspec.comparison.runs import Diff, diff
from simspec.comparison.study import study
from simspec.comparison.worlds import diff_worlds
from simspec.errors import EXIT_FAILED, EXIT_OK, Location, Problem, SpecError
from simspec.report import differences, terminal
from simspec.report.final import ends
from simspec.report.plain import diff_data, plain, study_data, text
from simspec.report.results import Results
from simspec.runner.store import load_run
from simspec.world.types import World


def run(
    world: World,
    engines: list[str],
    folder: Path,
    *,
    spec: Path | None = None,
    locate: Callable[[str], Location | None],
    prove: bool,
    repeats: bool,
    keep_going: bool,
    tolerance: float,
    fail_on_diff: bool,
    pythons: Mapping[str, str],
    deadline: float,
    source: Mapping[str, Any],
    as_json: bool,
    warnings: Sequence[Problem] = (),
    show: Sequence[str] = (),
) -> int:
    """Study ``world``, of the file ``spec``, in ``engines``, write ``folder``, and print."""
    if fail_on_diff and len(engines) < 2:
        raise SpecError(
            [Problem("--fail-on-diff compares engines with each other", found=", ".join(engines), allowed="two")]
        )
    results = Results(world, folder)
    results.demand(engines, [spec] if spec is not None else [])
    with terminal.progress(not as_json) as progress:
        found = study(
            world,
            engines,
            arrivals=results,
            prove=prove,
            repeats=repeats,
            keep_going=keep_going,
            tolerance=tolerance,
            pythons=pythons,
            deadline=deadline,
            locate=locate,
            source=source,
            progress=progress,
        )
        progress("writing")
        results.finish(found)
    code = found.exit_code
    if code == EXIT_OK and fail_on_diff:
        code = diff_code(found.diffs)
    if as_json:
        more = {"exit_code": code, "folder": folder, "notes": results.notes, "warnings": warnings}
        more["ends"] = {name: ends(one, show) for name, one in found.runs.items()}
        sys.stdout.write(text({**study_data(found), **more}))
        return code
    screen = terminal.console()
    terminal.show_study(found, screen, show)
    for note in results.notes:
        screen.print(f"note: {note}", soft_wrap=True, markup=False)
    screen.print(f"written: {folder}", soft_wrap=True)
    _say_untold(found.diffs if fail_on_diff else ())
    for name, one in found.runs.items():
        if one.failed is not None:
            terminal.console(error=True).print(f"{name} failed: {one.failed}", soft_wrap=True, style="bold red")
    return code


def diff_code(diffs: Sequence[Diff]) -> int:
    """The exit code of comparisons: 0 only where all are told to be within tolerance. What cannot be told did not pass."""
    return EXIT_OK if diffs and all(one.within for one in diffs) else EXIT_FAILED


def _say_untold(diffs: Sequence[Diff]) -> None:
    for one in diffs:
        if (why := differences.cannot_be_told(one)) is not None:
            terminal.console(error=True).print(why, soft_wrap=True, style="yellow", markup=False)


def diff_runs(a: Path, b: Path, tolerance: float, as_json: bool) -> int:
    """Compare two saved runs."""
    runs = load_run(a), load_run(b)
    floors = [floor for folder in (a, b) if (floor := load_floor(folder)) is not None]
    found = diff(*runs, tolerance=tolerance, floor=floors)
    if as_json:
        sys.stdout.write(text(diff_data(found)))
    else:
        screen = terminal.console()
        for table in differences.diff_tables(found):
            screen.print(table)
        for note in found.notes:
            screen.print(f"note: {note}", soft_wrap=True)
        _say_untold([found])
    return diff_code([found])


def diff_specs(a: World, b: World, as_json: bool) -> int:
    """Show what changed between two worlds."""
    found = diff_worlds(a, b)
    if as_json:
        sys.stdout.write(text({"changes": plain(found)}))
    elif found:
        terminal.console().print(differences.changes(found))
    else:
        print("the same world")
    return EXIT_FAILED if found else EXIT_OK
