"""The format ``urdf``: the Unified Robot Description Format, one tree of links a file."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import ClassVar

from simspec.formats.kit.contract import Format
from simspec.formats.kit.mesh_reading import read_meshes
from simspec.formats.kit.meshes import FIELDS, field_files, mesh_files
from simspec.formats.kit.plain import Plain, losses
from simspec.formats.kit.text import environment
from simspec.formats.urdf.document import Document
from simspec.formats.urdf.plain import PLACEMENT, PROFILES, SUPPORT, placeholders, robots_and_placement
from simspec.formats.urdf.tree import Geometry, Robots
from simspec.support.declarations import Table
from simspec.world import types
from simspec.world.types import World

INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
"""The attributes of an ``inertia``, in the order of :class:`simspec.formats.urdf.tree.Inertial`."""


class Urdf(Format):
    """Files of the format ``urdf``: NAME.urdf for each distinct tree."""

    NAME: ClassVar[str] = "urdf"
    SUPPORT: ClassVar[Table] = SUPPORT
    RANGED: ClassVar[tuple[str, ...]] = ("slide",)
    PROFILES: ClassVar[tuple[str, ...]] = PROFILES

    def __init__(self, profile: str = PROFILES[0]):
        self.profile = profile

    def in_profile(self, name: str) -> Format:
        """The format in this layout. Raises SpecError for a name that is not of ``PROFILES``."""
        return Urdf(name) if name in self.PROFILES else super().in_profile(name)

    def write(self, tree: Robots) -> dict[str, str]:
        """A file for each robot, and the files of their meshes."""
        template = environment().get_template("urdf/model.urdf.j2")
        robots = {name: template.render(robot=robot, inertia=INERTIA) for name, robot in tree.items()}
        fields = (geometry.field for geometry in _geometries(tree) if geometry.field)
        hulls = (geometry.mesh for geometry in _geometries(tree) if geometry.mesh)
        return {**robots, **mesh_files(hulls), **field_files(fields)}

    def plain(self, world: World) -> Plain:
        """One file for each distinct tree; where the trees stand and how they begin goes into ``placement.json``."""
        robots, placement = robots_and_placement(world, self.profile)
        return Plain({**self.write(robots), PLACEMENT: placement}, losses(world, SUPPORT, placeholders(world)))

    def parts(self, world: World, files: Mapping[str, str]) -> Mapping[str, tuple[types.Body, ...]]:
        """The file of each distinct tree, with the bodies of the first tree that has it."""
        bodies = {body.name: body for body in world.bodies}
        found: dict[str, tuple[types.Body, ...]] = {}
        for tree in json.loads(files[PLACEMENT])["trees"]:
            found.setdefault(tree["file"], tuple(bodies[link["name"]] for link in tree["links"]))
        return found

    def read(self, folder: Path) -> Document:
        """All robots of a folder, with the files of meshes below it. Raises ValueError, which names the place."""
        from simspec.formats.urdf.reading import read_folder

        return dataclasses.replace(read_folder(folder), meshes=read_meshes(folder, FIELDS))


def _geometries(robots: Robots) -> Iterator[Geometry]:
    for robot in robots.values():
        for link in robot.links:
            yield from (visual.geometry for visual in link.visuals)
            yield from (collision.geometry for collision in link.collisions)
