"""The content of a sweep: paths, values, ranges of values, and distributions that values are drawn from."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

from pydantic import Field, ValidationError, create_model

from simspec.errors import UNSEEN_CHARACTERS
from simspec.language import quantities
from simspec.language.document import INVALID
from simspec.language.quantities import Number, Reader, Vector, Whole
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, as_faults, fault, read_each, show
from simspec.language.words import LONGEST_TEXT, Word

MOST_VALUES = 100_000
"""Values of one axis of a sweep."""
DIGITS = 12
"""Significant digits of values that a sweep works out: fewer than arithmetic has, so that all machines have the same ones."""

NOT_SWEPT = ("simspec", "name", "description", "sweep")
"""Parts of a file that no run depends on."""
SPACINGS = ("linear", "logarithmic")

_LABEL = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*(@[0-9][0-9A-Za-z.+_-]{0,39})?")
"""An engine by name, or by name and version."""


@dataclass(frozen=True)
class DottedPath(Reader):
    """A dotted path of the spec, as ``--set`` takes it."""

    WORDS = "path"
    SCHEMA: ClassVar = {"type": "string", "pattern": r"^[^.\s][^.]*(\.[^.]+)*$"}

    def read(self, value: Any) -> str:
        if not isinstance(value, str) or not value or len(value) > LONGEST_TEXT or UNSEEN_CHARACTERS.search(value):
            raise fault("expected a dotted path", show(value), "as --set takes it: physics.timestep", code="S804")
        steps = value.split(".")
        if not all(step and step == step.strip() for step in steps):
            raise fault(
                "expected a dotted path: steps with a dot between them", show(value), "physics.timestep", code="S804"
            )
        if steps[0] in NOT_SWEPT:
            raise fault("no run depends on this part of a spec, so a sweep does not change it", steps[0], code="S804")
        return value


@dataclass(frozen=True)
class EngineLabel(Reader):
    """An engine's name, or name and version."""

    WORDS = "NAME or NAME@VERSION"
    SCHEMA: ClassVar = {"type": "string", "pattern": f"^{_LABEL.pattern}$"}

    def read(self, value: Any) -> str:
        if not isinstance(value, str) or not _LABEL.fullmatch(value):
            raise fault("expected an engine", show(value), "NAME or NAME@VERSION", code="E107")
        return value


@dataclass(frozen=True)
class Plain(Reader):
    """Any value that a spec can have; its type follows from the path that it is put at."""

    WORDS = "a value"
    SCHEMA: ClassVar = {"not": {"type": "null"}}

    def read(self, value: Any) -> Any:
        if value is None:
            raise fault("null is no value", "null", code="S804")
        if faults := list(_unusable(value)):
            raise Faults(faults)
        return value


def _unusable(value: Any, loc: tuple[str | int, ...] = ()) -> Iterator[Fault]:
    """Numbers that are not finite, and what was reported already, anywhere in a value."""
    if value is INVALID:
        yield Fault(loc, "", reported=True)
    elif isinstance(value, float) and not math.isfinite(value):
        yield Fault(loc, "numbers must be finite", show(value), "a finite number", code="S203")
    elif isinstance(value, (Mapping, list, tuple)):
        items = value.items() if isinstance(value, Mapping) else enumerate(value)
        for key, item in items:
            yield from _unusable(item, (*loc, key))


@dataclass(frozen=True)
class Values(Reader):
    """A list of plain values, no two alike unless ``alike``."""

    WORDS = "a list of values"
    SCHEMA: ClassVar = {"type": "array", "items": Plain().schema(), "minItems": 1, "maxItems": MOST_VALUES}

    alike: bool = False

    def read(self, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, (list, tuple)):
            raise fault("expected a list of values", show(value), "[..., ...]", code="S804")
        if not 0 < len(value) <= MOST_VALUES:
            raise fault(
                "no values" if not value else "too many values",
                f"{len(value)} values",
                f"1 to {MOST_VALUES}",
                code="S804",
            )
        read_each(enumerate(value), Plain().read)
        first: dict[str, int] = {}
        faults = [
            Fault((index,), "this value is duplicated", f"{show(item)}, as number {before + 1}", code="S804")
            for index, item in enumerate(() if self.alike else value)
            if (before := first.setdefault(same(item), index)) != index
        ]
        if faults:
            raise Faults(faults)
        return tuple(value)


def same(value: Any) -> str:
    """A text that is equal for plain values that mean the same: 1 and 1.0, mappings in any order."""
    return json.dumps(_as_float(value), sort_keys=True, ensure_ascii=False, default=str)


def _as_float(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _as_float(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_as_float(item) for item in value]
    exact = type(value) is int and abs(value) <= 2**53
    return float(value) if exact else value


class Amount(NamedTuple):
    """A number as it was written, and its unit as text ("" for none)."""

    number: Fraction
    whole: bool
    unit: str

    def of(self, number: Fraction) -> Any:
        """Another number in this unit, as a spec would say it."""
        whole = number.denominator == 1 and (self.whole or bool(self.unit))
        value: float | int = int(number) if whole else float(number)
        return f"{value!r} {self.unit}" if self.unit else value


def amount_of(value: Any) -> Amount:
    """The amount of a number, or of a text of a number with a unit. Raises Faults."""
    if isinstance(value, str):
        try:
            number, unit = quantities.split(value)
        except quantities.UnitError as error:
            raise fault(str(error), error.found, error.allowed, error.hint, code="S201") from None
        return Amount(number, False, unit)
    read = Number().read(value)
    whole = isinstance(value, int)
    return Amount(Fraction(value if whole else repr(read)), whole, "")


@dataclass(frozen=True)
class Quantity(Reader):
    """A number, or a number with a unit, of whatever dimension: that follows from the path that it is put at. Kept as written;
    :func:`amount_of` gives its amount."""

    WORDS = "a number, with or without a unit"
    SCHEMA = Number().schema()

    def read(self, value: Any) -> Any:
        amount_of(value)
        return value


@dataclass(frozen=True)
class Quantities(Reader):
    """Two numbers in one unit, kept as written. ``rising``: the second above the first; ``positive``: both above 0; ``spread``:
    the second is."""

    SCHEMA = Vector(Number(), 2).schema()

    rising: bool = True
    positive: bool = False
    spread: bool = False

    def read(self, value: Any) -> tuple[Any, Any]:
        if not isinstance(value, (list, tuple)) or len(value) != 2:
            raise fault("expected two numbers", show(value), self.describe(), code="S804")
        first, second = read_each(enumerate(value), amount_of)
        faults = _same_unit(first, second, (1,), value[1])
        if self.rising and first.number >= second.number:
            faults.append(
                Fault((1,), "must be above the first number", show(value[1]), f"above {show(value[0])}", code="S804")
            )
        if self.positive and first.number <= 0:
            faults.append(Fault((0,), "must be above 0", show(value[0]), code="S804"))
        if self.spread and second.number <= 0:
            faults.append(Fault((1,), "must be above 0", show(value[1]), code="S804"))
        if faults:
            raise Faults(faults)
        return value[0], value[1]

    def describe(self) -> str:
        return "[mean, standard deviation]" if self.spread else "[lower, upper]"


def _same_unit(first: Amount, second: Amount, loc: tuple[str | int, ...], shown: Any) -> list[Fault]:
    if first.unit == second.unit:
        return []
    message, allowed = "both numbers must have the same unit", first.unit or "no unit"
    return [Fault(loc, message, show(shown), allowed, "write the unit with both, in the same words", code="S804")]


class _Range(Strict):
    """Base of a range of values."""

    if TYPE_CHECKING:  # `from` is read with getattr
        to: Any
        count: int
        spacing: str

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        try:
            begin, end = amount_of(data.get("from")), amount_of(data.get("to"))
        except Faults:
            return  # reported where they are read
        yield from _same_unit(begin, end, ("to",), data["to"])
        if begin.number == end.number:
            yield Fault(
                ("to",), "from and to are equal", show(data["to"]), None, "a list of one value: [...]", code="S804"
            )
        if data.get("spacing") == "logarithmic":
            for name, amount in (("from", begin), ("to", end)):
                if amount.number <= 0:
                    yield Fault((name,), "must be above 0 with logarithmic spacing", show(data[name]), code="S804")

    def values(self) -> Iterator[Any]:
        """The values, as a spec would say them, in the unit that the range is written in."""
        begin, end, last = amount_of(getattr(self, "from")), amount_of(self.to), self.count - 1
        unit = Amount(begin.number, begin.whole and end.whole, begin.unit)
        for index in range(self.count):
            if index in (0, last):
                yield unit.of((end if index else begin).number)
            elif self.spacing == "linear":
                yield unit.of(begin.number + (end.number - begin.number) * Fraction(index, last))
            else:
                ratio = math.log(end.number) - math.log(begin.number)
                yield unit.of(rounded(float(begin.number) * math.exp(ratio * index / last)))


def rounded(value: float) -> Fraction:
    """A number that was worked out, with as many digits as all machines agree on."""
    return Fraction(f"{value:.{DIGITS}g}")


_RANGE: dict[str, Any] = {
    "from": (Annotated[Any, Quantity()], Field(..., description="The first value")),
    "to": (Annotated[Any, Quantity()], Field(..., description="The last value, in the same unit")),
    "count": (Annotated[int, Whole(2, MOST_VALUES)], Field(..., description="Number of values")),
    "spacing": (
        Annotated[str, Word(SPACINGS)],
        Field("linear", description="Equal differences, or equal ratios, of neighbours"),
    ),
}
Range: type[_Range] = create_model("Range", __base__=_Range, __doc__="Values spread evenly between two.", **_RANGE)
"""The model of a range; ``from`` is a word of Python's own, so it cannot be written as a class."""


@dataclass(frozen=True)
class Axis(Reader):
    """The values of a path: a list, or a range."""

    WORDS = "a list of values, or a [Range](#range)"
    SCHEMA: ClassVar = {"anyOf": [Values().schema(), {"$ref": "#/definitions/Range"}]}

    def read(self, value: Any) -> tuple[Any, ...]:
        if isinstance(value, (list, tuple)):
            return Values().read(value)
        if not isinstance(value, Mapping):
            raise fault(
                "expected a list of values, or a range", show(value), "[..., ...] or {from, to, count}", code="S804"
            )
        try:
            return tuple(Range.model_validate(dict(value)).values())
        except ValidationError as error:
            raise as_faults(error, Range.model_fields) from None


PathOf = Annotated[str, DottedPath()]


class Distribution(Strict):
    """The distribution of the samples of a value."""

    ALTERNATIVES: ClassVar[tuple[str, ...]] = ("uniform", "normal", "log_uniform", "choice")

    uniform: Maybe[Annotated[tuple[Any, Any], Quantities()]] = Field(
        ABSENT, description="Evenly distributed between two numbers"
    )
    normal: Maybe[Annotated[tuple[Any, Any], Quantities(rising=False, spread=True)]] = Field(
        ABSENT, description="Normally distributed"
    )
    log_uniform: Maybe[Annotated[tuple[Any, Any], Quantities(positive=True)]] = Field(
        ABSENT, description="Log-uniformly distributed between two numbers above 0"
    )
    choice: Maybe[Annotated[tuple[Any, ...], Values(alike=True)]] = Field(
        ABSENT,
        description="One of a list of values, with equal probability; a repeated value counts as often as it is listed",
    )
