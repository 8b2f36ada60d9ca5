"""The commands of engines, as ``cli.py`` has the others: arguments and help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simspec.arguments import AsJson
from simspec.commands.guard import command

EngineNames = Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="Engines.")]


def add_engines(app: typer.Typer) -> None:
    """Add the commands of engines to the command line."""
    group = typer.Typer(rich_markup_mode=None, context_settings={"help_option_names": ["--help", "-h"]})
    group.callback(invoke_without_command=True)(command(engines_command))
    group.command("doctor")(command(doctor_command))
    group.command("install")(command(install_command))
    app.add_typer(group, name="engines")
    app.command("trust")(command(trust_command))


def trust_command(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="A simspec.toml, or its folder (default: the nearest one).")
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="Print the files that are trusted.")] = False,
    revoked: Annotated[bool, typer.Option("--revoke", help="Do not trust FILE any more.")] = False,
    as_json: AsJson = False,
) -> int:
    """Let simspec use the interpreters and folders that a project file names, until the file changes.

    A simspec.toml may come from anybody with a repository. Read it first: the interpreters that it names are started, and
    what a relative path leads to in the repository is not looked at. See docs/project-file.md.

    \b
    simspec trust
    simspec trust path/to/simspec.toml
    simspec trust --list
    simspec trust --revoke path/to/simspec.toml
    """
    from simspec.commands.trust import trust

    return trust(file, listed, revoked, as_json)


def engines_command(
    context: typer.Context,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Write the support matrix, and beside it engines.md.")
    ] = False,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Output file of --markdown.")] = Path(
        "docs/support-matrix.md"
    ),
    check: Annotated[
        bool, typer.Option("--check", help="With --markdown: exit with 1 if the page is not current.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """List the engines, their versions, here and in other interpreters, and the features they support.

    Interpreters that simspec.toml names are not started; `simspec engines doctor` starts them.

    \b
    simspec engines
    simspec engines --json
    simspec engines doctor
    """
    if context.invoked_subcommand is not None:
        return 0
    from simspec.commands.engines import engines

    return engines(markdown, out, check, as_json)


def doctor_command(
    names: EngineNames = None,
    every: Annotated[
        bool, typer.Option("--all", help="Exit with 3 also where a known engine is not installed.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Say of each engine whether it is installed and works, in which version, and what is missing and why.

    A ball falls in each for a tenth of a second, in the engine's own process. Exit code 3 where an installed engine does
    not work, or an engine that is named is not there. Interpreters of simspec.toml are started once `simspec trust` has
    been said of it.

    \b
    simspec engines doctor
    simspec engines doctor NAME --json
    """
    from simspec.commands.engines_doctor import doctor

    return doctor(names or [], every, as_json)


def install_command(
    names: EngineNames = None,
    every: Annotated[bool, typer.Option("--all", help="Every known engine that is not installed.")] = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="Run the commands: pip of this interpreter; apt-get only for root.")
    ] = False,
    as_json: AsJson = False,
) -> int:
    """Print the commands that install engines; nothing is run without --yes. NAME@VERSION gets an environment of its own.

    \b
    simspec engines install NAME
    simspec engines install NAME@3.8 --yes
    simspec engines install --all --yes
    """
    from simspec.commands.engines_install import install

    return install(names or [], every, yes, as_json)
