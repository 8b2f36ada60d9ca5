"""Problems of specs and files on terminals: errors, refusals of engines, losses and repairs of imports, implausible values."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from simspec.engines.kit.registry import engine_name
from simspec.errors import MOST_PROBLEMS, EngineRefusal, Location, Problem, SimspecError, SpecError, UnsupportedError
from simspec.language.foreign import AccountGroup, LossSeverity, Repair, kind_of
from simspec.plausibility.findings import RULES, Grade, Plausibility, PlausibilityFinding
from simspec.report.screen import console, plain
from simspec.report.table import Table
from simspec.support.declarations import Level
from simspec.world.types import World

if TYPE_CHECKING:
    from rich.text import Text

    from simspec.audit.exported import ReaderLoss
    from simspec.formats.kit.contract import Loss
    from simspec.report.console import Screen
    from simspec.selection import Selection


# Imports: losses and repairs.


def losses_table(file: str, groups: Sequence[AccountGroup]) -> Table:
    """One row for each kind of loss, with the place of the first and the number of all. Kinds that change no physics and have
    one reason are one row."""
    rows = Table(
        f"Elements that the import of {file} does not carry", "what", "changes", "why", "line", "count", right=(3, 4)
    )
    alike: dict[tuple[str, ...], list[AccountGroup]] = {}
    for group in groups:
        first = group.first
        why = f"{first.reason}; {first.hint}" if first.hint else first.reason
        single = kind_of(first) if first.severity is LossSeverity.PHYSICS else ""
        alike.setdefault((first.severity.value, why, single), []).append(group)
    for (severity, why, _), same in alike.items():
        more = f" and {len(same) - 1} more" if len(same) > 1 else ""
        line, count = same[0].first.location.line, sum(group.count for group in same)
        rows.add(f"{kind_of(same[0].first)}{more}", severity, why, str(line), str(count))
    return rows


def repairs_table(repairs: Sequence[Repair]) -> Table:
    """One row for each repair."""
    rows = [(repair.rule, repair.what, repair.location.line) for repair in repairs]
    return Table("Repairs", "rule", "what", "line", right=(2,), rows=rows)


# Exports: losses of plain files.

WIDTH: Final = 80
"""Columns of a line."""


def export_losses_table(format_name: str, losses: Sequence[Loss], locate: Callable[[str], Location | None]) -> Table:
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


def as_problems(findings: Sequence[PlausibilityFinding]) -> list[Problem]:
    """Findings as problems of the spec, for ``--strict``."""
    problems = []
    for finding in findings:
        message = f"implausible ({finding.rule}): {finding.element}: {finding.message}"
        problems.append(
            Problem(message, finding.path, finding.location, hint=RULES[finding.rule].hint, code=finding.rule)
        )
    return problems


def plausibility_data(found: Plausibility) -> dict[str, Any]:
    """The same as plain data, each finding with the limit of its rule, the reason and the way out."""
    data: dict[str, Any] = plain(found)
    for finding in data["findings"]:
        rule = RULES[finding["rule"]]
        finding |= {"limit": rule.limit, "why": rule.why, "hint": rule.hint}
    return data


def _groups(found: Plausibility) -> list[tuple[PlausibilityFinding, ...]]:
    """Findings of one rule and grade together, warnings first."""
    groups: dict[tuple[Grade, str], list[PlausibilityFinding]] = {}
    for finding in (*found.warnings, *found.notes):
        groups.setdefault((finding.grade, finding.rule), []).append(finding)
    return [tuple(group) for group in groups.values()]


def _head(found: Plausibility) -> str:
    counts = {"warning": len(found.warnings), "note": len(found.notes)}
    parts = [f"{count} {name}{'s' if count > 1 else ''}" for name, count in counts.items() if count]
    return f"plausibility: {', '.join(parts)}"


def _short(group: tuple[PlausibilityFinding, ...]) -> str:
    first = group[0]
    line = f", line {first.location.line}" if first.location is not None else ""
    more = f"; and {len(group) - 1} more" if len(group) > 1 else ""
    text = f"  {first.grade} {first.rule}: {figure(first)}{first.element}{line}"
    return text + more if len(text + more) <= WIDTH else f"{text[: WIDTH - 1 - len(more)]}…{more}"


def figure(finding: PlausibilityFinding) -> str:
    """The figure of a finding in front of its element; empty where its rule has none."""
    value, unit = finding.value, finding.unit
    if not value:
        return ""
    if unit == "m" and abs(value) < 1.0:
        value, unit = 1e3 * value, "mm"
    elif unit == "kg" and abs(value) < 0.1:
        value, unit = 1e3 * value, "g"
    return f"{value:.3g} {unit or 'times'}, "


def _whole(group: tuple[PlausibilityFinding, ...]) -> Iterator[str]:
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


# Errors and warnings.


def show_error(error: SimspecError) -> None:
    """Print an error on standard error: every problem, its place first."""
    from rich.text import Text

    screen = console(error=True)
    if not isinstance(error, SpecError):
        screen.print(Text.assemble(_kind("error", error.code), str(error)), soft_wrap=not screen.is_terminal)
        return
    brief = error.brief if isinstance(error, UnsupportedError) else ()
    for problem in error.problems[:MOST_PROBLEMS]:
        if not (brief and isinstance(problem, EngineRefusal)):
            screen.print(_problem(problem, _kind("error", problem.code), screen), soft_wrap=True)
    for line in brief:
        screen.message(line)
    for line in error.more if not brief else ():
        screen.print(line)
    count = len(error.problems)
    head = f"{count} problem{'s' if count > 1 else ''}"
    screen.message(head + _pages(error.problems, screen.width - len(head)), style="bold red")
    for line in error.ending if isinstance(error, UnsupportedError) else ():
        screen.message(line)


def show_warnings(warnings: Sequence[Problem]) -> None:
    """Print warnings on standard error, as errors are."""
    screen = console(error=True)
    for problem in warnings:
        screen.print(_problem(problem, _kind("warning", problem.code), screen), soft_wrap=True)


def _kind(word: str, code: str) -> Text:
    from rich.text import Text

    style = "bold red" if word == "error" else "bold yellow"
    return Text(f"{word}[{code}]: " if code else f"{word}: ", style=style)


def _pages(problems: Iterable[Problem], width: int) -> str:
    """The command that prints the pages of some problems: of codes, of features where engines refuse these; the first, and as
    many as fit into ``width``."""
    words = [word for word in dict.fromkeys(_feature_of(problem) or problem.code for problem in problems) if word]
    text = f"; about {'it' if len(words) == 1 else 'them'}: simspec help {' '.join(words[:1])}" if words else ""
    for word in words[1:]:
        text += f" {word}" if len(text) + len(word) < width else ""
    return text


def _feature_of(problem: Problem) -> str:
    return problem.feature if isinstance(problem, EngineRefusal) else ""


def _problem(problem: Problem, kind: Text, screen: Screen) -> Text:
    """The text of a problem; on a terminal its lines are wrapped between words, and further lines are indented."""
    from rich.text import Text

    place = f"{problem.location}: " if problem.location else ""
    first, *rest = str(problem).split("\n")
    head = f"{place}{kind.plain}"
    lines = [f"{head}{first.removeprefix(place)}", *rest]
    if screen.is_terminal:
        lines = [part for line in lines for part in _wrapped(line, screen.width)]
    text = Text("\n".join(lines))
    if lines[0].startswith(head.rstrip()):
        text.stylize("bold", 0, len(place))
        text.stylize(kind.style, len(place), len(head))
    return text


def _wrapped(line: str, width: int) -> list[str]:
    indent = "           " if line.startswith("  ") else "    "
    return textwrap.wrap(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


LONGEST_REASON = 600
"""Characters of why an engine is left out: eight lines of a terminal; ``--json`` has the whole."""


def not_run_table(reasons: Mapping[str, str], places: Mapping[str, str] | None = None) -> Table | None:
    """The requested engines that did not run, one row each; None without any."""
    why = {name: textwrap.shorten(reason, LONGEST_REASON, placeholder=" …") for name, reason in reasons.items()}
    rows = [(name, reason + (places or {}).get(name, "")) for name, reason in why.items()]
    return Table("Not run", "engine", "why", rows=rows) if rows else None


def show_not_taken(selection: Selection, screen: Screen) -> None:
    """The engines that do not support the world and were not named, one row each; nothing where all are taken."""
    if not selection.not_taken:
        return
    places = {name: f"\n{taken.location}" if taken.location else "" for name, taken in selection.not_taken.items()}
    screen.print(not_run_table({name: taken.reason for name, taken in selection.not_taken.items()}, places))
    if requested := [name for name, refusal in selection.not_taken.items() if refusal.acceptable]:
        screen.note(f"to accept by name what differs: simspec accept SPEC  ({', '.join(requested)})")


# Refusals of engines: a line for each feature, and two with the ways out.

EVERY = "all"
"""Stands for every feature with ``--accept``."""
MOST_NAMED = 6
"""Features that the last line names; it counts the others."""
MOST_WORDS = 3
"""Features that are named as words of ``--accept``; more stand as ``all``."""
_WORDS = {
    Level.APPROXIMATE: "approximate in",
    Level.OUTSIDE: "computed outside of",
    Level.UNSUPPORTED: "not supported by",
}


@dataclass(frozen=True)
class WaysOut:
    """The ways out of what engines refuse of one spec.

    accepted     by engine that supports the spec once these are accepted: the features by option (``accept``, ``outside``)
    unsupported  by engine that nothing accepted helps: the features that it does not support, or the subjects of problems
                 that are of no feature
    by_none      features that none of the engines supports
    command      writes what is missing into the spec; empty where there is nothing to accept, or no file to write
    words        the same for one command, without writing: words of the command line
    """

    accepted: Mapping[str, Mapping[str, Sequence[str]]]
    unsupported: Mapping[str, Sequence[str]]
    by_none: Sequence[str]
    command: str
    words: str

    def lines(self) -> tuple[str, str]:
        """The two last lines of a command that fails for refusals."""
        if not self.accepted:
            first = "Accepting by name does not help any of these engines"
        else:
            how = " or ".join(filter(None, (self.command, self.words)))
            first = f"To accept what differs in {', '.join(self.accepted)}: {how}"
        if self.by_none:
            return first, f"Supported by none of these engines: {', '.join(self.by_none)}"
        if not self.unsupported:
            return first, "Every feature is supported by each of these engines once it is accepted"
        lacked = list(dict.fromkeys(feature for features in self.unsupported.values() for feature in features))
        return first, f"Not supported by {', '.join(self.unsupported)}, whatever is accepted: {_some(lacked)}"


def ways_out(
    problems: Iterable[Problem],
    spec: str,
    engines: Sequence[str],
    world: World | None = None,
    pythons: Mapping[str, str] | None = None,
    writable: bool = True,
) -> WaysOut | None:
    """The ways out of what ``engines`` (names or labels) refuse of the file ``spec``; None where no problem is of one engine.

    ``world``: engines that seem to need acceptances alone are compiled for with everything accepted, since a format may
    refuse more. ``writable``: whether ``simspec accept`` can write the file."""
    from simspec.selection import acceptable

    by_engine: dict[str, list[EngineRefusal]] = {}
    for problem in problems:
        if isinstance(problem, EngineRefusal):
            by_engine.setdefault(problem.engine, []).append(problem)
    if not by_engine:
        return None
    accepted: dict[str, dict[str, list[str]]] = {}
    unsupported: dict[str, list[str]] = {}
    labels = {engine_name(label): label for label in engines}
    for engine, refusals in by_engine.items():
        lacking = [_subject(refusal) for refusal in refusals if not refusal.option]
        if not lacking and world is not None and not acceptable(world, labels.get(engine, engine), pythons):
            lacking = ["its files, whatever is accepted"]
        if lacking:
            unsupported[engine] = list(dict.fromkeys(lacking))
            continue
        for entry in refusals:
            features = accepted.setdefault(engine, {}).setdefault(entry.option, [])
            features += [entry.feature] if entry.feature not in features else []
    names = list(dict.fromkeys(map(engine_name, engines))) or list(by_engine)
    lacked = dict.fromkeys(feature for of_engine in unsupported.values() for feature in of_engine)
    by_none = [feature for feature in lacked if all(feature in unsupported.get(name, ()) for name in names)]
    command = ""
    if accepted and writable:
        requested = " ".join(f"-e {labels.get(name, name)}" for name in accepted)
        command = f"simspec accept {shlex.quote(spec)} {requested}"
    words = dict.fromkeys(word for options in accepted.values() for named in options.values() for word in named)
    few = [f"--accept {word}" for word in words] if len(words) <= MOST_WORDS else [f"--accept {EVERY}"]
    return WaysOut(accepted, unsupported, by_none, command, " ".join(few) if words else "")


def with_endings(
    problems: Iterable[Problem], ways: Mapping[str, WaysOut], lines: Sequence[str] = ()
) -> UnsupportedError:
    """The error of several specs, whose last lines are the ways out by spec; ``lines``: see ``UnsupportedError.brief``."""
    error = UnsupportedError(problems)
    error.brief = tuple(lines)
    endings = [(name, line) for name, found in ways.items() for line in found.lines()]
    error.ending = tuple(f"{name}: {line}" if len(ways) > 1 else line for name, line in endings)
    error.ways_out = {name: vars(found) for name, found in ways.items()}
    return error


def brief(problems: Iterable[Problem]) -> list[str]:
    """One line for each feature that engines refuse, with the engines, and for each problem of an engine that is of none."""
    from simspec.compiler import OPTION_OF

    level_of = {option: level for level, option in OPTION_OF.items()}
    groups: dict[str, list[EngineRefusal]] = {}
    for problem in problems:
        if isinstance(problem, EngineRefusal):
            groups.setdefault(_subject(problem), []).append(problem)
    lines = []
    for what, refusals in groups.items():
        levels: dict[Level, dict[str, None]] = {}
        for refusal in refusals:
            levels.setdefault(level_of.get(refusal.option, Level.UNSUPPORTED), {})[refusal.engine] = None
        place = f"{refusals[0].location}: " if refusals[0].location else ""
        text = "; ".join(f"{_WORDS[level]} {', '.join(levels[level])}" for level in _WORDS if level in levels)
        lines.append(f"{place}{what}" if what.startswith(f"{refusals[0].engine}: ") else f"{place}{what}: {text}")
    return lines


MOST_IN_FULL = 3
"""Refusals of engines that a command prints in full; of more each feature is a line."""


def briefly(problems: Sequence[Problem], specs: Iterable[str], engines: Iterable[str]) -> tuple[str, ...]:
    """The lines of :func:`brief`, and the command that prints all in full; none for a few refusals."""
    if sum(isinstance(problem, EngineRefusal) for problem in problems) <= MOST_IN_FULL:
        return ()
    words = [*map(shlex.quote, specs), *(f"-e {name}" for name in engines)]
    return (*brief(problems), f"each in full: simspec check {' '.join(words)} -v")


@contextmanager
def with_ways_out(
    spec: str, engines: Sequence[str], world: World, pythons: Mapping[str, str] | None = None, writable: bool = True
) -> Iterator[None]:
    """An UnsupportedError raised within gets the ways out (see :func:`ways_out`) as its last lines."""
    try:
        yield
    except UnsupportedError as error:
        found = ways_out(error.problems, spec, engines, world, pythons, writable)
        if found is not None and not error.ending:
            error.ending, error.ways_out = found.lines(), {spec: vars(found)}
            error.brief = briefly(error.problems, [spec], engines)
        raise


def _subject(refusal: EngineRefusal) -> str:
    """The subject of a refusal: the feature, or for a problem of no feature the part of the message before its reason."""
    if refusal.feature:
        return refusal.feature
    subject = refusal.message.partition(": ")[0].removeprefix(f"{refusal.engine} does not support ")
    return subject if subject != refusal.message else f"{refusal.engine}: {subject}"


def _some(features: Sequence[str]) -> str:
    more = f", {len(features) - MOST_NAMED} more" if len(features) > MOST_NAMED else ""
    return ", ".join(features[:MOST_NAMED]) + more
