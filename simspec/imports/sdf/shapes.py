"""Collisions and visuals of SDF as shapes of the language."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from simspec.errors import Problem, SpecError
from simspec.imports.elements import Element
from simspec.imports.sdf.aside import IN_COLLISION, IN_VISUAL, set_aside
from simspec.imports.sdf.surfaces import Surface, read_surface
from simspec.imports.sdf.values import Placement, finite_of, lost, pose_of, unused, vector_of
from simspec.language.foreign import Fate, Severity
from simspec.world import frames
from simspec.world.types import Pose

DENSITY: Final = 1000.0
"""Of a collision that says none, where a link's inertia is to be computed."""
COLOUR: Final = (0.7, 0.7, 0.7, 1.0)
"""The language's default."""


@dataclass
class ShapeRead:
    """A shape, and where it stands in the file."""

    data: dict[str, Any]
    element: Element
    name: str
    surface: Surface | None = None
    """Of a shape that collides."""


def read_shapes(link: Element, move: Placement, density: float | None) -> list[ShapeRead]:
    """All shapes of a link, moved; a visual that is the same as a collision is one with it. ``density``: of collisions that say
    none, where the inertia is to be computed. Raises SpecError with every problem."""
    shapes: list[ShapeRead] = []
    problems: list[Problem] = []
    for child in link.look("collision", "visual"):
        child.take()
        try:
            shape = _collision(child, move, density) if child.tag == "collision" else _visual(child, move)
        except SpecError as error:
            problems.extend(error.problems)
            continue
        if shape is None:
            continue
        twin = _twin(shapes, shape)
        if twin is None:
            shapes.append(shape)
        else:
            _merge(twin, shape)
    if problems:
        raise SpecError(problems)
    return shapes


def _size(element: Element) -> dict[str, Any]:
    return {"box": {"size": list(vector_of(element, "size", (1.0, 1.0, 1.0)))}}


def _round(kind: str, radius: float, length: float | None) -> Callable[[Element], dict[str, Any]]:
    def read(element: Element) -> dict[str, Any]:
        sizes = {"radius": finite_of(element, "radius", radius)}
        if length is not None:
            sizes["length"] = finite_of(element, "length", length)
        return {kind: sizes}

    return read


def _ellipsoid(element: Element) -> dict[str, Any]:
    return {"ellipsoid": {"radii": list(vector_of(element, "radii", (1.0, 1.0, 1.0)))}}


GEOMETRY: Final[Mapping[str, Callable[[Element], dict[str, Any]]]] = {
    "box": _size,
    "sphere": _round("sphere", 1.0, None),
    "cylinder": _round("cylinder", 1.0, 1.0),
    "capsule": _round("capsule", 0.5, 1.0),
    "ellipsoid": _ellipsoid,
}
NOT_CARRIED: Final = {
    "mesh": "simspec does not support meshes of SDF yet",
    "heightmap": "simspec has no height fields",
    "image": "simspec makes no shapes of pictures",
    "polyline": "simspec has no extruded polygons",
    "cone": "simspec has no cones",
}


def _geometry(shape: Element) -> tuple[dict[str, Any], Placement] | None:
    """The kind and the size of a shape, with its pose against that of the element; None for what is not carried, which is then
    said. Raises SpecError for geometries that SDF does not have."""
    geometry = shape.child("geometry")
    if geometry is None:
        raise shape.error(f"<{shape.tag}> has no <geometry>")
    kinds = geometry.look()
    if len(kinds) != 1:
        raise geometry.error("<geometry> should have one shape in it", found=str(len(kinds)))
    kind = kinds[0]
    if kind.tag in GEOMETRY:
        return GEOMETRY[kind.tag](kind.take()), Placement()
    if kind.tag == "plane":
        kind.take()
        unused(next(iter(kind.look("size")), None), "a plane has no end", Severity.APPEARANCE)
        return {"plane": {}}, _upright(kind)
    if kind.tag == "empty":
        kind.take()
        return None
    if kind.tag not in NOT_CARRIED:
        raise kind.error(
            "not a shape of SDF", found=kind.tag[:60], allowed=", ".join((*GEOMETRY, "plane", *NOT_CARRIED))
        )
    if shape.tag == "collision":
        raise kind.error(NOT_CARRIED[kind.tag], allowed=", ".join((*GEOMETRY, "plane")))
    lost(kind, NOT_CARRIED[kind.tag], Severity.APPEARANCE)
    return None


def _upright(plane: Element) -> Placement:
    """The rotation that turns z into a plane's normal."""
    x, y, z = vector_of(plane, "normal", (0.0, 0.0, 1.0))
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        raise plane.error("the normal of a plane has no length")
    if x == 0.0 and y == 0.0 and z > 0.0:
        return Placement()
    if x == 0.0 and y == 0.0:
        return Placement(Pose((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)))
    half = (length + z, -y, x, 0.0)  # (1 + cos, axis × sin) of the turn from z, not yet of unit length
    return Placement(Pose((0.0, 0.0, 0.0), frames.normalise(half)))


def _posed(shape: Element, move: Placement) -> tuple[dict[str, Any], Placement] | None:
    read = _geometry(shape)
    pose = pose_of(shape)
    if pose.relative_to:
        raise shape.error("the pose of a shape against another frame is not supported", found=pose.relative_to[:80])
    if read is None:
        return None
    data, inner = read
    return data, move.then(pose.placement).then(inner)


def _collision(shape: Element, move: Placement, densities: float | None) -> ShapeRead | None:
    read = _posed(shape, move)
    set_aside(shape, IN_COLLISION)
    surface = read_surface(shape)
    density = finite_of(shape, "density", densities or DENSITY)
    if densities is None:
        unused(next(iter(shape.look("density")), None), "the file gives the mass")
    lost(next(iter(shape.look("auto_inertia_params")), None), "simspec computes inertias of its own shapes")
    if read is None:
        return None
    data, place = read
    if place.data():
        data["pose"] = place.data()
    if densities is not None and "plane" not in data:
        data["density"] = density
    data["visual"] = False
    return ShapeRead(data, shape, shape.word("name") or "", surface)


def _visual(shape: Element, move: Placement) -> ShapeRead | None:
    read = _posed(shape, move)
    set_aside(shape, IN_VISUAL)
    colour = _colour(shape)
    if read is None:
        return None
    data, place = read
    if place.data():
        data["pose"] = place.data()
    data["collision"] = False
    if colour is not None and colour != COLOUR:
        data["colour"] = list(colour)
    return ShapeRead(data, shape, shape.word("name") or "")


def _colour(shape: Element) -> tuple[float, ...] | None:
    material = shape.child("material")
    if material is None:
        return None
    for tag in ("ambient", "specular", "emissive", "shininess", "lighting", "script", "shader", "pbr", "double_sided"):
        for child in material.look(tag):
            lost(child, "a shape has one colour", Severity.APPEARANCE)
    lost(next(iter(material.look("render_order")), None), "a shape has one colour", Severity.APPEARANCE)
    material.set_aside("name", Fate.LOST, "a colour has no name", Severity.INFORMATION)
    diffuse = material.look("diffuse") or material.look("ambient")
    if not diffuse:
        return None
    values = diffuse[0].content(None)
    if len(values) not in (3, 4):
        raise diffuse[0].error("a colour has three or four numbers", found=diffuse[0].text[:80])
    return tuple(min(1.0, max(0.0, value)) for value in (*values, 1.0)[:4])


def _twin(shapes: list[ShapeRead], shape: ShapeRead) -> ShapeRead | None:
    """The collision of a visual, or the visual of a collision: the same shape at the same place."""
    drawn = shape.element.tag == "visual"
    mine = {key: value for key, value in shape.data.items() if key not in ("visual", "collision", "colour", "density")}
    for other in shapes:
        if other.element.tag == shape.element.tag or ("visual" if drawn else "collision") not in other.data:
            continue
        if {key: other.data[key] for key in other.data.keys() - {"visual", "collision", "colour", "density"}} == mine:
            return other
    return None


def _merge(twin: ShapeRead, shape: ShapeRead) -> None:
    """Make one shape of a collision and a visual."""
    for key in ("visual", "collision"):
        twin.data.pop(key, None)
    for key in ("colour", "density"):
        if key in shape.data:
            twin.data[key] = shape.data[key]
    if shape.surface is not None:
        twin.surface, twin.name = shape.surface, shape.name
    shape.element.set_aside("name", Fate.UNUSED, "one shape with its collision", Severity.INFORMATION)
