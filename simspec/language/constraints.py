"""Constraints: what holds joints and bodies together outside the tree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field

from simspec.language.contact import Names
from simspec.language.joints import DIMENSION, check_suits_driven
from simspec.language.quantities import Number
from simspec.language.reader import Reader
from simspec.language.shapes import Point, Pose
from simspec.language.strict import ABSENT, Fault, Maybe, Strict
from simspec.language.words import Name

JointName = Annotated[str, Name(path=True, of="joint")]
TwoBodies = Annotated[tuple[str, str], Names(2, path=True)]


@dataclass(frozen=True)
class Displacement(Reader):
    """An angle or a length, by the type of the joint, which shows when the spec is resolved (:meth:`number`); kept as written.
    What suits neither a hinge nor a slide is refused here."""

    def number(self, kind: str) -> Number:
        """The number of a joint of a type (hinge or slide)."""
        return Number(DIMENSION[kind]["position"])

    def read(self, value: Any) -> Any:
        check_suits_driven(self.number, value)
        return value

    def unit(self) -> str:
        return "rad or m"

    def describe(self) -> str:
        return "by the joint's type"

    def schema(self) -> dict[str, Any]:
        return Number("number").schema()


class Follow(Strict):
    """A coupling of two hinges or slides: the position of `joint` is `ratio` times that of `leader`, plus `offset`."""

    joint: JointName = Field(
        ..., description="The joint that follows; it has no controller, and follows no other joint"
    )
    leader: JointName = Field(..., description="The joint that it follows")
    ratio: Annotated[float, Number("number")] = Field(
        1.0,
        description="Position of `joint` for each unit of `leader`'s, not 0; m/rad for a slide that follows a hinge",
    )
    offset: Maybe[Annotated[Any, Displacement()]] = Field(
        ABSENT, description="Position of `joint` where `leader` is at zero; default 0"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "joint" in data and data.get("joint") == data.get("leader"):
            yield Fault(("leader",), "a joint cannot follow itself", str(data["leader"]), "another joint")
        if data.get("ratio") == 0:
            hint = "make the joint fixed"
            yield Fault(("ratio",), "with a ratio of 0 the joint would follow nothing", "0", "another number", hint)


class Connect(Strict):
    """A loop that is closed at a point: two bodies turn freely about it, and do not touch each other."""

    bodies: TwoBodies = Field(..., description="The two bodies")
    at: Point = Field(..., description="The point in the first body's frame")
    second_at: Maybe[Point] = Field(
        ABSENT, description="The same point in the second body's frame; default: where it is initially"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from _same(data)


class Weld(Strict):
    """A loop that is closed rigidly: two bodies keep their places in each other's frames, and do not touch each other."""

    bodies: TwoBodies = Field(..., description="The two bodies")
    pose: Maybe[Pose] = Field(
        ABSENT, description="Pose of the second body's frame in the first's; default: the initial one"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from _same(data)


def _same(data: Mapping[str, Any]) -> Iterable[Fault]:
    bodies = data.get("bodies")
    if isinstance(bodies, (list, tuple)) and len(bodies) == 2 and bodies[0] == bodies[1]:
        yield Fault(("bodies",), "a body cannot be held to itself", str(bodies[0]), "two different bodies")


class Constraint(Strict):
    """What holds joints or bodies together outside the tree of bodies."""

    ONE_OF: ClassVar[tuple[str, ...]] = ("follow", "connect", "weld")

    follow: Maybe[Follow] = Field(ABSENT, description="A joint follows another")
    connect: Maybe[Connect] = Field(ABSENT, description="Two bodies meet at a point")
    weld: Maybe[Weld] = Field(ABSENT, description="Two bodies are held rigidly")
