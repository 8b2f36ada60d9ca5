"""``simspec study``: all sweeps of a study into one store, and its tables."""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from simspec.arguments import engines_at_work, interpreters, print_json
from simspec.commands.publish import demand_publishable
from simspec.commands.publish import publish as publish_study
from simspec.commands.report import SWEEP_FOLDER
from simspec.commands.study_explained import explained
from simspec.commands.sweep import side_by_side
from simspec.comparison.study import missing_engines
from simspec.engines.kit.warm import WarmProcesses
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, EXIT_WRONG, Problem, SpecError
from simspec.experiments.cost import costs, estimate
from simspec.experiments.executors.contract import Supplies
from simspec.experiments.executors.local import LocalExecutor
from simspec.experiments.first_gap import second_passes
from simspec.experiments.index import Index, refresh
from simspec.experiments.machine import disturbances
from simspec.experiments.plan import Plan, plan_sweep
from simspec.experiments.proof_cost import proof_seconds, proofs_left
from simspec.experiments.roundings import rounding_lines
from simspec.experiments.store import Store
from simspec.experiments.sweep import Outcome
from simspec.experiments.sweep import sweep as run_sweep
from simspec.experiments.timing import timed_tasks
from simspec.experiments.versions import versions_of
from simspec.language.study_specs import StudySource, SweepOfStudy, load_study_file
from simspec.outputs.marker import STORE, STUDY
from simspec.outputs.targets import demand, folder_problem
from simspec.outputs.writing import change_file, open_folder
from simspec.report.kit import table
from simspec.report.page.document import page as html
from simspec.report.page.sheets import Sheet, sheet
from simspec.report.plain import PAGE_FILE as HTML_FILE
from simspec.report.progress import duration, progress
from simspec.report.screen import console, say
from simspec.report.study.cases import unfailed
from simspec.report.study.done import Done, Explained, Shown
from simspec.report.study.markdown import markdown
from simspec.report.study.measured import counted, measured
from simspec.report.study.page_section import SCHEMA, TABLES_FILE, study_parts
from simspec.report.study.registry import shown_of
from simspec.report.sweep import proof_words
from simspec.report.terminal import show_error
from simspec.resources import resource_folder
from simspec.robot_files import project_options
from simspec.stored import StudyTables, read_as

RUNS = Path("runs")
PAGE_FILE = "study.md"
CONTACT_SHOWN = frozenset(("certified", "contact"))
"""Words of `show` whose tables say where contact is beyond the tolerances of L5."""
Planned = tuple[SweepOfStudy, Plan]


def study(
    name: str,
    *,
    small: bool,
    store: Path | None,
    dry_run: bool,
    no_verify: bool,
    wait: bool,
    python: list[str] | None,
    deadline: float,
    allow_outside: bool,
    as_json: bool,
    publish: Path | None = None,
) -> int:
    """Do the sweeps of a study, write and print its tables, and publish them where that is asked for."""
    source = load_study_file(find_study(name), allow_outside=allow_outside, options=project_options())
    pythons = interpreters(python, None, starts=not dry_run)
    sweeps = source.sweeps(small)
    absent = absent_engines(sweeps, pythons)
    for label, why in absent.items():
        say(f"{source.name}: without {label}: {why}", error=True)
    if publish is not None and absent:
        problem = Problem(f"engines of the study are missing: {', '.join(absent)}", hint="simspec engines install")
        raise SpecError([problem])
    planned = [(one, plan_of(one, pythons, tuple(absent))) for one in sweeps]
    folder = RUNS / (f"{source.name}-small" if small else source.name)
    place = store or folder / SWEEP_FOLDER
    demand([folder_problem(place, STORE, source.files()), folder_problem(folder, STUDY, source.files())])
    if publish is not None:
        demand_publishable(publish, source, name)
    if dry_run:
        return _dry_run(source, planned, place, as_json)
    open_folder(folder, STUDY)
    opened = Store.open(place, create=True)
    if any(plan.measure == "speed" for _, plan in planned):
        for why in disturbances():
            say(f"warning: speed is measured, and the machine is not quiet: {why}", error=True)
    done = []
    for one, plan in planned:
        say(f"{source.name}: {one.name}, {len(plan):,} runs", error=True)

        def run_plan(plan: Plan, one: SweepOfStudy = one) -> Outcome:
            with progress(not as_json) as tell:
                return run_sweep(
                    plan,
                    opened,
                    functools.partial(_local, plan, pythons),
                    verify=not no_verify,
                    pythons=pythons,
                    deadline=deadline,
                    source={"file": Path(one.words.spec).name, "study": source.name, "sweep": one.name}
                    | {"show": list(one.spec.data.record.show)},
                    progress=tell,
                    wait=wait,
                )

        outcome = run_plan(plan)
        moved = []
        for second in second_passes(outcome, opened, one.words.gap_seeds) if one.words.gap_seeds else ():
            say(
                f"{source.name}: {one.name}, moved by {second.amount:g} (the first gap), {len(second.plan):,} runs",
                error=True,
            )
            moved.append((second, run_plan(second.plan)))
        figures = [figure for figure in source.figures if figure.sweep == one.name]
        found: list[Explained] = []
        if "attribution" in one.words.show:
            with progress(not as_json) as tell:
                found = explained(outcome, opened, pythons, deadline, tell)
        done.append(Done(one, outcome, opened, figures, moved, found))
    return _tell(source, name, done, folder, small, as_json, publish, absent)


def find_study(name: str) -> Path:
    """The file of a study: a path, or the name of a study that is shipped with simspec."""
    path = Path(name)
    if path.is_file() or path.suffix:
        return path
    shipped = resource_folder("specs") / "studies" / f"{path.name}.yaml"
    return shipped if shipped.is_file() else path


def _named(one: SweepOfStudy) -> list[str] | None:
    """The engines that a sweep names."""
    named = one.spec.data.sweep.engines if one.spec.data.sweep is not None else None
    return list(named) if named else None


def absent_engines(sweeps: Sequence[SweepOfStudy], pythons: Mapping[str, str]) -> dict[str, str]:
    """The engines that sweeps name and that are not here, each with the reason; a study goes on without them."""
    labels = [label for one in sweeps for label in _named(one) or ()]
    return missing_engines(list(dict.fromkeys(labels)), pythons)


def plan_of(
    one: SweepOfStudy,
    pythons: Mapping[str, str],
    absent: Collection[str] = (),
    assumed: Mapping[str, Mapping[str, str]] = MappingProxyType({}),
) -> Plan:
    """The plan of a sweep of a study, for the engines that it names, but those that are ``absent``, else all that support
    it; ``assumed``: the versions of engines that are not here, of a plan that nobody runs. Raises SpecError where no engine
    is left."""
    named = _named(one)
    if named is not None and not (named := [label for label in named if label not in absent]):
        raise SpecError([Problem(f"{one.name}: none of the engines of this sweep is installed")])
    selection = engines_at_work(named, pythons, demand=not assumed)
    if not named:
        selection = selection.for_world(one.spec.resolve(), one.spec.locate)
    labels = list(selection.engines)
    here = versions_of([label for label in labels if label not in assumed], pythons)
    return plan_sweep(one.spec, engines=labels, versions={**assumed, **here})


def _local(plan: Plan, pythons: Mapping[str, str], supplies: Supplies) -> LocalExecutor:
    """Runs on this machine: where speed is measured, one at a time, on a processor of its own."""
    if plan.measure == "speed":
        return LocalExecutor(supplies, 1, pythons, do_run=timed_tasks(pythons))
    return LocalExecutor(supplies, side_by_side(None, plan), pythons, warm=WarmProcesses())


def _tell(
    source: StudySource,
    name: str,
    done: Sequence[Done],
    folder: Path,
    small: bool,
    as_json: bool,
    into: Path | None,
    absent: Mapping[str, str],
) -> int:
    parts = [(one, shown_of(one)) for one in done]
    made = {one.sweep.name: {shown.name: sheet(shown.table) for shown in own} for one, own in parts}
    code = max((_code(one) or EXIT_FAILED * bool(unfailed(one)) for one in done), default=EXIT_OK)
    code = max([code, *(exit_code(second, one.sweep.words.show) for one in done for _, second in one.moved)])
    command = f"simspec study {name}{' --small' if small else ''}"
    data = study_data(source, done, parts, small, command, absent)
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    files = {TABLES_FILE: text, PAGE_FILE: page(source, made, data)}
    change_file(folder, STUDY, TABLES_FILE, lambda before: files[TABLES_FILE])
    change_file(folder, STUDY, PAGE_FILE, lambda before: files[PAGE_FILE])
    if into is not None:
        published = read_as(StudyTables, text, TABLES_FILE)
        files[HTML_FILE] = html([study_parts(published, done[0].store)])
        publish_study(source, name, done, files, small, into)
    if as_json:
        print_json({**data, "folder": folder, "exit_code": code})
        return code
    for one, own in parts:
        for shown in own:
            console().print(shown.table)
        if one.outcome.invalid:
            show_error(SpecError(one.outcome.invalid))
    for line in data["said"]:
        say(line, error=True)
    console().print(f"written: {folder / PAGE_FILE}, {folder / TABLES_FILE}", soft_wrap=True)
    return code


def exit_code(outcome: Outcome, show: Collection[str]) -> int:
    """What a sweep of a study ends with. Runs that fail or do not do what is expected are what a study is to find out, and so,
    where the study shows it (``CONTACT_SHOWN``), is contact beyond the tolerances of L5 at a timestep."""
    if outcome.invalid_count:
        return EXIT_WRONG
    if outcome.stopped:
        return EXIT_ENGINE
    told = outcome.by_contact if CONTACT_SHOWN.intersection(show) else set()
    return EXIT_FAILED if outcome.unproven.keys() - told else EXIT_OK


def study_data(
    source: StudySource,
    done: Sequence[Done],
    parts: Sequence[tuple[Done, Sequence[Shown]]],
    small: bool,
    command: str,
    absent: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, Any]:
    """A study as plain data: its tables as they are printed, each with its figures as data; ``absent``: engines that it names
    and went without, each with the reason."""
    said = [f"without {label}: {why}" for label, why in absent.items()]
    bad: list[int] = []
    for one in done:
        outcome = one.outcome
        if _code(one) != EXIT_OK:
            bad.append(len(said))
        held = unfailed(one)
        missing = sum(row is None for _, row in outcome.rows())
        proof = "proof not asked for" if not outcome.verified else "every model proven"
        proof = _failed(one) if outcome.unproven else proof
        said.append(
            f"{one.sweep.name}: {len(outcome.plan):,} runs, {outcome.ran:,} of them now"
            + (f", {missing:,} not done" if missing else "")
            + f"; {proof}"
        )
        for second, of_second in one.moved:
            if exit_code(of_second, one.sweep.words.show) != EXIT_OK:
                bad.append(len(said))
            line = f"{one.sweep.name}: {len(of_second.plan):,} runs moved by {second.amount:g}, the engines' first gap"
            said.append(
                f"{line}, {of_second.ran:,} of them now" + "".join(f"; {why}" for why in of_second.stopped.values())
            )
        said += [f"{one.sweep.name}: {line}" for line in rounding_lines(outcome.plan)]
        said += [f"{one.sweep.name}: not proven: {why}" for why in list(outcome.unproven.values())[:8]]
        said += [f"{one.sweep.name}: {engine} was stopped: {why}" for engine, why in outcome.stopped.items()]
        bad += range(len(said), len(said) + len(held))
        said += [f"{one.sweep.name}: {line}" for line in held]
        said += [f"{one.sweep.name}: {note}" for note in outcome.notes]
    return {
        "schema": SCHEMA,
        "study": source.name,
        "description": source.data.description,
        "small": small,
        "figures": source.figures_source,
        "said": said,
        "bad": bad,
        "sweeps": {one.sweep.name: [_plain(shown) for shown in own] for one, own in parts},
        "measured": measured(done, command),
    }


def _code(done: Done) -> int:
    return exit_code(done.outcome, done.sweep.words.show)


def _failed(done: Done) -> str:
    """Of how many models the proof failed; where contact alone is beyond its tolerances, that is said."""
    count, by_contact = len(done.outcome.unproven), len(done.outcome.by_contact)
    if not by_contact or CONTACT_SHOWN.isdisjoint(done.sweep.words.show):
        return f"proof FAILED for {counted(count, 'model')}"
    told = f"contact beyond the tolerances of L5 for {counted(by_contact, 'model')}, all else of them proven"
    return told if by_contact == count else f"proof FAILED for {counted(count - by_contact, 'model')}; {told}"


def _plain(shown: Shown) -> dict[str, Any]:
    """What is shown, as plain data."""
    return {
        "name": shown.name,
        **dataclasses.asdict(sheet(shown.table)),
        "said": list(shown.said),
        "records": list(shown.records),
    }


def page(source: StudySource, made: Mapping[str, Mapping[str, Sheet]], data: Mapping[str, Any]) -> str:
    """A study as a page of Markdown."""
    parts = [f"# {source.name}", "", source.data.description, ""]
    if data["small"]:
        parts += ["The small study: fewer timesteps, seeds and repetitions.", ""]
    if source.figures_source:
        parts += [f"Figures from elsewhere: {source.figures_source}.", ""]
    lines = [f"- {one['what']}: {one['value']}" for one in data["measured"]]
    lines += [f"- {line}" for line in data["said"]]
    for name, own in made.items():
        parts += [f"## {name}", "", *(markdown(one) for one in own.values())]
    return "\n".join([*parts, "## How it was done", "", *lines]) + "\n"


def _dry_run(source: StudySource, planned: Sequence[Planned], place: Path, as_json: bool) -> int:
    store = Store.open(place) if place.is_dir() and any(place.iterdir()) else None
    index = refresh(store, repair=False) if store is not None else Index()
    took, proofs = proof_seconds(index, store), []
    shown = table(
        f"{source.name}: to do",
        "sweep",
        "engine",
        "runs",
        "of",
        "steps",
        "time, one after the other",
        right=range(2, 6),
    )
    told, known, total = [], True, 0.0
    asked: set[str] = set()
    for one, plan in planned:
        cells = list(plan)
        proofs.append(proofs_left(cells, index, took))
        left = [cell for cell in cells if index.done(cell.key) is None and cell.key not in asked]
        asked.update(cell.key for cell in cells)
        cost = estimate(plan, left, costs(index.rows.values(), plan.spec.name))
        for engine in plan.engines:
            seconds = cost.seconds[engine]
            runs = sum(cell.engine == engine for cell in cells)
            known = known and (seconds is not None or not cost.runs[engine])
            total += (seconds or 0.0) if cost.runs[engine] else 0.0
            time = "not measured yet" if seconds is None else f"about {duration(seconds)}"
            time = time if cost.runs[engine] else "–"
            shown.add_row(one.name, engine, f"{cost.runs[engine]:,}", f"{runs:,}", f"{cost.steps[engine]:,}", time)
            told.append(
                {"sweep": one.name, "engine": engine, "to_do": cost.runs[engine], "runs": runs}
                | {"steps": cost.steps[engine], "seconds": seconds}
            )
    if as_json:
        print_json(
            {"study": source.name, "store": place, "sweeps": told, "seconds": total if known else None}
            | {"proofs": [{"models": one.models, "seconds": one.total} for one in proofs]}
        )
        return EXIT_OK
    console().print(shown)
    for one, plan in planned:
        for line in rounding_lines(plan):
            console().print(f"{one.name}: {line}", soft_wrap=True)
    end = (
        f"about {duration(total)}, from what such runs took in this store" if known else "the time of some is not known"
    )
    console().print(f"runs: {end}", soft_wrap=True)
    for (one, _), own in zip(planned, proofs, strict=True):
        console().print(f"{one.name}: {proof_words(own)}", soft_wrap=True)
    return EXIT_OK
