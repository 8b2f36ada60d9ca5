"""One check of a proof: what was held against what, how often, how closely, and where it was worst."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from simspec.engines.kit.capabilities import DOUBLE, ROUNDING, SINGLE
from simspec.engines.kit.process import Operation
from simspec.world.types import World

TEXT_TOLERANCE = 1e-12
"""L0: numbers are printed to round-trip; left is the way from a tensor to principal axes and back, whose largest moment may
be clipped by 2⁻⁴⁰ ≈ 9e-13 (``world/inertia.py``), and frames composed and undone (a few last bits)."""
MODEL_TOLERANCE = 1e-9
"""L1 to L4: engines keep doubles, but diagonalise inertias, shift frames and invert matrices; all stay below 1e-10 when they
are told the same model (measured), while the smallest real error of a model, a digit lost in printing, is 1e-7."""


TOO_CHAOTIC = "its contact-free motion is too chaotic"
"""How the reason begins for which a motion is there and not compared; it stands in the verdict."""
NOTHING = "nothing was compared"
"""Name of the failed check that stands for a level, or a part of one, that the world has and nobody compared."""


@dataclass(frozen=True, slots=True)
class Check:
    """``worst`` is the largest deviation, in units of the quantity's own scale; None when something differs in kind (a
    joint's type, a missing body), which no number can say. ``where`` is its place, ``detail`` what was found there.

    The verdict follows from these figures and is not stored: see :attr:`passed`. Raises ValueError for figures that are none
    (a negative count, a deviation or tolerance below zero or not finite, a deviation of nothing).
    """

    level: str
    name: str
    count: int
    tolerance: float
    worst: float | None
    where: str
    detail: str = ""

    def __post_init__(self) -> None:
        numbers = [self.tolerance] if self.worst is None else [self.tolerance, self.worst]
        if self.count < 0 or not all(math.isfinite(number) and number >= 0.0 for number in numbers):
            raise ValueError(f"{self.level} {self.name}: count {self.count}, worst {self.worst} of {self.tolerance}")
        if not self.count and self.worst is not None:
            raise ValueError(f"{self.level} {self.name}: a deviation of {self.worst}, and nothing compared")

    @property
    def passed(self) -> bool:
        """Whether something was compared, and all of it is within the tolerance."""
        return self.count > 0 and self.worst is not None and self.worst <= self.tolerance


class Tally:
    """Collects deviations into one check for each (level, name)."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, str], tuple[int, float, float | None, str, str]] = {}

    def add(
        self, level: str, name: str, tolerance: float, deviation: float | None, where: str, detail: str = ""
    ) -> None:
        """Note one deviation; None (or NaN) = different in kind, worse than any number."""
        if deviation is not None and not math.isfinite(deviation):
            deviation, detail = None, detail or f"deviation is {deviation}"
        count, _, worst, place, explained = self._rows.get((level, name), (0, tolerance, 0.0, "", ""))
        if worst is not None and (deviation is None or deviation > worst or not count):
            worst, place, explained = deviation, where, detail
        self._rows[level, name] = (count + 1, tolerance, worst, place, explained)

    def equal(self, level: str, name: str, expected: object, actual: object, where: str) -> bool:
        """Note whether two things are the same."""
        same = expected == actual
        self.add(level, name, 0.0, 0.0 if same else None, where, "" if same else f"{actual}, should be {expected}")
        return same

    def checks(self) -> list[Check]:
        """The checks, in the order in which they were first noted within their levels."""
        return [
            Check(level, name, count, tolerance, worst, where, detail)
            for (level, name), (count, tolerance, worst, where, detail) in sorted(
                self._rows.items(), key=lambda item: item[0][0]
            )
        ]


Part = tuple[str, str]
"""Level, and name of a check ("" any)."""


@dataclass(frozen=True, slots=True)
class Demand:
    """What a proof must have compared: ``count`` times, ``least`` at least, within ``tolerance`` at most."""

    count: int
    least: int
    tolerance: float


Demands = dict[Part, Demand]


class Plan(Protocol):
    """A motion that engines repeat, and what must come of it."""

    def operation(self, world: World) -> Operation | None:
        """The operation that an engine is asked for; None where nothing can be compared."""

    def demands(self) -> Demands:
        """What a proof must have compared."""

    def checks(self, world: World, answer: Mapping[str, np.ndarray], creep: float = 0.0) -> list[Check]:
        """The answer against the plan; ``creep``: the speed (m/s, rad/s) that the engine's solver is declared to leave joints
        that dry friction holds (``Engine.DRY_FRICTION_CREEP``)."""


LEEWAY = 4.0
"""How much larger than planned a round-off floor may be when a stored proof is judged: the floor is the worst of four disturbed
runs, and another machine's last bits give another worst."""


def failed(level: str, name: str, detail: str) -> Check:
    """A check that could not be made at all, and so has failed."""
    return Check(level, name, 0, 0.0, None, "", detail)


# What a proof demands of an engine by the numbers that it computes with (``Engine.PRECISION``), never by the engine.
#
# What is read back is as near as numbers of that length are. Motion is as near as a world's own floor: the oracle run again,
# disturbed as such numbers disturb it. Of doubles the beginning alone is, by the last bits, and the tolerance is 100 times
# what that makes. In single precision each step's rounding counts, so that the oracle's state is rounded after every step:
# what an engine does beside it (its rotations, its sums) is then a few times that floor and not a hundred. Of 14 free bodies
# with random tensors that turn at 0.5 and 2.8 rad/s for 2,000 steps of 1 ms, an engine of single precision was off by 0.9 to
# 3.5 times the floor (measured), which is 4e-6 to 2e-5.

OF_LOOPS = 10.0
"""Rows of constraints that close loops are redundant, or nearly so, and engines that solve them by iteration end at their own
tolerance: one is 1.0e-9 off in a gripper of two four-bars and 1.3e-9 in a biped whose shins are loops (measured), where mass
matrix and bias force agree to 1e-15."""
Rounded = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, slots=True)
class Precision:
    """``name`` as engines declare it. ``model``: tolerance of levels L1 to L4, relative to each quantity's own scale.
    ``motion``: the least tolerance of L6 and L7; ``factor``: of the floor, where that is larger; ``loosest``: up to which
    tolerance motion is compared. ``perturbation``: what disturbs a beginning (0: it is left, and every step is disturbed).
    ``sliding``: the least tolerance of what dry friction makes of a speed."""

    name: str
    model: float
    motion: float
    factor: float
    loosest: float
    perturbation: float
    sliding: float

    def tolerance(self, floor: float) -> float:
        """Of a motion with a round-off floor."""
        return max(self.motion, self.factor * floor)

    def of_loops(self) -> Precision:
        """For motion (L6) of a world in which constraints close loops: in doubles the least tolerance is larger."""
        return replace(self, motion=OF_LOOPS * self.motion) if self.name == DOUBLE else self

    def beginning(self, state: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        """A state from which a disturbed motion begins."""
        if not self.perturbation:
            return state
        return state * (1.0 + self.perturbation * generator.choice([-1.0, 1.0], len(state)))

    def rounding(self, run: int, generator: np.random.Generator) -> Rounded | None:
        """What the oracle's states become after every step of a disturbed ``run`` (0, 1, …): in the first the nearest numbers
        of this precision, in others numbers that are off by anything that these may be. None: what they are."""
        if self.perturbation:
            return None
        if run == 0:
            return _nearest
        off = ROUNDING[self.name]
        return lambda state: state * (1.0 + off * generator.uniform(-1.0, 1.0, len(state)))


def _nearest(state: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):
        return state.astype(np.float32).astype(float)


PRECISIONS: Mapping[str, Precision] = {
    DOUBLE: Precision(
        DOUBLE, model=MODEL_TOLERANCE, motion=1e-9, factor=100.0, loosest=1e-7, perturbation=1e-15, sliding=1e-8
    ),
    # 32 roundings: engines of single precision that are told the same model keep it to 1e-7 to 3e-7 (masses, tensors, poses,
    # mass matrices, measured in two), while what must be caught is 1e-5 off
    SINGLE: Precision(SINGLE, model=2e-6, motion=2e-6, factor=10.0, loosest=1e-3, perturbation=0.0, sliding=1e-5),
}
