"""Possible interactions of bodies of two materials in a world: the contact features that it needs, and the coupled probes that
apply.

A demand for something that cannot happen in a world would refuse engines for nothing.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from simspec.language.vocabulary import STATIC_SHAPES
from simspec.world.canonical import derived
from simspec.world.contact_pairs import CollisionFilter, meeting_laws, solid_shapes
from simspec.world.frames import sorted_pair
from simspec.world.kinematics import poses, rigid_groups
from simspec.world.overlap import Solid, bounding_spheres_meet, separation, solid_at
from simspec.world.shapes import SHAPES, Round
from simspec.world.types import Body, Shape, World

# Which bodies may jam between two walls, as a drawer in its slot.
#
# A body that fits between two surfaces and is longer than the distance between them may tilt until it touches both, at two
# different heights. Friction there alone may then press it on, as it presses a clamp onto its post.

MOST_WALLS = 500
"""Pairs of walls that are looked at, those first whose centres are nearest: half a second."""


@dataclasses.dataclass(frozen=True)
class _Slider:
    """A body that moves freely, and its greatest length (m)."""

    body: Body
    long: float

    def fits(self, distance: float) -> bool:
        """Whether it fits between walls at this distance (m), and may touch both."""
        return (
            self.long
            > distance
            >= (2.0 * min(SHAPES[shape.kind].inner_radius(shape.size) for shape in solid_shapes(self.body)))
        )  # of meshes the costly half last


def jamming_materials(
    world: World, free: Iterable[Body], walls: Iterable[Sequence[Body]]
) -> frozenset[tuple[str, str]]:
    """The sorted pairs of materials of a ``free`` body and of two ``walls`` between which it may jam.

    Walls are the solid shapes of bodies that keep their places relative to each other. Height fields are none.
    """
    sliders, places = _sliders(world, free), poses(world)
    if not sliders:
        return frozenset()
    longest = max(slider.long for slider in sliders)
    allowed = CollisionFilter(world)
    found: set[tuple[str, str]] = set()
    for bodies in walls:
        solids = [
            solid_at(body, shape, places[body.name])
            for body in bodies
            for shape in solid_shapes(body)
            if not SHAPES[shape.kind].grid
        ]
        for solid, other in _near(solids, longest):
            distance = separation(solid, other)
            for slider in sliders:
                if not slider.fits(distance):
                    continue
                first, second = (_materials(allowed, slider.body, wall) for wall in (solid, other))
                if first and second:
                    found |= first | second
    return frozenset(found)


def _materials(allowed: CollisionFilter, body: Body, wall: Solid) -> set[tuple[str, str]]:
    """The sorted pairs of materials in which a body may touch a wall."""
    if not allowed.may_touch(body.name, wall.body):
        return set()
    pairs = {sorted_pair(shape.material, wall.shape.material) for shape in solid_shapes(body)}
    return {pair for pair in pairs if allowed.may_materials_touch(*pair)}


def _sliders(world: World, free: Iterable[Body]) -> list[_Slider]:
    """One of all bodies that are alike."""
    special = {name for pair in world.contact.excluded_bodies for name in pair}
    found: dict[object, _Slider] = {}
    for body in free:
        shapes = solid_shapes(body)
        if not shapes or (len(shapes) == 1 and SHAPES[shapes[0].kind].round is Round.EVERY):
            continue  # a ball is as long as it is wide
        alike = (body.collision_group, shapes, body.name if body.name in special else "")
        if alike not in found:
            found[alike] = _Slider(body, _greatest_length(shapes))
    return list(found.values())


def _greatest_length(shapes: Sequence[Shape]) -> float:
    outer = [SHAPES[shape.kind].outer_radius(shape.size) for shape in shapes]
    centres = [np.array(shape.pose.position) for shape in shapes]
    pairs = itertools.combinations(range(len(shapes)), 2)
    between = (float(np.linalg.norm(centres[i] - centres[j])) + outer[i] + outer[j] for i, j in pairs)
    return max((2.0 * max(outer), *between))


def _near(solids: Sequence[Solid], longest: float) -> Iterator[tuple[Solid, Solid]]:
    """Pairs that may be nearer to each other than ``longest`` (m)."""
    planes = [solid for solid in solids if solid.kind.endless]
    others = [solid for solid in solids if not solid.kind.endless]
    yield from itertools.islice(itertools.combinations(planes, 2), MOST_WALLS)
    yield from itertools.islice(itertools.product(planes, others), MOST_WALLS)
    if len(others) < 2:
        return
    centre = np.array([solid.centre for solid in others])
    pairs = bounding_spheres_meet(centre, np.array([solid.outer for solid in others]) + 0.5 * longest)
    distances = np.linalg.norm(centre[pairs[:, 0]] - centre[pairs[:, 1]], axis=1)
    for first, second in pairs[np.argsort(distances, kind="stable")[:MOST_WALLS]]:
        yield others[first], others[second]


MANY = 400
"""Classes of bodies up to which excluded pairs are distinguished one by one; beyond, such bodies count as their class does."""
WITHIN = 4.0
"""A box lies within another's face where the face is this many times as wide as the box's diagonal, as floors are: it may be
pushed over an edge all the same, but few bodies are there at a time."""

FLAT = ("box", "cylinder", "mesh")
"""Kinds of shapes with faces."""


@dataclass(frozen=True, slots=True)
class MaterialReach:
    """Possible interactions between two materials.

    leans    a body may be touched from two sides, or is held by a joint: friction can change a normal force
    gathers  one body may touch two others that move
    corners  a body with several points of contact can land on some of them
    carries  a body may lie on another that accelerates: one that is kinematic or hangs on a joint, or on a moving surface
    ratio    the largest ratio of masses of two bodies that move and may touch; 0: no two may
    layers   how many such bodies can lie on each other, 3 standing for more
    kinds    of the shapes of bodies that move and touch so, sorted
    crosses  a box may lie on another so that their edges cross: neither is so small that it lies within the other's faces
    squeezes a body with faces may be pressed on one by a body on a joint, and touch another next to it
    jams     a body that moves may have another between two of its shapes, as a clamp that friction alone presses on; or may be
             between two walls, as a drawer in its slot
    plane    a body that moves may touch a plane, of any material
    """

    leans: bool = False
    gathers: bool = False
    corners: bool = False
    carries: bool = False
    ratio: float = 0.0
    layers: int = 0
    kinds: tuple[str, ...] = ()
    crosses: bool = False
    jams: bool = False
    squeezes: bool = False
    plane: bool = False


@dataclass(frozen=True)
class _Class:
    """Bodies that are alike for which touch which: some of them, the lightest and the heaviest among them."""

    materials: frozenset[str]
    moves: bool
    bodies: tuple[Body, ...]


@derived
def reach(world: World, first: str, second: str) -> MaterialReach:
    """Possible interactions of bodies of two materials in ``world``."""
    masses, groups = _masses(world), rigid_groups(world)
    kinematic, leaning = _kinematic(world), _leaning(world)
    ratio, leans, carries, crosses = 0.0, False, False, False
    jams, squeezes = sorted_pair(first, second) in _slots(world), False
    moved: set[str] = set()
    for entry, other in _touching(world, frozenset((first, second))):
        moving = [body for body in (entry, other) if _moves(world, body)]
        moved |= {body.name for body in moving}
        leans = leans or any(body.name in leaning for body in moving)
        crosses = crosses or _boxes_cross(entry, other)
        jams = jams or _clamps(world, entry, other) or _clamps(world, other, entry)
        squeezes = squeezes or _squeezes(world, entry, other) or _squeezes(world, other, entry)
        free = [body for body in moving if body.name not in kinematic]
        driven = len(moving) == 2 and any(body.name in kinematic or not _is_lone(world, body) for body in moving)
        carries = (
            carries
            or driven
            or any(any(any(shape.surface_velocity) for shape in solid_shapes(body)) for body in (entry, other))
        )
        if len(free) == 2:
            low, high = sorted(masses[groups[body.name]] for body in free)
            ratio = max(ratio, high / low) if low > 0.0 else ratio
    together = _together(world, first, second) if ratio else 0
    plane = not moved.isdisjoint(_on_planes(world))
    corners = any(_has_corners(body) for body in world.bodies if body.name in moved)
    kinds = {
        shape.kind
        for body in world.bodies
        if body.name in moved
        for shape in solid_shapes(body)
        if shape.material in (first, second)
    }
    return MaterialReach(
        leans, together > 2, corners, carries, ratio, together, tuple(sorted(kinds)), crosses, jams, squeezes, plane
    )


@derived
def _on_planes(world: World) -> frozenset[str]:
    """Bodies that move and may touch a plane of any material, of each class some."""
    return frozenset(
        body.name
        for pair in _touching(world)
        for body, other in (pair, pair[::-1])
        if _moves(world, body) and any(shape.kind == "plane" for shape in solid_shapes(other))
    )


def _touching(world: World, materials: frozenset[str] | None = None) -> Iterator[tuple[Body, Body]]:
    """Pairs of bodies, of each two classes some and the extremes of their masses, of which one moves and that may touch; with
    two ``materials``, one of each."""
    allowed, classes = CollisionFilter(world), _classes(world)
    for index, class_ in enumerate(classes):
        for other in classes[index:]:
            if not (class_.moves or other.moves):
                continue
            if materials is not None and not _meet(class_, other, materials):
                continue
            for body in class_.bodies:
                for partner in other.bodies:
                    if allowed.may_touch(body.name, partner.name):
                        yield body, partner


def _clamps(world: World, body: Body, partner: Body) -> bool:
    """Whether a body moves as forces move it, and may have a shape of its partner between two of its own."""
    if not _moves(world, body) or body.name in _kinematic(world):
        return False
    gap = _gaps(world)[body.name]
    return any(
        shape.kind not in STATIC_SHAPES and 2.0 * SHAPES[shape.kind].inner_radius(shape.size) < gap
        for shape in solid_shapes(partner)
    )


@derived
def _slots(world: World) -> frozenset[tuple[str, str]]:
    """The sorted pairs of materials of a free body and of fixed or kinematic walls between which it may jam."""
    free = [body for body in world.bodies if _moves(world, body) and _is_lone(world, body)]
    groups, kinematic = rigid_groups(world), _kinematic(world)
    walls: dict[str, list[Body]] = {}
    for body in world.bodies:
        if not _moves(world, body) or groups[body.name] in kinematic:
            walls.setdefault(groups[body.name], []).append(body)
    return jamming_materials(world, [body for body in free if body.name not in kinematic], walls.values())


def _squeezes(world: World, body: Body, finger: Body) -> bool:
    """Whether a body may be pressed against another by ``finger``, face on face."""
    faces = all(any(shape.kind in FLAT for shape in solid_shapes(entry)) for entry in (body, finger))
    driven = _moves(world, finger) and finger.name not in _kinematic(world) and not _is_lone(world, finger)
    return faces and driven and body.name in _leaning(world)


def _boxes_cross(body: Body, other: Body) -> bool:
    """Whether boxes of two bodies are so alike in size that one may reach beyond the edges of the other's faces."""
    return any(
        first.kind == second.kind == "box" and WITHIN * min(_over(first, second), _over(second, first)) > 1.0
        for first in solid_shapes(body)
        for second in solid_shapes(other)
    )


def _over(small: Shape, large: Shape) -> float:
    """The diagonal of one box's largest face over the width of the other's."""
    _, width, length = sorted(small.size)
    return math.hypot(width, length) / sorted(large.size)[1]


def _meet(entry: _Class, other: _Class, materials: frozenset[str]) -> bool:
    first, second = min(materials), max(materials)
    return (first in entry.materials and second in other.materials) or (
        second in entry.materials and first in other.materials
    )


@derived
def _leaning(world: World) -> frozenset[str]:
    """Names of bodies, of each class some, that may be touched from two sides, or that joints or constraints hold: all but free
    ones that may touch one flat fixed shape and nothing else."""
    touched: dict[str, set[str]] = {}
    leaning: set[str] = set()
    for entry, other in _touching(world):
        for body, partner in ((entry, other), (other, entry)):
            if not _moves(world, body):
                continue
            shapes = solid_shapes(partner)
            touched.setdefault(body.name, set()).update(shape.name for shape in shapes)
            alone = len(shapes) == 1 and not _moves(world, partner)
            # a box touches a body of one convex shape with one normal, and one of several shapes on two sides, as a clamp
            flat = alone and (shapes[0].kind == "plane" or (shapes[0].kind == "box" and len(solid_shapes(body)) == 1))
            if not flat or not _is_lone(world, body) or len(touched[body.name]) > 1:
                leaning.add(body.name)
    return frozenset(leaning)


@derived
def _gaps(world: World) -> dict[str, float]:
    """Of each body the largest distance (m) between the centres of two of its shapes, more than what it can have between them;
    infinite where bodies with shapes are fixed to it."""
    groups = rigid_groups(world)
    carrying: dict[str, int] = {}
    for body in world.bodies:
        carrying[groups[body.name]] = carrying.get(groups[body.name], 0) + bool(solid_shapes(body))
    return {
        body.name: math.inf if carrying[groups[body.name]] > 1 else _spread(solid_shapes(body)) for body in world.bodies
    }


def _spread(shapes: Sequence[Shape]) -> float:
    centres = [shape.pose.position for shape in shapes]
    return max((math.dist(centre, other) for centre, other in itertools.combinations(centres, 2)), default=0.0)


@derived
def _kinematic(world: World) -> frozenset[str]:
    return frozenset(motion.body for motion in world.motions)


@derived
def _classes(world: World) -> list[_Class]:
    masses, groups = _masses(world), rigid_groups(world)
    special = {name for pair in world.contact.excluded_bodies for name in pair}
    if len(special) > MANY:
        special = set()
    kinematic = _kinematic(world)
    members: dict[tuple[frozenset[str], bool, tuple[object, ...]], list[Body]] = {}
    for body in world.bodies:
        materials = frozenset(shape.material for shape in solid_shapes(body))
        if materials:
            alone = body.name in special or body.name in kinematic
            kinds = tuple(sorted({shape.kind for shape in solid_shapes(body)})), len(solid_shapes(body))
            moves = _moves(world, body)
            more = (body.collision_group, kinds, _gaps(world)[body.name], body.name if alone or not moves else "")
            members.setdefault((materials, moves, more), []).append(body)
    found = []
    for (materials, moves, _), bodies in members.items():
        by_mass = sorted(bodies, key=lambda body: masses[groups[body.name]])
        some = dict.fromkeys((*bodies[:2], by_mass[0], by_mass[-1]))
        found.append(_Class(materials, moves, tuple(some)))
    return found


@derived
def _masses(world: World) -> dict[str, float]:
    """Of each rigid group (kg)."""
    masses: dict[str, float] = {}
    for body in world.bodies:
        group = rigid_groups(world)[body.name]
        masses[group] = masses.get(group, 0.0) + body.inertial.mass
    return masses


def _moves(world: World, body: Body) -> bool:
    return rigid_groups(world)[body.name] != "world"


def _is_lone(world: World, body: Body) -> bool:
    """Whether a body is free, and no other hangs on it by a joint or a constraint."""
    return body.joint.kind == "free" and body.name not in _attached(world)


@derived
def _attached(world: World) -> frozenset[str]:
    """The names of bodies that others are joined to, or that constraints hold."""
    names = {body.joint.parent for body in world.bodies if body.joint.parent is not None and body.joint.kind != "fixed"}
    for constraint in world.constraints:
        names |= {str(value) for value in dataclasses.asdict(constraint).values() if isinstance(value, str)}
    return frozenset(names)


def _has_corners(body: Body) -> bool:
    shapes = solid_shapes(body)
    return len(shapes) > 1 or any(shape.kind != "sphere" for shape in shapes)


def _together(world: World, first: str, second: str) -> int:
    """How many rigid groups move freely or on joints and have one of the two materials: up to 3, which stands for more."""
    groups, kinematic = rigid_groups(world), _kinematic(world)
    found: set[str] = set()
    for body in world.bodies:
        if (
            _moves(world, body)
            and body.name not in kinematic
            and any(shape.material in (first, second) for shape in solid_shapes(body))
        ):
            found.add(groups[body.name])
            if len(found) > 2:
                break
    return len(found)


@derived
def largest_ratio(world: World) -> float:
    """The largest ratio of masses of two bodies that move and may touch; 0: no two may."""
    return max((reach(world, *pair).ratio for pair in meeting_laws(world)), default=0.0)


@derived
def crossing(world: World) -> bool:
    """Whether boxes may lie on each other so that their edges cross."""
    return any(reach(world, *pair).crosses for pair in meeting_laws(world))
