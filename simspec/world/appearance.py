"""How meshes look: the surface that a page draws in place of a hull. No engine receives it, and no hash depends on it."""

from __future__ import annotations

from dataclasses import dataclass

Triple = tuple[float, float, float]
Rgba = tuple[float, float, float, float]

UNSTORED = {"unstored": True}
"""Metadata of a field that canonical JSON never has."""


@dataclass(frozen=True, slots=True)
class DrawnSurface:
    """Triangles of a file, simplified, in m and in the axes of the mesh's frame.

    ``vertices``: x y z in single precision; ``triangles``: three vertices each, in 16 bits; both least byte first. ``colours``:
    for so many triangles in turn the colour in the file, None where it has none. ``faces``: triangles of the file.
    """

    vertices: bytes
    triangles: bytes
    colours: tuple[tuple[Rgba | None, int], ...]
    faces: int

    @property
    def count(self) -> int:
        """Its triangles."""
        return len(self.triangles) // 6


@dataclass(frozen=True, slots=True)
class DrawnMesh:
    """The file whose surface is drawn for a shape, in place of its hull.

    file         path on this machine
    unit, up     as the spec takes the file; None: as the file says
    scale        factors, after ``up``
    position     of the mesh's frame in the body's (m), and its ``quaternion``
    coloured     whether the spec gives the colour, which then replaces those of the file
    first        False of the further pieces of a mesh: the first draws all of it
    surface      the triangles, of a run that was stored; None: they are read from the file
    """

    file: str
    unit: float | None
    up: str | None
    scale: Triple
    position: Triple
    quaternion: tuple[float, float, float, float]
    coloured: bool
    first: bool = True
    surface: DrawnSurface | None = None
