"""The verdict of a study in sentences."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from simspec.comparison.runs import INCONCLUSIVE, OUT, WITHIN, Diff, out_words
from simspec.comparison.study import Study
from simspec.errors import clipped
from simspec.proof.certificate import Certificate
from simspec.report.differences import angle, inconclusive_note, not_compared_words, tolerances
from simspec.report.studies import StoredStudy
from simspec.report.table import BAD, GOOD, PLAIN, WARNING, length, listed, number
from simspec.report.verdict import NBSP, VerdictPart
from simspec.report.verdict import verdict as study_verdict
from simspec.runner.unphysical import together

MARKS = {GOOD: "✓", WARNING: "!", BAD: "✗", PLAIN: "·"}
"""Marks in addition to the colour, so that the meaning does not depend on colour vision."""
MOST_FAILED = 5
"""Failed expectations, and failed checks, that are named."""
LONGEST_REASON = 300


@dataclass(frozen=True)
class Sentence:
    """One thing that is said, and whether it is good."""

    tone: str
    text: str

    @property
    def mark(self) -> str:
        return MARKS.get(self.tone, MARKS[PLAIN])


MOST_SENTENCES = 5
"""Sentences of the verdict, above the playback."""
RANK = {BAD: 0, WARNING: 1, GOOD: 2}
"""Tones, the worst first."""


def short_verdict(stored: StoredStudy) -> list[Sentence]:
    """A summary, and the verdict of the command line in at most four further sentences."""
    groups: dict[str, list[VerdictPart]] = {}
    label = ""
    for part in study_verdict(stored.study, {}, None):
        label = part.label or label
        groups.setdefault("model" if label in ("accepted", "contact law") else label, []).append(part)
    sentences = [
        Sentence(
            min((part.tone for part in parts), key=lambda tone: RANK.get(tone, len(RANK))),
            f"{name.capitalize()}: {'; '.join(_labelled(part, name) for part in parts)}.".replace(NBSP, " "),
        )
        for name, parts in groups.items()
    ]
    return [summary(stored.study), *sentences][:MOST_SENTENCES]


def _labelled(part: VerdictPart, group: str) -> str:
    return part.text if part.label in ("", group) else f"{part.label}: {part.text}"


def remarks(study: Study) -> list[Sentence]:
    """The results of a study in all sentences: models, failures, differences, expectations, repeats, speed."""
    makers = (_models, _failures, _differences, _expectations, _repeats, _speed)
    return [sentence for sentences in makers for sentence in sentences(study)]


def summary(study: Study) -> Sentence:
    """The answer in one sentence: models, motions, expectations."""
    failed = [name for name, run in study.runs.items() if run.failed is not None]
    certificate, verdicts = study.certificate, {diff.verdict for diff in study.diffs}
    if certificate is not None and any(name in study.runs for name, _ in certificate.failures()):
        return Sentence(BAD, "The engines do not have the same model: the runs below are not comparable.")
    if failed:
        return Sentence(BAD, f"{listed(failed)} did not finish.")
    model, proven = _model(study)
    rows = study.outcomes.values()
    unmet = len({index for row in rows for index, outcome in enumerate(row) if not outcome.passed})
    tail = f", and {unmet} expectation{'s' if unmet > 1 else ''} failed." if unmet else "."
    if _not_physical(study):
        tail, unmet = f"; the motion is not physical{tail}", unmet + 1
    tone = BAD if unmet else WARNING
    if not study.diffs:
        return Sentence(_worst(not proven, bool(unmet)), f"{model}{tail}")
    if OUT in verdicts:
        first = min((out for diff in study.diffs if (out := diff.first_out) is not None), key=_when)
        return Sentence(tone, f"{model}; their motions part at {_when(first):.4g} s{tail}")
    if all(diff.not_compared for diff in study.diffs):
        if _chaotic(study.diffs):
            return Sentence(tone, f"{model}; their own noise leaves no time at which motions can be compared{tail}")
        return Sentence(tone, f"{model}; nothing but the beginning was recorded that could be compared{tail}")
    if INCONCLUSIVE in verdicts:
        return Sentence(tone, f"{model}; whether they move alike is inconclusive, because of their own noise{tail}")
    times = {diff.compared_until for diff in study.diffs}
    then = f"{model}, and move alike"
    if _chaotic(study.diffs):
        then += f" until {min(times):.4g} s, where chaos begins" + (" in some of them" if len(times) > 1 else "")
    return Sentence(_worst(not proven, bool(unmet)), f"{then}{tail}")


def _model(study: Study) -> tuple[str, bool]:
    """The state of the models in words, and whether all of them were compared with the spec's."""
    certificate, alone = study.certificate, len(study.runs) == 1
    if certificate is None:
        return "The model was not checked" if alone else "The models were not compared", False
    if not study.runs.keys() <= certificate.engines.keys():
        return "Not every engine's model was compared with the spec's", False
    model = "The engine has the spec's model" if alone else "The engines have the same model"
    if any(certificate.engines[name].accepted for name in study.runs):
        model += ", with approximations that the spec accepts"
    return model, True


def _worst(unchecked: bool, unmet: bool) -> str:
    return BAD if unmet else WARNING if unchecked else GOOD


def _when(body: object) -> float:
    first_out = getattr(body, "first_out", None)
    return float(first_out) if first_out is not None else float("inf")


def _models(study: Study) -> Iterator[Sentence]:
    certificate = study.certificate
    if certificate is None:
        yield Sentence(WARNING, "Models: not compared. There is no certificate for these runs.")
        return
    proven = [name for name in study.runs if name in certificate.engines and certificate.engines[name].valid]
    if proven:
        count = sum(check.count for name in proven for check in certificate.engines[name].checks)
        yield Sentence(GOOD, f"Models: proven equal to the spec in {listed(proven)}, by {count:,} comparisons.")
    yield from _unproven(study, certificate)
    for name, proof in certificate.engines.items():
        if name in study.runs and proof.accepted:
            features = listed(sorted(proof.accepted))
            yield Sentence(WARNING, f"Models: {name} differs from the spec as the spec accepts: {features}.")
        if name in study.runs and proof.declared.declared:
            yield Sentence(WARNING, f"Contact: {name}: {proof.declared.words}.")


def _unproven(study: Study, certificate: Certificate) -> Iterator[Sentence]:
    for name in study.runs:
        if name not in certificate.engines:
            yield Sentence(WARNING, f"Models: {name} was not checked; the certificate does not contain it.")
            continue
        failed = [check for check in certificate.engines[name].checks if not check.passed]
        if failed:
            named = ", ".join(f"{check.level} {check.name}" for check in failed[:MOST_FAILED])
            more = f" and {len(failed) - MOST_FAILED} more" if len(failed) > MOST_FAILED else ""
            yield Sentence(BAD, f"Models: {name} does not have the spec's model. Failed: {named}{more}.")


def _failures(study: Study) -> Iterator[Sentence]:
    for name, run in study.runs.items():
        if run.failed is not None:
            until = f" Its records end at {run.time[-1]:.4g} s." if run.recorded else ""
            yield Sentence(BAD, f"Run: {name} failed: {clipped(run.failed, LONGEST_REASON)}.{until}")
    for line in _not_physical(study):
        yield Sentence(BAD, f"Motion: not physical: {line}.")


def _not_physical(study: Study) -> list[str]:
    return together({name: run.unphysical for name, run in study.runs.items() if run.recorded})


def _differences(study: Study) -> Iterator[Sentence]:
    """The pairs that agree, and those that were not compared, in a sentence for each time up to which they were; the others
    each in one."""
    alike = sorted((diff for diff in study.diffs if diff.verdict == WITHIN), key=_reach)
    for (_, chaotic), group in itertools.groupby(alike, _reach):
        same = list(group)
        chaos = ", beyond which the engines' own noise has outgrown that" if chaotic else ""
        largest = max((diff.worst.position_largest for diff in same if diff.worst is not None), default=0.0)
        turned = max((diff.worst_angle.angle_largest for diff in same if diff.worst_angle is not None), default=0.0)
        until = f"until {same[0].compared_until:.4g} s{chaos}"
        text = f"Motion: within {tolerances(same[0])} of each other {until}: {_pairs(same)}."
        yield Sentence(GOOD, f"{text} Largest difference: {length(largest)}, {angle(turned)}.")
    nothing = [diff for diff in study.diffs if diff.verdict == INCONCLUSIVE and diff.not_compared]
    for given in dict.fromkeys(map(not_compared_words, nothing)):
        same = [diff for diff in nothing if not_compared_words(diff) == given]
        yield Sentence(WARNING, f"Motion: {_pairs(same)}: {given}.")
    for diff in study.diffs:
        if diff.verdict == INCONCLUSIVE and not diff.not_compared and (note := inconclusive_note(diff)) is not None:
            yield Sentence(WARNING, f"Motion: {note}.")
        if (out := diff.first_out) is not None:
            cause = {"contact": "after a contact", "free motion": "in free motion"}.get(out.cause, out.cause)
            noise = f"; the engines' own noise is then at most {length(out.floor)}" if out.floor is not None else ""
            yield Sentence(
                WARNING,
                f"Motion: {_pair(diff)} part at {_when(out):.4g} s, {cause}: {out.body} is the first to differ by more "
                f"than {length(diff.tolerance)} or {diff.angle_tolerance:g} rad ({out_words(out)}){noise}.",
            )


def _reach(diff: Diff) -> tuple[float, bool]:
    """How far two runs were compared, those that go furthest first, and whether chaos ended it."""
    return -diff.compared_until, diff.horizon is not None


def _pairs(diffs: Sequence[Diff]) -> str:
    return ", ".join(_pair(diff) for diff in diffs)


def _chaotic(diffs: Sequence[Diff]) -> bool:
    return any(diff.horizon is not None for diff in diffs)


def _pair(diff: Diff) -> str:
    return f"{diff.first.split()[0]} – {diff.second.split()[0]}"


def _expectations(study: Study) -> Iterator[Sentence]:
    outcomes = [(name, outcome) for name, outcomes in study.outcomes.items() for outcome in outcomes]
    if not outcomes:
        return
    failed = [(name, outcome) for name, outcome in outcomes if not outcome.passed]
    if not failed:
        yield Sentence(GOOD, f"Expectations: all {len(outcomes)} met.")
        return
    named = "; ".join(
        f"{outcome.kind} in {name} ({number(outcome.measured, outcome.unit)}, bound {number(outcome.bound, outcome.unit)})"
        for name, outcome in failed[:MOST_FAILED]
    )
    more = f"; and {len(failed) - MOST_FAILED} more" if len(failed) > MOST_FAILED else ""
    yield Sentence(BAD, f"Expectations: {len(failed)} of {len(outcomes)} failed: {named}{more}.")


def _repeats(study: Study) -> Iterator[Sentence]:
    same = [name for name, floor in study.floors.items() if floor.bitwise is True]
    other = [name for name, floor in study.floors.items() if floor.bitwise is False]
    without = [name for name, run in study.runs.items() if name not in study.floors and run.failed is None]
    if same:
        verb = "repeats" if len(same) == 1 else "repeat"
        yield Sentence(GOOD, f"Repeatability: {listed(same)} {verb} the run to the last bit.")
    if other:
        yield Sentence(WARNING, f"Repeatability: a repeated run gave other bits in {listed(other)}.")
    if without:
        yield Sentence(
            WARNING, f"Repeatability: not measured in {listed(without)}: noise and differences cannot be separated."
        )


def _speed(study: Study) -> Iterator[Sentence]:
    factors = {name: factor for name, run in study.runs.items() if (factor := run.cpu_factor) is not None}
    if factors:
        ordered = sorted(factors.items(), key=lambda item: -item[1])
        figures = ", ".join(f"{name} {factor:.3g}" for name, factor in ordered)
        yield Sentence(GOOD, f"Speed: simulated time over processor time of the steps: {figures}.")
