"""Control: which joints are driven, by which law, with which gains and limits. The laws stand in ``world/actions.py``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final

from pydantic import Field

from simspec.language.arrays import PATTERN, JointNames, NamePattern, read_pattern, too_many
from simspec.language.document import listed
from simspec.language.joints import JointQuantity
from simspec.language.quantities import Number, Reader, Vector, article
from simspec.language.shapes import NameOf
from simspec.language.strict import (
    ABSENT,
    Fault,
    Faults,
    Maybe,
    Strict,
    fault,
    misspelt,
    read_entries,
    replace_loc,
    show,
)
from simspec.language.vocabulary import ACTUATORS, CONTROL_LAWS, DISCRETISATIONS
from simspec.language.words import Flag, Word

LARGEST_GEAR: Final = 1e6
"""A ratio beyond this (or below its inverse) is no gear; its square would overflow the numbers of engines."""
LAWS: Final[Mapping[str, tuple[str, ...]]] = {
    "position": ("kp", "kd"),
    "velocity": ("kd",),
    "effort": (),
    "affine": ("gain", "bias"),
}
"""The laws of actuators, with the numbers that each has."""
COMMANDS: Final = {"position": "position", "velocity": "velocity", "effort": "effort", "affine": ""}
"""The quantity of the command of each law: an entry of ``joints.DIMENSION`` ("": a plain number)."""


@dataclass(frozen=True)
class Command(Reader):
    """A command, whose meaning and so dimension follow from the actuator's law and the joint's type (:meth:`number`); kept as
    written."""

    UNIT = "by the law"
    WORDS = "a number"
    SCHEMA = Number("number").schema()

    def number(self, kind: str, quantity: str) -> Number:
        """The number of a joint of a type. ``quantity``: a value of :data:`COMMANDS`."""
        return JointQuantity(quantity).number(kind)

    def read(self, value: Any) -> Any:
        refused: list[Faults] = []
        for quantity in COMMANDS.values():
            try:
                return JointQuantity(quantity).read(value)
            except Faults as error:
                refused.append(error)
        raise refused[0]


@dataclass(frozen=True)
class CommandLimits(Reader):
    """The smallest and the largest command."""

    UNIT = "by the law"
    WORDS = "two numbers"
    SCHEMA: ClassVar = {"type": "array", "items": Number("number").schema(), "minItems": 2, "maxItems": 2}

    def read(self, value: Any) -> Any:
        if not isinstance(value, (list, tuple)) or len(value) != 2:
            raise fault("expected the smallest and the largest command", show(value), "[LOWER, UPPER]", code="S104")
        return tuple(map(COMMAND.read, value))


COMMAND: Final = Command()
OF_JOINT: Final = {
    "kp": JointQuantity("stiffness", 0.0),
    "kd": JointQuantity("damping", 0.0),
    "effort_limit": JointQuantity("effort", 0.0),
}


class Actuator(Strict):
    """An actuator, which turns a command u into the effort on a joint: g clip(f), f by the law, of the actuator's position g
    q."""

    joint: NameOf = Field(..., description="Hinge or slide on which the actuator acts, by its name in the model")
    law: Annotated[str, Word(tuple(LAWS))] = Field(
        "position",
        description="position: f = kp (u − g q) − kd g v; velocity: f = kd (u − g v); effort: f = u; affine: f = gain u + "
        "bias₀ + bias₁ g q + bias₂ g v",
    )
    kp: Annotated[Any, OF_JOINT["kp"]] = Field(None, description="Effort per error of position; position, required")
    kd: Annotated[Any, OF_JOINT["kd"]] = Field(
        None, description="Effort per velocity; position (default 0), velocity (required)"
    )
    gain: Maybe[Annotated[float, Number("number")]] = Field(ABSENT, description="Effort per command; affine, default 1")
    bias: Maybe[Annotated[tuple[float, float, float], Vector(Number("number"))]] = Field(
        ABSENT,
        description="Effort without a command, per position and per velocity; the last two are not above 0; affine",
    )
    gear: Annotated[float, Number("number", -LARGEST_GEAR, LARGEST_GEAR)] = Field(
        1.0, description="g: turns of the actuator per turn of the joint; negative: in opposite directions"
    )
    effort_limit: Maybe[Annotated[Any, OF_JOINT["effort_limit"]]] = Field(
        ABSENT, description="Largest |f|; the joint's `limits.effort` also applies, to the effort on the joint"
    )
    command_limits: Maybe[Annotated[Any, CommandLimits()]] = Field(ABSENT, description="Smallest and largest command")
    command: Annotated[Any, COMMAND] = Field(0.0, description="Command, unless a controller gives another")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        law = data.get("law", "position")
        if not isinstance(law, str) or law not in LAWS:
            return
        yield from cls._of_law(law, data)
        if data.get("gear") == 0:
            yield Fault(("gear",), "an actuator with a gear of 0 does nothing", "0", code="S716")
        for index, value in enumerate(listed(data.get("bias"))[:3]):
            if index and isinstance(value, (int, float)) and value > 0.0:
                message = f"an effort that grows with the {('position', 'velocity')[index - 1]} is unstable"
                yield Fault(("bias", index), message, f"{value:g}", "up to 0", code="S716")

    @classmethod
    def _of_law(cls, law: str, data: Mapping[str, Any]) -> Iterator[Fault]:
        for key in ("kp", "kd", "gain", "bias"):
            if key in data and key not in LAWS[law]:
                allowed = ", ".join(LAWS[law]) or "no gains"
                yield Fault((key,), f"an actuator with law {law} has no {key}", show(data[key]), allowed, code="S110")
        needed = {"position": "kp", "velocity": "kd"}.get(law)
        if needed is not None and needed not in data and not misspelt(needed, data, cls.model_fields):
            yield Fault((), f"an actuator with law {law} needs {needed}", hint=f"{needed}: 10", code="S102")


MOST_CONTROLLERS = 100

_ACTUATOR_GAINS: Mapping[str, Mapping[str, str]] = {
    "position": {"kp": "N m/rad", "kd": "N m s/rad"},
    "velocity": {"kd": "N m s/rad"},
    "effort": {},
}
"""The gains that an actuator needs, with the unit at a hinge; it has no others."""
_NOT_OF_LAW: Mapping[str, Mapping[str, str]] = {
    "pd": dict.fromkeys(("natural_frequency", "damping_ratio"), "only for law: computed-torque; pd uses kp and kd"),
    "computed-torque": {
        **dict.fromkeys(("kp", "kd"), "computed torque uses natural_frequency and damping_ratio"),
        "actuator": "the law computes the efforts",
        "gravity_compensation": "computed torque always compensates gravity",
    },
    "native": {
        **dict.fromkeys(("natural_frequency", "damping_ratio"), "only for law: computed-torque"),
        "discretisation": "the engine chooses how its own controller is discretised",
        "gravity_compensation": "only for law: pd",
        "every": "the engine's own controller acts in every step",
    },
}
"""Fields that mean nothing under a law, and why."""


@dataclass(frozen=True)
class PerJoint(JointQuantity):
    """One such number for all joints of a controller, or a mapping of numbers by name or pattern."""

    least: float | None = 0.0

    def read(self, value: Any) -> Any:
        if not isinstance(value, Mapping):
            return super().read(value)
        if not value:
            raise fault("no joint given", "{}", "a number, or {JOINT: number, ...}", code="S113")
        if (many := too_many(value)) is not None:
            raise many
        return read_entries(value, read_pattern, super().read)

    def describe(self) -> str:
        return f"{Number('number', self.least, self.most).describe()}, or numbers by joint"

    def schema(self) -> dict[str, Any]:
        number = super().schema()
        by_joint = {
            "type": "object",
            "propertyNames": {"pattern": f"^{PATTERN.pattern}$"},
            "additionalProperties": number,
            "minProperties": 1,
        }
        return {"anyOf": [number, by_joint]}


PER_JOINT: Mapping[str, PerJoint] = {
    "kp": PerJoint("stiffness"),
    "kd": PerJoint("damping"),
    "effort_limit": PerJoint("effort"),
    "velocity_limit": PerJoint("velocity"),
    "gear": PerJoint("", 1.0 / LARGEST_GEAR, LARGEST_GEAR),
    "rotor_inertia": PerJoint("armature"),
}
"""The fields of a controller that are given by joint."""


class Controller(Strict):
    """A controller, which drives joints along the trajectory. A joint has at most one controller."""

    law: Annotated[str, Word(CONTROL_LAWS)] = Field("pd", description="The control law, see above")
    joints: Maybe[Annotated[tuple[str, ...], JointNames()]] = Field(
        ABSENT, description="Hinges and slides that the controller drives; every entry matches at least one"
    )
    actuators: Maybe[Annotated[tuple[str, ...], JointNames("actuator")]] = Field(
        ABSENT, description="Instead of `joints`: the models' actuators that act, by full names (MODEL/ACTUATOR)"
    )
    commands: dict[Annotated[str, NamePattern("actuator", path=True)], Annotated[Any, COMMAND]] = Field(
        {}, description="Commands of the actuators by full names, in place of their `command`; `*` matches any text"
    )
    discretisation: Annotated[str, Word(DISCRETISATIONS)] = Field(
        "explicit", description="explicit: the law at the beginning of a step; implicit: at its end; not with `native`"
    )
    natural_frequency: Maybe[Annotated[float, Number("angular velocity", 0, above=True)]] = Field(
        ABSENT, description="ω: natural frequency of the error; computed-torque, required"
    )
    damping_ratio: Annotated[float, Number("number", 0)] = Field(
        1.0, description="ζ: 1: critically damped; computed-torque"
    )
    every: Maybe[Annotated[float, Number("time", 0, above=True)]] = Field(
        ABSENT,
        description="Sampling period of the controller, during which its efforts are constant; a whole number "
        "of timesteps; default: one step; not with `native`",
    )
    actuator: Annotated[str, Word(ACTUATORS)] = Field(
        "position",
        description="position: kp and kd; velocity: kd alone; effort: neither, the trajectory's efforts alone (law pd); "
        "pd and native",
    )
    kp: Annotated[Any, PER_JOINT["kp"]] = Field(None, description="Effort per error of position; pd and native")
    kd: Annotated[Any, PER_JOINT["kd"]] = Field(None, description="Effort per error of velocity; pd and native")
    gravity_compensation: Annotated[bool, Flag()] = Field(
        False, description="Whether to add the effort that balances gravity at rest; pd"
    )
    effort_limit: Maybe[Annotated[Any, PER_JOINT["effort_limit"]]] = Field(
        ABSENT, description="The largest effort of the actuator; the joint's `limits.effort` also applies"
    )
    velocity_limit: Maybe[Annotated[Any, PER_JOINT["velocity_limit"]]] = Field(
        ABSENT,
        description="The largest speed of the actuator, which the trajectory must not exceed; the joint's "
        "`limits.velocity` also applies",
    )
    gear: Maybe[Annotated[Any, PER_JOINT["gear"]]] = Field(
        ABSENT,
        description="g: turns of the actuator per turn of the joint; kp, kd, limits and rotor inertia are the "
        "actuator's; default 1",
    )
    rotor_inertia: Maybe[Annotated[Any, PER_JOINT["rotor_inertia"]]] = Field(
        ABSENT, description="Inertia of the actuator's rotor; g² times as much is added to the joint's `armature`"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "actuators" in data:
            yield from cls._of_actuators(data)
            return
        if "joints" not in data and not misspelt("joints", data, cls.model_fields):
            yield Fault(
                ("joints",),
                "joints is missing",
                None,
                "a list of joints' full names, or actuators: [...] of a model",
                code="S102",
            )
        if "commands" in data:
            yield Fault(
                ("commands",),
                "commands are of actuators, and this controller has none",
                hint="actuators: [...]",
                code="S110",
            )
        law, actuator = data.get("law", "pd"), data.get("actuator", "position")
        if not isinstance(law, str) or law not in CONTROL_LAWS:
            return
        for key, why in _NOT_OF_LAW[law].items():
            if key in data:
                yield Fault(
                    (key,),
                    f"{key} is not allowed with law {law}: {why}",
                    show(data[key]),
                    None,
                    "remove it",
                    code="S110",
                )
        if law == "computed-torque":
            if cls._lacks("natural_frequency", data):
                hint = "natural_frequency: 30 rad/s"
                yield Fault((), "law computed-torque needs a natural_frequency", None, None, hint, code="S102")
        elif isinstance(actuator, str) and actuator in ACTUATORS:
            yield from cls._gains(law, actuator, data)

    @classmethod
    def _of_actuators(cls, data: Mapping[str, Any]) -> Iterator[Fault]:
        commands = data.get("commands")
        if isinstance(commands, Mapping) and (many := too_many(commands)) is not None:
            yield from replace_loc(many.faults, ("commands",))
        for key in cls.model_fields:
            if key in data and key not in ("actuators", "commands", "discretisation", "every"):
                why = "one or the other" if key == "joints" else "the actuators say it"
                yield Fault(
                    (key,),
                    f"{key} is not allowed with actuators: {why}",
                    show(data[key]),
                    None,
                    "remove it",
                    code="S110",
                )

    @classmethod
    def _gains(cls, law: str, actuator: str, data: Mapping[str, Any]) -> Iterator[Fault]:
        needed = _ACTUATOR_GAINS[actuator]
        if law == "native" and actuator == "effort":
            allowed = "position, velocity"
            hint = "law: pd applies efforts in every engine"
            yield Fault(
                ("actuator",), "law native does not support an effort actuator", actuator, allowed, hint, code="S703"
            )
        for key, unit in needed.items():
            if cls._lacks(key, data):
                others = " and ".join(needed)
                message = f"{article(actuator)} actuator needs {others}; {key} is missing"
                yield Fault((), message, hint=f"{key}: 10 {unit}", code="S703")
        for key in ("kp", "kd"):
            if key in data and key not in needed:
                allowed = ", ".join(needed) or "neither kp nor kd"
                yield Fault((key,), f"{article(actuator)} actuator has no {key}", show(data[key]), allowed, code="S110")

    @classmethod
    def _lacks(cls, key: str, data: Mapping[str, Any]) -> bool:
        return key not in data and not misspelt(key, data, cls.model_fields)
