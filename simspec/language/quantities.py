"""The types that fields have: numbers with a dimension and bounds, and vectors (names and words: ``words.py``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pydantic import GetJsonSchemaHandler
from pydantic_core import core_schema

from simspec.language import units
from simspec.language.strict import Faults, fault, raised, read_each, show, unreported


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
    """A finite number of a dimension of :mod:`simspec.language.units`, within bounds (``above``: the lower one excluded)."""

    dimension: str = "number"
    least: float | None = None
    most: float | None = None
    above: bool = False

    def read(self, value: Any) -> float:
        if type(value) is float:
            number = value
        elif isinstance(value, str):
            try:
                number = units.parse(value, self.dimension)
            except units.UnitError as error:
                raise fault(str(error), error.found, error.allowed, error.hint) from None
        elif isinstance(value, bool) or not (isinstance(value, int) or hasattr(value, "__float__")):
            raise fault(f"expected {self.describe()}", show(value), self._allowed())
        else:
            try:
                number = float(value)
            except (OverflowError, TypeError, ValueError):
                raise fault("not a usable number", show(value)[:40], self._allowed()) from None
        if not -units.LARGEST <= number <= units.LARGEST:  # also true of NaN
            finite = "a finite number" if number - number != 0.0 else f"magnitudes up to {units.LARGEST:g}"
            raise fault("not a usable number", show(value), finite)
        if self.least is not None and (number <= self.least if self.above else number < self.least):
            word = "above" if self.above else "at least"
            raise fault(f"must be {word} {self.least:g}", show(value), self._allowed())
        if 0.0 < number < units.SMALLEST and (self.above or self.dimension in ("mass", "density")):
            allowed = f"{'' if self.above else '0, or '}at least {units.SMALLEST:g}"
            raise fault("too small a number", show(value), allowed)
        if self.most is not None and number > self.most:
            raise fault(f"must be at most {self.most:g}", show(value), self._allowed())
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
        unit = units.DIMENSIONS[self.dimension].unit
        return "" if unit == "1" else unit

    def describe(self) -> str:
        bounds = self._bounds()
        return units.article(self.dimension) + (f" {bounds}" if bounds else "")

    def schema(self) -> dict[str, Any]:
        schema: dict[str, Any] = {"type": ["number", "string"], "pattern": "^\\s*[-+]?[.0-9]"}
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
            raise fault(f"expected {self.describe()}", found, f"[{', '.join(['…'] * self.length)}]")
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
            raise fault("a zero vector has no direction", show(list(vector)), "a vector other than zero", "[0, 0, 1]")
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
                "not of unit length", f"{show(list(quaternion))}, of length {squared**0.5:.6g}", "w x y z of length 1"
            )
        return quaternion


@dataclass(frozen=True)
class Whole(Reader):
    """A whole number."""

    least: int = 0
    most: int = 2**53

    def read(self, value: Any) -> int:
        if isinstance(value, bool) or not hasattr(value, "__index__"):
            raise fault("expected a whole number", show(value), f"{self.least} to {self.most}")
        number = int(value)
        if not self.least <= number <= self.most:
            raise fault("out of range", show(value), f"{self.least} to {self.most}")
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
