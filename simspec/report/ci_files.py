"""Test reports for CI systems: XML (JUnit), annotations of a spec's lines (GitHub), a summary in Markdown."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree

from simspec.comparison.runs import Diff, out_words
from simspec.comparison.study import Study
from simspec.errors import Location, Problem, clipped, visible
from simspec.report.differences import told
from simspec.report.table import markdown_rows
from simspec.report.tested import Entry, Status, Suite, counts, file_of, wrong

# XML ("JUnit"): one ``testsuite`` for each spec and engine. ``error``: an engine failed; ``failure``: a proof, an
# expectation or a comparison failed. Several CI systems read ``file`` and ``line`` of a ``testcase``, which no standard
# has.

BEGINNING = '<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="simspec"'
"""How each of these files begins: what simspec may replace."""
ELEMENTS = {Status.FAILED: "failure", Status.ERROR: "error", Status.SKIPPED: "skipped"}
LONGEST_DETAIL = 20_000
"""Characters of the text of one entry."""


def own_junit(content: bytes) -> bool:
    """Whether simspec wrote a file."""
    return content.startswith(BEGINNING.encode())


def junit(suites: Sequence[Suite]) -> str:
    """The report as XML text. Whatever names and messages contain is text in it; control characters are
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


def _seconds(suites: Sequence[Suite]) -> str:
    return f"{sum(entry.seconds for suite in suites for entry in suite.entries):.3f}"


def _add(parent: ElementTree.Element, suite: Suite, entry: Entry) -> None:
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


def annotation_lines(suites: Sequence[Suite], warnings: Sequence[Problem] = ()) -> list[str]:
    """The lines to print: what failed, worst first, then what looks like a slip in the spec; of each kind ten at most, the
    last of which counts the others."""
    errors = [
        (entry.location, f"{suite.engine}: {entry.name}", f"{suite.name}: {entry.name}: {entry.message}")
        for suite, entry in wrong(suites)
    ]
    slips = [(problem.location, problem.path or "spec", problem.message) for problem in warnings]
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
"""How each of these files begins: what simspec may replace."""
DIFFERENCES = ("compared", "verdict", "largest difference", "body", "first out of tolerance")
MARKS = re.compile(r"([\\`*_\[\]#|~$@])")


def own_summary(content: bytes) -> bool:
    """Whether simspec wrote a file (an empty one is nobody's)."""
    return not content or content.startswith(BEGINNING_SUMMARY.encode())


def words(text: str, most: int = 300) -> str:
    """Foreign text for a cell of a table: no markup, no link, one line."""
    marked = MARKS.sub(r"\\\1", html.escape(visible(clipped(text, most)), quote=False))
    return marked.replace("://", "&#58;//").replace("www.", "www&#46;")


def summary(
    suites: Sequence[Suite], study: Study | None = None, baseline: Sequence[str] = (), room: int = LARGEST
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
    for title, entries in (("What failed, worst first", bad), ("Skipped", skipped)):
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
            _largest(diff) if told(diff) else "–",
            words(diff.worst.body) if told(diff) else "–",
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
