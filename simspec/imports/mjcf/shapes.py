"""Geoms of a compiled model as shapes of a spec."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from simspec.imports.mjcf.bodies import Bodies, Names, numbers, pose
from simspec.imports.mjcf.surfaces import Surfaces

PLANE, HEIGHT_FIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(8)
"""Types of geoms."""
MAKERS: Final[Mapping[int, Callable[[Sequence[float]], dict[str, Any]]]] = {
    PLANE: lambda _: {"plane": {}},
    SPHERE: lambda size: {"sphere": {"radius": size[0]}},
    CAPSULE: lambda size: {"capsule": {"radius": size[0], "length": 2.0 * size[1]}},
    ELLIPSOID: lambda size: {"ellipsoid": {"radii": list(size)}},
    CYLINDER: lambda size: {"cylinder": {"radius": size[0], "length": 2.0 * size[1]}},
    BOX: lambda size: {"box": {"size": [2.0 * value for value in size]}},
}
"""The word of a shape and its sizes: geoms have half lengths."""
HIDDEN: Final = 3
"""Groups from this one on are not drawn by default."""


def add_shapes(bodies: Bodies, surfaces: Surfaces) -> None:
    """Give each body its shapes; those of the world are a body of their own, which is fixed."""
    model = bodies.model
    names = Names()
    for number in range(model.numbers["ngeom"]):
        part = model.part("geom", number)
        shape = _shape(bodies, surfaces, number)
        if shape is None:
            continue
        if part.name:
            shape = {"name": names.give(part.name, "geom"), **shape}
        body = int(model["geom_bodyid"][number])
        if body == 0:
            name = bodies.named(0)
            bodies.places.setdefault((name,), part.element.location)
        else:
            name = bodies.names[body]
        shapes = bodies.data[name].setdefault("shapes", [])
        bodies.places[name, "shapes", len(shapes)] = part.element.location
        shapes.append(shape)


def _shape(bodies: Bodies, surfaces: Surfaces, number: int) -> dict[str, Any] | None:
    model = bodies.model
    element = model.part("geom", number).element
    kind, body = int(model["geom_type"][number]), int(model["geom_bodyid"][number])
    material = surfaces.material(number)
    maker = MAKERS.get(kind)
    if maker is None:
        bodies.features.add("geom.kind" if material is not None else "geom.appearance", element)
        return None
    shape = maker(numbers(model["geom_size"][number]))
    where = pose(model["geom_pos"][number] - bodies.shifts[body], model["geom_quat"][number])
    if where:
        shape["pose"] = where
    if material is None:
        shape["collision"] = False
    else:
        shape["material"] = material
        if int(model["geom_group"][number]) >= HIDDEN:
            shape["visual"] = False
    shape["colour"] = _colour(bodies, number)
    return shape


def _colour(bodies: Bodies, number: int) -> list[float]:
    """Red, green, blue and opacity: the geom's own, else its material's."""
    model = bodies.model
    colour, material = model["geom_rgba"][number], int(model["geom_matid"][number])
    if material >= 0 and list(colour) == [0.5, 0.5, 0.5, 1.0]:
        colour = model["mat_rgba"][material]
    return [round(min(1.0, max(0.0, float(value))), 6) for value in colour]
