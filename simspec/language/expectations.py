"""Expectations of a scenario about its runs: the kinds, the parameters of each, and their meaning. The runner measures them
(``runner/expectations.py``)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field, create_model
from pydantic_core import core_schema

from simspec.language.quantities import Number, Reader, Vector
from simspec.language.strict import ABSENT, Fault, Faults, Strict, fault, read_entries, show
from simspec.language.words import NAME, Name


@dataclass(frozen=True)
class Parameter:
    """A parameter: its type (with dimension and bounds), whether it must be given, and its meaning."""

    reader: Reader
    meaning: str
    required: bool = True


@dataclass(frozen=True)
class ExpectationKind:
    """A kind of expectation: its requirement, its parameters, and parameters of which exactly one must be given.

    ``of_end`` says whether a run that is cut short cannot answer it: it looks at the end of the run ("always"), or does so
    where a parameter of this name is not given; "" what must hold at all times must hold in every part of them.
    """

    meaning: str
    parameters: Mapping[str, Parameter]
    alternatives: tuple[str, ...] = ()
    of_end: str = ""


@dataclass(frozen=True)
class Targets(Reader):
    """Places of bodies, by their full names; read as pairs (body, place) sorted by body."""

    UNIT = "m"
    WORDS = "places by the bodies' full names"
    SCHEMA: ClassVar = {
        "type": "object",
        "propertyNames": {"pattern": f"^{NAME.pattern}(/{NAME.pattern})?$"},
        "additionalProperties": Vector(Number("length")).schema(),
        "minProperties": 1,
    }

    def read(self, value: Any) -> tuple[tuple[str, tuple[float, ...]], ...]:
        if not isinstance(value, Mapping) or not value:
            found = "{}" if isinstance(value, Mapping) else show(value)
            raise fault(f"expected {self.describe()}", found, "{BODY: [x, y, z], ...}", code="S104")
        return tuple(sorted(read_entries(value, Name(path=True).read, _POINT.read).items()))

    def written(self, value: tuple[tuple[str, tuple[float, ...]], ...] | None) -> Any:
        return value and {name: list(place) for name, place in value}

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        # an expectation that was made in Python is written as a spec would say it
        written = core_schema.plain_serializer_function_ser_schema(self.written)
        return core_schema.no_info_plain_validator_function(self._validate, serialization=written)


_SHARE = Number("number", 0)
_LENGTH = Number("length", 0)
_TIME = Number("time", 0)
_BODY = Parameter(Name(path=True), "Full name of a body")
_SINGLE = Parameter(
    _LENGTH, "Replaces `tolerance` in engines that compute in single precision; default: `tolerance`", required=False
)
_AT = Parameter(_TIME, "A recorded time; default: the end", required=False)
_POINT = Vector(Number("length"))

KINDS: Mapping[str, ExpectationKind] = {
    "energy_never_rises": ExpectationKind(
        "The total energy is never above its lowest value before",
        {"tolerance": Parameter(_SHARE, "Largest rise, as a share of the run's energy scale")},
    ),
    "energy_conserved": ExpectationKind(
        "The total energy remains at its initial value",
        {"tolerance": Parameter(_SHARE, "Largest deviation, as a share of the run's energy scale")},
    ),
    "momentum_conserved": ExpectationKind(
        "Linear momentum and angular momentum about the world's origin remain constant; requires zero gravity",
        {"tolerance": Parameter(_SHARE, "Largest deviation of each momentum, as a fraction of its scale")},
    ),
    "no_penetration_deeper_than": ExpectationKind(
        "Contact depth never exceeds a bound", {"depth": Parameter(_LENGTH, "Largest depth of a contact")}
    ),
    "comes_to_rest": ExpectationKind(
        "All centres of mass are slow at the end",
        {
            "speed": Parameter(Number("velocity", 0), "Largest speed of a centre of mass"),
            "before": Parameter(_TIME, "Must hold from this time on; default: at the end", required=False),
        },
        of_end="before",
    ),
    "follows_oracle": ExpectationKind(
        "Body frames follow the motion without contact that an independent implementation computes with the same "
        "integrator and timestep",
        {
            "tolerance": Parameter(_LENGTH, "Largest distance of a body frame's origin"),
            "tolerance_single": _SINGLE,
            "until": Parameter(_TIME, "Time up to which this must hold; default: the end", required=False),
        },
    ),
    "position": ExpectationKind(
        "A body's frame is at a position",
        {
            "body": _BODY,
            "xyz": Parameter(_POINT, "Place of the frame's origin in the world"),
            "tolerance": Parameter(_LENGTH, "Largest distance from the position"),
            "tolerance_single": _SINGLE,
            "at": _AT,
        },
        of_end="at",
    ),
    "at_target": ExpectationKind(
        "All given bodies' frames are at their positions",
        {
            "targets": Parameter(Targets(), "Places of the frames' origins in the world"),
            "tolerance": Parameter(_LENGTH, "Largest distance of any body from its target"),
            "tolerance_single": _SINGLE,
            "at": _AT,
        },
        of_end="at",
    ),
    "displacement": ExpectationKind(
        "A body's frame has moved by a vector, or by a distance in any direction",
        {
            "body": _BODY,
            "xyz": Parameter(_POINT, "The displacement, in world axes", required=False),
            "distance": Parameter(_LENGTH, "The length of the displacement", required=False),
            "tolerance": Parameter(_LENGTH, "Largest deviation"),
            "tolerance_single": _SINGLE,
            "at": _AT,
        },
        alternatives=("xyz", "distance"),
        of_end="at",
    ),
    "apex_height": ExpectationKind(
        "Greatest height z of a body's frame after a time; not measured if the frame still rises at the end of the run",
        {
            "body": _BODY,
            "height": Parameter(Number("length"), "The height"),
            "tolerance": Parameter(_LENGTH, "Largest deviation"),
            "tolerance_single": _SINGLE,
            "after": Parameter(_TIME, "The time from which on the apex is sought"),
        },
        of_end="always",
    ),
    "angular_speed": ExpectationKind(
        "A body turns at a speed, about any axis",
        {
            "body": _BODY,
            "speed": Parameter(Number("angular velocity", 0), "The magnitude of the angular velocity"),
            "tolerance": Parameter(Number("angular velocity", 0), "Largest deviation"),
            "at": _AT,
        },
        of_end="at",
    ),
    "stays_within": ExpectationKind(
        "A body's frame never leaves a box",
        {
            "body": _BODY,
            "lower": Parameter(_POINT, "Corner of the smallest coordinates, in the world"),
            "upper": Parameter(_POINT, "Corner of the largest coordinates"),
        },
    ),
    "keeps_place": ExpectationKind(
        "A body's frame keeps its position in another body's frame, as for a held object that does not slip",
        {
            "body": _BODY,
            "within": Parameter(Name(path=True), "Full name of the other body"),
            "after": Parameter(_TIME, "Time of the reference position"),
            "until": Parameter(_TIME, "Time up to which this must hold; default: the end", required=False),
            "distance": Parameter(_LENGTH, "Largest distance from the reference position"),
        },
    ),
    "bodies_apart": ExpectationKind(
        "The origins of two bodies' frames never come closer than a distance",
        {
            "first": _BODY,
            "second": Parameter(Name(path=True), "Full name of another body"),
            "at_least": Parameter(_LENGTH, "Smallest distance"),
        },
    ),
}
"""Every kind of expectation."""

BODIES = ("body", "first", "second", "within")
"""Parameters that name a body."""
TIMES = ("at", "before", "until", "after")
"""Parameters that are times of the run."""


class _Parameters(Strict):
    """Base of the parameters of one kind."""

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "lower" in data and "upper" in data:
            try:
                lower, upper = _POINT.read(data["lower"]), _POINT.read(data["upper"])
            except Faults:
                return  # reported where they are read
            for index, (low, high) in enumerate(zip(lower, upper, strict=True)):
                if low > high:
                    yield Fault(("lower", index), "lower is above upper", f"{low:g} > {high:g}", code="S205")
        if "first" in data and data["first"] == data.get("second"):
            yield Fault(("second",), "first and second are the same body", show(data["second"]), code="S502")


def _model(name: str, kind: ExpectationKind) -> type[Strict]:
    fields: dict[str, Any] = {
        key: (
            Annotated[Any, parameter.reader],
            Field(... if parameter.required else None, description=parameter.meaning),
        )
        for key, parameter in kind.parameters.items()
    }
    title = "".join(part.capitalize() for part in name.split("_"))
    model = create_model(title, __base__=_Parameters, __doc__=kind.meaning, **fields)
    model.ALTERNATIVES = kind.alternatives
    return model


class _AnyExpectation(Strict):
    """Base of an entry of ``expect``."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = tuple(KINDS)


_KINDS: dict[str, Any] = {
    name: (_model(name, kind), Field(ABSENT, description=kind.meaning)) for name, kind in KINDS.items()
}
Expectation: type[Strict] = create_model(
    "Expectation",
    __base__=_AnyExpectation,
    __doc__="One expectation: its kind, with its parameters.",
    **_KINDS,
)
"""The model of an entry of ``expect``: exactly one kind."""
