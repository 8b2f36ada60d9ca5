"""What swaps close of a gap, each by itself and together; what of that may be claimed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from simspec.attribution.candidates import CAUSES, Candidate, Kind, Pair
from simspec.attribution.intervals import Draws, Interval, above
from simspec.attribution.measure import AT_ONCE, RUN, Gap, Gaps, negligible
from simspec.comparison.floor import FLOOR_FACTOR
from simspec.engines.kit.process import side_by_side
from simspec.errors import EngineError, SpecError

SMALLEST_SHARE = 0.01
"""A smaller share is not claimed."""
SMALLEST_EFFECT = 1e-6
"""What moves a side by less than this part of the gap is not said to act. So small, since the engines' own differences may be
thousands of times what a setting does; above it, and above the noise, a side with another value does move otherwise."""
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
class Joint:
    """Swaps made together: their names, the gap that they leave by class (m), and the share that they close, with intervals."""

    names: tuple[str, ...]
    gap: Mapping[str, float]
    share: Mapping[str, float]
    interval: Mapping[str, Interval] = field(default_factory=dict)


class Judge:
    """What swaps close of the gap of a pair. ``floor``: by class the noise (m)."""

    def __init__(self, asked: Gaps, pair: Pair, gap: Gap, floor: Mapping[str, float], progress: Callable[..., None]):
        self._asked, self._pair, self._whole, self._floor, self._progress = asked, pair, gap, floor, progress
        self._runs = gap.run is not None
        self._draws = Draws(asked.windows, asked.quiet)
        self.gap = self.means(gap)

    def means(self, gap: Gap) -> dict[str, float]:
        """By class the mean gap (m)."""
        means = {
            name: float(value) for name, value in self._asked.windows.means(gap.of_windows, self._asked.quiet).items()
        }
        return means if gap.run is None else {**means, RUN: float(gap.run.sum())}

    def with_runs(self) -> Judge:
        """The same, of whole runs, too. Raises EngineError."""
        gap = self._asked.of(self._pair, runs=True)
        return Judge(self._asked, self._pair, gap, self._floor, self._progress)

    @property
    def telling(self) -> tuple[str, ...]:
        """The classes with a gap that is more than round-off."""
        return tuple(name for name, whole in self.gap.items() if whole > negligible(self._floor.get(name, 0.0)))

    def shares(self, gap: Mapping[str, float]) -> dict[str, float]:
        """The share that is closed, by class, of the gaps that are more than round-off."""
        return {name: 1.0 - gap[name] / self.gap[name] for name in self.telling if name in gap}

    def intervals(self, gap: Gap) -> dict[str, Interval]:
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
            jobs = [pool.submit(self._one, candidate) for candidate in candidates]
            swaps: list[Swap] = []
            for job, candidate in zip(jobs, candidates, strict=True):
                self._progress(f"swapping {candidate.name}", len(swaps) / len(candidates))
                swaps.append(job.result())
        return swaps

    def _one(self, candidate: Candidate) -> Swap:
        facts = candidate.name, candidate.kind.value, candidate.group, candidate.values
        try:
            changed = candidate.apply(self._pair)
            gap = self._asked.of(changed, self._runs)
            moved = self._asked.moved(self._pair, changed, self._runs) if candidate.kind in CAUSES else None
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

    def _effect(self, moved: Gap) -> dict[str, float]:
        parts = {name: value / self.gap[name] for name, value in self.means(moved).items() if name in self.telling}
        return {name: part for name, part in parts.items() if part >= self._least(name, SMALLEST_EFFECT)}

    def together(self, candidates: Sequence[Candidate], swaps: Iterable[Swap]) -> tuple[Joint, Pair, Gap]:
        """All differences of the two sides' values, and of the other candidates those that close more of the gap when added to
        those before them, the largest share first. And the pair that they leave, with its gap."""
        tried = [(swap, candidate) for swap, candidate in zip(swaps, candidates, strict=True) if swap.failed is None]
        tried.sort(key=lambda both: (both[1].kind is not Kind.DIFFERENCE, -both[0].largest))
        pair, gap, names, about = self._pair, self._whole, list[str](), set[str]()
        for swap, candidate in tried:
            given = candidate.kind is Kind.DIFFERENCE
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
        return Joint(tuple(names), means, self.shares(means), self.intervals(gap) if names else {}), pair, gap

    def _joint(self, pair: Pair, candidate: Candidate) -> tuple[Pair, Gap] | None:
        """The pair with one more change, and its gap; None where that is not possible: each by itself could be tried, and the
        share of this one stays in what is left."""
        try:
            changed = candidate.apply(pair)
            return changed, self._asked.of(changed, self._runs)
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
        found, key=lambda swap: (swap.kind != Kind.DIFFERENCE.value, -swap.largest, -max(swap.effect.values()))
    )
