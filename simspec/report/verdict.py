"""The verdict of a study in a few lines: whether the model is the same, the motions agree, and expectations are met."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.text import Text

from simspec.comparison.clusters import Agreement, Cluster, ClusterDeparture, agreement
from simspec.comparison.runs import OUT, Diff
from simspec.engines.kit.capabilities import DOUBLE
from simspec.errors import EngineRefusal, visible
from simspec.numerals import rounded
from simspec.report.certificate import level_title, strain
from simspec.report.console import STYLES
from simspec.report.table import BAD, DIM, GOOD, WARNING, length, listed, number
from simspec.runner.unphysical import together
from simspec.selection import NotTaken
from simspec.support.features import Feature
from simspec.world.contact_pairs import meeting_laws

if TYPE_CHECKING:
    from simspec.comparison.study import Study
    from simspec.proof.certificate import EngineProof

LABEL = 14
"""Columns of the labels."""
LONGEST_COMMAND = 80 - LABEL
"""Columns up to which a command is followed by its purpose."""
MOST_LINES = 12
"""Lines of a verdict on a terminal; longer parts are cut."""
NBSP = "\u00a0"
"""A blank at which no line is broken."""
FURTHER = "further: "
"""The beginning of the part on departures after the first."""
AFTER_MOTIONS = ("expectations", "speed", "not run", "next")
"""Labels of the parts that may follow the motions."""
CUT_FIRST = ("not run", "accepted", "speed", "contact law", "model", "further")
"""Parts that are cut before the others, where a verdict is too long."""
NAMED = 5
"""Engines up to which those with the same model are named where all have it."""
NOT_INSTALLED = "not installed"
"""The beginning of the reason of an engine that is not there: the tables list it."""
FEW = 3
"""Features, checks or expectations that a line names; it counts the others."""


@dataclass(frozen=True, slots=True)
class VerdictPart:
    """One line of a verdict: a label, a sentence, and its tone. ``brief``: whether a short verdict contains it."""

    label: str
    text: str
    tone: str = ""
    brief: bool = True


def verdict(
    study: Study, not_run: Mapping[str, NotTaken | str], folder: Path | None, skipped: str = ""
) -> list[VerdictPart]:
    """The verdict of a study, in the order of the questions.

    ``not_run``: requested engines that were left out, with the reason; ``folder``: the study's, for the commands that help;
    ``skipped``: the option by which contact and noise were not measured.
    """
    found = agreement(study)
    parts = [*_failed(study), *_unphysical(study), *_model(study), *_contact(study, skipped)]
    parts += [*_motion(found, study), *_expectations(study), *_speed(study)]
    if words := grouped(not_run):
        parts.append(VerdictPart("not run", words, WARNING, brief=False))
    return parts + (_next(found, folder) if folder is not None else [])


def verdict_data(parts: Iterable[VerdictPart]) -> list[dict[str, Any]]:
    """The verdict as plain data."""
    return [{"label": part.label, "text": part.text.replace(NBSP, " ")} for part in parts if part.label != "next"]


def show_verdict(parts: Sequence[VerdictPart], screen: Console, brief: bool = False) -> None:
    """Print a verdict on at most :data:`MOST_LINES` lines."""
    shown = [part for part in parts if part.brief or not brief]
    for part, lines in zip(shown, fitted(shown, screen.width), strict=True):
        for index, line in enumerate(lines):
            label = ("" if index else part.label).ljust(LABEL)
            line = line.replace(NBSP, " ")
            screen.print(Text(label, style="bold").append(Text(line, style=STYLES.get(part.tone, ""))), soft_wrap=True)


def fitted(parts: Sequence[VerdictPart], width: int) -> list[list[str]]:
    """The lines of each part, wrapped to ``width`` columns; the longest are cut until all are at most :data:`MOST_LINES`.
    Commands are never cut nor wrapped."""
    room = max(width - LABEL, 20)
    whole = [
        [visible(line) for line in part.text.split("\n")]
        if part.label == "next"
        else textwrap.wrap(visible(part.text), room, break_long_words=False, break_on_hyphens=False) or [""]
        for part in parts
    ]
    while sum(map(len, whole)) > MOST_LINES:
        cuttable = [index for index, part in enumerate(parts) if part.label != "next" and len(whole[index]) > 1]
        if not cuttable:
            break
        least = min(_rank(parts[index]) for index in cuttable)
        longest = max(
            (index for index in cuttable if _rank(parts[index]) == least), key=lambda index: len(whole[index])
        )
        whole[longest] = textwrap.wrap(
            visible(parts[longest].text),
            room,
            max_lines=len(whole[longest]) - 1,
            placeholder=" … (-v: all)",
            break_long_words=False,
            break_on_hyphens=False,
        )
    return whole


def _rank(part: VerdictPart) -> int:
    """The order in which parts are cut: the least first."""
    name = "further" if part.text.startswith(FURTHER) else part.label
    return CUT_FIRST.index(name) if name in CUT_FIRST else len(CUT_FIRST)


def _failed(study: Study) -> list[VerdictPart]:
    reasons = [(name, run.failed) for name, run in study.runs.items() if run.failed is not None]
    return [
        VerdictPart("failed", f"{name}: {(why.splitlines() or ['no reason given'])[0].removeprefix(f'{name}: ')}", BAD)
        for name, why in reasons
    ]


def _unphysical(study: Study) -> list[VerdictPart]:
    lines = together({name: run.unphysical for name, run in study.runs.items() if run.recorded})
    return [VerdictPart("not physical", "; ".join(lines), BAD)] if lines else []


# --- the model ---


def _model(study: Study) -> list[VerdictPart]:
    certificate = study.certificate
    if certificate is None:
        return [VerdictPart("model", "not proven to be the same: the proof was skipped", WARNING)]
    proofs = certificate.engines
    valid = {name: proof for name, proof in proofs.items() if proof.valid}
    parts = []
    if valid:
        count = sum(check.count for proof in valid.values() for check in proof.checks)
        singles = [name for name, proof in valid.items() if proof.precision != DOUBLE]
        whole = valid.keys() == proofs.keys() | study.runs.keys()
        names = f"all {len(valid)} engines" if whole and len(valid) > NAMED else ", ".join(valid)
        text = f"same in {names} ({count:,} comparisons)"
        text += f"; {', '.join(singles)} in single precision" if singles else ""
        parts.append(VerdictPart("model", text, GOOD))
    if different := [_not_valid(name, proof) for name, proof in proofs.items() if not proof.passed]:
        parts.append(VerdictPart("" if parts else "model", f"differs in {'; '.join(different)}", BAD))
    if unproven := [name for name, proof in proofs.items() if proof.passed and proof.files_alone]:
        text = f"not proven in {listed(unproven)}: the files alone were checked"
        parts.append(VerdictPart("" if parts else "model", text, WARNING))
    if without := [name for name, run in study.runs.items() if name not in proofs and run.failed is None]:
        text = f"not proven in {listed(without)}: the certificate does not contain it"
        parts.append(VerdictPart("" if parts else "model", text, WARNING))
    methods = {name: proof.convergence for name, proof in valid.items() if proof.convergence is not None}
    if methods:
        text = "; ".join(f"{name} of {limit.ordinal} order, {limit.difference}" for name, limit in methods.items())
        parts.append(VerdictPart("method", text, WARNING))
    accepted: dict[str, list[str]] = {}
    for name, proof in proofs.items():
        # a method that was measured has a line with its figures
        features = [feature for feature in proof.accepted if not (proof.convergence and feature == METHOD)]
        if features:
            accepted.setdefault(_few(features), []).append(name)
    if accepted:
        text = "; ".join(f"{', '.join(names)}: {features}" for features, names in accepted.items())
        parts.append(VerdictPart("accepted", text, WARNING))
    return parts


METHOD = Feature.INTEGRATOR.value


def _not_valid(name: str, proof: EngineProof) -> str:
    failed = sorted((check for check in proof.checks if not check.passed), key=strain, reverse=True)
    if not failed:
        return f"{name}: nothing was compared"
    worst = failed[0]
    where = f" at {worst.where}" if worst.where else ""
    deviation = "" if worst.worst is None else f" by {worst.worst:.2g} (tolerance {worst.tolerance:.2g})"
    more = f" and {len(failed) - 1} more checks" if len(failed) > 1 else ""
    return f"{name}: {level_title(worst.level, [worst])}, {worst.name}{deviation}{where}{more}"


def _contact(study: Study, skipped: str) -> list[VerdictPart]:
    certificate = study.certificate
    if certificate is None or not meeting_laws(study.world):
        return []
    measured = {name: proof for name, proof in certificate.engines.items() if proof.contact}
    if not measured:
        return [VerdictPart("contact law", f"not measured{f' ({skipped})' if skipped else ''}", WARNING)]
    shares = {name: proof.declared for name, proof in measured.items()}
    text = "measured"
    cached, figures = (
        sum(share.cached for share in shares.values()),
        sum(share.figures for share in shares.values()),
    )
    text += f" ({figures:,} figures" + (f", {cached:,} of them from the cache)" if cached else ")")
    by = [f"{name}: {share.declared} of {share.figures}" for name, share in shares.items() if share.declared]
    text += f"; by declared deviation in {', '.join(by)}" if by else ""
    absent = [f"{name}: no {_few(share.effects)}" for name, share in shares.items() if share.absent]
    text += f"; {'; '.join(absent)}" if absent else ""
    passed = all(check.passed for proof in measured.values() for check in proof.level("L5"))
    return [VerdictPart("contact law", text, (WARNING if by else GOOD) if passed else BAD)]


# --- motions ---


def _motion(found: Agreement, study: Study) -> list[VerdictPart]:
    if not found.clusters:
        return []
    first = found.clusters[0]
    if len(study.diffs) == 0:
        return [VerdictPart("motion", f"only {first.engines[0]} ran: nothing to compare with", DIM)]
    floors = [study.floors[name] for name in first.engines if name in study.floors]
    source = ", from the cache" if floors and all(floor.cached for floor in floors) else ""
    parts = [VerdictPart("motion", _agreeing(first, source), GOOD)] if len(first.engines) > 1 else []
    out = sorted((departure for departure in found.departures if departure.diff.verdict == OUT), key=_order)
    first_out = out[0] if out else None
    if first_out is not None:
        text = _departing(first_out, alone=len(first.engines) == 1)
        parts.append(VerdictPart("" if parts else "motion", text, WARNING))
    if more := out[1:]:
        text = "; ".join(
            f"{', '.join(departure.cluster.engines)} by {_largest(departure)[0]} from {_since(departure):.3g}{NBSP}s"
            for departure in more
        )
        parts.append(VerdictPart("", f"{FURTHER}{text}", WARNING))
    for departure in found.departures:
        if departure.diff.verdict != OUT:
            why = departure.diff.not_compared or _hidden(departure.diff)
            text = f"{', '.join(departure.cluster.engines)} against {departure.reference}: inconclusive: {why}"
            parts.append(VerdictPart("" if parts else "motion", text, WARNING))
    return parts


def _since(departure: ClusterDeparture) -> float:
    """The time (s) of the first difference out of tolerance."""
    body = departure.diff.first_out
    return body.first_out if body is not None and body.first_out is not None else math.inf


def _order(departure: ClusterDeparture) -> tuple[float, float]:
    """The earliest departure first, of several at one time the largest."""
    worst = departure.diff.worst
    size = worst.position_largest if worst is not None else 0.0
    return _since(departure), -size if math.isfinite(size) else -math.inf


def _agreeing(cluster: Cluster, source: str) -> str:
    """The agreement of a cluster. ``source``: of its noise, where that was not measured now."""
    noise = "noise not measured" if cluster.noise is None else f"noise {_size(cluster.noise)}{source}"
    until = f" until {cluster.until:.3g}{NBSP}s, then chaos" if cluster.horizon else ""
    return f"{', '.join(cluster.engines)} agree within {_within(cluster)}{until} ({noise})"


def _within(cluster: Cluster) -> str:
    turn = f" and {cluster.angle:.2g}{NBSP}rad" if cluster.angle > cluster.position else ""
    return (_size(cluster.position) if cluster.position else f"0{NBSP}m") + turn


def _departing(departure: ClusterDeparture, alone: bool) -> str:
    """The first departure. ``alone``: whether the reference agrees with no other engine, so that it has not been named."""
    engines, body = ", ".join(departure.cluster.engines), departure.diff.first_out
    several = len(departure.cluster.engines) > 1
    engines += f" (within {_within(departure.cluster)} of each other)" if several else ""
    size, time, name = _largest(departure)
    cause = {"contact": ", after contact", "free motion": ", in free motion"}.get(body.cause if body else "", "")
    if departure.contact:
        cause = f", after {'–'.join(departure.contact)} contact"
    verb = "differ" if several else "differs"
    verb += f" from {departure.reference}" if alone else ""
    return f"{engines} {verb} by {size} at {time:.3g}{NBSP}s ({name}), from {_since(departure):.3g}{NBSP}s{cause}"


def _largest(departure: ClusterDeparture) -> tuple[str, float, str]:
    """The largest difference in the quantity that first exceeded its tolerance, with its unit; its time (s), and its body."""
    diff = departure.diff
    body, worst, turned = diff.first_out, diff.worst, diff.worst_angle
    assert worst is not None, "a body is out of tolerance"
    assert turned is not None, "a body is out of tolerance"
    if body is not None and "position" not in body.exceeded:
        return f"{turned.angle_largest:.3g}{NBSP}rad", turned.time_of_largest_angle, turned.body
    return _size(worst.position_largest), worst.time_of_largest, worst.body


def _size(value: float) -> str:
    """A length whose unit stays on the line of its number."""
    return length(value).replace(" ", NBSP)


def _hidden(diff: Diff) -> str:
    body = diff.inconclusive_body
    noise = f" of {_size(body.floor)}" if body is not None and body.floor else ""
    return f"the engines' noise{noise} hides differences of the tolerance's size"


# --- expectations and speed ---


def _expectations(study: Study) -> list[VerdictPart]:
    """The expectations in the engines that ran: a failed run is a line of its own."""
    by_engine = {name: row for name, row in study.outcomes.items() if row}
    if not by_engine:
        return []
    absent = [name for name in by_engine if study.runs[name].failed is not None]
    if len(absent) == len(by_engine):
        return [VerdictPart("expectations", f"not evaluated: {listed(absent)} failed", BAD)]
    by_engine = {name: row for name, row in by_engine.items() if name not in absent}
    without = f"; not evaluated in {listed(absent)}" if absent else ""
    count = max(map(len, by_engine.values()))
    missed: dict[int, list[str]] = {}
    for name, row in by_engine.items():
        for index, outcome in enumerate(row):
            if not outcome.passed:
                missed.setdefault(index, []).append(name)
    if not missed:
        return [VerdictPart("expectations", f"{count} of {count} met{without}", BAD if absent else GOOD)]
    words = []
    for index, names in list(missed.items())[:FEW]:
        outcome = by_engine[names[0]][index]
        figures = (
            f"{number(outcome.measured, outcome.unit)}, bound {number(outcome.bound, outcome.unit)}"
            if outcome.measured is not None
            else outcome.detail or "not measured"
        )
        words.append(f"{outcome.kind} not met in {listed(names)} ({figures})")
    more = (f"; and {len(missed) - FEW} more" if len(missed) > FEW else "") + without
    return [VerdictPart("expectations", f"{count - len(missed)} of {count} met; {'; '.join(words)}{more}", BAD)]


def _speed(study: Study) -> list[VerdictPart]:
    factors = {name: run.real_time_factor for name, run in study.runs.items()}
    known = sorted(((value, name) for name, value in factors.items() if value), reverse=True)
    if not known:
        return []
    best, first = known[0]
    slower = [
        f"{name} {best / value:.1f}" if best / value < 10 else f"{name} {rounded(best / value, 2)}"
        for value, name in known[1:]
    ]
    text = f"{first} {rounded(best, 3)} × real time" + (f"; {', '.join(slower)} times slower" if slower else "")
    return [VerdictPart("speed", text, brief=False)]


# --- engines that did not run, and commands that help ---


def grouped(not_run: Mapping[str, NotTaken | str]) -> str:
    """The engines that did not run, by the features that they refuse; without those that are not installed."""
    groups: dict[str, list[str]] = {}
    for name, why in not_run.items():
        if not str(why).startswith(NOT_INSTALLED):
            groups.setdefault(_short(why), []).append(name)
    return "; ".join(f"{', '.join(names)}: {why}" for why, names in groups.items())


def _short(why: NotTaken | str) -> str:
    """The features that an engine refuses, or the beginning of the reason."""
    if isinstance(why, NotTaken):
        features = [problem.feature for problem in why.problems if isinstance(problem, EngineRefusal)]
        if known := list(dict.fromkeys(feature for feature in features if feature)):
            return _few(known) + (" (can be accepted)" if why.acceptable else "")
    text = str(why).splitlines()[0]
    return textwrap.shorten(text, 90, placeholder=" …")


def _few(names: Sequence[str]) -> str:
    more = len(names) - FEW
    return ", ".join(names[:FEW]) + (f" and {more} more" if more > 0 else "")


def _next(found: Agreement, folder: Path) -> list[VerdictPart]:
    commands = []
    out = min((departure for departure in found.departures if departure.diff.verdict == OUT), key=_order, default=None)
    if out is not None:
        commands.append((f"simspec explain {folder / out.reference} {folder / out.engine}", "why they differ"))
    commands.append((f"simspec view {folder}", "see it"))
    width = max(len(command) for command, _ in commands)
    words = any(len(f"{command.ljust(width)}  ({why})") > LONGEST_COMMAND for command, why in commands)
    text = "\n".join(command if words else f"{command.ljust(width)}  ({why})" for command, why in commands)
    return [VerdictPart("next", text, DIM, brief=False)]
