"""Where the difference of two sides comes from: windows, one swap at a time, what the swaps close together, what is left."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simspec.attribution.candidates import Candidate, Kind, Pair, causes, probes
from simspec.attribution.configuration import Asking, Configuration, Floats, run_operation
from simspec.attribution.contact import FirstContact, contact_questions, first_contact
from simspec.attribution.windows import MOST_WINDOWS, Windows, ends, gaps, ordered_poses, question, take_windows
from simspec.comparison.floor import FLOOR_FACTOR, PERTURBATION
from simspec.engines.kit.process import Answer, side_by_side
from simspec.errors import EngineError, SpecError
from simspec.runner.case import moved_states

RUN = "whole run"
"""The class of what windows do not show: the runs from their own beginnings, at the ends of all windows."""
NEGLIGIBLE = 1e-12
"""m: gaps that are round-off of positions of a few metres in a window's steps, whatever the floor."""
SMALLEST_SHARE = 0.01
"""A smaller share is not claimed."""
ENOUGH = 0.99
"""Share from which nothing more is looked for."""
AT_ONCE = 2
"""Engine processes side by side."""
COLD = Asking()


@dataclass(frozen=True)
class Swap:
    """A candidate and what came of it: by class the gap that is left (m), and the share of the gap that it closes, where that
    may be claimed. ``failed``: why it could not be tried."""

    name: str
    kind: str
    group: str
    values: tuple[str, str]
    gap: Mapping[str, float] = field(default_factory=dict)
    share: Mapping[str, float] = field(default_factory=dict)
    failed: str | None = None

    @property
    def largest(self) -> float:
        """The largest share of any class."""
        return max(self.share.values(), default=0.0)


@dataclass(frozen=True)
class Joint:
    """Swaps made together: their names, the gap that they leave by class (m), and the share that they close."""

    names: tuple[str, ...]
    gap: Mapping[str, float]
    share: Mapping[str, float]


@dataclass(frozen=True)
class Explanation:
    """What ``simspec explain`` found.

    first, second  the two sides, in words
    same_engine    whether both are the same engine
    length         of a window (s); ``counts``: windows of the run by class, ``looked_at``: of which these many, ``hidden``: of
                   which these many do not count, because the first side's own noise hides the gap in them
    gap, floor     by class: mean gap (m) of the windows between the sides, and of the first side with itself, its states moved
                   in the last bits
    contact        the first contact
    causes         what differs between the sides, or from engines' defaults, each by itself; ``caused``: together
    probes         of what is left then: other choices, refinements, removals, each by itself; ``probed``: those that help,
                   together, with shares of what was left
    unexplained    share of the gap, by class, that neither causes nor probes close
    """

    first: str
    second: str
    same_engine: bool
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

    def __repr__(self) -> str:
        return f"<Explanation of {self.first} and {self.second}: {len(self.causes)} differences>"

    @property
    def telling(self) -> tuple[str, ...]:
        """The classes with a gap that is more than round-off."""
        return tuple(name for name in self.gap if self.gap[name] > negligible(self.floor.get(name, 0.0)))


def negligible(floor: float) -> float:
    """The gap (m) up to which nothing is told apart from round-off."""
    return max(FLOOR_FACTOR * floor, NEGLIGIBLE)


class Gaps:
    """The gaps of pairs of configurations, each configuration asked once."""

    def __init__(self, windows: Windows, asking: Asking):
        self._windows, self._asking = windows, asking
        self._ends: dict[tuple[object, ...], Floats] = {}
        self._runs: dict[tuple[object, ...], Floats] = {}
        self.quiet: NDArray[np.bool_] = np.ones(len(windows.numbers), dtype=bool)
        """The windows (k,) whose own noise does not hide the gap of the two sides."""
        self.runs = False
        """Whether whole runs are asked for, too."""

    def begin(self, pair: Pair, run: Answer) -> tuple[dict[str, float], dict[str, float], FirstContact | None]:
        """Of the two sides as they are: by class the mean gap (m) and the first side's noise (m), and the first contact of
        ``run``, the first side's. Windows in which the noise hides the gap do not count, here and later.

        Raises UnsupportedError and EngineError.
        """
        windows = self._windows
        states = moved_states(windows.world, windows.q, windows.v, PERTURBATION, PERTURBATION)
        contact = contact_questions(*pair, run)
        asked = [[question(side, windows), *contact[index : index + 1]] for index, side in enumerate(pair)]
        asked[0].append(question(pair[0], windows, states))
        with side_by_side(AT_ONCE) as pool:
            jobs = [
                pool.submit(self._asking.ask, side, *operations) for side, operations in zip(pair, asked, strict=True)
            ]
            ours, theirs = (job.result() for job in jobs)
        for side, answers in zip(pair, (ours, theirs), strict=True):
            self._ends[side.key] = ends(side, windows, answers[0])
        gap = gaps(windows.world, *(self._ends[side.key] for side in pair))
        noise = gaps(windows.world, self._ends[pair[0].key], ends(pair[0], windows, ours[-1]))
        self.quiet = noise <= np.maximum(NEGLIGIBLE, gap / FLOOR_FACTOR)
        touching = first_contact(pair, [ours[1], theirs[1]]) if contact else None
        return windows.means(gap, self.quiet), windows.means(noise, self.quiet), touching

    def of(self, pair: Pair) -> dict[str, float]:
        """By class the mean gap (m), whatever is accepted or not: a counterfactual is no claim. Raises UnsupportedError,
        SpecError and EngineError."""
        first, second = (side.accepting() for side in pair)
        world = self._windows.world
        found = self._windows.means(gaps(world, self._end(first), self._end(second)), self.quiet)
        if self.runs:
            found[RUN] = float(gaps(world, *self._run(first, second)).mean())
        return found

    def _end(self, side: Configuration) -> Floats:
        if side.key not in self._ends:
            (answer,) = self._asking.ask(side, question(side, self._windows))
            self._ends[side.key] = ends(side, self._windows, answer)
        return self._ends[side.key]

    def _run(self, first: Configuration, second: Configuration) -> tuple[Floats, Floats]:
        poses = [self._whole(side) for side in (first, second)]
        rows = min(map(len, poses))
        return poses[0][:rows], poses[1][:rows]

    def _whole(self, side: Configuration) -> Floats:
        """Poses (rows, bodies, 7) of a run, at the ends of all windows."""
        q, v = side.initial
        key = (*side.key, q.tobytes(), v.tobytes())
        if key not in self._runs:
            steps = self._windows.steps(side.world)
            count = sum(self._windows.counts.values())
            operation = run_operation(side, count * steps, steps)
            (answer,) = self._asking.ask(side, operation)
            if answer.result["failed"] is not None:
                raise EngineError(side.engine, f"the state is not finite after step {answer.result['failed']['step']}")
            self._runs[key] = ordered_poses(side.world, self._windows.world, answer.arrays["pose"])
        return self._runs[key]


def explain_sides(
    first: Configuration,
    second: Configuration,
    names: tuple[str, str],
    *,
    most: int = MOST_WINDOWS,
    asking: Asking = COLD,
    progress: Callable[..., None] = lambda text, share=None: None,
) -> Explanation:
    """Where the difference of two sides comes from. ``names``: what they are called; ``most``: windows that are looked at.

    Raises SpecError where they are of different scenes or have no common window, UnsupportedError and EngineError where one of
    the two as they are cannot be asked; a swap that cannot is told as such.
    """
    differing = causes(first, second)
    progress("running the first side")
    windows, run = take_windows(first, second, asking, most)
    asked = Gaps(windows, asking)
    progress("asking both sides")
    pair = (first, second)
    gap, floor, contact = asked.begin(pair, run)
    in_windows = any(gap[name] > negligible(floor[name]) for name in gap)
    if differing and (not in_windows or any(candidate.whole_run for candidate in differing)):
        asked.runs = True
        gap = asked.of(pair)
        floor[RUN] = 0.0  # not asked for: what is claimed of whole runs is what closes them whole
    judge = _Judge(asked, gap, floor, progress)
    swaps = judge.each(pair, differing)
    caused, left = judge.together(pair, differing, swaps, all_of_them=first.kind is second.kind)
    same = first.kind is second.kind
    probed, further = Joint((), caused.gap, {}), []
    if not same and judge.open(caused.gap):
        second_judge = _Judge(asked, caused.gap, floor, progress)
        candidates = list(probes(left))
        further = second_judge.each(left, candidates)
        probed, _ = second_judge.together(left, [one for one in candidates if one.kind is not Kind.REMOVAL], further)
    unexplained = {name: 1.0 - share for name, share in judge.shares(probed.gap).items()}
    return Explanation(
        *names,
        same,
        float(windows.length),
        windows.counts,
        len(windows.numbers),
        int((~asked.quiet).sum()),
        gap,
        floor,
        contact,
        tuple(swaps),
        caused,
        tuple(further),
        probed,
        unexplained,
    )


class _Judge:
    """What swaps close of a gap."""

    def __init__(
        self, asked: Gaps, gap: Mapping[str, float], floor: Mapping[str, float], progress: Callable[..., None]
    ):
        self._asked, self._gap, self._floor, self._progress = asked, gap, floor, progress

    def shares(self, gap: Mapping[str, float]) -> dict[str, float]:
        """The share that is closed, by class, of the gaps that are more than round-off."""
        return {
            name: 1.0 - gap[name] / whole
            for name, whole in self._gap.items()
            if name in gap and whole > negligible(self._floor[name])
        }

    def open(self, gap: Mapping[str, float]) -> bool:
        """Whether anything worth asking about is left."""
        return any(share < ENOUGH for share in self.shares(gap).values())

    def claimed(self, share: Mapping[str, float]) -> dict[str, float]:
        """The shares that may be claimed: above the smallest one, and above what the floor would make."""
        least = {name: max(SMALLEST_SHARE, FLOOR_FACTOR * self._floor[name] / self._gap[name]) for name in share}
        return {name: value for name, value in share.items() if abs(value) >= least[name]}

    def each(self, pair: Pair, candidates: Sequence[Candidate]) -> list[Swap]:
        """Each candidate by itself, in their order."""
        with side_by_side(AT_ONCE) as pool:
            jobs = [pool.submit(self._one, pair, candidate) for candidate in candidates]
            found: list[Swap] = []
            for job, candidate in zip(jobs, candidates, strict=True):
                self._progress(f"swapping {candidate.name}", len(found) / len(candidates))
                found.append(job.result())
        return found

    def _one(self, pair: Pair, candidate: Candidate) -> Swap:
        facts = candidate.name, candidate.kind.value, candidate.group, candidate.values
        try:
            gap = self._asked.of(candidate.apply(pair))
        except (SpecError, EngineError) as error:
            return Swap(*facts, failed=str(error).splitlines()[0])
        return Swap(*facts, gap, self.claimed(self.shares(gap)))

    def together(
        self, pair: Pair, candidates: Sequence[Candidate], swaps: Iterable[Swap], all_of_them: bool = False
    ) -> tuple[Joint, Pair]:
        """The candidates that close more of the gap when added to those before them, the largest share first; with
        ``all_of_them`` the others after those, where a share is left. And the pair that they leave."""
        ranked = sorted(
            ((swap, candidate) for swap, candidate in zip(swaps, candidates, strict=False) if swap.failed is None),
            key=lambda both: -both[0].largest,
        )
        names: list[str] = []
        about: set[str] = set()
        gap: Mapping[str, float] = self._gap
        waiting = []
        for swap, candidate in ranked:
            if about & set(candidate.about) or (swap.largest <= 0.0 and not all_of_them):
                continue
            if names and not self.open(gap):
                break
            self._progress(f"adding {candidate.name}")
            tried = self._joint(pair, candidate)
            if tried is None or not self._better(gap, tried[1]):
                waiting.append(candidate)
                continue
            pair, gap = tried
            names.append(candidate.name)
            about |= set(candidate.about)
        if all_of_them and self.open(gap):
            # what closes nothing by itself, and only together
            for candidate in waiting:
                tried = self._joint(pair, candidate)
                if tried is not None:
                    pair, gap = tried
                    names.append(candidate.name)
        return Joint(tuple(names), gap, self.shares(gap)), pair

    def _joint(self, pair: Pair, candidate: Candidate) -> tuple[Pair, dict[str, float]] | None:
        try:
            changed = candidate.apply(pair)
            return changed, self._asked.of(changed)
        except (SpecError, EngineError):
            return (
                None  # each by itself it could be tried; together it is left out, and its share stays in what is left
            )

    def _better(self, before: Mapping[str, float], after: Mapping[str, float]) -> bool:
        """Whether a share worth telling is closed in some class, and less is opened in the others."""
        old, new = self.shares(before), self.shares(after)
        steps = self.claimed({name: new[name] - old[name] for name in new if name in old})
        return bool(steps) and sum(steps.values()) > 0.0


def useful(swaps: Iterable[Swap]) -> list[Swap]:
    """The swaps that close a share, the largest first."""
    return sorted((swap for swap in swaps if swap.largest > 0.0), key=lambda swap: -swap.largest)
