"""The format ``skel``: one XML file, ``world.skel``.

Poses are a position and intrinsic X-Y-Z Euler angles: of bodies in the world at zero configuration, of shapes in their body, of
joints in their child.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, ClassVar, Final

from simspec.formats.kit.contract import Format
from simspec.formats.kit.mesh_reading import read_meshes
from simspec.formats.kit.meshes import mesh_file, mesh_files
from simspec.formats.kit.plain import Plain, losses
from simspec.formats.kit.text import environment
from simspec.formats.skel.document import Document
from simspec.formats.skel.from_world import GEOMETRY, JOINT_TYPES, PLANE, UNSCALED
from simspec.formats.skel.plain import SUPPORT, plain_tree, renamed
from simspec.formats.skel.tree import Body, Joint, Shape, World
from simspec.support.declarations import Table
from simspec.world import frames, types
from simspec.world.types import Pose

WORLD: Final = "world.skel"


class Skel(Format):
    """The .skel language, without what the program that reads it makes of it."""

    NAME: ClassVar[str] = "skel"
    SUPPORT: ClassVar[Table] = SUPPORT

    def write(self, tree: World) -> dict[str, str]:
        """``world.skel``, and the files of its meshes. Raises KeyError for kinds of joints and shapes that the language does
        not have, and ValueError for numbers that are not finite."""
        content = {
            "name": tree.name,
            "timestep": tree.timestep,
            "gravity": tree.gravity,
            "collision_detector": tree.collision_detector,
            "skeletons": [
                {
                    "name": skeleton.name,
                    "mobile": "true" if skeleton.mobile else "false",
                    "bodies": [_body(body) for body in skeleton.bodies],
                    "joints": [_joint(joint) for joint in skeleton.joints],
                }
                for skeleton in tree.skeletons
            ],
        }
        bodies = (body for skeleton in tree.skeletons for body in skeleton.bodies)
        shapes = (shape for body in bodies for shape in (*body.visual, *body.collision))
        meshes = mesh_files(shape.size for shape in shapes if shape.kind == "mesh")
        return {WORLD: environment().get_template("skel/world.skel.j2").render(content), **meshes}

    def plain(self, world: types.World) -> Plain:
        """``world.skel``, without a collision detector's name."""
        return Plain(self.write(plain_tree(world)), losses(world, SUPPORT, renamed(world)))

    def read(self, folder: Path) -> Document:
        """The document of ``world.skel`` in ``folder``, with the files of meshes below it.

        Raises FileNotFoundError; SpecError where it cannot be read; ValueError, which names file and line, where it is no
        .skel, or a mesh is no convex hull.
        """
        from simspec.formats.skel.reading import read_document

        return dataclasses.replace(read_document(folder / WORLD), meshes=read_meshes(folder))


def _transformation(pose: Pose) -> tuple[float, ...]:
    return (*pose.position, *frames.to_euler_xyz(pose.quaternion))


def _body(body: Body) -> dict[str, Any]:
    return {
        "name": body.name,
        "pose": _transformation(body.pose),
        "mass": body.inertial.mass,
        "inertia": body.inertial.inertia,
        "centre_of_mass": body.inertial.centre_of_mass,
        "visual": [_shape(shape) for shape in body.visual],
        "collision": [_shape(shape) for shape in body.collision],
    }


def _shape(shape: Shape) -> dict[str, Any]:
    sizes: tuple[tuple[str, tuple[float, ...] | str], ...] = PLANE
    if shape.kind == "mesh":
        sizes = (("file_name", mesh_file(shape.size)), ("scale", UNSCALED))
    elif shape.kind != "plane":
        parts, factor = GEOMETRY[shape.kind]
        sizes = tuple((name, tuple(value * factor for value in shape.size[part])) for name, part in parts)
    return {"kind": shape.kind, "sizes": sizes, "pose": _transformation(shape.pose), "colour": shape.colour}


def _joint(joint: Joint) -> dict[str, Any]:
    return {
        "name": joint.name,
        "type": JOINT_TYPES[joint.kind],
        "parent": "world" if joint.parent is None else joint.parent,
        "child": joint.child,
        "axis": joint.axis,
        "limits": joint.position_limits,
        "damping": joint.damping,
        "dry_friction": joint.dry_friction,
        "spring_rest": joint.spring_rest,
        "spring_stiffness": joint.spring_stiffness,
        "position": joint.position,
        "velocity": joint.velocity,
    }
