"""From the nodes of a Solid back to the shapes of its body: those that are drawn, and those of its boundingObject."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from simspec.dialects.webots.raised_places import pose_of
from simspec.dialects.webots.sidecar import ShapeEntry
from simspec.formats.wbt.document import Node
from simspec.world.types import Shape, Surface

KINDS: Final = {"Sphere": "sphere", "Box": "box", "Cylinder": "cylinder", "Capsule": "capsule", "Plane": "plane"}


def shapes_of(solid: Node, entries: Sequence[ShapeEntry]) -> tuple[Shape, ...]:
    """The shapes of a body in the order of the sidecar, which says which of them are seen and which are solid. Raises
    ValueError where the nodes are not those."""
    drawn = [_drawn(node) for node in solid.nodes("children") if node.kind == "Pose"]
    bounding, material = solid.node("boundingObject"), solid.text("contactMaterial")
    stops: list[Shape] = []
    if bounding is not None:
        if bounding.kind != "Group":
            raise bounding.refused("should be a Group")
        stops = [_shape(node, _inside(node)) for node in bounding.nodes("children")]
    elif material != "default":
        raise solid.refused("has a contactMaterial and no boundingObject")
    shapes = []
    for entry in entries:
        if (entry.visual and not drawn) or (entry.solid and not stops):
            raise solid.refused(f"has too few shapes for {entry.name!r} of the sidecar")
        seen = drawn.pop(0) if entry.visual else None
        felt = stops.pop(0) if entry.solid else None
        read = felt or seen
        if read is None:
            raise solid.refused(f"{entry.name!r} is neither seen nor solid")
        if seen and felt and (seen.kind, seen.size, seen.pose) != (felt.kind, felt.size, felt.pose):
            raise solid.refused(f"{entry.name!r} is drawn otherwise than it is solid")
        read = replace(read, name=entry.name, visual=entry.visual, collision=entry.solid)
        if seen is not None:
            read = replace(read, colour=seen.colour)
        if felt is not None:
            read = replace(read, material=material, surfaces=(Surface(),))
        shapes.append(read)
    if drawn or stops:
        raise solid.refused("has shapes that the sidecar does not name")
    return tuple(shapes)


def _drawn(node: Node) -> Shape:
    shape = _inside(node)
    if shape.kind != "Shape":
        raise shape.refused("should be a Shape")
    look, geometry = shape.node("appearance"), shape.node("geometry")
    if look is None or look.kind != "PBRAppearance" or geometry is None:
        raise shape.refused("should have a PBRAppearance and a geometry")
    red, green, blue = look.numbers("baseColor", 3)
    return replace(_shape(node, geometry), colour=(red, green, blue, 1.0 - look.number("transparency")))


def _inside(node: Node) -> Node:
    """The one node in a Pose."""
    if node.kind != "Pose":
        raise node.refused("should be a Pose")
    inside = node.nodes("children")
    if len(inside) != 1:
        raise node.refused(f"has {len(inside)} nodes, should have one")
    return inside[0]


def _shape(pose: Node, geometry: Node) -> Shape:
    kind = KINDS.get(geometry.kind)
    if kind is None:
        raise geometry.refused("is no geometry that simspec writes")
    if kind == "box":
        size = geometry.numbers("size", 3)
    elif kind == "plane":
        size = ()
    else:
        size = (geometry.number("radius"),)
        size += () if kind == "sphere" else (geometry.number("height"),)
    if not all(length > 0.0 for length in size):
        raise geometry.refused("should have sizes above zero")
    return Shape("", kind, size, pose_of(pose))
