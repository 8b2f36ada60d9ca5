"""Contact: materials, how they combine, and what does not touch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from simspec.spec.quantities import Name, Number, Reader, Word
from simspec.spec.shapes import NameOf
from simspec.spec.strict import Fault, Faults, Strict, fault, replace_loc, show

CONES = ("elliptic", "pyramid-inscribed", "pyramid-circumscribed")
RULES = ("min", "max", "product", "mean", "geometric-mean")
MOST_MATERIALS = 300
"""The world holds every pair of materials: n (n + 1) / 2 entries."""

Coefficient = Annotated[float, Number("number", 0)]
Ratio = Annotated[float, Number("number", 0, 1)]


@dataclass(frozen=True)
class Names(Reader):
    """A list of names; ``count`` of them, or any number."""

    count: int | None = None
    path: bool = False

    def read(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, (list, tuple)) or (self.count is not None and len(value) != self.count):
            raise fault(f"wants {self.describe()}", show(value))
        return tuple(Name(self.path).read(item) for item in value)

    def describe(self) -> str:
        count = "" if self.count is None else f"{self.count} "
        return f"a list of {count}" + ("bodies' full names" if self.path else "names")

    def schema(self) -> dict[str, Any]:
        found: dict[str, Any] = {"type": "array", "items": Name(self.path).schema()}
        if self.count is not None:
            found |= {"minItems": self.count, "maxItems": self.count}
        return found


@dataclass(frozen=True)
class Exclusions(Reader):
    """Pairs of full body names."""

    def read(self, value: Any) -> tuple[tuple[str, ...], ...]:
        if not isinstance(value, (list, tuple)):
            raise fault("wants a list of pairs of bodies", show(value), "[[body, other], ...]")
        return tuple(self._pair(index, item) for index, item in enumerate(value))

    def _pair(self, index: int, item: Any) -> tuple[str, ...]:
        try:
            pair = Names(2, path=True).read(item)
            if pair[0] == pair[1]:
                raise fault("a body is not excluded from itself", pair[0], "two different bodies")
        except Faults as error:
            raise Faults(replace_loc(error.faults, (index,))) from None
        return pair

    def describe(self) -> str:
        return "a list of pairs of bodies' full names"

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": Names(2, path=True).schema()}


class Material(Strict):
    """A surface, by its contact with itself."""

    friction: Coefficient = Field(0.0, description="μ: sliding friction, largest tangential over normal force")
    restitution: Ratio = Field(0.0, description="e: separation speed over approach speed")


class Combine(Strict):
    """How the values of two different materials combine where `pairs` says nothing. One word stands for both."""

    friction: Annotated[str, Word(RULES)] = Field("min", description="Rule for friction")
    restitution: Annotated[str, Word(RULES)] = Field("min", description="Rule for restitution")


class Pair(Strict):
    """The contact law of two materials; wins over `combine`, and over the material's own values for a pair with itself."""

    between: Annotated[tuple[str, str], Names(2)] = Field(..., description="The two materials")
    friction: Coefficient = Field(None, description="Friction of the pair; default: by `combine`")
    restitution: Ratio = Field(None, description="Restitution of the pair; default: by `combine`")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if "between" in data and "friction" not in data and "restitution" not in data:
            yield Fault((), "a pair says nothing without friction or restitution")


class Group(Strict):
    """A collision group; bodies name it by `collision_group`."""

    ignores: Annotated[tuple[str, ...], Names()] = Field(
        ..., description="Groups whose bodies do not touch bodies of this one; its own name: bodies within the group"
    )


class Contact(Strict):
    """Contact between bodies. Bodies joined by a joint do not touch each other, nor do bodies joined rigidly."""

    friction_cone: Annotated[str, Word(CONES)] = Field(
        "elliptic",
        description="The friction law. elliptic: |f| ≤ μ N; pyramid-inscribed: |fx| + |fy| ≤ μ N; "
        "pyramid-circumscribed: |fx| ≤ μ N and |fy| ≤ μ N",
    )
    materials: dict[NameOf, Material] = Field({}, description="Materials by name")
    combine: Combine = Field(None, description="The rule for pairs of different materials, or a rule for each quantity")
    pairs: list[Pair] = Field([], description="Laws of pairs of materials")
    groups: dict[NameOf, Group] = Field({}, description="Collision groups by name; symmetric")
    exclude: Annotated[tuple[tuple[str, str], ...], Exclusions()] = Field(
        (), description="Pairs of bodies, by their full names, that do not touch"
    )

    @classmethod
    def prepare(cls, data: dict[str, Any]) -> tuple[dict[str, Any], list[Fault]]:
        word = data.get("combine")
        if not isinstance(word, str):
            return data, []
        data = dict(data)
        try:
            Word(RULES).read(word)
        except Faults as error:
            del data["combine"]
            return data, replace_loc(error.faults, ("combine",))
        data["combine"] = {"friction": word, "restitution": word}
        return data, []

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        materials = data.get("materials")
        if isinstance(materials, Mapping) and len(materials) > MOST_MATERIALS:
            yield Fault(("materials",), "too many materials", str(len(materials)), f"up to {MOST_MATERIALS}")
