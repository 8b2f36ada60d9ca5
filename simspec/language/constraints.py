"""Constraints between joints and bodies outside the tree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field

from simspec.language.contact import Names
from simspec.language.document import listed
from simspec.language.joints import JointQuantity
from simspec.language.quantities import Number, Reader, Vector
from simspec.language.shapes import Point, Pose
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, fault, read_entries, show
from simspec.language.vocabulary import SCALAR_JOINTS
from simspec.language.words import Name

JointName = Annotated[str, Name(path=True, of="joint")]
TwoBodies = Annotated[tuple[str, str], Names(2, path=True)]


@dataclass(frozen=True)
class Displacement(JointQuantity):
    """An angle or a length, by the type of the joint."""

    quantity: str = "position"

    def describe(self) -> str:
        return "by the joint's type"


@dataclass(frozen=True)
class OfSum(JointQuantity):
    """A number of a sum of joint positions, which is an angle or a length; a plain number is in SI units of whichever it is."""

    def read(self, value: Any) -> float:
        return self.number(self.kinds(value)[0]).read(value)


@dataclass(frozen=True)
class RangeOfSum(Reader):
    """[lower, upper] of a sum of joint positions."""

    WORDS = "[lower, upper]"
    SCHEMA = Vector(Number("number"), 2).schema()

    def read(self, value: Any) -> tuple[float, ...]:
        if not isinstance(value, (list, tuple)) or len(value) != 2:
            raise fault(f"expected {self.describe()}", show(value), "[lower, upper]", code="S104")
        lower, upper = (BOUND.read(item) for item in value)
        if not lower < upper:
            turned = f"[{show(value[1])}, {show(value[0])}]" if lower > upper else None
            raise fault(
                "the lower limit is not below the upper", show(list(value)), "[lower, upper]", turned, code="S205"
            )
        return lower, upper

    def unit(self) -> str:
        return BOUND.unit()


BOUND = OfSum("position")


@dataclass(frozen=True)
class Coefficients(Reader):
    """Numbers by the full names of joints, none of them 0."""

    WORDS = "numbers by joint"
    SCHEMA: ClassVar = {"type": "object", "minProperties": 1, "additionalProperties": Number("number").schema()}

    def read(self, value: Any) -> dict[str, float]:
        if not isinstance(value, Mapping):
            raise fault("expected coefficients by joint", show(value), "{JOINT: number, ...}", code="S104")
        if not value:
            raise fault("no joint given", "{}", "{JOINT: number, ...}", code="S113")
        return read_entries(value, Name(path=True, of="joint").read, self._coefficient)

    @staticmethod
    def _coefficient(value: Any) -> float:
        coefficient = Number("number").read(value)
        if coefficient == 0.0:
            raise fault(
                "a coefficient of 0 adds nothing", show(value), "another number", "remove the joint", code="S502"
            )
        return coefficient


class Follow(Strict):
    """A coupling of two hinges or slides: the position of `joint` is `ratio` times that of `leader`, plus `offset`."""

    joint: JointName = Field(
        ..., description="The joint that follows; it has no controller, and follows no other joint"
    )
    leader: JointName = Field(..., description="The joint that `joint` follows")
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
            yield Fault(("leader",), "a joint cannot follow itself", str(data["leader"]), "another joint", code="S502")
        if data.get("ratio") == 0:
            hint = "make the joint fixed"
            yield Fault(
                ("ratio",), "with a ratio of 0 the joint would follow nothing", "0", "another number", hint, code="S502"
            )


class _Loop(Strict):
    bodies: TwoBodies = Field(..., description="The two bodies")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        bodies = listed(data.get("bodies"))
        if len(bodies) == 2 and bodies[0] == bodies[1]:
            yield Fault(
                ("bodies",), "a body cannot be connected to itself", str(bodies[0]), "two different bodies", code="S502"
            )


class Connect(_Loop):
    """A loop closed at a point: two bodies rotate freely about it, and do not touch each other."""

    at: Point = Field(..., description="The point in the first body's frame")
    second_at: Maybe[Point] = Field(
        ABSENT, description="The same point in the second body's frame; default: its initial position"
    )


class Weld(_Loop):
    """A rigidly closed loop: two bodies keep their relative pose, and do not touch each other."""

    pose: Maybe[Pose] = Field(
        ABSENT, description="Pose of the second body's frame in the first's; default: the initial one"
    )


class SumLimits(Strict):
    """Limits of a sum of joint positions."""

    position: Annotated[tuple[float, float], RangeOfSum()] = Field(
        ..., description="[lower, upper]: lower ≤ L ≤ upper, hard, inelastic stops"
    )


class Sum(Strict):
    """A weighted sum L of the positions of hinges and slides, with forces along it: a spring −stiffness × (L − rest),
    a damper −damping × L̇, dry friction, and stops. A force F along L is the effort coefficient × F on each joint.
    """

    joints: Annotated[dict[str, float], Coefficients()] = Field(
        ..., description="The coefficient of each joint, by its full name; not 0"
    )
    stiffness: Annotated[float, OfSum("stiffness", 0.0)] = Field(0.0, description="k ≥ 0 of the spring along the sum")
    rest: Annotated[float, OfSum("rest")] = Field(0.0, description="The sum at which the spring has no force")
    damping: Annotated[float, OfSum("damping", 0.0)] = Field(
        0.0, description="d ≥ 0 of the damper along the sum, explicit in time"
    )
    dry_friction: Annotated[float, OfSum("dry_friction", 0.0)] = Field(
        0.0, description="Maximum force of dry friction along the sum, ≥ 0"
    )
    limits: Maybe[SumLimits] = Field(ABSENT, description="Limits of the sum")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if not any(data.get(key) for key in ("stiffness", "damping", "dry_friction", "limits")):
            hint = "stiffness, damping, dry_friction, or limits: {position: [lower, upper]}"
            yield Fault((), "nothing acts along this sum", None, None, hint, code="S502")
        elif data.get("rest") and not data.get("stiffness"):
            yield Fault(
                ("rest",), "a sum without a spring has no rest", hint="give it a stiffness, or remove rest", code="S502"
            )
        limits = data.get("limits")
        ends = limits.get("position") if isinstance(limits, Mapping) else getattr(limits, "position", None)
        given: list[tuple[OfSum, Any, tuple[str | int, ...]]] = [
            (OfSum(key), data[key], (key,)) for key in ("stiffness", "rest", "damping", "dry_friction") if key in data
        ]
        given += [(BOUND, end, ("limits", "position", index)) for index, end in enumerate(listed(ends))]
        kinds: tuple[str, ...] = SCALAR_JOINTS
        for reader, value, place in given:
            try:
                suited = [kind for kind in reader.kinds(value) if kind in kinds]
            except Faults:
                continue  # reported where it is read
            if not suited:
                message = "the numbers of one sum are in units of an angle and of a length"
                yield Fault(place, message, show(value), f"in {reader.number(kinds[0]).unit()}", code="S201")
                return
            kinds = tuple(suited)


class Constraint(Strict):
    """A constraint between joints or bodies outside the tree of bodies."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("follow", "connect", "weld", "sum")

    follow: Maybe[Follow] = Field(ABSENT, description="A joint follows another")
    connect: Maybe[Connect] = Field(ABSENT, description="Two bodies meet at a point")
    weld: Maybe[Weld] = Field(ABSENT, description="Two bodies keep their relative pose")
    sum: Maybe[Sum] = Field(ABSENT, description="Springs, friction and stops along a weighted sum of joint positions")
