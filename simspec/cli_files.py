"""The commands of robot files of other languages, as ``cli.py`` has the others: arguments and help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simspec.arguments import (
    Annotations,
    AsJson,
    Engines,
    GitHub,
    JunitFile,
    Outside,
    Pythons,
    Sets,
    Strict,
    SummaryFile,
)
from simspec.commands.guard import command
from simspec.robot_files import NO_WORDS, RobotFiles, reads_robot_files


def add_imports(app: typer.Typer) -> None:
    """Add the commands that read and write such files to the command line."""
    app.command("import")(command(reads_robot_files(import_command)))
    app.command("export")(command(reads_robot_files(export_command)))


def add_audit(app: typer.Typer) -> None:
    """Add the command that compares what engines make of such files."""
    app.command("audit")(command(reads_robot_files(audit_command)))


def import_command(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE", help="A robot file of another language, or a robot of robot_descriptions by name."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Output file (default: standard output).")
    ] = None,
    meshes: Annotated[
        Path | None, typer.Option("--meshes", metavar="DIR", help="Copy the meshes to this folder, and name those.")
    ] = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit with 2, and write nothing, where something lost changes physics.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Write a robot file of another language as a spec, and list what it does not carry.

    Every element and attribute is carried, carried without effect, or lost with its reason. Defects of the file are
    errors; --repair RULE repairs those of a kind, with a comment in the spec (docs/import.md).

    \b
    simspec import FILE -o robot.yaml
    simspec import FILE --repair triangle-inequality --strict
    simspec import FILE --package-path ~/ros/src -o robot.yaml
    simspec import panda_description -o panda.yaml
    """
    from simspec.commands.importing import import_file

    return import_file(
        file,
        out,
        meshes=meshes,
        robot_files=robot_files,
        allow_outside=allow_outside,
        strict=strict,
        as_json=as_json,
    )


def export_command(
    specs: Annotated[list[str], typer.Argument(metavar="SPEC...", help="YAML files, or library scenarios.")],
    format_name: Annotated[str, typer.Option("--format", metavar="NAME", help="The format of the files.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Output folder (default plain/NAME/FORMAT); of several, DIR/NAME; or FILE, by its suffix, where a format has "
            "single files.",
        ),
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option("--profile", metavar="NAME", help="The layout of the files, where a format has several."),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit with 1 if the folder is not current.")
    ] = False,
    sets: Sets = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    strict: Strict = False,
    as_json: AsJson = False,
) -> int:
    """Write specs as plain files for other tools, and list what the files do not carry.

    The same as `compile --format`. --strict makes what is lost of the bodies an error; nothing is written then.

    \b
    simspec export robot.yaml --format FORMAT
    simspec export robot.yaml --format FORMAT -o build/robot --strict
    simspec export robot.yaml --format FORMAT -o robot.SUFFIX
    """
    from simspec.commands.compile import compile_specs

    return compile_specs(
        specs,
        None,
        format_name,
        out,
        profile=profile,
        check=check,
        explain=False,
        sets=sets,
        allow_outside=allow_outside,
        robot_files=robot_files,
        strict=strict,
        as_json=as_json,
    )


def audit_command(
    files: Annotated[
        list[str], typer.Argument(metavar="FILE...", help="Robot files, of any language an engine reads.")
    ],
    engine: Engines = None,
    pair: Annotated[
        bool, typer.Option("--pair", help="Compare what two files of one robot mean, with each other.")
    ] = False,
    details: Annotated[bool, typer.Option("--details", help="Print every finding, not one of each kind.")] = False,
    no_verify: Annotated[
        bool, typer.Option("--no-verify", help="Do not compile the file and prove what engines hold of that.")
    ] = False,
    robot_files: RobotFiles = NO_WORDS,
    html: Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Also write a page.")] = None,
    allow_outside: Outside = False,
    python: Pythons = None,
    deadline: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.1, help="Deadline of one engine for one file.")
    ] = 60.0,
    junit: JunitFile = None,
    annotations: Annotations = False,
    summary: SummaryFile = None,
    github: GitHub = False,
    as_json: AsJson = False,
) -> int:
    """Load robot files as they are in every engine that reads them, and list what each engine changes, drops or refuses.

    Each engine loads the file by its own loader with its defaults, in a process of its own, and is asked what it
    holds; that is compared with what the file means. Then the same file is compiled by simspec and proven.

    \b
    simspec audit ROBOT
    simspec audit robots/* --junit audit.xml --html audit.html
    simspec audit ROBOT OTHER --pair       two files of one robot
    Exit codes: 0 nothing is changed in silence; 1 findings; 2 a file is wrong; 3 an engine died.
    """
    from simspec.commands.audit import audit
    from simspec.commands.ci import reports_of

    return audit(
        files,
        engine,
        pair=pair,
        details=details,
        verify=not no_verify,
        robot_files=robot_files,
        page_file=html,
        allow_outside=allow_outside,
        python=python,
        deadline=deadline,
        as_json=as_json,
        reports=reports_of(junit, annotations, summary, github),
    )
