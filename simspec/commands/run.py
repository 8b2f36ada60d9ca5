"""``simspec run``: compile, verify, run in several engines, compare, and write ``runs/NAME``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from simspec.arguments import chosen_engines, engines_at_work, interpreters, load_spec, source_of
from simspec.commands.baseline import NO_BASELINES, Baselines, with_baseline
from simspec.commands.ci import NO_REPORTS, Reports, reporting
from simspec.commands.diff import diff_code
from simspec.commands.report import write_page
from simspec.commands.study_folder import Results
from simspec.comparison.study import study
from simspec.errors import EXIT_FAILED, EXIT_OK, Location, Problem, SpecError
from simspec.report.final import ends
from simspec.report.plain import study_data, text
from simspec.report.progress import progress
from simspec.report.regressions import comparison_lines, comparison_suite
from simspec.report.screen import console, say
from simspec.report.session import show_run
from simspec.report.terminal import show_not_taken
from simspec.report.tested import skipped_suites, study_suites
from simspec.resources import find_spec
from simspec.robot_files import NO_WORDS, RobotFiles
from simspec.selection import Selection
from simspec.world.types import World


def run(
    spec: str,
    *,
    all_engines: bool,
    engine: list[str] | None,
    keep_going: bool,
    out: Path,
    repeats: bool,
    prove: bool,
    tolerance: float,
    fail_on_diff: float | None,
    sets: list[str] | None,
    allow_outside: bool,
    robot_files: RobotFiles = NO_WORDS,
    strict: bool,
    python: list[str] | None,
    deadline: float,
    page: bool,
    as_json: bool,
    reports: Reports = NO_REPORTS,
    baselines: Baselines = NO_BASELINES,
) -> int:
    """Study ``spec`` in all engines, in those named by ``engine`` or in the project's, and write ``out``/NAME."""
    with reporting(reports, spec, as_json):
        if all_engines and engine:
            raise SpecError([Problem("--all-engines and --engine exclude each other")])
        words = None if all_engines else chosen_engines(engine)
        if not all_engines and not words:
            allowed = "--all-engines, --engine NAME (repeatable), or default-engines in simspec.toml"
            raise SpecError([Problem("no engines selected", allowed=allowed)])
        loaded, world, warned, sets = load_spec(
            spec,
            sets,
            allow_outside,
            robot_files=robot_files,
            strict=strict,
            as_json=as_json,
            duration_of_model=OF_A_MODEL,
        )
        pythons = interpreters(python, engine)
        return run_world(
            world,
            engines_at_work(words, pythons, demand=False),
            out / world.name,
            spec=find_spec(spec),
            locate=loaded.locate,
            prove=prove,
            repeats=repeats,
            keep_going=keep_going,
            tolerance=tolerance if fail_on_diff is None else fail_on_diff,
            fail_on_diff=fail_on_diff is not None,
            pythons=pythons,
            deadline=deadline,
            source={**source_of(spec, sets, robot_files, loaded), **_shown(loaded.data.record.show)},
            page=page,
            as_json=as_json,
            warnings=warned,
            show=loaded.data.record.show,
            reports=reports,
            baselines=baselines,
        )


OF_A_MODEL = "1s"
"""How long a model runs that is run by itself, and whose file does not say so: robot files have no word for it."""


def _shown(show: Sequence[str]) -> dict[str, list[str]]:
    """What `record.show` names, for a run's provenance: reports made later show the same."""
    return {"show": list(show)} if show else {}


def run_world(
    world: World,
    selection: Selection,
    folder: Path,
    *,
    spec: Path | None = None,
    locate: Callable[[str], Location | None],
    prove: bool,
    repeats: bool,
    keep_going: bool,
    tolerance: float,
    fail_on_diff: bool,
    pythons: Mapping[str, str],
    deadline: float,
    source: Mapping[str, Any],
    page: bool = False,
    as_json: bool,
    warnings: Sequence[Problem] = (),
    show: Sequence[str] = (),
    reports: Reports = NO_REPORTS,
    baselines: Baselines = NO_BASELINES,
) -> int:
    """Study ``world``, of the file ``spec``, in the engines of ``selection``, write ``folder``, and print.

    Where no engine is named, those that support the world are compared: at least two. ``page``: also write report.html.
    ``reports``: what is written for CI systems; ``baselines``: what the study is compared with and kept as.
    """
    before = baselines.before(repeats)
    selection = selection.for_world(world, locate, least=2)
    engines = list(selection.engines)
    if fail_on_diff and len(engines) < 2:
        raise SpecError(
            [Problem("--fail-on-diff requires two engines", found=", ".join(engines), allowed="two or more engines")]
        )
    results = Results(world, folder, selection.not_taken)
    results.demand(engines, [spec] if spec is not None else [])
    with progress(not as_json) as tell:
        result = study(
            world,
            engines,
            compiled=selection.compiled,
            arrivals=results,
            prove=prove,
            repeats=repeats,
            keep_going=keep_going,
            tolerance=tolerance,
            pythons=pythons,
            deadline=deadline,
            locate=locate,
            source=source,
            progress=tell,
        )
        tell("writing")
        results.finish(result, keep_page=page)
        path = write_page([folder], None) if page else None
        compared = None
        if baselines:
            compared = with_baseline(
                baselines, before, result, tolerance=tolerance, pythons=pythons, deadline=deadline, progress=tell
            )
    code = result.exit_code
    if code == EXIT_OK and fail_on_diff:
        code = diff_code(result.diffs)
    if code == EXIT_OK and compared is not None and compared.failed:
        code = EXIT_FAILED
    told = compared.comparison if compared is not None else None
    reports.write(
        [
            *study_suites(result, locate, fail_on_diff),
            *skipped_suites(world.name, selection.not_taken),
            *([comparison_suite(world.name, told)] if told is not None else []),
        ],
        study=result,
        warnings=warnings,
        baseline=comparison_lines(told) if told is not None else (),
        as_json=as_json,
    )
    if as_json:
        more = {"exit_code": code, "folder": folder, "notes": results.notes, "warnings": warnings}
        more["page"] = path
        more["baseline"] = compared.data() if compared is not None else None
        more["not_run"] = selection.not_taken
        more["ends"] = {name: ends(run, show) for name, run in result.runs.items()}
        sys.stdout.write(text({**study_data(result), **more}))
        return code
    show_not_taken(selection, console())
    show_run(result, folder, results.notes, show, fail_on_diff)
    if compared is not None:
        compared.show(console())
    if path is not None:
        say(f"report: {path}")
    return code
