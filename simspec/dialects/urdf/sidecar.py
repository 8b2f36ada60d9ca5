"""The sidecar of plain URDF: an engine's values that the files lack, each with its unit, and whether it fits together.

An engine's process imports this module; it needs numpy only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

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
from simspec.formats.kit.forms import NamePairs, Names, check_distinct, check_known
from simspec.language.vocabulary import HARDNESS_KINDS, PRIMITIVE_SHAPES
from simspec.world.shapes import SHAPES
from simspec.world.types import Hardness, PairContact, Pose, Vector3

SIDECAR_KINDS: Final = tuple(kind for kind in PRIMITIVE_SHAPES if kind not in ("sphere", "box", "cylinder"))
"""The kinds of shapes that URDF lacks, which stand in the sidecar."""


@dataclass(frozen=True, slots=True)
class UrdfInstance:
    """One tree: the file that says it, maybe shared, and the names, place and beginning of this one.

    file        its name; equal trees share one, which has the names of the first instance of it
    model       the tree's name
    free        whether the root moves freely. Else the file's first link is a link without mass that stands for the world,
                at the world's origin: the first joint says where the tree stands
    root_link   the name of the file's root: the first body's, or that of the world's link
    bodies      names, in the order of the file's links (after the world's link)
    joints      by body, the joint above it; of a free root there is none in the file
    shapes      by body, the names of its shapes
    materials   by body and shape; "" of a shape that is only seen
    position    generalised coordinates of the bodies' joints, in their order (``world/kinematics.py``): hinge and slide one
                number, free x y z of the centre of mass in the world and quaternion w x y z
    velocity    hinge and slide one number; free velocity of the centre of mass in world axes, then angular velocity in the
                body's axes
    """

    file: str
    model: str
    free: bool
    root_link: str
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    shapes: tuple[Names, ...]
    materials: tuple[tuple[str, ...], ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SidecarShape:
    """A shape that URDF lacks: kind, size and pose in the link's frame as in ``world/types.py``."""

    body: str
    shape: str
    kind: str
    size: tuple[float, ...]
    pose: Pose
    collision: bool
    visual: bool
    colour: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Numbers:
    """The numbers of one material's shapes, which the engine combines by the rules that it declares: friction and restitution
    are ratios, torsional and rolling friction lengths (m)."""

    material: str
    friction: float
    torsional_friction: float
    rolling_friction: float
    restitution: float
    hardness: Hardness


@dataclass(frozen=True, slots=True)
class ShapePair:
    """The law of two shapes, which numbers of materials cannot give: it overrides them."""

    first: str
    second: str
    friction: float
    torsional_friction: float
    rolling_friction: float
    restitution: float
    hardness: Hardness


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfSidecar(Sidecar):
    """Input of an engine that reads plain URDF, in addition to the files.

    A limit of 1e9 (``formats/urdf/robots.py``, UNLIMITED) in a file stands for none: URDF demands one.
    """

    gravity: Vector3
    """m/s², world axes."""
    timestep: float
    """s."""
    instances: tuple[UrdfInstance, ...]
    alongside: tuple[SidecarShape, ...] = field(metadata={"key": "beside"})
    springs: tuple[JointSpring, ...]
    armature: tuple[Armature, ...]
    materials: tuple[Numbers, ...]
    pairs: tuple[ShapePair, ...]
    laws: tuple[PairContact, ...]
    """The law of every two materials, for engines that have a table of them."""
    groups: tuple[str, ...]
    """The collision group of each body, in the order of ``bodies``."""
    ignored_groups: NamePairs
    """Groups whose bodies do not touch each other."""
    excluded: NamePairs
    """Bodies that do not touch each other: those of the spec, and those that are rigidly joined and move. A body does not touch
    itself, and what cannot move does not touch what cannot move either."""

    def check(self) -> None:
        kinds = {body.name: body.kind for body in self.bodies}
        check_every_body((instance.bodies for instance in self.instances), kinds)
        for index, instance in enumerate(self.instances):
            _check_instance(instance, kinds, f"sidecar.instances.{index}")
        shapes = [name for instance in self.instances for names in instance.shapes for name in names]
        check_distinct(shapes, "sidecar.instances, shapes")
        check_of_bodies({"springs": self.springs, "armature": self.armature}, kinds)
        self._check_shapes(set(shapes))
        materials = [numbers.material for numbers in self.materials]
        check_distinct(materials, "sidecar.materials")
        check_known({name for law in self.laws for name in (law.first, law.second)}, materials, "sidecar.laws")
        hard = {entry.hardness.kind for entry in self.materials} | {entry.hardness.kind for entry in self.pairs}
        check_known(hard | {law.hardness.kind for law in self.laws}, HARDNESS_KINDS, "sidecar, kinds of hardness")
        if len(self.groups) != len(self.bodies):
            raise ValueError(f"sidecar.groups has {len(self.groups)} entries for {len(self.bodies)} bodies")
        check_known({name for pair in self.excluded for name in pair}, kinds, "sidecar.excluded")

    def _check_shapes(self, shapes: set[str]) -> None:
        """Shapes that others name are there, of known kinds and materials."""
        materials = {numbers.material for numbers in self.materials} | {""}
        used = {name for instance in self.instances for names in instance.materials for name in names}
        check_known(used, materials, "sidecar.instances, materials")
        check_known({name for pair in self.pairs for name in (pair.first, pair.second)}, shapes, "sidecar.pairs")
        check_distinct((entry.shape for entry in self.alongside), "sidecar.beside")
        local = {
            shape: body
            for instance in self.instances
            for body, names in zip(instance.bodies, instance.shapes, strict=True)
            for shape in names
        }
        for index, entry in enumerate(self.alongside):
            at = f"sidecar.beside.{index}"
            check_known((entry.kind,), SIDECAR_KINDS, at)
            if local.get(entry.shape) != entry.body:
                raise ValueError(f"{at}: body {entry.body!r} has no shape {entry.shape!r}")
            wrong = SHAPES[entry.kind].wrong_size(entry.size)
            if wrong is not None:
                raise ValueError(f"{at}.size {wrong}")


def _check_instance(instance: UrdfInstance, kinds: Mapping[str, str], at: str) -> None:
    bodies = instance.bodies
    lists = {"joints": instance.joints, "shapes": instance.shapes, "materials": instance.materials}
    check_by_body(bodies, lists, at)
    for names, materials in zip(instance.shapes, instance.materials, strict=True):
        if len(names) != len(materials):
            raise ValueError(f"{at}.materials has {len(materials)} entries for {len(names)} shapes")
    if instance.free != (kinds[bodies[0]] == "free") or any(kinds[name] == "free" for name in bodies[1:]):
        raise ValueError(f"{at}.free does not fit the kinds of its bodies")
    check_coordinates([kinds[body] for body in bodies], instance.position, instance.velocity, at)
    check_unit([instance.position[3:7]] if instance.free else [], at)
