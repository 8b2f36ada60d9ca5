"""One check of a proof: how often two things were compared, how closely they agree, and where they differ most."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from simspec.engines.kit.capabilities import DOUBLE, ROUNDING, SINGLE
from simspec.engines.kit.process import Operation
from simspec.language.vocabulary import LAW_QUANTITIES
from simspec.world import frames
from simspec.world.hull import hull_of, mesh_vertices
from simspec.world.shapes import SHAPES, Field, Round, field_of
from simspec.world.types import EngineValue, PairContact, Quaternion, Shape, World

TEXT_TOLERANCE = 1e-12
"""L0: numbers are printed to round-trip; left is the way from a tensor to principal axes and back, whose largest moment may
be clipped by 2⁻⁴⁰ ≈ 9e-13 (``world/inertia.py``), and frames composed and undone (a few last bits)."""
MODEL_TOLERANCE = 1e-9
"""L1 to L4: engines keep doubles, but diagonalise inertias, shift frames and invert matrices; all stay below 1e-10 when they
receive the same model (measured), while the smallest real error of a model, a digit lost in printing, is 1e-7."""


TOO_CHAOTIC = "its contact-free motion is too chaotic"
"""How the reason begins for which a motion is there and not compared; it stands in the verdict."""
NOTHING = "nothing was compared"
"""Name of the failed check that stands for a level, or a part of one, that the world has and that was not compared."""


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
    """Comparisons that a proof must contain: ``count``, ``least`` of them at least, within ``tolerance`` at most."""

    count: int
    least: int
    tolerance: float


Demands = dict[Part, Demand]


class MotionPlan(Protocol):
    """A motion that engines repeat, and what must come of it."""

    def operation(self, world: World) -> Operation | None:
        """The operation for an engine; None where nothing can be compared."""

    def demands(self) -> Demands:
        """The comparisons that a proof must contain."""

    def checks(self, world: World, answer: Mapping[str, np.ndarray], creep: float = 0.0) -> list[Check]:
        """The answer against the plan; ``creep``: the speed (m/s, rad/s) that the engine's solver is declared to leave joints
        that dry friction holds (``Engine.DRY_FRICTION_CREEP``)."""


OTHERS = 10.0
"""Times a deviation of the oracle's method from the exact motion that another method's may be: methods of first order with
an implicit Coriolis force deviated 1 to 4 times as much (measured in two engines)."""
LEEWAY = 4.0
"""How much larger than planned a round-off floor may be when a stored proof is judged: the floor is the worst of four disturbed
runs, and another machine's last bits give another worst."""


def failed(level: str, name: str, detail: str) -> Check:
    """A check that could not be made at all, and so has failed."""
    return Check(level, name, 0, 0.0, None, "", detail)


# Tolerances of an engine, by the numbers that it computes with (``Engine.PRECISION``), never by the engine.
#
# Values that are read back are as near as numbers of that length are. Motion is as near as a world's own floor: the oracle
# run again, disturbed as such numbers disturb it. Of doubles the beginning alone is, by the last bits, and the tolerance is
# 100 times what that makes. In single precision each step's rounding counts, so that the oracle's state is rounded after
# every step: the error of other operations (rotations, sums) is then a few times that floor and not a hundred. Of 14
# free bodies with random tensors that turn at 0.5 and 2.8 rad/s for 2,000 steps of 1 ms, an engine of single precision was
# off by 0.9 to 3.5 times the floor (measured), which is 4e-6 to 2e-5.

OF_LOOPS = 10.0
"""Rows of constraints that close loops are redundant, or nearly so, and engines that solve them by iteration end at their own
tolerance: one is 1.0e-9 off in a gripper of two four-bars and 1.3e-9 in a biped whose shins are loops (measured), where mass
matrix and bias force agree to 1e-15."""
Rounded = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, slots=True)
class Precision:
    """``name`` as engines declare it. ``model``: tolerance of levels L1 to L4, relative to each quantity's own scale.
    ``motion``: the least tolerance of L6 and L7; ``factor``: of the floor, where that is larger; ``loosest``: up to which
    tolerance motion is compared. ``perturbation``: relative change of a beginning (0: none, and every step is disturbed).
    ``sliding``: the least tolerance of what dry friction makes of a speed. ``order``: of the engine's method of integration; 0:
    semi-implicit Euler, as the oracle's."""

    name: str
    model: float
    motion: float
    factor: float
    loosest: float
    perturbation: float
    sliding: float
    order: int = 0

    def tolerance(self, floor: float) -> float:
        """Of a motion with a round-off floor."""
        return max(self.motion, self.factor * floor)

    def of_order(self, order: int) -> Precision:
        """The same numbers by a method of another order."""
        return replace(self, order=order)

    def of_loops(self) -> Precision:
        """For motion (L6) of a world in which constraints close loops: in doubles the least tolerance is larger."""
        return replace(self, motion=OF_LOOPS * self.motion) if self.name == DOUBLE else self

    def beginning(self, state: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        """A state from which a disturbed motion begins."""
        if not self.perturbation:
            return state
        return state * (1.0 + self.perturbation * generator.choice([-1.0, 1.0], len(state)))

    def rounding(self, run: int, generator: np.random.Generator) -> Rounded | None:
        """The rounding of the oracle's states after every step of a disturbed ``run`` (0, 1, …): in the first the nearest
        numbers of this precision, in others numbers that are off by anything that these may be. None: no rounding."""
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
    # 32 roundings: engines of single precision that receive the same model keep it to 1e-7 to 3e-7 (masses, tensors, poses,
    # mass matrices, measured in two), while what must be caught is 1e-5 off
    SINGLE: Precision(SINGLE, model=2e-6, motion=2e-6, factor=10.0, loosest=1e-3, perturbation=0.0, sliding=1e-5),
}

INVENTORY_LEVEL, INVENTORY = "L4", "everything else held"
"""Level and name of the check of ``ReadBack.inventory``."""


def inventory_checks(
    expected: Mapping[str, EngineValue], actual: Mapping[str, EngineValue], precision: Precision = PRECISIONS[DOUBLE]
) -> list[Check]:
    """Everything else that an engine holds, name by name, against what it must hold; none where neither has a name.

    A name that only one side has differs in kind, as do words, flags and lengths of lists. Numbers are relative to themselves,
    small ones to ``SMALL_SHARE`` of the largest of their list.
    """
    tally = Tally()
    for name in sorted(expected.keys() | actual.keys()):
        both = name in actual and name in expected
        deviation = value_difference(expected[name], actual[name]) if both else None
        wanted = repr(expected[name]) if name in expected else "absent"
        detail = f"{name} is {actual[name]!r}, should be {wanted}" if name in actual else f"{name} is missing"
        tally.add(INVENTORY_LEVEL, INVENTORY, precision.model, deviation, name, "" if deviation == 0.0 else detail)
    return tally.checks()


# Distances of two values of a model: numbers, vectors, orientations, poses of shapes, values of an inventory, height
# fields, hulls, and tables of contact laws.

Array = NDArray[np.float64]
KEPT = 64
"""Height fields, and hulls, whose samples and directions are cached."""
SMALL_SHARE = 1e-6
"""Share of the largest number of a list below which another is held to that share, not to itself: a zero with round-off must
not fail, a small number must not hide."""
HALF_TURNS: tuple[Quaternion, ...] = ((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
"""By half a turn about its x, y and z axis; all leave a box and an ellipsoid as they are."""


def distance(a: Sequence[float], b: Sequence[float], scale: float = 1.0) -> float:
    """The length of a − b in units of ``scale``; None-safe callers check lengths first."""
    return math.dist(a, b) / scale


def turn_between(a: Quaternion, b: Quaternion) -> float:
    """The angle (rad) between two orientations: 2 |sin(angle/2)|, exact for small angles, at most 2."""
    _, x, y, z = frames.multiply(frames.conjugate(a), b)
    return 2.0 * math.sqrt(x * x + y * y + z * z)


def relative(expected: float, actual: float) -> float:
    """|found − expected| relative to the larger of both; 0 when both are 0."""
    largest = max(abs(expected), abs(actual))
    # with a zero, max() passes a NaN over: the difference has it
    return abs(actual - expected) / (largest or 1.0)


def value_difference(expected: object, actual: object) -> float | None:
    """The distance of two values: relative for numbers; else 0 when they are the same and None when they are not."""
    if isinstance(expected, (list, tuple)) != isinstance(actual, (list, tuple)):
        return None
    values: Sequence[object] = expected if isinstance(expected, (list, tuple)) else (expected,)
    actual_values: Sequence[object] = actual if isinstance(actual, (list, tuple)) else (actual,)
    if len(values) != len(actual_values):
        return None
    scale = max((abs(x) for x in (*values, *actual_values) if _is_number(x)), default=0.0)
    worst = 0.0
    for a, b in zip(values, actual_values, strict=True):
        if _is_number(a) and _is_number(b) and math.isfinite(a) and math.isfinite(b):
            largest = max(abs(a), abs(b), SMALL_SHARE * scale if math.isfinite(scale) else 0.0)
            worst = max(worst, abs(a - b) / largest if largest else 0.0)
        elif a != b or isinstance(a, bool) != isinstance(b, bool):
            return None
    return worst


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def unlikeness(shape: Shape, other: Shape) -> float:
    """How little two shapes of one kind resemble each other, to match shapes without names."""
    away, turned = pose_difference(shape, other)
    if SHAPES[shape.kind].points:
        sizes = distance(_bounds(shape.size), _bounds(other.size))
    else:
        sizes = distance(shape.size, other.size) if len(shape.size) == len(other.size) else math.inf
    return away + turned + sizes + (0.0 if shape.name == other.name else 1e-6)


def _bounds(points: Sequence[float]) -> tuple[float, ...]:
    """The least and the largest x, y and z of points."""
    columns = [points[axis::3] or (math.inf,) for axis in range(3)]
    return (*map(min, columns), *map(max, columns))


def pose_difference(shape: Shape, other: Shape) -> tuple[float, float]:
    """Metres and radians between two shapes' poses, without what the shape's symmetry makes meaningless."""
    kind = SHAPES[shape.kind]
    if kind.round is not Round.AXIS:
        turned = 0.0
        if kind.round is Round.NONE:
            turns = (frames.IDENTITY, *(HALF_TURNS if kind.upside_down else ()))
            quaternion = shape.pose.quaternion
            turned = min(turn_between(quaternion, frames.multiply(other.pose.quaternion, turn)) for turn in turns)
        return distance(shape.pose.position, other.pose.position), turned
    axis, other_axis = (frames.rotate(member.pose.quaternion, (0.0, 0.0, 1.0)) for member in (shape, other))
    turned = distance(axis, other_axis)
    if kind.upside_down:
        turned = min(turned, distance(axis, tuple(-x for x in other_axis)))
    if not kind.endless:
        return distance(shape.pose.position, other.pose.position), turned
    offset = frames.subtract(other.pose.position, shape.pose.position)
    return abs(frames.dot(axis, offset)), turned


# The distance of two height fields: by the heights of their surfaces, at the points of the grid and within every triangle.
#
# Within each cell one place is looked at in either of its triangles, so that a surface which is split along the other diagonal
# differs there, by a third of what the cell is bent by, though all its points are the same.


def field_distance(wanted: tuple[float, ...], actual: tuple[float, ...]) -> float:
    """The largest difference of two height fields, of heights, lengths or base, as a share of the extent of the first."""
    field, other = field_of(wanted), field_of(actual)
    lengths = max(abs(field.x - other.x), abs(field.y - other.y), abs(field.base - other.base))
    shares, heights = _sampled(wanted)
    value = float(np.abs(surface(other, shares) - heights).max())
    return max(lengths, value) / field.extent


def surface(field: Field, shares: Array) -> Array:
    """The heights (n,) of a field at places (n, 2) within its rectangle, as shares of its lengths from the least x and y."""
    rows, columns = field.shape
    along, across = shares[:, 0] * (columns - 1), shares[:, 1] * (rows - 1)
    column = np.clip(np.floor(along).astype(np.int64), 0, columns - 2)
    row = np.clip(np.floor(across).astype(np.int64), 0, rows - 2)
    u, v = along - column, across - row
    z = field.heights
    low, high = z[row, column], z[row + 1, column + 1]
    where = np.where(u >= v, z[row, column + 1], z[row + 1, column])
    more, less = np.maximum(u, v), np.minimum(u, v)
    made: Array = low + more * (where - low) + less * (high - where)
    return made


@functools.lru_cache(maxsize=KEPT)
def _sampled(size: tuple[float, ...]) -> tuple[Array, Array]:
    """Places (n, 2) in the rectangle, as shares, and the heights (n,) of a field there: its points, and the middle of each
    triangle."""
    field = field_of(size)
    rows, columns = field.shape
    inside = [
        (column + du, row + dv)
        for du, dv in ((2.0 / 3.0, 1.0 / 3.0), (1.0 / 3.0, 2.0 / 3.0))
        for row, column in [np.indices((rows - 1, columns - 1)).reshape(2, -1)]
    ]
    row, column = np.indices((rows, columns)).reshape(2, -1)
    along = np.concatenate([column, *(each[0] for each in inside)]) / (columns - 1)
    across = np.concatenate([row, *(each[1] for each in inside)]) / (rows - 1)
    shares = np.stack([along, across], axis=1)
    return shares, surface(field, shares)


# The distance of two convex hulls: by their support functions, whatever their vertices and faces are called and counted.
#
# The directions are 2,000 spread over the sphere, and those that tell most of the wanted hull: the normals of its faces,
# along which no point of the other may reach further, and at each vertex one along which that vertex alone reaches as far. So
# no vertex is moved unseen, however small the face that it moves.
#
# Where every vertex of each hull is as near to one of the other as is tolerated, their support functions differ by no more
# along any direction at all (the largest difference of the support functions of two convex sets is the largest distance of a
# point of either from the other: Schneider, Convex Bodies, 1.8). Such hulls need no other comparison: where these have 20,000
# vertices, directions times vertices are 10⁹.

DIRECTIONS = 2000
"""Spread over the sphere, at 4.5° from each other."""
AT_ONCE = 65_536
"""Products of a direction and a vertex that are looked at together: they stay in the processor's cache, and are too few for
a BLAS to share among threads, which on a busy machine wait for each other forty times as long as they work (measured)."""


def hull_distance(wanted: tuple[float, ...], actual: tuple[float, ...], tolerated: float = 0.0) -> float:
    """The largest difference of the support functions of two hulls (flat vertices, m) about one origin, as a share of the
    extent of the first; a bound of it, where that is ``tolerated`` at most."""
    bound = _bound(wanted, actual) / extent(wanted)
    if bound <= tolerated:
        return bound
    directions, reach = _directions(wanted)
    return float(np.abs(_support(actual, directions) - reach).max()) / extent(wanted)


def _bound(wanted: tuple[float, ...], actual: tuple[float, ...]) -> float:
    """The largest distance (m) of a vertex of either hull from the nearest of the other; NaN where one has a place that is not
    finite."""
    if wanted == actual:
        return 0.0
    from scipy.spatial import KDTree

    ours, theirs = mesh_vertices(wanted), mesh_vertices(actual)
    if not (np.isfinite(ours).all() and np.isfinite(theirs).all()):
        return math.nan
    there, back = KDTree(theirs).query(ours)[0], KDTree(ours).query(theirs)[0]
    return float(max(there.max(), back.max()))


def extent(size: tuple[float, ...]) -> float:
    """The largest extent (m) of a hull along its frame's axes."""
    return float(np.ptp(mesh_vertices(size), axis=0).max())


def _support(size: tuple[float, ...], directions: Array) -> Array:
    vertices = mesh_vertices(size).T
    step = max(1, AT_ONCE // vertices.shape[1])
    parts = (directions[start : start + step] @ vertices for start in range(0, len(directions), step))
    reach: Array = np.concatenate([part.max(axis=1) for part in parts])
    return reach


@functools.lru_cache(maxsize=KEPT)
def _directions(size: tuple[float, ...]) -> tuple[Array, Array]:
    """The unit vectors (n, 3) along which others are held against a hull, and how far (m) (n,) it reaches along each."""
    hull = hull_of(size)
    at_vertices = np.zeros_like(hull.vertices)
    for corner in range(3):
        np.add.at(at_vertices, hull.triangles[:, corner], hull.normals)
    at_vertices /= np.linalg.norm(at_vertices, axis=1, keepdims=True)
    spread = _spread()
    # along the normal of a face its corners reach farthest, and along a sum of normals of faces at a vertex that vertex: the
    # rest needs no looking at, which would be most of what two hulls cost
    at_faces = np.einsum("fcx,fx->fc", hull.vertices[hull.triangles], hull.normals).max(axis=1)
    at_corners = np.einsum("vx,vx->v", hull.vertices, at_vertices)
    directions = np.concatenate([spread, hull.normals, at_vertices])
    return directions, np.concatenate([_support(size, spread), at_faces, at_corners])


def _spread() -> Array:
    """Unit vectors (n, 3) spread evenly over the sphere: a Fibonacci spiral."""
    index = np.arange(DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * index / DIRECTIONS
    turn = math.pi * (1.0 + math.sqrt(5.0)) * index
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


# A table of the laws of materials, as an engine holds it, against the world's.

Difference = tuple[str, float | None, str, str]
"""The quantity, its deviation (None: of another kind), the place, and the value found."""
HARDNESS_NUMBERS = ("time_constant", "damping_ratio", "stiffness", "damping")


def table_differences(
    laws: Mapping[tuple[str, str], PairContact], table: Sequence[PairContact]
) -> Iterator[Difference]:
    """Differences of a table from the ``laws`` of every two materials that meet, by their sorted names: one row for each, and
    no other rows."""
    names = [(law.first, law.second) for law in table]
    whole = sorted(names) == sorted(laws)  # a pair that is held twice is one too many
    found = "" if whole else f"{sorted(names)}, should be {sorted(laws)}"
    yield "laws of materials", 0.0 if whole else None, "contact.pairs", found
    for contact in table:
        law = laws.get((contact.first, contact.second))
        if law is None:
            continue
        at = f"contact.pairs.{contact.first}.{contact.second}"
        for quantity in LAW_QUANTITIES:
            wanted, actual = getattr(law, quantity), getattr(contact, quantity)
            yield quantity.replace("_", " "), relative(wanted, actual), at, f"{actual!r}, should be {wanted!r}"
        same = (law.collide, law.margin, law.hardness.kind) == (contact.collide, contact.margin, contact.hardness.kind)
        yield "kind of law", 0.0 if same else None, at, "" if same else f"{contact}, should be {law}"
        for name in HARDNESS_NUMBERS:
            wanted, actual = getattr(law.hardness, name), getattr(contact.hardness, name)
            yield "hardness", relative(wanted, actual), at, f"{actual!r}, should be {wanted!r}"
