"""Contact that PhysX computes approximately, and the hulls that it does not support. Measured with SAPIEN 3.0.3, PhysX 5.3.1.

``tools/deviations.py`` measures the tables of contact of several bodies at 1 to 16 ms, frictions of 0.05 to 1.2, restitutions
of 0 to 1, and ratios of masses of 1 to 1000.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from simspec.engines.kit.deviations import JAMMED, SWEEPS, Deviation, Reason, coarse, read_deviations
from simspec.engines.kit.refinements import coupled, met_pairs
from simspec.support import classes
from simspec.support.declarations import Level, Refinement, Table, unsupported_if
from simspec.support.features import Feature
from simspec.world.contact_pairs import solid_shapes
from simspec.world.hull import FlatError, closed_triangles, hull, hull_of, mesh_vertices
from simspec.world.types import World

_ANCHORS = (
    "PhysX's friction ties two anchors of a pair to their initial places by springs: leaning and "
    "piled bodies do not slip near their threshold, and spinning bodies are braked at an angle to "
    "their slip (accepted by name: contact.cone.elliptic)"
)
_FEW = coarse("rest on crossing edges")

DEVIATIONS: tuple[Deviation, ...] = read_deviations(
    Path(__file__).with_name("contact_deviations.csv"),
    (Reason("stack*", SWEEPS), Reason("jam*", JAMMED), Reason("cross*", _FEW), Reason("*", _ANCHORS)),
)
COUPLED: Table = coupled(
    "physx",
    DEVIATIONS,
    {
        Feature.MASS_RATIO: classes.HEAVY_ON_LIGHT,
        Feature.SELF_LOCKING: classes.JAMMED,
    },
)

# Hulls. PhysX computes the hull of the vertices again, and drops vertices silently: those that reach less than ``OUT`` of the
# sum of the hull's extents beyond the hull of the others, and some where there are more than ``MOST_FACES`` faces. Of 1,500
# random hulls of 5 to 140 vertices, none that these rules accept lost a vertex, and 1 % of those that they reject would have
# kept all.

OUT = 3.6e-4
"""A little above the measured 3.5e-4."""
LEAST_OUT = 7e-7
"""m: the least that a corner must reach beyond the others, 7e-4 of PhysX's unit of length."""
MOST_FACES, MOST_CORNERS = 255, 255
"""Of one of PhysX's hulls. A surface of triangles alone has 255 faces with 129 corners."""
DIGITS = 6
"""After the point of a normal, and of a share of the extent: by which triangles are in one face."""
KEPT = 256
"""Hulls of which the answer is remembered."""


def hull_refusal(world: World) -> Refinement | None:
    """Not a world with a hull of which PhysX would leave corners out."""
    for body in world.bodies:
        for shape in solid_shapes(body):
            if shape.kind == "mesh" and (why := left_out(shape.size)):
                return unsupported_if(f"{why} ({shape.name!r}). Reduce the hull by `max_vertices` of the mesh")
    return None


@functools.lru_cache(maxsize=KEPT)
def left_out(size: tuple[float, ...]) -> str | None:
    """Why PhysX would not hold a hull (flat vertices, m) as it is; None where it does."""
    vertices = mesh_vertices(size)
    if len(vertices) > MOST_CORNERS:
        return f"PhysX supports hulls of up to {MOST_CORNERS} corners, and this has {len(vertices)}"
    if closed_triangles(len(vertices)) > MOST_FACES and (faces := _faces(size)) > MOST_FACES:
        return f"PhysX supports hulls of up to {MOST_FACES} faces, and this has {faces}"
    needed = max(LEAST_OUT, OUT * float(np.ptp(vertices, axis=0).sum()))
    near = [reach for number in range(len(vertices)) if (reach := _reach(vertices, number)) <= needed]
    if not near:
        return None
    return (
        f"PhysX drops corners that protrude by less than {needed:.2g} m from the hull of the others, and {len(near)} of "
        f"{len(vertices)} corners do (by {min(near):.2g} m at least)"
    )


def _faces(size: tuple[float, ...]) -> int:
    """The number of different planes of a hull's triangles."""
    hull = hull_of(size)
    planes = np.column_stack([hull.normals, hull.offsets / np.ptp(hull.vertices, axis=0).max()])
    return len(np.unique(np.round(planes, DIGITS), axis=0))


def _reach(vertices: np.ndarray, number: int) -> float:
    """How far (m) a corner is outside of the hull of the others; endlessly, where these make no solid."""
    try:
        others = hull(np.delete(vertices, number, axis=0))
    except FlatError:
        return float("inf")
    return float((others.normals @ vertices[number] - others.offsets).max())


# Edges. A corner in a face is exact, an edge across an edge is not. In 720 random overlaps of each pair of kinds, 10 µm to 2 mm
# deep, compared with coal:
#
# boxes, boxes        edges cross in half: normals 0.27 rad (median) to 1.5 rad off, depths up to 2.1 mm; none missed
# hulls, boxes/hulls  normals up to 0.7 rad off in half, depths up to 0.22 mm; 7 missed, up to 0.28 mm
# hulls, balls/capsules  normals right to 4e-4 rad, depths off by 1 µm to 0.1 mm in 2 of 100; one missed
# others              right to 7e-7 m and 3e-6 rad; none missed
#
# With ``enable_pcm`` normals of edges are as wrong (0.9 rad), and contacts of earlier steps are kept.

_EDGES = (
    "PhysX's normals and depths are inaccurate where edges of a hull cross others, and it misses some of these overlaps"
)
_BOXES = (
    "PhysX's normals and depths are inaccurate where edges of two boxes cross. Corners in a face, and boxes that rest or slide "
    "on faces, are exact"
)
_ROUND = "PhysX's depths are inaccurate for some contacts of spheres and capsules with hulls"
APPROXIMATE: Mapping[tuple[str, str], str] = {
    ("box", "box"): _BOXES,
    ("box", "mesh"): _EDGES,
    ("mesh", "mesh"): _EDGES,
    ("mesh", "sphere"): _ROUND,
    ("capsule", "mesh"): _ROUND,
}
"""Of pairs of kinds, what is lost."""
SHORT = "contact normals are inaccurate where edges of boxes cross"
SHORT_HULLS = "contact normals are inaccurate where edges of hulls cross"
SHORT_ROUND = "depths of some contacts of spheres and capsules with hulls are inaccurate"


def _refinement(met: Mapping[tuple[str, str], str]) -> Refinement:
    how = "; ".join(dict.fromkeys(met.values()))
    if ("box", "box") in met:
        return Refinement(Level.APPROXIMATE, how, SHORT)
    short = SHORT_HULLS if _EDGES in met.values() else SHORT_ROUND
    return Refinement(Level.APPROXIMATE, f"{how}; see docs/engines/physx.md", short)


def _of(kind: str) -> Mapping[tuple[str, str], str]:
    """The pairs in messages on boxes, and on hulls."""
    return {pair: how for pair, how in APPROXIMATE.items() if ("mesh" in pair) == (kind == "mesh")}


def boxes(world: World) -> Refinement | None:
    """Boxes that may meet boxes; the message on hulls covers those that may meet hulls."""
    met = met_pairs(world, _of("box"))
    return _refinement(met) if met else None


def meshes(world: World) -> Refinement | None:
    """Not hulls that PhysX would not hold; approximate are those that may meet more than planes."""
    if refused := hull_refusal(world):
        return refused
    met = met_pairs(world, _of("mesh"))
    return _refinement(met) if met else None


BOXES, MESHES = (_refinement(_of(kind)) for kind in ("box", "mesh"))
"""Where all of these pairs may meet, for tables."""
