"""What is implausible about a model, for people: a line for each rule, and on request each finding with reason and way out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from simspec.errors import Problem
from simspec.plausibility.findings import RULES, Finding, Grade, Plausibility
from simspec.report.plain import plain

WIDTH = 80
"""Columns of a line."""
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
    return [
        Problem(
            f"implausible ({finding.rule}): {finding.element}: {finding.message}",
            finding.path,
            finding.location,
            hint=RULES[finding.rule].hint,
        )
        for finding in findings
    ]


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
    parts = []
    for name, findings in (("warning", found.warnings), ("note", found.notes)):
        if findings:
            parts.append(f"{len(findings)} {name}{'s' if len(findings) > 1 else ''}")
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
