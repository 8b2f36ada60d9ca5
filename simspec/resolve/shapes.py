"""Poses and orientations, and the shapes of bodies with the files of meshes and height fields that they use."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from simspec.errors import Location, Problem, SpecError
from simspec.language import trees
from simspec.language.actions import MotionPoint, ToolPlace
from simspec.language.arrays import Array, Jitter
from simspec.language.document import Key
from simspec.language.models import Body as SpecBody
from simspec.language.problems import in_order
from simspec.language.shapes import HULL, MOST_HEIGHTS, MOST_VERTICES, PIECES, Heightfield, Inertia, Mesh, Orientation
from simspec.language.shapes import Pose as SpecPose
from simspec.language.shapes import Shape as SpecShape
from simspec.language.sources import Source
from simspec.language.strict import required
from simspec.language.vocabulary import SHAPE_KINDS
from simspec.meshes.reading import MeshError
from simspec.world import frames, inertia
from simspec.world.appearance import DrawnMesh
from simspec.world.shapes import HEIGHTFIELD_HEAD, SHAPES, heightfield_size
from simspec.world.types import Body, Pose, Quaternion, Shape, Vector3, Velocity6

if TYPE_CHECKING:
    from simspec.meshes.load import MadeMesh, MeshOptions


# Poses of the spec as poses of the world, and the layout of arrays.

Z_AXIS: Vector3 = (0.0, 0.0, 1.0)


def orientation(written: SpecPose | Orientation | Inertia | ToolPlace | MotionPoint) -> Quaternion:
    """The rotation that `rpy` or `quat` says."""
    if written.quat is not None:
        return frames.normalise(written.quat)
    if written.rpy is not None:
        return frames.from_rpy(*written.rpy)
    return frames.IDENTITY


def pose(written: SpecPose | None) -> Pose:
    """A pose of the spec; None is the identity."""
    return Pose() if written is None else Pose(written.xyz, orientation(written))


def elements(array: Array | None) -> list[tuple[str, Pose]]:
    """The suffix of the name, and the pose in the array's frame, of every element; one without suffix for no array."""
    if array is None:
        return [("", Pose())]
    poses = layout(array)
    digits = len(str(len(poses) - 1))
    return [(f"_{index:0{digits}d}", place) for index, place in enumerate(poses)]


def layout(array: Array) -> list[Pose]:
    """The poses of an array's elements in the array's frame, jitter included."""
    elements = list(_layout(array))
    return elements if array.jitter is None else list(_jittered(elements, array.jitter))


def _layout(array: Array) -> Iterator[Pose]:
    if array.grid is not None:
        dx, dy, dz = required(array.spacing)
        nx, ny, nz = array.grid
        for i in range(nx):
            for j in range(ny):
                for k in range(nz):
                    yield Pose((i * dx, j * dy, k * dz))
    elif array.line is not None:
        x, y, z = required(array.step)
        for i in range(array.line):
            yield Pose((i * x, i * y, i * z))
    elif array.ring is not None:
        radius = required(array.radius)
        for i in range(array.ring):
            angle = 2.0 * math.pi * i / array.ring
            sine, cosine = frames.sine_cosine(angle)
            turn = frames.from_axis_angle(Z_AXIS, angle) if array.face else frames.IDENTITY
            yield Pose((radius * cosine, radius * sine, 0.0), turn)
    else:
        for element in required(array.poses):
            yield pose(element)


def _jittered(elements: list[Pose], jitter: Jitter) -> Iterator[Pose]:
    # random() is the one method whose numbers Python promises to keep for a seed
    draw = random.Random(jitter.seed).random
    for element in elements:
        x, y, z = element.position
        if jitter.radial is not None:
            scale = 1.0 - jitter.radial + 2.0 * jitter.radial * draw()
            yield Pose((x * scale, y * scale, z * scale), element.quaternion)
        else:
            reach = required(jitter.uniform)
            x, y, z = (value + (-reach + 2.0 * reach * draw()) for value in (x, y, z))
            yield Pose((x, y, z), element.quaternion)


# The meshes of a spec: all that its shapes name, read and made before any tree is resolved.

MOST_IN_WORLD = 500_000
"""Vertices of all shapes of one scenario, copies included: each takes 60 bytes in a world's file, and more in an engine's."""


@dataclass(frozen=True)
class MeshShape:
    """A shape that is a mesh: where it stands, its body, and what it says."""

    source: Source
    path: tuple[Key, ...]
    body: SpecBody
    shape: SpecShape
    mesh: Mesh

    @property
    def file(self) -> Path:
        """The file that it names."""
        return self.source.meshes[self.mesh.file]

    @property
    def options(self) -> MeshOptions:
        """How it takes the file."""
        return options_of(self.mesh)

    @property
    def place(self) -> Location | None:
        """Where the file is named."""
        return self.source.document.locate((*self.path, "mesh", "file"))

    def problem(self, message: str, hint: str | None = None, *, code: str) -> Problem:
        """A problem or a warning of this mesh."""
        return self.source.document.problem(
            (*self.path, "mesh", "file"), message, found=self.mesh.file, hint=hint, code=code
        )


def options_of(mesh: Mesh) -> MeshOptions:
    """How a mesh of the spec takes its file."""
    from simspec.meshes.load import MeshOptions

    return MeshOptions(mesh.metres(), mesh.up, mesh.scale, mesh.taken_as == PIECES, mesh.max_vertices)


Meshes: TypeAlias = "Mapping[tuple[Path, MeshOptions], MadeMesh]"
"""The solids of each file, by the options of the mesh."""


def mesh_shapes(source: Source) -> Iterator[MeshShape]:
    """Every shape of a spec that is a mesh, once for each place in a file."""
    seen: set[tuple[int, tuple[Key, ...]]] = set()
    for bodies in trees.every(source):
        for name, body in bodies.typed.items():
            for index, shape in enumerate(body.shapes if body is not None else ()):
                path = (*bodies.path, name, "shapes", index)
                key = (id(bodies.source), path)
                if body is not None and shape.mesh is not None and key not in seen:
                    seen.add(key)
                    yield MeshShape(bodies.source, path, body, shape, shape.mesh)


def read_meshes(source: Source) -> Meshes:
    """All meshes of a spec. Raises SpecError with every file of which no solid can be made, and every body whose mass cannot be
    computed from one."""
    shapes = list(mesh_shapes(source))
    if not shapes:
        return {}
    from simspec.meshes.load import load

    loaded = load([(shape.file, shape.options) for shape in shapes], MOST_VERTICES)
    problems: list[Problem] = []
    for shape in shapes:
        result = loaded[shape.file, shape.options]
        if isinstance(result, MeshError):
            problems.append(shape.problem(str(result), code="S406"))
        elif result.enclosed is None and shape.mesh.mass_from != HULL and fills(shape.body, shape.shape):
            message = f"the mass of this mesh cannot be computed: {result.open_because}"
            hint = "mass_from: hull; or the body's mass with inertia; or a file that is closed"
            problems.append(shape.problem(message, hint, code="S406"))
    if problems:
        raise SpecError(in_order(problems))
    return {wanted: result for wanted, result in loaded.items() if not isinstance(result, MeshError)}


def fills(body: SpecBody, shape: SpecShape) -> bool:
    """Whether a body's mass or inertia is computed from this shape of it."""
    if any(other.density for other in body.shapes):
        return bool(shape.density)
    if body.inertia is not None or not body.mass:
        return False
    colliding = any(other.collision and other.has_volume for other in body.shapes)
    return shape.collision or not colliding


def too_many(source: Source, bodies: tuple[Body, ...]) -> list[Problem]:
    """The problem of a world whose meshes have too many vertices; none where they do not."""
    total = sum(len(shape.size) // 3 for body in bodies for shape in body.shapes if shape.kind == "mesh")
    if total <= MOST_IN_WORLD:
        return []
    first = next(mesh_shapes(source))
    message = (
        f"the meshes of this scenario have {total:,} vertices, copies included; up to {MOST_IN_WORLD:,} are supported"
    )
    return [first.problem(message, "max_vertices: 64", code="S406")]


# The height fields of a spec: their files, read before any tree is resolved, and their heights as the world has them.

FloatArray = NDArray[np.float64]
Grids = Mapping[Path, FloatArray]
"""The numbers (rows, columns) of each file, as they stand in it."""


def field_shapes(source: Source) -> Iterator[tuple[Source, tuple[Key, ...], Heightfield]]:
    """Every shape of a spec that is a height field, with its file and its place there, once for each place."""
    seen: set[tuple[int, tuple[Key, ...]]] = set()
    for bodies in trees.every(source):
        for name, body in bodies.typed.items():
            for index, shape in enumerate(body.shapes if body is not None else ()):
                path = (*bodies.path, name, "shapes", index, "heightfield")
                key = (id(bodies.source), path)
                if shape.heightfield is not None and key not in seen:
                    seen.add(key)
                    yield bodies.source, path, shape.heightfield


def read_grids(source: Source) -> Grids:
    """The files of all height fields of a spec. Raises SpecError with every one that cannot be read."""
    grids: dict[Path, FloatArray] = {}
    problems: list[Problem] = []
    for local, path, shape in field_shapes(source):
        if shape.file is None or local.meshes[shape.file] in grids:
            continue
        from simspec.meshes.load import read_grid

        try:
            grids[local.meshes[shape.file]] = read_grid(local.meshes[shape.file])
        except MeshError as error:
            problems.append(local.document.problem((*path, "file"), str(error), found=shape.file, code="S407"))
    if problems:
        raise SpecError(in_order(problems))
    return grids


def placed_field(field: Heightfield, source: Source, grids: Grids) -> tuple[tuple[float, ...], Pose]:
    """The size of a height field in the world, and its frame there in the shape's frame of the spec: the world has the lowest
    height at zero, and the first row at the least y."""
    numbers = np.array(field.rows) if field.file is None else grids[source.meshes[field.file]]
    heights = numbers[::-1]
    if field.heights is not None:
        (low, high), least = field.heights, heights.min()
        span = heights.max() - least
        heights = low + (heights - least) * ((high - low) / span if span else 0.0)
    lowest = float(heights.min())
    x, y = required(field.size)
    return heightfield_size(x, y, field.base, heights - lowest), Pose((0.0, 0.0, lowest))


def too_many_heights(source: Source, bodies: tuple[Body, ...]) -> list[Problem]:
    """The problem of a world whose height fields have too many heights; none where they do not."""
    sizes = [shape.size for body in bodies for shape in body.shapes if shape.kind == "heightfield"]
    total = sum(len(size) - HEIGHTFIELD_HEAD for size in sizes)
    if total <= MOST_HEIGHTS:
        return []
    local, path, _ = next(field_shapes(source))
    message = (
        f"the height fields of this scenario have {total:,} heights, copies included; up to {MOST_HEIGHTS:,} are read"
    )
    return [local.document.problem(path, message, hint="fewer rows and columns, or fewer copies", code="S109")]


# Shapes of a body: as the world has them, and what mass they have where they are filled.

PIECE = "_piece_"
"""Between the name of a shape and the number of a further piece of it."""


@dataclass(frozen=True)
class ShapeFiles:
    """The content of the files that shapes name."""

    meshes: Meshes = field(default_factory=dict)
    grids: Grids = field(default_factory=dict)


@dataclass(frozen=True)
class Fill:
    """The volume (m³) that a shape fills, and its part of a body for a mass (kg)."""

    volume: float
    part: Callable[[float], inertia.Part]


@dataclass(frozen=True)
class Resolved:
    """A shape of the spec as shapes of the world (several where a mesh is taken as pieces), and what it fills: nothing for a
    plane or a height field. ``fill`` is evaluated only for bodies with mass, since a mesh need not be closed where it has
    none."""

    written: SpecShape
    shapes: tuple[Shape, ...]
    fill: Callable[[], list[Fill]]


def resolved_shape(name: str, spec: SpecShape, only: str | None, source: Source, files: ShapeFiles) -> Resolved:
    """A shape by its own ``name``, or the one given; ``only``: the material of a shape that names none."""
    kind = next(kind for kind in SHAPE_KINDS if getattr(spec, kind) is not None)
    material = spec.material or (only if spec.collision else None) or ""
    red, green, blue, *opacity = spec.colour
    colour = (red, green, blue, opacity[0] if opacity else 1.0)
    name, place = spec.name or name, pose(spec.pose)

    stated = spec.surface_velocity
    moving = None if stated is None else (stated.linear, stated.angular)

    def shape(suffix: str, size: tuple[float, ...], at: Pose, within: Pose) -> Shape:
        whole = Shape(
            f"{name}{suffix}", kind, size, at, material, spec.collision, spec.visual, colour, margin=spec.margin
        )
        return whole if moving is None else replace(whole, surface_velocity=_seen_from(within, *moving))

    if kind == "mesh":
        written = required(spec.mesh)
        mesh = files.meshes[source.meshes[written.file], options_of(written)]
        surface = _drawn(written, spec, source, place) if spec.visual else None
        shapes = tuple(
            replace(
                shape(f"{PIECE}{index}" if index else "", part.size, frames.compose(place, part.pose), part.pose),
                drawn=surface and replace(surface, first=not index),
            )
            for index, part in enumerate(mesh.parts)
        )
        enclosed = mesh.enclosed if written.mass_from != HULL else None
        return Resolved(spec, shapes, lambda: [_solid(mesh, place)] if enclosed is not None else _all(shapes))
    if kind == "heightfield":
        size, frame = placed_field(required(spec.heightfield), source, files.grids)
        return Resolved(spec, (shape("", size, frames.compose(place, frame), frame),), lambda: [])
    values = getattr(spec, kind).__dict__.values()
    size = tuple(number for value in values for number in (value if isinstance(value, tuple) else (value,)))
    return Resolved(spec, (single := (shape("", size, place, Pose()),)), lambda: _all(single))


def _drawn(mesh: Mesh, spec: SpecShape, source: Source, place: Pose) -> DrawnMesh:
    """The surface that is drawn of a mesh."""
    coloured = "colour" in spec.model_fields_set
    file, options = str(source.meshes[mesh.file]), options_of(mesh)
    return DrawnMesh(file, options.unit, options.up, options.scale, place.position, place.quaternion, coloured)


def _seen_from(frame: Pose, linear: Vector3, angular: Vector3) -> Velocity6:
    """A field of velocities, given at an origin, as it is at the origin of a ``frame`` and in its axes."""
    at = frames.add(linear, frames.cross(angular, frame.position))
    turn = frames.conjugate(frame.quaternion)
    return (*frames.rotate(turn, at), *frames.rotate(turn, angular))


def _all(shapes: tuple[Shape, ...]) -> list[Fill]:
    return [_fill(shape) for shape in shapes if not SHAPES[shape.kind].static]


def _fill(shape: Shape) -> Fill:
    volume = SHAPES[shape.kind].volume(shape.size)
    return Fill(volume, lambda heavy: inertia.shape_part(shape.kind, shape.size, shape.pose, heavy))


def _solid(mesh: MadeMesh, place: Pose) -> Fill:
    """The solid that a closed surface bounds."""
    solid = required(mesh.enclosed)
    at = frames.compose(place, solid.frame)

    def part(heavy: float) -> inertia.Part:
        xx, yy, zz = (heavy * moment / solid.volume for moment in solid.moments)
        return inertia.Part(heavy, at, (xx, yy, zz))

    return Fill(solid.volume, part)
