"""Shapes of a world as prims: collision and visual in one, hulls as meshes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from simspec.formats.usd.tree import Prim, Property
from simspec.world.types import Pose, Shape, Vector3

TYPES: Final = {
    "sphere": "Sphere",
    "box": "Cube",
    "cylinder": "Cylinder",
    "capsule": "Capsule",
    "plane": "Plane",
    "mesh": "Mesh",
}
PLANE: Final = 200.0
"""m; how far a plane is drawn: it collides without end."""


def place(prim: Prim, pose: Pose, before: Sequence[str] = (), scale: Vector3 | None = None) -> None:
    """Where a prim stands in the one that it is in."""
    prim.say("double3", "xformOp:translate", pose.position)
    prim.say("quatd", "xformOp:orient", pose.quaternion)
    order = [*before, "xformOp:translate", "xformOp:orient"]
    if scale is not None:
        prim.say("double3", "xformOp:scale", scale)
        order.append("xformOp:scale")
    prim.properties.append(Property("token[]", "xformOpOrder", order, uniform=True))


def shape_prim(shape: Shape, material: str) -> Prim | None:
    """The prim of a shape; None for a kind that the schemas do not have. ``material``: the path of its material."""
    kind = TYPES.get(shape.kind)
    if kind is None:
        return None
    prim = Prim(shape.name, kind)
    scale: Vector3 | None = None
    size = shape.size
    match shape.kind:
        case "sphere":
            prim.say("double", "radius", size[0])
            _extent(prim, (size[0],) * 3)
        case "box":
            prim.say("double", "size", 1.0)
            scale = (size[0], size[1], size[2])
            _extent(prim, (0.5,) * 3)
        case "cylinder" | "capsule":
            prim.uniform("axis", "Z")
            prim.say("double", "radius", size[0])
            prim.say("double", "height", size[1])
            cap = size[0] if shape.kind == "capsule" else 0.0
            _extent(prim, (size[0], size[0], 0.5 * size[1] + cap))
        case "plane":
            prim.uniform("axis", "Z")
            prim.say("double", "width", PLANE)
            prim.say("double", "length", PLANE)
            _extent(prim, (0.5 * PLANE, 0.5 * PLANE, 0.0))
        case "mesh":
            _mesh(prim, size)
    place(prim, shape.pose, scale=scale)
    red, green, blue, opacity = shape.colour
    prim.say("color3f[]", "primvars:displayColor", [(red, green, blue)])
    prim.say("float[]", "primvars:displayOpacity", [opacity])
    prim.own("double4", "colour", shape.colour)
    prim.uniform("purpose", "default" if shape.visual else "guide")
    if shape.collision:
        prim.apply("PhysicsCollisionAPI", "MaterialBindingAPI")
        prim.say("bool", "physics:collisionEnabled", True)
        if material:
            prim.relate("material:binding:physics", [material])
        if shape.kind == "mesh":
            prim.apply("PhysicsMeshCollisionAPI")
            prim.uniform("physics:approximation", "convexHull")
    return prim


def _extent(prim: Prim, half: Sequence[float]) -> None:
    prim.say("float3[]", "extent", [tuple(-value for value in half), tuple(half)])


def _mesh(prim: Prim, size: Sequence[float]) -> None:
    """A hull: triangles, anticlockwise from outside."""
    from simspec.world.hull import mesh_triangles

    triangles = mesh_triangles(tuple(size)).tolist()
    points = [tuple(size[start : start + 3]) for start in range(0, len(size), 3)]
    low, high = (tuple(limit(point[k] for point in points) for k in range(3)) for limit in (min, max))
    prim.say("float3[]", "extent", [low, high])
    prim.say("point3f[]", "points", points)
    prim.say("int[]", "faceVertexCounts", [3] * len(triangles))
    prim.say("int[]", "faceVertexIndices", [index for triangle in triangles for index in triangle])
    prim.uniform("subdivisionScheme", "none")
    prim.own("double3[]", "points", points)
