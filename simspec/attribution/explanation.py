"""Where the difference of two sides comes from: windows, one swap at a time, what the swaps close together, what is left."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from simspec.attribution.candidates import Candidate, CandidateKind, Pair, causes, probes
from simspec.attribution.configuration import Asking, Configuration, ModelProof
from simspec.attribution.declared import (
    DeclaredDeviation,
    RecoveryShift,
    by_method,
    located,
    recoveries,
    touching_names,
    without_methods,
)
from simspec.attribution.differences import differences
from simspec.attribution.measure import (
    RUN,
    BodyGap,
    CombinedSwap,
    Gaps,
    Judge,
    Swap,
    negligible,
)
from simspec.attribution.windows import CLASSES, MOST_WINDOWS, FirstContact, take_windows
from simspec.engines.kit.capabilities import SINGLE
from simspec.engines.kit.process import Answer
from simspec.errors import EngineError

COLD = Asking()
MUCH = 0.5
"""Unexplained share of a class from which the analysis is repeated from the second side's states."""
SIDES = ("A", "B")
"""Names of the two sides."""


@dataclass(frozen=True)
class Explanation:
    """Result of ``simspec explain``.

    first, second  the two sides, in words
    same_engine    whether both are the same engine
    same_world     whether both were given the same world
    models         whether each side's engine model equals its world, where requested
    length         of a window (s); ``counts``: windows of the run by class, ``looked_at``: evaluated windows, ``hidden``:
                   windows that do not count, because noise hides the gap in them
    gap, floor     by class: mean gap (m) of the windows between the sides, and of a side with itself, its states moved in the
                   last bits: the first side, or a second of lower precision, where that gap is larger
    singles        the sides' engines that compute in single precision, by their titles
    contact        the first contact
    causes         what differs between the sides, or from engines' defaults, each by itself; ``caused``: together
    probes         of what is left then: other choices, refinements, removals, each by itself; ``probed``: those that help,
                   together, with shares of what was left
    unexplained    share of the gap, by class, that neither causes nor probes close
    restart        of two engines, of A and B by class (m): how far each is from its own run, where it begins windows in that
                   run's states; their memory in addition to their state
    exchanged      the same from B's states, where much is unexplained from A's; there A is B, and B is A
    notes          what was not looked at, and why
    declared       declared deviations of the two engines that fit: those with a law, by the share that it predicts of what the
                   causes leave, which is not unexplained; then those that act where the difference is
    """

    first: str
    second: str
    same_engine: bool
    same_world: bool
    models: tuple[ModelProof, ...]
    length: float
    counts: Mapping[str, int]
    looked_at: int
    hidden: int
    gap: Mapping[str, float]
    floor: Mapping[str, float]
    contact: FirstContact | None
    causes: tuple[Swap, ...]
    caused: CombinedSwap
    probes: tuple[Swap, ...]
    probed: CombinedSwap
    unexplained: Mapping[str, float]
    restart: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    exchanged: Explanation | None = None
    notes: tuple[str, ...] = ()
    declared: tuple[DeclaredDeviation, ...] = ()
    singles: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<Explanation of {self.first} and {self.second}: {len(self.causes)} differences>"

    @property
    def telling(self) -> tuple[str, ...]:
        """The classes with a gap that is more than round-off."""
        return tuple(name for name in self.gap if self.gap[name] > negligible(self.floor.get(name, 0.0)))


def explain_sides(
    first: Configuration,
    second: Configuration,
    names: tuple[str, str],
    *,
    most: int = MOST_WINDOWS,
    asking: Asking = COLD,
    proofs: Sequence[ModelProof] = (),
    progress: Callable[..., None] = lambda text, share=None: None,
) -> Explanation:
    """Where the difference of two sides comes from. ``names``: names of the sides; ``most``: maximum number of evaluated
    windows; ``proofs``: proofs of each side's model.

    Raises SpecError where they are of different scenes or have no common window, UnsupportedError and EngineError where one of
    the unchanged sides cannot run; a swap that cannot run is reported as failed.
    """
    explanation = _from_first(first, second, names, most=most, asking=asking, proofs=proofs, progress=progress)
    if explanation.same_engine or not any(
        share > MUCH for name, share in explanation.unexplained.items() if name in CLASSES
    ):
        return explanation
    # a state may be one that the other side never comes into: a deep overlap, say, that no swap takes back within a window
    progress("asking the same from the second side's states")
    try:
        other = _from_first(second, first, names[::-1], most=most, asking=asking, proofs=(), progress=progress)
    except EngineError as error:
        notes = (*explanation.notes, f"not evaluated from the second side's states: {error}")
        return dataclasses.replace(explanation, notes=notes)
    return dataclasses.replace(explanation, exchanged=other)


def _from_first(
    first: Configuration,
    second: Configuration,
    names: tuple[str, str],
    *,
    most: int,
    asking: Asking,
    proofs: Sequence[ModelProof],
    progress: Callable[..., None],
) -> Explanation:
    """The result of :func:`explain_sides` from states of the first side."""
    differing = causes(first, second)
    progress("running the first side")
    windows, run = take_windows(first, second, asking, most)
    gaps = Gaps(windows, asking)
    progress("asking both sides")
    pair = (first, second)
    gap, noise, contact = gaps.begin(pair, run)
    floor = Judge(gaps, pair, noise, {}, progress).gap
    judge = Judge(gaps, pair, gap, floor, progress)
    if differing and (not judge.telling or any(candidate.whole_run for candidate in differing)):
        judge = judge.with_runs()
    swaps = judge.each(differing)
    judge, swaps, notes = _in_whole_runs(judge, differing, swaps)
    caused, left, rest = judge.together(differing, swaps)
    same = first.kind is second.kind
    restart: dict[str, dict[str, float]] = {}
    if not same and judge.telling:
        progress("asking whether the engines repeat their own runs")
        try:
            again = gaps.restarted(pair, run)
            restart = {name: judge.means(gap) for name, gap in zip(SIDES, again, strict=True)}
        except EngineError as error:
            notes.append(f"not known whether the engines repeat their own runs from their states: {error}")
    if gaps.not_finite:
        notes.append(f"{gaps.not_finite} windows are not looked at: a state at their end is not finite")
    windows = gaps.windows
    declared: list[DeclaredDeviation] = []
    methods: list[DeclaredDeviation] = []
    met: dict[str, float] = dict(caused.gap)
    touching = touching_names(first.world, run)
    if not same and judge.open(met) and (said := recoveries(left, touching)):
        found, rest = _recovered(gaps, left, rest, floor, said, run)
        declared, met = found, ({**met, **judge.means(BodyGap(rest.windows))} if found else met)
    probed, further = CombinedSwap((), met, {}), list[Swap]()
    if not same and judge.open(met):
        second_judge = Judge(gaps, left, BodyGap(rest.windows), floor, progress)
        candidates = list(probes(left))
        further = second_judge.each(candidates)
        closing = [both for both in zip(candidates, further, strict=True) if both[0].kind is not CandidateKind.REMOVAL]
        probed, _, _ = second_judge.together([both[0] for both in closing], [both[1] for both in closing])
        tried = list(zip(candidates, further, strict=True))
        methods = by_method(
            left, tried, {name: met[name] / gap for name, gap in judge.gap.items() if gap and name in met}
        )
        declared += [*methods, *located(left, touching, tried)]
    unexplained = {name: 1.0 - share for name, share in judge.shares({**caused.gap, **probed.gap}).items()}
    unexplained = without_methods(methods, unexplained)
    return Explanation(
        *names,
        same,
        not differences(first.world, second.world),
        tuple(proofs),
        float(windows.length),
        windows.counts,
        len(windows.numbers),
        int((~gaps.quiet).sum()),
        judge.gap,
        floor,
        contact,
        tuple(swaps),
        caused,
        tuple(further),
        probed,
        unexplained,
        restart,
        None,
        tuple(notes),
        tuple(declared),
        _singles(pair),
    )


def _singles(pair: Pair) -> tuple[str, ...]:
    kinds = dict.fromkeys(side.kind for side in pair)
    return tuple(kind.TITLE or kind.NAME for kind in kinds if kind.PRECISION == SINGLE)


def _recovered(
    gaps: Gaps, pair: Pair, gap: BodyGap, floor: Mapping[str, float], said: Sequence[tuple[str, str]], run: Answer
) -> tuple[list[DeclaredDeviation], BodyGap]:
    """The part of a gap that declared laws of recovery account for, and the rest; later gaps are without this part. Nothing
    where they close no share that may be claimed."""
    judge = Judge(gaps, pair, BodyGap(gap.windows), floor, lambda *_: None)
    gaps.shift = RecoveryShift(gaps.windows, run)
    after = gaps.of(pair)
    means, intervals = judge.means(after), judge.intervals(after)
    share = judge.claimed(judge.shares(means), intervals)
    if not share or sum(share.values()) <= 0.0:
        gaps.shift = None
        return [], gap
    engines, whats = (" and ".join(dict.fromkeys(words)) for words in zip(*said, strict=True))
    return [DeclaredDeviation(engines, whats, "recovery of overlaps", True, share, intervals)], after


def _in_whole_runs(
    judge: Judge, candidates: Sequence[Candidate], swaps: Sequence[Swap]
) -> tuple[Judge, list[Swap], list[str]]:
    """Swaps that act in no evaluated window are tried in whole runs: they may act in other windows, in states that the first
    side does not reach, or over longer times."""
    idle = [index for index, swap in enumerate(swaps) if swap.failed is None and not swap.acts]
    if RUN in judge.gap or not idle:
        return judge, list(swaps), []
    try:
        whole = judge.with_runs()
    except EngineError as error:
        return judge, list(swaps), [f"whole runs are not compared: {error}"]
    again = dict(zip(idle, whole.each([candidates[index] for index in idle]), strict=True))
    if not any(swap.acts for swap in again.values()):
        return judge, list(swaps), []
    return whole, [again.get(index, swap) for index, swap in enumerate(swaps)], []
