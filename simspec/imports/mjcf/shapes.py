"""Geoms and height fields of a compiled model as shapes of a spec."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from simspec.imports.mjcf.bodies import MjcfBodies, MjcfNames, Vector, inverse, numbers, pose, product, rotated
from simspec.imports.mjcf.contact import MjcfSurfaces
from simspec.language.shapes import MOST_VERTICES
from simspec.meshes.load import read_grid
from simspec.meshes.reading import MeshError

# --- height fields ---

MOST_ROWS: Final = 2**16
"""Heights that are written into a spec; of more, a picture that says the same is named."""
SAME: Final = 1e-6
"""Share of the range by which a picture may be off: the compiler has single precision."""


def height_field(bodies: MjcfBodies, number: int) -> dict[str, Any] | None:
    """The shape of a geom; None for what the language does not have: one on a body that may move, and one of more heights than
    are read."""
    model = bodies.model
    data, shares = int(model["geom_dataid"][number]), model.get("hfield_data")
    if shares is None or not _is_static(bodies, int(model["geom_bodyid"][number])):
        return None
    rows, columns = int(model["hfield_nrow"][data]), int(model["hfield_ncol"][data])
    half_x, half_y, top, base = model["hfield_size"][data].tolist()
    first = int(model["hfield_adr"][data])
    grid = shares[first : first + rows * columns].reshape(rows, columns)[::-1]  # as on a map: the greatest y first
    said = {"size": numbers([2.0 * half_x, 2.0 * half_y]), "heights": [0.0, float(top)], "base": float(base)}
    path = model.field_files.get(data)
    if path is not None and _says(path, grid):
        text = os.path.relpath(path, bodies.folder).replace(os.sep, "/")
        bodies.files[text] = path
        return {"heightfield": {"file": text, **said}}
    if rows * columns > MOST_ROWS:
        return None
    if not grid.any():  # all at the lowest, as in the compiled model
        said["heights"] = [0.0, 0.0]
    return {"heightfield": {"rows": [numbers(row) for row in grid], **said}}


def _is_static(bodies: MjcfBodies, body: int) -> bool:
    """Whether a body is fixed to the world, and none above it is moved as it is told."""
    if int(bodies.model["body_weldid"][body]) != 0:
        return False
    while body:
        if int(bodies.model["body_mocapid"][body]) >= 0:
            return False
        body = int(bodies.model["body_parentid"][body])
    return True


def _says(path: Path, grid: NDArray[Any]) -> bool:
    """Whether a file is a picture that the language reads, with these shares of its range."""
    if path.suffix.lower() != ".png":
        return False
    try:
        shades = read_grid(path)
    except MeshError:
        return False
    span = shades.max() - shades.min()
    return shades.shape == grid.shape and bool(np.abs((shades - shades.min()) / (span or 1.0) - grid).max() <= SAME)


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
SUFFIXES: Final = (".obj", ".stl", ".ply", ".msh")
"""Files of meshes that the language and the compiler read alike."""
MOST_FACES: Final = 200_000
"""Triangles of a mesh in the language."""
THINNEST: Final = 1e-6
"""Of a mesh's length: what is thinner is flat, and has no hull."""
HIDDEN: Final = 3
"""Groups from this one on are not drawn by default."""


def add_shapes(bodies: MjcfBodies, surfaces: MjcfSurfaces) -> None:
    """Give each body its shapes; those of the world are a body of their own, which is fixed."""
    model = bodies.model
    names = MjcfNames()
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


def _shape(bodies: MjcfBodies, surfaces: MjcfSurfaces, number: int) -> dict[str, Any] | None:
    model = bodies.model
    element = model.part("geom", number).element
    kind, body = int(model["geom_type"][number]), int(model["geom_bodyid"][number])
    material = surfaces.material(number)
    place, turn = model["geom_pos"][number], model["geom_quat"][number]
    maker = MAKERS.get(kind)
    if kind == MESH:
        made = _mesh(bodies, number, material is not None)
        shape, place, turn = made or (None, place, turn)
    elif kind == HEIGHT_FIELD:
        shape = height_field(bodies, number)
    else:
        shape = maker(numbers(model["geom_size"][number])) if maker else None
    if shape is None:
        bodies.features.add("geom.kind" if material is not None else "geom.appearance", element)
        return None
    where = pose(place - bodies.shifts[body], turn)
    if where:
        shape["pose"] = where
    if material is None:
        shape["collision"] = False
    else:
        shape["material"] = material
        if margin := surfaces.margin(number):
            shape["margin"] = margin
        if moving := _moving(bodies, number, place, turn):
            shape["surface_velocity"] = moving
        if int(model["geom_group"][number]) >= HIDDEN:
            shape["visual"] = False
    shape["colour"] = _colour(bodies, number)
    return shape


def _moving(bodies: MjcfBodies, number: int, place: Vector, turn: Vector) -> dict[str, Any]:
    """The velocity of a geom's surface, in the frame of the shape, which of a mesh is not the geom's; ``place``, ``turn``: of
    the shape in the file's frame of the body."""
    field = bodies.model.get("geom_surfacevel")
    if field is None or not field[number].any():
        return {}
    linear, angular = field[number][:3], field[number][3:]
    own_place, own_turn = bodies.model["geom_pos"][number], bodies.model["geom_quat"][number]
    if not (np.array_equal(place, own_place) and np.array_equal(turn, own_turn)):
        linear = linear + np.cross(angular, rotated(inverse(own_turn), place - own_place))
        into = product(inverse(turn), own_turn)
        linear, angular = rotated(into, linear), rotated(into, angular)
    return {name: numbers(value) for name, value in (("linear", linear), ("angular", angular)) if value.any()}


def _mesh(bodies: MjcfBodies, number: int, solid: bool) -> tuple[dict[str, Any], Vector, Vector] | None:
    """The shape of a mesh, and where the frame of its file is in the body's: the compiler moves meshes to their centre.
    None for what the language does not have."""
    model, data = bodies.model, int(bodies.model["geom_dataid"][number])
    mesh = model.meshes.get(data)
    if mesh is None or mesh.path is None or mesh.path.suffix.lower() not in SUFFIXES:
        return None
    flat = min(mesh.extent) < THINNEST * max(mesh.extent)
    scale, origin, own = (np.array(values) for values in (mesh.scale, mesh.origin, mesh.turn))
    turned = np.any(own[1:])
    if flat or mesh.faces > MOST_FACES or (turned and np.any(scale != scale[0])):
        return None
    turn = product(model["geom_quat"][number], inverse(model["mesh_quat"][data]))
    place = model["geom_pos"][number] - rotated(turn, model["mesh_pos"][data])
    own = own / np.linalg.norm(own)
    place = place - rotated(turn, scale * rotated(inverse(own), origin))
    text = os.path.relpath(mesh.path, bodies.folder).replace(os.sep, "/")
    bodies.files[text] = mesh.path
    said: dict[str, Any] = {"file": text}
    if np.any(scale != 1.0):
        said["scale"] = numbers(scale)
    if mesh.hull > MOST_VERTICES:
        said["max_vertices"] = MOST_VERTICES
        bodies.features.add("geom.hull" if solid else "geom.drawn_hull", model.part("geom", number).element)
    return {"mesh": said}, place, product(turn, inverse(own))


def _colour(bodies: MjcfBodies, number: int) -> list[float]:
    """Red, green, blue and opacity: the geom's own, else its material's."""
    model = bodies.model
    colour, material = model["geom_rgba"][number], int(model["geom_matid"][number])
    if material >= 0 and list(colour) == [0.5, 0.5, 0.5, 1.0]:
        colour = model["mat_rgba"][material]
    return [round(min(1.0, max(0.0, float(value))), 6) for value in colour]
