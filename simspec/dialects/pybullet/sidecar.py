"""PyBullet's sidecar: where trees stand, how they begin, what carries which shapes, what touches what; and contact in URDF."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final

from simspec.contact import CollisionPart, ContactPlan, parts
from simspec.dialects.kit.sidecar import (
    Armature,
    JointSpring,
    Sidecar,
    check_by_body,
    check_coordinates,
    check_every_body,
    check_of_bodies,
    check_unit,
)
from simspec.errors import Problem
from simspec.formats.kit.forms import DISTINCT, NamePairs, Names, check_distinct, check_known
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.support.declarations import Level, Refinement, Support, never
from simspec.support.negotiation import LARGE_TREE
from simspec.world.canonical import derived
from simspec.world.contact_pairs import excluded_pairs, meeting_laws
from simspec.world.hull import hull_within_margin, thickened
from simspec.world.kinematics import bare_frames, rigid_groups, trees
from simspec.world.types import POSITION_SIZE, Body, Hardness, Pose, Shape, Surface, Vector3, World

FREE: Final = "free"
FIXED: Final = "fixed"
WORLD_LINK: Final = "world link"
ROOTS: Final = (FREE, FIXED, WORLD_LINK)
"""The base of a tree: its free root, its fixed root, or a link that stands for the world."""

Places = Annotated[tuple[int, ...], DISTINCT]


@dataclass(frozen=True, slots=True)
class PybulletLinkCopy:
    """A link that only carries shapes: ``shapes`` of ``body``, in the ``layer`` of the contact plan."""

    link: str
    body: str
    layer: int
    shapes: Names


@dataclass(frozen=True, slots=True)
class PybulletInstance:
    """One tree: the file that says it, maybe shared, where it stands, how it begins, and the names of this one.

    bodies, joints, shapes, layers   by body, in the order of the file's links after a world link; the layer of its own link
    visual_only                      PyBullet lists collision shapes and visual shapes separately: of each body the places of
    the
                                     shapes that are only seen
    copies                           after the bodies' links: which shapes of which body a link carries, and the layer
    position, velocity               generalised coordinates of the bodies, in their order
    """

    file: str
    model: str
    root: str
    base: Pose
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    shapes: tuple[Names, ...]
    visual_only: tuple[Places, ...]
    copies: tuple[PybulletLinkCopy, ...]
    layers: tuple[int, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class FixedFrame:
    """A body that PyBullet does not receive: a frame at ``pose`` in that of ``parent``, to which its joint fixes it."""

    name: str
    model: str
    joint: str
    parent: str
    pose: Pose


@dataclass(frozen=True, slots=True)
class FilterClass:
    """Links of one bit and one mask of Bullet's filter."""

    group: int
    mask: int
    links: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PybulletCollisionFilter:
    """Classes of links, and pairs of links that do not touch besides."""

    classes: tuple[FilterClass, ...]
    excluded: NamePairs


@dataclass(frozen=True, slots=True, kw_only=True)
class PybulletSidecar(Sidecar):
    """PyBullet's input in addition to its files."""

    gravity: Vector3
    timestep: float
    instances: tuple[PybulletInstance, ...]
    springs: tuple[JointSpring, ...]
    armature: tuple[Armature, ...]
    collision_filter: PybulletCollisionFilter
    restitution_threshold: float
    native_contact: bool
    frames: tuple[FixedFrame, ...] | None = None
    """The bodies that PyBullet does not receive, parents first; None where it receives all."""
    sleepers: Names | None = None
    """The free rigid bodies that may sleep; there with the setting ``sleeping`` alone."""

    def check(self) -> None:
        kinds = {body.name: body.kind for body in self.bodies}
        given = [instance.bodies for instance in self.instances]
        check_every_body([*given, [frame.name for frame in self.frames or ()]], kinds)
        _check_frames(self.frames or (), {name for bodies in given for name in bodies}, kinds)
        solid: set[str] = set()
        for index, instance in enumerate(self.instances):
            _check_instance(instance, kinds, f"sidecar.instances.{index}")
            solid.update(copy.link for copy in instance.copies)
            solid.update(
                body
                for body, names, places in zip(instance.bodies, instance.shapes, instance.visual_only, strict=True)
                if len(names) > len(places)
            )
        check_of_bodies({"springs": self.springs, "armature": self.armature}, kinds)
        _check_classes(self.collision_filter.classes, solid)
        pairs = {name for pair in self.collision_filter.excluded for name in pair}
        check_known(pairs, solid, "sidecar.collision_filter.excluded")
        check_known(self.sleepers or (), kinds, "sidecar.sleepers")
        if (self.sleepers is not None) != bool(self.settings.get("sleeping", False)):
            raise ValueError("sidecar.sleepers and the setting sleeping disagree")


def _check_frames(frames: Sequence[FixedFrame], given: set[str], kinds: Mapping[str, str]) -> None:
    """Every frame is fixed to a body that PyBullet receives, or to a frame before it."""
    known = set(given)
    for frame in frames:
        check_known((frame.parent,), known, f"sidecar.frames, {frame.name!r}")
        if kinds[frame.name] != "fixed":
            raise ValueError(f"sidecar.frames has {frame.name!r}, which is no fixed body")
        known.add(frame.name)
    check_unit((frame.pose.quaternion for frame in frames), "sidecar.frames")


def _check_classes(classes: Sequence[FilterClass], solid: set[str]) -> None:
    """Every link with collision shapes is in one class, every class has a bit of its own and selects such bits alone."""
    at = "sidecar.collision_filter.classes"
    names = [name for entry in classes for name in entry.links]
    check_distinct(names, at)
    if set(names) != solid or not all(entry.links for entry in classes):
        raise ValueError(f"{at} do not hold each link with collision shapes: {sorted(set(names) ^ solid)}")
    bits = [entry.group for entry in classes]
    check_distinct(bits, f"{at}, groups")
    if not all(0 < bit < 1 << 31 and bit & (bit - 1) == 0 for bit in bits):
        raise ValueError(f"{at} have the groups {bits}, should each be one bit")
    if any(entry.mask < 0 or entry.mask & ~sum(bits) for entry in classes):
        raise ValueError(f"{at} have masks with bits of no class")


def _check_instance(instance: PybulletInstance, kinds: Mapping[str, str], at: str) -> None:
    bodies = instance.bodies
    if instance.root not in ROOTS:
        raise ValueError(f"{at}.root is {instance.root!r}, should be one of {', '.join(ROOTS)}")
    lists = {
        "joints": instance.joints,
        "shapes": instance.shapes,
        "visual_only": instance.visual_only,
        "layers": instance.layers,
    }
    check_by_body(bodies, lists, at)
    for names, places in zip(instance.shapes, instance.visual_only, strict=True):
        if not set(places) <= set(range(len(names))):
            raise ValueError(f"{at}.visual_only names shapes {list(places)} of {len(names)}")
    check_coordinates([kinds[body] for body in bodies], instance.position, instance.velocity, at)
    _check_placed(instance, kinds, at)
    check_known({copy.body for copy in instance.copies}, set(bodies), f"{at}.copies")
    shapes = dict(zip(bodies, instance.shapes, strict=True))
    for copy in instance.copies:
        check_known(set(copy.shapes), set(shapes[copy.body]), f"{at}.copies, link {copy.link!r}")
    check_distinct((copy.link for copy in instance.copies), f"{at}.copies")


def _check_placed(instance: PybulletInstance, kinds: Mapping[str, str], at: str) -> None:
    """The base stands where its free root does, and rotations are of unit length."""
    base, numbers = instance.base, list(instance.position)
    if instance.root == FREE and [*base.position, *base.quaternion] != numbers[:7]:
        raise ValueError(f"{at}.base is not where {at}.position puts it")
    turns: list[Sequence[float]] = [base.quaternion]
    for body in instance.bodies:
        local = [numbers.pop(0) for _ in range(POSITION_SIZE[kinds[body]])]
        if kinds[body] in QUATERNION_JOINTS:
            turns.append(local[-4:])
    check_unit(turns, at)


# Bodies that are only frames, represented outside PyBullet in trees for which it has no room.

MOST_LINKS: Final = LARGE_TREE
"""Links in addition to the base of one tree; copies of shapes count."""
NO_LINKS: Final = f"PyBullet supports at most {MOST_LINKS} links besides the base in one tree"
IN_SIDECAR = Refinement(
    Level.OUTSIDE,
    f"{NO_LINKS}. simspec computes bodies that are nothing but frames (fixed, massless and without shapes) from the "
    f"bodies that "
    "carry them",
    short="frames of trees of more than 127 bodies are computed from the bodies that carry them",
)


@derived
def frames_alongside(world: World) -> frozenset[str]:
    """The names of the bodies that PyBullet does not receive: all frames of the trees that are too large for it."""
    large = {body.name for bodies in trees(world).values() if len(bodies) > MOST_LINKS for body in bodies}
    return bare_frames(world) & large


def _room(world: World) -> Refinement | None:
    alongside = frames_alongside(world)
    most = max((sum(body.name not in alongside for body in bodies) for bodies in trees(world).values()), default=0)
    return IN_SIDECAR if most <= MOST_LINKS else None


def _tree_size() -> Support:
    support = never(NO_LINKS)
    return Support(support.level, support.how, refine=_room, cases=(IN_SIDECAR,), absence=support.absence)


TREE_SIZE: Final = _tree_size()

# Contact: PyBullet holds friction, restitution and hardness once per link, multiplies two links' numbers, and filters links.
# So the shapes of a body are split by material, and copied where a table of pairs needs it (``simspec/contact.py``): the
# first part stays on the body's own link, every other gets a massless link on a fixed joint.

FILTER_BITS = 31
"""Collision classes that PyBullet's 32-bit group masks can distinguish (the sign bit left alone)."""
LARGEST_FRICTION = 10.0
"""PyBullet clamps the friction of a pair to ±10 (measured)."""
NATIVE = "native"

Key = tuple[bool, str, frozenset[tuple[str, int]]]
"""A class of the filter: whether its links cannot move, the collision group (where it matters), and which (material, layer)
they meet."""


def split(body: Body, plan: ContactPlan) -> tuple[CollisionPart, ...]:
    """The parts of a body; one without collision shapes for a body that has none."""
    return parts(body, plan) or (CollisionPart(body.name, "", 0, (), Surface(hardness=Hardness())),)


def copy_name(part: CollisionPart) -> str:
    """The name of the link of a part beyond the first; no spec can give it, since names have no dots."""
    return f"{part.body}__{part.material}.{part.layer}"


def link_name(part: CollisionPart, first: CollisionPart) -> str:
    """The name of a part's link."""
    return part.body if part is first else copy_name(part)


def contact_values(surface: Surface) -> tuple[tuple[str, float], ...]:
    """The children of a link's ``contact`` element, by name. A pair's springs stand in series and its dampers add up, so that
    each link has twice the stiffness and half the damping (measured)."""
    found = [
        ("lateral_friction", surface.friction or 0.0),
        ("rolling_friction", surface.rolling_friction or 0.0),
        ("spinning_friction", surface.torsional_friction or 0.0),
        ("restitution", surface.restitution or 0.0),
    ]
    if surface.hardness is not None and surface.hardness.kind == "stiffness":
        found += [("stiffness", 2.0 * surface.hardness.stiffness), ("damping", surface.hardness.damping / 2.0)]
    return tuple(found)


def native_contact(world: World) -> bool:
    """Whether contact is as hard as PyBullet makes it; all pairs that meet then are (see :func:`problems`)."""
    return any(law.hardness.kind == NATIVE for law in meeting_laws(world).values())


def restitution_threshold(world: World) -> float:
    """The speed below which nothing bounces: PyBullet has one for all pairs (see :func:`problems`)."""
    return max((law.restitution_threshold for law in meeting_laws(world).values() if law.restitution), default=0.0)


def problems(world: World) -> list[Problem]:
    """Parameters that PyBullet stores once for all pairs, and that differ between pairs of the world."""
    laws = meeting_laws(world)
    found = []
    bouncing = {pair: law for pair, law in laws.items() if law.restitution}
    if len({law.restitution_threshold for law in bouncing.values()}) > 1:
        found.append(
            _differing(
                "one restitution_threshold for all pairs that bounce",
                {pair: f"{law.restitution_threshold:g} m/s" for pair, law in bouncing.items()},
                "restitution_threshold",
            )
        )
    kinds = {pair: law.hardness.kind for pair, law in laws.items()}
    if NATIVE in kinds.values() and len(set(kinds.values())) > 1:
        found.append(_differing("its native hardness for all pairs or none", kinds, "hardness"))
    for (first, second), law in laws.items():
        if law.friction > LARGEST_FRICTION:
            found.append(
                Problem(
                    f"PyBullet does not support friction above {LARGEST_FRICTION:g}",
                    f"contact.pairs.{first}.{second}.friction",
                    found=f"{law.friction:g}",
                    allowed=f"up to {LARGEST_FRICTION:g}",
                    code="E104",
                )
            )
    return found


def _differing(what: str, values: Mapping[tuple[str, str], str], field: str) -> Problem:
    first, second = next(iter(values))
    text = "; ".join(f"{name}, {other}: {value}" for (name, other), value in values.items())
    return Problem(
        f"PyBullet supports only {what}",
        f"contact.pairs.{first}.{second}.{field}",
        found=text,
        hint="make them equal, or run without this engine",
        code="E104",
    )


def collision_filter(world: World, plan: ContactPlan) -> PybulletCollisionFilter:
    """Classes of links (a group bit and a mask each) and pairs of links that do not touch besides.

    Links are of one class when they are in groups that ignore the same, both can move or both cannot (those never touch each
    other), and meet the same materials in the same layers. More classes than bits: exclusions are written as pairs.
    """
    groups = rigid_groups(world)
    ignored = set(world.contact.ignored_groups)
    named = {name for pair in ignored for name in pair}
    meets = _meeting(plan)
    links: dict[Key, list[str]] = {}
    of: dict[str, Key] = {}
    holds: dict[Key, set[tuple[str, int]]] = {}
    by_body: dict[str, list[str]] = {}
    for body in world.bodies:
        some = parts(body, plan)
        for part in some:
            group = body.collision_group if body.collision_group in named else ""
            key = (groups[body.name] == "world", group, meets.get((part.material, part.layer), frozenset()))
            name = link_name(part, some[0])
            links.setdefault(key, []).append(name)
            of[name] = key
            holds.setdefault(key, set()).add((part.material, part.layer))
            by_body.setdefault(body.name, []).append(name)
    classes = sorted(links, key=lambda key: (key[0], key[1], sorted(key[2])))

    def touch(key: Key, other: Key) -> bool:
        if (key[0] and other[0]) or (min(key[1], other[1]), max(key[1], other[1])) in ignored:
            return False
        return not key[2].isdisjoint(holds[other])

    excluded = {
        (min(a, b), max(a, b))
        for first, second in excluded_pairs(world)
        for a in by_body.get(first, ())
        for b in by_body.get(second, ())
    }
    for names in by_body.values():  # a body does not touch itself
        excluded.update((min(a, b), max(a, b)) for a, b in itertools.combinations(names, 2) if touch(of[a], of[b]))
    if len(classes) > FILTER_BITS:
        excluded |= _excluded_of(of, touch)
        return PybulletCollisionFilter((FilterClass(1, 1, tuple(of)),), tuple(sorted(excluded)))
    bits = {key: 1 << index for index, key in enumerate(classes)}
    return PybulletCollisionFilter(
        tuple(
            FilterClass(bits[key], sum(bit for other, bit in bits.items() if touch(key, other)), tuple(links[key]))
            for key in classes
        ),
        tuple(sorted(excluded)),
    )


def _meeting(plan: ContactPlan) -> dict[tuple[str, int], frozenset[tuple[str, int]]]:
    """For each (material, layer) the others that it meets."""
    found: dict[tuple[str, int], set[tuple[str, int]]] = {}
    for (first, second), layer in plan.layer_of.items():
        found.setdefault((first, layer), set()).add((second, layer))
        found.setdefault((second, layer), set()).add((first, layer))
    return {key: frozenset(others) for key, others in found.items()}


def _excluded_of(of: Mapping[str, Key], touch: Callable[[Key, Key], bool]) -> set[tuple[str, str]]:
    names: Iterable[str] = sorted(of)
    ordered = list(names)
    return {
        (name, other)
        for index, name in enumerate(ordered)
        for other in ordered[index + 1 :]
        if not touch(of[name], of[other])
    }


# Meshes within the margin that PyBullet keeps around hulls.
#
# On the base of a tree the margin is the setting ``collision_margin``; on every other link PyBullet keeps 1 mm, whatever it
# is requested (measured, 3.2.7). It is outside of the hull, so that hulls are written with their faces that much further in:
# faces are then where they should be, and edges are rounded by the margin, as PyBullet's own boxes and cylinders are there. A
# hull that is too thin for that is written as far in as it goes (``world/hull.py``), and is thicker in PyBullet. In boxes and
# cylinders the margin is within: a thinner shape is written as thick as both margins, since Bullet overlooks contacts of cores
# of less than nothing (measured: of a sole of 16 × 7 cm and 1 mm, 11 of 93 pairs of a robot's shapes).

LINK_MARGIN: Final = 1e-3
"""m, around hulls on links other than bases."""


def written_shapes(body: Body, parts: Sequence[CollisionPart], local_margin: float) -> dict[str, Shape]:
    """The shapes of a body by name, those that touch within the margin of the link that carries them: ``own_margin`` on its
    own."""
    margins = {shape.name: LINK_MARGIN for part in parts[1:] for shape in part.shapes}
    margins |= {shape.name: local_margin for shape in parts[0].shapes}
    return {shape.name: _within(shape, margins.get(shape.name, 0.0)) for shape in body.shapes}


def faces_meet(world: World, plan: ContactPlan, base_margin: float) -> bool:
    """Whether hulls get the features by which PyBullet finds all contact points of two faces in one step.

    It then looks at hulls without their margin (measured: one on a link is 1 mm deep in another), so that no hull may have one:
    all meshes that touch are on bases of trees, whose margin is ``base_margin`` (m).
    """
    margins = [margin for body in world.bodies for _, margin in margins_of("mesh", body, plan, base_margin)]
    return bool(margins) and not any(margins)


def margins_of(kind: str, body: Body, plan: ContactPlan, base_margin: float) -> Iterator[tuple[Shape, float]]:
    """The shapes of a ``kind`` of a body that touch, each with the margin (m) of a link that carries it; a copied one more than
    once."""
    local, *carried = parts(body, plan) or (None,)
    root = body.joint.parent is None and body.joint.kind in ("free", "fixed")
    on_base = root and (body.joint.kind == "free" or not body.inertial.mass)
    for part in () if local is None else (local, *carried):
        for shape in part.shapes:
            if shape.kind == kind:
                yield shape, base_margin if part is local and on_base else LINK_MARGIN


def _within(shape: Shape, margin: float) -> Shape:
    if not shape.collision or not margin:
        return shape
    if shape.kind in ("box", "cylinder"):
        return dataclasses.replace(shape, size=thickened(shape.kind, shape.size, margin))
    if shape.kind != "mesh":
        return shape
    return dataclasses.replace(shape, size=hull_within_margin(shape.size, margin))
