"""``simspec sweep``: do the runs that a spec's ``sweep`` requests, and store them; stored runs are not repeated."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, Final

from simspec.commands.experiment_options import SweepOptions
from simspec.commands.loading import LoadedSpec, load_spec, source_of
from simspec.commands.options import engines_at_work, print_json
from simspec.commands.reports import SWEEP_FOLDER, Reports, reporting, reports_of
from simspec.errors import EXIT_OK, Problem, SpecError
from simspec.experiments.cases import rounded_data, rounding_sets
from simspec.experiments.dask import DaskExecutor, demand_address
from simspec.experiments.index import Index, costs, estimate, proof_seconds, proofs_left, refresh
from simspec.experiments.plan import Plan, plan_sweep
from simspec.experiments.store import Store
from simspec.experiments.sweep import SweepOutcome, local_executor, side_by_side
from simspec.experiments.sweep import sweep as run_sweep
from simspec.experiments.timing import disturbances, versions_of
from simspec.outputs.targets import STORE, STUDY, demand, file_problem, folder_problem
from simspec.outputs.writing import open_folder, write_file
from simspec.project import Interpreters, load_project
from simspec.report.experiments import CSV_FIRST, groups, outcome_data, show_outcome, show_plan, sweep_csv
from simspec.report.problems import show_error, show_not_taken
from simspec.report.screen import console, progress, say
from simspec.report.tested import skipped_suites, sweep_suites
from simspec.selection import Selection

RUNS: Final = Path("runs")
"""The default store of a spec is runs/NAME/sweep."""


def sweep(options: SweepOptions) -> int:
    """Do the sweep of a spec, and print its results."""
    if options.dry_run and reports_of(options):
        message = "--dry-run runs nothing: --junit, --annotations, --summary and --github do not apply"
        raise SpecError([Problem(message, code="C102")])
    with reporting(options, options.spec) as reports:
        loaded = load_spec(options, options.spec)
        spec = loaded.spec
        pythons = options.interpreters(starts=not options.dry_run)
        named = options.engine or (spec.data.sweep.engines if spec.data.sweep is not None else None)
        selection = engines_at_work(named or list(load_project().default_engines) or None, pythons)
        if not named:
            selection = selection.for_world(loaded.world, spec.locate)
        labels = list(selection.engines)
        plan = plan_sweep(spec, engines=labels, versions=versions_of(labels, pythons))
        folder = options.store or RUNS / spec.name / SWEEP_FOLDER
        if options.scheduler is not None:
            demand_cluster(options.scheduler, options.jobs, plan)
        jobs = side_by_side(options.jobs, plan) if options.scheduler is None else 1
        problems = [folder_problem(folder, STORE, [loaded.file])]
        if options.store is None:
            problems.append(folder_problem(folder.parent, STUDY, [loaded.file]))
        if options.csv is not None:
            problems.append(file_problem(options.csv, is_csv))
        demand(problems)
        if options.dry_run:
            return _dry_run(options, plan, folder, jobs, selection, pythons)
        if options.store is None:
            open_folder(folder.parent, STUDY)
        opened = Store.open(folder, create=True)
        if options.scheduler is None and plan.measure == "speed":
            warn_of_disturbances()
        with progress(not options.as_json) as tell:
            outcome = run_sweep(
                plan,
                opened,
                functools.partial(local_executor, plan, jobs, pythons)
                if options.scheduler is None
                else functools.partial(DaskExecutor, address=options.scheduler, versions=plan.versions),
                verify=not options.no_verify,
                retry_failed=options.retry_failed,
                pythons=pythons,
                deadline=options.deadline,
                source={
                    **source_of(options.spec, loaded.sets, spec, options.robot_files),
                    "show": list(spec.data.record.show),
                },
                progress=tell,
                wait=options.wait,
            )
        return _show(options, outcome, selection, folder, loaded, reports)


def demand_cluster(scheduler: str, jobs: int | None, plan: Plan) -> None:
    """Raise SpecError where a sweep cannot be done on a cluster, or requests something of this machine."""
    demand_address(scheduler)
    if jobs is not None:
        message = "is of this machine; how many runs a worker does side by side is said where it is started"
        raise SpecError(
            [Problem(message, "--jobs", None, f"--jobs {jobs} with --scheduler", "one of the two", code="C109")]
        )
    if plan.measure == "speed":
        message = "speed is measured on this machine, where nothing else is at work"
        place = plan.spec.locate("sweep.measure")
        raise SpecError(
            [
                Problem(
                    message, "sweep.measure", place, "--scheduler", "measure: physics, or no --scheduler", code="C109"
                )
            ]
        )


def warn_of_disturbances() -> None:
    """Warn of other work on the machine, which disturbs measured speeds."""
    for why in disturbances():
        say(f"warning: speed is measured, and the machine is not quiet: {why}", error=True)


def is_csv(content: bytes) -> bool:
    """Whether a file is a table that simspec wrote."""
    return content.startswith((",".join(CSV_FIRST) + ",").encode())


def _show(
    options: SweepOptions,
    outcome: SweepOutcome,
    selection: Selection,
    folder: Path,
    loaded: LoadedSpec,
    reports: Reports,
) -> int:
    """Write and print the results; the exit code."""
    csv, warnings = options.csv, loaded.warnings
    rows = list(outcome.rows())
    grouped = groups(outcome.plan, rows)
    stored = {row.key: row for _, row in rows if row is not None}.values()
    failed = sum(row.failed is not None for row in stored)
    unfulfilled = sum(row.expected - row.passed for row in stored if row.failed is None)
    code = outcome.exit_code(failed, unfulfilled)
    if csv is not None:
        write_file(csv, sweep_csv(outcome.plan, rows), is_csv)
    if reports:
        suites = [*sweep_suites(outcome, rows, loaded.spec.locate)]
        suites += skipped_suites(outcome.plan.spec.name, selection.not_taken)
        reports.write(suites, warnings=warnings, as_json=options.as_json)
    if options.as_json:
        more = {"store": folder, "not_run": selection.not_taken, "warnings": warnings, "problems": outcome.invalid}
        print_json({**outcome_data(outcome, grouped), **more, "exit_code": code})
        return code
    show_not_taken(selection, console())
    show_outcome(outcome, grouped)
    if outcome.invalid:
        show_error(SpecError(outcome.invalid))
        console(error=True).print(f"{outcome.invalid_count:,} runs were not done: their values make the spec invalid")
    console().print(f"written: {folder}{f', {csv}' if csv is not None else ''}", soft_wrap=True)
    console().print(f"next: simspec view {folder}  (its page: plots and tables)", soft_wrap=True)
    return code


def stored_index(folder: Path) -> tuple[Store | None, Index]:
    """The store in a folder (None where there is none), and its index; nothing is repaired."""
    store = Store.open(folder) if folder.is_dir() and any(folder.iterdir()) else None
    return store, refresh(store, repair=False) if store is not None else Index()


def _dry_run(
    options: SweepOptions, plan: Plan, folder: Path, jobs: int, selection: Selection, pythons: Interpreters
) -> int:
    """Print the plan and its cost."""
    store, index = stored_index(folder)
    not_queried = {label: pythons.not_queried[label] for label in plan.engines if label in pythons.not_queried}
    to_do = (cell for cell in plan if index.done(cell.key) is None)
    left = estimate(plan, to_do, costs(index.rows.values(), plan.spec.name))
    done = len(plan) - sum(left.runs.values())
    proofs = None if options.no_verify else proofs_left(plan, index, proof_seconds(index, store))
    if options.as_json:
        data: dict[str, Any] = {"plan": plan.describe(), "store": folder, "done": done, "jobs": jobs}
        data["rounded"] = {name: rounded_data(rounded) for name, rounded in rounding_sets(plan).items()}
        data |= {"to_do": {"runs": left.runs, "steps": left.steps, "seconds": left.seconds}, "notes": index.notes}
        data["proofs"] = None if proofs is None else {"models": proofs.models, "seconds": proofs.total}
        data |= {"not_queried": not_queried, "verify": not options.no_verify, "not_run": selection.not_taken}
        print_json({**data, "exit_code": EXIT_OK})
        return EXIT_OK
    show_not_taken(selection, console())
    for label, why in not_queried.items():
        console().note(f"note: {label}: {why}; its stored runs are not recognised")
    for note in index.notes:
        console().note(f"note: {note}")
    show_plan(plan, done, left, jobs, proofs)
    return EXIT_OK
