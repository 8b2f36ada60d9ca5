"""How long two engines' positions can be compared: up to the noise horizon, and, in chaotic scenes, up to a second,
earlier one.

Growth depends on size (finite-size Lyapunov exponents). Moved by 1e-15, a scene may stay within a nanometre for seconds; moved
by what the engines differ by at their first contact, the same engine alone is soon as far off as the engines are. The
noise floor
does not show that; repeats that are perturbed by the size of the engines' first gap do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.comparison.common import Common, moving_in_common
from simspec.comparison.floor import FLOOR_FACTOR, Floor, deviations, measure_floor
from simspec.comparison.horizon import DECADE, horizon
from simspec.comparison.runs import TOLERANCE
from simspec.errors import Problem, SpecError
from simspec.runner.run import Run
from simspec.world.kinematics import initial_state
from simspec.world.types import World

RESOLUTION = 1e-9
"""Deviations (m) below this are no gap: in smooth motion round-off alone adds up to them."""
ALIKE = 10.0
"""A perturbation is of a gap's size when neither is more than this many times the other: growth changes slowly with size."""


@dataclass(frozen=True, slots=True)
class Gap:
    """The first recorded time (s) at which two engines differ by more than noise, by how much (m), and which body most."""

    time: float
    size: float
    body: str


def first_gap(a: Run, b: Run, floors: Sequence[Floor] = (), resolution: float = RESOLUTION) -> Gap | None:
    """The first gap of two runs: a deviation above ``resolution`` (m) and above ``FLOOR_FACTOR`` times the noise; None
    where they
    never part. Raises SpecError where the runs have no common time or moving body."""
    names = moving_in_common(a, b)
    common = Common(a, b, names, floors)
    for part in common.blocks(common.rows):
        position, _ = deviations(*common.poses(part))
        own, _ = common.noise(np.arange(part.start, part.stop)[:, None])
        beyond = (position > np.maximum(resolution, FLOOR_FACTOR * own)) | ~np.isfinite(position)
        if beyond.any():
            row = int(beyond.any(axis=1).argmax())
            size = np.where(beyond[row], np.nan_to_num(position[row], nan=np.inf), 0.0)
            body = int(size.argmax())
            return Gap(float(common.time(np.array([part.start + row]))[0]), float(size[body]), names[body])
    return None


def perturbation_of(world: World, size: float) -> float:
    """The relative change of the initial state (``Case.perturb``) that moves no coordinate by more than ``size`` (m,
    rad), and the
    largest by that much."""
    q, _ = initial_state(world)
    # what is exactly zero is moved by the amount itself
    reach = float(np.where(q == 0.0, 1.0, np.abs(q)).max(initial=0.0))
    if not reach:
        raise SpecError([Problem(f"no body of {world.name!r} can move")])
    return size / reach


def floors_by_size(run: Run, repeats: Sequence[Run]) -> dict[float, Floor]:
    """The noise floor of a run for each size of perturbation among its repeats; unchanged repeats count with the smallest."""
    sizes = sorted({float(other.provenance.get("perturb") or 0.0) for other in repeats})
    perturbed = [size for size in sizes if size] or sizes[:1]
    floors = {}
    for size in perturbed:
        chosen = (size, 0.0) if size == perturbed[0] else (size,)
        floor = measure_floor(run, [one for one in repeats if float(one.provenance.get("perturb") or 0.0) in chosen])
        if floor is not None:
            floors[size] = floor
    return floors


@dataclass(frozen=True)
class Horizons:
    """How long the positions of two runs can be compared.

    noise   time (s) from which round-off hides differences of the tolerance's size; None = never in these runs
    gap     the engines' first gap; None where they never part
    second  time (s) from which an engine alone, moved by the size of that gap, is off by the tolerance: from there on
    differences
            of positions follow from the first gap, and say nothing more about the engines. None = never, or not measured
    measured  whether repeats perturbed by the size of the gap were given
    notes   what must be known to read it
    """

    noise: float | None
    gap: Gap | None
    second: float | None
    measured: bool
    notes: tuple[str, ...] = ()

    @property
    def comparable_until(self) -> float | None:
        """The earlier of the two horizons (s); None = to the end."""
        return min((one for one in (self.noise, self.second) if one is not None), default=None)


def horizons(
    a: Run,
    b: Run,
    floors: Sequence[Floor],
    moved: Sequence[Floor] = (),
    *,
    tolerance: float = TOLERANCE,
    angle_tolerance: float | None = None,
) -> Horizons:
    """The horizons of two runs. ``floors``: of repeats moved in the last bits; ``moved``: of repeats moved by the size
    of the first
    gap (:func:`perturbation_of`). Raises SpecError where the runs have nothing in common."""
    names, angle = moving_in_common(a, b), tolerance if angle_tolerance is None else angle_tolerance
    gap = first_gap(a, b, floors)
    noise, second = (
        _time(Common(a, b, names, some), factor, tolerance, angle, some)
        for some, factor in ((floors, FLOOR_FACTOR), (moved, 1.0))
    )
    notes = [] if floors else ["the noise floor was not measured"]
    if gap is not None and not moved:
        notes.append(f"no repeats were moved by the size of the first gap ({gap.size:.2g} m): chaos may hide behind it")
    if gap is not None:
        for floor in moved:
            start = float(floor.position[0].max(initial=0.0)) if len(floor.position) else 0.0
            if not gap.size / ALIKE <= start <= gap.size * ALIKE:
                told = f"{floor.engine}: moved by {start:.2g} m, the first gap is {gap.size:.2g} m"
                notes.append(f"{told}: the second horizon is of another size")
    return Horizons(noise, gap, second, bool(moved), tuple(notes))


def _time(common: Common, factor: float, tolerance: float, angle: float, floors: Sequence[Floor]) -> float | None:
    last = horizon(common, factor, tolerance, angle) if floors else common.rows
    return float(common.time(np.array([last]))[0]) if last < common.rows else None


def growth_rates(time: NDArray[np.float64], separation: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Finite-size Lyapunov exponents: for each decade from the first separation (rows,) on, the size (m) at which it
    begins and the
    rate (1/s), ln 10 over the time that the separation takes to grow tenfold. ``separation`` never falls
    (``Floor.position.max(axis=1)``); a decade passed between two rows has no rate that could be told, and is left out."""
    grown = np.flatnonzero(separation > 0.0)
    if not len(grown):
        return []
    size, rates = float(separation[grown[0]]), []
    while size * DECADE <= separation[-1]:
        begin, end = (int(np.argmax(separation >= level)) for level in (size, size * DECADE))
        if end > begin and math.isfinite(float(separation[end])):
            rates.append((size, math.log(DECADE) / float(time[end] - time[begin])))
        size *= DECADE
    return rates
