"""Reports: ``simspec report``, and files for CI systems: a test report, annotations of the spec's lines, a
summary of the job. ``simspec diff``: how two stored runs, or two specs, differ."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from simspec.commands.experiment_options import ReportOptions
from simspec.commands.options import Options, print_json
from simspec.commands.scenario_options import DiffOptions
from simspec.comparison.floor import load_floor
from simspec.comparison.runs import Diff
from simspec.comparison.runs import diff as compare
from simspec.comparison.worlds import diff_worlds
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SimspecError, SpecError
from simspec.outputs.files import append_text, file_size
from simspec.outputs.targets import RUN, STORE, STUDY, demand, file_problem, read_marker
from simspec.outputs.writing import change_file, write_file
from simspec.report import differences
from simspec.report.differences import show_diff
from simspec.report.screen import console, diff_data, plain, say
from simspec.runner.store import load_run
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.comparison.study import Study
    from simspec.report.tested import TestedSuite


STEP_SUMMARY = "GITHUB_STEP_SUMMARY"
"""Variable of the environment of a step of GitHub Actions: the file that the job's summary is added to."""
SWEEP_FOLDER = "sweep"
"""Folder of the store of ``simspec study``, in the folder of its results."""


@dataclass(frozen=True)
class Reports:
    """Reports for CI systems: ``junit``, ``summary``: files; ``annotate``: whether annotations are printed; ``step_summary``:
    the file of the CI system that the summary is added to."""

    junit: Path | None = None
    annotate: bool = False
    summary: Path | None = None
    step_summary: Path | None = None

    def __bool__(self) -> bool:
        return self != Reports()

    def demand(self) -> None:
        """Raise SpecError, with every problem, when one of the files may not be written: before any work is done."""
        from simspec.report.tested import is_junit, is_summary

        targets = [(self.junit, is_junit), (self.summary, is_summary)]
        demand(file_problem(path, ours) for path, ours in targets if path is not None)

    def write(
        self,
        suites: Sequence[TestedSuite],
        *,
        study: Study | None = None,
        warnings: Sequence[Problem] = (),
        baseline: Sequence[str] = (),
        as_json: bool = False,
    ) -> None:
        """Write all reports. With ``as_json`` annotations go to standard error, which CI systems read as well."""
        from simspec.report.tested import LARGEST, annotation_lines, is_junit, is_summary, junit, summary

        if self.junit is not None:
            write_file(self.junit, junit(suites), is_junit)
        if self.summary is not None:
            write_file(self.summary, summary(suites, study, baseline), is_summary)
        if self.step_summary is not None:
            text = summary(suites, study, baseline, LARGEST - file_size(self.step_summary))
            if not text or not append_text(self.step_summary, text, LARGEST):
                say(f"{self.step_summary}: no room for another summary", error=True)
        if self.annotate:
            for line in annotation_lines(suites, warnings):
                say(line, error=as_json)


def reports_of(options: Options, environment: Mapping[str, str] = os.environ) -> Reports:
    """The reports that options request. ``--github``: annotations, and the summary where GitHub Actions shows it. Raises
    SpecError."""
    summary, github = options.summary, options.github
    step = environment.get(STEP_SUMMARY, "")
    if github and not step:
        hint = "in a step of GitHub Actions it is set; elsewhere: --annotations, --summary FILE"
        raise SpecError([Problem(f"--github: {STEP_SUMMARY} is not set", hint=hint, code="C117")])
    named = summary is not None and bool(step) and os.path.abspath(summary) == os.path.abspath(step)
    return Reports(
        options.junit,
        options.annotations or github,
        None if named else summary,
        Path(step) if github or named else None,
    )


@contextlib.contextmanager
def reporting(options: Options, spec: str) -> Iterator[Reports]:
    """A block whose errors of simspec are reported, too, before they are raised. Targets that may not be written are refused
    before it begins."""
    reports = reports_of(options)
    reports.demand()
    try:
        yield reports
    except SimspecError as error:
        from simspec.report.tested import error_suites

        reports.write(error_suites(spec, error), as_json=options.as_json)
        raise


# --- pages ------------------------------------------------------------------------------------------------------------------


def report(options: ReportOptions) -> int:
    """Write the page of studies and runs, to ``--out`` or into the one folder there is."""
    path = write_page(options.folders, options.out)
    if options.as_json:
        print_json({"file": path, "folders": list(options.folders), "bytes": path.stat().st_size})
    else:
        say(f"written: {path}")
    return EXIT_OK


def write_page(folders: Sequence[Path], out: Path | None) -> Path:
    """Write the page of some studies and runs to ``out``, or into the one folder; its path. A page that is current is left
    alone.

    Raises SpecError when one of them is damaged, or the target may not be written.
    """
    from simspec.report.page.document import is_page
    from simspec.report.screen import PAGE_FILE
    from simspec.runner.store import is_run

    if out is None and len(folders) != 1:
        message = "a report of several folders needs a file of its own"
        raise SpecError([Problem(message, hint="use -o FILE", code="C107")])
    if out is not None:
        demand([file_problem(out, is_page)])
    content = page_of(folders).encode()
    if out is not None:
        return write_file(out, content, is_page)
    (folder,) = folders
    kind = RUN if is_run(folder) else STORE if sweep_folder(folder) == folder else STUDY
    change_file(folder, kind, PAGE_FILE, lambda before: None if before == content else content)
    return folder / PAGE_FILE


def sweep_folder(folder: Path) -> Path | None:
    """The store of a sweep that a folder is, or that it has in place of runs; None where it has runs, or none is there."""
    from simspec.runner.store import stored_runs

    for place in (folder, folder / SWEEP_FOLDER):
        marker = read_marker(place) if place.is_dir() else None
        if marker is not None and marker.kind == STORE:
            return place if place == folder or not stored_runs(folder) else None
    return None


def page_of(folders: Sequence[Path]) -> str:
    """The text of that page. Raises SpecError when a folder is damaged."""
    from simspec.experiments.store import Store
    from simspec.report.page.document import Part, page
    from simspec.report.studies import load_study
    from simspec.report.study.pages import study_parts, study_tables
    from simspec.report.study.sweeps import sweep_parts

    parts: list[Part] = []
    for folder in folders:
        tables, store = study_tables(folder), folder / SWEEP_FOLDER
        if (swept := sweep_folder(folder)) is not None and tables is None:
            parts.append(sweep_parts(Store.open(swept)))
        elif tables is None:
            parts.append(load_study(folder))
        else:
            parts.append(study_parts(tables, Store.open(store) if store.is_dir() else None))
    return page(parts)


# --- diff -------------------------------------------------------------------------------------------------------------------


def diff(options: DiffOptions) -> int:
    """Compare the runs in two folders, or two specs."""
    a, b = Path(options.a), Path(options.b)
    if a.is_dir() and b.is_dir():
        options.robot_files.check_effect()
        return diff_runs(a, b, options.tolerance, options.as_json)
    if a.is_dir() or b.is_dir():
        raise SpecError([Problem(f"cannot compare {a} with {b}", allowed="two run folders, or two specs", code="R108")])

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
