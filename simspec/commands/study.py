"""``simspec study``: all sweeps of a study into one store, and its tables."""

from __future__ import annotations

import functools
import gzip
import hashlib
import itertools
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from simspec.attribution.sides import explain
from simspec.commands.experiment_options import StudyOptions
from simspec.commands.options import engines_at_work, print_json
from simspec.commands.reports import SWEEP_FOLDER
from simspec.commands.sweep import RUNS, stored_index, warn_of_disturbances
from simspec.comparison.study import missing_engines
from simspec.errors import EXIT_ENGINE, EXIT_FAILED, EXIT_OK, EXIT_WRONG, Problem, SimspecError, SpecError
from simspec.experiments.after_sweep import MODELS_FILE, MOST_MODELS, outdated_runs, second_passes, sweep_models
from simspec.experiments.after_sweep import SCHEMA as MODELS_SCHEMA
from simspec.experiments.cases import rounding_lines
from simspec.experiments.index import costs, estimate, proof_seconds, proofs_left
from simspec.experiments.plan import Plan, plan_sweep
from simspec.experiments.store import Store
from simspec.experiments.sweep import SweepOutcome, local_executor, side_by_side
from simspec.experiments.sweep import sweep as run_sweep
from simspec.experiments.timing import versions_of
from simspec.files import resource_folder
from simspec.language.load import StudySource, SweepOfStudy, load_study_file
from simspec.outputs.targets import STORE, STUDY, demand, folder_problem
from simspec.outputs.writing import change_file, open_folder, write_folder
from simspec.report.experiments import proof_words
from simspec.report.page.document import page as html
from simspec.report.problems import show_error
from simspec.report.screen import PAGE_FILE as HTML_FILE
from simspec.report.screen import console, duration, progress, say
from simspec.report.study.pages import PUBLISHED_FILE, SCHEMA, TABLES_FILE, study_parts
from simspec.report.study.runs import Done, StudyExplanation, StudyTable
from simspec.report.study.tables import counted, measured, shown_of
from simspec.report.study.validity import unfailed
from simspec.report.table import Table, html_data, markdown
from simspec.stored import StudyTables, read_as

WINDOWS: Final = 30
"""Windows that are looked at, of each engine."""
MOST_NAMED = 3
PAGE_FILE = "study.md"
CONTACT_SHOWN = frozenset(("certified", "contact"))
"""Words of `show` whose tables say where contact is beyond the tolerances of L5."""
Planned = tuple[SweepOfStudy, Plan]


def study(options: StudyOptions) -> int:
    """Do the sweeps of a study, write and print its tables, and publish them with ``--publish``."""
    name, publish = options.study, options.publish
    source = load_study_file(
        find_study(name), allow_outside=options.allow_outside, options=options.robot_files.options()
    )
    pythons = options.interpreters(starts=not options.dry_run)
    sweeps = source.sweeps(options.small)
    absent = absent_engines(sweeps, pythons)
    for label, why in absent.items():
        say(f"{source.name}: without {label}: {why}", error=True)
    if publish is not None and absent:
        problem = Problem(
            f"engines of the study are missing: {', '.join(absent)}", hint="simspec engines install", code="E201"
        )
        raise SpecError([problem])
    planned = [(entry, plan_of(entry, pythons, tuple(absent))) for entry in sweeps]
    folder = RUNS / (f"{source.name}-small" if options.small else source.name)
    place = options.store or folder / SWEEP_FOLDER
    demand([folder_problem(place, STORE, source.files()), folder_problem(folder, STUDY, source.files())])
    if publish is not None:
        demand_publishable(publish, source, name)
    if options.dry_run:
        return _dry_run(source, planned, place, options.as_json)
    open_folder(folder, STUDY)
    opened = Store.open(place, create=True)
    if any(plan.measure == "speed" for _, plan in planned):
        warn_of_disturbances()
    done = []
    for entry, plan in planned:
        say(f"{source.name}: {entry.name}, {len(plan):,} runs", error=True)

        def run_plan(plan: Plan, item: SweepOfStudy = entry) -> SweepOutcome:
            with progress(not options.as_json) as tell:
                return run_sweep(
                    plan,
                    opened,
                    functools.partial(local_executor, plan, side_by_side(None, plan), pythons),
                    verify=not options.no_verify,
                    pythons=pythons,
                    deadline=options.deadline,
                    source={"file": Path(item.words.spec).name, "study": source.name, "sweep": item.name}
                    | {"show": list(item.spec.data.record.show)},
                    progress=tell,
                    wait=options.wait,
                )

        outcome = run_plan(plan)
        moved = []
        for second in second_passes(outcome, opened, entry.words.gap_seeds) if entry.words.gap_seeds else ():
            amount, count = f"{second.amount:g}", f"{len(second.plan):,}"
            say(f"{source.name}: {entry.name}, moved by {amount} (the first gap), {count} runs", error=True)
            moved.append((second, run_plan(second.plan)))
        figures = [figure for figure in source.figures if figure.sweep == entry.name]
        found: list[StudyExplanation] = []
        if "attribution" in entry.words.show:
            with progress(not options.as_json) as tell:
                found = explained(outcome, opened, pythons, options.deadline, tell)
        done.append(Done(entry, outcome, opened, figures, moved, found))
    return _show(options, source, done, folder, absent)


def find_study(name: str) -> Path:
    """The file of a study: a path, or the name of a study that is shipped with simspec."""
    path = Path(name)
    if path.is_file() or path.suffix:
        return path
    shipped = resource_folder("specs") / "studies" / f"{path.name}.yaml"
    return shipped if shipped.is_file() else path


def _named(entry: SweepOfStudy) -> list[str] | None:
    """The engines that a sweep names."""
    named = entry.spec.data.sweep.engines if entry.spec.data.sweep is not None else None
    return list(named) if named else None


def absent_engines(sweeps: Sequence[SweepOfStudy], pythons: Mapping[str, str]) -> dict[str, str]:
    """The engines that sweeps name and that are not here, each with the reason; a study goes on without them."""
    labels = [label for entry in sweeps for label in _named(entry) or ()]
    return missing_engines(list(dict.fromkeys(labels)), pythons)


def plan_of(
    entry: SweepOfStudy,
    pythons: Mapping[str, str],
    absent: Collection[str] = (),
    assumed: Mapping[str, Mapping[str, str]] = MappingProxyType({}),
) -> Plan:
    """The plan of a sweep of a study, for the engines that it names, but those that are ``absent``, else all that support
    it; ``assumed``: the versions of engines that are not here, of a plan that is not run. Raises SpecError where no engine
    is left."""
    named = _named(entry)
    if named is not None and not (named := [label for label in named if label not in absent]):
        raise SpecError([Problem(f"{entry.name}: none of the engines of this sweep is installed", code="E201")])
    selection = engines_at_work(named, pythons, demand=not assumed)
    if not named:
        selection = selection.for_world(entry.spec.resolve(), entry.spec.locate)
    labels = list(selection.engines)
    here = versions_of([label for label in labels if label not in assumed], pythons)
    return plan_sweep(entry.spec, engines=labels, versions={**assumed, **here})


def _show(
    options: StudyOptions, source: StudySource, done: Sequence[Done], folder: Path, absent: Mapping[str, str]
) -> int:
    """Write, publish and print the results; the exit code."""
    parts = [(entry, shown_of(entry)) for entry in done]
    made = {entry.sweep.name: {shown.name: shown for shown in tables} for entry, tables in parts}
    code = max((_code(entry) or EXIT_FAILED * bool(unfailed(entry)) for entry in done), default=EXIT_OK)
    code = max([code, *(exit_code(second, entry.sweep.words.show) for entry in done for _, second in entry.moved)])
    command = f"simspec study {options.study}{' --small' if options.small else ''}"
    data = study_data(source, done, parts, options.small, command, absent)
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    files = {TABLES_FILE: text, PAGE_FILE: page(source, made, data)}
    change_file(folder, STUDY, TABLES_FILE, lambda before: files[TABLES_FILE])
    change_file(folder, STUDY, PAGE_FILE, lambda before: files[PAGE_FILE])
    if options.publish is not None:
        published = read_as(StudyTables, text, TABLES_FILE)
        files[HTML_FILE] = html([study_parts(published, done[0].store)])
        publish(source, options, done, files)
    if options.as_json:
        print_json({**data, "folder": folder, "exit_code": code})
        return code
    for item, local in parts:
        for shown in local:
            console().print(shown)
        if item.outcome.invalid:
            show_error(SpecError(item.outcome.invalid))
    for line in data["said"]:
        say(line, error=True)
    console().print(f"written: {folder / PAGE_FILE}, {folder / TABLES_FILE}", soft_wrap=True)
    return code


def exit_code(outcome: SweepOutcome, show: Collection[str]) -> int:
    """The exit code of a sweep of a study. A study is to find runs that fail or miss expectations, and therefore,
    where the study shows it (``CONTACT_SHOWN``), is contact beyond the tolerances of L5 at a timestep."""
    if outcome.invalid_count:
        return EXIT_WRONG
    if outcome.stopped:
        return EXIT_ENGINE
    by_contact = outcome.by_contact if CONTACT_SHOWN.intersection(show) else set()
    return EXIT_FAILED if outcome.unproven.keys() - by_contact else EXIT_OK


def study_data(
    source: StudySource,
    done: Sequence[Done],
    parts: Sequence[tuple[Done, Sequence[StudyTable]]],
    small: bool,
    command: str,
    absent: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, Any]:
    """A study as plain data: its tables as they are printed, each with its figures as data; ``absent``: engines that it names
    and went without, each with the reason."""
    said = [f"without {label}: {why}" for label, why in absent.items()]
    bad: list[int] = []
    for entry in done:
        outcome = entry.outcome
        if _code(entry) != EXIT_OK:
            bad.append(len(said))
        actual = unfailed(entry)
        missing = sum(row is None for _, row in outcome.rows())
        proof = "proof not requested" if not outcome.verified else "every model proven"
        proof = _failed(entry) if outcome.unproven else proof
        said.append(
            f"{entry.sweep.name}: {len(outcome.plan):,} runs, {outcome.ran:,} of them now"
            + (f", {missing:,} not done" if missing else "")
            + f"; {proof}"
        )
        for second, of_second in entry.moved:
            if exit_code(of_second, entry.sweep.words.show) != EXIT_OK:
                bad.append(len(said))
            line = (
                f"{entry.sweep.name}: {len(of_second.plan):,} runs moved by {second.amount:g}, the engines' first gap"
            )
            said.append(
                f"{line}, {of_second.ran:,} of them now" + "".join(f"; {why}" for why in of_second.stopped.values())
            )
        said += [f"{entry.sweep.name}: {line}" for line in rounding_lines(outcome.plan)]
        said += [f"{entry.sweep.name}: not proven: {why}" for why in list(outcome.unproven.values())[:8]]
        said += [f"{entry.sweep.name}: {engine} was stopped: {why}" for engine, why in outcome.stopped.items()]
        bad += range(len(said), len(said) + len(actual))
        said += [f"{entry.sweep.name}: {line}" for line in actual]
        said += [f"{entry.sweep.name}: {note}" for note in outcome.notes]
    return {
        "schema": SCHEMA,
        "study": source.name,
        "description": source.data.description,
        "small": small,
        "figures": source.figures_source,
        "said": said,
        "bad": bad,
        "sweeps": {
            entry.sweep.name: [
                {"name": shown.name, **html_data(shown), "records": list(shown.records)} for shown in tables
            ]
            for entry, tables in parts
        },
        "measured": measured(done, command),
    }


def _code(done: Done) -> int:
    return exit_code(done.outcome, done.sweep.words.show)


def _failed(done: Done) -> str:
    """Of how many models the proof failed; where contact alone is beyond its tolerances, that is said."""
    count, by_contact = len(done.outcome.unproven), len(done.outcome.by_contact)
    if not by_contact or CONTACT_SHOWN.isdisjoint(done.sweep.words.show):
        return f"proof FAILED for {counted(count, 'model')}"
    text = f"contact beyond the tolerances of L5 for {counted(by_contact, 'model')}, all else of them proven"
    return text if by_contact == count else f"proof FAILED for {counted(count - by_contact, 'model')}; {text}"


def page(source: StudySource, made: Mapping[str, Mapping[str, Table]], data: Mapping[str, Any]) -> str:
    """A study as a page of Markdown."""
    parts = [f"# {source.name}", "", source.data.description, ""]
    if data["small"]:
        parts += ["The small study: fewer timesteps, seeds and repetitions.", ""]
    if source.figures_source:
        parts += [f"Figures from elsewhere: {source.figures_source}.", ""]
    lines = [f"- {entry['what']}: {entry['value']}" for entry in data["measured"]]
    lines += [f"- {line}" for line in data["said"]]
    for name, tables in made.items():
        parts += [f"## {name}", "", *(markdown(table) for table in tables.values())]
    return "\n".join([*parts, "## How it was done", "", *lines]) + "\n"


def _dry_run(source: StudySource, planned: Sequence[Planned], place: Path, as_json: bool) -> int:
    store, index = stored_index(place)
    took, proofs = proof_seconds(index, store), []
    shown = Table(
        f"{source.name}: to do",
        "sweep",
        "engine",
        "runs",
        "of",
        "steps",
        "time, one after the other",
        right=range(2, 6),
    )
    given, known, total = [], True, 0.0
    requested: set[str] = set()
    for entry, plan in planned:
        cells = list(plan)
        proofs.append(proofs_left(cells, index, took))
        left = [cell for cell in cells if index.done(cell.key) is None and cell.key not in requested]
        requested.update(cell.key for cell in cells)
        cost = estimate(plan, left, costs(index.rows.values(), plan.spec.name))
        for engine in plan.engines:
            seconds = cost.seconds[engine]
            runs = sum(cell.engine == engine for cell in cells)
            known = known and (seconds is not None or not cost.runs[engine])
            total += (seconds or 0.0) if cost.runs[engine] else 0.0
            time = "not measured yet" if seconds is None else f"about {duration(seconds)}"
            time = time if cost.runs[engine] else "–"
            shown.add(entry.name, engine, f"{cost.runs[engine]:,}", f"{runs:,}", f"{cost.steps[engine]:,}", time)
            given.append(
                {"sweep": entry.name, "engine": engine, "to_do": cost.runs[engine], "runs": runs}
                | {"steps": cost.steps[engine], "seconds": seconds}
            )
    if as_json:
        print_json(
            {"study": source.name, "store": place, "sweeps": given, "seconds": total if known else None}
            | {"proofs": [{"models": proof.models, "seconds": proof.total} for proof in proofs]}
        )
        return EXIT_OK
    console().print(shown)
    for entry, plan in planned:
        for line in rounding_lines(plan):
            console().note(f"{entry.name}: {line}")
    end = (
        f"about {duration(total)}, from what such runs took in this store" if known else "the time of some is not known"
    )
    console().note(f"runs: {end}")
    for (entry, _), local in zip(planned, proofs, strict=True):
        console().note(f"{entry.name}: {proof_words(local)}")
    return EXIT_OK


def explained(
    outcome: SweepOutcome, store: Store, pythons: Mapping[str, str], deadline: float, progress: Callable[..., None]
) -> list[StudyExplanation]:
    """Of each engine but the first of the plan, where it differs from that, from the runs of the scenario itself at the
    smallest timestep. An unsupported or failed comparison has its reason."""
    keys: dict[str, tuple[float, str]] = {}
    for cell, row in outcome.rows():
        if row is None or cell.case is not None or row.failed is not None or cell.perturb:
            continue
        if cell.engine not in keys or row.timestep < keys[cell.engine][0]:
            keys[cell.engine] = (row.timestep, row.key)
    first, *others = outcome.plan.engines
    found: list[StudyExplanation] = []
    for engine in others:
        missing = next((name for name in (first, engine) if name not in keys), None)
        if missing is not None:
            found.append(StudyExplanation(engine, first, None, f"{missing} has no whole run"))
            continue
        if keys[first][0] != keys[engine][0]:
            found.append(StudyExplanation(engine, first, None, f"{first} has no run at {keys[engine][0]:g} s"))
            continue
        progress(f"explaining where {engine} differs from {first}")
        runs = [store.load(keys[name][1]) for name in (first, engine)]
        try:
            explanation = explain(
                *runs, windows=WINDOWS, names=(first, engine), pythons=pythons, deadline=deadline, progress=progress
            )
        except SimspecError as error:
            found.append(StudyExplanation(engine, first, None, str(error).splitlines()[0]))
        else:
            found.append(StudyExplanation(engine, first, explanation))
    return found


# --- publishing -------------------------------------------------------------------------------------------------------------


def demand_publishable(folder: Path, source: StudySource, name: str) -> None:
    """Raise SpecError, before anything is run, where a study could not be published into ``folder``."""
    problem = None
    if Path(name).is_absolute():
        hint = "give a relative path"
        problem = Problem(
            "a published study names its file, which is to be found on other machines too", hint=hint, code="S804"
        )
    demand([problem, folder_problem(folder, STUDY, source.files())])


def publish(source: StudySource, options: StudyOptions, done: Sequence[Done], files: dict[str, str]) -> None:
    """Write ``files`` (``study.json`` among them), and the hashes of the models of its figures, into the folder of
    ``--publish``.

    Raises SpecError where a run in the store is not of the model that the code makes of it today, or where there is none.
    """
    problems = []
    for entry in done:
        outcome = entry.outcome
        if outcome.invalid_count:
            problems.append(
                Problem(f"{entry.sweep.name}: values make the scenario invalid: nothing is published", code="S804")
            )
        if len(outcome.plan) > MOST_MODELS:
            problems.append(
                Problem(
                    f"{entry.sweep.name}: {len(outcome.plan):,} runs; a published sweep has {MOST_MODELS:,}",
                    code="S804",
                )
            )
        old = list(itertools.islice(outdated_runs(outcome, entry.store), MOST_NAMED + 1))
        if old:
            named = ", ".join(old[:MOST_NAMED]) + (", …" if len(old) > MOST_NAMED else "")
            message = f"{entry.sweep.name}: the store has runs of models that this code no longer makes: {named}"
            problems.append(Problem(message, hint="use a new --store", code="R104"))
    if problems:
        raise SpecError(problems)
    models: dict[str, Any] = {
        "schema": MODELS_SCHEMA,
        "source": options.study,
        "small": options.small,
        "study_sha256": hashlib.sha256(files[TABLES_FILE].encode()).hexdigest(),
        "sweeps": {entry.sweep.name: sweep_models(source, entry.sweep, entry.outcome.plan) for entry in done},
    }
    text = json.dumps(models, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    if options.publish is not None:
        write_folder(published_files(files, text), options.publish, STUDY)


def published_files(files: Mapping[str, str], models: str) -> dict[str, str | bytes]:
    """The files of a published study: ``files`` with the tables compressed, since these reach megabytes and are committed,
    and ``models``, the text of ``models.json``."""
    tables = gzip.compress(files[TABLES_FILE].encode(), mtime=0)
    rest = {name: text for name, text in files.items() if name != TABLES_FILE}
    return {**rest, PUBLISHED_FILE: tables, MODELS_FILE: models}
