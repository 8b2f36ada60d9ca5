"""The surfaces that a stored run is drawn with: its files of meshes may change, or be missing where a report is made."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from simspec.meshes.drawn import Wanted, plain_surface, surface_of, surfaces, wanted
from simspec.world.appearance import DrawnMesh
from simspec.world.types import World

VERSION = 1


def looks_of(world: World) -> str | None:
    """The drawn surfaces of a world as JSON; None where there are none."""
    known = surfaces(world)
    if not known:
        return None
    numbers = {item: number for number, item in enumerate(known)}
    shapes = [
        [body.name, shape.name, numbers[wanted(shape.drawn)], *_place(shape.drawn)]
        for body in world.bodies
        for shape in body.shapes
        if shape.drawn is not None and wanted(shape.drawn) in numbers
    ]
    plain = {
        "simspec_looks": VERSION,
        "surfaces": [plain_surface(surface) for surface in known.values()],
        "shapes": shapes,
    }
    return json.dumps(plain, separators=(",", ":"), allow_nan=False) + "\n"


def _place(drawn: DrawnMesh) -> tuple[list[float], list[float], bool, bool]:
    return list(drawn.position), list(drawn.quaternion), drawn.coloured, drawn.first


def with_looks(world: World, plain: Any) -> World:
    """A stored world whose shapes are drawn with the surfaces of ``plain``. Raises ValueError, KeyError or TypeError where it
    is no JSON of :func:`looks_of`."""
    if plain["simspec_looks"] != VERSION:
        return world
    known = [surface_of(entry) for entry in plain["surfaces"]]
    drawn: dict[tuple[str, str], DrawnMesh] = {}
    for body, shape, number, position, quaternion, coloured, first in plain["shapes"]:
        x, y, z = map(float, position)
        qw, qx, qy, qz = map(float, quaternion)
        drawn[str(body), str(shape)] = DrawnMesh(
            *_numbered(int(number)), (x, y, z), (qw, qx, qy, qz), bool(coloured), bool(first), known[number]
        )
    bodies = tuple(
        dataclasses.replace(
            body,
            shapes=tuple(dataclasses.replace(shape, drawn=drawn.get((body.name, shape.name))) for shape in body.shapes),
        )
        for body in world.bodies
    )
    return dataclasses.replace(world, bodies=bodies)


def _numbered(number: int) -> Wanted:
    """A stored surface has its number in place of a file."""
    return f"#{number}", None, None, (1.0, 1.0, 1.0)
