"""One walk over a ``world.json`` for all engines that are built by calls of their API, and their values in the world's types.

A :class:`Walk` numbers the bodies, the collision shapes and their copies, places each body in the body that moves it, and lists
the pairs that must not touch. An engine's ``building.py`` creates one object of the engine for each row, and derives nothing.
:func:`refuse` raises the EngineErrors that several engines share.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from simspec.engines.kit.arrays import checked_singles
from simspec.engines.kit.world_simulation import positive_definite
from simspec.errors import EngineError
from simspec.formats.world import AxisJoint, FixedJoint, FreeJoint, JsonBody, JsonShape, JsonWorld, ShapeCopy, rows_of
from simspec.world import frames
from simspec.world.hull import HullError, hull_of
from simspec.world.types import Inertial, Pose, Shape, Surface, Vector3

STATIC = -1
"""The row of the world, as a parent, and as the carrier of a body that cannot move."""
HALVED: Final[Mapping[str, tuple[float, ...]]] = {
    "sphere": (1.0,),
    "box": (0.5, 0.5, 0.5),
    "capsule": (1.0, 0.5),
    "cylinder": (1.0, 0.5),
    "ellipsoid": (1.0, 1.0, 1.0),
    "plane": (),
}
"""By kind of shape the factors of the numbers of its size in engines that have halves of edges and lengths."""


@dataclass(frozen=True, slots=True)
class PlacedBody:
    """A body of the document, with the rows of its ``parent`` and of the ``root`` of its tree. ``carrier`` is the row of the
    body whose joint moves its rigid group: its own unless it is fixed to another body, :data:`STATIC` where nothing moves it.
    ``pose`` is its pose in the frame of the carrier, or in the world."""

    row: int
    body: JsonBody
    parent: int
    root: int
    carrier: int
    pose: Pose

    @property
    def moves(self) -> bool:
        return self.carrier != STATIC


@dataclass(frozen=True, slots=True)
class PlacedShape:
    """A collision shape: its ``number`` among all of the document, and its ``place`` among the shapes of its body. ``pose`` is
    in the frame of the body's carrier, or of the body itself where that is static."""

    number: int
    owner: PlacedBody
    place: int
    shape: JsonShape
    pose: Pose


@dataclass(frozen=True, slots=True)
class ShapeUnit:
    """One copy of a collision shape, with the numbers of its layer; ``number`` counts the copies of all shapes."""

    number: int
    of: PlacedShape
    copy: ShapeCopy

    @property
    def kind(self) -> tuple[str, str, int]:
        """(collision group, material, layer): units of equal kind touch the same others, but for excluded bodies."""
        return (self.of.owner.body.group, self.of.shape.material, self.copy.layer)


@dataclass(frozen=True, slots=True)
class Walk:
    """A document in rows. ``excluded``: sorted pairs of rows of bodies that must not touch."""

    document: JsonWorld
    bodies: tuple[PlacedBody, ...]
    shapes: tuple[PlacedShape, ...]
    units: tuple[ShapeUnit, ...]
    excluded: tuple[tuple[int, int], ...]
    _layers: dict[frozenset[str], int] = field(repr=False)
    _ignored: frozenset[frozenset[str]] = field(repr=False)

    @classmethod
    def of(cls, document: JsonWorld) -> Walk:
        rows = rows_of(document.bodies)
        bodies: list[PlacedBody] = []
        for row, body in enumerate(document.bodies):
            parent, pose = rows.parents[row], Pose()
            if isinstance(body.joint, FixedJoint):
                above = Pose() if parent < 0 else bodies[parent].pose
                pose = body.joint.origin if parent < 0 else frames.compose(above, body.joint.origin)
            bodies.append(PlacedBody(row, body, parent, rows.roots[row], rows.groups[row], pose))
        solid = [
            (owner, place, shape) for owner in bodies for place, shape in enumerate(owner.body.shapes) if shape.copies
        ]
        shapes = tuple(
            PlacedShape(
                number, owner, place, shape, frames.compose(owner.pose, shape.pose) if owner.moves else shape.pose
            )
            for number, (owner, place, shape) in enumerate(solid)
        )
        copies = [(shape, copy) for shape in shapes for copy in shape.shape.copies]
        names = {body.name: row for row, body in enumerate(document.bodies)}
        pairs = {(min(names[a], names[b]), max(names[a], names[b])) for a, b in document.excluded.bodies}
        return cls(
            document,
            tuple(bodies),
            shapes,
            tuple(ShapeUnit(number, shape, copy) for number, (shape, copy) in enumerate(copies)),
            tuple(sorted(pairs)),
            {frozenset((name, other)): layer for name, other, layer in document.meets},
            frozenset(frozenset(pair) for pair in document.excluded.groups),
        )

    @property
    def trees(self) -> dict[int, list[int]]:
        """The rows of each tree, by the row of its root."""
        found: dict[int, list[int]] = {}
        for body in self.bodies:
            found.setdefault(body.root, []).append(body.row)
        return found

    @property
    def lightest(self) -> dict[int, int]:
        """By root of each tree whose root cannot move the lightest body with mass that moves."""
        found: dict[int, int] = {}
        for root, rows in self.trees.items():
            moving = [row for row in rows if self.bodies[row].moves and self.bodies[row].body.mass]
            if moving and not self.bodies[root].moves:
                found[root] = min(moving, key=lambda row: self.bodies[row].body.mass)
        return found

    @property
    def single(self) -> list[int]:
        """The rows of the bodies that are trees by themselves and move freely."""
        alone = [rows[0] for rows in self.trees.values() if len(rows) == 1]
        return [row for row in alone if isinstance(self.bodies[row].body.joint, FreeJoint)]

    @property
    def kinds(self) -> tuple[tuple[str, str, int], ...]:
        """The distinct kinds of units, in the order of their first units."""
        return tuple(dict.fromkeys(unit.kind for unit in self.units))

    def meet(self, entry: tuple[str, str, int], other: tuple[str, str, int]) -> bool:
        """Whether units of two kinds touch: in the one layer of their materials, unless their groups ignore each other."""
        layer = self._layers.get(frozenset((entry[1], other[1])), -1)
        return entry[2] == other[2] == layer and frozenset((entry[0], other[0])) not in self._ignored

    def unit_pairs(self) -> np.ndarray:
        """The pairs (n, 2) of numbers of units that may touch, sorted, the smaller first: of different rigid groups of which
        one moves, of kinds that meet, and not of excluded bodies."""
        first, second = np.triu_indices(len(self.units), 1)
        number = {kind: index for index, kind in enumerate(self.kinds)}
        kinds = np.array([number[unit.kind] for unit in self.units], dtype=np.int64)
        carriers = np.array([unit.of.owner.carrier for unit in self.units], dtype=np.int64)
        rows = np.array([unit.of.owner.row for unit in self.units], dtype=np.int64)
        meets = np.array([[self.meet(kind, other) for other in number] for kind in number], dtype=bool)
        kept = carriers[first] != carriers[second]
        first, second = first[kept], second[kept]
        kept = meets[kinds[first], kinds[second]] if len(first) else np.zeros(0, dtype=bool)
        first, second = first[kept], second[kept]
        low, high = np.minimum(rows[first], rows[second]), np.maximum(rows[first], rows[second])
        kept = ~np.isin(low * len(self.bodies) + high, self.excluded_keys())
        return np.stack([first[kept], second[kept]], axis=1)

    def excluded_keys(self) -> np.ndarray:
        """The excluded pairs as sorted numbers (n,): smaller row × bodies + larger row."""
        return np.array([index * len(self.bodies) + other for index, other in self.excluded], dtype=np.int64)


def refuse(
    walk: Walk,
    engine: str,
    *,
    cones: Collection[str] | None = None,
    joints: Collection[str] | None = None,
    shapes: Collection[str] | None = None,
    servos: bool = True,
    moving_planes: bool = True,
    carried_mass: bool = True,
    degenerate_mass: bool = True,
) -> None:
    """Raise EngineError for the first part of a document that ``engine`` does not support.

    ``cones``, ``joints``, ``shapes``: the kinds that it supports (None: all). ``servos``: its own controllers;
    ``moving_planes``: planes on bodies that move; ``carried_mass``: masses of bodies that are fixed to bodies that move;
    ``degenerate_mass``: free bodies without mass, and inertias of bodies that move which have no inverse.
    """
    if cones is not None and walk.document.friction_cone not in cones:
        raise EngineError(engine, f"does not support the friction cone {walk.document.friction_cone}")
    for placed in walk.bodies:
        body, joint = placed.body, placed.body.joint
        servo = isinstance(joint, AxisJoint) and joint.servo is not None
        if joints is not None and joint.kind not in joints:
            raise EngineError(
                engine, f"does not support the {joint.kind} {joint.name!r}" + " and its controller" * servo
            )
        if servo and not servos:
            raise EngineError(engine, f"has no controller of its own, which joint {joint.name!r} has")
        if not carried_mass and placed.carrier not in (STATIC, placed.row) and (body.mass or any(body.inertia)):
            raise EngineError(
                engine, f"does not support the mass of {body.name!r}, which is fixed to a body that moves"
            )
        if not degenerate_mass and placed.moves:
            if isinstance(joint, FreeJoint) and not body.mass > 0.0:
                raise EngineError(engine, f"does not support {body.name!r}, which moves freely and has no mass")
            if body.mass and not positive_definite(body.inertia):
                raise EngineError(engine, f"does not support the inertia of {body.name!r}, which has no inverse")
    for solid in walk.shapes:
        kind, name = solid.shape.kind, solid.shape.name
        if shapes is not None and kind not in shapes:
            raise EngineError(engine, f"does not support the {kind} {name!r}")
        if kind == "plane" and solid.owner.moves and not moving_planes:
            raise EngineError(engine, f"does not support the plane {name!r} on a body that moves")


def surface_numbers(engine: str, unit: ShapeUnit, size: Sequence[float]) -> tuple[float, float]:
    """Friction and restitution of a copy, of an engine in single precision whose shapes have no other numbers. ``size``: the
    shape's as the engine receives it. Raises EngineError where a part of it is 0, and for numbers that the engine does not
    have."""
    shape, copy = unit.of.shape, unit.copy
    if shape.kind != "mesh" and not all(edge > 0.0 for edge in size):
        raise EngineError(engine, f"has no {shape.kind} of the size {min(shape.size)!r} ({shape.name})")
    friction, restitution = checked_singles(engine, (copy.friction, copy.restitution), f"numbers of {shape.name}")
    if friction < 0.0 or not 0.0 <= restitution <= 1.0:
        raise EngineError(engine, f"does not support the numbers of {shape.name!r}: {friction:g} and {restitution:g}")
    if copy.torsional_friction or copy.rolling_friction or copy.hardness is not None:
        raise EngineError(engine, f"does not support more than friction and restitution of {shape.name!r}")
    return friction, restitution


def hull_triangles(engine: str, name: str, size: Sequence[float]) -> np.ndarray:
    """The triangles (n, 3) of the convex hull ``name`` (flat vertices). Raises EngineError where there is none."""
    try:
        return hull_of(size).triangles
    except (HullError, ValueError) as error:
        raise EngineError(engine, f"has no hull {name!r}: {error}") from error
    except ImportError as error:
        raise EngineError(engine, f"meshes need scipy: {error}") from error


# Read-back: values of engines' APIs in the types of the world.


def vector(values: Any) -> Vector3:
    """Three numbers, without negative zeros."""
    x, y, z = np.asarray(values, dtype=float).tolist()
    return (x + 0.0, y + 0.0, z + 0.0)


def pose_of(position: Any, rotation: np.ndarray) -> Pose:
    """A pose of a position and a rotation matrix (3, 3)."""
    return Pose(vector(position), frames.from_matrix(tuple(map(tuple, rotation.tolist()))))  # type: ignore[arg-type]


def inertial_of(mass: float, centre: Any, moments: np.ndarray) -> Inertial:
    """Mass properties with the moments (3, 3) about the centre of mass."""
    m = np.asarray(moments).tolist()
    return Inertial(float(mass), vector(centre), (m[0][0], m[1][1], m[2][2], m[0][1], m[0][2], m[1][2]))


def bound(value: float) -> float | None:
    """A limit, None where it is infinite."""
    return float(value) if math.isfinite(value) else None


def range_of(lower: float, upper: float) -> tuple[float, float] | None:
    """The limits of a position, None where both are infinite."""
    return (float(lower), float(upper)) if math.isfinite(lower) or math.isfinite(upper) else None


def shape_of_copies(
    engine: str, visual: Shape, forms: Sequence[tuple[str, tuple[float, ...], Pose]], surfaces: Sequence[Surface]
) -> Shape:
    """A collision shape as an engine stores its copies, each with kind, size and pose; ``visual`` is the visual part of the
    file. Raises EngineError where the copies differ."""
    if any(form != forms[0] for form in forms):
        raise EngineError(engine, f"holds copies of {visual.name!r} that differ")
    kind, size, pose = forms[0]
    return dataclasses.replace(visual, kind=kind, size=size, pose=pose, collision=True, surfaces=tuple(surfaces))


def alike(first: Shape, second: Shape) -> bool:
    return (first.kind, first.size, first.pose) == (second.kind, second.size, second.pose)


def merged(shapes: Iterable[Shape], same: Callable[[Shape, Shape], bool] = alike) -> list[Shape]:
    """Shapes of one name: those that are the ``same`` are one, with the surfaces of its copies and the colour of the visual."""
    kept: list[Shape] = []
    for shape in shapes:
        row = next((row for row, other in enumerate(kept) if same(other, shape)), None)
        if row is None:
            kept.append(shape)
            continue
        other = kept[row]
        kept[row] = dataclasses.replace(
            other,
            collision=other.collision or shape.collision,
            visual=other.visual or shape.visual,
            colour=(other if other.visual else shape).colour,
            surfaces=other.surfaces + shape.surfaces,
        )
    return kept
