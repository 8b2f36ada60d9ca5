"""Arrays: many bodies or models written once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field

from simspec.language.quantities import Number, Vector, Whole
from simspec.language.reader import Reader
from simspec.language.shapes import Length, Point, Pose, Switch
from simspec.language.strict import ABSENT, Fault, Maybe, Strict, fault, required, show

MOST_ELEMENTS = 100_000
"""Elements of one array, and bodies of one scenario: beyond it a slip of the pen is likelier than a plan."""


@dataclass(frozen=True)
class Grid(Reader):
    """Three counts."""

    def read(self, value: Any) -> tuple[int, int, int]:
        if not isinstance(value, (list, tuple)) or len(value) != 3:
            raise fault("expected three whole numbers", show(value), "[nx, ny, nz]")
        counts = [Whole(1, MOST_ELEMENTS).read(item) for item in value]
        total = counts[0] * counts[1] * counts[2]
        if total > MOST_ELEMENTS:
            raise fault("too many elements", f"{total}", f"up to {MOST_ELEMENTS}")
        return counts[0], counts[1], counts[2]

    def describe(self) -> str:
        return "a list of 3 whole numbers ≥ 1"

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": Whole(1, MOST_ELEMENTS).schema(), "minItems": 3, "maxItems": 3}


@dataclass(frozen=True)
class Spacing(Reader):
    """One length for all axes, or three."""

    def read(self, value: Any) -> tuple[float, ...]:
        if isinstance(value, (list, tuple)):
            return Vector(Number("length")).read(value)
        distance = Number("length").read(value)
        return (distance, distance, distance)

    def unit(self) -> str:
        return "m"

    def describe(self) -> str:
        return "a length, or a list of 3"

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [Number("length").schema(), Vector(Number("length")).schema()]}


class Jitter(Strict):
    """Seeded perturbation of an array's elements: the same layout on every machine and in every engine."""

    ONE_OF: ClassVar[tuple[str, ...]] = ("uniform", "radial")

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

    ONE_OF: ClassVar[tuple[str, ...]] = ("grid", "line", "ring", "poses")
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
    step: Maybe[Point] = Field(ABSENT, description="From one element of a line to the next")
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
