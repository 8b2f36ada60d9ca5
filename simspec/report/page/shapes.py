"""The shapes of a page: which are seen, which collide, and the triangles of those that have some."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from simspec.meshes.drawn import Wanted, wanted
from simspec.report.page.model import DIGITS, placed
from simspec.report.page.packing import FARTHEST, PackedNumbers, coded
from simspec.world.appearance import DrawnMesh, DrawnSurface, Rgba
from simspec.world.hull import mesh_triangles, mesh_vertices
from simspec.world.kinematics import rigid_groups
from simspec.world.shapes import SHAPES, field_of
from simspec.world.types import GREY, Pose, Shape, World

Surfaces = Mapping[Wanted, DrawnSurface]
MOST_ROWS = 200
"""Rows, and columns, of a height field that are drawn: its points are indexed by numbers of 16 bits."""
TINTS: tuple[Rgba, ...] = (
    (0.40, 0.60, 0.82, 1.0),
    (0.93, 0.72, 0.38, 1.0),
    (0.48, 0.74, 0.62, 1.0),
    (0.85, 0.61, 0.74, 1.0),
    (0.86, 0.55, 0.42, 1.0),
    (0.62, 0.78, 0.92, 1.0),
    (0.62, 0.58, 0.80, 1.0),
    (0.72, 0.74, 0.46, 1.0),
)
"""Colours of moving bodies in a world without colours: lighter ones of those that runs have on the page."""


def painted(world: World) -> World:
    """``world`` with a colour for each moving body, where no shape has a colour and no mesh is drawn as its file has it."""
    shapes = [shape for body in world.bodies for shape in body.shapes]
    if any(shape.colour != GREY or shape.drawn is not None for shape in shapes):
        return world
    groups = rigid_groups(world)
    moving = [body.name for body in world.bodies if groups[body.name] != "world" and body.shapes]
    tints = {name: TINTS[index % len(TINTS)] for index, name in enumerate(moving)}
    bodies = tuple(
        dataclasses.replace(
            body, shapes=tuple(dataclasses.replace(shape, colour=tints[body.name]) for shape in body.shapes)
        )
        if body.name in tints
        else body
        for body in world.bodies
    )
    return dataclasses.replace(world, bodies=bodies)


def drawn_shapes(world: World, packed: PackedNumbers, surfaces: Surfaces) -> list[dict[str, Any]]:
    """The shapes as ``page/src/data.ts`` declares them. Seen are the visual shapes, and planes; of a body without any, those
    that collide. Not those that are too large to be drawn. ``surfaces``: drawn in place of hulls that are seen."""
    shown: list[dict[str, Any]] = []
    hulls: dict[tuple[float, ...], dict[str, str]] = {}
    coloured: dict[Wanted, list[tuple[Rgba | None, dict[str, Any]]]] = {}
    for index, body in enumerate(painted(world).bodies):
        visual = any(map(_visual, body.shapes))
        for shape in filter(is_drawn, body.shapes):
            seen = _visual(shape) if visual else shape.collision
            if not seen and not shape.collision:
                continue
            drawn = shape.drawn
            if seen and drawn is not None and (surface := surfaces.get(wanted(drawn))) is not None:
                if drawn.first:
                    parts = coloured.setdefault(wanted(drawn), _packed_surface(surface, packed))
                    shown += _entries(index, shape, drawn, parts)
                if not shape.collision:
                    continue
                seen = False
            shown.append(
                {
                    "body": index,
                    "kind": "mesh" if SHAPES[shape.kind].grid else shape.kind,  # drawn as its triangles
                    "seen": seen,
                    "solid": shape.collision,
                    **_size(shape, hulls, packed),
                    **placed(shape.pose),
                    "colour": [round(part, 3) for part in shape.colour],
                }
            )
    return shown


def _visual(shape: Shape) -> bool:
    return shape.visual or shape.kind == "plane"


def _entries(
    body: int, shape: Shape, drawn: DrawnMesh, parts: Sequence[tuple[Rgba | None, dict[str, Any]]]
) -> Iterator[dict[str, Any]]:
    """A surface as shapes, one for each of its colours."""
    for colour, hull in parts:
        yield {
            "body": body,
            "kind": "mesh",
            "seen": True,
            "solid": False,
            "size": [],
            "hull": hull,
            **placed(Pose(drawn.position, drawn.quaternion)),
            "colour": [round(part, 3) for part in (shape.colour if drawn.coloured or colour is None else colour)],
        }


def _packed_surface(surface: DrawnSurface, packed: PackedNumbers) -> list[tuple[Rgba | None, dict[str, Any]]]:
    """The triangles of each colour of a surface; vertices are rounded to 16 bits between two corners."""
    vertices = np.frombuffer(surface.vertices, "<f4").reshape(-1, 3).astype(np.float64)
    triangles = np.frombuffer(surface.triangles, "<u2").reshape(-1, 3)
    low, high = vertices.min(axis=0), vertices.max(axis=0) + 1e-9
    box = {"low": np.round(low, DIGITS + 2).tolist(), "high": np.round(high, DIGITS + 2).tolist()}
    places = packed.codes(coded(vertices, low, high))
    made = []
    first = 0
    for colour, count in surface.colours:
        corners = packed.codes(np.ascontiguousarray(triangles[first : first + count]).view(np.int16))
        made.append((colour, {"vertices": places, "triangles": corners, **box}))
        first += count
    return made


def surfaces_note(surfaces: Surfaces) -> str | None:
    """How the drawn surfaces differ from those of the files; None where they do not."""
    drawn, whole = (
        sum(values) for values in ([s.count for s in surfaces.values()], [s.faces for s in surfaces.values()])
    )
    if not whole or drawn > 0.99 * whole:  # degenerate triangles are left out
        return None
    return f"Meshes are drawn with {drawn:,} of their {whole:,} triangles."


def _size(shape: Shape, hulls: dict[tuple[float, ...], dict[str, str]], packed: PackedNumbers) -> dict[str, Any]:
    """A shape's lengths; of a mesh or a height field its vertices and faces, packed once for each size."""
    if not (SHAPES[shape.kind].points or SHAPES[shape.kind].grid):
        return {"size": [round(length, DIGITS) for length in shape.size]}
    if shape.size not in hulls:
        points, corners = (
            drawn_field(shape.size)
            if SHAPES[shape.kind].grid
            else (mesh_vertices(shape.size), mesh_triangles(shape.size))
        )
        vertices, triangles = packed.floats(points), packed.codes(corners.astype(np.uint16).view(np.int16))
        hulls[shape.size] = {"vertices": vertices, "triangles": triangles}
    return {"size": [], "hull": hulls[shape.size]}


def drawn_field(size: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """The boundary of a height field, of a large one with some of its rows and columns."""
    field = field_of(size)
    kept = [np.unique(np.linspace(0, count - 1, min(count, MOST_ROWS)).round().astype(int)) for count in field.shape]
    return dataclasses.replace(field, heights=field.heights[np.ix_(*kept)]).closed()


def is_drawn(shape: Shape) -> bool:
    """Whether a shape and its place are small enough to be drawn."""
    return all(abs(length) < FARTHEST for length in (*shape.size, *shape.pose.position))
