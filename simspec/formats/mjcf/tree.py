"""The written tree: a model of the MJCF language as plain values, which ``templates/mjcf/`` prints in this order.

Frames and units are the language's (m, kg, s, and rad where ``compiler`` says so): a body's frame is in its parent's, a
joint's and a shape's in their body's; quaternions are w x y z; lengths of shapes are halved where the language wants that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from simspec.errors import Problem, UnsupportedError
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.kinematics import rigid_groups
from simspec.world.types import VELOCITY_SIZE, Quaternion, Vector3, World

Value = bool | int | float | str | tuple[float, ...]
Attributes = tuple[tuple[str, Value], ...]
"""Names and values, in the order in which they are printed."""


@dataclass(frozen=True, slots=True)
class MjcfInertial:
    """Mass (kg), centre of mass (m), and principal moments (kg m²) in axes turned by ``orientation``."""

    position: Vector3
    orientation: Quaternion
    mass: float
    moments: Vector3


@dataclass(frozen=True, slots=True)
class MjcfJoint:
    """A joint: ``hinge``, ``slide``, ``ball`` or ``free``."""

    name: str
    type: str
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfMesh:
    """A convex hull: its name, its ``vertices`` (flat, m) as they stand in a file of their own, called ``file``."""

    name: str
    file: str
    vertices: tuple[float, ...]
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfHeightField:
    """A height field: its name, rows and columns, ``size`` (half lengths along x and y, height of the highest point over the
    lowest, base; m), and the ``elevation`` of its points as shares of that height, the row of the greatest y first."""

    name: str
    rows: int
    columns: int
    size: tuple[float, ...]
    elevation: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class MjcfGeom:
    """A shape. ``class_name``: the class of defaults that it takes; empty: its body's. ``mesh``, ``hfield``: the mesh or the
    height field that it is, which has no ``size``."""

    name: str
    type: str
    size: tuple[float, ...]
    position: Vector3
    orientation: Quaternion
    class_name: str = ""
    more: Attributes = ()
    mesh: str = ""
    hfield: str = ""


@dataclass(frozen=True, slots=True)
class MjcfSite:
    """A frame in a body."""

    name: str
    position: Vector3
    orientation: Quaternion


@dataclass(frozen=True, slots=True)
class MjcfBody:
    """A body. ``depth``: how many bodies it stands in; bodies are listed depth first, so that none refers to its parent."""

    name: str
    position: Vector3
    orientation: Quaternion
    depth: int = 0
    inertial: MjcfInertial | None = None
    joints: tuple[MjcfJoint, ...] = ()
    geoms: tuple[MjcfGeom, ...] = ()
    more: Attributes = ()
    sites: tuple[MjcfSite, ...] = ()


@dataclass(frozen=True, slots=True)
class MjcfDefault:
    """Defaults by element. The model's own have no name, and its classes take them over."""

    name: str = ""
    elements: tuple[tuple[str, Attributes], ...] = ()


@dataclass(frozen=True, slots=True)
class MjcfPair:
    """An explicit pair of shapes."""

    geom1: str
    geom2: str
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfExclude:
    """Two bodies whose shapes do not touch."""

    body1: str
    body2: str


@dataclass(frozen=True, slots=True)
class MjcfEquality:
    """A constraint; ``type`` is its element."""

    type: str
    name: str
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfTendon:
    """A fixed tendon: joints by name, each with its coefficient."""

    name: str
    joints: tuple[tuple[str, float], ...]
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfActuator:
    """An actuator of a joint; ``type`` is its element."""

    type: str
    name: str
    joint: str
    more: Attributes = ()


@dataclass(frozen=True, slots=True)
class MjcfKey:
    """A keyframe: the coordinates and velocities of all joints, and the controls of all actuators, in the order of the file."""

    name: str
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    control: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class MjcfModel:
    """One file."""

    name: str
    compiler: Attributes = ()
    option: Attributes = ()
    flags: tuple[tuple[str, bool], ...] = ()
    size: Attributes = ()
    default: MjcfDefault = MjcfDefault()
    classes: tuple[MjcfDefault, ...] = ()
    bodies: tuple[MjcfBody, ...] = ()
    pairs: tuple[MjcfPair, ...] = ()
    excludes: tuple[MjcfExclude, ...] = ()
    actuators: tuple[MjcfActuator, ...] = ()
    keys: tuple[MjcfKey, ...] = ()
    meshes: tuple[MjcfMesh, ...] = ()
    heightfields: tuple[MjcfHeightField, ...] = ()
    equalities: tuple[MjcfEquality, ...] = ()
    tendons: tuple[MjcfTendon, ...] = ()


# Contact: bit masks of shapes, excluded pairs of bodies, and the memory of a step.

Kind = tuple[str, str]
"""The properties that decide which shapes a shape may touch: the collision group of its body, and its material."""

FILTER_BITS = 31
"""Kinds of shapes that ``contype`` and ``conaffinity`` can distinguish (the sign bit left alone)."""


def collision_masks(world: World) -> tuple[dict[Kind, Attributes], list[tuple[str, str]]]:
    """``contype`` and ``conaffinity`` of each kind of shape, and pairs of bodies to exclude where masks do not suffice.

    Two shapes touch when (type1 & affinity2) or (type2 & affinity1). Each class of kinds that must not touch
    some other has a bit of its own as its type, and the bits of all classes that it may touch as its affinity: both
    terms are then the same, and their "or" is exactly the wanted matrix. All that touches everything shares the first bit.

    Raises UnsupportedError where there are more classes than bits, and some shapes of two bodies may touch and others not.
    """
    separate = _separated(world)
    kinds = sorted({(body.collision_group, shape.material) for body in world.bodies for shape in solid_shapes(body)})
    rows = {kind: frozenset(other for other in kinds if separate(kind, other)) for kind in kinds}
    # kinds that keep apart from the same others are one class: they touch each other all or not at all
    classes = sorted({row: kind for kind, row in reversed(rows.items()) if row}.values())
    if not classes:
        return dict.fromkeys(kinds, ()), []
    if len(classes) >= FILTER_BITS:
        return dict.fromkeys(kinds, ()), _separated_bodies(world, rows)
    bit_of_row = {rows[kind]: index for index, kind in enumerate(classes, 1)} | {frozenset(): 0}

    def mask(kind: Kind) -> Attributes:
        # the first bit stands for all that touches everything, and stays set when no such shape is there
        affinity = 1 | sum(1 << bit_of_row[rows[other]] for other in classes if other not in rows[kind])
        return (("contype", 1 << bit_of_row[rows[kind]]), ("conaffinity", affinity))

    return {kind: mask(kind) for kind in kinds}, []


def _separated(world: World) -> Callable[[Kind, Kind], bool]:
    ignored = set(world.contact.ignored_groups)
    passing = {(pair.first, pair.second) for pair in world.contact.pairs if not pair.collide}

    def separate(kind: Kind, other: Kind) -> bool:
        groups, materials = (tuple(sorted(names)) for names in zip(kind, other, strict=True))
        return groups in ignored or materials in passing

    return separate


def _separated_bodies(world: World, rows: Mapping[Kind, frozenset[Kind]]) -> list[tuple[str, str]]:
    """Pairs of bodies none of whose shapes touch; only bodies that keep apart from some kind are looked at."""
    members: dict[frozenset[Kind], list[str]] = {}
    for body in world.bodies:
        kinds = frozenset((body.collision_group, shape.material) for shape in solid_shapes(body))
        if kinds:
            members.setdefault(kinds, []).append(body.name)
    found: list[tuple[str, str]] = []
    for name, names in members.items():
        for other, others in members.items():
            separate = [b in rows[a] for a in name for b in other]
            if not any(separate):
                continue
            pairs = {(min(a, b), max(a, b)) for a in names for b in others if a != b}
            if pairs and not all(separate):
                raise UnsupportedError([_too_many_classes(*min(pairs))])
            found.extend(pairs)
    return sorted(set(found))


def _too_many_classes(first: str, second: str) -> Problem:
    return Problem(
        f"some shapes of {first!r} and {second!r} may touch and others not, and MJCF's masks distinguish only "
        f"{FILTER_BITS - 1} classes of shapes",
        "contact",
        hint="use fewer groups that ignore others and fewer materials that pass through others, or one material for a body",
        code="E104",
    )


# --- memory ---
# ``size memory`` holds the contacts, constraints and solver of one state. The default, 40 (n + 500)² bytes for n velocities, is
# 1.8 GB for 1,000 free bodies whatever may touch. Above MOST_BY_DEFAULT velocities the size is a bound on what a step needs; it
# is reserved, and taken as far as it is used. A state that does not fit is an error of the run. Figures marked *measured* are
# of version 4.0.1 of the reference program (docs/records/scale.md).

MIB: Final = 2**20
MOST_BY_DEFAULT: Final = 2500
"""Velocities; the default for them is 380 MB."""
BASE: Final = 64 * MIB
"""For what does not grow with the contacts: the default of an empty model is 13 MB."""
NEIGHBOURS: Final = 8
"""Contacts of a moving shape, each counted at one of the two: balls that do not overlap, of whatever sizes, have less than 7.5
on average (Kuperberg and Schramm 1994, Average kissing numbers for non-congruent sphere packings)."""
POINTS: Final = {"sphere": 1, "capsule": 2}
"""Points of a contact, by the kind of shape; of other kinds ``MOST_POINTS``."""
MOST_POINTS: Final = 8
"""Of two boxes."""
GROUND_POINTS: Final = 50
"""Of a shape on a height field (``mjMAXCONPAIR`` of the reference program)."""
POINT_BYTES: Final = 700
"""Of a contact (mjContact, 600 bytes in version 4, and its places in lists)."""
ROW_BYTES: Final = 300
"""Of a constraint row in addition to its Jacobian: 14 numbers and their copies for the solver."""
ENTRY_BYTES: Final = 48
"""Of a number of the Jacobian: value and column (12), in the Jacobian, its transpose, and the solver's copies of both."""
PAIR_BYTES: Final = 4
"""Of each two bodies, for the search of what may touch: 4.1 MB for 1,000 balls, 67 MB for 4,096 (measured)."""
FACTOR_ENTRY: Final = 12
"""Bytes of a number of the factor of Newton's Hessian; a full one has n²/2."""
PILE_BYTES: Final = 2000
"""Newton's factor of a pile, over (velocities / 6) ** (5/3): each body of a pile of n, numbered in layers, couples with those
within a layer, n ** (2/3) of them. 1,000 measured, in piles of 216 and 1,000 balls; numbered at random 1,900."""

MOST_FACTOR: Final = 4 * 2**30
"""Bytes that are reserved for that factor at most: a machine refuses to reserve more than it has. A pile of 10,000 balls would
take 4.6 GB; larger systems are solved by other solvers (``solver: cg``), or takes a size of its own (``arena``)."""


def arena_megabytes(world: World, newton: bool = True) -> int | None:
    """MiB of the arena of a world; None where the default is kept. ``newton``: whether the solver is Newton's."""
    moving = [body for body in world.bodies if body.joint.kind != "fixed"]
    velocities = sum(VELOCITY_SIZE[body.joint.kind] for body in moving)
    if velocities <= MOST_BY_DEFAULT:
        return None
    path = _longest_path(world)
    points = _points(world)
    laws = meeting_laws(world).values()
    rows = max((_rows(law.friction, law.torsional_friction, law.rolling_friction) for law in laws), default=0)
    size = BASE + points * (POINT_BYTES + rows * (ROW_BYTES + 2 * path * ENTRY_BYTES))
    others = (
        2 * velocities + 6 * len(world.constraints) + 2 * len(world.sums)
    )  # limits and dry friction of joints, equalities
    size += others * (ROW_BYTES + 2 * path * ENTRY_BYTES)
    size += PAIR_BYTES * (1 + len(world.bodies)) ** 2
    if newton:
        full = FACTOR_ENTRY * velocities * (velocities + 1) / 2
        size += int(min(full, PILE_BYTES * (velocities / 6) ** (5 / 3), MOST_FACTOR))
    return -(-size // MIB)


def _rows(sliding: float, torsional: float, rolling: float) -> int:
    """The most rows of a point, of either cone: a pyramid has two for each direction of friction."""
    if rolling:
        return 10
    if torsional:
        return 6
    return 4 if sliding else 1


def _points(world: World) -> int:
    """A bound on the points of contact."""
    groups = rigid_groups(world)
    ground = any(shape.kind == "heightfield" for body in world.bodies for shape in solid_shapes(body))
    return sum(
        NEIGHBOURS * POINTS.get(shape.kind, MOST_POINTS) + (GROUND_POINTS if ground else 0)
        for body in world.bodies
        if groups[body.name] != "world"
        for shape in solid_shapes(body)
    )


def _longest_path(world: World) -> int:
    """The most velocities on the way from the world to a body; bodies stand behind their parents."""
    found: dict[str, int] = {}
    for body in world.bodies:
        above = 0 if body.joint.parent is None else found[body.joint.parent]
        found[body.name] = above + VELOCITY_SIZE[body.joint.kind]
    return max(found.values(), default=0)
