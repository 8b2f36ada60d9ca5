"""``simspec verify``: prove, write the certificate, print; each function returns the exit code."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from simspec import generated
from simspec.arguments import chosen_engines, engines_at_work, interpreters, load_spec, spec_file
from simspec.commands.accept import is_writable
from simspec.commands.ci import NO_REPORTS, Reports, reporting
from simspec.commands.self_test import complete_self_test, self_test
from simspec.engines.kit.identity import engine_version
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, Location, Problem, SpecError
from simspec.outputs.marker import COMPILED, STUDY
from simspec.outputs.targets import demand, existing_name_problem, folder_problem
from simspec.outputs.writing import add_file
from simspec.report import terminal
from simspec.report.plain import certificate_data, text
from simspec.report.progress import progress
from simspec.report.refusals import with_ways_out
from simspec.report.screen import console
from simspec.report.tested import certificate_suites, skipped_suites
from simspec.robot_files import NO_WORDS, RobotFiles
from simspec.selection import Selection
from simspec.world.types import World

if TYPE_CHECKING:
    from rich.console import Console

    from simspec.proof.certificate import Certificate

PLOTS = Path("runs")
"""Where plots go, in a folder of the world's name: the generated folder holds what compiling and proving write, and no more."""


def verify(
    spec: str | None,
    engine: list[str] | None,
    *,
    planted: bool,
    complete: bool,
    contact: bool,
    cache: bool,
    out: Path | None,
    sets: list[str] | None,
    allow_outside: bool,
    robot_files: RobotFiles = NO_WORDS,
    strict: bool,
    python: list[str] | None,
    deadline: float,
    as_json: bool,
    reports: Reports = NO_REPORTS,
) -> int:
    """Verify ``spec``, or with ``planted`` test the proof itself (``complete``: with every change that files can suffer)."""
    pythons = interpreters(python, engine)
    if (spec is None) != planted:
        raise SpecError([Problem("nothing to verify", allowed="either SPEC or --self-test")])
    if planted:
        robot_files.check_effect()
    if planted and reports:
        raise SpecError([Problem("--junit, --annotations, --summary and --github require SPEC")])
    selection = engines_at_work(chosen_engines(engine), pythons, files_alone=not planted)
    if complete and (spec is not None or any(map(engine_version, selection.engines))):
        raise SpecError([Problem("--complete requires --self-test, and engines without a version in their name")])
    if complete:
        return complete_self_test(selection.engines, pythons, as_json)
    if spec is None:
        return self_test(selection.engines, pythons, as_json)
    with reporting(reports, spec, as_json):
        loaded, world, warned, _ = load_spec(
            spec, sets, allow_outside, robot_files=robot_files, strict=strict, as_json=as_json
        )
        check_targets(world, spec, out, contact)
        with with_ways_out(spec, selection.engines, world, pythons, is_writable(loaded)):
            return verify_world(
                world,
                selection,
                loaded.locate,
                pythons,
                deadline,
                out,
                as_json,
                contact,
                cache,
                warnings=warned,
                reports=reports,
            )


def check_targets(world: World, spec: str, out: Path | None, contact: bool) -> None:
    """Raise SpecError when what would be written may not be: before anything is compiled or proven.

    ``contact``: whether plots are written too.
    """
    folder = out or generated.GENERATED / world.name
    problems = [folder_problem(folder, COMPILED, [spec_file(spec)])]
    problems += [] if any(problems) else [existing_name_problem(folder, generated.CERTIFICATE_FILE)]
    if contact:
        problems.append(folder_problem(PLOTS / world.name, STUDY))
    demand(problems)


def verify_world(
    world: World,
    selection: Selection,
    locate: Callable[[str], Location | None],
    pythons: Mapping[str, str],
    deadline: float,
    out: Path | None,
    as_json: bool,
    contact: bool = False,
    cache: bool = True,
    *,
    warnings: Sequence[Problem] = (),
    reports: Reports = NO_REPORTS,
) -> int:
    """Compile ``world`` into its generated folder, verify what is there, and write the certificate beside it.

    Reports, verdict and exit code are of the engines that are verified now. Proofs of others stay in the file while they hold.
    """
    from simspec.proof.verify import verify as prove

    selection = selection.for_world(world, locate)
    folder = out or generated.GENERATED / world.name
    built = generated.build(world, selection, locate)
    before = generated.write(built, folder).stored
    with progress(not as_json) as tell:
        # in a private copy: the folder may be written again meanwhile, and its certificate names the hashes of these files
        certificate = prove(
            world,
            selection.engines,
            compiled=built.compiled,
            pythons=pythons,
            locate=locate,
            deadline=deadline,
            progress=tell,
            cache=cache,
        )
    written = generated.write_certificate(certificate, world, folder)
    stored = written.stored if before is None else written.stored.after(before.without(certificate.engines))
    path = folder / generated.CERTIFICATE_FILE
    suites = certificate_suites(certificate, world, locate)
    reports.write([*suites, *skipped_suites(world.name, selection.not_taken)], warnings=warnings, as_json=as_json)
    if as_json:
        sys.stdout.write(
            text(
                {
                    "certificate": certificate_data(certificate),
                    "valid": certificate.valid,
                    "file": path,
                    "stored": stored.data(),
                    "not_verified": selection.not_taken,
                    "warnings": warnings,
                }
            )
        )
    else:
        screen = console()
        terminal.show_not_taken(selection, screen)
        terminal.show_certificate(certificate, screen)
        if contact:
            for path_of_plot in show_contact(certificate, world, screen):
                screen.print(f"{path_of_plot}: written", soft_wrap=True)
        screen.print(f"{path}: {'written' if written.changed else 'unchanged'}", soft_wrap=True)
        for line in stored.lines():
            screen.print(f"  {line}", soft_wrap=True, markup=False)
    if certificate.valid:
        return EXIT_OK
    # what passed and is not valid was asked of no engine
    return EXIT_ENGINE if all(proof.passed for proof in certificate.engines.values()) else EXIT_FAILED


def show_contact(certificate: Certificate, world: World, screen: Console) -> list[Path]:
    """Print every contact figure, and draw required against measured friction; returns the plots' files."""
    from simspec.report.contact import contact_table
    from simspec.report.polar import polar_plot

    figures = {name: proof.contact for name, proof in certificate.engines.items() if proof.contact}
    if not figures:
        screen.print("no two bodies of this world can touch: no contact measured")
        return []
    for table in contact_table(figures):
        screen.print(table)
    drawn = polar_plot(figures, world.contact.friction_cone)
    return [add_file(PLOTS / world.name, STUDY, f"contact{suffix}", picture) for suffix, picture in drawn.items()]
