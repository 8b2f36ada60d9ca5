"""Joints: the dimension and the meaning of each field follow from the joint's type."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError

from simspec.language.document import mapping
from simspec.language.quantities import ByJointType, Direction, Number, Reader, Vector
from simspec.language.shapes import NameOf, Orientation, Pose
from simspec.language.strict import (
    ABSENT,
    Fault,
    Faults,
    Maybe,
    Strict,
    as_faults,
    fault,
    misspelt,
    replace_loc,
    show,
    unreported,
)
from simspec.language.vocabulary import JOINT_KINDS, SCALAR_JOINTS
from simspec.language.words import Word

DIMENSION: Mapping[str, Mapping[str, str]] = {
    "fixed": {},
    "hinge": {
        "position": "angle",
        "velocity": "angular velocity",
        "effort": "torque",
        "damping": "angular damping",
        "dry_friction": "torque",
        "armature": "moment of inertia",
        "stiffness": "angular stiffness",
        "rest": "angle",
    },
    "slide": {
        "position": "length",
        "velocity": "velocity",
        "effort": "force",
        "damping": "damping",
        "dry_friction": "force",
        "armature": "mass",
        "stiffness": "stiffness",
        "rest": "length",
    },
    "ball": {"damping": "angular damping", "armature": "moment of inertia", "stiffness": "angular stiffness"},
    "free": {"damping": "damping", "armature": "mass"},
}
"""The dimension of each plain number of a joint, by the joint's type."""

_MOTION = ("axis", "limits", "damping", "dry_friction", "armature", "spring")
_FREE = {"damping": ("damping", "angular damping"), "armature": ("mass", "moment of inertia")}
"""The numbers of a free joint that have two parts, and the dimensions of `linear` and `angular`."""
_MEANINGLESS: Mapping[str, Mapping[str, str]] = {
    "fixed": dict.fromkeys((*_MOTION, "position", "velocity"), "a fixed joint does not move"),
    "hinge": {},
    "slide": {},
    "ball": {
        "axis": "a ball joint turns about every axis",
        "dry_friction": "only for hinge and slide joints",
    },
    "free": {
        "origin": "a free body's initial pose is the body's `pose`",
        "position": "a free body's initial pose is the body's `pose`",
        "velocity": "a free body's initial velocity is the body's `velocity`",
        **dict.fromkeys(("axis", "limits", "dry_friction", "spring"), "a free body has no joint frame"),
    },
}
"""Fields that mean nothing on a type of joint, and why."""


@dataclass(frozen=True)
class JointQuantity(Reader):
    """A number whose dimension follows from the joint's type: hinge or slide, which shows when the spec is resolved
    (:meth:`number`). Kept as written; a value that suits neither type is refused here. ``quantity``: an entry of
    :data:`DIMENSION`, "" for a plain number."""

    quantity: str
    least: float | None = None
    most: float | None = None

    def number(self, kind: str) -> Number:
        """The number of a joint of a type (:data:`SCALAR_JOINTS`)."""
        return Number(DIMENSION[kind][self.quantity] if self.quantity else "number", self.least, self.most)

    def kinds(self, value: Any) -> tuple[str, ...]:
        """The types of joints whose number ``value`` may be. Raises Faults where there is
        none: those of the first type, with the units of all."""
        refused, suited = list[Faults](), list[str]()
        for kind in SCALAR_JOINTS:
            try:
                self.number(kind).read(value)
                suited.append(kind)
            except Faults as error:
                refused.append(error)
        if not suited:
            first = refused[0].faults
            either = (
                f"a number, or one with a unit: {self.unit()}" if self.quantity and isinstance(value, str) else None
            )
            raise Faults([each._replace(allowed=either or each.allowed) for each in first])
        return tuple(suited)

    def read(self, value: Any) -> Any:
        self.kinds(value)
        return value

    def unit(self) -> str:
        return " or ".join(self.number(kind).unit() for kind in SCALAR_JOINTS) if self.quantity else ""

    def describe(self) -> str:
        return "a number" if self.least is None else f"a number ≥ {self.least:g}"

    def schema(self) -> dict[str, Any]:
        return Number("number", self.least, self.most).schema()


class Limits(Strict):
    """Limits of a hinge or a slide: a hard stop, and two ratings that control and expectations obey. Of a ball: the largest
    angle."""

    position: Maybe[Annotated[Any, ByJointType("rad or m", 2)]] = Field(
        ABSENT, description="[lower, upper]: lower ≤ q ≤ upper, hard, inelastic stops"
    )
    angle: Maybe[Annotated[Any, ByJointType("rad")]] = Field(
        ABSENT,
        description="Ball: maximum angle |log R| of the rotation, at most 180 deg; a hard, inelastic stop",
    )
    velocity: Maybe[Annotated[Any, ByJointType("rad/s or m/s")]] = Field(
        ABSENT, description="Velocity rating > 0; stored in the model, not enforced by the engine"
    )
    effort: Maybe[Annotated[Any, ByJointType("N m or N")]] = Field(
        ABSENT, description="Effort rating > 0; stored in the model, not enforced by the engine"
    )


class Spring(Strict):
    """An effort −stiffness × (q − rest) at a hinge or a slide; at a ball joint a torque −stiffness × log R in the child's
    axes, log R being the rotation vector from the joint's frame to the child's."""

    stiffness: Annotated[Any, ByJointType("N m/rad or N/m")] = Field(..., description="Stiffness k ≥ 0")
    rest: Maybe[Annotated[Any, ByJointType("rad or m")]] = Field(
        ABSENT, description="The position without effort; default 0; not at a ball joint"
    )


class Joint(Strict):
    """The motion of a body relative to its parent (a root: relative to the world). The joint's frame is `origin` in
    the parent's body frame; the body's frame coincides with it when the joint is at zero.
    """

    name: Maybe[NameOf] = Field(
        ABSENT, description="Name; default `<body>_joint`, with a number appended if that name is taken"
    )
    type: Annotated[str, Word(JOINT_KINDS)] = Field(
        ...,
        description="fixed: rigid; hinge: turns about `axis`; slide: moves along `axis`; ball: turns about its origin; "
        "free: a root that moves freely",
    )
    origin: Maybe[Pose] = Field(
        ABSENT, description="Pose of the joint's frame in the parent's body frame; default: the same frame"
    )
    axis: Maybe[Annotated[tuple[float, float, float], Direction()]] = Field(
        ABSENT, description="Axis in the joint's frame, of any length but zero; required for hinge and slide"
    )
    limits: Maybe[Limits] = Field(ABSENT, description="Limits; hinge, slide and ball")
    damping: Maybe[Annotated[Any, ByJointType("N m s/rad or N s/m", parts=True)]] = Field(
        ABSENT,
        description="d ≥ 0: an effort −d × velocity, in time as `physics.damping` says; default 0; not of fixed joints; of a "
        "free joint two numbers, `{linear: ..., angular: ...}`",
    )
    dry_friction: Maybe[Annotated[Any, ByJointType("N m or N")]] = Field(
        ABSENT, description="Maximum effort of dry friction, ≥ 0; default 0; hinge and slide"
    )
    armature: Maybe[Annotated[Any, ByJointType("kg m² or kg", parts=True)]] = Field(
        ABSENT,
        description="Inertia ≥ 0 added to this joint's diagonal of the mass matrix (a geared rotor: rotor inertia × "
        "ratio²), at a ball joint to all three; default 0; not of fixed joints; of a free joint two numbers, "
        "`{linear: ..., angular: ...}`",
    )
    spring: Maybe[Spring] = Field(ABSENT, description="A spring; hinge, slide and ball")
    position: Maybe[Annotated[Any, ByJointType("rad or m", orientation=True)]] = Field(
        ABSENT,
        description="Initial position, within the limits; at a ball joint an orientation, `{rpy: ...}` or `{quat: ...}`; "
        "default 0",
    )
    velocity: Maybe[Annotated[Any, ByJointType("rad/s or m/s", orientation=True)]] = Field(
        ABSENT,
        description="Initial velocity; at a ball joint three numbers, of the child against the parent in the child's "
        "axes; default 0",
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        kind = data.get("type")
        if kind not in JOINT_KINDS:
            return
        for key, why in _MEANINGLESS[kind].items():
            if key in data:
                yield Fault((key,), f"{key} is not allowed on a {kind} joint: {why}", code="S110")
        if kind in SCALAR_JOINTS and "axis" not in data and not misspelt("axis", data, cls.model_fields):
            yield Fault((), f"a {kind} joint needs an axis", None, None, "axis: [0, 0, 1]", code="S102")

    @classmethod
    def prepare(cls, data: dict[str, Any]) -> tuple[dict[str, Any], list[Fault]]:
        kind = data.get("type")
        if kind not in JOINT_KINDS:
            return data, []
        data, faults = dict(data), []
        for key in _TYPED:
            if key not in data:
                continue
            value = data.pop(key)
            if key in _MEANINGLESS[kind]:
                continue
            if key in _NESTED:
                data[key], more = _read_nested(kind, key, value)
                faults += more
            else:
                read, more = _attempt(lambda value, key=key: _read_plain(kind, key, value), value, (key,))
                faults += more
                if not more:
                    data[key] = read
        start, limits = data.get("position"), mapping(data.get("limits"))
        if isinstance(start, (float, Orientation)):
            beyond = beyond_limits(start, limits.get("position"), limits.get("angle"))
            faults += [beyond._replace(loc=("position",))] if beyond is not None else []
        return data, faults


ROUND_OFF = 1e-7
"""rad: an angle is known from its cosine, near 0 to the root of the last bit."""
EDGE = 1e-9
"""How far an initial position may be beyond a limit, relative to the larger of the limit and 1 (rad, m): round-off of degrees,
of ratios of joints that follow others, and of files with ten digits. Such a position is taken for the limit."""
PARTS = ("linear", "angular")
OUTSIDE = "the initial position is beyond the joint's limits"
_NESTED = ("limits", "spring")
_TYPED = (*_NESTED, "damping", "dry_friction", "armature", "position", "velocity")


def angle_of(turn: Orientation) -> float:
    """The angle (rad, 0 to π) of a rotation."""
    w, length = 1.0, 1.0
    if turn.quat is not None:
        w, length = turn.quat[0], math.hypot(*turn.quat)
    elif turn.rpy is not None:
        sines, cosines = ([function(angle / 2.0) for angle in turn.rpy] for function in (math.sin, math.cos))
        w = math.prod(cosines) + math.prod(sines)
    return 2.0 * math.acos(min(1.0, abs(w) / length))


def beyond_cone(turn: Orientation, largest: float) -> bool:
    """Whether a rotation is by more than the largest angle (rad) of a ball joint, up to round-off of the angle."""
    return angle_of(turn) > largest + ROUND_OFF


def scaled_to(turn: Sequence[float], largest: float) -> tuple[float, float, float, float]:
    """The rotation about the axis of ``turn`` (a quaternion w x y z of any length) by ``largest`` (rad)."""
    w, *vector = turn
    sine = math.hypot(*vector)
    share = math.copysign(math.sin(largest / 2.0), w) / sine
    return (math.cos(largest / 2.0), *(share * value for value in vector))  # type: ignore[return-value]


def quaternion_of(turn: Orientation) -> tuple[float, float, float, float]:
    """A rotation as a quaternion w x y z, of the length that is written; not for what enters files (`world.frames`)."""
    if turn.quat is not None:
        return turn.quat
    (a, b, c), (x, y, z) = (
        [function(angle / 2.0) for angle in turn.rpy or (0.0,) * 3] for function in (math.cos, math.sin)
    )
    return (a * b * c + x * y * z, x * b * c - a * y * z, a * y * c + x * b * z, a * b * z - x * y * c)


def nearest(position: float, limits: Sequence[float]) -> float:
    """The position within limits that is nearest to one of a hinge or slide."""
    return min(max(position, limits[0]), limits[1])


def within(position: float, limits: Sequence[float]) -> float | None:
    """An initial position of a hinge or slide: the limit where it is beyond it by round-off, None where by more."""
    allowed = nearest(position, limits)
    return allowed if abs(position - allowed) <= EDGE * max(1.0, abs(allowed)) else None


def beyond_limits(start: float | Orientation, limits: Sequence[float] | None, largest: float | None) -> Fault | None:
    """The fault of an initial position beyond the ``limits`` of a hinge or slide, or of the initial orientation of a ball joint
    by more than its ``largest`` angle (rad); None where there is none."""
    if isinstance(start, Orientation):
        if largest is None or not beyond_cone(start, largest):
            return None
        shown = ", ".join(f"{value:.9g}" for value in scaled_to(quaternion_of(start), largest))
        found, allowed, suggested = f"{angle_of(start):g}", f"0 to {largest:g}", f"{{quat: [{shown}]}}"
    else:
        if limits is None or within(start, limits) is not None:
            return None
        found, allowed, suggested = f"{start:g}", f"{limits[0]:g} to {limits[1]:g}", f"{nearest(start, limits)!r}"
    return Fault((), OUTSIDE, found, allowed, f"{suggested}, the nearest allowed value", code="S501")


def read_position(kind: str, value: Any) -> Any:
    """An initial position as the joint's type wants it: a float, or an Orientation for a ball joint. Raises Faults."""
    if kind != "ball":
        return Number(DIMENSION[kind]["position"]).read(value)
    if not isinstance(value, (dict, Orientation)):
        raise fault(
            "a ball joint's position is an orientation", show(value), "{rpy: [...]} or {quat: [...]}", code="S507"
        )
    try:
        return Orientation.model_validate(value)
    except ValidationError as error:
        raise as_faults(error, Orientation.model_fields) from None


def read_velocity(kind: str, value: Any) -> Any:
    """An initial velocity as the joint's type wants it: a float, or three for a ball joint. Raises Faults."""
    if kind == "ball":
        return Vector(Number("angular velocity")).read(value)
    return Number(DIMENSION[kind]["velocity"]).read(value)


def _attempt(reader: Any, value: Any, loc: tuple[str | int, ...]) -> tuple[Any, list[Fault]]:
    try:
        return reader(unreported(value)), []
    except Faults as error:
        return None, replace_loc(error.faults, loc)


def _read_plain(kind: str, key: str, value: Any) -> Any:
    if kind == "free" and key in _FREE:
        return _read_free(key, value)
    if key == "velocity":
        return read_velocity(kind, value)
    if key == "position":
        return read_position(kind, value)
    return Number(DIMENSION[kind][key], 0).read(value)


def _read_free(key: str, value: Any) -> tuple[float, float]:
    """Damping or armature of a free joint: of translation, and of rotation. Raises Faults."""
    if isinstance(value, tuple):
        return value
    if not isinstance(value, dict):
        raise fault(f"{key} of a free joint has two parts", show(value), "{linear: ..., angular: ...}", code="S507")
    faults = [
        Fault((str(name),), f"{key} of a free joint has no {name}", None, "linear, angular", code="S507")
        for name in value
        if name not in PARTS
    ]
    numbers = []
    for part, dimension in zip(PARTS, _FREE[key], strict=True):
        read, more = _attempt(Number(dimension, 0).read, value.get(part, 0.0), (part,))
        faults += more
        numbers.append(read)
    if faults:
        raise Faults(faults)
    return numbers[0], numbers[1]


def _read_nested(kind: str, key: str, value: Any) -> tuple[Any, list[Fault]]:
    """`limits` or `spring` with its numbers read; a number that could not be read is left out, or 0 where it is required."""
    if isinstance(value, BaseModel):
        value = value.model_dump(exclude_unset=True)
    if not isinstance(value, dict):
        return value, []
    dimension, data = DIMENSION[kind], dict(value)
    faults: list[Fault] = []
    readers: dict[str, Reader] = (
        {"stiffness": Number(dimension["stiffness"], 0), "rest": Number(dimension.get("rest", "angle"))}
        if key == "spring"
        else {
            "position": Vector(Number(dimension.get("position", "angle")), 2),
            "angle": Number("angle", 0, math.pi, above=True),
            "velocity": Number(dimension.get("velocity", "velocity"), 0, above=True),
            "effort": Number(dimension.get("effort", "torque"), 0, above=True),
        }
    )
    if key == "spring" and kind == "ball" and "rest" in data:
        faults.append(
            Fault(
                (key, "rest"), "the spring of a ball joint has its rest position at zero", hint="remove it", code="S110"
            )
        )
        del data["rest"]
    for name, reader in readers.items():
        if name not in data:
            continue
        if key == "limits" and (name == "angle") != (kind == "ball"):
            text = "limits: {angle: 60 deg}" if kind == "ball" else "limits: {position: [lower, upper]}"
            faults.append(
                Fault((key, name), f"the limits of a {kind} joint have no {name}", None, None, text, code="S110")
            )
            del data[name]
            continue
        item = data.pop(name)
        read, more = _attempt(reader.read, item, (key, name))
        faults += more
        if read is not None:
            data[name] = read
        elif name == "stiffness":
            data[name] = 0.0
        if (key, name) == ("limits", "position") and read is not None and read[0] > read[1]:
            shown, turned = f"{show(item[0])} > {show(item[1])}", f"[{show(item[1])}, {show(item[0])}]"
            faults.append(
                Fault((key, name), "the lower limit is above the upper", shown, "[lower, upper]", turned, code="S205")
            )
            del data[name]
    return data, faults
