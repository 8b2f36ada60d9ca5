"""Shapes of a body: as the world has them, and what mass they have where they are filled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from simspec.language.mesh import HULL
from simspec.language.shapes import Shape as SpecShape
from simspec.language.sources import Source
from simspec.language.strict import required
from simspec.language.vocabulary import SHAPE_KINDS
from simspec.resolve.heightfields import Grids, placed_field
from simspec.resolve.meshes import Meshes, options_of
from simspec.resolve.poses import pose
from simspec.world import frames, inertia
from simspec.world.shapes import SHAPES
from simspec.world.types import Pose, Shape, Vector3, Velocity6

if TYPE_CHECKING:
    from simspec.meshes.made import MadeMesh

PIECE = "_piece_"
"""Between the name of a shape and the number of a further piece of it."""


@dataclass(frozen=True)
class ShapeFiles:
    """What the files that shapes name hold."""

    meshes: Meshes = field(default_factory=dict)
    grids: Grids = field(default_factory=dict)


@dataclass(frozen=True)
class Fill:
    """What a shape fills: its volume (m³), and the part of a body that it is when it has a mass (kg)."""

    volume: float
    part: Callable[[float], inertia.Part]


@dataclass(frozen=True)
class Resolved:
    """A shape of the spec as shapes of the world (several where a mesh is taken as pieces), and what it fills: nothing for a
    plane or a height field. ``fill`` is asked only of what has mass, since a mesh need not be closed where it has none."""

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
        shapes = tuple(
            shape(f"{PIECE}{index}" if index else "", part.size, frames.compose(place, part.pose), part.pose)
            for index, part in enumerate(mesh.parts)
        )
        enclosed = mesh.enclosed if written.mass_from != HULL else None
        return Resolved(spec, shapes, lambda: [_solid(mesh, place)] if enclosed is not None else _all(shapes))
    if kind == "heightfield":
        size, frame = placed_field(required(spec.heightfield), source, files.grids)
        return Resolved(spec, (shape("", size, frames.compose(place, frame), frame),), lambda: [])
    values = getattr(spec, kind).__dict__.values()
    size = tuple(number for value in values for number in (value if isinstance(value, tuple) else (value,)))
    return Resolved(spec, (only_one := (shape("", size, place, Pose()),)), lambda: _all(only_one))


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
