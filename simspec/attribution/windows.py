"""Teacher-forced windows: both sides begin every window in a state of the first side's run, so that what they differ by at its
end has no chaos and no history in it.

The gap of a body in a window is √(Δx² + (ρ Δα)²): Δx the distance of the two positions of the body frame (m), Δα the angle
between the two orientations (rad), ρ the body's radius of gyration (m). The gap of a window is the sum over the bodies, so that
what moves one body by little shows next to one that moves another by much.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.attribution.configuration import Asking, Configuration, Floats, run_operation, windows_operation
from simspec.engines.kit.process import Answer, Operation
from simspec.errors import EngineError, Problem, SpecError
from simspec.world.kinematics import layout_of
from simspec.world.rotations import rotation_error
from simspec.world.types import World

LENGTH = Fraction(1, 100)
"""s of a window at least: so short that nothing grows that is not there, so long that an impact shows in positions."""
LONGEST = Fraction(1, 5)
"""s of a window at most, where the two timesteps have no common multiple before."""
MOST_WINDOWS = 240
"""Windows that are looked at unless the caller says otherwise."""
MOST_ROWS = 4_000_000
"""Rows times bodies of the recording that windows are taken from; beyond, contacts are looked at less often than each step."""
CLASSES = ("free", "impact", "contact")
"""free: no contact in it; impact: bodies touch that did not touch in the window before; contact: all touching bodies touched
before."""
ALL = "all"


@dataclass(frozen=True)
class Windows:
    """Windows of a run: states q (k, nq), v (k, nv) at their beginnings, in the coordinates of ``world``; ``numbers`` (k): each
    begins after so many lengths of a window; ``kinds`` (k): index into ``CLASSES``; ``counts``: how many windows of each class
    the run has, of which these are a sample; ``before``: states a window's length earlier (of the first window: its own)."""

    world: World
    length: Fraction
    numbers: NDArray[np.int64]
    q: Floats
    v: Floats
    kinds: NDArray[np.int64]
    counts: Mapping[str, int]
    before: tuple[Floats, Floats]

    def __repr__(self) -> str:
        return f"<Windows: {len(self.numbers)} of {float(self.length):g} s>"

    def rows(self, run: Answer, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """The rows (k,) of the run that the windows are of, at the beginnings of windows of these numbers (k)."""
        rows: NDArray[np.int64] = numbers * (
            self.steps(self.world) // int(run.arrays["step"][1] - run.arrays["step"][0])
        )
        return rows

    def steps(self, world: World) -> int:
        """Steps of ``world`` in a window. Raises SpecError where that is no whole number."""
        steps = self.length / exact(world.physics.timestep)
        if steps.denominator != 1:
            raise SpecError(
                [Problem(f"a window of {float(self.length):g} s is not a whole number of its steps", code="R105")]
            )
        return steps.numerator

    def only(self, kept: NDArray[np.bool_]) -> Windows:
        """Those of the windows (k,) that are kept; the others stand for nothing."""
        before = self.before[0][kept], self.before[1][kept]
        return replace(
            self, numbers=self.numbers[kept], q=self.q[kept], v=self.v[kept], kinds=self.kinds[kept], before=before
        )

    def counted(self, quiet: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The windows (k,) that count: the ``quiet`` ones (k,); where a class has none of these, all of its windows."""
        counted = quiet.copy()
        for index in range(len(CLASSES)):
            inside = self.kinds == index
            if not (inside & quiet).any():
                counted |= inside
        return counted

    def weights(self, quiet: NDArray[np.bool_]) -> dict[str, float]:
        """The share of the run that the windows of each class stand for; ``quiet`` as in :meth:`counted`."""
        counted = self.counted(quiet)
        weights = {}
        for index, name in enumerate(CLASSES):
            inside = self.kinds == index
            if inside.any():
                weights[name] = self.counts[name] * float((inside & counted).sum()) / float(inside.sum())
        whole = sum(weights.values())
        return {name: weight / whole for name, weight in weights.items()}

    def means(self, gaps: Floats, quiet: NDArray[np.bool_]) -> dict[str, Any]:
        """The mean of something for each window (k, ...) by class, and over all, each class with the weight it has in the run;
        ``quiet`` as in :meth:`counted`."""
        counted = self.counted(quiet)
        weights = self.weights(quiet)
        means = {name: gaps[(self.kinds == CLASSES.index(name)) & counted].mean(axis=0) for name in weights}
        return {**means, ALL: sum(weights[name] * mean for name, mean in means.items())}


def exact(timestep: float) -> Fraction:
    """A timestep as the fraction that was meant: 1/240, not its nearest double."""
    near = Fraction(timestep).limit_denominator(1_000_000)
    return near if math.isclose(near, timestep, rel_tol=1e-12) else Fraction(timestep)


def window_length(worlds: Sequence[World], duration: Fraction) -> Fraction:
    """The length of a window: a whole number of steps of all worlds. Raises SpecError where there is none."""
    steps = [exact(world.physics.timestep) for world in worlds]
    common = steps[0]
    for step in steps[1:]:
        numerator = math.lcm(common.numerator * step.denominator, step.numerator * common.denominator)
        common = Fraction(numerator, common.denominator * step.denominator)
    if common > max(LONGEST, *steps) or common > duration:
        text = " and ".join(f"{world.physics.timestep:g} s" for world in worlds)
        allowed = f"timesteps with a common multiple of at most {float(min(max(LONGEST, *steps), duration)):g} s"
        raise SpecError(
            [Problem("there is no window that both can step through", found=text, allowed=allowed, code="R105")]
        )
    most = math.floor(duration / common)
    return common * min(max(1, math.ceil(LENGTH / common)), most)


def take_windows(
    first: Configuration, second: Configuration, asking: Asking, most: int = MOST_WINDOWS
) -> tuple[Windows, Answer]:
    """Windows of a run of ``first``, of which ``second`` may make the same; and that run, with contacts."""
    world = first.world
    timestep = exact(world.physics.timestep)
    worlds = (world, second.world)
    duration = min(exact(world.physics.timestep) * world.physics.steps for world in worlds)
    if duration == 0:
        raise SpecError([Problem("there is no motion to explain: the duration is 0", "physics.duration", code="R106")])
    length = window_length(worlds, duration)
    steps = (length / timestep).numerator
    count = math.floor(duration / length)
    every = _every(steps, count * steps * len(world.bodies))
    (answer,) = asking.ask(first, run_operation(first, count * steps, every, ["contacts"]))
    if answer.result["failed"] is not None:
        failed = answer.result["failed"]
        count = min(count, int(failed["step"]) // steps)
        if not count:
            raise EngineError(first.engine, f"the state is not finite after step {failed['step']}")
    kinds = _kinds(answer, count, steps // every)
    chosen = _sample(kinds, most)
    rows = chosen * (steps // every)
    arrays = answer.arrays
    counts = {name: int((kinds == index).sum()) for index, name in enumerate(CLASSES)}
    earlier = np.maximum(chosen - 1, 0) * (steps // every)
    states, before = ((arrays["q"][at], arrays["v"][at]) for at in (rows, earlier))
    windows = Windows(world, length, chosen, *states, kinds[chosen], counts, before)
    return windows, answer


def _every(steps: int, work: int) -> int:
    """How often the run is recorded: every step, or so rarely that it has not too many rows; a divisor of a window's steps."""
    least = -(-work // MOST_ROWS)
    return next((every for every in range(1, steps + 1) if steps % every == 0 and every >= least), steps)


def touching_pairs(arrays: Mapping[str, np.ndarray]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows (n,) and pairs of bodies (n, 2; the smaller index first) of the contacts that overlap or press."""
    acting = (arrays["contact.normal_force"] > 0.0) | (arrays["contact.distance"] <= 0.0)
    pairs = np.sort(arrays["contact.body"].astype(np.int64), axis=1)[acting]
    return arrays["contact.row"].astype(np.int64)[acting], pairs


def _kinds(answer: Answer, count: int, rows: int) -> NDArray[np.int64]:
    """The class (count,) of each window of ``rows`` rows."""
    row, pairs = touching_pairs(answer.arrays)
    window = (row - 1) // rows  # a row has the contacts of the step before it
    kinds = np.full(count, CLASSES.index("free"), dtype=np.int64)
    keys = pairs[:, 0] * answer.arrays["pose"].shape[1] + pairs[:, 1]
    before: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
    ends = np.searchsorted(window, np.arange(count + 1))
    for number in range(count):
        touching = np.unique(keys[ends[number] : ends[number + 1]])
        if len(touching):
            new = not np.isin(touching, before).all()
            kinds[number] = CLASSES.index("impact" if new else "contact")
        before = touching
    return kinds


def _sample(kinds: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """The numbers of at most ``most`` windows, spread evenly over each class; impacts, the rarest, are thinned out last."""
    left = {index: np.flatnonzero(kinds == index) for index in range(len(CLASSES))}
    chosen: list[NDArray[np.int64]] = []
    for place, index in enumerate(sorted(left, key=lambda entry: len(left[entry]))):
        share = (most - sum(map(len, chosen))) // (len(CLASSES) - place)
        numbers = left[index]
        if len(numbers) > share:
            numbers = numbers[np.linspace(0, len(numbers) - 1, max(1, share)).round().astype(np.int64)]
        chosen.append(numbers)
    return np.sort(np.concatenate(chosen))


def map_states(source: World, target: World, q: Floats, v: Floats) -> tuple[Floats, Floats]:
    """States (..., nq), (..., nv) of one world in the order of another's bodies."""
    if [body.name for body in source.bodies] == [body.name for body in target.bodies]:
        return q, v
    theirs, ours = layout_of(source), layout_of(target)
    at = {body.name: index for index, body in enumerate(source.bodies)}
    new_q, new_v = np.empty_like(q), np.empty_like(v)
    for index, body in enumerate(target.bodies):
        new_q[..., ours.position[index]] = q[..., theirs.position[at[body.name]]]
        new_v[..., ours.velocity[index]] = v[..., theirs.velocity[at[body.name]]]
    return new_q, new_v


def ordered_poses(world: World, target: World, pose: Floats) -> Floats:
    """Poses (..., bodies, 7) of one world in the order of another's bodies."""
    at = {body.name: index for index, body in enumerate(world.bodies)}
    return pose[..., [at[body.name] for body in target.bodies], :]


def question(configuration: Configuration, windows: Windows, states: tuple[Floats, Floats] | None = None) -> Operation:
    """The windows, as a request to a configuration. ``states``: others to begin in."""
    q, v = map_states(windows.world, configuration.world, *(states or (windows.q, windows.v)))
    steps = windows.steps(configuration.world)
    before = map_states(windows.world, configuration.world, *windows.before)
    return windows_operation(configuration, q, v, (windows.numbers * steps).tolist(), steps, before=before)


def ends(configuration: Configuration, windows: Windows, answer: Answer) -> Floats:
    """Poses (k, bodies, 7) at the ends of the windows, in the order of the windows' world. Raises EngineError where one is not
    finite."""
    pose = poses_at_ends(configuration, windows, answer)
    if not np.isfinite(pose).all():
        raise EngineError(configuration.engine, "the state is not finite at the end of a window")
    return pose


def poses_at_ends(configuration: Configuration, windows: Windows, answer: Answer) -> Floats:
    """The same, finite or not."""
    return ordered_poses(configuration.world, windows.world, answer.arrays["pose"])


def gaps(world: World, first: Floats, second: Floats) -> Floats:
    """The gap (k, bodies) between poses (k, bodies, 7), of each body."""
    radii = np.array([_radius(world, index) for index in range(len(world.bodies))])
    distance = np.linalg.norm(first[..., :3] - second[..., :3], axis=-1)
    turn = radii * rotation_error(first[..., 3:], second[..., 3:])
    gap: Floats = np.hypot(distance, turn)
    return gap


def _radius(world: World, index: int) -> float:
    inertial = world.bodies[index].inertial
    return math.sqrt(sum(inertial.inertia[:3]) / (2.0 * inertial.mass)) if inertial.mass > 0.0 else 0.0


# First contact of a run, from the same state in both engines: its bodies, and the first quantity that differs.

SAME = 1e-6
"""Relative difference from which quantities are reported as different."""
QUANTITIES: Mapping[str, str] = {"points": "", "depth": "m", "normal force": "N"}
"""Compared quantities of a contact, in this order, with units."""


@dataclass(frozen=True)
class FirstContact:
    """``bodies``: the pair that touches first in the first side's run; by quantity the values on each side, from the same state
    (None: the pair does not touch there); ``differs``: the first quantity that does, "" where none does."""

    bodies: tuple[str, str]
    quantities: Mapping[str, tuple[float | None, float | None]]
    differs: str


def contact_questions(first: Configuration, second: Configuration, run: Answer) -> list[Operation]:
    """Queries to each side about the first contact of ``run``, which is the first side's: a window up to the row in which
    bodies touch. Empty where none touch, or where the second side's steps do not fit between two rows."""
    row, _ = touching_pairs(run.arrays)
    if not len(row):
        return []
    before = int(row[0]) - 1
    steps = run.arrays["step"]
    timestep = exact(first.world.physics.timestep)
    begin, length = int(steps[before]) * timestep, int(steps[before + 1] - steps[before]) * timestep
    states = (run.arrays["q"][before : before + 1], run.arrays["v"][before : before + 1])
    operations = []
    for side in (first, second):
        start, count = (time / exact(side.world.physics.timestep) for time in (begin, length))
        if start.denominator != 1 or count.denominator != 1:
            return []
        q, v = map_states(first.world, side.world, *states)
        operations.append(windows_operation(side, q, v, [start.numerator], count.numerator, contacts=True))
    return operations


def first_contact(sides: tuple[Configuration, Configuration], answers: Sequence[Answer]) -> FirstContact | None:
    """The first contact, from the answers of both sides to :func:`contact_questions`; None where neither has any."""
    contacts = [_by_pair(side, answer) for side, answer in zip(sides, answers, strict=True)]
    pair = next(iter([*contacts[0], *contacts[1]]), None)
    if pair is None:
        return None
    ours, theirs = (contact.get(pair) for contact in contacts)
    values = {name: (ours[name] if ours else None, theirs[name] if theirs else None) for name in QUANTITIES}
    return FirstContact(pair, values, _differs(values))


def _differs(values: Mapping[str, tuple[float | None, float | None]]) -> str:
    for name, (entry, other) in values.items():
        if entry is None or other is None:
            return "whether they touch"
        if abs(entry - other) > SAME * max(abs(entry), abs(other)):
            return name
    return ""


def _by_pair(side: Configuration, answer: Answer) -> dict[tuple[str, str], dict[str, float]]:
    """Of each pair of bodies that touches: points, largest depth, normal force of all."""
    _, pairs = touching_pairs(answer.arrays)
    acting = (answer.arrays["contact.normal_force"] > 0.0) | (answer.arrays["contact.distance"] <= 0.0)
    depth, force = -answer.arrays["contact.distance"][acting], answer.arrays["contact.normal_force"][acting]
    names = [body.name for body in side.world.bodies]
    found = {}
    unique: NDArray[np.int64] = np.unique(pairs, axis=0)
    for entry, other in unique:
        here = (pairs == (entry, other)).all(axis=1)
        first, second = sorted((names[entry], names[other]))
        found[first, second] = {
            "points": float(here.sum()),
            "depth": float(depth[here].max()),
            "normal force": float(force[here].sum()),
        }
    return found
