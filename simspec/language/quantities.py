"""Values with units, and the types that fields have: numbers with a dimension and bounds, and vectors (names and words:
``words.py``)."""

from __future__ import annotations

import difflib
import functools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from pydantic import GetJsonSchemaHandler
from pydantic_core import core_schema

from simspec.language.strict import Faults, fault, raised, read_each, show, unreported

# Values with units are turned into SI doubles: exact arithmetic, one rounding at the end. A quantity is a decimal number and a
# unit expression (``5 mm``, ``7.85 g/cm^3``, ``2 N*m*s/rad``). The number and the
# unit's factor are exact fractions, so that ``5 mm`` is the double 0.005 and ``1 ms`` the double 0.001; only π is the
# double ``math.pi``, so that ``30 deg`` is ``math.pi / 6``. Angles are a dimension of their own here: ``1 %`` is no angle.

Exponents = tuple[int, int, int, int]
"""Powers of metre, kilogram, second, radian."""

LARGEST = 1e30
"""Larger magnitudes are refused: no scenario means them, and their squares would leave the range of a double."""
SMALLEST = 1e-30
"""Smaller sizes, masses and densities are refused, 0 aside: volumes and moments of them would round to zero."""

_BASE = ("metre", "kilogram", "second", "radian")
_LENGTH, _MASS, _TIME, _ANGLE, _FORCE = (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (1, 1, -2, 0)
_PI, _POUND, _GRAVITY = Fraction(math.pi), Fraction("0.45359237"), Fraction("9.80665")
_DEFINITIONS: tuple[tuple[str, Fraction | str, Exponents], ...] = (
    ("metre m meter metres meters", "1", _LENGTH),
    ("kilogram kg kilograms", "1", _MASS),
    ("second s sec seconds", "1", _TIME),
    ("radian rad radians", "1", _ANGLE),
    ("gram g grams", "1/1000", _MASS),
    ("tonne t tonnes", "1000", _MASS),
    ("minute min minutes", "60", _TIME),
    ("hour h hours", "3600", _TIME),
    ("degree deg degrees", _PI / 180, _ANGLE),
    ("revolution rev revolutions turn", 2 * _PI, _ANGLE),
    ("rpm", 2 * _PI / 60, (0, 0, -1, 1)),
    ("hertz Hz", "1", (0, 0, -1, 0)),
    ("newton N newtons", "1", _FORCE),
    ("joule J joules", "1", (2, 1, -2, 0)),
    ("watt W watts", "1", (2, 1, -3, 0)),
    ("pascal Pa pascals", "1", (-1, 1, -2, 0)),
    ("litre l liter L litres", "1/1000", (3, 0, 0, 0)),
    ("inch in inches", "0.0254", _LENGTH),
    ("foot ft feet", "0.3048", _LENGTH),
    ("yard yd", "0.9144", _LENGTH),
    ("pound lb pounds", _POUND, _MASS),
    ("ounce oz", _POUND / 16, _MASS),
    ("pound_force lbf", _POUND * _GRAVITY, _FORCE),
    ("kilogram_force kgf", _GRAVITY, _FORCE),
    ("percent", "1/100", (0, 0, 0, 0)),
)
"""Every unit: its names, its factor to SI and its powers of the base units; exact definitions (SI, and the international
yard and pound)."""
_UNITS = {name: (Fraction(factor), powers) for names, factor, powers in _DEFINITIONS for name in names.split()}
LONGEST_SYMBOL = 3
"""Letters of a unit's symbol (kg, lb, deg), which has no plural; names have more."""
_PREFIXES = {
    **{"": 0, "yocto": -24, "y": -24, "nano": -9, "n": -9, "micro": -6, "u": -6, "milli": -3, "m": -3},
    **{"centi": -2, "c": -2, "deci": -1, "d": -1, "hecto": 2, "h": 2, "kilo": 3, "k": 3, "mega": 6, "M": 6},
    **{"giga": 9, "G": 9},
}
"""Prefixes of units, as powers of 10."""


@dataclass(frozen=True)
class Dimension:
    """A physical dimension: its name, its SI unit as text, and the powers of the base units that are accepted (a
    rotational stiffness may be written in N m/rad or in N m)."""

    name: str
    unit: str
    accepted: tuple[Exponents, ...]


def _dimensions() -> Mapping[str, Dimension]:
    torque = (2, 1, -2, 0)
    table: list[tuple[str, str, tuple[Exponents, ...]]] = [
        ("number", "1", ((0, 0, 0, 0),)),
        ("length", "m", ((1, 0, 0, 0),)),
        ("mass", "kg", ((0, 1, 0, 0),)),
        ("time", "s", ((0, 0, 1, 0),)),
        ("angle", "rad", ((0, 0, 0, 1),)),
        ("velocity", "m/s", ((1, 0, -1, 0),)),
        ("angular velocity", "rad/s", ((0, 0, -1, 1),)),
        ("acceleration", "m/s²", ((1, 0, -2, 0),)),
        ("density", "kg/m³", ((-3, 1, 0, 0),)),
        ("viscosity", "Pa s", ((-1, 1, -1, 0),)),
        ("moment of inertia", "kg m²", ((2, 1, 0, 0), (2, 1, 0, -2))),
        ("force", "N", ((1, 1, -2, 0),)),
        ("torque", "N m", (torque, (2, 1, -2, -1))),
        ("damping", "N s/m", ((0, 1, -1, 0),)),
        ("angular damping", "N m s/rad", ((2, 1, -1, -1), (2, 1, -1, 0), (2, 1, -1, -2))),
        ("stiffness", "N/m", ((0, 1, -2, 0),)),
        ("angular stiffness", "N m/rad", ((2, 1, -2, -1), torque, (2, 1, -2, -2))),
    ]
    return {name: Dimension(name, unit, accepted) for name, unit, accepted in table}


DIMENSIONS: Mapping[str, Dimension] = _dimensions()

_QUANTITY = re.compile(
    r"[ \t\r\n\f\v]*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,3})?)(?:\s*(\S(?:.*\S)?))?[ \t\r\n\f\v]*",
    re.DOTALL,
)
"""A number and its unit. Spaces of other kinds than ASCII's stand between the two alone."""
_TERM = re.compile(r"(?P<operator>\s*[*/]\s*|\s+|)(?P<name>[A-Za-z_]+)(?:(?:\^|\*\*)(?P<power>-?[1-9])(?![0-9.]))?")
_SIGNS = (("%", "percent"), ("°", "deg"), ("µ", "u"), ("μ", "u"), ("·", "*"), ("²", "^2"), ("³", "^3"), ("−", "-"))
_LONGEST = 80
"""Characters of a quantity: no user writes more, and arithmetic on a megabyte of digits takes long."""


class UnitError(ValueError):
    """A text that is no quantity of the wanted dimension; ``found``, ``allowed`` and ``hint`` as in a Problem."""

    def __init__(self, message: str, found: str, allowed: str, hint: str | None = None):
        super().__init__(message)
        self.found, self.allowed, self.hint = found, allowed, hint


def unit_names() -> list[str]:
    """Every name that a unit may be written with, without prefixes."""
    return list(_UNITS)


@functools.lru_cache(maxsize=1024)
def _unit(name: str) -> tuple[Fraction, Exponents]:
    """The factor to SI and the powers of the base units of one unit: its name, or a prefix and a name, or that with a
    plural ``s`` where the name is a word and not a symbol. Raises ValueError for an unknown name."""
    if name == "dimensionless":
        return Fraction(1), (0, 0, 0, 0)
    if name in _UNITS:
        return _UNITS[name]
    for plural in ("", "s") if name.endswith("s") else ("",):
        stem = name.removesuffix(plural)
        for prefix, power in _PREFIXES.items():
            unit = stem.removeprefix(prefix) if stem.startswith(prefix) else ""
            if unit not in _UNITS or (plural and len(unit) <= LONGEST_SYMBOL):
                continue
            factor, powers = _UNITS[unit]
            return factor * Fraction(10) ** power, powers
    raise ValueError(name)


@functools.lru_cache(maxsize=1024)
def _factor(expression: str) -> tuple[Fraction, Exponents]:
    """The same for a product of powers of units, read from left to right: ``N m s/rad``, ``kg*m^2``, ``1/s``.

    Raises ValueError with the part that is not understood.
    """
    text = expression
    for symbol, word in _SIGNS:
        text = text.replace(symbol, word)
    text = re.sub(r"^1\s*/", "/", text.strip())
    factor, exponents, position = Fraction(1), [0, 0, 0, 0], 0
    while position < len(text):
        match = _TERM.match(text, position)
        if match is None or (position == 0 and "*" in match["operator"]) or (position and not match["operator"]):
            raise ValueError(text[position:])
        sign = -1 if match["operator"].strip() == "/" else 1
        power = sign * int(match["power"] or 1)
        unit, powers = _unit(match["name"])
        factor *= unit**power
        exponents = [total + power * each for total, each in zip(exponents, powers, strict=True)]
        position = match.end()
    return factor, tuple(exponents)  # type: ignore[return-value]


def split(text: str) -> tuple[Fraction, str]:
    """The exact number of a quantity written as text, and its unit ("" for none), of whatever dimension. Raises UnitError."""
    match = _QUANTITY.fullmatch(text) if len(text) <= _LONGEST else None
    shown = repr(text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "...")
    if match is None:
        raise UnitError("expected a number, with or without a unit", shown, "a number, or one with a unit")
    number, unit = match.groups("")
    if unit:
        _known_factor(unit, shown, "a number, or one with a unit")
    value = Fraction(number)
    if abs(value) > LARGEST:
        raise UnitError("too large a number", shown, f"magnitudes up to {LARGEST:g}")
    return value, unit


def _known_factor(unit: str, shown: str, allowed: str) -> tuple[Fraction, Exponents]:
    """As :func:`_factor`. Raises UnitError with the nearest unit there is."""
    try:
        return _factor(unit)
    except ValueError as error:
        near = difflib.get_close_matches(str(error), unit_names(), 1)
        hint = f"did you mean {near[0]!r}?" if near else None
        raise UnitError(f"unknown unit {str(error)!r}", shown, allowed, hint) from None


def dimension_name(exponents: Exponents) -> str:
    """The name of a dimension given by its powers of the base units, or the powers themselves."""
    for dimension in DIMENSIONS.values():
        if exponents == dimension.accepted[0]:
            return dimension.name
    return " ".join(f"{name}^{power}" for name, power in zip(_BASE, exponents, strict=True) if power)


def article(noun: str) -> str:
    """The noun with "a" or "an"."""
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


@functools.lru_cache(maxsize=65536)
def parse(text: str, dimension: str) -> float:
    """The SI value of a quantity written as text; a bare number is SI already. Raises UnitError."""
    wanted = DIMENSIONS[dimension]
    is_number = wanted.unit == "1"
    allowed = "a number, or a percentage as '1 %'" if is_number else f"a number in {wanted.unit}, or one with a unit"
    match = _QUANTITY.fullmatch(text) if len(text) <= _LONGEST else None
    shown = repr(text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "...")
    if match is None:
        hint = (
            "$NAME is a parameter: only quantities of the `model` that declares it can refer to it"
            if "$" in text
            else None
        )
        raise UnitError(f"expected {article(dimension)}, found no number", shown, allowed, hint)
    number, unit = match.groups("")
    factor = Fraction(1)
    if unit:
        factor, exponents = _known_factor(unit, shown, allowed)
        if exponents not in wanted.accepted:
            raise UnitError(
                f"wrong unit: expected {article(dimension)} ({wanted.unit}), found {unit!r}",
                f"{shown}, of dimension {dimension_name(exponents)}",
                allowed,
            )
    value = Fraction(number) * factor
    if abs(value) > LARGEST:
        raise UnitError("too large a number", shown, f"magnitudes up to {LARGEST:g}")
    return float(value)


class Reader:
    """A field type that reads one value by :meth:`read`; subclasses are frozen dataclasses used in ``Annotated``.
    ``WORDS``, ``UNIT`` and ``SCHEMA``: the results of :meth:`describe`, :meth:`unit` and :meth:`schema` where these are
    fixed."""

    WORDS: ClassVar[str] = ""
    UNIT: ClassVar[str] = ""
    SCHEMA: ClassVar[Mapping[str, Any]] = {}

    def read(self, value: Any) -> Any:
        """The value as the world wants it. Raises Faults."""
        raise NotImplementedError

    def written(self, value: Any) -> Any:
        """A value that was read, as a spec writes it, for the defaults in the schema and the reference."""
        return value

    def schema(self) -> dict[str, Any]:
        """Its JSON Schema."""
        return dict(self.SCHEMA)

    def unit(self) -> str:
        """The SI unit, for the reference; "" for none."""
        return self.UNIT

    def describe(self) -> str:
        """The type in words, for the reference."""
        return self.WORDS

    def _validate(self, value: Any) -> Any:
        try:
            return self.read(unreported(value))
        except Faults as error:
            raise raised(error.faults, None) from None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return self.schema()


@dataclass(frozen=True)
class Number(Reader):
    """A finite number of a dimension of :data:`DIMENSIONS`, within bounds (``above``: the lower one excluded)."""

    dimension: str = "number"
    least: float | None = None
    most: float | None = None
    above: bool = False

    def read(self, value: Any) -> float:
        if type(value) is float:
            number = value
        elif isinstance(value, str):
            try:
                number = parse(value, self.dimension)
            except UnitError as error:
                raise fault(str(error), error.found, error.allowed, error.hint, code="S201") from None
        elif isinstance(value, bool) or not (isinstance(value, int) or hasattr(value, "__float__")):
            raise fault(f"expected {self.describe()}", show(value), self._allowed(), code="S201")
        else:
            try:
                number = float(value)
            except (OverflowError, TypeError, ValueError):
                raise fault("not a usable number", show(value)[:40], self._allowed(), code="S203") from None
        if not -LARGEST <= number <= LARGEST:  # also true of NaN
            finite = "a finite number" if number - number != 0.0 else f"magnitudes up to {LARGEST:g}"
            raise fault("not a usable number", show(value), finite, code="S203")
        if self.least is not None and (number <= self.least if self.above else number < self.least):
            word = "above" if self.above else "at least"
            raise fault(f"must be {word} {self.least:g}", show(value), self._allowed(), code="S202")
        if 0.0 < number < SMALLEST and (self.above or self.dimension in ("mass", "density")):
            allowed = f"{'' if self.above else '0, or '}at least {SMALLEST:g}"
            raise fault("too small a number", show(value), allowed, code="S202")
        if self.most is not None and number > self.most:
            raise fault(f"must be at most {self.most:g}", show(value), self._allowed(), code="S202")
        return number

    def _bounds(self) -> str:
        parts = []
        if self.least is not None:
            parts.append(f"{'>' if self.above else '≥'} {self.least:g}")
        if self.most is not None:
            parts.append(f"≤ {self.most:g}")
        return ", ".join(parts)

    def _allowed(self) -> str:
        unit = self.unit()
        return " ".join(
            part for part in ("a number", self._bounds(), f"in {unit}, or with a unit" if unit else "") if part
        )

    def unit(self) -> str:
        unit = DIMENSIONS[self.dimension].unit
        return "" if unit == "1" else unit

    def describe(self) -> str:
        bounds = self._bounds()
        return article(self.dimension) + (f" {bounds}" if bounds else "")

    def schema(self) -> dict[str, Any]:
        schema: dict[str, Any] = {"type": ["number", "string"], "pattern": "^\\s*[-+]?[.0-9$]"}
        if self.least is not None:
            schema["exclusiveMinimum" if self.above else "minimum"] = self.least
        if self.most is not None:
            schema["maximum"] = self.most
        return schema


@dataclass(frozen=True)
class Vector(Reader):
    """A list of numbers of one kind; ``longest`` when the length may vary up to it."""

    item: Number
    length: int = 3
    longest: int | None = None

    def read(self, value: Any) -> tuple[float, ...]:
        if hasattr(value, "tolist"):  # an array of numpy
            value = value.tolist()
        longest = self.longest or self.length
        if not isinstance(value, (list, tuple)) or not self.length <= len(value) <= longest:
            found = f"{len(value)} values" if isinstance(value, (list, tuple)) else show(value)
            raise fault(f"expected {self.describe()}", found, f"[{', '.join(['…'] * self.length)}]", code="S104")
        return tuple(read_each(enumerate(value), self.item.read))

    def unit(self) -> str:
        return self.item.unit()

    def describe(self) -> str:
        count = f"{self.length}" if self.longest is None else f"{self.length} to {self.longest}"
        noun = {"inertia": "inertias", "velocity": "velocities", "angular velocity": "angular velocities"}
        return f"a list of {count} {noun.get(self.item.dimension, self.item.dimension + 's')}"

    def schema(self) -> dict[str, Any]:
        longest = self.longest or self.length
        return {"type": "array", "items": self.item.schema(), "minItems": self.length, "maxItems": longest}


@dataclass(frozen=True)
class Direction(Reader):
    """A vector whose length does not matter, but must not be zero; kept as written, normalised when resolved."""

    WORDS = "a vector of 3 numbers, not zero"
    SCHEMA = Vector(Number()).schema()

    def read(self, value: Any) -> tuple[float, ...]:
        vector = Vector(Number()).read(value)
        if not any(vector):
            raise fault(
                "a zero vector has no direction",
                show(list(vector)),
                "a vector other than zero",
                "[0, 0, 1]",
                code="S204",
            )
        return vector


@dataclass(frozen=True)
class UnitQuaternion(Reader):
    """w x y z of unit length to 1 % (then normalised): a larger deviation is a mistake, not rounding."""

    WORDS = "a unit quaternion w x y z"
    SCHEMA = Vector(Number(), 4).schema()

    def read(self, value: Any) -> tuple[float, ...]:
        quaternion = Vector(Number(), 4).read(value)
        squared = sum(item * item for item in quaternion)
        if not 0.98 < squared < 1.02:
            raise fault(
                "not of unit length",
                f"{show(list(quaternion))}, of length {squared**0.5:.6g}",
                "w x y z of length 1",
                code="S204",
            )
        return quaternion


@dataclass(frozen=True)
class Whole(Reader):
    """A whole number."""

    least: int = 0
    most: int = 2**53

    def read(self, value: Any) -> int:
        if isinstance(value, bool) or not hasattr(value, "__index__"):
            raise fault("expected a whole number", show(value), f"{self.least} to {self.most}", code="S104")
        number = int(value)
        if not self.least <= number <= self.most:
            raise fault("out of range", show(value), f"{self.least} to {self.most}", code="S202")
        return number

    def describe(self) -> str:
        return f"a whole number ≥ {self.least}"

    def schema(self) -> dict[str, Any]:
        return {"type": "integer", "minimum": self.least, "maximum": self.most}


@dataclass(frozen=True)
class ByJointType(Reader):
    """A value whose dimension follows from the joint's type: kept as written here, read by ``models.Joint``."""

    unit_text: str
    values: int = 1
    orientation: bool = False
    parts: bool = False
    """Whether a free joint has it in two parts."""

    def read(self, value: Any) -> Any:
        return value

    def unit(self) -> str:
        return self.unit_text

    def describe(self) -> str:
        return "[lower, upper]" if self.values == 2 else "by the joint's type"

    def schema(self) -> dict[str, Any]:
        number = Number().schema()
        if self.values == 2:
            return Vector(Number(), 2).schema()
        if self.orientation:
            return {"anyOf": [number, Vector(Number()).schema(), {"$ref": "#/definitions/Orientation"}]}
        if self.parts:
            two = {"linear": number, "angular": number}
            return {"anyOf": [number, {"type": "object", "properties": two, "additionalProperties": False}]}
        return number
