"""What everybody who writes a world as URDF has in common: frames, inertias, shapes, names of files."""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping
from typing import Final

from simspec.formats.kit.meshes import field_file, mesh_file
from simspec.formats.urdf.tree import (
    Attributes,
    Collision,
    Geometry,
    Inertial,
    Material,
    Origin,
    Robot,
    Visual,
    nameless,
)
from simspec.world import frames
from simspec.world.inertia import principal_axes
from simspec.world.types import Body, Pose, Shape
from simspec.world.types import Inertial as WorldInertial

GEOMETRY: Final[Mapping[str, tuple[str, tuple[tuple[str, slice], ...]]]] = {
    "sphere": ("sphere", (("radius", slice(0, 1)),)),
    "box": ("box", (("size", slice(0, 3)),)),
    "cylinder": ("cylinder", (("radius", slice(0, 1)), ("length", slice(1, 2)))),
}
"""For each kind of shape with a few sizes the element, and which part of ``Shape.size`` goes into which attribute."""
KINDS: Final = (*GEOMETRY, "mesh")
"""The kinds of shapes that the language has."""


UNLIMITED: Final = 1e9
"""What stands where the language demands a limit, and the world has none."""
WORLD_LINK: Final = "world"
"""The link without mass that stands for the world, where a tree is fixed to it."""


def origin_of(pose: Pose) -> Origin:
    """A pose as URDF's position and fixed-axis angles."""
    return Origin(pose.position, frames.to_rpy(pose.quaternion))


def principal_inertial(inertial: WorldInertial) -> Inertial:
    """Mass and principal moments, in a frame of the principal axes: no product of inertia is left."""
    moments, turn = principal_axes(inertial.inertia)
    return Inertial(origin_of(Pose(inertial.centre_of_mass, turn)), inertial.mass, (*moments, 0.0, 0.0, 0.0))


def full_inertial(inertial: WorldInertial) -> Inertial:
    """Mass and the whole tensor, in axes parallel to the body's."""
    return Inertial(Origin(inertial.centre_of_mass), inertial.mass, inertial.inertia)


def geometry_of(shape: Shape) -> Geometry:
    """The geometry of a shape that the language has, and of a height field its closed surface. Raises KeyError for others."""
    if shape.kind == "mesh":
        return Geometry("mesh", (("filename", mesh_file(shape.size)),), shape.size)
    if shape.kind == "heightfield":
        return Geometry("mesh", (("filename", field_file(shape.size)),), field=shape.size)
    tag, parts = GEOMETRY[shape.kind]
    attributes: Attributes = tuple((name, shape.size[part]) for name, part in parts)
    return Geometry(tag, attributes)


def visual_of(shape: Shape, geometry: Geometry, material: str) -> Visual:
    """A shape that is seen, in a material of this name."""
    return Visual(shape.name, geometry, origin_of(shape.pose), Material(material, shape.colour))


def collision_of(shape: Shape, geometry: Geometry) -> Collision:
    """A shape that touches."""
    return Collision(shape.name, geometry, origin_of(shape.pose))


def unlike(name: str, taken: set[str]) -> str:
    """``name``, with as many underscores as make it unlike those ``taken``."""
    while name in taken:
        name += "_"
    return name


def limits_of(body: Body) -> tuple[tuple[str, float], ...]:
    """Attributes of a joint's ``limit``, as far as the world has them."""
    joint = body.joint
    limits: list[tuple[str, float]] = []
    if joint.position_limits is not None:
        limits += zip(("lower", "upper"), joint.position_limits, strict=True)
    if joint.effort_limit is not None:
        limits.append(("effort", joint.effort_limit))
    if joint.velocity_limit is not None:
        limits.append(("velocity", joint.velocity_limit))
    return tuple(limits)


class Files:
    """The robots of a folder by file: equal ones, apart from their names, share the file of the first."""

    def __init__(self, taken: set[str]) -> None:
        """``taken``: names of files that are there already, in small letters."""
        self.robots: dict[str, Robot] = {}
        self._taken = taken
        self._file_of: dict[Hashable, str] = {}

    def add(self, robot: Robot, apart: Hashable = None) -> str:
        """The name of the file that holds ``robot``, or one like it with the same ``apart``."""
        key = (nameless(robot), apart)
        file = self._file_of.get(key)
        if file is None:
            file = self._file_of[key] = self._file_name(robot.name)
            self.robots[file] = robot
        return file

    def _file_name(self, name: str) -> str:
        """A safe file name for a tree, unlike those taken (also where letters' case makes no difference)."""
        stem = re.sub(r"[^A-Za-z0-9_-]", ".", name).strip(".") or "tree"
        file, count = f"{stem}.urdf", 1
        while file.lower() in self._taken:
            count += 1
            file = f"{stem}.{count}.urdf"
        self._taken.add(file.lower())
        return file
