"""Which recorded times a page shows, the box of its positions, and numbers packed as text: rounded to 16 bits, gzip, base64."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.files import parts
from simspec.runner.metrics import moving_bodies
from simspec.runner.run import Run
from simspec.world.types import World

# Packing: 16 bits where numbers are for the eye, gzip, base64; ``page/src/packing.ts`` reads it. Trajectories are
# differences in time, all low bytes before all high bytes, so that slow changes are mostly zeros.

Numbers = NDArray[np.float64]
Codes = NDArray[np.int16]

LARGEST_CODE = 32767
"""Numbers between two bounds are coded as −32767 to 32767."""


class PackedNumbers:
    """The packed numbers of a page, by name."""

    def __init__(self) -> None:
        self.entries: dict[str, str] = {}

    def add(self, content: bytes) -> str:
        """Pack some bytes; the name that they have in the page."""
        name = f"d{len(self.entries)}"
        # without a time of packing: the same runs give the same page
        self.entries[name] = base64.b64encode(gzip.compress(content, 9, mtime=0)).decode("ascii")
        return name

    def floats(self, values: Numbers) -> str:
        """Numbers in single precision; those that are not finite stay so."""
        with np.errstate(over="ignore"):
            return self.add(values.astype("<f4").tobytes())

    def codes(self, codes: Codes) -> str:
        """16-bit numbers, low bytes first."""
        return self.add(_planes(codes))

    def series(self, codes: Codes) -> str:
        """Trajectories (series, frames), each as its first number and the differences after it (modulo 2¹⁶)."""
        return self.add(_planes(np.diff(codes, axis=1, prepend=np.zeros((len(codes), 1), np.int16))))


def _planes(codes: Codes) -> bytes:
    pairs = np.ascontiguousarray(codes, dtype="<i2").view(np.uint8).reshape(-1, 2)
    return pairs[:, 0].tobytes() + pairs[:, 1].tobytes()


def coded(values: Numbers, low: Numbers, high: Numbers) -> Codes:
    """Codes of finite ``values`` between ``low`` and ``high`` (which broadcast); values beyond a bound are at the bound."""
    share = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.round(share * (2 * LARGEST_CODE) - LARGEST_CODE).astype(np.int16)


def decoded(codes: Codes, low: Numbers, high: Numbers) -> Numbers:
    """The values of codes, within half a step of :func:`resolution`."""
    result: Numbers = (codes.astype(np.float64) + LARGEST_CODE) / (2 * LARGEST_CODE) * (high - low) + low
    return result


def resolution(low: Numbers, high: Numbers) -> float:
    """The largest step between two codes."""
    return float((high - low).max() / (2 * LARGEST_CODE))


def turns(quaternions: Numbers) -> Codes:
    """Codes of unit quaternions (frames, bodies, 4), each of the sign that is nearest to the one before it."""
    same = np.einsum("tbi,tbi->tb", quaternions[1:], quaternions[:-1]) >= 0.0
    sign = np.cumprod(np.where(same, 1.0, -1.0), axis=0)
    followed = quaternions.copy()
    followed[1:] *= sign[..., None]
    return np.round(np.clip(followed, -1.0, 1.0) * LARGEST_CODE).astype(np.int16)


# Frames: the recorded times that a page shows, and the box of its positions.

Rows = NDArray[np.int64]

MOST_NUMBERS = 350_000
"""Numbers (three of a position, four of a turn) that the playback of one run has: about 0.1 MB packed."""
FEWEST_FRAMES, MOST_FRAMES = 200, 2000
COARSEST = 1 / 400
"""Largest step of packed positions, of the radius of what is looked at: beyond, it would be seen."""
FARTHEST = 1e9
"""Distance from the origin (m) beyond which nothing is drawn: single precision, which pictures are drawn in, ends before."""
USUAL = (5.0, 95.0)
"""Percentiles of the positions that the camera looks at, and that the box is limited by: a run may throw a body far away."""


@dataclass(frozen=True)
class ShownFrames:
    """The rows that are shown, of some runs of one world.

    ``rows``: of the longest run; a run that ended early has the first ``shown[k]`` of them. ``low`` and ``high`` (3,): the
    box of all positions (m). ``centre`` (3,) and ``radius`` (m): the ball that most of what moves is in. ``every``: the
    distance of the rows. ``beyond``: whether bodies leave the box, and are drawn at its edge.
    """

    rows: Rows
    shown: tuple[int, ...]
    time: Numbers
    low: Numbers
    high: Numbers
    centre: Numbers
    radius: float
    every: int
    beyond: bool

    @property
    def step(self) -> float:
        """The largest step between two packed positions (m)."""
        return resolution(self.low, self.high)


def choose_frames(world: World, runs: Sequence[Run]) -> ShownFrames:
    """The frames of some runs of ``world`` that recorded anything: evenly spaced, with the first and the last."""
    usable = [_rows_to_draw(run) for run in runs]
    longest = int(np.argmax(usable))
    count = usable[longest]
    moving = moving_bodies(world)
    numbers = sum(3 if turns_unseen(world, int(body)) else 7 for body in moving)
    most = int(np.clip(MOST_NUMBERS // max(1, numbers), FEWEST_FRAMES, MOST_FRAMES))
    every = max(1, -(-(count - 1) // (most - 1)))
    rows = np.arange(0, count, every)
    if rows[-1] != count - 1:
        rows = np.append(rows, count - 1)
    shown = tuple(int(np.searchsorted(rows, number)) for number in usable)
    everywhere = [run.arrays["pose"][rows[:number], :, :3] for run, number in zip(runs, shown, strict=True)]
    low, high, centre, radius, beyond = box_of(world, everywhere, moving)
    time = np.asarray(runs[longest].time[rows], dtype=np.float64)
    return ShownFrames(rows, shown, time, low, high, centre, radius, every, beyond)


def _rows_to_draw(run: Run) -> int:
    """The rows before the first that cannot be drawn; at least one."""
    poses = run.arrays["pose"]
    for part in parts(len(poses), 2 * poses[:1].nbytes, poses):
        drawn = drawable(poses[part])
        if not drawn.all():
            first: int = part.start + int(drawn.argmin())
            return max(1, first)
    return len(poses)


def drawable(poses: Numbers) -> NDArray[np.bool_]:
    """Which rows of poses (rows, bodies, 7) can be drawn: all numbers are finite, and no body is beyond ``FARTHEST``."""
    return np.asarray((np.abs(poses) < FARTHEST).all(axis=(1, 2)), dtype=np.bool_)


def turns_unseen(world: World, body: int) -> bool:
    """Whether a turn of a body is invisible: all its shapes are balls about its origin."""
    shapes = world.bodies[body].shapes
    return all(shape.kind == "sphere" and not any(shape.pose.position) for shape in shapes)


def box_of(world: World, everywhere: Sequence[Numbers], moving: Rows) -> tuple[Numbers, Numbers, Numbers, float, bool]:
    """The box of all positions, what the camera looks at, and whether the box had to be limited."""
    margin = 1e-6
    of_moving = np.concatenate([_clean(values[:, moving].reshape(-1, 3)) for values in everywhere])
    of_all = np.concatenate([_clean(values.reshape(-1, 3)) for values in everywhere])
    if not len(of_all):
        of_all = np.zeros((1, 3))  # nothing can be drawn
    if not len(of_moving):
        of_moving = of_all
    first, last = np.percentile(of_moving, USUAL, axis=0)
    size = max((_reach(world, int(body)) for body in moving), default=0.0)
    centre = 0.5 * (first + last)
    radius = float(0.5 * np.linalg.norm(last - first) + size) or 1.0
    low, high = of_all.min(axis=0) - margin, of_all.max(axis=0) + margin
    beyond = resolution(low, high) > COARSEST * radius
    if beyond:
        reach = COARSEST * radius * 32767
        low, high = np.maximum(low, centre - reach), np.minimum(high, centre + reach)
        low = np.minimum(low, high - margin)  # where all of it is on one side of the centre
    return low, high, centre, radius, beyond


def _clean(values: Numbers) -> Numbers:
    return values[(np.abs(values) < FARTHEST).all(axis=1)]


def _reach(world: World, body: int) -> float:
    """How far (m) a body's shapes reach from its origin, roughly: enough for a camera."""
    reaches = [
        max(map(abs, shape.pose.position)) + max(map(abs, shape.size), default=0.0)
        for shape in world.bodies[body].shapes
    ]
    return min(max(reaches, default=0.0), FARTHEST)
