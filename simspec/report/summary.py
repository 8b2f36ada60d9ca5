"""A summary of a command in Markdown, as CI systems show it beside a job: verdict first, then tables."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence

from simspec.comparison.runs import Diff, out_words
from simspec.comparison.study import Study
from simspec.errors import clipped, visible
from simspec.report.differences import told
from simspec.report.tested import Status, Suite, counts, wrong

LARGEST = 2**20
"""Bytes that a job's summary may have: a longer one is not shown at all."""
RESERVE = 200
"""Bytes for the line that counts what is left out."""
BEGINNING = "<!-- simspec summary -->\n"
"""How each of these files begins: what simspec may replace."""
DIFFERENCES = ("compared", "verdict", "largest difference", "body", "first out of tolerance")
MARKS = re.compile(r"([\\`*_\[\]#|~$@])")


def own_summary(content: bytes) -> bool:
    """Whether simspec wrote a file (an empty one is nobody's)."""
    return not content or content.startswith(BEGINNING.encode())


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
    told = ", ".join(f"{number} {status}" for status, number in total.items() if number)
    lines = [f"## simspec: {specs}: {verdict}", "", told + "." if told else "No entries.", ""]
    lines += table(("", *Status), ([words(suite.name), *(str(suite.count(one)) for one in Status)] for suite in suites))
    if study is not None:
        lines += _figures(study)
    lines += baseline
    if bad:
        rows = ([words(suite.name), words(entry.name), words(entry.message)] for suite, entry in bad)
        lines += ["### What failed, worst first", "", *table(("", "entry", "why"), rows)]
    skipped = [(suite, entry) for suite in suites for entry in suite.entries if entry.status is Status.SKIPPED]
    if skipped:
        rows = ([words(suite.name), words(entry.name), words(entry.message)] for suite, entry in skipped)
        lines += ["### Skipped", "", *table(("", "entry", "why"), rows)]
    return _bounded(lines, room)


def _figures(study: Study) -> list[str]:
    rows = [
        [words(run.label), _number(run.real_time_factor), _number(run.end_to_end_factor)] for run in study.runs.values()
    ]
    shown = table(("engine", "real-time factor of the steps", "end to end"), rows)
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
    return shown + (table(DIFFERENCES, rows) if rows else [])


def _largest(diff: Diff) -> str:
    """The largest differences in position, angle, and in the coordinates of joints."""
    sizes = [f"{diff.worst.position_largest:.3g} m"] if diff.worst is not None else []
    sizes += [f"{diff.worst_angle.angle_largest:.3g} rad"] if diff.worst_angle is not None else []
    for unit in ("rad", "m"):
        sizes += [f"joint {one.largest:.3g} {unit}" for one in diff.joints if one.unit == unit][:1]
    return ", ".join(sizes)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table of Markdown, and an empty line; cells are Markdown already."""
    lines = [f"| {' | '.join(head)} |", f"|{' --- |' * len(head)}"]
    return [*lines, *(f"| {' | '.join(cells)} |" for cells in rows), ""]


def _bounded(lines: Sequence[str], room: int) -> str:
    """The lines that fit; the last one then counts the others."""
    text, used = [BEGINNING], len(BEGINNING)
    for number, line in enumerate(lines):
        size = len(line.encode()) + 1
        if used + size > room - RESERVE:
            text.append(f"\n{len(lines) - number:,} more lines are left out: a job's summary has a largest size.\n")
            break
        text.append(f"{line}\n")
        used += size
    return "".join(text) if room > RESERVE else ""
