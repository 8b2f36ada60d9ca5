"""Where the difference of two sides comes from: windows, one swap at a time, what the swaps close together, what is left."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from simspec.attribution.candidates import Candidate, Kind, Pair, causes, probes
from simspec.attribution.configuration import Asking, Configuration
from simspec.attribution.contact import FirstContact
from simspec.attribution.declared import Declared, RecoveryShift, located, recoveries, touching_names
from simspec.attribution.differences import differences
from simspec.attribution.judge import Joint, Judge, Swap
from simspec.attribution.measure import RUN, Gap, Gaps, negligible
from simspec.attribution.models import ModelProof
from simspec.attribution.windows import CLASSES, MOST_WINDOWS, take_windows
from simspec.engines.kit.process import Answer
from simspec.errors import EngineError

COLD = Asking()
MUCH = 0.5
"""Unexplained share of a class from which the same is asked from the second side's states, too."""
SIDES = ("A", "B")
"""What the two sides are called."""


@dataclass(frozen=True)
class Explanation:
    """What ``simspec explain`` found.

    first, second  the two sides, in words
    same_engine    whether both are the same engine
    same_world     whether both were given the same world
    models         whether each side's engine holds its world, where that was asked
    length         of a window (s); ``counts``: windows of the run by class, ``looked_at``: of which these many, ``hidden``: of
                   which these many do not count, because the first side's own noise hides the gap in them
    gap, floor     by class: mean gap (m) of the windows between the sides, and of the first side with itself, its states moved
                   in the last bits
    contact        the first contact
    causes         what differs between the sides, or from engines' defaults, each by itself; ``caused``: together
    probes         of what is left then: other choices, refinements, removals, each by itself; ``probed``: those that help,
                   together, with shares of what was left
    unexplained    share of the gap, by class, that neither causes nor probes close
    restart        of two engines, of A and B by class (m): how far each is from its own run, where it begins windows in that
                   run's states; what they remember beside their state
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
    caused: Joint
    probes: tuple[Swap, ...]
    probed: Joint
    unexplained: Mapping[str, float]
    restart: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    exchanged: Explanation | None = None
    notes: tuple[str, ...] = ()
    declared: tuple[Declared, ...] = ()

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
    """Where the difference of two sides comes from. ``names``: what they are called; ``most``: windows that are looked at;
    ``proofs``: what is known of each side's model.

    Raises SpecError where they are of different scenes or have no common window, UnsupportedError and EngineError where one of
    the two as they are cannot be asked; a swap that cannot is told as such.
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
        notes = (*explanation.notes, f"not asked from the second side's states: {error}")
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
    """What :func:`explain_sides` gives, from states of the first side."""
    differing = causes(first, second)
    progress("running the first side")
    windows, run = take_windows(first, second, asking, most)
    asked = Gaps(windows, asking)
    progress("asking both sides")
    pair = (first, second)
    gap, noise, contact = asked.begin(pair, run)
    floor = Judge(asked, pair, noise, {}, progress).gap
    judge = Judge(asked, pair, gap, floor, progress)
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
            again = asked.restarted(pair, run)
            restart = {name: judge.means(gap) for name, gap in zip(SIDES, again, strict=True)}
        except EngineError as error:
            notes.append(f"not known whether the engines repeat their own runs from their states: {error}")
    if asked.not_finite:
        notes.append(f"{asked.not_finite} windows are not looked at: a state at their end is not finite")
    windows = asked.windows
    declared: list[Declared] = []
    met: dict[str, float] = dict(caused.gap)
    touching = touching_names(first.world, run)
    if not same and judge.open(met) and (said := recoveries(left, touching)):
        found, rest = _recovered(asked, left, rest, floor, said, run)
        declared, met = found, ({**met, **judge.means(Gap(rest.windows))} if found else met)
    probed, further = Joint((), met, {}), list[Swap]()
    if not same and judge.open(met):
        second_judge = Judge(asked, left, Gap(rest.windows), floor, progress)
        candidates = list(probes(left))
        further = second_judge.each(candidates)
        closing = [both for both in zip(candidates, further, strict=True) if both[0].kind is not Kind.REMOVAL]
        probed, _, _ = second_judge.together([both[0] for both in closing], [both[1] for both in closing])
        declared += located(left, touching, list(zip(candidates, further, strict=True)))
    unexplained = {name: 1.0 - share for name, share in judge.shares({**caused.gap, **probed.gap}).items()}
    return Explanation(
        *names,
        same,
        not differences(first.world, second.world),
        tuple(proofs),
        float(windows.length),
        windows.counts,
        len(windows.numbers),
        int((~asked.quiet).sum()),
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
    )


def _recovered(
    asked: Gaps, pair: Pair, gap: Gap, floor: Mapping[str, float], said: Sequence[tuple[str, str]], run: Answer
) -> tuple[list[Declared], Gap]:
    """The part of a gap that declared laws of recovery account for, and the rest; later gaps are without this part. Nothing
    where they close no share that may be claimed."""
    judge = Judge(asked, pair, Gap(gap.windows), floor, lambda *_: None)
    asked.shift = RecoveryShift(asked.windows, run)
    after = asked.of(pair)
    means, intervals = judge.means(after), judge.intervals(after)
    share = judge.claimed(judge.shares(means), intervals)
    if not share or sum(share.values()) <= 0.0:
        asked.shift = None
        return [], gap
    engines, whats = (" and ".join(dict.fromkeys(words)) for words in zip(*said, strict=True))
    return [Declared(engines, whats, "recovery of overlaps", True, share, intervals)], after


def _in_whole_runs(
    judge: Judge, candidates: Sequence[Candidate], swaps: Sequence[Swap]
) -> tuple[Judge, list[Swap], list[str]]:
    """What acts in no window that is looked at is looked for in whole runs: it may act in others, in states that the first side
    does not come into, or over longer times."""
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
