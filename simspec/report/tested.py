"""Test reports: entries of proofs, runs and sweeps, and files for CI systems: JUnit, annotations, a summary in Markdown."""

from __future__ import annotations

import html
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from simspec.comparison.runs import OUT, WITHIN, Diff, out_words
from simspec.comparison.study import Study
from simspec.errors import MOST_PROBLEMS, EngineError, Location, Problem, SimspecError, SpecError, clipped, visible
from simspec.proof.checks import Check
from simspec.report.certificate import level_title, strain
from simspec.report.differences import has_figures, tolerances
from simspec.report.table import markdown_rows
from simspec.runner.expectations import Outcome
from simspec.runner.run import Run
from simspec.selection import NotTaken
from simspec.world.types import World

if TYPE_CHECKING:
    from simspec.experiments.index import RunRow
    from simspec.experiments.plan import Cell
    from simspec.experiments.sweep import SweepOutcome
    from simspec.proof.certificate import Certificate, EngineProof


# Entries: suites (a spec in an engine) of entries that passed, failed, could not be done, or do not apply.

Locate = Callable[[str], Location | None]


class Status(StrEnum):
    """The result of an entry. ERROR: it could not be done; SKIPPED: it does not apply, and why is said."""

    PASSED = "passed"
    FAILED = "failed"
    ERROR = "error"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class TestedEntry:
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
class TestedSuite:
    """The entries of one ``spec`` in one ``engine`` (or of a pair of engines, or of the command as a whole)."""

    spec: str
    engine: str
    entries: tuple[TestedEntry, ...] = field(default=())

    @property
    def name(self) -> str:
        """Spec and engine."""
        return f"{self.spec} / {self.engine}"

    def count(self, status: Status) -> int:
        """How many entries have this status."""
        return sum(entry.status is status for entry in self.entries)


def wrong(suites: Iterable[TestedSuite]) -> list[tuple[TestedSuite, TestedEntry]]:
    """Every entry that is an error or failed, worst first: errors, then by how far a bound is exceeded."""
    rows = [(suite, entry) for suite in suites for entry in suite.entries]
    rows = [(suite, entry) for suite, entry in rows if entry.status in (Status.ERROR, Status.FAILED)]
    return sorted(rows, key=lambda row: (row[1].status is not Status.ERROR, -row[1].excess))


def counts(suites: Sequence[TestedSuite]) -> dict[Status, int]:
    """How many entries have each status."""
    return {status: sum(suite.count(status) for suite in suites) for status in Status}


# Proofs and runs.


def certificate_suites(certificate: Certificate, world: World, locate: Locate) -> list[TestedSuite]:
    """One suite for each engine, one entry for each level of the proof."""
    proofs = certificate.engines.items()
    return [TestedSuite(certificate.name, engine, tuple(_levels(proof, world, locate))) for engine, proof in proofs]


def _levels(proof: EngineProof, world: World, locate: Locate) -> Iterable[TestedEntry]:
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
            yield TestedEntry(title, Status.FAILED, message, detail, place, seconds, strain(bad[0]))
        elif checks:
            yield TestedEntry(title, Status.PASSED, seconds=seconds)
        else:
            yield TestedEntry(title, Status.SKIPPED, separate[level], seconds=seconds)


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


def study_suites(study: Study, locate: Locate, demand_diff: bool) -> list[TestedSuite]:
    """One suite for each engine: its proof, its run, the expectations; then one for each pair of engines that was compared.

    ``demand_diff``: whether differences are failures; else they are reported as skipped.
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
        suites.append(TestedSuite(world.name, name, tuple(entries)))
    if study.certificate is not None:  # a run that ended the study early leaves proofs of engines that were not run
        proofs = certificate_suites(study.certificate, world, locate)
        suites += [suite for suite in proofs if suite.engine not in study.runs]
    return suites + [_comparison(world, diff, locate, demand_diff) for diff in study.diffs]


def _run_entry(run: Run, locate: Locate) -> TestedEntry:
    seconds = float(run.provenance.get("seconds", {}).get("process", 0.0))
    if run.failed is None:
        return TestedEntry("run", Status.PASSED, seconds=seconds)
    first = run.failed.splitlines()[0] if run.failed else "no reason given"
    return TestedEntry("run", Status.ERROR, clipped(first), run.failed, locate("name"), seconds, math.inf)


def _expectation(number: int, outcome: Outcome, run: Run, locate: Locate) -> TestedEntry:
    name, place = f"expectation {number + 1} {outcome.kind}", locate(f"expect.{number}")
    if outcome.passed:
        return TestedEntry(name, Status.PASSED, location=place)
    if run.failed is not None:
        return TestedEntry(name, Status.SKIPPED, "the run failed", location=place)
    if outcome.measured is None:
        return TestedEntry(name, Status.FAILED, outcome.detail, location=place, excess=math.inf)
    unit = f" {outcome.unit}" if outcome.unit else ""
    message = f"measured {outcome.measured:.6g}{unit}, bound {outcome.bound:.6g}{unit}"
    pair = (abs(outcome.measured), abs(outcome.bound))
    excess = max(pair) / min(pair) if min(pair) > 0.0 and math.isfinite(max(pair)) else math.inf
    return TestedEntry(name, Status.FAILED, message, outcome.detail, place, excess=excess)


def _comparison(world: World, diff: Diff, locate: Locate, demanded: bool) -> TestedSuite:
    entries = []
    for body in diff.bodies:
        name = f"same motion of {body.body}"
        if body.verdict == WITHIN:
            entries.append(TestedEntry(name, Status.PASSED))
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
            entries.append(TestedEntry(name, Status.FAILED, message, body.cause, place, excess=excess))
        else:
            entries.append(TestedEntry(name, Status.SKIPPED, f"{message}; not demanded (--fail-on-diff)"))
    return TestedSuite(world.name, f"{diff.first} – {diff.second}", tuple(entries))


# Skipped engines and errors.


def skipped_suites(spec: str, not_taken: Mapping[str, NotTaken]) -> list[TestedSuite]:
    """Engines that were left out: a suite each, skipped with the reason."""
    suites = []
    for engine, why in not_taken.items():
        suites.append(
            TestedSuite(spec, engine, (TestedEntry("support", Status.SKIPPED, why.reason, location=why.location),))
        )
    return suites


def coded_message(problem: Problem) -> str:
    """The message of a problem with its code, for systems that show the message alone."""
    message = clipped(problem.message)
    return f"{message} [{problem.code}]" if problem.code else message


def error_suites(spec: str, error: SimspecError) -> list[TestedSuite]:
    """The error that ended a command: an entry for each of its problems."""
    if isinstance(error, EngineError):
        entry = TestedEntry("engine", Status.ERROR, clipped(str(error).splitlines()[0]), str(error), excess=math.inf)
        return [TestedSuite(spec, error.engine, (entry,))]
    problems: Sequence[Problem] = error.problems if isinstance(error, SpecError) else [Problem(str(error), code="E202")]
    entries = []
    for problem in problems[:MOST_PROBLEMS]:
        about = (coded_message(problem), str(problem), problem.location)
        entries.append(TestedEntry(problem.path or "spec", Status.ERROR, *about, excess=math.inf))
    if len(problems) > MOST_PROBLEMS:
        entries.append(TestedEntry("more", Status.ERROR, f"{len(problems) - MOST_PROBLEMS:,} more problems"))
    return [TestedSuite(spec, "spec", tuple(entries))]


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


def sweep_suites(
    outcome: SweepOutcome, rows: Iterable[tuple[Cell, RunRow | None]], locate: Locate
) -> list[TestedSuite]:
    """The runs of a sweep by engine, then proofs that failed, and values that make the spec invalid.

    ``locate``: gives the place of a path in the spec.
    """
    spec = outcome.plan.spec.name
    entries: dict[str, list[TestedEntry]] = {}
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
        entries[engine].append(TestedEntry(f"{number:,} more runs", status, why))
    suites = [TestedSuite(spec, engine, tuple(local)) for engine, local in entries.items()]
    if outcome.unproven:
        place = locate("name")
        failed = [
            TestedEntry("proof", Status.FAILED, why, "", place, excess=math.inf) for why in outcome.unproven.values()
        ]
        suites.append(TestedSuite(spec, "proofs", tuple(failed)))
    if outcome.invalid:
        problems = list(outcome.invalid)
        if (count := outcome.invalid_count) > 1:
            problems.append(Problem(f"{count:,} runs were not done: their values make the spec invalid", code="R106"))
        suites += error_suites(spec, SpecError(problems))
    return suites


def _entry(cell: Cell, row: RunRow | None, outcome: SweepOutcome, locate: Locate) -> TestedEntry:
    place = locate("sweep")
    name = _name(cell)
    if row is None:
        why = outcome.stopped.get(cell.engine, "not run")
        return TestedEntry(name, Status.SKIPPED, clipped(why), location=place)
    seconds = row.process_seconds or 0.0
    if row.failed is not None:
        status = Status.SKIPPED if row.failed.startswith(UNSUPPORTED) else Status.ERROR
        return TestedEntry(name, status, clipped(row.failed), row.failed, place, seconds, math.inf)
    if row.passed < row.expected:
        message = f"{row.expected - row.passed} of {row.expected} expectations are not met"
        return TestedEntry(name, Status.FAILED, message, "", place, seconds, (row.expected - row.passed) / row.expected)
    return TestedEntry(name, Status.PASSED, seconds=seconds)


def _name(cell: Cell) -> str:
    """The case, values and seed of a cell in a line."""
    words = [f"run {cell.index + 1}"]
    words += [cell.case] if cell.case is not None else []
    words += [f"{path}={clipped(str(value), 60)}" for path, value in cell.overrides]
    words += [f"sample {cell.sample}"] if cell.sample is not None else []
    words += [f"seed {cell.seed}"] if cell.seed is not None else []
    words += [f"repeat {cell.repeat}"] if cell.repeat else []
    return ", ".join(words)


# XML ("JUnit"): one ``testsuite`` for each spec and engine. ``error``: an engine failed; ``failure``: a proof, an expectation,
# or a comparison failed. Several CI systems read ``file`` and ``line`` of a ``testcase``, which no standard has.

BEGINNING = '<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="simspec"'
"""The beginning of each of these files, by which simspec knows the files that it may replace."""
ELEMENTS = {Status.FAILED: "failure", Status.ERROR: "error", Status.SKIPPED: "skipped"}
LONGEST_DETAIL = 20_000
"""Characters of the text of one entry."""


def is_junit(content: bytes) -> bool:
    """Whether simspec wrote a file."""
    return content.startswith(BEGINNING.encode())


def junit(suites: Sequence[TestedSuite]) -> str:
    """The report as XML text. Markup in names and messages is escaped as text; control characters are
    escaped as in Python."""
    total = counts(suites)
    root = ElementTree.Element("testsuites", {"name": "simspec", **_numbers(total), "time": _seconds(suites)})
    for suite in suites:
        numbers = _numbers({status: suite.count(status) for status in Status})
        attributes = {"name": visible(suite.name), **numbers, "time": _seconds([suite])}
        element = ElementTree.SubElement(root, "testsuite", attributes)
        for entry in suite.entries:
            _add(element, suite, entry)
    ElementTree.indent(root, " ")
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'


def _numbers(by_status: dict[Status, int]) -> dict[str, str]:
    names = {"failures": Status.FAILED, "errors": Status.ERROR, "skipped": Status.SKIPPED}
    return {"tests": str(sum(by_status.values())), **{name: str(by_status[status]) for name, status in names.items()}}


def _seconds(suites: Sequence[TestedSuite]) -> str:
    return f"{sum(entry.seconds for suite in suites for entry in suite.entries):.3f}"


def _add(parent: ElementTree.Element, suite: TestedSuite, entry: TestedEntry) -> None:
    attributes = {"name": visible(entry.name), "classname": visible(f"{suite.spec}.{suite.engine}")}
    attributes["time"] = f"{entry.seconds:.3f}"
    if entry.location is not None:
        attributes |= {"file": visible(file_of(entry.location)), "line": str(entry.location.line)}
    element = ElementTree.SubElement(parent, "testcase", attributes)
    if entry.status in ELEMENTS:
        given = {"message": visible(entry.message)}
        if entry.status is not Status.SKIPPED:
            given["type"] = entry.status.value
        child = ElementTree.SubElement(element, ELEMENTS[entry.status], given)
        if entry.detail:
            child.text = visible(entry.detail[:LONGEST_DETAIL], lines=True)


# Annotations of a spec's lines, for GitHub Actions.

MOST = 10
"""Annotations of one kind that a step may have: further ones are dropped without a word."""
IN_TEXT = {"%": "%25", "\r": "%0D", "\n": "%0A"}
IN_PROPERTY = {**IN_TEXT, ":": "%3A", ",": "%2C"}


def annotation_lines(suites: Sequence[TestedSuite], warnings: Sequence[Problem] = ()) -> list[str]:
    """The lines to print: failures, worst first, then likely mistakes of the spec; of each kind ten at most, the
    last of which counts the others."""
    errors = [
        (entry.location, f"{suite.engine}: {entry.name}", f"{suite.name}: {entry.name}: {entry.message}")
        for suite, entry in wrong(suites)
    ]
    slips = [(problem.location, problem.path or "spec", coded_message(problem)) for problem in warnings]
    return [*_lines("error", errors), *_lines("warning", slips)]


def _lines(kind: str, rows: Sequence[tuple[Location | None, str, str]]) -> Iterable[str]:
    shown = rows if len(rows) <= MOST else rows[: MOST - 1]
    for location, title, text in shown:
        properties = {} if location is None else {"file": file_of(location), "line": str(location.line)}
        if location is not None:
            properties["col"] = str(location.column)
        yield _line(kind, {**properties, "title": title}, text)
    if len(rows) > len(shown):
        yield _line(kind, {"title": "simspec"}, f"{len(rows) - len(shown)} more: see the test report or the output")


def _line(kind: str, properties: dict[str, str], text: str) -> str:
    given = ",".join(f"{name}={_escaped(visible(value), IN_PROPERTY)}" for name, value in properties.items())
    return f"::{kind} {given}::{_escaped(visible(text, lines=True), IN_TEXT)}"


def _escaped(text: str, table: dict[str, str]) -> str:
    return "".join(table.get(character, character) for character in text)


# Summary of a command in Markdown: verdict first, then tables.

LARGEST = 2**20
"""Bytes that a job's summary may have: a longer one is not shown at all."""
RESERVE = 200
"""Bytes for the line that counts what is left out."""
BEGINNING_SUMMARY = "<!-- simspec summary -->\n"
"""The beginning of each of these files, by which simspec knows the files that it may replace."""
DIFFERENCES = ("compared", "verdict", "largest difference", "body", "first out of tolerance")
MARKS = re.compile(r"([\\`*_\[\]#|~$@])")


def is_summary(content: bytes) -> bool:
    """Whether simspec wrote a file, or the file is empty."""
    return not content or content.startswith(BEGINNING_SUMMARY.encode())


def words(text: str, most: int = 300) -> str:
    """Foreign text for a cell of a table: no markup, no link, one line."""
    marked = MARKS.sub(r"\\\1", html.escape(visible(clipped(text, most)), quote=False))
    return marked.replace("://", "&#58;//").replace("www.", "www&#46;")


def summary(
    suites: Sequence[TestedSuite], study: Study | None = None, baseline: Sequence[str] = (), room: int = LARGEST
) -> str:
    """The summary, of at most ``room`` bytes; ``baseline``: Markdown lines about a baseline."""
    total = counts(suites)
    bad = wrong(suites)
    specs = ", ".join(dict.fromkeys(words(suite.spec) for suite in suites)) or "nothing"
    verdict = "failed" if bad else "passed" if total[Status.PASSED] else "nothing was tested"
    text = ", ".join(f"{number} {status}" for status, number in total.items() if number)
    lines = [f"## simspec: {specs}: {verdict}", "", text + "." if text else "No entries.", ""]
    rows: Iterable[Sequence[str]] = [
        [words(suite.name), *(str(suite.count(status)) for status in Status)] for suite in suites
    ]
    lines += [*markdown_rows(("", *Status), rows), ""]
    if study is not None:
        lines += _figures(study)
    lines += baseline
    skipped = [(suite, entry) for suite in suites for entry in suite.entries if entry.status is Status.SKIPPED]
    for title, entries in (("Failures, worst first", bad), ("Skipped", skipped)):
        if entries:
            rows = ([words(suite.name), words(entry.name), words(entry.message)] for suite, entry in entries)
            lines += [f"### {title}", "", *markdown_rows(("", "entry", "why"), rows), ""]
    return _bounded(lines, room)


def _figures(study: Study) -> list[str]:
    factors = {words(run.label): (run.real_time_factor, run.end_to_end_factor) for run in study.runs.values()}
    rows = [[name, *("–" if each is None else f"{each:.3g}" for each in pair)] for name, pair in factors.items()]
    shown = [*markdown_rows(("engine", "real-time factor of the steps", "end to end"), rows), ""]
    rows = [
        [
            words(f"{diff.first} – {diff.second}"),
            diff.verdict + (f": {words(diff.not_compared)}" if diff.not_compared else ""),
            _largest(diff) if has_figures(diff) else "–",
            words(diff.worst.body) if has_figures(diff) else "–",
            f"{words(out.body)} at {out.first_out:.4g} s: {out_words(out)}" if (out := diff.first_out) else "–",
        ]
        for diff in study.diffs
        if diff.worst is not None
    ]
    return shown + ([*markdown_rows(DIFFERENCES, rows), ""] if rows else [])


def _largest(diff: Diff) -> str:
    """The largest differences in position, angle, and in the coordinates of joints."""
    sizes = [f"{diff.worst.position_largest:.3g} m"] if diff.worst is not None else []
    sizes += [f"{diff.worst_angle.angle_largest:.3g} rad"] if diff.worst_angle is not None else []
    for unit in ("rad", "m"):
        sizes += [f"joint {joint.largest:.3g} {unit}" for joint in diff.joints if joint.unit == unit][:1]
    return ", ".join(sizes)


def _bounded(lines: Sequence[str], room: int) -> str:
    """The lines that fit; the last one then counts the others."""
    text, used = [BEGINNING_SUMMARY], len(BEGINNING_SUMMARY)
    for number, line in enumerate(lines):
        size = len(line.encode()) + 1
        if used + size > room - RESERVE:
            text.append(f"\n{len(lines) - number:,} more lines are left out: a job's summary has a largest size.\n")
            break
        text.append(f"{line}\n")
        used += size
    return "".join(text) if room > RESERVE else ""
