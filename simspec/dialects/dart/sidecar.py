"""The sidecar of a .skel folder: DART's settings that the file lacks, and whether its lists fit together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from simspec.dialects.kit.sidecar import JointSpring, JointValue, OfBody, Sidecar, check_of_bodies
from simspec.formats.kit.forms import NamePairs, Names, check_distinct, check_known


@dataclass(frozen=True, slots=True)
class DartShapeCopy:
    """One copy of a collision shape: the node it is on, and its numbers in its layer."""

    node: str
    layer: int
    friction: float
    restitution: float


@dataclass(frozen=True, slots=True)
class DartShapeEntry:
    """A shape of a body; its copies in the order of their layers, none where it is only visual."""

    name: str
    body: str
    visual: bool
    material: str
    surfaces: tuple[DartShapeCopy, ...]


@dataclass(frozen=True, slots=True)
class WeldedNode:
    """A further node of a body, welded to its own (see ``copies.py``)."""

    node: str
    body: str


@dataclass(frozen=True, slots=True)
class NodeFilter:
    """Classes of nodes that touch the same others, and the pairs of classes that do not touch. ``layers`` are for
    readers: two materials, and the layer in which they meet, or None."""

    classes: Mapping[str, Names]
    excluded: NamePairs = field(metadata={"key": "apart"})
    layers: tuple[tuple[str, str, int | None], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DartSidecar(Sidecar):
    """Models of the bodies in their order, shapes, limits, losses, and what does not touch."""

    models: tuple[str, ...]
    shapes: tuple[DartShapeEntry, ...]
    enforce_limits: Names
    velocity_limits: tuple[JointValue, ...]
    effort_limits: tuple[JointValue, ...]
    damping: tuple[JointValue, ...]
    armature: tuple[JointValue, ...]
    springs: tuple[JointSpring, ...]
    ignored_groups: NamePairs
    groups: Mapping[str, Names]
    """The bodies of each collision group that ``ignored_groups`` names."""
    excluded: NamePairs
    copies: tuple[WeldedNode, ...]
    filter: NodeFilter

    def check(self) -> None:
        """Raise ValueError, which names the place, where its lists do not fit together."""
        bodies = {body.name for body in self.bodies}
        if len(self.models) != len(self.bodies):
            raise ValueError(f"sidecar.models has {len(self.models)} entries for {len(self.bodies)} bodies")
        lists: Mapping[str, Iterable[OfBody]] = {
            "velocity_limits": self.velocity_limits,
            "effort_limits": self.effort_limits,
            "damping": self.damping,
            "armature": self.armature,
            "springs": self.springs,
        }
        check_of_bodies(lists, bodies)
        check_known(self.enforce_limits, bodies, "sidecar.enforce_limits")
        check_known((name for pair in self.excluded for name in pair), bodies, "sidecar.excluded")
        check_known((name for names in self.groups.values() for name in names), bodies, "sidecar.groups")
        _check_used(self.groups, self.ignored_groups, "sidecar.groups")
        check_distinct((copy.node for copy in self.copies), "sidecar.copies")
        check_known((copy.body for copy in self.copies), bodies, "sidecar.copies")
        check_known((shape.body for shape in self.shapes), bodies, "sidecar.shapes")
        for index, shape in enumerate(self.shapes):
            check_distinct((copy.layer for copy in shape.surfaces), f"sidecar.shapes.{index}.surfaces")
            if shape.material and not shape.surfaces:
                raise ValueError(f"sidecar.shapes.{index} has the material {shape.material!r} and no surface of it")
        check_distinct((node for nodes in self.filter.classes.values() for node in nodes), "sidecar.filter.classes")
        _check_used(self.filter.classes, self.filter.excluded, "sidecar.filter.classes")
        check_distinct(((name, other) for name, other, _ in self.filter.layers), "sidecar.filter.layers")


def _check_used(sets: Mapping[str, Names], pairs: NamePairs, at: str) -> None:
    """Sets of names are there for pairs of them: those that pairs name, and none is empty."""
    used = {name for pair in pairs for name in pair}
    if set(sets) != used or not all(sets.values()):
        raise ValueError(f"{at} has {sorted(sets)}, none of them empty, for pairs of {sorted(used)}")
