"""``simspec diff``: how two stored runs, or two specs, differ."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from simspec.commands.options import print_json
from simspec.commands.scenario_options import DiffOptions
from simspec.comparison.floor import load_floor
from simspec.comparison.runs import Diff
from simspec.comparison.runs import diff as compare
from simspec.comparison.worlds import diff_worlds
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.report import differences
from simspec.report.differences import show_diff
from simspec.report.plain import diff_data, plain
from simspec.report.screen import console, say
from simspec.runner.store import load_run
from simspec.world.types import World


def diff(options: DiffOptions) -> int:
    """Compare the runs in two folders, or two specs."""
    a, b = Path(options.a), Path(options.b)
    if a.is_dir() and b.is_dir():
        options.robot_files.check_effect()
        return diff_runs(a, b, options.tolerance, options.as_json)
    if a.is_dir() or b.is_dir():
        raise SpecError([Problem(f"cannot compare {a} with {b}", allowed="two run folders, or two specs")])
    from simspec.commands.loading import load_spec

    loaded = [load_spec(options, name, check_effect=False, warn=False) for name in (options.a, options.b)]
    options.robot_files.check_effect(*(entry.spec for entry in loaded))
    return diff_specs(loaded[0].world, loaded[1].world, options.as_json)


def diff_runs(a: Path, b: Path, tolerance: float, as_json: bool) -> int:
    """Compare two saved runs."""
    floors = [floor for folder in (a, b) if (floor := load_floor(folder)) is not None]
    difference = compare(load_run(a), load_run(b), tolerance=tolerance, floor=floors)
    if as_json:
        print_json(diff_data(difference))
    else:
        show_diff(difference)
    return diff_code([difference])


def diff_specs(a: World, b: World, as_json: bool) -> int:
    """Show the changes between two worlds."""
    changes = diff_worlds(a, b)
    if as_json:
        print_json({"changes": plain(changes)})
    elif changes:
        console().print(differences.changes(changes))
    else:
        say("no differences")
    return EXIT_FAILED if changes else EXIT_OK


def diff_code(diffs: Sequence[Diff]) -> int:
    """The exit code of comparisons: 0 only where all are within tolerance. An inconclusive comparison has not passed."""
    return EXIT_OK if diffs and all(diff.within for diff in diffs) else EXIT_FAILED
