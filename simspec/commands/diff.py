"""``simspec diff``: compare two saved runs, or what two specs mean."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from simspec.arguments import load_spec
from simspec.comparison.floor import load_floor
from simspec.comparison.runs import Diff
from simspec.comparison.runs import diff as compare
from simspec.comparison.worlds import diff_worlds
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.report import differences
from simspec.report.plain import diff_data, plain, text
from simspec.report.screen import console, say
from simspec.report.session import show_diff
from simspec.robot_files import NO_WORDS, RobotFiles
from simspec.runner.store import load_run
from simspec.world.types import World


def diff(
    a: str, b: str, tolerance: float, allow_outside: bool, as_json: bool, robot_files: RobotFiles = NO_WORDS
) -> int:
    """Compare the runs in two folders, or two specs."""
    if Path(a).is_dir() and Path(b).is_dir():
        robot_files.check_effect()
        return diff_runs(Path(a), Path(b), tolerance, as_json)
    if Path(a).is_dir() or Path(b).is_dir():
        raise SpecError([Problem(f"cannot compare {a} with {b}", allowed="two run folders, or two specs")])
    one, other = (
        load_spec(name, None, allow_outside, robot_files=robot_files, check_effect=False, warn=False) for name in (a, b)
    )
    robot_files.check_effect(one.spec, other.spec)
    return diff_specs(one.world, other.world, as_json)


def diff_code(diffs: Sequence[Diff]) -> int:
    """The exit code of comparisons: 0 only where all are told to be within tolerance. What cannot be told did not pass."""
    return EXIT_OK if diffs and all(diff.within for diff in diffs) else EXIT_FAILED


def diff_runs(a: Path, b: Path, tolerance: float, as_json: bool) -> int:
    """Compare two saved runs."""
    runs = load_run(a), load_run(b)
    floors = [floor for folder in (a, b) if (floor := load_floor(folder)) is not None]
    difference = compare(*runs, tolerance=tolerance, floor=floors)
    if as_json:
        sys.stdout.write(text(diff_data(difference)))
    else:
        show_diff(difference)
    return diff_code([difference])


def diff_specs(a: World, b: World, as_json: bool) -> int:
    """Show what changed between two worlds."""
    changes = diff_worlds(a, b)
    if as_json:
        sys.stdout.write(text({"changes": plain(changes)}))
    elif changes:
        console().print(differences.changes(changes))
    else:
        say("no differences")
    return EXIT_FAILED if changes else EXIT_OK
