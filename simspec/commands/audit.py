"""``simspec audit``: what engines make of robot files that they load as they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from simspec.arguments import chosen_engines, engines_at_work, interpreters, print_json
from simspec.audit.audit import audit as audit_file
from simspec.audit.findings import FileAudit
from simspec.audit.pair import pair as compare_pair
from simspec.commands.ci import NO_REPORTS, Reports, reporting
from simspec.confinement import walls
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.language.foreign import ImportOptions
from simspec.outputs.targets import demand, file_problem
from simspec.outputs.writing import write_file
from simspec.report.audit import audit_data, audit_sections, audit_suites, pair_data, show_audit, show_pair
from simspec.report.page.document import is_page, page
from simspec.report.progress import progress
from simspec.report.screen import say
from simspec.robot_files import NO_WORDS, RobotFiles


def audit(
    files: Sequence[Path],
    engine: list[str] | None,
    *,
    pair: bool,
    details: bool,
    verify: bool,
    robot_files: RobotFiles = NO_WORDS,
    page_file: Path | None,
    allow_outside: bool,
    python: list[str] | None,
    deadline: float,
    as_json: bool,
    reports: Reports = NO_REPORTS,
) -> int:
    """Audit files one after the other; 0 where no engine changes, drops or refuses anything in silence, 1 where one
    does, 3 where an engine died."""
    options = robot_files.options()
    if pair:
        return _pair(files, options, allow_outside, as_json)
    pythons = interpreters(python, engine)
    selection = engines_at_work(chosen_engines(engine), pythons)
    if page_file is not None:
        demand([file_problem(page_file, is_page)])
    with reporting(reports, ", ".join(str(path) for path in files[:3]), as_json):
        audits: list[FileAudit] = []
        with progress(not as_json) as tell, WarmProcesses() as warm:
            for path in files:
                audits.append(
                    audit_file(
                        path,
                        selection.engines,
                        options,
                        pythons=pythons,
                        deadline=deadline,
                        prove=verify,
                        allow_outside=allow_outside,
                        progress=tell,
                        warm=warm,
                    )
                )
        reports.write(audit_suites(audits), as_json=as_json)
        if page_file is not None:
            write_file(page_file, page([audit_sections(audits)]).encode(), is_page)
    if as_json:
        print_json(audit_data(audits))
    else:
        for one in audits:
            show_audit(one, details)
        if page_file is not None:
            say(f"written: {page_file}")
        if walls().why:
            say(f"engines loaded the files without confinement: {walls().why} (docs/security.md)")
    if any(one.died for one in audits):
        return EXIT_ENGINE
    return EXIT_OK if all(one.clean for one in audits) else EXIT_FAILED


def _pair(files: Sequence[Path], options: ImportOptions, allow_outside: bool, as_json: bool) -> int:
    if len(files) != 2:
        raise SpecError([Problem("--pair compares two files", found=str(len(files)))])
    found = compare_pair(files[0], files[1], options, allow_outside)
    if as_json:
        print_json(pair_data(found))
    else:
        show_pair(found)
    return EXIT_OK if found.same else EXIT_FAILED
