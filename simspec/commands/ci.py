"""What commands write for CI systems: a test report, annotations of the spec's lines, a summary of the job."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from simspec.errors import Problem, SimspecError, SpecError
from simspec.outputs.appending import append_text, size_of
from simspec.outputs.targets import demand, file_problem
from simspec.outputs.writing import write_file
from simspec.report.screen import say

if TYPE_CHECKING:
    from simspec.comparison.study import Study
    from simspec.report.tested import Suite

STEP_SUMMARY = "GITHUB_STEP_SUMMARY"
"""Names, in a step of GitHub Actions, the file that the job's summary is added to."""


@dataclass(frozen=True)
class Reports:
    """What is to be written: ``junit``, ``summary``: files; ``annotate``: whether annotations are printed;
    ``step_summary``: the file of the CI system that the summary is added to."""

    junit: Path | None = None
    annotate: bool = False
    summary: Path | None = None
    step_summary: Path | None = None

    def __bool__(self) -> bool:
        return self != NO_REPORTS

    def demand(self) -> None:
        """Raise SpecError, with every problem, when one of the files may not be written: before any work is done."""
        from simspec.report.junit import own_junit
        from simspec.report.summary import own_summary

        targets = [(self.junit, own_junit), (self.summary, own_summary)]
        demand(file_problem(path, ours) for path, ours in targets if path is not None)

    def write(
        self,
        suites: Sequence[Suite],
        *,
        study: Study | None = None,
        warnings: Sequence[Problem] = (),
        baseline: Sequence[str] = (),
        as_json: bool = False,
    ) -> None:
        """Write all that is asked for. With ``as_json`` annotations go to standard error, which CI systems read as well."""
        from simspec.report.annotations import annotation_lines
        from simspec.report.junit import junit, own_junit
        from simspec.report.summary import LARGEST, own_summary, summary

        if self.junit is not None:
            write_file(self.junit, junit(suites), own_junit)
        if self.summary is not None:
            write_file(self.summary, summary(suites, study, baseline), own_summary)
        if self.step_summary is not None:
            text = summary(suites, study, baseline, LARGEST - size_of(self.step_summary))
            if not text or not append_text(self.step_summary, text, LARGEST):
                say(f"{self.step_summary}: no room for another summary", error=True)
        if self.annotate:
            for line in annotation_lines(suites, warnings):
                say(line, error=as_json)


NO_REPORTS = Reports()


def reports_of(
    junit: Path | None,
    annotate: bool,
    summary: Path | None,
    github: bool,
    environment: Mapping[str, str] = os.environ,
) -> Reports:
    """What the options ask for. ``github``: annotations, and the summary where GitHub Actions shows it. Raises SpecError."""
    step = environment.get(STEP_SUMMARY, "")
    if github and not step:
        hint = "in a step of GitHub Actions it is set; elsewhere: --annotations, --summary FILE"
        raise SpecError([Problem(f"--github: {STEP_SUMMARY} is not set", hint=hint)])
    named = summary is not None and bool(step) and os.path.abspath(summary) == os.path.abspath(step)
    return Reports(
        junit,
        annotate or github,
        None if named else summary,
        Path(step) if github or named else None,
    )


@contextlib.contextmanager
def reporting(reports: Reports, spec: str, as_json: bool) -> Iterator[None]:
    """A block whose errors of simspec are reported too, before they are raised. What may not be written is said first."""
    reports.demand()
    try:
        yield
    except SimspecError as error:
        from simspec.report.tested import error_suites

        reports.write(error_suites(spec, error), as_json=as_json)
        raise
