"""What a command found, as test reports have it: suites (a spec in an engine) of entries that passed, failed, could not be
done, or do not apply. ``junit.py``, ``annotations.py`` and ``summary.py`` write it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from simspec.comparison.runs import OUT, WITHIN, Diff, out_words
from simspec.comparison.study import Study
from simspec.errors import MOST_PROBLEMS, EngineError, Location, Problem, SimspecError, SpecError, clipped
from simspec.experiments.index import Row
from simspec.experiments.plan import Cell
from simspec.experiments.sweep import Outcome as SweepOutcome
from simspec.proof.checks import Check
from simspec.report.certificate import level_title, strain
from simspec.report.differences import tolerances
from simspec.runner.expectations import Outcome
from simspec.runner.run import Run
from simspec.selection import NotTaken
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.proof.certificate import Certificate, EngineProof


Locate = Callable[[str], Location | None]


class Status(StrEnum):
    """What became of an entry. ERROR: it could not be done; SKIPPED: it does not apply, and why is said."""

    PASSED = "passed"
    FAILED = "failed"
    ERROR = "error"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Entry:
    """One thing that was tested.

    ``message``: in a line, what is wrong, or why it was skipped; ``detail``: more of it; ``location``: the place in the spec;
    ``seconds``: wall time; ``excess``: by which factor a bound is exceeded, infinite where no number says it.
    """

    name: str
    status: Status
    message: str = ""
    detail: str = ""
    location: Location | None = None
    seconds: float = 0.0
    excess: float = 0.0


@dataclass(frozen=True)
class Suite:
    """The entries of one ``spec`` in one ``engine`` (or of a pair of engines, or of the command as a whole)."""

    spec: str
    engine: str
    entries: tuple[Entry, ...] = field(default=())

    @property
    def name(self) -> str:
        """Spec and engine."""
        return f"{self.spec} / {self.engine}"

    def count(self, status: Status) -> int:
        """How many entries have this status."""
        return sum(entry.status is status for entry in self.entries)


def wrong(suites: Iterable[Suite]) -> list[tuple[Suite, Entry]]:
    """Every entry that is an error or failed, worst first: errors, then by how far a bound is exceeded."""
    rows = [(suite, entry) for suite in suites for entry in suite.entries]
    rows = [(suite, entry) for suite, entry in rows if entry.status in (Status.ERROR, Status.FAILED)]
    return sorted(rows, key=lambda row: (row[1].status is not Status.ERROR, -row[1].excess))


def counts(suites: Sequence[Suite]) -> dict[Status, int]:
    """How many entries have each status."""
    return {status: sum(suite.count(status) for suite in suites) for status in Status}


# Proofs and runs.


def certificate_suites(certificate: Certificate, world: World, locate: Locate) -> list[Suite]:
    """One suite for each engine, one entry for each level of the proof."""
    proofs = certificate.engines.items()
    return [Suite(certificate.name, engine, tuple(_levels(proof, world, locate))) for engine, proof in proofs]


def _levels(proof: EngineProof, world: World, locate: Locate) -> Iterable[Entry]:
    names = {check.level for check in proof.checks}
    separate = {name: why for name, why in (proof.not_compared | proof.unchecked).items() if " " not in name}
    for number, level in enumerate(sorted(names | separate.keys())):
        checks = proof.level(level)
        title = f"proof {level_title(level, checks)}"
        seconds = proof.seconds if number == 0 else 0.0  # the levels share one process
        bad = sorted((check for check in checks if not check.passed), key=strain, reverse=True)
        if bad:
            message = f"{bad[0].name}: {_deviation(bad[0])}" + (f" at {bad[0].where}" if bad[0].where else "")
            if len(bad) > 1:
                message += f"; {len(bad)} of {len(checks)} checks failed"
            lines = (f"{check.name}: {_deviation(check)} {check.where} {check.detail}".strip() for check in bad)
            detail = "\n".join(lines)
            place = _place(bad[0].where, world, locate)
            yield Entry(title, Status.FAILED, message, detail, place, seconds, strain(bad[0]))
        elif checks:
            yield Entry(title, Status.PASSED, seconds=seconds)
        else:
            yield Entry(title, Status.SKIPPED, separate[level], seconds=seconds)


def _deviation(check: Check) -> str:
    if not check.count:
        return "not compared"
    if check.worst is None:
        return "differs in kind"
    return f"deviation {check.worst:.3g}, tolerance {check.tolerance:.3g}"


def _place(where: str, world: World, locate: Locate) -> Location | None:
    """The place in the spec of what a check names: a path of the world, or a body; else the spec's beginning."""
    path = f"bodies.{where}" if any(body.name == where for body in world.bodies) else where
    return (locate(path) if path else None) or locate("name")


def study_suites(study: Study, locate: Locate, demand_diff: bool) -> list[Suite]:
    """One suite for each engine: its proof, its run, the expectations; then one for each pair of engines that was compared.

    ``demand_diff``: whether differences are failures; else they are told, and skipped.
    """
    world = study.world
    suites = []
    for name, run in study.runs.items():
        proof = study.certificate.engines.get(name) if study.certificate is not None else None
        entries = [] if proof is None else list(_levels(proof, world, locate))
        entries.append(_run_entry(run, locate))
        entries += [
            _expectation(number, outcome, run, locate) for number, outcome in enumerate(study.outcomes.get(name, ()))
        ]
        suites.append(Suite(world.name, name, tuple(entries)))
    if study.certificate is not None:  # a run that ended the study early leaves proofs of engines that were not run
        proofs = certificate_suites(study.certificate, world, locate)
        suites += [suite for suite in proofs if suite.engine not in study.runs]
    return suites + [_comparison(world, diff, locate, demand_diff) for diff in study.diffs]


def _run_entry(run: Run, locate: Locate) -> Entry:
    seconds = float(run.provenance.get("seconds", {}).get("process", 0.0))
    if run.failed is None:
        return Entry("run", Status.PASSED, seconds=seconds)
    first = run.failed.splitlines()[0] if run.failed else "no reason given"
    return Entry("run", Status.ERROR, clipped(first), run.failed, locate("name"), seconds, math.inf)


def _expectation(number: int, outcome: Outcome, run: Run, locate: Locate) -> Entry:
    name, place = f"expectation {number + 1} {outcome.kind}", locate(f"expect.{number}")
    if outcome.passed:
        return Entry(name, Status.PASSED, location=place)
    if run.failed is not None:
        return Entry(name, Status.SKIPPED, "the run failed", location=place)
    if outcome.measured is None:
        return Entry(name, Status.FAILED, outcome.detail, location=place, excess=math.inf)
    unit = f" {outcome.unit}" if outcome.unit else ""
    message = f"measured {outcome.measured:.6g}{unit}, bound {outcome.bound:.6g}{unit}"
    pair = (abs(outcome.measured), abs(outcome.bound))
    excess = max(pair) / min(pair) if min(pair) > 0.0 and math.isfinite(max(pair)) else math.inf
    return Entry(name, Status.FAILED, message, outcome.detail, place, excess=excess)


def _comparison(world: World, diff: Diff, locate: Locate, demanded: bool) -> Suite:
    entries = []
    for body in diff.bodies:
        name = f"same motion of {body.body}"
        if body.verdict == WITHIN:
            entries.append(Entry(name, Status.PASSED))
            continue
        if body.verdict == OUT:
            first = f"first beyond the tolerance of {tolerances(diff)} at {body.first_out:.4g} s: {out_words(body)}"
            message = f"differs by {body.position_largest:.3g} m and {body.angle_largest:.3g} rad, {first}"
        elif not body.compared:
            message = f"inconclusive: {diff.not_compared}"
        else:
            message = f"inconclusive: the engines' noise exceeds the tolerance from {body.inconclusive_from:.4g} s on"
        if demanded:
            pairs = ((body.position_largest, diff.tolerance), (body.angle_largest, diff.angle_tolerance))
            excess = max(largest / most if most else math.inf for largest, most in pairs)
            place = locate(f"bodies.{body.body}")
            entries.append(Entry(name, Status.FAILED, message, body.cause, place, excess=excess))
        else:
            entries.append(Entry(name, Status.SKIPPED, f"{message}; not demanded (--fail-on-diff)"))
    return Suite(world.name, f"{diff.first} – {diff.second}", tuple(entries))


# Skipped engines and errors.


def skipped_suites(spec: str, not_taken: Mapping[str, NotTaken]) -> list[Suite]:
    """Engines that were left out: a suite each, skipped with the reason."""
    suites = []
    for engine, why in not_taken.items():
        suites.append(Suite(spec, engine, (Entry("support", Status.SKIPPED, why.reason, location=why.location),)))
    return suites


def error_suites(spec: str, error: SimspecError) -> list[Suite]:
    """The error that ended a command: an entry for each of its problems."""
    if isinstance(error, EngineError):
        entry = Entry("engine", Status.ERROR, clipped(str(error).splitlines()[0]), str(error), excess=math.inf)
        return [Suite(spec, error.engine, (entry,))]
    problems: Sequence[Problem] = error.problems if isinstance(error, SpecError) else [Problem(str(error))]
    entries = []
    for problem in problems[:MOST_PROBLEMS]:
        about = (clipped(problem.message), str(problem), problem.location)
        entries.append(Entry(problem.path or "spec", Status.ERROR, *about, excess=math.inf))
    if len(problems) > MOST_PROBLEMS:
        entries.append(Entry("more", Status.ERROR, f"{len(problems) - MOST_PROBLEMS:,} more problems"))
    return [Suite(spec, "spec", tuple(entries))]


def file_of(location: Location, environment: Mapping[str, str] = os.environ) -> str:
    """A location's file as a path from the root of the repository that CI checked out, else from the working folder; as it is
    where it lies outside of both."""
    path = os.path.abspath(location.file)
    for root in (environment.get("GITHUB_WORKSPACE"), os.getcwd()):
        if root and os.path.commonpath([os.path.abspath(root), path]) == os.path.abspath(root):
            return os.path.relpath(path, root)
    return location.file


# Sweeps: a suite for each engine, an entry for each run.

MOST_ENTRIES = 20_000
"""Entries of one engine: further runs are counted in one. A report of more has tens of megabytes, which no CI system shows."""
UNSUPPORTED = "does not support this world"


def sweep_suites(outcome: SweepOutcome, rows: Iterable[tuple[Cell, Row | None]], locate: Locate) -> list[Suite]:
    """The runs of a sweep by engine, then proofs that failed, and values that make the spec invalid.

    ``locate``: gives the place of a path in the spec.
    """
    spec = outcome.plan.spec.name
    entries: dict[str, list[Entry]] = {}
    left: dict[tuple[str, Status], int] = {}
    for cell, row in rows:
        entry = _entry(cell, row, outcome, locate)
        local = entries.setdefault(cell.engine, [])
        if len(local) < MOST_ENTRIES or entry.status is Status.ERROR:
            local.append(entry)
        else:
            left[cell.engine, entry.status] = left.get((cell.engine, entry.status), 0) + 1
    for (engine, status), number in left.items():
        why = "" if status is Status.PASSED else "more than are listed"
        entries[engine].append(Entry(f"{number:,} more runs", status, why))
    suites = [Suite(spec, engine, tuple(local)) for engine, local in entries.items()]
    if outcome.unproven:
        place = locate("name")
        failed = [Entry("proof", Status.FAILED, why, "", place, excess=math.inf) for why in outcome.unproven.values()]
        suites.append(Suite(spec, "proofs", tuple(failed)))
    if outcome.invalid:
        problems = list(outcome.invalid)
        if (count := outcome.invalid_count) > 1:
            problems.append(Problem(f"{count:,} runs were not done: their values make the spec invalid"))
        suites += error_suites(spec, SpecError(problems))
    return suites


def _entry(cell: Cell, row: Row | None, outcome: SweepOutcome, locate: Locate) -> Entry:
    place = locate("sweep")
    name = _name(cell)
    if row is None:
        why = outcome.stopped.get(cell.engine, "not run")
        return Entry(name, Status.SKIPPED, clipped(why), location=place)
    seconds = row.process_seconds or 0.0
    if row.failed is not None:
        status = Status.SKIPPED if row.failed.startswith(UNSUPPORTED) else Status.ERROR
        return Entry(name, status, clipped(row.failed), row.failed, place, seconds, math.inf)
    if row.passed < row.expected:
        message = f"{row.expected - row.passed} of {row.expected} expectations are not met"
        return Entry(name, Status.FAILED, message, "", place, seconds, (row.expected - row.passed) / row.expected)
    return Entry(name, Status.PASSED, seconds=seconds)


def _name(cell: Cell) -> str:
    """What a cell asks for, in a line."""
    words = [f"run {cell.index + 1}"]
    words += [cell.case] if cell.case is not None else []
    words += [f"{path}={clipped(str(value), 60)}" for path, value in cell.overrides]
    words += [f"sample {cell.sample}"] if cell.sample is not None else []
    words += [f"seed {cell.seed}"] if cell.seed is not None else []
    words += [f"repeat {cell.repeat}"] if cell.repeat else []
    return ", ".join(words)
