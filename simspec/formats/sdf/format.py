"""The format ``sdf``: one XML file, ``world.sdf``, of the version 1.9, which every reader of today knows, and of 1.11 where
joints follow others.

Poses are a position and a quaternion, which the language has since that version: numbers read back to the same doubles.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar, Final

from simspec.formats.kit.contract import Format, PlainFiles, losses
from simspec.formats.kit.text import XmlElement, environment, mesh_file, mesh_files, number, read_xml
from simspec.formats.sdf import tree
from simspec.formats.sdf.plain import SIZES, SUPPORT, loops_within, more_losses, plain_tree
from simspec.formats.sdf.tree import SdfJoint, SdfShape, SdfWorld
from simspec.support.declarations import Support, Table, approximate, never
from simspec.support.features import Feature
from simspec.world import frames, types
from simspec.world.damping import without_implicit_damping
from simspec.world.kinematics import trees
from simspec.world.types import Inertial, Pose

# --- SDF 1.6, for readers that know no newer version ---
# Links stand in the model's frame, rotations are angles about fixed axes, and a body that cannot move states a mass of zero:
# older readers assume 1 kg where none is stated, and read no relative_to and no quaternions.

CLASSIC: Final = "1.6"
"""The newest version that older readers know."""
OLDER: Final[Mapping[Feature, Support]] = {
    Feature.SHAPE_CAPSULE: approximate(
        "simspec writes the same solid as a cylinder and two spheres, since SDF 1.6 has no capsules"
    ),
    Feature.SHAPE_ELLIPSOID: never("SDF 1.6 has no ellipsoids"),
    Feature.CONSTRAINT_COUPLING: never("SDF 1.6 has no joints that follow others"),
    Feature.CONSTRAINT_LOOP: never("older readers of SDF expect trees"),
    Feature.FRAME: never("SDF 1.6 has no frames"),
}
"""The features that files of this version carry otherwise than newer versions."""


def classic(newer: tree.SdfWorld) -> tree.SdfWorld:
    """The file in SDF 1.6."""
    return dataclasses.replace(newer, version=CLASSIC, models=tuple(map(_model, newer.models)))


def _model(model: tree.SdfModel) -> tree.SdfModel:
    at: dict[str, Pose] = {}
    for link in model.links:
        at[link.name] = link.pose if link.relative_to is None else frames.compose(at[link.relative_to], link.pose)
    joints = tuple(dataclasses.replace(joint, mimic=None) for joint in _tree_joints(model))
    links = tuple(
        dataclasses.replace(
            link,
            relative_to=None,
            pose=at[link.name],
            inertial=link.inertial or Inertial(0.0),
            shapes=tuple(part for shape in link.shapes for part in _parts(shape)),
        )
        for link in model.links
    )
    return dataclasses.replace(model, links=links, joints=joints, frames=())


def _tree_joints(model: tree.SdfModel) -> Iterator[tree.SdfJoint]:
    """The joints of the tree: those that close loops stand after them, and are of links that have one already."""
    children: set[str] = set()
    for joint in model.joints:
        if joint.child not in children:
            children.add(joint.child)
            yield joint


def _parts(shape: tree.SdfShape) -> Iterator[tree.SdfShape]:
    """The shapes of the older language that stand for a shape."""
    if shape.kind == "capsule":
        radius, length = shape.size
        yield dataclasses.replace(shape, kind="cylinder")
        for end, height in (("top", length / 2.0), ("bottom", -length / 2.0)):
            place = frames.compose(shape.pose, Pose((0.0, 0.0, height)))
            yield dataclasses.replace(shape, name=f"{shape.name}__{end}", kind="sphere", size=(radius,), pose=place)
    elif shape.kind != "ellipsoid":
        yield shape


WORLD: Final = "world.sdf"
VERSION: Final = "1.9"
COUPLED: Final = "1.11"
"""The first version that has joints which follow others."""
UNLIMITED: Final = 1e16
"""SDF's number for no limit."""
JOINT_TYPES: Final = {"fixed": "fixed", "hinge": "revolute", "slide": "prismatic", "ball": "ball"}
PATCH: Final = 3.0 * math.pi / 16.0
"""Torsional friction as a length is this times the coefficient and the radius of the patch."""


class Sdf(Format):
    """SDF, without what the program that reads it makes of it."""

    NAME: ClassVar[str] = "sdf"
    SUPPORT: ClassVar[Table] = SUPPORT
    PROFILES: ClassVar[tuple[str, ...]] = (VERSION, CLASSIC)

    def __init__(self, profile: str = VERSION):
        self.profile = profile

    def in_profile(self, name: str) -> Format:
        """The format in this version. Raises SpecError for a name that is not of ``PROFILES``."""
        return Sdf(name) if name in self.PROFILES else super().in_profile(name)

    def write(self, tree: SdfWorld) -> dict[str, str]:
        """``world.sdf``, and the files of its meshes. Raises KeyError for kinds of joints and shapes that the language does
        not have, and ValueError for numbers that are not finite."""
        joints = [joint for model in tree.models for joint in model.joints]
        needed = COUPLED if any(joint.mimic is not None for joint in joints) else VERSION
        older = tree.version == CLASSIC
        content = {
            "version": tree.version or needed,
            "rotation": "" if older else ' rotation_format="quat_xyzw"',
            "world": tree,
            "type_of": JOINT_TYPES.__getitem__,
            "pose": lambda pose: _pose(pose, older),
            "sizes": _sizes,
            "limits": lambda joint: _limits(joint, math.inf if older else UNLIMITED),
            "patch": PATCH,
        }
        shapes = (shape for model in tree.models for link in model.links for shape in link.shapes)
        meshes = mesh_files(shape.size for shape in shapes if shape.kind == "mesh")
        return {WORLD: environment().get_template("sdf/world.sdf.j2").render(content), **meshes}

    def plain(self, world: types.World) -> PlainFiles:
        """``world.sdf``: a model for each tree."""
        world = without_implicit_damping(world)
        tree = plain_tree(world)
        if self.profile == CLASSIC:
            return PlainFiles(self.write(classic(tree)), losses(world, {**SUPPORT, **OLDER}, more_losses(world)))
        return PlainFiles(self.write(tree), losses(world, SUPPORT, more_losses(world)))

    def parts(self, world: types.World, files: Mapping[str, str]) -> Mapping[str, tuple[types.Body, ...]]:
        """``world.sdf``."""
        return {WORLD: world.bodies}

    def closes_loops(self, world: types.World) -> bool:
        """Whether some tree has a loop that is closed at zero: of others, and of profile 1.6, files have none."""
        return any(loops_within(world, bodies) for bodies in trees(world).values())

    def read(self, folder: Path) -> XmlElement:
        """The outermost element of ``world.sdf`` in ``folder``: its meaning is the importer's matter.

        Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no SDF.
        """
        root = read_xml(folder / WORLD)
        if root.tag != "sdf":
            raise ValueError(f"{WORLD}:{root.line}: the outermost element is <{root.tag[:60]}>, should be <sdf>")
        return root


def _pose(pose: Pose, older: bool) -> tuple[float, ...]:
    """Position and quaternion, or angles about fixed axes."""
    w, x, y, z = pose.quaternion
    if older:
        return (*pose.position, *frames.to_rpy(pose.quaternion))
    return (*pose.position, x, y, z, w)


def _sizes(shape: SdfShape) -> list[tuple[str, tuple[float, ...] | str]]:
    """The elements of a shape's geometry."""
    if shape.kind == "plane":
        return [("normal", (0.0, 0.0, 1.0)), ("size", (200.0, 200.0))]
    if shape.kind == "mesh":
        return [("uri", mesh_file(shape.size))]
    return [(name, shape.size[part]) for name, part in SIZES[shape.kind]]


def _limits(joint: SdfJoint, none: float) -> tuple[str, str]:
    lower, upper = joint.position_limits or (-none, none)
    return number(lower) if math.isfinite(lower) else "-inf", number(upper) if math.isfinite(upper) else "inf"
