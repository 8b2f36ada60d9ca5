"""Records that two runs have in common: times, bodies, and sides of contacts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.comparison.floor import DEVIATION_BYTES, Floor
from simspec.errors import Problem, SpecError
from simspec.files import block_rows, parts, release, zeros
from simspec.language.vocabulary import TREE_JOINTS
from simspec.runner import metrics
from simspec.runner.labels import SEPARATOR, labels_of, shapes_of, side_names
from simspec.runner.run import Run
from simspec.world.kinematics import layout_of
from simspec.world.types import Inertial, Joint

# Times that both runs recorded: poses and noise, block by block.


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
        """Notes on recorded times that the other run did not record, though it went on: records at rounded intervals of two
        timesteps coincide only now and then. Empty where all of one run's are common."""
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
        arrays += [values for floor, _, _ in self._floors for values in (floor.time, floor.position, floor.angle)]
        return parts(last, 2 * DEVIATION_BYTES * self.bodies, *arrays)

    def poses(self, part: slice) -> tuple[np.ndarray, np.ndarray]:
        """Poses (rows, bodies, 7) of a block, in each run."""
        sides = zip(self._runs, (self.rows_a, self.rows_b), strict=True)
        entry, other = (run.arrays["pose"][np.ix_(rows[part], self._columns(run))] for run, rows in sides)
        return entry, other

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
        values, other = (run.arrays["q"][rows[part], columns[joint.name]] for run, rows, columns in sides)
        return values, other

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
        return reach + max((body_size(mass) for mass in masses if mass.mass > 0.0), default=0.0)


def body_size(inertial: Inertial) -> float:
    """About the size (m) of a body with mass: twice its radius of gyration."""
    return 2.0 * math.sqrt(sum(inertial.inertia[:3]) / (2.0 * inertial.mass))


def moving_in_common(a: Run, b: Run) -> list[str]:
    """The names of the bodies that can move in both runs, in the order of the first. Raises SpecError where there are none."""
    for run in (a, b):
        if not run.recorded:
            raise SpecError([Problem(f"{run.label} recorded nothing to compare: {run.failed}", code="R106")])
    names = [{run.world.bodies[k].name for k in metrics.moving_bodies(run.world)} for run in (a, b)]
    both = [body.name for body in a.world.bodies if body.name in names[0] & names[1]]
    if not both:
        raise SpecError([Problem(f"{a.label} and {b.label} have no moving body in common", code="R105")])
    return both


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
        steps = [(run.world.record.every_steps, run.world.physics.timestep) for run in (a, b)]
        text = " / ".join(f"every {every * step:g} s at {step:g} s a step" for every, step in steps)
        hint = "a record.every that is a whole number of both timesteps" if beginning else None
        raise SpecError(
            [
                Problem(
                    f"{a.label} and {b.label} have no recorded time in common{but}", found=text, hint=hint, code="R105"
                )
            ]
        )
    return rows_a[:count], rows_b[:count]


# Sides of contacts that all runs distinguish: shapes, groups of shapes of a body, or bodies where a run did not record shapes.

Element = tuple[str, str]
"""A body, and a shape of it; "" for the body as a whole."""
NAMED = 3
"""Shapes of a group that a name lists; more are counted."""


@dataclass(frozen=True)
class Sides:
    """The sides of contacts of some runs.

    names    what may touch, by number: a body's name where that is all of its shapes, else with the shapes in brackets
    numbers  for each run the number of each of its own sides
    arrays   for each run the array (contacts, 2) of its own sides: ``contact.shape``, or ``contact.body``
    notes    why contacts are matched by less than single shapes, where they are
    """

    names: tuple[str, ...]
    numbers: tuple[NDArray[np.int64], ...]
    arrays: tuple[str, ...]
    notes: tuple[str, ...]


def common_sides(runs: Sequence[Run], by: str = "shape") -> Sides:
    """The finest sides that all ``runs`` tell; ``by``: ``shape``, or ``body`` for bodies alone. Raises ValueError for
    another."""
    if by not in ("shape", "body"):
        raise ValueError(f"contacts are matched by shape or by body, not by {by!r}")
    arrays = tuple(
        "contact.shape" if by == "shape" and ("contact.shape" in run.arrays) else "contact.body" for run in runs
    )
    given = [_sides(run, array) for run, array in zip(runs, arrays, strict=True)]
    above: dict[Element, Element] = {}

    def top(element: Element) -> Element:
        while above.setdefault(element, element) != element:
            element = above[element]
        return element

    for sides in given:
        for first, *others in sides:
            for other in others:
                above[top(other)] = top(first)
            top(first)
    members: dict[Element, list[str]] = {}
    for element in above:
        members.setdefault(top(element), []).append(element[1])
    solid: dict[str, set[str]] = {}
    for run in runs:
        for body in run.world.bodies:
            solid.setdefault(body.name, set()).update(shape.name for shape in body.shapes if shape.collision)
    number = {element: place for place, element in enumerate(members)}
    names = tuple(_name(body, shapes, solid[body]) for (body, _), shapes in members.items())
    numbers = tuple(np.array([number[top(first)] for first, *_ in sides], dtype=np.int64) for sides in given)
    notes = (
        [note for run, array in zip(runs, arrays, strict=True) for note in _notes(run, array)] if by == "shape" else []
    )
    return Sides(names, numbers, arrays, tuple(dict.fromkeys(notes)))


def _sides(run: Run, array: str) -> list[list[Element]]:
    """The elements of each of a run's own sides, by its number in ``array``."""
    if array == "contact.body":
        return [[(body.name, ""), *((body.name, shape.name) for shape in body.shapes)] for body in run.world.bodies]
    body_of = {shape: body for body, shape in shapes_of(run.world)}
    labels = side_names(run.world, labels_of(run.provenance))
    return [[(body_of[shape], shape) for shape in label.split(SEPARATOR)] for label in labels]


def _name(body: str, shapes: Sequence[str], solid: set[str]) -> str:
    if "" in shapes or solid <= set(shapes):
        return body
    listed = ", ".join(shapes[:NAMED])
    return f"{body} ({listed})" if len(shapes) <= NAMED else f"{body} ({listed} and {len(shapes) - NAMED} more)"


def _notes(run: Run, array: str) -> list[str]:
    if array == "contact.body":
        given = any(len(body.shapes) > 1 for body in run.world.bodies)
        why = f"{run.label} does not tell the shapes of contacts: they are matched by bodies"
        return [why] if given and len(run.arrays.get("contact.row", ())) else []
    grouped = {shape for group in labels_of(run.provenance).groups or () for shape in group}
    bodies = ", ".join(dict.fromkeys(body for body, shape in shapes_of(run.world) if shape in grouped))
    why = f"{run.label} does not distinguish some shapes of {bodies} in contact: they are matched together"
    return [why] if grouped else []


# First contacts: of each body, and of pairs that touch in one run only. ``contact.row`` never decreases, so that rows
# of a time are found by bisection.

CONTACT_BYTES = 200
"""Of temporary arrays for each contact."""


def first_touches(runs: Sequence[Run], names: Sequence[str]) -> dict[str, float]:
    """For every body the first time (s) at which any run recorded a contact of it, or of a body of its tree."""
    touched: dict[str, float] = {}
    for run in runs:
        if "contact.row" not in run.arrays:
            continue
        first = _first_rows(run)
        models: dict[str, float] = {}
        for body, row in zip(run.world.bodies, first, strict=True):
            if row >= 0:
                models[body.model] = min(models.get(body.model, np.inf), float(run.time[row]))
        for body in run.world.bodies:
            if body.model in models:
                touched[body.name] = min(touched.get(body.name, np.inf), models[body.model])
    return {name: touched[name] for name in names if name in touched}


def first_contact(runs: Sequence[Run], name: str) -> tuple[str, str] | None:
    """The bodies of the first contact of a body, or of its tree, that any run recorded: a body of the tree, and the other.
    None where there is none."""
    found: list[tuple[float, str, str]] = []
    for run in runs:
        if "contact.row" not in run.arrays:
            continue
        row, sides = run.arrays["contact.row"], run.arrays["contact.body"]
        bodies = run.world.bodies
        inside = np.array([body.model == bodies[run.index[name]].model for body in bodies])
        for part in parts(len(row), CONTACT_BYTES, row, sides):
            pairs = sides[part].astype(np.int64)
            touching = inside[pairs].any(axis=1)
            if touching.any():
                at = int(touching.argmax())
                touching_body, other = pairs[at] if inside[pairs[at][0]] else pairs[at][::-1]
                found.append((float(run.time[row[part][at]]), bodies[touching_body].name, bodies[other].name))
                break
    return min(found)[1:] if found else None


def _first_rows(run: Run) -> np.ndarray:
    """The first row with a contact of each body (bodies,); −1 where there is none."""
    row, body = run.arrays["contact.row"], run.arrays["contact.body"]
    first = np.full(len(run.world.bodies), -1, dtype=np.int64)
    for part in parts(len(row), CONTACT_BYTES, row, body):
        touching = body[part].astype(np.int64).ravel()
        new = np.flatnonzero(first[touching] < 0)
        bodies, place = np.unique(touching[new], return_index=True)
        first[bodies] = row[part][new[place] // 2]
        if (first >= 0).all():
            break
    return first


@dataclass(frozen=True, slots=True)
class FirstContactDifference:
    """The first common time (s) at which other pairs touch in one run than in the other: the pairs that touch in the first
    only,
    and in the second only, by the names of :class:`simspec.comparison.common.Sides`."""

    time: float
    first_only: tuple[tuple[str, str], ...]
    second_only: tuple[tuple[str, str], ...]


def first_difference(common: Common, a: Run, b: Run, by: str = "shape") -> FirstContactDifference | None:
    """The first common time at which other pairs of shapes (or what of them both runs tell) touch in one run than in the other;
    None where the same do at all times, or contacts were not recorded."""
    if "contact.row" not in a.arrays or "contact.row" not in b.arrays:
        return None
    known = common_sides((a, b), by)
    count = len(known.names)
    sides = sides_of((a, b), (common.rows_a, common.rows_b), known)
    first, arrays = 0, [values for side in sides for values in (side.row, side.labels, side.rows)]
    while first < common.rows:
        last = min(common.rows, *(side.until(first) for side in sides))
        values, other = (side.pairs(first, last, count) for side in sides)
        different = np.setxor1d(values, other, assume_unique=True)
        if len(different):
            row = different.min() // count**2
            alone = different[different // count**2 == row]
            of_first = np.isin(alone, values)
            time = float(common.time(np.array([row]))[0])
            only = [
                tuple(sorted(named_pair(known.names, int(pair) % count**2) for pair in chosen))
                for chosen in (alone[of_first], alone[~of_first])
            ]
            return FirstContactDifference(time, only[0], only[1])
        first = last
        for array in arrays:
            release(array)
    return None


def named_pair(names: Sequence[str], number: int) -> tuple[str, str]:
    """The names (sorted) of a pair, from its number: one · names + other."""
    name, other = sorted(names[index] for index in divmod(number, len(names)))
    return name, other


def sides_of(runs: Sequence[Run], rows: Sequence[np.ndarray], known: Sides) -> list[Side]:
    """The contacts of each run at the given rows of it (of common times), by the sides that all tell."""
    sides = zip(runs, rows, known.arrays, known.numbers, strict=True)
    return [Side(run, rows, array, index) for run, rows, array, index in sides]


class Side:
    """The contacts of a run. ``rows``: its rows that are of common times; ``array``: its own sides, ``index``: their
    numbers."""

    def __init__(self, run: Run, rows: np.ndarray, array: str, index: np.ndarray):
        self.row, self.labels = run.arrays["contact.row"], run.arrays[array]
        self.rows, self._index, self._force = rows, index, run.arrays["contact.normal_force"]

    def until(self, first: int) -> int:
        """The end of a block of common rows from ``first`` on: one row, or as many as have no more contacts than a block."""
        last = int(np.searchsorted(self.row, self.rows[first])) + block_rows(CONTACT_BYTES)
        if last >= len(self.row):
            return len(self.rows)
        return max(first + 1, int(np.searchsorted(self.rows, self.row[last])))

    def pairs(self, first: int, last: int, count: int) -> np.ndarray:
        """Touching pairs at the common rows ``first`` … ``last − 1``: each pair once for each row, as the number
        (row · count + one) · count + other; ``count``: how many sides there are."""
        at, pair, _ = self._contacts(first, last, count)
        return np.unique(at * count**2 + pair)

    def forces(self, first: int, last: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Every contact at the common rows ``first`` … ``last − 1``: its common row (n,), its pair as the number
        one · count + other (n,), and its normal force (n,), N."""
        at, pair, chosen = self._contacts(first, last, count)
        return at, pair, self._force[chosen]

    def _contacts(self, first: int, last: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Common row, number of the pair, and place in the run's arrays of every contact, (n,) each."""
        begin, end = np.searchsorted(self.row, [self.rows[first], self.rows[last - 1] + 1])
        row = self.row[begin:end]
        at = first + np.searchsorted(self.rows[first:last], row)
        common = self.rows[at] == row
        pair = np.sort(self._index[self.labels[begin:end].astype(np.int64)], axis=1)
        return at[common], (pair[:, 0] * count + pair[:, 1])[common], begin + np.flatnonzero(common)
