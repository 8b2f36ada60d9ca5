"""What a proof demands of an engine by the numbers that it computes with (``Engine.PRECISION``), never by the engine.

What is read back is as near as numbers of that length are. Motion is as near as a world's own floor: the oracle run again,
disturbed as such numbers disturb it. Of doubles the beginning alone is, by the last bits, and the tolerance is 100 times what
that makes. In single precision each step's rounding counts, so that the oracle's state is rounded after every step: what an
engine does beside it (its rotations, its sums) is then a few times that floor and not a hundred. Of 14 free bodies with random
tensors that turn at 0.5 and 2.8 rad/s for 2,000 steps of 1 ms, an engine of single precision was off by 0.9 to 3.5 times the
floor (measured), which is 4e-6 to 2e-5.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from simspec.engines.kit.capabilities import DOUBLE, ROUNDING, SINGLE
from simspec.proof.checks import MODEL_TOLERANCE

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
