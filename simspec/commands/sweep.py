"""``simspec sweep``: what a spec's ``sweep`` asks for, run and stored, what is stored already left as it is."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from simspec.arguments import engines_at_work, interpreters, load_spec, print_json, source_of, spec_file
from simspec.commands.ci import NO_REPORTS, Reports, reporting
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EXIT_OK, Location, Problem, SpecError
from simspec.experiments.cost import costs, estimate
from simspec.experiments.executors.contract import Supplies
from simspec.experiments.executors.dask import DaskExecutor, demand_address
from simspec.experiments.executors.local import LocalExecutor
from simspec.experiments.index import Index, refresh
from simspec.experiments.machine import disturbances
from simspec.experiments.plan import Cell, Plan, plan_sweep
from simspec.experiments.proof_cost import proof_seconds, proofs_left
from simspec.experiments.roundings import rounded_data, rounding_sets
from simspec.experiments.store import Store
from simspec.experiments.sweep import Outcome
from simspec.experiments.sweep import sweep as run_sweep
from simspec.experiments.timing import timed_tasks
from simspec.experiments.versions import versions_of
from simspec.outputs.marker import STORE, STUDY
from simspec.outputs.targets import demand, file_problem, folder_problem
from simspec.outputs.writing import open_folder, write_file
from simspec.project import Interpreters, load_project
from simspec.report.progress import progress
from simspec.report.screen import console, say
from simspec.report.sweep import CSV_FIRST, csv_text, groups, outcome_data, show_outcome, show_plan
from simspec.report.swept import sweep_suites
from simspec.report.terminal import show_error, show_not_taken
from simspec.report.tested import skipped_suites
from simspec.robot_files import NO_WORDS, RobotFiles
from simspec.selection import Selection

RUNS, SWEEP_FOLDER = Path("runs"), "sweep"
"""The default store of a spec is runs/NAME/sweep."""


def sweep(
    spec: str,
    *,
    engine: list[str] | None,
    store: Path | None,
    jobs: int | None,
    scheduler: str | None,
    dry_run: bool,
    retry_failed: bool,
    no_verify: bool,
    csv: Path | None,
    wait: bool,
    sets: list[str] | None,
    allow_outside: bool,
    robot_files: RobotFiles = NO_WORDS,
    strict: bool,
    python: list[str] | None,
    deadline: float,
    as_json: bool,
    reports: Reports = NO_REPORTS,
) -> int:
    """Do the sweep of ``spec`` into ``store``, and print what it came to."""
    if dry_run and reports:
        raise SpecError(
            [Problem("--dry-run runs nothing: --junit, --annotations, --summary and --github do not apply")]
        )
    with reporting(reports, spec, as_json):
        loaded, world, warned, _ = load_spec(
            spec, sets, allow_outside, robot_files=robot_files, strict=strict, as_json=as_json
        )
        pythons = interpreters(python, engine, starts=not dry_run)
        named = engine or (loaded.data.sweep.engines if loaded.data.sweep is not None else None)
        words = named or list(load_project().default_engines)
        selection = engines_at_work(words or None, pythons)
        if not named:
            selection = selection.for_world(world, loaded.locate)
        labels = list(selection.engines)
        plan = plan_sweep(loaded, engines=labels, versions=versions_of(labels, pythons))
        folder = store or RUNS / plan.spec.name / SWEEP_FOLDER
        if scheduler is not None:
            demand_cluster(scheduler, jobs, plan)
        at_once = side_by_side(jobs, plan) if scheduler is None else 1
        _demand_targets(store, folder, csv, spec_file(spec))
        if dry_run:
            return _dry_run(plan, folder, at_once, selection, not no_verify, as_json, _not_queried(labels, pythons))
        if store is None:
            open_folder(folder.parent, STUDY)
        opened = Store.open(folder, create=True)
        with progress(not as_json) as tell:
            outcome = run_sweep(
                plan,
                opened,
                functools.partial(_local, plan, at_once, pythons)
                if scheduler is None
                else functools.partial(DaskExecutor, address=scheduler, versions=plan.versions),
                verify=not no_verify,
                retry_failed=retry_failed,
                pythons=pythons,
                deadline=deadline,
                source={**source_of(spec, sets, loaded, robot_files), "show": list(loaded.data.record.show)},
                progress=tell,
                wait=wait,
            )
        return _tell(outcome, selection, folder, csv, warned, as_json, reports, loaded.locate)


def side_by_side(jobs: int | None, plan: Plan) -> int:
    """How many runs at a time: as many as there are cores, one where speed is measured. Raises SpecError for another number
    there."""
    if plan.measure == "speed":
        if jobs not in (None, 1):
            message = "speed is measured with one run at a time"
            raise SpecError(
                [Problem(message, "sweep.measure", plan.spec.locate("sweep.measure"), f"--jobs {jobs}", "--jobs 1")]
            )
        return 1
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return jobs or cores


def demand_cluster(scheduler: str, jobs: int | None, plan: Plan) -> None:
    """Raise SpecError where a sweep cannot be done on a cluster, or asks for what is of this machine."""
    demand_address(scheduler)
    if jobs is not None:
        message = "is of this machine; how many runs a worker does side by side is said where it is started"
        raise SpecError([Problem(message, "--jobs", None, f"--jobs {jobs} with --scheduler", "one of the two")])
    if plan.measure == "speed":
        message = "speed is measured on this machine, where nothing else is at work"
        place = plan.spec.locate("sweep.measure")
        raise SpecError(
            [Problem(message, "sweep.measure", place, "--scheduler", "measure: physics, or no --scheduler")]
        )


def _local(plan: Plan, at_once: int, pythons: Mapping[str, str], supplies: Supplies) -> LocalExecutor:
    """Runs on this machine. Where speed is measured, each is alone on a processor, in a process that nothing was done in
    before."""
    if plan.measure == "speed":
        for why in disturbances():
            say(f"warning: speed is measured, and the machine is not quiet: {why}", error=True)
        return LocalExecutor(supplies, at_once, pythons, do_run=timed_tasks(pythons))
    return LocalExecutor(supplies, at_once, pythons, warm=WarmProcesses())


def _demand_targets(store: Path | None, folder: Path, csv: Path | None, spec: Path) -> None:
    """Raise SpecError, with every problem, when a target may not be written: before any work is done."""
    problems = [folder_problem(folder, STORE, [spec])]
    if store is None:
        problems.append(folder_problem(folder.parent, STUDY, [spec]))
    if csv is not None:
        problems.append(file_problem(csv, own_csv))
    demand(problems)


def own_csv(content: bytes) -> bool:
    """Whether a file is a table that simspec wrote."""
    return content.startswith((",".join(CSV_FIRST) + ",").encode())


def _tell(
    outcome: Outcome,
    selection: Selection,
    folder: Path,
    csv: Path | None,
    warned: Sequence[Problem],
    as_json: bool,
    reports: Reports,
    locate: Callable[[str], Location | None],
) -> int:
    rows = list(outcome.rows())
    made = groups(outcome.plan, rows)
    everything = {row.key: row for _, row in rows if row is not None}.values()
    failed = sum(row.failed is not None for row in everything)
    unfulfilled = sum(row.expected - row.passed for row in everything if row.failed is None)
    code = outcome.exit_code(failed, unfulfilled)
    if csv is not None:
        write_file(csv, csv_text(outcome.plan, rows), own_csv)
    if reports:
        suites = [*sweep_suites(outcome, rows, locate), *skipped_suites(outcome.plan.spec.name, selection.not_taken)]
        reports.write(suites, warnings=warned, as_json=as_json)
    if as_json:
        more = {"store": folder, "not_run": selection.not_taken, "warnings": warned, "problems": outcome.invalid}
        print_json({**outcome_data(outcome, made), **more, "exit_code": code})
        return code
    show_not_taken(selection, console())
    show_outcome(outcome, made)
    if outcome.invalid:
        show_error(SpecError(outcome.invalid))
        console(error=True).print(f"{outcome.invalid_count:,} runs were not done: their values make the spec invalid")
    console().print(f"written: {folder}{f', {csv}' if csv is not None else ''}", soft_wrap=True)
    return code


def _not_queried(labels: Iterable[str], pythons: Interpreters) -> dict[str, str]:
    """The engines of a plan whose versions are not known, with the reason: their stored runs count as to do."""
    return {label: pythons.not_queried[label] for label in labels if label in pythons.not_queried}


def _dry_run(
    plan: Plan,
    folder: Path,
    jobs: int,
    selection: Selection,
    verify: bool,
    as_json: bool,
    not_queried: Mapping[str, str] = MappingProxyType({}),
) -> int:
    store = Store.open(folder) if folder.is_dir() and any(folder.iterdir()) else None
    index = refresh(store, repair=False) if store is not None else Index()
    done = 0

    def to_do() -> Iterable[Cell]:
        nonlocal done
        for cell in plan:
            if index.done(cell.key) is None:
                yield cell
            else:
                done += 1

    left = estimate(plan, to_do(), costs(index.rows.values(), plan.spec.name))
    proofs = proofs_left(plan, index, proof_seconds(index, store)) if verify else None
    if as_json:
        told: dict[str, Any] = {"plan": plan.describe(), "store": folder, "done": done, "jobs": jobs}
        told["rounded"] = {name: rounded_data(rounded) for name, rounded in rounding_sets(plan).items()}
        told |= {"to_do": {"runs": left.runs, "steps": left.steps, "seconds": left.seconds}, "notes": index.notes}
        told["proofs"] = None if proofs is None else {"models": proofs.models, "seconds": proofs.total}
        told["not_queried"] = dict(not_queried)
        print_json({**told, "verify": verify, "not_run": selection.not_taken, "exit_code": EXIT_OK})
        return EXIT_OK
    show_not_taken(selection, console())
    for label, why in not_queried.items():
        console().print(f"note: {label}: {why}; its stored runs are not recognised", soft_wrap=True)
    for note in index.notes:
        console().print(f"note: {note}", soft_wrap=True)
    show_plan(plan, done, left, jobs, proofs)
    return EXIT_OK
