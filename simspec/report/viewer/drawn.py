"""The drawing of a world: triangles of shapes, axes and limits of joints, near pairs of contact, loads. Lengths in m; nothing
here depends on the viewer."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.meshes.drawn import Wanted, wanted
from simspec.report.page.shapes import drawn_field, is_drawn
from simspec.world import frames
from simspec.world.actions import Force
from simspec.world.appearance import DrawnSurface, Rgba
from simspec.world.contact_pairs import CollisionFilter, solid_shapes
from simspec.world.frames import vector3
from simspec.world.hull import mesh_triangles, mesh_vertices
from simspec.world.kinematics import is_carrier, rigid_groups
from simspec.world.posture import poses_at
from simspec.world.shapes import SHAPES
from simspec.world.types import Body, Joint, Pose, Shape, Vector3, World

Floats = NDArray[np.float64]
Faces = NDArray[np.int64]

SMALLEST_SCENE = 0.05
"""m: a scene is drawn as if it reached at least so far."""
FARTHEST_PLANE = 5.0
"""A plane is part of the scene whose distance is at most so many times the size of what moves."""
MOST_NEAR = 400
"""Pairs of shapes near each other that are drawn."""
MOST_TESTED = 3_000
"""Collision shapes of a world whose pairs are looked at."""
NEAR = 0.05
"""Pairs of shapes are near whose bounding spheres are at most this part of the scene's radius away from each other."""
FULL_TURN = 2.0 * math.pi
ARC_STEPS = 48


def triangles(shape: Shape) -> tuple[Floats, Faces] | None:
    """The vertices (n, 3) and faces (m, 3) of a shape in its frame; None for a plane, which has no end."""
    from trimesh import creation

    kind, size = SHAPES[shape.kind], shape.size
    if kind.endless:
        return None
    if kind.points:
        return mesh_vertices(size), np.asarray(mesh_triangles(size), dtype=np.int64)
    if kind.grid:
        points, corners = drawn_field(size)
        return points, np.asarray(corners, dtype=np.int64)
    if shape.kind == "box":
        made = creation.box(extents=size)
    elif shape.kind == "cylinder":
        made = creation.cylinder(radius=size[0], height=size[1], sections=40)
    elif shape.kind == "capsule":
        made = creation.capsule(radius=size[0], height=size[1], count=[24, 24])
        made.apply_translation([0.0, 0.0, -made.bounds.mean(axis=0)[2]])
    else:
        made = creation.icosphere(subdivisions=3)
        made.apply_scale(size if shape.kind == "ellipsoid" else [size[0]] * 3)
    return np.asarray(made.vertices, dtype=np.float64), np.asarray(made.faces, dtype=np.int64)


def visual_shapes(body: Body) -> list[Shape]:
    """The shapes by which a body is seen: its visual ones, and planes; of a body without any, those that collide."""
    shown = [shape for shape in body.shapes if shape.visual or SHAPES[shape.kind].endless]
    return [shape for shape in shown or body.shapes if is_drawn(shape)]


@dataclass(frozen=True)
class SeenPart:
    """The visible part of a shape in one colour: triangles in a frame of its body, or the shape itself where it has none.
    ``flat``: each triangle has a normal of its own."""

    shape: Shape
    pose: Pose
    colour: Rgba
    mesh: tuple[Floats, Faces] | None
    flat: bool


def visual_parts(body: Body, surfaces: Mapping[Wanted, DrawnSurface]) -> Iterator[SeenPart]:
    """The parts that are seen of a body: a mesh as its file has it, simplified, where ``surfaces`` has it; else its hull."""
    for shape in visual_shapes(body):
        surface = None if shape.drawn is None else surfaces.get(wanted(shape.drawn))
        if shape.drawn is None or surface is None:
            round_kind = shape.kind in ("sphere", "capsule", "ellipsoid")
            yield SeenPart(shape, shape.pose, shape.colour, triangles(shape), not round_kind)
        elif shape.drawn.first:
            pose = Pose(shape.drawn.position, shape.drawn.quaternion)
            for colour, mesh in surface_parts(surface):
                yield SeenPart(
                    shape, pose, shape.colour if shape.drawn.coloured or colour is None else colour, mesh, True
                )


def surface_parts(surface: DrawnSurface) -> Iterator[tuple[Rgba | None, tuple[Floats, Faces]]]:
    """The triangles of each colour of a surface, with the vertices that they use."""
    vertices = np.frombuffer(surface.vertices, "<f4").reshape(-1, 3).astype(np.float64)
    corners = np.frombuffer(surface.triangles, "<u2").reshape(-1, 3).astype(np.int64)
    first = 0
    for colour, count in surface.colours:
        used, faces = np.unique(corners[first : first + count], return_inverse=True)
        yield colour, (vertices[used], faces.reshape(-1, 3))
        first += count


@dataclass(frozen=True)
class Extent:
    """The ball that a scene is in: centre and radius."""

    centre: Vector3
    radius: float


def extent(world: World) -> Extent:
    """The ball around what moves, with its shapes and the places of near planes below it; around everything where nothing
    moves."""
    groups, placed = rigid_groups(world), poses_at(world, {})
    moving = [body for body in world.bodies if groups[body.name] != "world"]
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for body in moving or world.bodies:
        shapes = [shape for shape in body.shapes if is_drawn(shape) and not SHAPES[shape.kind].endless]
        places = [(frames.compose(placed[body.name], shape.pose), shape) for shape in shapes]
        balls = [(at.position, SHAPES[shape.kind].outer_radius(shape.size)) for at, shape in places]
        for centre, radius in balls or [(placed[body.name].position, 0.0)]:
            low, high = np.minimum(low, np.subtract(centre, radius)), np.maximum(high, np.add(centre, radius))
    for at in _planes(world, placed):
        normal = np.array(frames.rotate(at.quaternion, (0.0, 0.0, 1.0)))
        foot = 0.5 * (low + high) - normal * float((0.5 * (low + high) - at.position) @ normal)
        if np.linalg.norm(foot - 0.5 * (low + high)) < FARTHEST_PLANE * np.linalg.norm(high - low):
            low, high = np.minimum(low, foot), np.maximum(high, foot)
    if not np.isfinite([low, high]).all():
        return Extent((0.0, 0.0, 0.0), 1.0)
    return Extent(vector3(0.5 * (low + high)), max(SMALLEST_SCENE, 0.5 * float(np.linalg.norm(high - low))))


def _planes(world: World, placed: Mapping[str, Pose]) -> Iterator[Pose]:
    for body in world.bodies:
        for shape in body.shapes:
            if SHAPES[shape.kind].endless:
                yield frames.compose(placed[body.name], shape.pose)


def across(axis: Vector3) -> tuple[Vector3, Vector3]:
    """Two unit vectors that are square to ``axis`` and to each other; with it, a right-handed frame."""
    least = int(np.argmin(np.abs(axis)))
    first = frames.direction(frames.cross(axis, vector3(np.eye(3)[least])))
    return first, frames.cross(axis, first)


def axis_length(world: World, radius: float) -> float:
    """The length of joint axes and body frames in a scene of ``radius``: shorter where there are many."""
    return 0.2 * radius / max(1.0, math.sqrt(len(world.bodies) / 8.0))


def limits_line(joint: Joint, length: float) -> Floats:
    """Segments (n, 2, 3) in the joint's frame that show its range: of a hinge an arc with its two ends, or a circle where it is
    unlimited; of a slide the way of its body's origin, with a bar at each end; of a ball joint none."""
    first, second = across(joint.axis) if joint.kind in SCALAR_JOINTS else ((0.0,) * 3, (0.0,) * 3)
    if joint.kind == "hinge":
        low, high = joint.position_limits or (-math.pi, math.pi)
        high = min(high, low + FULL_TURN)
        turns = np.linspace(low, high, ARC_STEPS + 1)[:, None]
        arc = 0.6 * length * (np.cos(turns) * first + np.sin(turns) * second)
        ends = [(np.zeros(3), arc[0]), (np.zeros(3), arc[-1])] if joint.position_limits else []
        return np.array([*itertools.pairwise(arc), *ends])
    if joint.kind == "slide" and joint.position_limits is not None:
        start, end = (np.multiply(joint.axis, limit) for limit in joint.position_limits)
        bar = np.multiply(first, 0.3 * length)
        return np.array([(start, end), (start - bar, start + bar), (end - bar, end + bar)])
    return np.zeros((0, 2, 3))


def pointer_line(joint: Joint, length: float) -> Floats:
    """Segments (1, 2, 3) in the *body's* frame that point to the joint's position on its range; none where it has no axis."""
    if joint.kind == "hinge":
        return np.array([[(0.0, 0.0, 0.0), np.multiply(across(joint.axis)[0], 0.75 * length)]])
    if joint.kind == "slide":
        bar = np.multiply(across(joint.axis)[0], 0.2 * length)
        return np.array([[-bar, bar]])
    return np.zeros((0, 2, 3))


# --- contact ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Solids:
    """The collision shapes of a world whose pairs are looked at: owners, places in the body's frame, radii of bounding spheres
    (∞: a plane)."""

    bodies: tuple[str, ...]
    shapes: tuple[Shape, ...]
    radii: Floats


def solids(world: World) -> Solids:
    """The first ``MOST_TESTED`` collision shapes."""
    found = [(body.name, shape) for body in world.bodies for shape in solid_shapes(body) if is_drawn(shape)]
    found = found[:MOST_TESTED]
    radii = [SHAPES[shape.kind].outer_radius(shape.size) + shape.margin for _, shape in found]
    return Solids(tuple(name for name, _ in found), tuple(shape for _, shape in found), np.array(radii))


def near_pairs(world: World, shapes: Solids, placed: Mapping[str, Pose], reach: float) -> Floats:
    """Segments (n, 2, 3) between the centres of collision shapes that may touch, with a gap of at most ``reach`` between their
    bounding spheres; from a plane, between its nearest point and the centre of the other shape. The nearest come first."""
    at = [frames.compose(placed[body], shape.pose) for body, shape in zip(shapes.bodies, shapes.shapes, strict=True)]
    centres = np.array([pose.position for pose in at]).reshape(-1, 3)
    found: list[tuple[float, Vector3, Vector3]] = []
    allowed = CollisionFilter(world)
    for gap, first, second in _close(centres, shapes, at, reach):
        a, b = shapes.bodies[first], shapes.bodies[second]
        materials = shapes.shapes[first].material, shapes.shapes[second].material
        if not (allowed.may_touch(a, b) and allowed.may_materials_touch(*materials)):
            continue
        start = centres[first]
        if math.isinf(shapes.radii[first]):
            normal = np.array(frames.rotate(at[first].quaternion, (0.0, 0.0, 1.0)))
            start = centres[second] - normal * float(np.dot(centres[second] - centres[first], normal))
        found.append((gap, vector3(start), vector3(centres[second])))
        if len(found) == MOST_NEAR:
            break
    return np.array([(start, end) for _, start, end in found]).reshape(-1, 2, 3)


def _close(centres: Floats, shapes: Solids, at: list[Pose], reach: float) -> Iterator[tuple[float, int, int]]:
    """Gap and indices of shapes whose bounding spheres are close, the closest first; a plane is the first of its pair."""
    finite = np.flatnonzero(np.isfinite(shapes.radii))
    gaps: list[Floats] = []
    pairs: list[Faces] = []
    for row, index in enumerate(finite):
        others = finite[row + 1 :]
        away = np.linalg.norm(centres[others] - centres[index], axis=1) - shapes.radii[others] - shapes.radii[index]
        near = away <= reach
        gaps.append(away[near])
        pairs.append(np.column_stack([np.full(int(near.sum()), index), others[near]]))
    for index in np.flatnonzero(np.isinf(shapes.radii)):
        normal = np.array(frames.rotate(at[index].quaternion, (0.0, 0.0, 1.0)))
        away = (centres[finite] - centres[index]) @ normal - shapes.radii[finite]
        near = away <= reach
        gaps.append(away[near])
        pairs.append(np.column_stack([np.full(int(near.sum()), index), finite[near]]))
    if not gaps:
        return
    gap, pair = np.concatenate(gaps), np.concatenate(pairs)
    for place in np.argsort(gap, kind="stable"):
        yield float(gap[place]), int(pair[place, 0]), int(pair[place, 1])


def law_lines(world: World) -> list[tuple[str, str]]:
    """The materials that may meet, and their law in words."""
    from simspec.world.contact_pairs import meeting_laws

    lines = []
    for (first, second), law in sorted(meeting_laws(world).items()):
        if law.collide:
            words = f"friction {law.friction:g}, restitution {law.restitution:g}"
            lines.append((first if first == second else f"{first} – {second}", words))
    return lines


# --- loads --------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Load:
    """An arrow: on a body at a point of its frame (None: at a place of the scene), along a vector of the world."""

    body: str | None
    at: Vector3
    along: Vector3
    words: str
    turning: bool = False


def loads(world: World, scene: Extent) -> list[Load]:
    """Gravity, next to the scene, and the forces and torques on bodies; the largest of each kind is half the scene's radius
    long."""
    found: list[Load] = []
    strength = float(np.linalg.norm(world.physics.gravity))
    if strength:
        place = vector3(np.add(scene.centre, (-scene.radius, 0.0, 0.7 * scene.radius)))
        along = vector3(np.multiply(world.physics.gravity, 0.35 * scene.radius / strength))
        found.append(Load(None, place, along, f"gravity {strength:.4g} m/s²"))
    for turning, unit in ((False, "N"), (True, "N m")):
        sizes = {index: float(np.linalg.norm(_vector(force, turning))) for index, force in enumerate(world.forces)}
        largest = max(sizes.values(), default=0.0)
        for index, force in enumerate(world.forces):
            if sizes[index]:
                along = vector3(np.multiply(_vector(force, turning), 0.5 * scene.radius / largest))
                until = "the end" if force.until is None else f"{force.until:g} s"
                words = f"{sizes[index]:.4g} {unit}, {force.start:g} s to {until}"
                found.append(Load(force.body, force.at, along, words, turning))
    return found


def _vector(force: Force, turning: bool) -> Vector3:
    return force.torque if turning else force.force


def named_bodies(world: World) -> list[Body]:
    """The bodies that the spec names: without those between two joints of one body."""
    return [body for body in world.bodies if not is_carrier(body.name)]
