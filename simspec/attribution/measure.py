"""What is measured of pairs of configurations: the gap at the ends of windows, of whole runs, and what a change moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.attribution.candidates import Pair
from simspec.attribution.configuration import Asking, Configuration, Floats, run_operation, windows_operation
from simspec.attribution.contact import FirstContact, contact_questions, first_contact
from simspec.attribution.windows import Windows, ends, gaps, ordered_poses, poses_at_ends, question
from simspec.comparison.floor import FLOOR_FACTOR, perturbation_of
from simspec.engines.kit.process import Answer, side_by_side
from simspec.errors import EngineError
from simspec.runner.case import moved_states

RUN = "whole run"
"""The class of what windows do not show: the runs from their own beginnings, at the ends of all windows."""
NEGLIGIBLE = 1e-12
"""m: gaps that are round-off of positions of a few metres in a window's steps, whatever the floor."""
AT_ONCE = 2
"""Engine processes side by side."""


def negligible(floor: float) -> float:
    """The gap (m) up to which nothing is told apart from round-off."""
    return max(FLOOR_FACTOR * floor, NEGLIGIBLE)


@dataclass(frozen=True)
class Gap:
    """A gap (m): of each window and body (k, bodies), and the mean of whole runs (rows) by body (bodies); None where that was
    not asked for."""

    windows: Floats
    run: Floats | None = None

    @property
    def of_windows(self) -> Floats:
        """Of each window (k,): the sum over the bodies."""
        total: Floats = self.windows.sum(axis=-1)
        return total


class Gaps:
    """The gaps of pairs of configurations, each configuration asked once."""

    def __init__(self, windows: Windows, asking: Asking):
        self.windows, self._asking = windows, asking
        self._ends: dict[tuple[object, ...], Floats] = {}
        self._runs: dict[tuple[object, ...], Floats] = {}
        self.quiet: NDArray[np.bool_] = np.ones(len(windows.numbers), dtype=bool)
        """The windows (k,) whose own noise does not hide the gap of the two sides."""
        self.shift: Callable[[Pair], Floats] | None = None
        """By how much (k, bodies, 3) the second side's ends are moved, since declared laws say so; see ``declared.py``."""
        self.not_finite = 0
        """Windows that are not looked at, since a state at their end is not finite."""

    def begin(self, pair: Pair, run: Answer) -> tuple[Gap, Gap, FirstContact | None]:
        """Of the two sides as they are: the gap, the first side's noise, and the first contact of ``run``, the first side's.
        Windows in which the noise hides the gap do not count, here and later.

        Raises UnsupportedError and EngineError.
        """
        windows = self.windows
        moved_by = perturbation_of(pair[0].engine)
        states = moved_states(windows.world, windows.q, windows.v, moved_by, moved_by)
        contact = contact_questions(*pair, run)
        asked = [[question(side, windows), *contact[index : index + 1]] for index, side in enumerate(pair)]
        asked[0].append(question(pair[0], windows, states))
        with side_by_side(AT_ONCE) as pool:
            jobs = [
                pool.submit(self._asking.ask, side, *operations) for side, operations in zip(pair, asked, strict=True)
            ]
            ours, theirs = (job.result() for job in jobs)
        poses = [poses_at_ends(side, windows, answers[0]) for side, answers in zip(pair, (ours, theirs), strict=True)]
        moved = poses_at_ends(pair[0], windows, ours[-1])
        here, there, moved = self._finite(pair, [*poses, moved])
        self._ends = {pair[0].key: here, pair[1].key: there}
        gap = Gap(gaps(windows.world, here, there))
        noise = Gap(gaps(windows.world, here, moved))
        self.quiet = noise.of_windows <= np.maximum(NEGLIGIBLE, gap.of_windows / FLOOR_FACTOR)
        return gap, noise, first_contact(pair, [ours[1], theirs[1]]) if contact else None

    def _finite(self, pair: Pair, poses: list[Floats]) -> list[Floats]:
        """The poses (k, bodies, 7) of the first side, of the second, and of the first moved, without the windows at whose end
        one of them is not finite; these are not looked at. Raises EngineError where none is left."""
        finite = [np.isfinite(pose).all(axis=(1, 2)) for pose in poses]
        kept = np.logical_and.reduce(finite)
        if not kept.any():
            side = pair[0] if not finite[0].any() else pair[1]
            raise EngineError(side.engine, "the state is not finite at the end of any window")
        self.not_finite = int((~kept).sum())
        self.windows = self.windows.only(kept)
        return [pose[kept] for pose in poses]

    def restarted(self, pair: Pair, run: Answer) -> tuple[Gap, Gap]:
        """How far each side is from its own run where it begins windows in that run's states: nothing, where the state is all
        that an engine has; more, where it remembers contact points of earlier steps, say. ``run``: the first side's. Raises
        EngineError."""
        first, second = pair
        windows = self.windows
        rows = [windows.rows(run, number) for number in (windows.numbers, windows.numbers + 1)]
        ours = gaps(windows.world, self._ends[first.key], run.arrays["pose"][rows[1]])
        steps = windows.steps(second.world)
        (own,) = self._asking.ask(second, run_operation(second, int(windows.numbers.max() + 1) * steps, steps))
        if own.result["failed"] is not None:
            raise EngineError(second.engine, f"the state is not finite after step {own.result['failed']['step']}")
        states = own.arrays["q"][windows.numbers], own.arrays["v"][windows.numbers]
        earlier = np.maximum(windows.numbers - 1, 0)
        before = own.arrays["q"][earlier], own.arrays["v"][earlier]
        again = windows_operation(second, *states, (windows.numbers * steps).tolist(), steps, before=before)
        (answer,) = self._asking.ask(second, again)
        there = ends(second, windows, answer)
        here = ordered_poses(second.world, windows.world, own.arrays["pose"][windows.numbers + 1])
        return Gap(ours), Gap(gaps(windows.world, there, here))

    def of(self, pair: Pair, runs: bool = False) -> Gap:
        """The gap of a pair, whatever is accepted or not: a counterfactual is no claim. ``runs``: of whole runs, too. Raises
        UnsupportedError, SpecError and EngineError."""
        first, second = (side.accepting() for side in pair)
        return self._between(first, second, runs, None if self.shift is None else self.shift((first, second)))

    def moved(self, before: Pair, after: Pair, runs: bool = False) -> Gap:
        """How far a change moves the sides: the gap between each side before and after it, the sum of both sides'."""
        parts = [
            self._between(one.accepting(), other.accepting(), runs) for one, other in zip(before, after, strict=True)
        ]
        run = None if parts[0].run is None or parts[1].run is None else parts[0].run + parts[1].run
        return Gap(parts[0].windows + parts[1].windows, run)

    def _between(self, first: Configuration, second: Configuration, runs: bool, shift: Floats | None = None) -> Gap:
        world = self.windows.world
        theirs = self._end(second)
        if shift is not None:
            theirs = theirs.copy()
            theirs[..., :3] += shift
        found = gaps(world, self._end(first), theirs)
        if not runs:
            return Gap(found)
        poses = [self._whole(side) for side in (first, second)]
        rows = min(map(len, poses))
        return Gap(found, gaps(world, poses[0][:rows], poses[1][:rows]).mean(axis=0))

    def _end(self, side: Configuration) -> Floats:
        if side.key not in self._ends:
            (answer,) = self._asking.ask(side, question(side, self.windows))
            self._ends[side.key] = ends(side, self.windows, answer)
        return self._ends[side.key]

    def _whole(self, side: Configuration) -> Floats:
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
