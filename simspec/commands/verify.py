"""``simspec verify``: prove, write the certificate, print; with ``--self-test``, count the planted defects that are caught.
``simspec audit``: how engines read robot files that they load as they are."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from simspec import generated
from simspec.audit import FileAudit
from simspec.audit.audit import audit as audit_file
from simspec.audit.audit import pair as compare_pair
from simspec.commands.check import is_writable
from simspec.commands.loading import LoadedSpec, load_spec, spec_name
from simspec.commands.options import engines_at_work, print_json
from simspec.commands.reports import reporting, reports_of
from simspec.commands.scenario_options import AuditOptions, VerifyOptions
from simspec.confinement import walls
from simspec.engines.kit.registry import engine_version
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.language.foreign import ImportOptions, suffixes
from simspec.language.packages import is_packaged, is_robot, packaged
from simspec.language.sources import of_package
from simspec.outputs.targets import COMPILED, STUDY, demand, existing_name_problem, file_problem, folder_problem
from simspec.outputs.writing import add_file, write_file
from simspec.processes import Ended
from simspec.report.audit import audit_data, audit_section, audit_suites, engine_line, pair_data, show_audit, show_pair
from simspec.report.certificate import complete_data, self_test_table, show_certificate, show_complete
from simspec.report.page.document import is_page, page
from simspec.report.problems import show_not_taken, with_ways_out
from simspec.report.screen import certificate_data, console, progress, say
from simspec.report.tested import certificate_suites, skipped_suites
from simspec.selection import Selection
from simspec.world.types import World

if TYPE_CHECKING:
    from rich.console import Console

    from simspec.proof.certificate import Certificate


PLOTS = Path("runs")
"""Folder of plots, below it the world's name: the generated folder contains only compiled files and their certificate."""


def verify(options: VerifyOptions) -> int:
    """Verify a spec, or test the proof itself (``complete``: with every possible change of the files)."""
    if options.accept and options.spec is None:
        raise SpecError([Problem("--accept requires SPEC", code="C102")])
    pythons = options.interpreters()
    if (options.spec is None) != options.self_test:
        raise SpecError([Problem("nothing to verify", allowed="either SPEC or --self-test", code="C102")])
    if options.self_test:
        options.robot_files.check_effect()
    if options.self_test and reports_of(options):
        raise SpecError([Problem("--junit, --annotations, --summary and --github require SPEC", code="C102")])
    selection = engines_at_work(options.chosen, pythons, files_alone=not options.self_test)
    if options.complete and (options.spec is not None or any(map(engine_version, selection.engines))):
        raise SpecError(
            [Problem("--complete requires --self-test, and engines without a version in their name", code="C102")]
        )
    if options.complete:
        return complete_self_test(selection.engines, pythons, options.as_json)
    if options.spec is None:
        return self_test(selection.engines, pythons, options.as_json)
    with reporting(options, options.spec):
        loaded = load_spec(options, options.spec)
        _demand_targets(options, loaded)
        with with_ways_out(options.spec, selection.engines, loaded.world, pythons, is_writable(loaded.spec)):
            return _verify(options, loaded, selection)


def _demand_targets(options: VerifyOptions, loaded: LoadedSpec) -> None:
    """Raise SpecError when a target may not be written: before anything is compiled or proven."""
    folder = options.out or generated.GENERATED / loaded.world.name
    problems = [folder_problem(folder, COMPILED, [loaded.file])]
    problems += [] if any(problems) else [existing_name_problem(folder, generated.CERTIFICATE_FILE)]
    if options.contact:
        problems.append(folder_problem(PLOTS / loaded.world.name, STUDY))
    demand(problems)


def _verify(options: VerifyOptions, loaded: LoadedSpec, selection: Selection) -> int:
    """Compile a world into its generated folder, verify these files, and write the certificate.

    Reports, verdict and exit code are of the engines that are verified now. Proofs of others stay in the file while they hold.
    """
    from simspec.proof.verify import verify as prove

    world, locate = loaded.world, loaded.spec.locate
    selection = selection.for_world(world, locate)
    folder = options.out or generated.GENERATED / world.name
    built = generated.build(world, selection, locate)
    before = generated.write(built, folder).stored
    with progress(not options.as_json) as tell:
        # in a private copy: the folder may be written again meanwhile, and its certificate names the hashes of these files
        certificate = prove(
            world,
            selection.engines,
            compiled=built.compiled,
            pythons=selection.pythons,
            locate=locate,
            deadline=options.deadline,
            progress=tell,
            cache=not options.no_cache,
        )
    written = generated.write_certificate(certificate, world, folder)
    stored = written.stored if before is None else written.stored.after(before.without(certificate.engines))
    path = folder / generated.CERTIFICATE_FILE
    suites = [*certificate_suites(certificate, world, locate), *skipped_suites(world.name, selection.not_taken)]
    reports_of(options).write(suites, warnings=loaded.warnings, as_json=options.as_json)
    if options.as_json:
        print_json(
            {
                "certificate": certificate_data(certificate),
                "valid": certificate.valid,
                "file": path,
                "stored": stored.data(),
                "not_verified": selection.not_taken,
                "warnings": loaded.warnings,
            }
        )
    else:
        screen = console()
        show_not_taken(selection, screen)
        show_certificate(certificate, screen)
        if options.contact:
            for plot in show_contact(certificate, world, screen):
                screen.print(f"{plot}: written", soft_wrap=True)
        screen.print(f"{path}: {'written' if written.changed else 'unchanged'}", soft_wrap=True)
        for line in stored.lines():
            screen.note(f"  {line}")
    if certificate.valid:
        return EXIT_OK
    # passed but not valid: no engine was queried
    return EXIT_ENGINE if all(proof.passed for proof in certificate.engines.values()) else EXIT_FAILED


def show_contact(certificate: Certificate, world: World, screen: Console) -> list[Path]:
    """Print every contact figure, and draw required against measured friction; returns the plots' files."""
    from simspec.report.certificate import contact_table
    from simspec.report.figures import polar_plot

    figures = {name: proof.contact for name, proof in certificate.engines.items() if proof.contact}
    if not figures:
        screen.print("no two bodies of this world can touch: no contact measured")
        return []
    for table in contact_table(figures):
        screen.print(table)
    drawn = polar_plot(figures, world.contact.friction_cone)
    return [add_file(PLOTS / world.name, STUDY, f"contact{suffix}", picture) for suffix, picture in drawn.items()]


def self_test(engines: Sequence[str], pythons: Mapping[str, str], as_json: bool) -> int:
    """Plant defects into compiled files, one at a time, and count those that the proof catches."""
    from simspec.proof.selftest import self_test as plant

    with progress(not as_json) as tell:
        result = plant(engines, pythons=pythons, progress=tell)
    if as_json:
        print_json({"planted": result.planted, "caught": result.caught, "outcomes": result.outcomes})
    else:
        screen = console()
        screen.print(self_test_table(result))
        screen.print(f"caught {result.caught} of {result.planted} planted defects")
    return EXIT_OK if result.passed else EXIT_FAILED


def complete_self_test(engines: Sequence[str], pythons: Mapping[str, str], as_json: bool) -> int:
    """Try every possible change of compiled files, and report those that the proof misses."""
    from simspec.proof.complete import complete_self_test as plant

    result = plant(engines, pythons=pythons, progress=lambda line: say(line, error=True))
    if as_json:
        print_json(complete_data(result))
    else:
        show_complete(result, console())
    return EXIT_OK if result.passed else EXIT_FAILED


# --- audit ------------------------------------------------------------------------------------------------------------------


def audit(options: AuditOptions) -> int:
    """Audit files one after the other; 0 where no engine changes, drops or refuses anything in silence, 1 where one
    does, 3 where an engine died."""
    files, page_file = options.files, options.html
    imports = options.robot_files.options()
    if options.pair:
        return _pair(options, imports)
    pythons = options.interpreters()
    selection = engines_at_work(options.chosen, pythons, audits=True)
    if page_file is not None:
        demand([file_problem(page_file, is_page)])
    with reporting(options, ", ".join(files[:3])) as reports:
        audits: list[FileAudit] = []
        shown = Shown(options)
        with shown.interrupted(audits), progress(not options.as_json) as tell, WarmProcesses() as warm:
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
                        arrived=shown.arrived,
                        warm=warm,
                    )
                )
                shown.partial = None
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


class Shown:
    """The lines of engines that have finished while others load the file; after an interrupt, the tables so far."""

    def __init__(self, options: AuditOptions):
        self._options = options
        self.partial: FileAudit | None = None
        """The audit of the file that is being loaded."""

    def arrived(self, partial: FileAudit) -> None:
        """Print a line for the engine that finished last; on standard error, where progress is."""
        self.partial = partial
        if not self._options.as_json:
            say(f"{Path(partial.file).name}: {engine_line(partial.engines[-1])}", error=True)

    @contextlib.contextmanager
    def interrupted(self, audits: Sequence[FileAudit]) -> Iterator[None]:
        """Print the audits that there are when a signal ends the block; the command then ends as the signal says."""
        try:
            yield
        except Ended:
            if not self._options.as_json:
                for entry in audits:
                    show_audit(entry, self._options.details)
                if self.partial is not None:
                    show_audit(self.partial, self._options.details, interrupted=True)
            raise


def _robot(name: str, options: ImportOptions) -> tuple[Path, ImportOptions]:
    """The file that an argument means, a path or a name of one of an installed package, and the options of its importer."""
    if not is_packaged(name) and (Path(name).exists() or not is_robot(name)):
        return Path(name), options
    found = packaged(spec_name(name), suffixes())
    return found.path, of_package(options, found)


def _pair(options: AuditOptions, imports: ImportOptions) -> int:
    if len(options.files) != 2:
        raise SpecError([Problem("--pair compares two files", found=str(len(options.files)), code="R108")])
    first, second = (_robot(file, imports) for file in options.files)
    found = compare_pair(first, second, options.allow_outside)
    if options.as_json:
        print_json(pair_data(found))
    else:
        show_pair(found)
    return EXIT_OK if found.same else EXIT_FAILED
