"""Constraints: what holds joints and bodies together outside the tree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field

from simspec.language.contact import Names
from simspec.language.joints import DIMENSION, check_suits_driven
from simspec.language.quantities import Number, Reader, Vector
from simspec.language.shapes import Point, Pose
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, fault, replace_loc, show
from simspec.language.vocabulary import SCALAR_JOINTS
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


@dataclass(frozen=True)
class OfSum(Reader):
    """A number of a sum of joint positions, which is an angle or a length. ``quantity`` is an entry of ``joints.DIMENSION``; a
    plain number is in SI units of whichever it is."""

    quantity: str
    least: float | None = None

    def number(self, kind: str) -> Number:
        """The number where the sum is what a joint of this type (hinge or slide) has as its position."""
        return Number(DIMENSION[kind][self.quantity], self.least)

    def read(self, value: Any) -> float:
        check_suits_driven(self.number, value)
        return self.number(self.kinds(value)[0]).read(value)

    def kinds(self, value: Any) -> tuple[str, ...]:
        """The types of joints whose number of this sort ``value`` may be."""
        suited = []
        for kind in SCALAR_JOINTS:
            try:
                self.number(kind).read(value)
            except Faults:
                continue
            suited.append(kind)
        return tuple(suited)

    def unit(self) -> str:
        units = (self.number(kind).unit() for kind in SCALAR_JOINTS)
        return " or ".join(units)

    def describe(self) -> str:
        return "a number" if self.least is None else f"a number ≥ {self.least:g}"

    def schema(self) -> dict[str, Any]:
        return Number("number", self.least).schema()


@dataclass(frozen=True)
class RangeOfSum(Reader):
    """[lower, upper] of a sum of joint positions."""

    def read(self, value: Any) -> tuple[float, ...]:
        if not isinstance(value, (list, tuple)) or len(value) != 2:
            raise fault(f"expected {self.describe()}", show(value), "[lower, upper]")
        lower, upper = (BOUND.read(item) for item in value)
        if not lower < upper:
            turned = f"[{show(value[1])}, {show(value[0])}]" if lower > upper else None
            raise fault("the lower limit is not below the upper", show(list(value)), "[lower, upper]", turned)
        return lower, upper

    def unit(self) -> str:
        return BOUND.unit()

    def describe(self) -> str:
        return "[lower, upper]"

    def schema(self) -> dict[str, Any]:
        return Vector(Number("number"), 2).schema()


BOUND = OfSum("position")


@dataclass(frozen=True)
class Coefficients(Reader):
    """Numbers by the full names of joints, none of them 0."""

    def read(self, value: Any) -> dict[str, float]:
        if not isinstance(value, Mapping):
            raise fault("expected coefficients by joint", show(value), "{JOINT: number, ...}")
        if not value:
            raise fault("no joint given", "{}", "{JOINT: number, ...}")
        faults: list[Fault] = []
        coefficients: dict[str, float] = {}
        for name, item in value.items():
            try:
                joint = Name(path=True, of="joint").read(name)
                coefficients[joint] = Number("number").read(item)
                if coefficients[joint] == 0.0:
                    raise fault("a coefficient of 0 adds nothing", show(item), "another number", "remove the joint")
            except Faults as error:
                faults.extend(replace_loc(error.faults, (str(name),)))
        if faults:
            raise Faults(faults)
        return coefficients

    def describe(self) -> str:
        return "numbers by joint"

    def schema(self) -> dict[str, Any]:
        return {"type": "object", "minProperties": 1, "additionalProperties": Number("number").schema()}


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


class SumLimits(Strict):
    """Limits of a sum of joint positions."""

    position: Annotated[tuple[float, float], RangeOfSum()] = Field(
        ..., description="[lower, upper]: lower ≤ L ≤ upper, hard, inelastic stops"
    )


class Sum(Strict):
    """A weighted sum L of the positions of hinges and slides, and what acts along it: a spring −stiffness × (L − rest), a
    damper −damping × L̇, dry friction, and stops. A force F along L is the effort coefficient × F on each joint."""

    joints: Annotated[dict[str, float], Coefficients()] = Field(
        ..., description="The coefficient of each joint, by its full name; not 0"
    )
    stiffness: Annotated[float, OfSum("stiffness", 0.0)] = Field(0.0, description="k ≥ 0 of the spring along the sum")
    rest: Annotated[float, OfSum("rest")] = Field(0.0, description="The sum at which the spring has no force")
    damping: Annotated[float, OfSum("damping", 0.0)] = Field(
        0.0, description="d ≥ 0 of the damper along the sum, explicit in time"
    )
    dry_friction: Annotated[float, OfSum("dry_friction", 0.0)] = Field(
        0.0, description="The largest dry force along the sum against its motion, ≥ 0"
    )
    limits: Maybe[SumLimits] = Field(ABSENT, description="Limits of the sum")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if not any(data.get(key) for key in ("stiffness", "damping", "dry_friction", "limits")):
            hint = "stiffness, damping, dry_friction, or limits: {position: [lower, upper]}"
            yield Fault((), "nothing acts along this sum", None, None, hint)
        elif data.get("rest") and not data.get("stiffness"):
            yield Fault(("rest",), "a sum without a spring has no rest", hint="give it a stiffness, or remove rest")
        limits = data.get("limits")
        ends = limits.get("position") if isinstance(limits, Mapping) else getattr(limits, "position", None)
        given: list[tuple[OfSum, Any, tuple[str | int, ...]]] = [
            (OfSum(key), data[key], (key,)) for key in ("stiffness", "rest", "damping", "dry_friction") if key in data
        ]
        given += [
            (BOUND, end, ("limits", "position", index))
            for index, end in enumerate(ends if isinstance(ends, (list, tuple)) else ())
        ]
        kinds: tuple[str, ...] = SCALAR_JOINTS
        for reader, value, place in given:
            suited = reader.kinds(value)
            if suited and not set(suited) & set(kinds):
                message = "the numbers of one sum are in units of an angle and of a length"
                yield Fault(place, message, show(value), f"in {reader.number(kinds[0]).unit()}")
                return
            kinds = tuple(kind for kind in kinds if kind in suited) or kinds


class Constraint(Strict):
    """What holds joints or bodies together outside the tree of bodies."""

    ONE_OF: ClassVar[tuple[str, ...]] = ("follow", "connect", "weld", "sum")

    follow: Maybe[Follow] = Field(ABSENT, description="A joint follows another")
    connect: Maybe[Connect] = Field(ABSENT, description="Two bodies meet at a point")
    weld: Maybe[Weld] = Field(ABSENT, description="Two bodies are held rigidly")
    sum: Maybe[Sum] = Field(
        ABSENT, description="What acts along a weighted sum of joint positions: springs, friction, stops"
    )
