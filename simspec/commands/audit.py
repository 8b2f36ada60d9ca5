"""``simspec audit``: how engines read robot files that they load as they are."""

from __future__ import annotations

from pathlib import Path

from simspec.audit import FileAudit
from simspec.audit.audit import audit as audit_file
from simspec.audit.audit import pair as compare_pair
from simspec.commands.loading import spec_name
from simspec.commands.options import engines_at_work, print_json
from simspec.commands.reports import reporting
from simspec.commands.scenario_options import AuditOptions
from simspec.confinement import walls
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.language.foreign import ImportOptions, suffixes
from simspec.language.packages import is_packaged, is_robot, packaged
from simspec.language.sources import of_package
from simspec.outputs.targets import demand, file_problem
from simspec.outputs.writing import write_file
from simspec.report.audit import audit_data, audit_section, audit_suites, pair_data, show_audit, show_pair
from simspec.report.page.document import is_page, page
from simspec.report.screen import progress, say


def audit(options: AuditOptions) -> int:
    """Audit files one after the other; 0 where no engine changes, drops or refuses anything in silence, 1 where one
    does, 3 where an engine died."""
    files, page_file = options.files, options.html
    imports = options.robot_files.options()
    if options.pair:
        return _pair(options, imports)
    pythons = options.interpreters()
    selection = engines_at_work(options.chosen, pythons)
    if page_file is not None:
        demand([file_problem(page_file, is_page)])
    with reporting(options, ", ".join(files[:3])) as reports:
        audits: list[FileAudit] = []
        with progress(not options.as_json) as tell, WarmProcesses() as warm:
            for file in files:
                path, said = _robot(file, imports)
                audits.append(
                    audit_file(
                        path,
                        selection.engines,
                        said,
                        pythons=pythons,
                        deadline=options.deadline,
                        prove=not options.no_verify,
                        allow_outside=options.allow_outside,
                        progress=tell,
                        warm=warm,
                    )
                )
        reports.write(audit_suites(audits), as_json=options.as_json)
        if page_file is not None:
            content = page([lambda packed: [audit_section(audit) for audit in audits]])
            write_file(page_file, content.encode(), is_page)
    if options.as_json:
        print_json(audit_data(audits))
    else:
        for entry in audits:
            show_audit(entry, options.details)
        if page_file is not None:
            say(f"written: {page_file}")
        if walls().why:
            say(f"engines loaded the files without confinement: {walls().why} (docs/concepts/security.md)")
    if any(entry.died for entry in audits):
        return EXIT_ENGINE
    return EXIT_OK if all(entry.clean for entry in audits) else EXIT_FAILED


def _robot(name: str, options: ImportOptions) -> tuple[Path, ImportOptions]:
    """The file that an argument means, a path or a name of one of an installed package, and the options of its importer."""
    if not is_packaged(name) and (Path(name).exists() or not is_robot(name)):
        return Path(name), options
    found = packaged(spec_name(name), suffixes())
    return found.path, of_package(options, found)


def _pair(options: AuditOptions, imports: ImportOptions) -> int:
    if len(options.files) != 2:
        raise SpecError([Problem("--pair compares two files", found=str(len(options.files)))])
    first, second = (_robot(file, imports) for file in options.files)
    found = compare_pair(first, second, options.allow_outside)
    if options.as_json:
        print_json(pair_data(found))
    else:
        show_pair(found)
    return EXIT_OK if found.same else EXIT_FAILED
