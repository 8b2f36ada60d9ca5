"""Poses, velocities, shapes and inertias: what a body is made of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, Field

from simspec.language.heightfield import Heightfield
from simspec.language.mesh import Mesh
from simspec.language.moments import impossible, principal_moments
from simspec.language.quantities import Number, UnitQuaternion, Vector
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict
from simspec.language.vocabulary import SHAPE_KINDS, STATIC_SHAPES
from simspec.language.words import Flag, Name

Length = Annotated[float, Number("length", 0, above=True)]
Length0 = Annotated[float, Number("length", 0)]
Lengths = Annotated[tuple[float, float, float], Vector(Number("length", 0, above=True))]
Point = Annotated[tuple[float, float, float], Vector(Number("length"))]
Angles = Annotated[tuple[float, float, float], Vector(Number("angle"))]
Quaternion = Annotated[tuple[float, float, float, float], UnitQuaternion()]
Moment = Annotated[float, Number("moment of inertia")]
Moments = Annotated[tuple[float, float, float], Vector(Number("moment of inertia", 0))]
LinearVelocity = Annotated[tuple[float, float, float], Vector(Number("velocity"))]
AngularVelocity = Annotated[tuple[float, float, float], Vector(Number("angular velocity"))]
Colour = Annotated[tuple[float, ...], Vector(Number("number", 0, 1), 3, 4)]
NameOf = Annotated[str, Name()]
Switch = Annotated[bool, Flag()]

RPY = "Roll, pitch, yaw about the fixed x, y, z axes of the parent's frame: R = Rz(yaw) Ry(pitch) Rx(roll)"


def excluded(data: Mapping[str, Any], first: str, second: str, why: str) -> Iterable[Fault]:
    """A fault where both of two fields are given."""
    if first in data and second in data:
        yield Fault((second,), f"{first} and {second} exclude each other: {why}", None, f"{first} or {second}")


class Orientation(Strict):
    """A rotation, as `rpy` or as `quat`, never both; neither means none."""

    rpy: Maybe[Angles] = Field(ABSENT, description=RPY)
    quat: Maybe[Quaternion] = Field(ABSENT, description="Unit quaternion w x y z")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from excluded(data, "rpy", "quat", "each defines the whole rotation")


class Pose(Strict):
    """Where a frame is in its parent's frame; `rpy` or `quat`, never both."""

    xyz: Point = Field((0.0, 0.0, 0.0), description="Position of the frame's origin")
    rpy: Maybe[Angles] = Field(ABSENT, description=RPY)
    quat: Maybe[Quaternion] = Field(ABSENT, description="Unit quaternion w x y z")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from Orientation.faults(data)


class Velocity(Strict):
    """The initial velocity of a free root, in the axes of the frame that its `pose` is in: the world's for a loose body and for
    a placed model, the model's for the root within a model."""

    linear: LinearVelocity = Field((0.0, 0.0, 0.0), description="Velocity of the origin of the body's frame")
    angular: AngularVelocity = Field((0.0, 0.0, 0.0), description="Angular velocity")


class SurfaceVelocity(Strict):
    """The velocity of a surface whose shape stays: of a conveyor belt, or a turntable. At a point x of the shape's frame the
    surface moves at linear + angular × x, less what points out of it."""

    linear: LinearVelocity = Field(
        (0.0, 0.0, 0.0), description="Velocity at the origin of the shape's frame, in its axes"
    )
    angular: AngularVelocity = Field((0.0, 0.0, 0.0), description="Angular velocity, in the axes of the shape's frame")


class Sphere(Strict):
    """A ball about the origin of the shape's frame."""

    radius: Length = Field(..., description="Radius")


class Box(Strict):
    """A cuboid about the origin of the shape's frame."""

    size: Lengths = Field(..., description="Full edge lengths along x, y, z")


class Cylinder(Strict):
    """A cylinder along z about the origin of the shape's frame."""

    radius: Length = Field(..., description="Radius")
    length: Length = Field(..., description="Distance between the flat ends")


class Capsule(Strict):
    """A cylinder along z with half a ball on either end, about the origin of the shape's frame."""

    radius: Length = Field(..., description="Radius of the cylinder and of the ends")
    length: Length = Field(..., description="Length of the cylindrical part; the whole is 2 × radius longer")


class Ellipsoid(Strict):
    """An ellipsoid about the origin of the shape's frame."""

    radii: Lengths = Field(..., description="Semi-axes along x, y, z")


class Plane(Strict):
    """The infinite x-y plane of the shape's frame, solid below (z < 0). Only on bodies fixed to the world."""


class Shape(Strict):
    """One collision and/or visual shape of a body."""

    ONE_OF: ClassVar[tuple[str, ...]] = SHAPE_KINDS

    name: Maybe[NameOf] = Field(
        ABSENT, description="Name; default `<body>_<index>`, with a number appended if that name is taken"
    )
    sphere: Maybe[Sphere] = Field(ABSENT, description="A ball")
    box: Maybe[Box] = Field(ABSENT, description="A cuboid")
    cylinder: Maybe[Cylinder] = Field(ABSENT, description="A cylinder along z")
    capsule: Maybe[Capsule] = Field(ABSENT, description="A capsule along z")
    ellipsoid: Maybe[Ellipsoid] = Field(ABSENT, description="An ellipsoid")
    plane: Maybe[Plane] = Field(ABSENT, description="An infinite plane, written `plane: {}`")
    mesh: Maybe[Mesh] = Field(ABSENT, description="A solid from a file of triangles")
    heightfield: Maybe[Heightfield] = Field(ABSENT, description="Ground of uneven height")
    pose: Maybe[Pose] = Field(
        ABSENT, description="Pose of the shape's frame in the body frame; default: the body frame"
    )
    density: Maybe[Annotated[float, Number("density", 0)]] = Field(
        ABSENT, description="Density; the body's mass properties are then the sum over its shapes"
    )
    material: Maybe[NameOf] = Field(
        ABSENT, description="A material of `contact.materials`; default: the only one, where exactly one is defined"
    )
    margin: Length0 = Field(
        0.0, description="Distance from the surface at which contact begins; the margins of both shapes are added"
    )
    surface_velocity: Maybe[SurfaceVelocity] = Field(
        ABSENT, description="Velocity of the surface while the shape stays, for friction; default: none"
    )
    collision: Switch = Field(True, description="Whether the shape takes part in contact")
    visual: Switch = Field(True, description="Whether the shape is drawn")
    colour: Colour = Field((0.7, 0.7, 0.7, 1.0), description="Red, green, blue and, where given, opacity; each 0 to 1")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "plane" in data and "density" in data:
            yield Fault(("density",), "a plane has no volume, so no density")
        if "heightfield" in data and "density" in data:
            yield Fault(("density",), "a height field cannot move, so it has no density")
        if data.get("collision") is False and "margin" in data:
            yield Fault(("margin",), "a margin belongs to contact, and the shape has none", hint="remove it")
        if data.get("collision") is False and "surface_velocity" in data:
            message = "a velocity of the surface belongs to contact, and the shape has none"
            yield Fault(("surface_velocity",), message, hint="remove it")
        if data.get("collision") is False and data.get("visual") is False:
            yield Fault(("visual",), "neither collision nor visual: the shape would have no effect", hint="remove it")

    @property
    def has_volume(self) -> bool:
        """Whether it can be filled with mass."""
        return all(getattr(self, kind) is None for kind in STATIC_SHAPES)


class Tensor(Strict):
    """An inertia tensor about the centre of mass, in axes parallel to the body frame's. The products of inertia are
    the tensor's own off-diagonal elements."""

    xx: Moment = Field(..., description="Ixx = ∫ (y² + z²) dm")
    yy: Moment = Field(..., description="Iyy = ∫ (x² + z²) dm")
    zz: Moment = Field(..., description="Izz = ∫ (x² + y²) dm")
    xy: Moment = Field(0.0, description="Ixy = −∫ x y dm")
    xz: Moment = Field(0.0, description="Ixz = −∫ x z dm")
    yz: Moment = Field(0.0, description="Iyz = −∫ y z dm")


class Inertia(Strict):
    """Moments of inertia about the centre of mass: a tensor, or principal moments with the orientation of their axes. No
    body has a principal moment above the sum of the other two; such values are refused."""

    ONE_OF: ClassVar[tuple[str, ...]] = ("tensor", "principal")

    tensor: Maybe[Tensor] = Field(ABSENT, description="The tensor in the body's axes")
    principal: Maybe[Moments] = Field(ABSENT, description="Principal moments, about the principal axes x, y, z")
    rpy: Maybe[Angles] = Field(ABSENT, description="Orientation of the principal axes in the body frame")
    quat: Maybe[Quaternion] = Field(ABSENT, description="The same, as a unit quaternion w x y z")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from Orientation.faults(data)
        for key in ("rpy", "quat"):
            if key in data and "tensor" in data:
                yield Fault((key,), f"{key} rotates principal axes; a tensor is given in the body's axes")
        for key, reader in (("principal", _principal), ("tensor", _of_tensor)):
            try:
                why = impossible(reader(data[key])) if key in data else None
            except Faults:
                continue  # reported where the value is read
            if why:
                hint = "moments are about the centre of mass; products carry the tensor's own sign"
                yield Fault((key,), why, None, "no principal moment greater than the sum of the other two", hint)


def _principal(value: Any) -> tuple[float, ...]:
    return Vector(Number("moment of inertia", 0)).read(value)


def _of_tensor(value: Any) -> tuple[float, ...]:
    values = value.model_dump() if isinstance(value, BaseModel) else value
    if not isinstance(values, Mapping) or not all(name in values for name in ("xx", "yy", "zz")):
        raise Faults([Fault((), "no tensor")])
    number = Number("moment of inertia")
    return principal_moments([number.read(values.get(name, 0.0)) for name in ("xx", "yy", "zz", "xy", "xz", "yz")])
