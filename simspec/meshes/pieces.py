"""Approximate convex decomposition: CoACD, in the process that reads files too."""

from __future__ import annotations

from importlib.util import find_spec

from simspec.meshes.files import MeshError
from simspec.meshes.reading import split
from simspec.world.hull import Points, Triangles

SECONDS = 120.0
"""Processor time: a profile of 20 triangles takes 2 s on a quiet machine, a robot's link of 26,000 more than three minutes."""
INSTALL = "pip install 'simspec[convex]'"


def pieces(vertices: Points, triangles: Triangles) -> list[Points]:
    """The corners (n, 3) of convex pieces that together are nearly the solid within triangles. Raises MeshError."""
    if find_spec("coacd") is None:
        raise MeshError(f"`as: pieces` needs CoACD, which is not installed: {INSTALL}")
    return split(vertices, triangles, SECONDS)
