"""Convex hulls in Rapier: which it holds, and how they are told.

Rapier keeps every corner that it is told, but touches by faces. It takes neighbouring faces for one where their normals are
within ``ALIKE`` of each other, in the plane of one of them, and uses four corners of a face. On a plane it looks at the face
alone that looks at the plane most, and does not feel a corner of another that is deeper. So a hull is exact where its faces
have up to four corners and meet at more than 1.5°, and on planes where the deepest corner is always one of the face that looks
down, as of boxes. Balls touch a hull exactly. Measured: rapier3d 0.36.1. What is asked of a world runs outside the engine's
process, without Rapier.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simspec.engines.rapier.units import NAME
from simspec.errors import EngineError
from simspec.support.declarations import Level, Refinement, not_here
from simspec.world.hull import Hull, HullError, hull_of, vertices_of
from simspec.world.meeting import meeting_laws, shape_pairs, solid_shapes
from simspec.world.types import World

ALIKE = 3.6e-4
"""1 − the cosine of the angle, 1.5°, up to which Rapier takes two faces for one: a little above √2⁻²³."""
MOST_CORNERS = 4
"""Of a face."""
FLAT = 1e-6
"""Share of its extent by which a hull is off at most that is exact: a few roundings."""
DIRECTIONS = 4000
"""Spread over the sphere, 3° apart, in which planes are tried beside those that three faces look at alike."""
KEPT = 256
"""Hulls of which the faces are remembered."""
MERGED_SHORT = "faces of a hull that meet at less than 1.5° are felt as one plane"
STACKS = (
    "hulls stand on each other less still than boxes: a stack of five cubes falls over in 0.5 s, and of 60 stacks of three one "
    "shifts by 5.8 mm (boxes by 0.2 mm at most; one hull rests on another to 2e-7 m)"
)
STACKED = Refinement(
    Level.APPROXIMATE, f"the convex hull; {STACKS}", "stacks of three hulls shift by mm, and of five fall over"
)


@dataclass(frozen=True, slots=True)
class Faces:
    """What Rapier makes of the faces of a hull: the most ``corners`` of one; how far (m) it is ``off`` where faces are nearly
    in one plane; how deep (m) a corner may be in a plane and ``unfelt``."""

    corners: int
    off: float
    unfelt: float


def hulls_held(world: World) -> Refinement | None:
    """Not hulls of which Rapier would not feel corners; approximately those that may touch hulls, and those with faces that are
    nearly in one plane, where they may touch what is no ball."""
    shapes = {shape.name: shape for body in world.bodies for shape in solid_shapes(body)}
    faces = {name: faces_of(shape.size) for name, shape in shapes.items() if shape.kind == "mesh"}
    off, stacked = (0.0, "", ""), False
    for pair in shape_pairs(world, meeting_laws(world)) if faces else ():
        stacked = stacked or all(name in faces for name in pair)
        for name, other in (pair, pair[::-1]):
            if name not in faces or shapes[other].kind == "sphere":
                continue
            if why := _refused(faces[name], shapes[other].kind):
                return not_here(f"{why} ({name!r}, which may touch {other!r})")
            off = max(off, (faces[name].off, name, other))
    size, name, other = off
    found = [STACKS] if stacked else []
    if size:
        found.append(
            f"of faces that meet at less than 1.5° Rapier makes one, so that {other!r} may feel {name!r} up to "
            f"{1e3 * size:.2g} mm off, and no hull is further off"
        )
    short = STACKED.short if stacked else MERGED_SHORT
    return Refinement(Level.APPROXIMATE, f"the convex hull; {'; '.join(found)}", short) if found else None


def _refused(own: Faces, kind: str) -> str | None:
    """Why Rapier does not have a hull beside a kind of shape."""
    if own.corners > MOST_CORNERS:
        return (
            f"Rapier uses {MOST_CORNERS} corners of a face, and one has {own.corners} here, where faces that meet at less than "
            "1.5° are one: a prism of 8 sides falls over"
        )
    if kind == "plane" and own.unfelt:
        return (
            "of a hull on a plane Rapier feels the corners of the face alone that looks at the plane most, and here others may "
            f"be {1e3 * own.unfelt:.2g} mm deep; a box in place of the plane feels all"
        )
    return None


@functools.lru_cache(maxsize=KEPT)
def faces_of(size: tuple[float, ...]) -> Faces:
    """What Rapier makes of the faces of a hull (flat vertices, m)."""
    held = hull_of(size)
    groups, most = _merged(held)
    least = FLAT * float(np.ptp(held.vertices, axis=0).max())
    off = max(_bent(held, group) for group in groups)
    unfelt = 0.0 if most > MOST_CORNERS else _unfelt(held, groups)
    return Faces(most, off if off > least else 0.0, unfelt if unfelt > least else 0.0)


def _merged(held: Hull) -> tuple[list[list[int]], int]:
    """The triangles of each of Rapier's faces, and the most corners that one has."""
    first: dict[tuple[int, int], int] = {}
    edges: list[tuple[int, int]] = []
    up = list(range(len(held.triangles)))

    def root(face: int) -> int:
        while up[face] != face:
            up[face] = up[up[face]]
            face = up[face]
        return face

    for face, (a, b, c) in enumerate(held.triangles.tolist()):
        for edge in ((a, b), (b, c), (c, a)):
            other = first.setdefault((min(edge), max(edge)), face)
            if other == face:
                continue
            edges.append((face, other))
            if held.normals[face] @ held.normals[other] > 1.0 - ALIKE:
                up[root(face)] = root(other)
    members: dict[int, list[int]] = {}
    for face in range(len(up)):
        members.setdefault(root(face), []).append(face)
    sides = dict.fromkeys(members, 0)
    for one, other in ((root(face), root(other)) for face, other in edges):
        if one != other:
            sides[one] += 1
            sides[other] += 1
    return list(members.values()), max(sides.values())


def _bent(held: Hull, group: Sequence[int]) -> float:
    """How far (m) corners of some triangles are from the planes of the others, at most."""
    if len(group) == 1:
        return 0.0
    own = held.vertices[np.unique(held.triangles[group])]
    return float(np.abs(own @ held.normals[group].T - held.offsets[group]).max())


def _unfelt(held: Hull, groups: Sequence[Sequence[int]]) -> float:
    """How much further (m) a hull reaches than the face that looks in a direction most, at most."""
    faces = np.zeros(len(held.triangles), dtype=np.intp)
    for number, group in enumerate(groups):
        faces[group] = number
    own = np.zeros((len(groups), len(held.vertices)), dtype=bool)
    for face, corners in zip(faces.tolist(), held.triangles, strict=True):
        own[face, corners] = True
    directions = _directions(held)
    reach = directions @ held.vertices.T
    looking = faces[np.argmax(directions @ held.normals.T, axis=1)]
    felt = np.where(own[looking], reach, -math.inf).max(axis=1)
    return float((reach.max(axis=1) - felt).max())


def _directions(held: Hull) -> np.ndarray:
    """Unit vectors (n, 3): a Fibonacci spiral, and those that three faces look at alike, a little towards each."""
    index = np.arange(DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * index / DIRECTIONS
    turn, across = math.pi * (1.0 + math.sqrt(5.0)) * index, np.sqrt(1.0 - z * z)
    found = [np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)]
    try:
        cells = hull_of(tuple(held.normals.ravel().tolist()))
    except HullError:
        return found[0]
    found += [cells.normals + 1e-6 * cells.vertices[cells.triangles[:, corner]] for corner in range(3)]
    every = np.concatenate(found)
    unit: np.ndarray = every / np.linalg.norm(every, axis=1, keepdims=True)
    return unit


def convex(rapier: Any, name: str, size: Sequence[float]) -> Any:
    """A builder of the collider of a hull (flat vertices, 1/1024 m), of its vertices and the faces that follow from them:
    Rapier's own hull leaves out vertices where it is thin or has thousands."""
    try:
        faces = hull_of(size).triangles
    except (HullError, ValueError) as error:
        raise EngineError(NAME, f"has no hull {name!r}: {error}") from error
    except ImportError as error:
        raise EngineError(NAME, f"meshes need scipy beside Rapier: {error}") from error
    return rapier.Collider.convex_mesh(vertices_of(size).astype(np.float32), faces.astype(np.uint32))
