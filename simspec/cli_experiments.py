"""The commands of experiments, as ``cli.py`` has the others: arguments and help; the work is done in ``simspec.commands``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simspec.arguments import DEADLINE, AsJson, Deadline, Engines, Outside, Pythons, Sets, SpecName, Strict
from simspec.commands.guard import command


def add_experiments(app: typer.Typer) -> None:
    """Add these commands to the command line."""
    app.command("sweep")(command(sweep_command))


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
    allow_outside: Outside = False,
    strict: Strict = False,
    python: Pythons = None,
    deadline: Deadline = DEADLINE,
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
        strict=strict,
        python=python,
        deadline=deadline,
        as_json=as_json,
    )
