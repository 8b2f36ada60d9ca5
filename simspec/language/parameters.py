"""Parameters of a model: how they are declared, and how the quantities of the model refer to them.

A reference is a sum of parameters, each with a factor: ``$length``, ``-$length / 2``, ``$hip + 0.5 * $thigh``. There is nothing
else: no functions, no brackets, no products of parameters.
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import Field

from simspec.language.document import INVALID
from simspec.language.quantities import DIMENSIONS, LARGEST, Number, Reader, UnitError, split
from simspec.language.strict import ABSENT, Fault, Faults, Maybe, Strict, fault, near, show
from simspec.language.words import LONGEST_NAME, Text, Word

MARK = "$"
"""The first character of a reference's name of a parameter."""
LONGEST_REFERENCE = 300
"""Characters of a reference."""
MOST_PARAMETERS = 100
"""Parameters of one model."""
REFERENCE_RULE = "$NAME, -$NAME / 2, 0.5 * $NAME, or a sum of such terms"

_FACTOR = r"[0-9]{1,20}(?:\.[0-9]{0,20})?(?:[eE][-+]?[0-9]{1,2})?"
_TERM = re.compile(
    rf"(?P<sign>[-+]?) *(?:(?P<before>{_FACTOR}) *\* *)?\$(?P<name>[A-Za-z_][A-Za-z0-9_]*)"
    rf"(?: *(?P<operator>[*/]) *(?P<after>{_FACTOR})(?![0-9.]))? *"
)
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class Term(NamedTuple):
    """A parameter times a factor."""

    name: str
    factor: Fraction


def is_reference(value: Any) -> bool:
    """Whether a value refers to a parameter, or tries to."""
    return isinstance(value, str) and MARK in value


def read_reference(text: str) -> list[Term]:
    """The terms of a reference. Raises Faults."""
    terms: list[Term] = []
    rest = text.strip(" ")
    position = 0
    if len(rest) > LONGEST_REFERENCE:
        raise fault("too long a reference", show(text), f"up to {LONGEST_REFERENCE} characters", code="S109")
    while position < len(rest) or not terms:
        match = _TERM.match(rest, position)
        if match is None or (terms and not match["sign"]):
            hint = "simspec knows no other arithmetic; declare a parameter for what is not such a sum"
            raise fault("not a reference to parameters", show(text), REFERENCE_RULE, hint, code="S201")
        factor = Fraction(match["before"] or 1) * (-1 if match["sign"] == "-" else 1)
        after = Fraction(match["after"] or 1)
        if match["operator"] == "/" and not after:
            raise fault("a division by 0", show(text), code="S201")
        terms.append(Term(match["name"], factor / after if match["operator"] == "/" else factor * after))
        position = match.end()
    return terms


def quantity_of(text: str, terms: Sequence[Term], values: Mapping[str, float], dimensions: Mapping[str, str]) -> str:
    """The quantity that a reference stands for, as a text with a unit; ``values`` are in SI. Raises Faults where the parameters
    are of several dimensions, or the number is too large."""
    first = terms[0].name
    for name, _ in terms:
        if dimensions[name] != dimensions[first]:
            found = f"{first}: {dimensions[first]}, {name}: {dimensions[name]}"
            raise fault("a sum of different dimensions", found, "parameters of one dimension", code="S201")
    total = sum((Fraction(values[name]) * factor for name, factor in terms), Fraction(0))
    if abs(total) > LARGEST:
        raise fault("too large a number", show(text), f"magnitudes up to {LARGEST:g}", code="S203")
    unit = DIMENSIONS[dimensions[first]].unit
    return f"{float(total) + 0.0!r} {'dimensionless' if unit == '1' else unit}"


@dataclass(frozen=True)
class ParameterName(Reader):
    """The name of a parameter: no hyphen, which would be read as a minus."""

    SCHEMA: ClassVar = {"type": "string", "pattern": f"^{_NAME.pattern}$"}
    WORDS = "name"

    def read(self, value: Any) -> str:
        rule = "letters, digits and _, beginning with a letter or _"
        if not isinstance(value, str) or not _NAME.fullmatch(value) or len(value) > LONGEST_NAME:
            clean = re.sub(r"[^A-Za-z0-9_]+", "_", value) if isinstance(value, str) else ""
            hint = f"did you mean {clean!r}?" if _NAME.fullmatch(clean) else None
            raise fault("not a valid name of a parameter", show(value), rule, hint, code="S301")
        return value


@dataclass(frozen=True)
class ParameterValue(Reader):
    """The value of a parameter, of the dimension that the model declares; kept as written."""

    UNIT = "by its dimension"
    WORDS = "a number"
    SCHEMA = Number("number").schema()

    def read(self, value: Any) -> Any:
        if is_reference(value):
            read_reference(value)
        elif isinstance(value, str):
            try:
                split(value)
            except UnitError as error:
                raise fault(str(error), error.found, error.allowed, error.hint, code="S201") from None
        else:
            Number("number").read(value)
        return value


class ModelParameter(Strict):
    """A quantity of a model that its placements may set."""

    dimension: Annotated[str, Word(tuple(DIMENSIONS))] = Field(..., description="Its dimension; `number`: none")
    default: Maybe[Annotated[Any, ParameterValue()]] = Field(
        ABSENT, description="Its value where a placement gives none; may refer to other parameters; none: required"
    )
    description: Annotated[str, Text()] = Field("", description="Its meaning")


class Wrong(NamedTuple):
    """The faults of the value of a parameter; ``given``: with the one that a placement gives, not with the default."""

    name: str
    given: bool
    faults: tuple[Fault, ...]


class ModelParameters:
    """The parameters of one model: their dimensions, and their values. ``declared`` and ``given``: as written, by name;
    ``unread``: those whose declaration has errors, which are reported where it is read."""

    def __init__(self, declared: Mapping[str, Any], given: Mapping[str, Any], unread: Container[str]):
        self.declared, self.unread = declared, unread
        self.dimensions = {name: str(parameter["dimension"]) for name, parameter in declared.items()}
        self.referenced: set[str] = set()
        self.wrong: list[Wrong] = []
        self._given = given
        self._values: dict[str, float | None] = {}
        self._within: list[str] = []
        for name in declared:
            self._value(name)

    def quantity(self, text: str) -> str | None:
        """The quantity that a reference stands for, as a text; None where a parameter's value is wrong or missing, which is
        reported once. Raises Faults where the reference is wrong."""
        terms = read_reference(text)
        values: dict[str, float] = {}
        for name, _ in terms:
            if name in self.unread:
                return None
            if name not in self.dimensions:
                allowed = ", ".join(f"${name}" for name in self.dimensions) or "the model has no parameters"
                hint = near(name, self.dimensions)
                raise fault(f"the model has no parameter {name!r}", show(text), allowed, hint, code="S302")
            self.referenced.add(name)
            value = self._value(name)
            if value is not None:
                values[name] = value
        return quantity_of(text, terms, values, self.dimensions) if len(values) == len({*dict(terms)}) else None

    def _value(self, name: str) -> float | None:
        if name in self._within:
            cycle = " -> ".join([*self._within[self._within.index(name) :], name])
            raise fault("the defaults of these parameters refer to each other", cycle, code="S311")
        if name not in self._values:
            self._within.append(name)
            try:
                self._values[name] = self._read(name)
            except Faults as error:
                self._values[name] = None
                self.wrong.append(Wrong(name, name in self._given, error.faults))
            finally:
                self._within.pop()
        return self._values[name]

    def _read(self, name: str) -> float | None:
        given = name in self._given
        written = self._given[name] if given else self.declared[name].get("default", INVALID)
        if written is INVALID:  # reported where it is written, or as missing
            return None
        if is_reference(written):
            if given:
                message, hint = "a scenario has no parameters that this could refer to", "a number with a unit"
                raise fault(message, show(written), hint=hint, code="S302")
            written = self.quantity(written)
        else:
            try:
                ParameterValue().read(written)
            except Faults:
                return None  # reported where it is read
        return None if written is None else Number(self.dimensions[name]).read(written)
