"""The plain file in SDF 1.6, for readers that know no newer version.

Links stand in the model's frame, turns are angles about fixed axes, and a body that cannot move says that it has no mass:
older readers take 1 kg for what is not said, and read no ``relative_to`` and no quaternions. What the version lacks is put
otherwise, or left out: capsules are a cylinder and two balls, ellipsoids, joints that follow others, named frames and loops
are not in the file.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Final

from simspec.formats.sdf import tree
from simspec.support.declarations import Support, approximate, never
from simspec.support.features import Feature
from simspec.world import frames
from simspec.world.types import Inertial, Pose

CLASSIC: Final = "1.6"
"""The newest version that older readers know."""
OLDER: Final[Mapping[Feature, Support]] = {
    Feature.SHAPE_CAPSULE: approximate("a cylinder and two spheres: together the same solid; SDF 1.6 has no capsules"),
    Feature.SHAPE_ELLIPSOID: never("SDF 1.6 has no ellipsoids"),
    Feature.CONSTRAINT_COUPLING: never("SDF 1.6 has no joints that follow others"),
    Feature.CONSTRAINT_LOOP: never("older readers of SDF expect trees"),
    Feature.FRAME: never("SDF 1.6 has no frames"),
}
"""What files of this version carry otherwise than those of the newer ones."""


def classic(newer: tree.World) -> tree.World:
    """The file in SDF 1.6."""
    return dataclasses.replace(newer, version=CLASSIC, models=tuple(map(_model, newer.models)))


def _model(model: tree.Model) -> tree.Model:
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


def _tree_joints(model: tree.Model) -> Iterator[tree.Joint]:
    """The joints of the tree: those that close loops stand after them, and are of links that have one already."""
    held: set[str] = set()
    for joint in model.joints:
        if joint.child not in held:
            held.add(joint.child)
            yield joint


def _parts(shape: tree.Shape) -> Iterator[tree.Shape]:
    """The shapes of the older language that stand for a shape."""
    if shape.kind == "capsule":
        radius, length = shape.size
        yield dataclasses.replace(shape, kind="cylinder")
        for end, height in (("top", length / 2.0), ("bottom", -length / 2.0)):
            place = frames.compose(shape.pose, Pose((0.0, 0.0, height)))
            yield dataclasses.replace(shape, name=f"{shape.name}__{end}", kind="sphere", size=(radius,), pose=place)
    elif shape.kind != "ellipsoid":
        yield shape
