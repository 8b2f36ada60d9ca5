"""Swaps: measured in windows, and judged by the share of the gap that they close."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simspec.attribution.candidates import CAUSES, Candidate, CandidateKind, Pair
from simspec.attribution.configuration import Asking, Configuration, run_operation, windows_operation
from simspec.attribution.configuration import Floats as ConfigurationFloats
from simspec.attribution.windows import (
    ALL,
    CLASSES,
    FirstContact,
    Windows,
    contact_questions,
    ends,
    first_contact,
    gaps,
    ordered_poses,
    poses_at_ends,
    question,
)
from simspec.comparison.floor import FLOOR_FACTOR, perturbation_of
from simspec.engines.kit.process import Answer, side_by_side
from simspec.errors import EngineError, SpecError
from simspec.runner.run import moved_states

# Gaps at the ends of windows and of whole runs, and the effect of a change on them.

RUN = "whole run"
"""The class of what windows do not show: the runs from their own beginnings, at the ends of all windows."""
NEGLIGIBLE = 1e-12
"""m: gaps that are round-off of positions of a few metres in a window's steps, whatever the floor."""
AT_ONCE = 2
"""Engine processes side by side."""


def negligible(floor: float) -> float:
    """The gap (m) up to which differences are indistinguishable from round-off."""
    return max(FLOOR_FACTOR * floor, NEGLIGIBLE)


@dataclass(frozen=True)
class BodyGap:
    """A gap (m): of each window and body (k, bodies), and the mean of whole runs (rows) by body (bodies); None where that was
    not requested."""

    windows: ConfigurationFloats
    run: ConfigurationFloats | None = None

    @property
    def of_windows(self) -> ConfigurationFloats:
        """Of each window (k,): the sum over the bodies."""
        total: ConfigurationFloats = self.windows.sum(axis=-1)
        return total


class Gaps:
    """The gaps of pairs of configurations, each configuration evaluated once."""

    def __init__(self, windows: Windows, asking: Asking):
        self.windows, self._asking = windows, asking
        self._ends: dict[tuple[object, ...], ConfigurationFloats] = {}
        self._runs: dict[tuple[object, ...], ConfigurationFloats] = {}
        self.quiet: NDArray[np.bool_] = np.ones(len(windows.numbers), dtype=bool)
        """The windows (k,) in which noise does not hide the gap of the two sides."""
        self.shift: Callable[[Pair], ConfigurationFloats] | None = None
        """By how much (k, bodies, 3) the second side's ends are moved, since declared laws say so; see ``declared.py``."""
        self.not_finite = 0
        """Windows that are not looked at, since a state at their end is not finite."""

    def begin(self, pair: Pair, run: Answer) -> tuple[BodyGap, BodyGap, FirstContact | None]:
        """Of the two sides as they are: the gap, the noise, and the first contact of ``run``, the first side's. The noise is
        that of the first side, or of a second side of lower precision, where it is larger: such a side moves by round-off as
        soon as it is given a state of the first. Windows in which the noise hides the gap do not count, here and later.

        Raises UnsupportedError and EngineError.
        """
        windows = self.windows
        moved_by = [perturbation_of(side.engine) for side in pair]
        noisy = [0, 1] if moved_by[1] > moved_by[0] else [0]
        contact = contact_questions(*pair, run)
        questions = [[question(side, windows), *contact[index : index + 1]] for index, side in enumerate(pair)]
        for index in noisy:
            states = moved_states(windows.world, windows.q, windows.v, moved_by[index], moved_by[index])
            questions[index].append(question(pair[index], windows, states))
        with side_by_side(AT_ONCE) as pool:
            jobs = [
                pool.submit(self._asking.ask, side, *operations)
                for side, operations in zip(pair, questions, strict=True)
            ]
            answers = [job.result() for job in jobs]
        poses = [poses_at_ends(side, windows, answer[0]) for side, answer in zip(pair, answers, strict=True)]
        poses += [poses_at_ends(pair[index], windows, answers[index][-1]) for index in noisy]
        poses = self._finite(pair, poses)
        here, there = poses[:2]
        self._ends = {pair[0].key: here, pair[1].key: there}
        gap = BodyGap(gaps(windows.world, here, there))
        moved = [gaps(windows.world, poses[index], poses[2 + place]) for place, index in enumerate(noisy)]
        noise = BodyGap(np.maximum.reduce(moved))
        self.quiet = noise.of_windows <= np.maximum(NEGLIGIBLE, gap.of_windows / FLOOR_FACTOR)
        return gap, noise, first_contact(pair, [answer[1] for answer in answers]) if contact else None

    def _finite(self, pair: Pair, poses: list[ConfigurationFloats]) -> list[ConfigurationFloats]:
        """The poses (k, bodies, 7) of the first side, of the second, and of sides moved, without the windows at whose end one
        of them is not finite; these are not looked at. Raises EngineError where none is left."""
        finite = [np.isfinite(pose).all(axis=(1, 2)) for pose in poses]
        kept = np.logical_and.reduce(finite)
        if not kept.any():
            side = pair[0] if not finite[0].any() else pair[1]
            raise EngineError(side.engine, "the state is not finite at the end of any window")
        self.not_finite = int((~kept).sum())
        self.windows = self.windows.only(kept)
        return [pose[kept] for pose in poses]

    def restarted(self, pair: Pair, run: Answer) -> tuple[BodyGap, BodyGap]:
        """How far each side is from its own run where it begins windows in that run's states: nothing, where the state is all
        that an engine has; more, where it remembers contact points of earlier steps, say. ``run``: the first side's. Raises
        EngineError."""
        first, second = pair
        windows = self.windows
        rows = [windows.rows(run, number) for number in (windows.numbers, windows.numbers + 1)]
        ours = gaps(windows.world, self._ends[first.key], run.arrays["pose"][rows[1]])
        steps = windows.steps(second.world)
        (course,) = self._asking.ask(second, run_operation(second, int(windows.numbers.max() + 1) * steps, steps))
        if course.result["failed"] is not None:
            raise EngineError(second.engine, f"the state is not finite after step {course.result['failed']['step']}")
        states = course.arrays["q"][windows.numbers], course.arrays["v"][windows.numbers]
        earlier = np.maximum(windows.numbers - 1, 0)
        before = course.arrays["q"][earlier], course.arrays["v"][earlier]
        again = windows_operation(second, *states, (windows.numbers * steps).tolist(), steps, before=before)
        (answer,) = self._asking.ask(second, again)
        there = ends(second, windows, answer)
        here = ordered_poses(second.world, windows.world, course.arrays["pose"][windows.numbers + 1])
        return BodyGap(ours), BodyGap(gaps(windows.world, there, here))

    def of(self, pair: Pair, runs: bool = False) -> BodyGap:
        """The gap of a pair, whatever is accepted or not: a counterfactual is no claim. ``runs``: of whole runs, too. Raises
        UnsupportedError, SpecError and EngineError."""
        first, second = (side.accepting() for side in pair)
        return self._between(first, second, runs, None if self.shift is None else self.shift((first, second)))

    def moved(self, before: Pair, after: Pair, runs: bool = False) -> BodyGap:
        """How far a change moves the sides: the gap between each side before and after it, the sum of both sides'."""
        parts = [
            self._between(configuration.accepting(), other.accepting(), runs)
            for configuration, other in zip(before, after, strict=True)
        ]
        run = None if parts[0].run is None or parts[1].run is None else parts[0].run + parts[1].run
        return BodyGap(parts[0].windows + parts[1].windows, run)

    def _between(
        self, first: Configuration, second: Configuration, runs: bool, shift: ConfigurationFloats | None = None
    ) -> BodyGap:
        world = self.windows.world
        theirs = self._end(second)
        if shift is not None:
            theirs = theirs.copy()
            theirs[..., :3] += shift
        found = gaps(world, self._end(first), theirs)
        if not runs:
            return BodyGap(found)
        poses = [self._whole(side) for side in (first, second)]
        rows = min(map(len, poses))
        return BodyGap(found, gaps(world, poses[0][:rows], poses[1][:rows]).mean(axis=0))

    def _end(self, side: Configuration) -> ConfigurationFloats:
        if side.key not in self._ends:
            (answer,) = self._asking.ask(side, question(side, self.windows))
            self._ends[side.key] = ends(side, self.windows, answer)
        return self._ends[side.key]

    def _whole(self, side: Configuration) -> ConfigurationFloats:
        """Poses (rows, bodies, 7) of a run, at the ends of all windows."""
        q, v = side.initial
        key = (*side.key, q.tobytes(), v.tobytes())
        if key not in self._runs:
            steps = self.windows.steps(side.world)
            count = sum(self.windows.counts.values())
            operation = run_operation(side, count * steps, steps)
            (answer,) = self._asking.ask(side, operation)
            if answer.result["failed"] is not None:
                raise EngineError(side.engine, f"the state is not finite after step {answer.result['failed']['step']}")
            self._runs[key] = ordered_poses(side.world, self.windows.world, answer.arrays["pose"])
        return self._runs[key]


# Intervals of shares. Windows are drawn again with replacement, class by class, in blocks of neighbours, since
# neighbouring windows are alike; a share is computed from each draw. The generator's seed is fixed.

Floats = NDArray[np.float64]
DRAWS = 400
"""Draws of an interval: the limits of 95 % then stand on ten draws at each end."""
LIMITS = (0.025, 0.975)
"""Quantiles of the draws that an interval lies between: 95 % of them are inside."""
SEED = 12
FEWEST = 4
"""Windows of a class below which nothing is drawn: their share has no interval."""
Interval = tuple[float, float]


class Draws:
    """Weights of windows in draws with replacement, by class: (DRAWS, k), rows that sum to one."""

    def __init__(self, windows: Windows, counting: NDArray[np.bool_]):
        generator = np.random.default_rng(SEED)
        self._weights: dict[str, Floats] = {}
        shares, totals = windows.weights(counting), np.zeros((DRAWS, len(counting)))
        drawn = True
        for index, name in enumerate(CLASSES):
            places = np.flatnonzero((windows.kinds == index) & windows.counted(counting))
            if not len(places):
                continue
            weights = np.zeros((DRAWS, len(counting)))
            np.add.at(weights, (np.arange(DRAWS)[:, None], places[_blocks(generator, len(places))]), 1.0 / len(places))
            if len(places) >= FEWEST:
                self._weights[name] = weights
            else:
                drawn = False
            totals += shares[name] * weights
        if drawn:
            self._weights[ALL] = totals

    def share(self, gap: Floats, whole: Floats) -> dict[str, Interval]:
        """By class the interval of 1 − mean(gap)/mean(whole), of gaps (k,) of the same windows."""
        intervals = {}
        for name, weights in self._weights.items():
            means = weights @ whole
            if (means > 0.0).all():
                low, high = np.quantile(1.0 - (weights @ gap) / means, LIMITS)
                intervals[name] = (float(low), float(high))
        return intervals


def _blocks(generator: np.random.Generator, count: int) -> NDArray[np.int64]:
    """Indices (DRAWS, count) of ``count`` things: blocks of neighbours that begin anywhere, the last continued by the first."""
    size = max(1, round(count ** (1.0 / 3.0)))
    number = -(-count // size)
    begins = generator.integers(0, count, size=(DRAWS, number, 1))
    return ((begins + np.arange(size)) % count).reshape(DRAWS, -1)[:, :count].astype(np.int64)


def above(interval: Interval | None) -> bool:
    """Whether a share with this interval may be claimed: all of it is on one side of zero. Without an interval it may."""
    return interval is None or interval[0] > 0.0 or interval[1] < 0.0


# Judgement: the share of a gap that swaps close, each by itself and together.

SMALLEST_SHARE = 0.01
"""A smaller share is not claimed."""
SMALLEST_EFFECT = 1e-6
"""A swap that moves a side by less than this part of the gap does not count as acting. So small, since the engines' own
differences may be thousands of times what a setting does; above it, and above the noise, a side with another value does move
otherwise."""
ENOUGH = 0.99
"""Share from which nothing more is looked for."""


@dataclass(frozen=True)
class Swap:
    """A candidate and what came of it, by class.

    gap       what is left (m)
    share     of the gap that it closes, where that may be claimed; ``interval``: where it lies, with other windows of the run
    effect    how far the swap moves the sides themselves, as a part of the gap, where that is more than their noise
    failed    why it could not be tried
    """

    name: str
    kind: str
    group: str
    values: tuple[str, str]
    gap: Mapping[str, float] = field(default_factory=dict)
    share: Mapping[str, float] = field(default_factory=dict)
    interval: Mapping[str, Interval] = field(default_factory=dict)
    effect: Mapping[str, float] = field(default_factory=dict)
    failed: str | None = None

    @property
    def largest(self) -> float:
        """The largest share of any class."""
        return max(self.share.values(), default=0.0)

    @property
    def acts(self) -> bool:
        """Whether it moves anything."""
        return bool(self.effect)


@dataclass(frozen=True)
class CombinedSwap:
    """Swaps made together: their names, the gap that they leave by class (m), and the share that they close, with intervals."""

    names: tuple[str, ...]
    gap: Mapping[str, float]
    share: Mapping[str, float]
    interval: Mapping[str, Interval] = field(default_factory=dict)


class Judge:
    """Shares of a pair's gap that swaps close. ``floor``: by class the noise (m)."""

    def __init__(self, gaps: Gaps, pair: Pair, gap: BodyGap, floor: Mapping[str, float], progress: Callable[..., None]):
        self._gaps, self._pair, self._whole, self._floor, self._progress = gaps, pair, gap, floor, progress
        self._runs = gap.run is not None
        self._draws = Draws(gaps.windows, gaps.quiet)
        self.gap = self.means(gap)

    def means(self, gap: BodyGap) -> dict[str, float]:
        """By class the mean gap (m)."""
        means = {
            name: float(value) for name, value in self._gaps.windows.means(gap.of_windows, self._gaps.quiet).items()
        }
        return means if gap.run is None else {**means, RUN: float(gap.run.sum())}

    def with_runs(self) -> Judge:
        """The same, of whole runs, too. Raises EngineError."""
        gap = self._gaps.of(self._pair, runs=True)
        return Judge(self._gaps, self._pair, gap, self._floor, self._progress)

    @property
    def telling(self) -> tuple[str, ...]:
        """The classes with a gap that is more than round-off."""
        return tuple(name for name, whole in self.gap.items() if whole > negligible(self._floor.get(name, 0.0)))

    def shares(self, gap: Mapping[str, float]) -> dict[str, float]:
        """The share that is closed, by class, of the gaps that are more than round-off."""
        return {name: 1.0 - gap[name] / self.gap[name] for name in self.telling if name in gap}

    def intervals(self, gap: BodyGap) -> dict[str, Interval]:
        """Where these shares lie, with other windows."""
        intervals = self._draws.share(gap.of_windows, self._whole.of_windows)
        return {name: intervals[name] for name in self.telling if name in intervals}

    def open(self, gap: Mapping[str, float]) -> bool:
        """Whether anything worth asking about is left."""
        return any(share < ENOUGH for share in self.shares(gap).values())

    def claimed(self, share: Mapping[str, float], intervals: Mapping[str, Interval] | None = None) -> dict[str, float]:
        """The shares that may be claimed: above the smallest one, above what the floor would make, and of one sign whatever
        windows the run has."""
        intervals = intervals or {}
        return {
            name: value
            for name, value in share.items()
            if abs(value) >= self._least(name, SMALLEST_SHARE) and above(intervals.get(name))
        }

    def _least(self, name: str, smallest: float) -> float:
        return max(smallest, FLOOR_FACTOR * self._floor.get(name, 0.0) / self.gap[name])

    def each(self, candidates: Sequence[Candidate]) -> list[Swap]:
        """Each candidate by itself, in their order."""
        with side_by_side(AT_ONCE) as pool:
            jobs = [pool.submit(self._evaluate, candidate) for candidate in candidates]
            swaps: list[Swap] = []
            for job, candidate in zip(jobs, candidates, strict=True):
                self._progress(f"swapping {candidate.name}", len(swaps) / len(candidates))
                swaps.append(job.result())
        return swaps

    def _evaluate(self, candidate: Candidate) -> Swap:
        facts = candidate.name, candidate.kind.value, candidate.group, candidate.values
        try:
            changed = candidate.apply(self._pair)
            gap = self._gaps.of(changed, self._runs)
            moved = self._gaps.moved(self._pair, changed, self._runs) if candidate.kind in CAUSES else None
        except (SpecError, EngineError) as error:
            return Swap(*facts, failed=str(error).splitlines()[0])
        left, intervals = self.means(gap), self.intervals(gap)
        return Swap(
            *facts,
            left,
            self.claimed(self.shares(left), intervals),
            intervals,
            {} if moved is None else self._effect(moved),
        )

    def _effect(self, moved: BodyGap) -> dict[str, float]:
        parts = {name: value / self.gap[name] for name, value in self.means(moved).items() if name in self.telling}
        return {name: part for name, part in parts.items() if part >= self._least(name, SMALLEST_EFFECT)}

    def together(self, candidates: Sequence[Candidate], swaps: Iterable[Swap]) -> tuple[CombinedSwap, Pair, BodyGap]:
        """All differences of the two sides' values, and of the other candidates those that close more of the gap when added to
        those before them, the largest share first. And the pair that they leave, with its gap."""
        tried = [(swap, candidate) for swap, candidate in zip(swaps, candidates, strict=True) if swap.failed is None]
        tried.sort(key=lambda both: (both[1].kind is not CandidateKind.DIFFERENCE, -both[0].largest))
        pair, gap, names, about = self._pair, self._whole, list[str](), set[str]()
        for swap, candidate in tried:
            given = candidate.kind is CandidateKind.DIFFERENCE
            if about & set(candidate.about) or not (given or (swap.largest > 0.0 and self.open(self.means(gap)))):
                continue
            self._progress(f"adding {candidate.name}")
            joint = self._joint(pair, candidate)
            if joint is None or not (given or self._better(self.means(gap), self.means(joint[1]))):
                continue
            pair, gap = joint
            names.append(candidate.name)
            about |= set(candidate.about)
        means = self.means(gap)
        return CombinedSwap(tuple(names), means, self.shares(means), self.intervals(gap) if names else {}), pair, gap

    def _joint(self, pair: Pair, candidate: Candidate) -> tuple[Pair, BodyGap] | None:
        """The pair with one more change, and its gap; None where that is not possible: each by itself could be tried, and the
        share of this one stays in what is left."""
        try:
            changed = candidate.apply(pair)
            return changed, self._gaps.of(changed, self._runs)
        except (SpecError, EngineError):
            return None

    def _better(self, before: Mapping[str, float], after: Mapping[str, float]) -> bool:
        """Whether a share worth telling is closed in some class, and less is opened in the others."""
        old, new = self.shares(before), self.shares(after)
        steps = self.claimed({name: new[name] - old[name] for name in new if name in old})
        return bool(steps) and sum(steps.values()) > 0.0


def useful(swaps: Iterable[Swap]) -> list[Swap]:
    """The swaps that close a share, the largest first."""
    return sorted((swap for swap in swaps if swap.largest > 0.0), key=lambda swap: -swap.largest)


def acting(swaps: Iterable[Swap]) -> list[Swap]:
    """The causes that move a side: first the values that the two sides were given differently, then settings away from their
    defaults; of each the largest share first, then the largest effect."""
    found = [swap for swap in swaps if swap.acts or swap.largest > 0.0]
    return sorted(
        found, key=lambda swap: (swap.kind != CandidateKind.DIFFERENCE.value, -swap.largest, -max(swap.effect.values()))
    )
