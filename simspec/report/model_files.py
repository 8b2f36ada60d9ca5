"""Repairs of imported files, losses of imports and exports, and implausible values, for people."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

from simspec.errors import Location, Problem
from simspec.language.foreign import Group, Repair, kind_of
from simspec.plausibility.findings import RULES, Finding, Grade, Plausibility
from simspec.report.plain import plain
from simspec.report.table import Table

if TYPE_CHECKING:
    from simspec.audit.exported import ReaderLoss
    from simspec.formats.kit.contract import Loss

# Imports: losses and repairs.


def losses_table(file: str, groups: Sequence[Group]) -> Table:
    """One row for each kind of loss, with the place of the first and the number of all."""
    rows = Table(f"What the import of {file} does not carry", "what", "changes", "why", "line", "count", right=(3, 4))
    for group in groups:
        first = group.first
        why = f"{first.reason}; {first.hint}" if first.hint else first.reason
        rows.add(kind_of(first), first.severity.value, why, str(first.location.line), str(group.count))
    return rows


def repairs_table(repairs: Sequence[Repair]) -> Table:
    """One row for each repair."""
    rows = [(repair.rule, repair.what, repair.location.line) for repair in repairs]
    return Table("What was repaired", "rule", "what", "line", right=(2,), rows=rows)


# Exports: losses of plain files.

WIDTH: Final = 80
"""Columns of a line."""


def losses_table_losses(format_name: str, losses: Sequence[Loss], locate: Callable[[str], Location | None]) -> Table:
    """One row for each loss; of its places the first, as file and line where the spec says it, else as the path."""
    rows = Table(f"What {format_name} does not carry", "feature", "what happens", "how", "where", "places", right=(4,))
    for loss in losses:
        first = loss.paths[0]
        location = locate(first)
        where = first if location is None else f"{location.file}:{location.line}"
        rows.add(loss.feature, loss.fate.value, loss.how, where, str(len(loss.paths)))
    return rows


def reader_lines(format_name: str, losses: Sequence[ReaderLoss]) -> Iterator[str]:
    """Which of the known readers of a format have the world's model, which another (with the number of its differences), and
    which refuse a file."""
    from simspec.audit.exported import readers
    from simspec.engines.kit.foreign import REFUSED

    counts: dict[str, int] = {reader.short: 0 for reader in readers(format_name)}
    refused = {loss.reader.short for loss in losses if loss.element == REFUSED}
    for loss in losses:
        counts[loss.reader.short] += 1
    same = [name for name, count in counts.items() if not count]
    changed = [f"{name} ({count})" for name, count in counts.items() if count and name not in refused]
    for title, names in (
        ("read as the spec by", same),
        ("read with differences (listed in losses.json) by", changed),
        ("refused by", sorted(refused)),
    ):
        if names:
            yield from textwrap.wrap(f"{title}: {', '.join(names)}", WIDTH, subsequent_indent="  ")


# Implausible values: a line for each rule, or each finding with its reason and way out.

MOST_LINES = 10
"""Lines of rules, after which the others are counted."""


def plausibility_lines(found: Plausibility, verbose: bool = False, warned: bool = False) -> list[str]:
    """Lines for a terminal. ``verbose``: every finding; ``warned``: leave out rules whose findings stand among the warnings of
    the spec, which are printed already."""
    groups = [group for group in _groups(found) if not (warned and RULES[group[0].rule].warned)]
    if not groups:
        return []
    lines = [_head(found)]
    if verbose:
        for group in groups:
            lines += _whole(group)
    else:
        lines += [_short(group) for group in groups[:MOST_LINES]]
        if left := groups[MOST_LINES:]:
            lines.append(f"  and {sum(map(len, left))} findings of {len(left)} more rules (-v)")
    return [*lines, *_sampled(found)]


def as_problems(findings: Sequence[Finding]) -> list[Problem]:
    """Findings as problems of the spec, for ``--strict``."""
    problems = []
    for finding in findings:
        message = f"implausible ({finding.rule}): {finding.element}: {finding.message}"
        problems.append(Problem(message, finding.path, finding.location, hint=RULES[finding.rule].hint))
    return problems


def plausibility_data(found: Plausibility) -> dict[str, Any]:
    """The same as plain data, each finding with the limit of its rule, the reason and the way out."""
    data: dict[str, Any] = plain(found)
    for finding in data["findings"]:
        rule = RULES[finding["rule"]]
        finding |= {"limit": rule.limit, "why": rule.why, "hint": rule.hint}
    return data


def _groups(found: Plausibility) -> list[tuple[Finding, ...]]:
    """Findings of one rule and grade together, warnings first."""
    groups: dict[tuple[Grade, str], list[Finding]] = {}
    for finding in (*found.warnings, *found.notes):
        groups.setdefault((finding.grade, finding.rule), []).append(finding)
    return [tuple(group) for group in groups.values()]


def _head(found: Plausibility) -> str:
    counts = {"warning": len(found.warnings), "note": len(found.notes)}
    parts = [f"{count} {name}{'s' if count > 1 else ''}" for name, count in counts.items() if count]
    return f"plausibility: {', '.join(parts)}"


def _short(group: tuple[Finding, ...]) -> str:
    first = group[0]
    line = f", line {first.location.line}" if first.location is not None else ""
    more = f"; and {len(group) - 1} more" if len(group) > 1 else ""
    text = f"  {first.grade} {first.rule}: {figure(first)}{first.element}{line}{more}"
    return text if len(text) <= WIDTH else f"{text[: WIDTH - 1]}…"


def figure(finding: Finding) -> str:
    """The figure of a finding in front of its element; empty where its rule has none."""
    value, unit = finding.value, finding.unit
    if not value:
        return ""
    if unit == "m" and abs(value) < 1.0:
        value, unit = 1e3 * value, "mm"
    elif unit == "kg" and abs(value) < 0.1:
        value, unit = 1e3 * value, "g"
    return f"{value:.3g} {unit or 'times'}, "


def _whole(group: tuple[Finding, ...]) -> Iterator[str]:
    rule = RULES[group[0].rule]
    yield f"  {group[0].grade} {rule.code}: {rule.why}; way out: {rule.hint}"
    for finding in group:
        place = f"{finding.location}: " if finding.location is not None else ""
        yield f"    {place}{finding.element}: {finding.message}"


def _sampled(found: Plausibility) -> Iterator[str]:
    """How the ranges of the joints were searched, where that left something open, or something was found there."""
    sampling = found.sampling
    swept = any(finding.positions for finding in found.findings)
    if sampling.cut_short:
        yield f"  joint ranges: {sampling.positions} of {sampling.planned} positions, {sampling.cut_short}"
    elif swept:
        yield f"  joint ranges: {sampling.positions} positions of {sampling.joints} joints"
    if sampling.left_out:
        first, why = next(iter(sampling.left_out.items()))
        more = f" and {len(sampling.left_out) - 1} more" if len(sampling.left_out) > 1 else ""
        yield f"  not moved: {first}{more}: {why}"
