"""Two runs at the times that both recorded: their poses and the engines' own noise, looked at block by block."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from simspec.comparison.floor import DEVIATION_BYTES, Floor
from simspec.errors import Problem, SpecError
from simspec.language.vocabulary import TREE_JOINTS
from simspec.mapped import parts, zeros
from simspec.runner import metrics
from simspec.runner.run import Run
from simspec.world.kinematics import layout_of
from simspec.world.types import Inertial, Joint


class Common:
    """Runs ``a`` and ``b`` at their common times, of the bodies ``names``, with the noise ``floors`` of their engines.

    ``rows_a`` and ``rows_b`` (rows,): the rows of each run that are of one time (to half of the smaller timestep). Raises
    SpecError where there is none.
    """

    def __init__(self, a: Run, b: Run, names: Sequence[str], floors: Sequence[Floor]):
        self._runs, self._names = (a, b), list(names)
        self.rows_a, self.rows_b = common_rows(a, b)
        self.rows, self.bodies = len(self.rows_a), len(names)
        self._q = [
            {
                body.joint.name: where
                for body, where in zip(run.world.bodies, layout_of(run.world).position, strict=True)
            }
            for run in self._runs
        ]
        self._floors = []
        for floor in floors:
            run = a if floor.engine == a.engine else b
            self._floors.append((floor, 0.5 * run.world.physics.timestep, self._columns(run)))

    def shared(self) -> str:
        """What there is to say of recorded times that the other run did not record, though it went on: records at rounded
        intervals of two timesteps meet now and then only. Empty where all of one run's are common."""
        end = min(float(run.time[-1]) for run in self._runs) + 0.5 * min(
            run.world.physics.timestep for run in self._runs
        )
        counts = [int(np.searchsorted(run.time, end)) for run in self._runs]
        if self.rows >= min(counts):
            return ""
        return f"{self.rows:,} recorded times are common, of {counts[0]:,} and {counts[1]:,}: these alone are compared"

    def _columns(self, run: Run) -> np.ndarray:
        return np.array([run.index[name] for name in self._names], dtype=np.int64)

    def time(self, rows: slice | np.ndarray) -> np.ndarray:
        """Times (n,) of some of the common rows, s."""
        result: np.ndarray = self._runs[0].time[self.rows_a[rows]]
        return result

    def blocks(self, last: int) -> Iterator[slice]:
        """Blocks of the common rows before ``last``."""
        arrays = [self.rows_a, self.rows_b, self._runs[0].time]
        arrays += [run.arrays["pose"] for run in self._runs]
        arrays += [one for floor, _, _ in self._floors for one in (floor.time, floor.position, floor.angle)]
        return parts(last, 2 * DEVIATION_BYTES * self.bodies, *arrays)

    def poses(self, part: slice) -> tuple[np.ndarray, np.ndarray]:
        """Poses (rows, bodies, 7) of a block, in each run."""
        sides = zip(self._runs, (self.rows_a, self.rows_b), strict=True)
        one, other = (run.arrays["pose"][np.ix_(rows[part], self._columns(run))] for run, rows in sides)
        return one, other

    def joints(self) -> list[Joint]:
        """The hinges, slides and ball joints that both runs have, in the order of the first."""
        kinds = {body.joint.name: body.joint.kind for body in self._runs[1].world.bodies}
        return [
            body.joint
            for body in self._runs[0].world.bodies
            if body.joint.kind in TREE_JOINTS and kinds.get(body.joint.name) == body.joint.kind
        ]

    def coordinates(self, joint: Joint, part: slice) -> tuple[np.ndarray, np.ndarray]:
        """The coordinates (rows, 1), of a ball joint its quaternion (rows, 4), of a block, in each run."""
        sides = zip(self._runs, (self.rows_a, self.rows_b), self._q, strict=True)
        one, other = (run.arrays["q"][rows[part], columns[joint.name]] for run, rows, columns in sides)
        return one, other

    def noise(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The larger of the floors, in position (m) and angle (rad), of each body at a row of its own (bodies,), or, of rows
        (n, 1), of all bodies at each (n, bodies). Zero without floors."""
        largest = [np.zeros(np.broadcast_shapes(np.shape(rows), (self.bodies,))) for _ in range(2)]
        for floor, near, columns in self._floors:
            # the last value before each time
            at = np.clip(np.searchsorted(floor.time, self.time(rows) + near) - 1, 0, None)
            for k, values in enumerate((floor.position, floor.angle)):
                largest[k] = np.maximum(largest[k], values[at, columns])
        return largest[0], largest[1]

    def size(self) -> float:
        """How large the scene is (m): the diagonal of the box about all the places of the bodies in a run, and the size of
        the largest body; the larger of the two runs."""
        low, high = np.full((2, 3), np.inf), np.full((2, 3), -np.inf)
        for part in self.blocks(self.rows):
            for k, poses in enumerate(self.poses(part)):
                places = poses[..., :3].reshape(-1, 3)
                places = places[np.isfinite(places).all(axis=1)]
                if len(places):
                    low[k], high[k] = np.minimum(low[k], places.min(axis=0)), np.maximum(high[k], places.max(axis=0))
        return max(self._size(run, low[k], high[k]) for k, run in enumerate(self._runs))

    def _size(self, run: Run, low: np.ndarray, high: np.ndarray) -> float:
        masses = [run.world.bodies[run.index[name]].inertial for name in self._names]
        reach = float(np.linalg.norm(high - low)) if (high >= low).all() else 0.0
        # of a body alone that stays where it is: its own size
        return reach + max((body_size(one) for one in masses if one.mass > 0.0), default=0.0)


def body_size(inertial: Inertial) -> float:
    """About the size (m) of a body with mass: twice its radius of gyration."""
    return 2.0 * math.sqrt(sum(inertial.inertia[:3]) / (2.0 * inertial.mass))


def moving_in_common(a: Run, b: Run) -> list[str]:
    """The names of the bodies that can move in both runs, in the order of the first. Raises SpecError where there are none."""
    for run in (a, b):
        if not run.recorded:
            raise SpecError([Problem(f"{run.label} recorded nothing to compare: {run.failed}")])
    names = [{run.world.bodies[k].name for k in metrics.moving_bodies(run.world)} for run in (a, b)]
    both = [body.name for body in a.world.bodies if body.name in names[0] & names[1]]
    if not both:
        raise SpecError([Problem(f"{a.label} and {b.label} have no moving body in common")])
    return both


def _interval(run: Run) -> float:
    return run.world.record.every_steps * run.world.physics.timestep


def common_rows(a: Run, b: Run) -> tuple[np.ndarray, np.ndarray]:
    """The rows of both runs at equal times (to half of the smaller timestep). Raises SpecError when there are none."""
    near = 0.5 * min(a.world.physics.timestep, b.world.physics.timestep)
    rows_a, rows_b = zeros((len(a.time),), int), zeros((len(a.time),), int)
    count = 0
    for part in parts(len(a.time), 64, a.time, b.time, rows_a, rows_b):
        time = a.time[part]
        at = np.clip(np.searchsorted(b.time, time - near), 0, len(b.time) - 1)
        same = np.flatnonzero(np.abs(b.time[at] - time) <= near)
        end = count + len(same)
        rows_a[count:end], rows_b[count:end] = part.start + same, at[same]
        count = end
    beginning = count and a.time[rows_a[count - 1]] == 0.0
    if not count or (beginning and min(len(a.time), len(b.time)) > 1):
        # initial states are alike by construction: their comparison shows nothing
        but = " but the beginning" if beginning else ""
        told = " / ".join(f"every {_interval(run):g} s at {run.world.physics.timestep:g} s a step" for run in (a, b))
        hint = "a record.every that is a whole number of both timesteps" if beginning else None
        raise SpecError(
            [Problem(f"{a.label} and {b.label} have no recorded time in common{but}", found=told, hint=hint)]
        )
    return rows_a[:count], rows_b[:count]
