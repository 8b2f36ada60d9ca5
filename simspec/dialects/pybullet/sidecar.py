"""PyBullet's sidecar: where trees stand, how they begin, what carries which shapes, what touches what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final

from simspec.dialects.kit.joints import (
    Armature,
    JointSpring,
    check_by_body,
    check_coordinates,
    check_every_body,
    check_of_bodies,
    check_unit,
)
from simspec.dialects.kit.sidecar import Sidecar
from simspec.formats.kit.forms import DISTINCT, NamePairs, Names, check_distinct, check_known
from simspec.language.vocabulary import QUATERNION_JOINTS
from simspec.support.declarations import Level, Refinement, Support, never
from simspec.support.negotiation import LARGE_TREE
from simspec.world.canonical import derived
from simspec.world.kinematics import bare_frames, trees
from simspec.world.types import POSITION_SIZE, Pose, Vector3, World

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
