"""Chaotic scenes, compared by distributions: two engines that differ in every position may still agree in all that lasts.

The *run* is the unit. Bodies of one run push each other and are not independent: pooled, 216 of them make a difference of 1 µm
in resting height "significant". Each run is summarised by a few numbers on physical scales; tests are by permutation, exact
where all permutations can be gone through, and say the smallest p that they could have given.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.comparison.common import CONTACT_BYTES, Sides, body_size, common_rows, common_sides, named_pair, sides_of
from simspec.errors import Problem, SpecError
from simspec.files import parts
from simspec.runner import metrics
from simspec.runner.run import Run

Numbers = NDArray[np.float64]

LEVEL = 0.05
"""p at or below which a test rejects."""
MOST_EXACT = 65_536
"""Permutations that are all gone through; where there are more, some are drawn."""
DRAWN = 9_999
"""Permutations that are drawn otherwise: p is then a multiple of 1/10,000."""
SAME = 1e-12
"""Relative difference within which two statistics are equal: the same sum in another order."""
SUMMARY = {"rms_radius": "m", "median_radius": "m", "mean_height": "m", "mean_speed": "m/s", "kinetic_energy": "J"}
"""The summary of a run at a time, with units.

rms_radius, median_radius   distance of the moving bodies' centres of mass from their common mean
mean_height                 mean of the centres of mass along the direction against gravity
mean_speed                  mean speed of the centres of mass
kinetic_energy              of all bodies
"""


def run_summary(run: Run, row: int = -1) -> Numbers:
    """The quantities of :data:`SUMMARY` (5,) of a run at a recorded row. Raises SpecError for a run that failed or in which
    nothing moves."""
    if run.failed is not None or not run.recorded:
        raise SpecError([Problem(f"{run.label} has no whole result to summarise: {run.failed}", code="R106")])
    moving = metrics.moving_bodies(run.world)
    if not len(moving):
        raise SpecError([Problem(f"no body of {run.world.name!r} can move", code="R106")])
    values = {name: np.asarray(run.arrays[name][[row]]) for name in ("q", "v", "pose", "velocity")}
    centres = metrics.motion(run.world, values).centre[0, moving]
    radii = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    heights = centres @ _up(run)
    speeds = metrics.speeds(run.world, values)[0, moving]
    kinetic, _ = metrics.energy(run.world, values)
    spread = metrics.spread(run.world, values)[0]
    return np.array([spread, np.median(radii), heights.mean(), speeds.mean(), kinetic[0]])


def summary_scales(run: Run) -> Numbers:
    """Physical scales (5,) of :data:`SUMMARY`: the median size d of the moving bodies with mass, the speed √(g d), the energy
    Σ m g d. Where there is no gravity: d, and the initial speed and energy. A difference of 1 is then one that anybody would
    see."""
    moving = metrics.moving_bodies(run.world)
    bodies = [run.world.bodies[index] for index in moving]
    size = float(np.median([body_size(body.inertial) for body in bodies if body.inertial.mass]))
    mass = sum(body.inertial.mass for body in bodies)
    pull = float(np.linalg.norm(run.world.physics.gravity))
    speed, energy = math.sqrt(pull * size), mass * pull * size
    if pull == 0.0:
        start = run_summary(run, 0)
        speed, energy = float(start[3]), float(start[4])
    if not (size > 0.0 and speed > 0.0 and energy > 0.0):
        raise SpecError([Problem(f"{run.world.name!r} has no scale of length, speed or energy", code="R106")])
    return np.array([size, size, size, speed, energy])


def _up(run: Run) -> Numbers:
    gravity = np.array(run.world.physics.gravity)
    pull = float(np.linalg.norm(gravity))
    return -gravity / pull if pull else np.array([0.0, 0.0, 1.0])


def paired(first: Mapping[int, Numbers], second: Mapping[int, Numbers]) -> tuple[Numbers, Numbers]:
    """Summaries of two engines by seed, as two arrays (seeds, k) in the order of the seeds. Raises SpecError where a seed was
    run in one of them only."""
    alone = sorted(first.keys() ^ second.keys())
    if alone or not first:
        text = ", ".join(map(str, alone)) or "none at all"
        raise SpecError(
            [Problem("pairs need the same seeds in both engines", found=f"in one only: {text}", code="R105")]
        )
    seeds = sorted(first)
    return np.array([first[seed] for seed in seeds]), np.array([second[seed] for seed in seeds])


def distances(x: Numbers, y: Numbers) -> Numbers:
    """Euclidean distances (n, m) between rows of x (n, k) and y (m, k)."""
    result: Numbers = np.linalg.norm(x[:, None] - y[None], axis=-1)
    return result


def energy_distance(x: Numbers, y: Numbers) -> float:
    """2 E|X − Y| − E|X − X'| − E|Y − Y'| (Székely and Rizzo 2004) of samples (n, k) and (m, k): ≥ 0, and 0 where equal."""
    return float(2.0 * distances(x, y).mean() - distances(x, x).mean() - distances(y, y).mean())


def median_distance(x: Numbers, y: Numbers) -> float:
    """The median distance between different members of both samples: the usual bandwidth of :func:`mmd`."""
    both = np.concatenate([x, y])
    return float(np.median(distances(both, both)[np.triu_indices(len(both), 1)]))


def mmd(x: Numbers, y: Numbers, bandwidth: float) -> float:
    """The squared maximum mean discrepancy (Gretton et al. 2012), biased estimate, kernel exp(−d²/2h²) with the bandwidth h:
    E k(X, X') + E k(Y, Y') − 2 E k(X, Y)."""
    kernel = [_kernel(distances(a, b), bandwidth).mean() for a, b in ((x, x), (y, y), (x, y))]
    return float(kernel[0] + kernel[1] - 2.0 * kernel[2])


def _kernel(distance: Numbers, bandwidth: float) -> Numbers:
    if not bandwidth > 0.0:
        raise ValueError(f"the bandwidth of a kernel must be positive: {bandwidth}")
    result: Numbers = np.exp(-(distance**2) / (2.0 * bandwidth**2))
    return result


@dataclass(frozen=True, slots=True)
class Test:
    """The outcome of a test by permutation.

    statistic  of the data as they are
    p          the share of permutations whose statistic is as large, the data themselves included
    smallest   the smallest p that so few runs can give; above ``level``, the test cannot reject
    exact      whether all permutations were gone through
    """

    statistic: float
    p: float
    smallest: float
    exact: bool
    permutations: int
    level: float = LEVEL

    @property
    def can_reject(self) -> bool:
        """Whether the test could reject for any data of this size."""
        return self.smallest <= self.level

    @property
    def rejects(self) -> bool:
        """Whether the test rejects."""
        return self.can_reject and self.p <= self.level

    def __str__(self) -> str:
        if not self.can_reject:
            return f"cannot reject: with so few runs p is at least {self.smallest:.2g} (here {self.p:.2g})"
        verdict = "differ" if self.rejects else "no difference found"
        return f"{verdict}: p = {self.p:.2g} (smallest possible {self.smallest:.2g})"


def permutation_test(
    x: Numbers, y: Numbers, bandwidth: float | None = None, *, level: float = LEVEL, seed: int = 0
) -> Test:
    """Whether samples x (n, k) and y (m, k) of *runs* are of one distribution, by the energy distance, or, with a
    ``bandwidth``, by
    :func:`mmd`. Scale the columns before (:func:`summary_scales`).

    Both are −zᵀDz of the matrix D of distances (or −k) with z = 1/n for members of x and −1/m for those of y, so that all
    permutations are one matrix product. Raises ValueError for empty samples.
    """
    n, m = len(x), len(y)
    if not n or not m:
        raise ValueError("a test needs runs of both")
    both = np.concatenate([x, y])
    matrix = distances(both, both)
    if bandwidth is not None:
        matrix = -_kernel(matrix, bandwidth)
    ways = math.comb(n + m, n)
    exact = ways <= MOST_EXACT
    labels = np.full((ways if exact else 1 + DRAWN, n + m), -1.0 / m)
    if exact:
        # the first combination is the data as they are
        chosen = np.array(list(itertools.combinations(range(n + m), n)))
    else:
        generator = np.random.default_rng(seed)
        drawn = generator.permuted(np.tile(np.arange(n + m), (DRAWN, 1)), axis=1)[:, :n]
        chosen = np.concatenate([np.arange(n)[None], drawn])
    np.put_along_axis(labels, chosen, 1.0 / n, axis=1)
    statistics = -((labels @ matrix) * labels).sum(axis=1)
    # where both are of one size, exchanging the two gives the same statistic
    return _judged(statistics, exact, (2 if n == m else 1) / ways, level, float(np.abs(matrix).max()))


def sign_flip_test(differences: Numbers, *, level: float = LEVEL, seed: int = 0) -> Test:
    """Whether paired differences (pairs, k), or (pairs,), are symmetric about zero: the largest |mean| of any column; one pair
    is one seed in both engines. Scale the columns before. With n pairs p is at least 2/2ⁿ: three cannot reject, six can.

    Raises ValueError without pairs.
    """
    pairs = len(differences)
    if not pairs:
        raise ValueError("a test needs pairs")
    values = np.asarray(differences, dtype=np.float64).reshape(pairs, -1)
    ways = 2**pairs
    exact = ways <= MOST_EXACT
    if exact:
        signs = 1.0 - 2.0 * ((np.arange(ways)[:, None] >> np.arange(pairs)) & 1)
    else:
        generator = np.random.default_rng(seed)
        drawn = 1.0 - 2.0 * generator.integers(0, 2, (DRAWN, pairs))
        signs = np.concatenate([np.ones((1, pairs)), drawn])
    statistics = np.abs(signs @ values / pairs).max(axis=1)
    return _judged(statistics, exact, 2.0 / ways, level, float(np.abs(values).max()))


def _judged(statistics: Numbers, exact: bool, smallest: float, level: float, scale: float) -> Test:
    """``statistics``: of the data as they are, then of permutations (all of them, with the data's own, where ``exact``)."""
    if not np.isfinite(statistics).all():
        raise ValueError("a summary is not finite")
    as_large = int((statistics >= statistics[0] - SAME * scale).sum())
    smallest = smallest if exact else max(smallest, 1.0 / len(statistics))
    return Test(float(statistics[0]), as_large / len(statistics), smallest, exact, len(statistics), level)


# Contacts of two runs, matched by pair: durations, overlap in time, impulses. Sides of pairs are those that both runs
# distinguish (:mod:`simspec.comparison.common`): a body, with its shapes in brackets where they are not all.

Pair = tuple[str, str]


def demand_contacts(run: Run) -> None:
    """Raises SpecError where a run did not record its contacts."""
    if "contact.row" not in run.arrays:
        hint = "add contacts to record.channels"
        raise SpecError([Problem(f"{run.label} did not record contacts", "record.channels", hint=hint, code="R107")])


def durations(run: Run) -> NDArray[np.float64]:
    """The time (rows,), s, that each recorded row stands for: the one since the row before; 0 of the initial state."""
    return np.diff(run.time, prepend=run.time[:1])


@dataclass(frozen=True, slots=True)
class PairTouch:
    """Of one pair in one run: time in contact (s), impulse (N s), and when it first touched (s)."""

    seconds: float
    impulse: float
    first: float


def pair_numbers(run: Run, part: slice, sides: Sides) -> NDArray[np.int64]:
    """For contacts ``part`` of a run the number of the pair (n,): smaller side times the number of sides, plus the larger."""
    pair = np.sort(sides.numbers[0][run.arrays[sides.arrays[0]][part].astype(np.int64)], axis=1)
    result: NDArray[np.int64] = pair[:, 0] * len(sides.names) + pair[:, 1]
    return result


def touches(run: Run, by: str = "shape") -> dict[Pair, PairTouch]:
    """Every pair of shapes (``by``: or of bodies) that touched in a run. The impulse is the time integral of the normal force,
    Σ F Δt over the recorded rows: exact where every step is recorded, a sample of it otherwise. Raises SpecError where
    contacts were not recorded."""
    demand_contacts(run)
    row, force = run.arrays["contact.row"], run.arrays["contact.normal_force"]
    lasting, sides = durations(run), common_sides([run], by)
    seconds: dict[int, float] = {}
    impulse: dict[int, float] = {}
    first: dict[int, float] = {}
    last_row: dict[int, int] = {}
    for part in parts(len(row), CONTACT_BYTES, row, force, run.arrays[sides.arrays[0]]):
        number, at = pair_numbers(run, part, sides), row[part].astype(np.int64)
        pushed = force[part] * lasting[at]
        kinds, place = np.unique(number, return_inverse=True)
        for kind, total in zip(kinds.tolist(), np.bincount(place, pushed, len(kinds)).tolist(), strict=True):
            impulse[kind] = impulse.get(kind, 0.0) + total
        # a pair counts once for each row, however many points it touches at; a block may end within a row
        for index, kind in enumerate(kinds.tolist()):
            kinds_here = np.unique(at[place == index])
            first.setdefault(kind, float(run.time[kinds_here[0]]))
            begun = 1 if kinds_here[0] == last_row.get(kind) else 0
            seconds[kind] = seconds.get(kind, 0.0) + float(lasting[kinds_here[begun:]].sum())
            last_row[kind] = int(kinds_here[-1])
    return {named_pair(sides.names, kind): PairTouch(seconds[kind], impulse[kind], first[kind]) for kind in impulse}


@dataclass(frozen=True, slots=True)
class PairComparison:
    """One pair in two runs over their common times: time in contact (s) in each and in both, and impulses (N s) in each."""

    pair: Pair
    first_seconds: float
    second_seconds: float
    both_seconds: float
    first_impulse: float
    second_impulse: float

    @property
    def jaccard(self) -> float:
        """Time in contact in both runs over time in contact in either: 1 where they touch at the same times. NaN where the
        pair touches in the initial state alone, which lasts no time."""
        either = self.first_seconds + self.second_seconds - self.both_seconds
        return self.both_seconds / either if either else float("nan")


def compare_contacts(a: Run, b: Run, by: str = "shape") -> tuple[PairComparison, ...]:
    """The contacts of two runs at the times that both recorded, by pair of shapes as far as both tell them (``by``: or of
    bodies), that with the largest impulse first. ``common_sides((a, b)).notes`` says what one does not tell.

    Raises SpecError where a run did not record contacts, or the runs have no common time.
    """
    for run in (a, b):
        demand_contacts(run)
    rows_a, rows_b = common_rows(a, b)
    time = a.time[rows_a]
    lasting = np.diff(time, prepend=time[:1])
    known = common_sides((a, b), by)
    sides, count = sides_of((a, b), (rows_a, rows_b), known), len(known.names)
    totals: dict[int, list[float]] = {}
    first = 0
    while first < len(rows_a):
        last = min(len(rows_a), *(side.until(first) for side in sides))
        array, other = (side.pairs(first, last, count) for side in sides)
        both = np.intersect1d(array, other, assume_unique=True)
        for column, found in enumerate((array, other, both)):
            _add(totals, column, found % count**2, lasting[found // count**2])
        for column, side in enumerate(sides, 3):
            at, pair, force = side.forces(first, last, count)
            _add(totals, column, pair, force * lasting[at])
        first = last
    compared = [PairComparison(named_pair(known.names, number), *values) for number, values in totals.items()]
    return tuple(
        sorted(
            compared,
            key=lambda comparison: (-max(comparison.first_impulse, comparison.second_impulse), comparison.pair),
        )
    )


def _add(totals: dict[int, list[float]], column: int, pair: NDArray[np.int64], amount: NDArray[np.float64]) -> None:
    kinds, place = np.unique(pair, return_inverse=True)
    for kind, total in zip(kinds.tolist(), np.bincount(place, amount, len(kinds)).tolist(), strict=True):
        totals.setdefault(kind, [0.0] * 5)[column] += total


def total_jaccard(compared: tuple[PairComparison, ...]) -> float | None:
    """The share for all pairs together: time in contact in both runs over that in either; None where nothing touched."""
    both = sum(comparison.both_seconds for comparison in compared)
    either = sum(comparison.first_seconds + comparison.second_seconds for comparison in compared) - both
    return both / either if either else None
