"""The commands of experiments, as ``cli.py`` has the others: arguments and help; the work is done in ``simspec.commands``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simspec.arguments import (
    DEADLINE,
    Accepts,
    Annotations,
    AsJson,
    Deadline,
    Engines,
    GitHub,
    JunitFile,
    Outside,
    Pythons,
    Sets,
    SpecName,
    Strict,
    SummaryFile,
)
from simspec.commands.guard import command
from simspec.robot_files import NO_WORDS, RobotFiles, reads_robot_files

PageFile = Annotated[
    Path | None, typer.Option("--out", "-o", metavar="FILE", help="Output file (default FOLDER/report.html).")
]


def add_experiments(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    app.command("sweep")(command(reads_robot_files(sweep_command)))
    app.command("study")(command(study_command))
    app.command("pages")(command(pages_command))
    app.command("explain")(command(reads_robot_files(explain_command)))
    app.command("bisect")(command(reads_robot_files(bisect_command)))


def add_reports(app: typer.Typer) -> None:
    """Add the commands that show what runs came to."""
    app.command("report")(command(report_command))
    app.command("view")(command(view_command))


def sweep_command(
    spec: SpecName,
    engine: Engines = None,
    store: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where runs are stored (default runs/NAME/sweep); may be shared.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Runs side by side (default: the cores; measure: speed: 1).")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Run on the workers of a Dask cluster: tcp://HOST:PORT.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the plan and its cost; run and write nothing.")
    ] = False,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Repeat the stored runs that failed.")] = False,
    no_verify: Annotated[
        bool, typer.Option("--no-verify", help="Skip the proof that the engines have the same model.")
    ] = False,
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Also write a table, one line per run.")
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Wait while another sweep writes to the store.")] = False,
    sets: Sets = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    strict: Strict = False,
    python: Pythons = None,
    deadline: Deadline = DEADLINE,
    junit: JunitFile = None,
    annotations: Annotations = False,
    summary: SummaryFile = None,
    github: GitHub = False,
    as_json: AsJson = False,
) -> int:
    """Do all runs that the `sweep` of a spec asks for, and store them. Runs that are stored already are not repeated.

    Without --engine, `sweep.engines` and default-engines (simspec.toml): every installed engine that supports the spec.
    Ended at any moment, the same command does what is left.

    \b
    simspec sweep friction.yaml --dry-run
    simspec sweep friction.yaml --jobs 4 --csv friction.csv
    simspec sweep friction.yaml --set sweep.repeat=5
    simspec sweep friction.yaml --retry-failed

    Exit code 1 if a proof or an expectation failed, 3 if a run failed or an engine was stopped.
    """
    from simspec.commands.ci import reports_of
    from simspec.commands.sweep import sweep

    return sweep(
        spec,
        engine=engine,
        store=store,
        jobs=jobs,
        scheduler=scheduler,
        dry_run=dry_run,
        retry_failed=retry_failed,
        no_verify=no_verify,
        csv=csv,
        wait=wait,
        sets=sets,
        allow_outside=allow_outside,
        robot_files=robot_files,
        strict=strict,
        python=python,
        deadline=deadline,
        as_json=as_json,
        reports=reports_of(junit, annotations, summary, github),
    )


def explain_command(
    a: Annotated[str, typer.Argument(metavar="A", help="Folder of a run, or a spec.")],
    b: Annotated[str | None, typer.Argument(metavar="[B]", help="Folder of another run, or another spec.")] = None,
    engine: Engines = None,
    others: Annotated[
        list[str] | None,
        typer.Option("--with", metavar="PATH=VALUE", help="Override a value of the second side. Repeatable."),
    ] = None,
    windows: Annotated[int, typer.Option(metavar="COUNT", min=3, help="Windows that are looked at, at most.")] = 240,
    verify: Annotated[
        bool, typer.Option("--verify", help="First prove that both engines hold their models (L0 to L7 without L5).")
    ] = False,
    sets: Sets = None,
    accept: Accepts = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    python: Pythons = None,
    deadline: Deadline = DEADLINE,
    as_json: AsJson = False,
) -> int:
    """Explain where the difference of two runs, or of two engines, comes from. Writes nothing.

    Both begin short windows in states of A's run; one thing that differs is taken away at a time, and the share
    of the difference that this closes is printed. Exit code 0 whatever the shares are.

    \b
    simspec explain runs/arm/ENGINE1 runs/arm/ENGINE2
    simspec explain arm.yaml --engine ENGINE1 --engine ENGINE2
    simspec explain arm.yaml --engine ENGINE --with physics.timestep=2ms
    simspec explain arm.yaml arm-heavier.yaml --engine ENGINE
    simspec explain robot.SUFFIX --engine ENGINE1 --engine ENGINE2 --accept all
    """
    from simspec.commands.explain import explain

    return explain(
        a,
        b,
        engine=engine,
        others=others,
        windows=windows,
        verify=verify,
        sets=sets,
        accept=accept,
        allow_outside=allow_outside,
        robot_files=robot_files,
        python=python,
        deadline=deadline,
        as_json=as_json,
    )


def bisect_command(
    spec: SpecName,
    first: Annotated[str, typer.Option("--from", metavar="VERSION", help="The older version.")],
    last: Annotated[str, typer.Option("--to", metavar="VERSION", help="The younger version.")],
    figure: Annotated[
        str,
        typer.Option("--figure", metavar="NAME", help="A number of a run: an expectation, a quantity, a coordinate."),
    ],
    engine: Engines = None,
    versions: Annotated[
        str | None,
        typer.Option(metavar="A,B,…", help="The versions between, instead of those that the package index has."),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="Install versions that are missing, each in an environment of its own.")
    ] = False,
    store: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where runs are stored (default runs/NAME/sweep); may be shared.")
    ] = None,
    no_verify: Annotated[
        bool, typer.Option("--no-verify", help="Skip the proof that the two versions have the same model.")
    ] = False,
    sets: Sets = None,
    accept: Accepts = None,
    robot_files: RobotFiles = NO_WORDS,
    allow_outside: Outside = False,
    python: Pythons = None,
    deadline: Deadline = DEADLINE,
    as_json: AsJson = False,
) -> int:
    """Find the released version of an engine that changed a figure beyond noise, by halving. See docs/bisect.md.

    Each version is run once, with repeats for its noise; runs that are stored already are not repeated. The search
    assumes one change between the two versions.

    \b
    simspec bisect SPEC --engine NAME --from 3.3.7 --to 3.8.0 --figure "deepest penetration" --yes
    simspec bisect SPEC --engine NAME --from 3.3.7 --to 3.8.0 --figure arm.z --versions 3.4.0,3.5.0
    simspec bisect SPEC --engine NAME --from 3.3.7 --to 3.8.0 --figure "expectation 1" --json

    Exit code 0 if the version was found, 1 if the figure does not change, 3 if a version at an end cannot be
    installed or fails.
    """
    from simspec.commands.bisect import bisect

    return bisect(
        spec,
        engine=engine,
        first=first,
        last=last,
        figure=figure,
        versions=versions,
        yes=yes,
        store=store,
        prove_models=not no_verify,
        sets=sets,
        accept=accept,
        allow_outside=allow_outside,
        robot_files=robot_files,
        python=python,
        deadline=deadline,
        as_json=as_json,
    )


def study_command(
    study: Annotated[str, typer.Argument(metavar="STUDY", help="A study file, or the name of a study of the library.")],
    small: Annotated[bool, typer.Option("--small", help="The small study: what the file says under `small`.")] = False,
    store: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where runs are stored (default runs/NAME/sweep); may be shared.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the plan and its cost; run and write nothing.")
    ] = False,
    publish: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Also write the results, and what they are of, into a folder to be committed."
        ),
    ] = None,
    no_verify: Annotated[
        bool, typer.Option("--no-verify", help="Skip the proof that the engines have the same model.")
    ] = False,
    wait: Annotated[bool, typer.Option("--wait", help="Wait while another sweep writes to the store.")] = False,
    python: Pythons = None,
    deadline: Deadline = DEADLINE,
    allow_outside: Outside = False,
    as_json: AsJson = False,
) -> int:
    """Do all sweeps of a study, and write its tables: runs/NAME/study.md and study.json (with --small: runs/NAME-small).

    Runs that are stored already are not repeated. Ended at any moment, the same command does what is left.

    \b
    simspec study koerber-2021 --small --dry-run
    simspec study koerber-2021 --small
    simspec study mine.yaml --store /data/store
    simspec study koerber-2021 --publish docs/studies/koerber-2021

    A run that fails or does not do what is expected is a result of the study. Exit code 1 if a proof failed, 2 if values make a
    scenario invalid, 3 if an engine was stopped.
    """
    from simspec.commands.study import study as run_study

    return run_study(
        study,
        small=small,
        store=store,
        dry_run=dry_run,
        no_verify=no_verify,
        wait=wait,
        python=python,
        deadline=deadline,
        allow_outside=allow_outside,
        as_json=as_json,
        publish=publish,
    )


def pages_command(
    pages: Annotated[list[Path], typer.Argument(metavar="PAGE...", help="Pages of Markdown.")],
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit code 1 unless pages and figures are current.")
    ] = False,
    older: Annotated[
        bool, typer.Option("--older", help="Make the pages say which figures are older than the code.")
    ] = False,
    python: Pythons = None,
    allow_outside: Outside = False,
    as_json: AsJson = False,
) -> int:
    """Fill the marked places of pages from published studies: those in the folder `studies` beside a page.

    No engine is run. Where a model that a study measured is compiled to something else today, its figures are older than the
    code: exit code 1, unless the page says so (--older).

    \b
    simspec pages docs/results.md
    simspec pages docs/results.md --check
    """
    from simspec.commands.pages import pages as fill_pages

    return fill_pages(pages, check=check, older=older, python=python, allow_outside=allow_outside, as_json=as_json)


def report_command(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDER...", help="Folders of studies (runs/NAME), or of runs (runs/NAME/ENGINE)."),
    ],
    out: PageFile = None,
    as_json: AsJson = False,
) -> int:
    """Write a report as one HTML page: verdict, certificate, tables, plots and playback. It loads nothing from elsewhere.

    Without -o it is FOLDER/report.html.

    \b
    simspec report runs/arm
    simspec report runs/arm runs/spheres-216 -o both.html
    """
    from simspec.commands.report import report

    return report(folders, out, as_json)


def view_command(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of a study (runs/NAME), or of a run.")],
    out: PageFile = None,
    as_json: AsJson = False,
) -> int:
    """Open the report of a study or a run in the browser; it is written first if it is not current.

    Without a display, it is only written.

    \b
    simspec view runs/arm
    """
    from simspec.commands.view import view

    return view(folder, out, as_json)
