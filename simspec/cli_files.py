"""The commands about robot files of other languages, as ``cli.py`` has the others: arguments and help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simspec.arguments import Annotations, AsJson, Engines, GitHub, JunitFile, Outside, Pythons, SummaryFile
from simspec.commands.guard import command


def add_files(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    app.command("audit")(command(audit_command))


def audit_command(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Robot files, of any language an engine reads.")
    ],
    engine: Engines = None,
    pair: Annotated[
        bool, typer.Option("--pair", help="Compare what two files of one robot mean, with each other.")
    ] = False,
    details: Annotated[bool, typer.Option("--details", help="Print every finding, not one of each kind.")] = False,
    no_verify: Annotated[
        bool, typer.Option("--no-verify", help="Do not compile the file and prove what engines hold of that.")
    ] = False,
    package_path: Annotated[
        list[Path] | None,
        typer.Option("--package-path", metavar="DIR", help="Folder with packages (package://NAME/). Repeatable."),
    ] = None,
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
        package_path=package_path or [],
        page_file=html,
        allow_outside=allow_outside,
        python=python,
        deadline=deadline,
        as_json=as_json,
        reports=reports_of(junit, annotations, summary, github),
    )
