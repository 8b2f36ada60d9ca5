"""Poses, velocities, shapes and inertias of bodies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, Field, create_model

from simspec.language.document import Key, listed, mapping
from simspec.language.moments import impossible, principal_moments
from simspec.language.quantities import Number, Reader, UnitQuaternion, Vector, Whole, parse
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, fault, read_each, show
from simspec.language.vocabulary import SHAPE_KINDS, STATIC_SHAPES
from simspec.language.words import FileName, Flag, Name, Word

AXES = ("x", "y", "z")
GRID_SUFFIXES = (".png", ".csv", ".txt")
"""Ends of names of files of heights, in small letters."""
MOST_HEIGHTS = 2**18
"""Heights of one field, 512 × 512: each takes 20 bytes in a world's file, and two triangles in an engine."""
FEWEST = 2
"""Rows, and columns, of the smallest field: one cell."""


@dataclass(frozen=True)
class HeightRows(Reader):
    """Rows of heights, all equally long."""

    UNIT = "m"
    WORDS = f"a list of at least {FEWEST} rows of heights"
    SCHEMA: ClassVar = {
        "type": "array",
        "items": {"type": "array", "items": Number("length").schema(), "minItems": FEWEST},
        "minItems": FEWEST,
    }

    def read(self, value: Any) -> tuple[tuple[float, ...], ...]:
        if hasattr(value, "tolist"):  # an array of numpy
            value = value.tolist()
        if not isinstance(value, (list, tuple)) or len(value) < FEWEST:
            found = f"{len(value)} rows" if isinstance(value, (list, tuple)) else show(value)
            raise fault(f"expected {self.describe()}", found, "[[…, …], [0.1, 0.2]]", code="S104")
        wide = len(value[0]) if isinstance(value[0], (list, tuple)) else 0
        if len(value) * max(wide, 1) > MOST_HEIGHTS:
            raise fault(
                "too many heights",
                f"{len(value)} × {wide}",
                f"up to {MOST_HEIGHTS}",
                "fewer rows and columns",
                code="S109",
            )

        def read_row(row: Any) -> tuple[float, ...]:
            if not isinstance(row, (list, tuple)) or len(row) < FEWEST or len(row) != wide:
                found = f"{len(row)} heights" if isinstance(row, (list, tuple)) else show(row)
                allowed = f"{max(wide, FEWEST)}, as in the first row" if wide >= FEWEST else f"at least {FEWEST}"
                raise fault("rows are equally long lists of heights", found, allowed, code="S407")
            return Vector(Number("length"), len(row)).read(row)

        return tuple(read_each(enumerate(value), read_row))


class Heightfield(Strict):
    """Ground of uneven height: the x-y rectangle `size` about the origin of the shape's frame, with heights over a grid of
    points. Each cell of the grid is two triangles, which meet along the diagonal from its corner at the least x and y to that
    at the greatest. The space below them is solid, down to `base` below the lowest point. Only on bodies that cannot move."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("rows", "file")

    rows: Maybe[Annotated[tuple[tuple[float, ...], ...], HeightRows()]] = Field(
        ABSENT,
        description="Heights as on a map: the first row at the greatest y, the first value of a row at the least x",
    )
    file: Maybe[Annotated[str, FileName()]] = Field(
        ABSENT,
        description="Path of a file with the heights, relative to this file: a grey PNG (8 or 16 bits), or "
        "numbers as text (CSV, TXT), one row in each line",
    )
    size: Annotated[tuple[float, float], Vector(Number("length", 0, above=True), 2)] = Field(
        ..., description="Full lengths along x and y, between the outermost points"
    )
    heights: Maybe[Annotated[tuple[float, float], Vector(Number("length"), 2)]] = Field(
        ABSENT,
        description="Heights of the smallest and of the largest number, with the others in proportion; default: "
        "the numbers are heights in m. Required for a PNG",
    )
    base: Annotated[float, Number("length", 0, above=True)] = Field(
        1.0, description="Depth of the solid ground below the lowest point"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        text = data.get("file")
        if isinstance(text, str) and text.strip():
            if not text.lower().endswith(GRID_SUFFIXES):
                yield Fault(
                    ("file",), "not a file of heights that is read", show(text), " ".join(GRID_SUFFIXES), code="S407"
                )
            elif text.lower().endswith(".png") and "heights" not in data:
                hint = "heights: [0, 0.5], those of the darkest and of the lightest pixel"
                yield Fault((), "the shades of a PNG are no lengths: heights is missing", None, None, hint, code="S407")
        heights = data.get("heights")
        if isinstance(heights, (list, tuple)) and len(heights) == 2:
            try:
                low, high = Vector(Number("length"), 2).read(heights)
            except Faults:
                return  # reported where it is read
            if low > high:
                yield Fault(
                    ("heights",),
                    "the first is that of the least number",
                    show(heights),
                    "[lowest, highest]",
                    code="S407",
                )


MESH_SUFFIXES = (".obj", ".stl", ".dae", ".glb", ".gltf", ".ply", ".msh")
"""Ends of names of files of triangles, in small letters."""
UNITS = ("m", "dm", "cm", "mm", "um", "in", "ft")
"""Units that a file's lengths may be in."""
FEWEST_VERTICES, MOST_VERTICES = 4, 20_000
"""Vertices of a hull. Engines' times grow with them: bodies of 1,800 run a hundred times slower in some than bodies of 128."""
FROM_FILES = ("mesh", "heightfield")
"""Kinds of shapes that may name a file."""
HULL, PIECES = "hull", "pieces"
SURFACE = "surface"


@dataclass(frozen=True)
class Scale(Reader):
    """A factor, or one for each axis; a negative one mirrors."""

    WORDS = "a number, or 3 of them"
    SCHEMA: ClassVar = {"anyOf": [Number("number").schema(), Vector(Number("number")).schema()]}

    def read(self, value: Any) -> tuple[float, float, float]:
        number = Number("number")
        if isinstance(value, (list, tuple)) or hasattr(value, "tolist"):
            x, y, z = Vector(number).read(value)
        else:
            x = y = z = number.read(value)
        if 0.0 in (x, y, z):
            raise fault("a factor of 0 leaves no volume", show(value), "numbers other than 0", code="S204")
        return (x, y, z)


@dataclass(frozen=True)
class Taken(Word):
    """The solid that a mesh stands for."""

    def read(self, value: Any) -> str:
        if value == SURFACE:
            hint = "hull; pieces for what is not convex; a height field or boxes for ground"
            raise fault(
                "contact with a surface of triangles is not supported yet",
                SURFACE,
                ", ".join(self.words),
                hint,
                code="S406",
            )
        return super().read(value)


class _File(Strict):
    file: Annotated[str, FileName()] = Field(
        ..., description="Path of the file (OBJ, STL, DAE, glTF, GLB, PLY, MSH), relative to this file"
    )
    unit: Maybe[Annotated[str, Word(UNITS)]] = Field(
        ABSENT, description="Unit of the file's lengths; default: that of the DAE file, else m"
    )
    up: Maybe[Annotated[str, Word(AXES)]] = Field(
        ABSENT,
        description="The file's axis that becomes z; default: that of the DAE file, y for glTF and GLB, z for "
        "all others",
    )
    scale: Annotated[tuple[float, float, float], Scale()] = Field(
        (1.0, 1.0, 1.0), description="Factors along the axes after `up`; negative ones mirror"
    )


_AS: dict[str, Any] = {  # `as` is no name that a class body may have
    "as": (
        Annotated[str, Taken((HULL, PIECES))],
        Field(
            HULL,
            description="`hull`: the convex hull; `pieces`: several convex hulls that together approximate the mesh",
        ),
    ),
}
_FileAs: type[_File] = create_model("_FileAs", __base__=_File, **_AS)


class Mesh(_FileAs):
    """A solid from a file of triangles: their convex hull, or several convex pieces."""

    max_vertices: Maybe[Annotated[int, Whole(FEWEST_VERTICES, MOST_VERTICES)]] = Field(
        ABSENT, description="Maximum number of vertices of the hull, or of each piece; default: no limit"
    )
    mass_from: Annotated[str, Word((SURFACE, HULL))] = Field(
        SURFACE,
        description="The solid of `density`, or of the body's `mass` without `inertia`: the closed `surface`, or the `hull`",
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        text = data.get("file")
        if isinstance(text, str) and text.strip() and not text.lower().endswith(MESH_SUFFIXES):
            yield Fault(
                ("file",), "not a file of triangles that is read", show(text), " ".join(MESH_SUFFIXES), code="S406"
            )

    @property
    def taken_as(self) -> str:
        """``hull`` or ``pieces``."""
        value: str = getattr(self, "as")
        return value

    def metres(self) -> float | None:
        """The length of the file's unit (m), where the spec says it."""
        return None if self.unit is None else parse(f"1 {self.unit}", "length")


def named_files(data: Any) -> Iterator[tuple[tuple[Key, ...], str]]:
    """The files that the shapes of a plain spec name, with the paths of the texts."""
    data = mapping(data)
    trees: list[tuple[tuple[Key, ...], Any]] = [((), data), (("model",), data.get("model"))]
    trees += [(("models", name), placed) for name, placed in mapping(data.get("models")).items()]
    for around, tree in trees:
        path = (*around, "bodies")
        for name, body in mapping(mapping(tree).get("bodies")).items():
            for index, shape in enumerate(listed(mapping(body).get("shapes"))):
                for kind in FROM_FILES:
                    text = mapping(mapping(shape).get(kind)).get("file")
                    if isinstance(text, str):
                        yield (*path, name, "shapes", index, kind, "file"), text


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

QUAT = "Unit quaternion w x y z"
RPY = "Roll, pitch, yaw about the fixed x, y, z axes of the parent's frame: R = Rz(yaw) Ry(pitch) Rx(roll)"


class Rotated(Strict):
    """Base of what has a rotation, as `rpy` or as `quat`, never both; the fields stand in the models, for their order."""

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "rpy" in data and "quat" in data:
            message = "rpy and quat exclude each other: each defines the whole rotation"
            yield Fault(("quat",), message, None, "rpy or quat", code="S103")


class Orientation(Rotated):
    """A rotation, as `rpy` or as `quat`, not both; default: no rotation."""

    rpy: Maybe[Angles] = Field(ABSENT, description=RPY)
    quat: Maybe[Quaternion] = Field(ABSENT, description=QUAT)


class Pose(Rotated):
    """Pose of a frame in its parent's frame; `rpy` or `quat`, not both."""

    xyz: Point = Field((0.0, 0.0, 0.0), description="Position of the frame's origin")
    rpy: Maybe[Angles] = Field(ABSENT, description=RPY)
    quat: Maybe[Quaternion] = Field(ABSENT, description=QUAT)


class Velocity(Strict):
    """The initial velocity of a free root, in the axes of the reference frame of its `pose`: the world's for a loose
    body and for a placed model, the model's for the root within a model.
    """

    linear: LinearVelocity = Field((0.0, 0.0, 0.0), description="Velocity of the origin of the body's frame")
    angular: AngularVelocity = Field((0.0, 0.0, 0.0), description="Angular velocity")


class SurfaceVelocity(Strict):
    """The velocity of a surface relative to its shape, as of a conveyor belt or a turntable. At a point x of the
    shape's frame the surface moves at linear + angular × x, without the normal component.
    """

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

    ALTERNATIVES: ClassVar[tuple[str, ...]] = SHAPE_KINDS

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
        ABSENT, description="Density; the body's mass properties are the sum over its shapes"
    )
    material: Maybe[NameOf] = Field(
        ABSENT, description="A material of `contact.materials`; default: the only one, where exactly one is defined"
    )
    margin: Length0 = Field(
        0.0, description="Distance from the surface at which contact begins; the margins of both shapes are added"
    )
    surface_velocity: Maybe[SurfaceVelocity] = Field(
        ABSENT, description="Velocity of the surface relative to the shape, for friction; default: none"
    )
    collision: Switch = Field(True, description="Whether the shape takes part in contact")
    visual: Switch = Field(True, description="Whether the shape is drawn")
    colour: Colour = Field((0.7, 0.7, 0.7, 1.0), description="Red, green, blue and, where given, opacity; each 0 to 1")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "plane" in data and "density" in data:
            yield Fault(("density",), "a plane has no volume, so no density", code="S110")
        if "heightfield" in data and "density" in data:
            yield Fault(("density",), "a height field cannot move, so it has no density", code="S110")
        if data.get("collision") is not False:
            return
        for key, noun in (("margin", "margin"), ("surface_velocity", "velocity of the surface")):
            if key in data:
                yield Fault(
                    (key,), f"a {noun} belongs to contact, and the shape has none", hint="remove it", code="S110"
                )
        if data.get("visual") is False:
            yield Fault(
                ("visual",),
                "neither collision nor visual: the shape would have no effect",
                hint="remove it",
                code="S110",
            )

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


class Inertia(Rotated):
    """Moments of inertia about the centre of mass: a tensor, or principal moments with the orientation of their axes. No
    body has a principal moment above the sum of the other two; such values are refused."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("tensor", "principal")

    tensor: Maybe[Tensor] = Field(ABSENT, description="The tensor in the body's axes")
    principal: Maybe[Moments] = Field(ABSENT, description="Principal moments, about the principal axes x, y, z")
    rpy: Maybe[Angles] = Field(ABSENT, description="Orientation of the principal axes in the body frame")
    quat: Maybe[Quaternion] = Field(ABSENT, description="The same, as a unit quaternion w x y z")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from super().faults(data)
        for key in ("rpy", "quat"):
            if key in data and "tensor" in data:
                yield Fault((key,), f"{key} rotates principal axes; a tensor is given in the body's axes", code="S110")
        for key, reader in (("principal", Vector(Number("moment of inertia", 0)).read), ("tensor", _of_tensor)):
            try:
                why = impossible(reader(data[key])) if key in data else None
            except Faults:
                continue  # reported where the value is read
            if why:
                hint = "moments are about the centre of mass; products carry the tensor's own sign"
                yield Fault(
                    (key,), why, None, "no principal moment greater than the sum of the other two", hint, code="S402"
                )


def _of_tensor(value: Any) -> tuple[float, ...]:
    values = value.model_dump() if isinstance(value, BaseModel) else value
    if not isinstance(values, Mapping) or not all(name in values for name in ("xx", "yy", "zz")):
        raise Faults([Fault((), "no tensor", code="S402")])
    number = Number("moment of inertia")
    return principal_moments([number.read(values.get(name, 0.0)) for name in ("xx", "yy", "zz", "xy", "xz", "yz")])
