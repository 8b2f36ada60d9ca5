"""The shapes of a page: which are seen, which collide, and the triangles of those that have some."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from simspec.report.page.model import DIGITS, placed
from simspec.report.page.packing import FARTHEST, PackedNumbers
from simspec.world.hull import mesh_triangles, mesh_vertices
from simspec.world.shapes import SHAPES, field_of
from simspec.world.types import Shape, World

MOST_ROWS = 200
"""Rows, and columns, of a height field that are drawn: its points are indexed by numbers of 16 bits."""


def drawn_shapes(world: World, packed: PackedNumbers) -> list[dict[str, Any]]:
    """The shapes as ``page/src/data.ts`` declares them. Seen are the visual shapes, and planes; of a body without any, those
    that collide. Not those that are too large to be drawn."""
    shown = []
    hulls: dict[tuple[float, ...], dict[str, str]] = {}
    for index, body in enumerate(world.bodies):
        visual = any(map(_visual, body.shapes))
        for shape in filter(is_drawn, body.shapes):
            seen = _visual(shape) if visual else shape.collision
            if not seen and not shape.collision:
                continue
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
