"""Actuators of a model: what turns a command into the effort on one joint. A controller names those that act."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Final

from pydantic import Field

from simspec.language.joints import DIMENSION, check_suits_driven
from simspec.language.quantities import Number, Vector
from simspec.language.reader import Reader
from simspec.language.shapes import NameOf
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, fault, misspelt, show
from simspec.language.words import Word

LARGEST_GEAR: Final = 1e6
LAWS: Final[Mapping[str, tuple[str, ...]]] = {
    "position": ("kp", "kd"),
    "velocity": ("kd",),
    "effort": (),
    "affine": ("gain", "bias"),
}
"""The laws of actuators, with the numbers that each has."""
COMMANDS: Final = {"position": "position", "velocity": "velocity", "effort": "effort", "affine": ""}
"""What the command of each law is: an entry of ``joints.DIMENSION`` ("": a plain number)."""


@dataclass(frozen=True)
class OfJoint(Reader):
    """A number whose dimension follows from the joint's type, kept as written: read when the spec is resolved (:meth:`number`).
    What suits no type of joint is refused here. ``quantities``: entries of ``joints.DIMENSION``, one of which is meant."""

    quantities: tuple[str, ...]
    unit_text: str
    least: float | None = None

    def number(self, kind: str, quantity: str | None = None) -> Number:
        """The number of a joint of a type; ``quantity`` "": a plain one."""
        quantity = self.quantities[0] if quantity is None else quantity
        return Number(DIMENSION[kind][quantity] if quantity else "number", self.least)

    def read(self, value: Any) -> Any:
        refused: list[Faults] = []
        for quantity in self.quantities:
            try:
                check_suits_driven(partial(self.number, quantity=quantity), value)
            except Faults as error:
                refused.append(error)
            else:
                return value
        raise refused[0]

    def unit(self) -> str:
        return self.unit_text

    def describe(self) -> str:
        return "a number" if self.least is None else f"a number ≥ {self.least:g}"

    def schema(self) -> dict[str, Any]:
        return Number("number", self.least).schema()


@dataclass(frozen=True)
class Ends(OfJoint):
    """Two such numbers."""

    def read(self, value: Any) -> Any:
        if not isinstance(value, (list, tuple)) or len(value) != 2:
            raise fault("expected the smallest and the largest command", show(value), "[LOWER, UPPER]")
        return tuple(super(Ends, self).read(item) for item in value)

    def describe(self) -> str:
        return "two numbers"

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": Number("number").schema(), "minItems": 2, "maxItems": 2}


_COMMAND: Final = tuple(COMMANDS.values())
COMMAND: Final = OfJoint(_COMMAND, "by the law")
OF_JOINT: Final = {
    "kp": OfJoint(("stiffness",), "N m/rad or N/m", 0.0),
    "kd": OfJoint(("damping",), "N m s/rad or N s/m", 0.0),
    "effort_limit": OfJoint(("effort",), "N m or N", 0.0),
}


class Actuator(Strict):
    """What turns a command u into the effort on one joint: g clip(f), f by the law, of the actuator's position g q."""

    joint: NameOf = Field(..., description="The hinge or slide that it acts on, by its name in the model")
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
        1.0, description="g: turns of the actuator per turn of the joint; below 0 it turns against it"
    )
    effort_limit: Maybe[Annotated[Any, OF_JOINT["effort_limit"]]] = Field(
        ABSENT, description="Largest |f|; the joint's `limits.effort` also applies, to the effort on the joint"
    )
    command_limits: Maybe[Annotated[Any, Ends(_COMMAND, "by the law")]] = Field(
        ABSENT, description="Smallest and largest command"
    )
    command: Annotated[Any, COMMAND] = Field(0.0, description="The command where no controller says another")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        law = data.get("law", "position")
        if not isinstance(law, str) or law not in LAWS:
            return
        yield from cls._of_law(law, data)
        if data.get("gear") == 0:
            yield Fault(("gear",), "an actuator with a gear of 0 does nothing", "0")
        bias = data.get("bias")
        if isinstance(bias, (list, tuple)):
            for index, word in ((1, "position"), (2, "velocity")):
                value = bias[index] if len(bias) > index else None
                if isinstance(value, (int, float)) and value > 0.0:
                    message = f"an effort that grows with the {word} is unstable"
                    yield Fault(("bias", index), message, f"{value:g}", "up to 0")

    @classmethod
    def _of_law(cls, law: str, data: Mapping[str, Any]) -> Iterator[Fault]:
        for key in ("kp", "kd", "gain", "bias"):
            if key in data and key not in LAWS[law]:
                allowed = ", ".join(LAWS[law]) or "no gains"
                yield Fault((key,), f"an actuator with law {law} has no {key}", show(data[key]), allowed)
        needed = {"position": "kp", "velocity": "kd"}.get(law)
        if needed is not None and needed not in data and not misspelt(needed, data, cls.model_fields):
            yield Fault((), f"an actuator with law {law} needs {needed}", hint=f"{needed}: 10")
