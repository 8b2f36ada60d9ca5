"""What a world takes from a file of triangles: convex solids with their frames, and the solid that the surface encloses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simspec.meshes.closed import Enclosed, enclosed, merged
from simspec.meshes.files import MeshError
from simspec.meshes.reading import Surface
from simspec.meshes.reduced import reduced
from simspec.world.hull import FlatError, Points, Solid, centred, corners, hull, mesh_size
from simspec.world.types import Pose

FURTHEST = 1e5
"""m from the origin of the shape's frame: what is further is in another unit."""
LARGEST = 40_000
"""Vertices of a file's hull, however few are asked for: to choose 128 of these takes 5 s of processor time (measured), and more
come only of files that are scans of round things, or made to take long."""
SAME = 1e-9
"""Share by which two volumes of one solid may differ by round-off."""
Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MeshOptions:
    """How a file is taken. ``unit`` (m) and ``up`` None: as the file says, else ``up`` of its language, and metres."""

    unit: float | None = None
    up: str | None = None
    scale: Triple = (1.0, 1.0, 1.0)
    pieces: bool = False
    max_vertices: int | None = None


@dataclass(frozen=True, slots=True)
class Convex:
    """A convex solid: ``size`` as a world's shape has it, ``pose`` of its frame in the mesh's frame, the largest distance (m)
    from the hull of which it has only some of the vertices, and how many that has."""

    size: tuple[float, ...]
    pose: Pose
    error: float
    vertices: int


@dataclass(frozen=True, slots=True)
class MadeMesh:
    """What was made of a file: its ``parts``, of the volume ``hull_volume`` (m³) the hull of all; the solid that its surface
    encloses, None where ``open_because`` says why that is not closed, and of how many closed ``surfaces`` it is made."""

    parts: tuple[Convex, ...]
    hull_volume: float
    enclosed: Solid | None
    open_because: str = ""
    surfaces: int = 1


class ManyVerticesError(MeshError):
    """A hull has more vertices than are allowed, and its options do not say how many it may have."""


class FlatMeshError(MeshError):
    """All points of a mesh are in one plane, or nearly so."""


def made(surface: Surface, options: MeshOptions, most_vertices: int = LARGEST) -> MadeMesh:
    """What a world takes from ``surface``; a hull whose options allow any number of vertices may have ``most_vertices``. Raises
    MeshError where no solid can be made of it, before more is computed of a hull that has too many."""
    vertices, triangles = merged(_placed(surface, options), surface.triangles)
    if _mirrored(options):
        triangles = triangles[:, ::-1]
    if len(vertices) and not np.abs(vertices).max() < FURTHEST:
        raise MeshError(f"it reaches further than {FURTHEST:g} m: `unit` and `scale` say how large it is")
    try:
        outer = vertices[corners(vertices)]
        if options.max_vertices is None and not options.pieces:
            _check_number(len(outer), most_vertices)
        _check_readable(len(outer))
        volume = hull(outer).solid.volume
        closed = enclosed(vertices, triangles)
        if closed.solid is not None and closed.solid.volume > volume * (1.0 + SAME):
            closed = Enclosed(None, "it encloses more than its hull: parts of it overlap")
        groups = [outer]
        if options.pieces:
            from simspec.meshes.pieces import pieces

            groups = [points[corners(points)] for points in pieces(vertices, triangles)]
        parts = tuple(_convex(points, options.max_vertices) for points in groups)
    except MeshError:
        raise
    except FlatError as error:
        raise FlatMeshError(f"it has no volume: {error}") from None
    except ValueError as error:
        raise MeshError(f"no solid can be made of it: {error}") from None
    return MadeMesh(parts, volume, closed.solid, closed.why, closed.surfaces)


def bounded(mesh: MadeMesh, options: MeshOptions, most_vertices: int) -> MadeMesh:
    """``mesh``, unless a hull of it, whose options allow any number of vertices, has more than ``most_vertices``: then
    ManyVerticesError is raised."""
    if options.max_vertices is None:
        _check_number(max(part.vertices for part in mesh.parts), most_vertices)
    return mesh


def _check_number(vertices: int, most: int) -> None:
    if vertices > most:
        raise ManyVerticesError(
            f"its hull has {vertices:,} vertices, more than {most:,}; `max_vertices: 64` leaves the best"
        )


def _check_readable(vertices: int) -> None:
    if vertices > LARGEST:
        raise MeshError(f"its hull has {vertices:,} vertices, more than the {LARGEST:,} that a file's may have")


def _convex(points: Points, most: int | None) -> Convex:
    """A hull in its own frame, in which all its vertices are corners still: round-off of the rotation may put one into a
    plane, and it is then left out, since whoever computes the faces from the vertices would miss it."""
    kept, error = (points, 0.0) if most is None else reduced(points, most)
    while True:
        pose, local = centred(kept)
        chosen = corners(local)
        if len(chosen) == len(kept):
            return Convex(mesh_size(local), pose, error, len(points))
        kept = kept[chosen]


def _placed(surface: Surface, options: MeshOptions) -> Points:
    """The vertices in m, in the shape's axes: unit, then the axis that is up (as COLLADA defines x, y and z up), then scale."""
    unit = options.unit if options.unit is not None else surface.unit if surface.unit is not None else 1.0
    if not (math.isfinite(unit) and unit > 0.0):
        raise MeshError(f"its unit is {unit:g} m")
    x, y, z = (surface.vertices[:, k] for k in range(3))
    axes = {"x": (-y, -z, x), "y": (x, -z, y), "z": (x, y, z)}[options.up or surface.up or "z"]
    return np.stack([axis * unit * factor for axis, factor in zip(axes, options.scale, strict=True)], axis=1)


def _mirrored(options: MeshOptions) -> bool:
    x, y, z = options.scale
    return x * y * z < 0.0
