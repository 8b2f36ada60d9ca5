"""Parts of models other than bodies: arrays (many bodies or models written once), named initial states, named frames."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field

from simspec.language.joint_names import NamePattern
from simspec.language.quantities import Number, Reader, Vector, Whole
from simspec.language.shapes import Length, Point, Pose, Switch, Velocity
from simspec.language.strict import ABSENT, Fault, Maybe, Strict, fault, required, show
from simspec.language.words import Name

MOST_ELEMENTS = 100_000
"""Elements of one array, and bodies of one scenario: beyond it a slip of the pen is likelier than a plan."""


@dataclass(frozen=True)
class Grid(Reader):
    """Three counts."""

    WORDS = "a list of 3 whole numbers ≥ 1"
    SCHEMA: ClassVar = {"type": "array", "items": Whole(1, MOST_ELEMENTS).schema(), "minItems": 3, "maxItems": 3}

    def read(self, value: Any) -> tuple[int, int, int]:
        if not isinstance(value, (list, tuple)) or len(value) != 3:
            raise fault("expected three whole numbers", show(value), "[nx, ny, nz]")
        counts = [Whole(1, MOST_ELEMENTS).read(item) for item in value]
        total = counts[0] * counts[1] * counts[2]
        if total > MOST_ELEMENTS:
            raise fault("too many elements", f"{total}", f"up to {MOST_ELEMENTS}")
        return counts[0], counts[1], counts[2]


@dataclass(frozen=True)
class Spacing(Reader):
    """One length for all axes, or three."""

    UNIT = "m"
    WORDS = "a length, or a list of 3"
    SCHEMA: ClassVar = {"anyOf": [Number("length").schema(), Vector(Number("length")).schema()]}

    def read(self, value: Any) -> tuple[float, ...]:
        if isinstance(value, (list, tuple)):
            return Vector(Number("length")).read(value)
        distance = Number("length").read(value)
        return (distance, distance, distance)


class Jitter(Strict):
    """Seeded perturbation of an array's elements: the same layout on every machine and in every engine."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("uniform", "radial")

    uniform: Maybe[Annotated[float, Number("length", 0)]] = Field(
        ABSENT, description="a: each coordinate of each element moves by U(−a, a); three draws per element: x, y, z"
    )
    radial: Maybe[Annotated[float, Number("number", 0, 1)]] = Field(
        ABSENT,
        description="a: each element's offset from the array's origin is scaled by U(1 − a, 1 + a); one draw each",
    )
    seed: Annotated[int, Whole()] = Field(..., description="Seed of the generator (Python's random.Random)")


class Array(Strict):
    """Copies of a root body with all its descendants, or of a model, named `<name>_<index>` with zeros in front to equal
    width. The elements are laid out in the frame that `pose` gives."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("grid", "line", "ring", "poses")
    COMPANIONS: ClassVar[Mapping[str, tuple[str, bool]]] = {
        "spacing": ("grid", True),
        "step": ("line", True),
        "radius": ("ring", True),
        "face": ("ring", False),
    }
    """Fields that belong to one layout, and whether it needs them."""

    grid: Maybe[Annotated[Any, Grid()]] = Field(
        ABSENT, description="[nx, ny, nz]: element (i, j, k) at spacing × (i, j, k); k runs fastest"
    )
    spacing: Annotated[Any, Spacing()] = Field(None, description="Distance of neighbours in a grid, along each axis")
    line: Maybe[Annotated[int, Whole(1, MOST_ELEMENTS)]] = Field(
        ABSENT, description="n elements, element i at i × `step`"
    )
    step: Maybe[Point] = Field(ABSENT, description="Displacement from one element of a line to the next")
    ring: Maybe[Annotated[int, Whole(1, MOST_ELEMENTS)]] = Field(
        ABSENT, description="n elements on a circle in the x-y plane, element i at the angle 2π i/n from the x axis"
    )
    radius: Maybe[Length] = Field(ABSENT, description="Radius of a ring")
    face: Switch = Field(
        False, description="Whether each element of a ring is turned by its angle, so that its x axis points outwards"
    )
    poses: Maybe[list[Pose]] = Field(ABSENT, description="The elements' poses, one by one")
    jitter: Maybe[Jitter] = Field(ABSENT, description="Perturbation of the elements' positions")

    def count(self) -> int:
        """How many elements there are."""
        if self.grid is not None:
            return math.prod(self.grid)
        return self.line or self.ring or len(required(self.poses))

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        for name, (layout, needed) in cls.COMPANIONS.items():
            if name in data and layout not in data:
                yield Fault((name,), f"{name} belongs to {layout}", None, None, f"remove it, or write {layout}")
            if needed and layout in data and name not in data:
                yield Fault((), f"{layout} needs {name}")
        poses = data.get("poses")
        if isinstance(poses, list) and not 0 < len(poses) <= MOST_ELEMENTS:
            yield Fault(("poses",), "expected one pose or more", f"{len(poses)} poses", f"1 to {MOST_ELEMENTS}")


class State(Strict):
    """An initial state of a model. Omitted values are those of the model's bodies."""

    pose: Maybe[Pose] = Field(ABSENT, description="Pose of the root in the model, in place of the body's")
    velocity: Maybe[Velocity] = Field(
        ABSENT, description="Velocity of a free root in the model's axes, in place of the body's"
    )
    positions: dict[Annotated[str, NamePattern()], Any] = Field(
        {}, description="Joint positions by the joint's name in the model; `*` matches any text"
    )
    velocities: dict[Annotated[str, NamePattern()], Any] = Field(
        {}, description="Joint velocities by the joint's name in the model; `*` matches any text"
    )
    commands: dict[Annotated[str, NamePattern("actuator")], Any] = Field(
        {},
        description="Commands by the actuator's name in the model, in place of the actuator's `command`; `*` "
        "matches any text",
    )


class Frame(Strict):
    """A frame fixed to a body, without mass or contact. It names a place: a tool point, a sensor, a site."""

    body: Annotated[str, Name(path=True)] = Field(
        ...,
        description="Body to which the frame is fixed: by its name in the model, or by its full name for a "
        "frame of a scenario",
    )
    pose: Maybe[Pose] = Field(ABSENT, description="Pose of the frame in the body's frame; default: the same frame")
