"""How long two engines' positions can be compared: up to the noise horizon, and, in chaotic scenes, up to a second,
earlier one.

Growth depends on size (finite-size Lyapunov exponents). Moved by 1e-15, a scene may stay within a nanometre for seconds; moved
by what the engines differ by at their first contact, the same engine alone is soon as far off as the engines are. The noise
floor does not show that; repeats that are perturbed by the size of the engines' first gap do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simspec.comparison.common import Common, moving_in_common
from simspec.comparison.floor import DECADE, FLOOR_FACTOR, STATES, Floor, deviations, horizon, measure_floor, same_bits
from simspec.comparison.runs import TOLERANCE
from simspec.errors import Problem, SpecError
from simspec.files import parts
from simspec.runner.run import Run
from simspec.world.kinematics import initial_state
from simspec.world.types import World

RESOLUTION = 1e-9
"""Deviations (m) below this are no gap: in smooth motion round-off alone adds up to them."""
ALIKE = 10.0
"""A perturbation is of a gap's size when neither is more than this many times the other: growth changes slowly with size."""


@dataclass(frozen=True, slots=True)
class FirstGap:
    """The first recorded time (s) at which two engines differ by more than noise, by how much (m), and which body most."""

    time: float
    size: float
    body: str


def first_gap(a: Run, b: Run, floors: Sequence[Floor] = (), resolution: float = RESOLUTION) -> FirstGap | None:
    """The first gap of two runs: a deviation above ``resolution`` (m) and above ``FLOOR_FACTOR`` times the noise; None where
    they never part. Raises SpecError where the runs have no common time or moving body."""
    names = moving_in_common(a, b)
    common = Common(a, b, names, floors)
    for part in common.blocks(common.rows):
        position, _ = deviations(*common.poses(part))
        values, _ = common.noise(np.arange(part.start, part.stop)[:, None])
        beyond = (position > np.maximum(resolution, FLOOR_FACTOR * values)) | ~np.isfinite(position)
        if beyond.any():
            row = int(beyond.any(axis=1).argmax())
            size = np.where(beyond[row], np.nan_to_num(position[row], nan=np.inf), 0.0)
            body = int(size.argmax())
            return FirstGap(float(common.time(np.array([part.start + row]))[0]), float(size[body]), names[body])
    return None


def perturbation_of(world: World, size: float) -> float:
    """The relative change of the initial state (``Case.perturb``) that moves no coordinate by more than ``size`` (m, rad), and
    the largest by that much."""
    q, _ = initial_state(world)
    # an exact zero is moved by the amount itself
    reach = float(np.where(q == 0.0, 1.0, np.abs(q)).max(initial=0.0))
    if not reach:
        raise SpecError([Problem(f"no body of {world.name!r} can move", code="R106")])
    return size / reach


def floors_by_size(run: Run, repeats: Sequence[Run]) -> dict[float, Floor]:
    """The noise floor of a run for each size of perturbation among its repeats; unchanged repeats count with the smallest."""
    sizes = sorted({float(other.provenance.get("perturb") or 0.0) for other in repeats})
    perturbed = [size for size in sizes if size] or sizes[:1]
    floors = {}
    for size in perturbed:
        chosen = (size, 0.0) if size == perturbed[0] else (size,)
        floor = measure_floor(
            run, [repeat for repeat in repeats if float(repeat.provenance.get("perturb") or 0.0) in chosen]
        )
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
    gap: FirstGap | None
    second: float | None
    measured: bool
    notes: tuple[str, ...] = ()

    @property
    def comparable_until(self) -> float | None:
        """The earlier of the two horizons (s); None = to the end."""
        return min((entry for entry in (self.noise, self.second) if entry is not None), default=None)


def horizons(
    a: Run,
    b: Run,
    floors: Sequence[Floor],
    moved: Sequence[Floor] = (),
    *,
    tolerance: float = TOLERANCE,
    angle_tolerance: float | None = None,
) -> Horizons:
    """The horizons of two runs. ``floors``: of repeats moved in the last bits; ``moved``: of repeats moved by the size of the
    first gap (:func:`perturbation_of`). Raises SpecError where the runs have nothing in common."""
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
                text = f"{floor.engine}: moved by {start:.2g} m, the first gap is {gap.size:.2g} m"
                notes.append(f"{text}: the second horizon is of another size")
    return Horizons(noise, gap, second, bool(moved), tuple(notes))


def _time(common: Common, factor: float, tolerance: float, angle: float, floors: Sequence[Floor]) -> float | None:
    last = horizon(common, factor, tolerance, angle) if floors else common.rows
    return float(common.time(np.array([last]))[0]) if last < common.rows else None


def growth_rates(time: NDArray[np.float64], separation: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Finite-size Lyapunov exponents: for each decade from the first separation (rows,) on, the size (m) at which it begins
    and the rate (1/s), ln 10 over the time that the separation takes to grow tenfold. ``separation`` never falls
    (``Floor.position.max(axis=1)``); a decade passed between two rows has no measurable rate, and is left out."""
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


# Consistency: one scenario at several timesteps (after Erez, Tassa and Todorov 2015).

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
        raise SpecError([Problem(f"{coarse.label} and {fine.label} are not one scenario in one engine", code="R105")])
    if not steps[1] < steps[0]:
        raise SpecError([Problem("the second run needs a smaller timestep than the first", code="R106")])
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
    """The data that are equal at every timestep: steps, records and control follow from the timestep, and settings may."""
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
    """The order from three runs of one scenario whose timesteps shrink by one factor r (dt, dt/r, dt/r²): p = log_r of the
    ratio of the two successive rms deviations.

    Raises SpecError for another number of runs, for timesteps of another ratio, and as :func:`consistency` does.
    """
    ordered = sorted(runs, key=lambda run: -run.world.physics.timestep)
    steps = [run.world.physics.timestep for run in ordered]
    if len(steps) != 3 or not math.isclose(steps[0] * steps[2], steps[1] ** 2, rel_tol=NEAR) or steps[0] == steps[1]:
        text = ", ".join(f"{1e3 * step:g} ms" for step in steps)
        hint = "for example 4, 2 and 1 ms"
        raise SpecError([Problem("an order needs three timesteps with one ratio", found=text, hint=hint, code="R106")])
    outer, inner = consistency(ordered[0], ordered[1]), consistency(ordered[1], ordered[2])
    # times that all three recorded, to half of the smallest timestep
    at = np.clip(np.searchsorted(inner.time, outer.time - 0.5 * steps[2]), 0, len(inner.time) - 1)
    same = np.abs(inner.time[at] - outer.time) <= 0.5 * steps[2]
    if not (outer.time[same] > 0.0).any():
        hint = "a record.every that is a whole number of all three timesteps"
        raise SpecError(
            [Problem("the three runs have no recorded time in common but the beginning", hint=hint, code="R106")]
        )
    coarse, fine = outer.rms[same], inner.rms[at[same]]
    ratio = steps[0] / steps[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        order = np.where((coarse > 0.0) & (fine > 0.0), np.log(coarse / fine) / math.log(ratio), np.nan)
        error = np.where(order > 0.0, fine / (ratio**order - 1.0), np.nan)
    return Convergence((steps[0], steps[1], steps[2]), outer.time[same], order, error)


# Determinism: whether repeated runs have the same bits, and the first place where they differ.

SAME = ("world_sha256", "engine_version", "artifacts_sha256", "perturb", "seed")
"""Entries of the provenance in which repeats are equal."""


@dataclass(frozen=True, slots=True)
class Departure:
    """Where a repeat first differs from the first run: its number (from 1), the array, the recorded time (s), and the largest
    difference there, in the array's own units (0.0: other bits of the same number). ``time`` and ``size`` are None where one
    simply recorded fewer rows."""

    repeat: int
    array: str
    time: float | None
    size: float | None


@dataclass(frozen=True)
class Determinism:
    """Repeats of one run: ``runs`` of them were compared; ``departures``: the first difference of each that differs."""

    engine: str
    runs: int
    departures: tuple[Departure, ...]

    @property
    def bitwise(self) -> bool:
        """Whether every repeat has the bits of the first run."""
        return not self.departures

    def __str__(self) -> str:
        if self.bitwise:
            return f"{self.runs} runs, bitwise equal"
        first = self.departures[0]
        when = "in its number of records" if first.time is None else f"from {first.time:.4g} s on, in {first.array}"
        return f"{len(self.departures)} of {self.runs - 1} repeats differ, the first {when}"


def determinism(runs: Sequence[Run]) -> Determinism:
    """Hold repeats of one run against the first, bit for bit: step, q, v, poses and velocities.

    Raises SpecError for fewer than two runs, for runs that are not repeats of each other, and for runs that recorded nothing.
    """
    if len(runs) < 2:
        raise SpecError([Problem("determinism needs at least two runs", code="R106")])
    first = runs[0]
    for run in runs:
        if not run.recorded:
            raise SpecError([Problem(f"{run.label} recorded nothing to compare: {run.failed}", code="R106")])
        other = [name for name in SAME if run.provenance.get(name) != first.provenance.get(name)]
        if run.engine != first.engine or other:
            why = ", ".join(other) or "engine"
            raise SpecError(
                [
                    Problem(
                        f"{first.label} and {run.label} are not repeats of one run", found=f"other {why}", code="R105"
                    )
                ]
            )
    departures = [_departure(first, run, number) for number, run in enumerate(runs[1:], 1) if not same_bits(first, run)]
    return Determinism(first.label, len(runs), tuple(departures))


def _departure(first: Run, other: Run, number: int) -> Departure:
    """The earliest difference; of several arrays at first row, that of the first in :data:`STATES`."""
    rows = min(len(first.time), len(other.time))
    earliest, array = rows, ""
    for name in STATES:
        a, b = first.arrays[name], other.arrays[name]
        for part in parts(earliest, 2 * a[:1].nbytes, a, b):
            differs = _bits(a[part]) != _bits(b[part])
            if differs.any():
                earliest, array = part.start + int(differs.any(axis=1).argmax()), name
                break
    if not array:
        return Departure(number, "step", None, None)
    a, b = (np.asarray(run.arrays[array][earliest], dtype=np.float64) for run in (first, other))
    return Departure(number, array, float(first.time[earliest]), float(np.abs(a - b).max()))


def _bits(values: np.ndarray) -> np.ndarray:
    """Each row as its bytes (rows, bytes)."""
    return np.frombuffer(values.tobytes(), dtype=np.uint8).reshape(len(values), -1)
