"""What URDF means, in the world's types: frames, inertias, shapes of the language. For everybody who reads a document.

What is absent has the value that the language gives it: no turn, no way, the axis x.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from types import MappingProxyType

from simspec.formats.kit.text import FIELDS
from simspec.formats.kit.xml_elements import XmlElement
from simspec.formats.urdf.reading import (
    UrdfDocument,
    UrdfInertialNode,
    UrdfLinkNode,
    UrdfOriginNode,
    UrdfShapeNode,
)
from simspec.world import frames
from simspec.world.types import Inertial as WorldInertial
from simspec.world.types import Pose, Vector3
from simspec.world.types import Shape as WorldShape

Size = tuple[str, tuple[float, ...]]
"""The kind of a shape, and its size as in :class:`simspec.world.types.Shape`."""

DEFAULT_AXIS: Vector3 = (1.0, 0.0, 0.0)


def pose_of(origin: UrdfOriginNode | None) -> Pose:
    """An origin as a pose."""
    if origin is None:
        return Pose()
    return Pose(origin.xyz or (0.0, 0.0, 0.0), frames.from_rpy(*(origin.rpy or (0.0, 0.0, 0.0))))


def inertial_of(inertial: UrdfInertialNode | None) -> WorldInertial:
    """Mass, centre of mass, and the tensor turned into the link's axes. A link without one has no mass."""
    if inertial is None:
        return WorldInertial(0.0)
    pose = pose_of(inertial.origin)
    tensor = tuple(value or 0.0 for value in inertial.inertia)
    return WorldInertial(inertial.mass, pose.position, frames.rotate_inertia(pose.quaternion, tensor))


def check_empty(link: UrdfLinkNode) -> None:
    """Raise ValueError where a link that only stands for the world has a mass or shapes."""
    if inertial_of(link.inertial).mass or link.visuals or link.collisions:
        raise link.node.error(f"link {link.name!r} stands for the world, and has a mass or shapes")


def size_of(geometry: XmlElement, meshes: Mapping[str, tuple[float, ...]] = MappingProxyType({})) -> Size:
    """The kind and size of a geometry of the language. ``meshes``: the vertices of convex hulls, and the sizes of height
    fields, by the name of their file; other meshes are not read. Raises ValueError for others."""
    if geometry.tag == "mesh":
        name = geometry.word("filename")
        if name not in meshes or "scale" in geometry.attributes:
            raise geometry.error(f"the mesh {name[:60]!r} is missing, or is scaled, which is not read here")
        return "heightfield" if name.startswith(f"{FIELDS}/") else "mesh", meshes[name]
    if geometry.tag == "box":
        geometry.word("size")
        return "box", geometry.numbers("size", 3) or ()
    if geometry.tag == "sphere":
        return "sphere", (geometry.need_number("radius"),)
    if geometry.tag == "cylinder":
        return "cylinder", (geometry.need_number("radius"), geometry.need_number("length"))
    raise geometry.error(f"a <{geometry.tag[:60]}> is not read here")


def check_meshes(document: UrdfDocument) -> None:
    """Raise ValueError where no shape names a mesh that is there."""
    shapes = (
        shape
        for robot in document.robots.values()
        for link in robot.links
        for shape in (*link.visuals, *link.collisions)
    )
    named = {shape.geometry.attributes.get("filename") for shape in shapes}
    if unused := document.meshes.keys() - named:
        raise ValueError(f"no shape is the mesh of {', '.join(sorted(unused))}")


def shapes_of(
    link: UrdfLinkNode, size: Callable[[XmlElement], Size] = size_of, unseen: Callable[[Size], bool] | None = None
) -> dict[str, WorldShape]:
    """The shapes of a link by name; a ``visual`` and a ``collision`` of one name are one shape.

    ``size`` reads a geometry; visuals of which ``unseen`` is true are left out. Raises ValueError for shapes without a name or
    colour, and where two of one name are not the same.
    """
    shapes: dict[str, WorldShape] = {}
    for visual, elements in ((False, link.collisions), (True, link.visuals)):
        for element in elements:
            kind, numbers = size(element.geometry)
            if visual and unseen is not None and unseen((kind, numbers)):
                continue
            name = element.node.word("name")
            fresh = WorldShape(name, kind, numbers, pose_of(element.origin), collision=False, visual=False)
            known = shapes.get(name, fresh)
            if (known.kind, known.size, known.pose) != (kind, numbers, fresh.pose):
                raise element.node.error(f"link {link.name!r}: visual and collision of shape {name!r} differ")
            if known.visual if visual else known.collision:
                raise element.node.error(f"link {link.name!r} has two shapes {name!r}")
            if visual:
                shapes[name] = dataclasses.replace(known, visual=True, colour=_colour(element))
            else:
                shapes[name] = dataclasses.replace(known, collision=True)
    return shapes


def _colour(visual: UrdfShapeNode) -> tuple[float, float, float, float]:
    rgba = visual.material.rgba if visual.material is not None else None
    if rgba is None:
        raise visual.node.error(f"the visual {visual.name!r} has no colour")
    return (rgba[0], rgba[1], rgba[2], rgba[3])
