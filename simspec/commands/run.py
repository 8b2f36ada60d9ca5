"""``simspec run``: compile, verify, run in several engines, compare, and write ``runs/NAME``; and its baselines."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simspec import generated
from simspec.commands.check import is_writable
from simspec.commands.loading import OF_A_MODEL, LoadedSpec, load_spec, source_of
from simspec.commands.options import engine_names, engines_at_work, print_json
from simspec.commands.reports import diff_code, reporting, reports_of, write_page
from simspec.commands.scenario_options import RunOptions
from simspec.comparison.floor import Floor, save_floor
from simspec.comparison.study import Arrivals, Study, study
from simspec.compiler import Compiled, compile_world
from simspec.errors import EXIT_FAILED, EXIT_OK, Problem, SpecError
from simspec.experiments.timing import TimedCase, disturbances, this_machine, timed_runs
from simspec.files import scratch_folder
from simspec.generated import CERTIFICATE_FILE
from simspec.outputs.targets import COMPILED, RUN, STUDY, demand, existing_name_problem, file_problem, folder_problem
from simspec.outputs.writing import Artifacts, change_file, open_folder, remove_file, write_file
from simspec.processes import Ended
from simspec.report.baseline import (
    Baseline,
    BaselineComparison,
    baseline_of,
    compare,
    comparison_data,
    comparison_lines,
    comparison_suite,
    is_baseline,
    read_baseline,
    show_comparison,
)
from simspec.report.console import Screen
from simspec.report.differences import show_inconclusive
from simspec.report.problems import show_not_taken, with_ways_out
from simspec.report.screen import (
    NOT_RUN,
    PAGE_FILE,
    REPORT_FILE,
    REPORT_SCHEMA,
    console,
    progress,
    say,
    study_data,
    text,
)
from simspec.report.studies import ends, show_failures, show_run
from simspec.report.table import BAD, length
from simspec.report.tested import skipped_suites, study_suites
from simspec.report.verdict import AFTER_MOTIONS, VerdictPart, show_verdict, verdict, verdict_data
from simspec.runner.run import Case, Run
from simspec.runner.store import stored_runs
from simspec.selection import NotTaken, Selection, compiling
from simspec.stored import Report, read_as
from simspec.world.canonical import sha256
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.proof.certificate import Certificate, EngineProof


# ``runs/NAME``: the results of a study, each part as soon as it is there.
#
# The folder is shared: by runs of several engines, one after the other or at the same time, and by worlds that a spec had
# before. Results of this world count; results of another world stay, and are named as such.

COMPILED_FOLDER = "compiled"
LEVELS_OF_QUICK = ("L0", "L1", "L2", "L3", "L4", "L6", "L7")
"""Levels of the proof with ``--quick``: all but the measurement of contact."""


class Results(Arrivals):
    """The results of one study of ``world`` in ``folder``. ``notes``: remarks about earlier results in the folder."""

    def __init__(self, world: World, folder: Path, not_run: Mapping[str, NotTaken] | None = None):
        """``not_run``: the requested engines that were left out."""
        self.notes: list[str] = []
        self._not_run = {name: str(why) for name, why in (not_run or {}).items()}
        self._world = world
        self._hash = sha256(world)
        self._folder = folder

    def demand(self, engines: list[str], specs: list[Path]) -> None:
        """Raise SpecError, with every problem, when one of the targets may not be written: before any work is done.

        ``specs``: the files that are read, which no target may hold.
        """
        demand([folder_problem(self._folder, STUDY, specs)])
        below = {COMPILED_FOLDER: COMPILED} | dict.fromkeys(engines, RUN)
        demand(folder_problem(self._folder / name, kind, specs) for name, kind in below.items())
        demand(existing_name_problem(self._folder, name) for name in (CERTIFICATE_FILE, REPORT_FILE))

    def compiled(self, compiled: Mapping[str, Compiled], files: Artifacts) -> None:
        open_folder(self._folder, STUDY)
        built = generated.CompiledSpec(self._world, compiled, files)
        generated.write(built, self._folder / COMPILED_FOLDER)

    def certificate(self, certificate: Certificate) -> None:
        """Keep the proof, together with those of other engines of the same world."""

        def change(before: bytes | None) -> str:
            return certificate.joined(self._kept(before, certificate)).to_json()

        change_file(self._folder, STUDY, CERTIFICATE_FILE, change)

    def _kept(self, content: bytes | None, new: Certificate) -> Mapping[str, EngineProof]:
        """The proofs of an earlier certificate that remain valid together with a new one."""
        from simspec.proof.certificate import Certificate
        from simspec.proof.judge import holding_proofs

        if content is None:
            return {}
        path = self._folder / CERTIFICATE_FILE
        try:
            earlier = Certificate.from_json(content.decode(errors="replace"), str(path))
        except SpecError as error:
            self.notes.append(f"{error.problems[0].message}; it was replaced")
            return {}
        files = generated.engine_hashes(generated.owned_files(self._folder / COMPILED_FOLDER))
        stored = holding_proofs(earlier, self._world, files, new.oracle)
        if others := stored.without(new.engines).reasons:
            self.notes.append(f"{path}: proofs dropped: {others}")
        return stored.kept

    def run(self, run: Run) -> None:
        run.save(self._folder / run.engine)

    def kept(self) -> list[str]:
        """The stored runs of this world, by their folders' names."""
        return [name for name, stored_hash in stored_runs(self._folder).items() if stored_hash == self._hash]

    def floor(self, floor: Floor) -> None:
        save_floor(floor, self._folder / floor.engine)

    def finish(self, study: Study, *, keep_page: bool = False) -> None:
        """Write the report, and look at what else there is in the folder. ``keep_page``: the page is written anew
        next."""
        open_folder(self._folder, STUDY)
        if study.certificate is None:
            self._drop_certificate()
        data = {**study_data(study), "world_sha256": self._hash, NOT_RUN: self._not_run}
        if not keep_page and remove_file(self._folder, STUDY, PAGE_FILE):
            self.notes.append(
                f"{self._folder / PAGE_FILE} was of earlier runs and was removed: simspec report writes it anew"
            )

        def change(before: bytes | None) -> str:
            # read while no other process writes: a run that was stored meanwhile would be lost from the report
            return text(self._joined({**data, "other_runs": self._others(study)}, before))

        change_file(self._folder, STUDY, REPORT_FILE, change)

    def _others(self, study: Study) -> dict[str, dict[str, bool]]:
        """Stored runs of other engines than the study's, and whether they are of its world; notes tell of the others."""
        others: dict[str, dict[str, bool]] = {}
        for name, stored_hash in stored_runs(self._folder).items():
            if name in study.runs:
                continue
            same = stored_hash == self._hash
            others[name] = {"same_world": same}
            if not same:
                why = (
                    "cannot be read"
                    if stored_hash is None
                    else "is of another world (an earlier spec, or another --set)"
                )
                self.notes.append(f"{self._folder / name} {why}: it is kept and not compared")
        return others

    def _drop_certificate(self) -> None:
        """A study without proof leaves the certificate of this world, and removes that of another."""
        path = self._folder / CERTIFICATE_FILE
        try:
            old = generated.read_certificate(self._folder)
            if old is None or old.world_sha256 == self._hash:
                return
            why = "was of another world"
        except SpecError as error:
            why = f"could not be read ({error})"
        if remove_file(self._folder, STUDY, CERTIFICATE_FILE):
            self.notes.append(f"{path} {why} and was removed")

    def _joined(self, data: dict[str, Any], before: bytes | None) -> dict[str, Any]:
        """This study's report, with what the one before says of other engines in the same world."""
        if before is None:
            return data
        path = self._folder / REPORT_FILE
        try:
            old = read_as(Report, before, str(path))
        except SpecError as error:
            self.notes.append(f"{path} could not be read and was replaced: {error.problems[0].message}")
            return data
        if old.schema_ != REPORT_SCHEMA or old.world_sha256 != self._hash:
            return data
        kept = {name for name, facts in data["other_runs"].items() if facts["same_world"]} & old.runs.keys()
        for part, earlier in (("runs", old.runs), ("floors", old.floors)):
            data[part] = {name: entry for name, entry in earlier.items() if name in kept} | data[part]
        data["diffs"] = [
            diff for diff in old.diffs if {_engine(diff, "first"), _engine(diff, "second")} <= kept
        ] + data["diffs"]
        # an engine that is neither left out nor run now remains a requested one
        there = data["runs"].keys() | data["other_runs"].keys()
        data[NOT_RUN] = {name: why for name, why in (old.left_out | self._not_run).items() if name not in there}
        return data


def _engine(diff: dict[str, Any], side: str) -> str:
    """The engine of one side of a stored comparison, which is labelled by engine and version."""
    return str(diff.get(side, "")).split(" ")[0]


def run(options: RunOptions) -> int:
    """Study a spec in all engines, in those that are named or in the project's, and write the folder of results."""
    with reporting(options, options.spec):
        if options.verbose and options.quiet:
            raise SpecError([Problem("--verbose and --quiet exclude each other", code="C101")])
        loaded = load_spec(options, options.spec, duration=OF_A_MODEL)
        selection = _requested(options)
        pythons = selection.pythons
        with with_ways_out(options.spec, selection.engines, loaded.world, pythons, is_writable(loaded.spec)):
            return run_world(options, loaded.world, selection, options.out / loaded.world.name, loaded)


def _requested(options: RunOptions) -> Selection:
    """The engines that the options name, or all; those that compile for a model last, and only where they are requested. Raises
    SpecError, EngineError."""
    every = options.all_engines or options.every_engine
    if every and options.engine:
        word = "--every-engine" if options.every_engine else "--all-engines"
        raise SpecError([Problem(f"{word} and --engine exclude each other", code="C101")])
    words = None if every else options.chosen
    if not every and not words:
        allowed = "--all-engines, --engine NAME (repeatable), or default-engines in simspec.toml"
        raise SpecError([Problem("no engines selected", allowed=allowed, code="C102")])
    selection = engines_at_work(words, options.interpreters(), demand=False)
    slow = compiling(selection.engines)
    if every and not options.every_engine:
        selection = selection.leave(slow)
    without = engine_names(options.without or [])
    if absent := [name for name in without if name not in selection.engines and name not in selection.not_taken]:
        raise SpecError(
            [Problem(f"--without {absent[0]}: it is not selected", allowed=", ".join(selection.engines), code="C102")]
        )
    left = [name for name in selection.engines if name not in without]
    if not left:
        raise SpecError([Problem("--without leaves no engine", found=", ".join(without), code="C102")])
    not_taken = {name: why for name, why in selection.not_taken.items() if name not in without}
    engines = tuple(sorted(left, key=lambda name: name in slow))
    return dataclasses.replace(selection, engines=engines, not_taken=not_taken)


def run_world(
    options: RunOptions, world: World, selection: Selection, folder: Path, loaded: LoadedSpec | None = None
) -> int:
    """Study ``world``, of the spec ``loaded``, in the engines of ``selection``, write ``folder``, and print.

    Where no engine is named, those that support the world are compared: at least two.
    """
    show, source = [], {}
    if loaded is not None:
        show = list(loaded.spec.data.record.show)
        source = source_of(options.spec, loaded.sets, loaded.spec, options.robot_files)
        source |= {"show": show} if show else {}
    locate: Callable[[str], Any] = loaded.spec.locate if loaded is not None else lambda path: None
    fails = options.fail_on_diff is not None
    before = _read_baseline(options)
    selection = selection.for_world(world, locate, least=2)
    engines = list(selection.engines)
    if fails and len(engines) < 2:
        message = "--fail-on-diff requires two engines"
        raise SpecError([Problem(message, found=", ".join(engines), allowed="two or more engines", code="C102")])
    results = Results(world, folder, selection.not_taken)
    results.demand(engines, [loaded.file] if loaded is not None else [])
    try:
        with progress(not (options.as_json or options.quiet)) as tell:
            result = study(
                world,
                engines,
                compiled=selection.compiled,
                arrivals=results,
                prove=not options.no_verify,
                levels=LEVELS_OF_QUICK if options.quick else None,
                repeats=options.repeats and not options.quick,
                cache=not (options.no_cache or options.baseline or options.write_baseline),
                keep_going=options.keep_going,
                tolerance=_tolerance(options),
                pythons=selection.pythons,
                deadline=options.deadline,
                locate=locate,
                source=source,
                progress=tell,
            )
            tell("writing")
            results.finish(result, keep_page=options.report)
            page = write_page([folder], None) if options.report else None
            compared = None
            if options.baseline is not None or options.write_baseline is not None:
                compared = _with_baseline(options, before, result, selection, tell)
    except Ended:
        if kept := results.kept():
            say(f"kept in {folder}: {', '.join(kept)}; to compare them: simspec view {folder}", error=True)
        raise
    done = Finished(options, result, folder, selection, compared, page, tuple(results.notes), tuple(show))
    comparison = done.comparison
    warnings = loaded.warnings if loaded is not None else []
    suites = [*study_suites(result, locate, fails), *skipped_suites(world.name, selection.not_taken)]
    suites += [comparison_suite(world.name, comparison)] if comparison is not None else []
    lines = comparison_lines(comparison) if comparison is not None else ()
    reports_of(options).write(suites, study=result, warnings=warnings, baseline=lines, as_json=options.as_json)
    if options.as_json:
        print_json({**done.data(), "warnings": warnings})
    else:
        done.show()
    return done.code


@dataclass(frozen=True)
class Finished:
    """A study that was done and written: its ``folder``, page and ``notes`` on the folder, the comparison with a baseline, and
    the bodies and joints to ``show``."""

    options: RunOptions
    study: Study
    folder: Path
    selection: Selection
    compared: Compared | None
    page: Path | None
    notes: tuple[str, ...]
    names: tuple[str, ...]

    @property
    def comparison(self) -> BaselineComparison | None:
        """The comparison with the baseline."""
        return self.compared.comparison if self.compared is not None else None

    @property
    def code(self) -> int:
        """The exit code of the command."""
        code = self.study.exit_code
        if code == EXIT_OK and self.options.fail_on_diff is not None:
            code = diff_code(self.study.diffs)
        return EXIT_FAILED if code == EXIT_OK and self.compared is not None and self.compared.failed else code

    @property
    def verdict(self) -> list[VerdictPart]:
        """The verdict; after its motions also that these fail ``--fail-on-diff``."""
        parts = verdict(
            self.study, self.selection.not_taken, self.folder, skipped="--quick" if self.options.quick else ""
        )
        bound = self.options.fail_on_diff
        if bound is not None and diff_code(self.study.diffs) != EXIT_OK:
            after = next((n for n, part in enumerate(parts) if part.label in AFTER_MOTIONS), len(parts))
            parts.insert(after, VerdictPart("", f"failed: not within --fail-on-diff {length(bound)}", BAD))
        return parts

    def data(self) -> dict[str, Any]:
        """For ``--json``."""
        return {
            **study_data(self.study),
            "verdict": verdict_data(self.verdict),
            "exit_code": self.code,
            "folder": self.folder,
            "notes": self.notes,
            "page": self.page,
            "baseline": self.compared.data() if self.compared is not None else None,
            "not_run": self.selection.not_taken,
            "ends": {name: ends(run, self.names) for name, run in self.study.runs.items()},
        }

    def show(self) -> None:
        """Print the verdict; with ``--verbose`` every table before it."""
        screen = console()
        if self.options.verbose:
            show_not_taken(self.selection, screen)
            show_run(self.study, self.folder, self.names)
        if self.compared is not None:
            self.compared.show(screen)
        show_verdict(self.verdict, screen, self.options.quiet)
        notes = [f"note: {note}" for note in self.notes]
        notes += [f"report: {self.page}"] if self.page is not None else []
        for note in () if self.options.quiet else notes:
            screen.note(note)
        show_failures(self.study)
        show_inconclusive(self.study.diffs if self.options.fail_on_diff is not None else ())


def _tolerance(options: RunOptions) -> float:
    return options.tolerance if options.fail_on_diff is None else options.fail_on_diff


# --- baselines --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Compared:
    """Result of a comparison with a baseline: the comparison (None: there was no baseline), notes, and the baseline written."""

    comparison: BaselineComparison | None
    notes: tuple[str, ...]
    written: Path | None

    @property
    def failed(self) -> bool:
        """Whether something regressed, or nothing could be compared."""
        return self.comparison is not None and (bool(self.comparison.regressions) or not self.comparison.compared)

    def show(self, screen: Screen) -> None:
        """Print it."""
        if self.comparison is not None:
            show_comparison(self.comparison, screen)
        for note in self.notes:
            screen.note(f"note: {note}")
        if self.written is not None:
            screen.print(f"baseline written: {self.written}", soft_wrap=True)

    def data(self) -> dict[str, Any]:
        """For ``--json``."""
        comparison = comparison_data(self.comparison) if self.comparison is not None else None
        return {"notes": list(self.notes), "written": self.written, "comparison": comparison}


def _read_baseline(options: RunOptions) -> Baseline | None:
    """The baseline to compare with; None where there is none yet. Raises SpecError, before any work is done, when it is
    damaged, when the new one may not be written, or when no noise is measured."""
    if options.baseline is None and options.write_baseline is None:
        return None
    if not options.repeats or options.quick:
        word = "--quick" if options.quick else "--no-repeats"
        message = f"a baseline requires each engine's own noise, which {word} does not measure"
        raise SpecError([Problem(message, hint="leave one of the two out", code="C101")])
    if options.write_baseline is not None:
        demand([file_problem(options.write_baseline, is_baseline)])
    return read_baseline(options.baseline) if options.baseline is not None else None


def _with_baseline(
    options: RunOptions, before: Baseline | None, study: Study, selection: Selection, tell: Callable[..., None]
) -> Compared:
    """Time the engines of a study, compare it with ``before``, and write the new baseline: not over one from which it
    regressed."""
    read, written = options.baseline, options.write_baseline
    notes: list[str] = []
    timed: list[Run] = []
    if options.timed_runs and (written is not None or (before is not None and before.has_speed)):
        notes = [f"speed: {why}" for why in disturbances()]
        timed = _time(options, study, selection, tell)
    now = baseline_of(study, timed, _tolerance(options), this_machine())
    comparison = None
    if before is not None:
        comparison = compare(before, now)
        notes += comparison.notes
        if not comparison.compared:
            notes.append("nothing could be compared with the baseline")
    elif read is not None:
        notes.append(f"{read}: no baseline yet: nothing was compared (--write-baseline {read} makes it)")
    if written is not None:
        same = read is not None and read.resolve() == written.resolve()
        if any(run.failed is not None for run in study.runs.values()):
            notes.append(f"{written}: not written, as an engine failed")
            written = None
        elif comparison is not None and comparison.regressions and same:
            notes.append(f"{written}: kept, as this run regressed from it; to accept it: --write-baseline alone")
            written = None
        else:
            write_file(written, now.text(), is_baseline)
    return Compared(comparison, tuple(notes), written)


def _time(options: RunOptions, study: Study, selection: Selection, tell: Callable[..., None]) -> list[Run]:
    names = [name for name, run in study.runs.items() if run.failed is None]
    with scratch_folder("timing") as place:
        cases = []
        for name, compiled in compile_world(study.world, names, pythons=selection.pythons).items():
            compiled.artifacts.write(place / name)
            cases.append(TimedCase(Case(study.world, name), place / name, selection.pythons.get(name)))
        return list(timed_runs(cases, options.timed_runs, deadline=options.deadline, progress=tell)) if cases else []
