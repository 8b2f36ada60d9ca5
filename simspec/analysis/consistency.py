"""Whether an engine agrees with itself: one scenario at several timesteps (after Erez, Tassa and Todorov 2015)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simspec.comparison.common import Common, moving_in_common
from simspec.comparison.floor import deviations
from simspec.errors import Problem, SpecError
from simspec.runner.run import Run
from simspec.world.types import World

NEAR = 1e-9
"""Relative difference within which two ratios of timesteps are equal."""


@dataclass(frozen=True)
class Consistency:
    """One engine at two timesteps (s), ``coarse`` > ``fine``, at the times that both recorded (rows,), s.

    rms, largest  deviation (m) of the moving bodies' positions, (rows,)
    drift         ½ g t Δdt (m), (rows,), with Δdt the difference of the timesteps: by how much two first-order motions in
                  free fall differ. A deviation of this size is the integrator's, and no fault of contact or solver
    """

    engine: str
    coarse: float
    fine: float
    time: NDArray[np.float64]
    rms: NDArray[np.float64]
    largest: NDArray[np.float64]
    drift: NDArray[np.float64]

    def row(self, time: float) -> int:
        """The row of the recorded time next to ``time`` (s)."""
        return int(np.abs(self.time - time).argmin())


def consistency(coarse: Run, fine: Run) -> Consistency:
    """Hold a run against one of the same scenario in the same engine at a smaller timestep.

    Raises SpecError for other scenarios or engines, where the second timestep is not smaller, and where there is no
    common time.
    """
    steps = [run.world.physics.timestep for run in (coarse, fine)]
    if coarse.label != fine.label or _scenario(coarse.world) != _scenario(fine.world):
        raise SpecError([Problem(f"{coarse.label} and {fine.label} are not one scenario in one engine")])
    if not steps[1] < steps[0]:
        raise SpecError([Problem("the second run needs a smaller timestep than the first")])
    common = Common(coarse, fine, moving_in_common(coarse, fine), [])
    time, rms, largest = (np.zeros(common.rows) for _ in range(3))
    for part in common.blocks(common.rows):
        position, _ = deviations(*common.poses(part))
        time[part] = common.time(part)
        rms[part] = np.sqrt((position**2).mean(axis=1))
        largest[part] = position.max(axis=1)
    pull = float(np.linalg.norm(coarse.world.physics.gravity))
    drift = 0.5 * pull * time * (steps[0] - steps[1])
    return Consistency(coarse.label, steps[0], steps[1], time, rms, largest, drift)


def _scenario(world: World) -> tuple[object, ...]:
    """What is equal at every timestep: steps, records and control follow from the timestep, and settings may."""
    bodies = tuple(
        replace(body, shapes=tuple(replace(shape, surfaces=()) for shape in body.shapes)) for body in world.bodies
    )
    return bodies, world.contact, world.physics.gravity


@dataclass(frozen=True)
class Convergence:
    """The observed order of convergence at each common time (rows,): p where deviations shrink as dtᵖ; NaN where there
    are none.

    ``error``: Richardson's estimate (m) of what is still missing at the finest timestep; NaN where the order is not positive.
    """

    timesteps: tuple[float, float, float]
    time: NDArray[np.float64]
    order: NDArray[np.float64]
    error: NDArray[np.float64]


def convergence(runs: Sequence[Run]) -> Convergence:
    """The order from three runs of one scenario whose timesteps shrink by one factor r (dt, dt/r, dt/r²): p = log_r of
    the ratio
    of the two successive rms deviations.

    Raises SpecError for another number of runs, for timesteps of another ratio, and as :func:`consistency` does.
    """
    ordered = sorted(runs, key=lambda run: -run.world.physics.timestep)
    steps = [run.world.physics.timestep for run in ordered]
    if len(steps) != 3 or not math.isclose(steps[0] * steps[2], steps[1] ** 2, rel_tol=NEAR) or steps[0] == steps[1]:
        told = ", ".join(f"{1e3 * step:g} ms" for step in steps)
        hint = "for example 4, 2 and 1 ms"
        raise SpecError([Problem("an order needs three timesteps with one ratio", found=told, hint=hint)])
    outer, inner = consistency(ordered[0], ordered[1]), consistency(ordered[1], ordered[2])
    # times that all three recorded, to half of the smallest timestep
    at = np.clip(np.searchsorted(inner.time, outer.time - 0.5 * steps[2]), 0, len(inner.time) - 1)
    same = np.abs(inner.time[at] - outer.time) <= 0.5 * steps[2]
    if not (outer.time[same] > 0.0).any():
        hint = "a record.every that is a whole number of all three timesteps"
        raise SpecError([Problem("the three runs have no recorded time in common but the beginning", hint=hint)])
    coarse, fine = outer.rms[same], inner.rms[at[same]]
    ratio = steps[0] / steps[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        order = np.where((coarse > 0.0) & (fine > 0.0), np.log(coarse / fine) / math.log(ratio), np.nan)
        error = np.where(order > 0.0, fine / (ratio**order - 1.0), np.nan)
    return Convergence((steps[0], steps[1], steps[2]), outer.time[same], order, error)
