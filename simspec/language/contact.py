"""Contact: materials, how they combine, and what does not touch; and options of engines, also by pairs of materials."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from pydantic import Field
from pydantic_core import core_schema

from simspec.language.quantities import Number, Reader
from simspec.language.shapes import Length0, NameOf
from simspec.language.strict import (
    ABSENT,
    Fault,
    Faults,
    Maybe,
    Strict,
    fault,
    near,
    read_each,
    replace_loc,
    show,
    too_long,
    unreported,
)
from simspec.language.vocabulary import (
    COMBINATIONS,
    COMBINED_QUANTITIES,
    FRICTION_CONES,
    HARDNESS_WORDS,
    LAW_QUANTITIES,
)
from simspec.language.words import Flag, Name, SettingValue, Text, Word

MOST_MATERIALS = 300
"""The world holds every pair of materials: n (n + 1) / 2 entries."""


Coefficient = Annotated[float, Number("number", 0)]
Ratio = Annotated[float, Number("number", 0, 1)]
Arm = Annotated[float, Number("length", 0)]
Speed = Annotated[float, Number("velocity", 0)]


HARDNESS_FORMS: Mapping[str, Mapping[str, Number]] = {
    "time-constant": {"time_constant": Number("time", 0, above=True), "damping_ratio": Number("number", 0, above=True)},
    "stiffness": {"stiffness": Number("stiffness", 0, above=True), "damping": Number("damping", 0)},
}
"""The two ways to state a compliance, each with its numbers."""


@dataclass(frozen=True)
class HardnessReader(Reader):
    """A word, or a mapping of one of ``HARDNESS_FORMS``; read as (kind, numbers in the order of the form)."""

    def read(self, value: Any) -> tuple[str, tuple[float, ...]]:
        if isinstance(value, str):
            return Word(HARDNESS_WORDS).read(value), ()
        if not isinstance(value, Mapping):
            raise fault("expected a word or a compliance", show(value), self._allowed(), code="S601")
        known = {name for form in HARDNESS_FORMS.values() for name in form}
        for name in value:
            if name not in known:
                hint = near(str(name), known)
                raise Faults([Fault((str(name),), "no such key", show(name), self._allowed(), hint, code="S101")])
        kind = next((kind for kind, form in HARDNESS_FORMS.items() if set(form) == set(value)), None)
        if kind is None:
            raise fault("incomplete compliance", show(dict(value)), self._allowed(), _completion(value), code="S601")
        entries = ((name, (number, value[name])) for name, number in HARDNESS_FORMS[kind].items())
        return kind, tuple(read_each(entries, lambda entry: entry[0].read(unreported(entry[1]))))

    def written(self, value: tuple[str, tuple[float, ...]] | None) -> Any:
        if value is None or value[0] in HARDNESS_WORDS:
            return value and value[0]
        return dict(zip(HARDNESS_FORMS[value[0]], value[1], strict=True))

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        # a model that was made in Python is written as a spec would say it
        written = core_schema.plain_serializer_function_ser_schema(self.written)
        return core_schema.no_info_plain_validator_function(self._validate, serialization=written)

    def _allowed(self) -> str:
        forms = (f"{{{', '.join(form)}}}" for form in HARDNESS_FORMS.values())
        return ", ".join((*HARDNESS_WORDS, *forms))

    def describe(self) -> str:
        words = " \\| ".join(f"`{word}`" for word in HARDNESS_WORDS)
        return words + " \\| " + " \\| ".join(f"`{{{', '.join(form)}}}`" for form in HARDNESS_FORMS.values())

    def schema(self) -> dict[str, Any]:
        forms = [
            {
                "type": "object",
                "properties": {name: number.schema() for name, number in form.items()},
                "required": list(form),
                "additionalProperties": False,
            }
            for form in HARDNESS_FORMS.values()
        ]
        return {"anyOf": [{"enum": list(HARDNESS_WORDS)}, *forms]}


def _completion(value: Mapping[str, Any]) -> str:
    """The way from a part of a compliance, or from parts of two, to a whole one."""
    begun = [form for form in HARDNESS_FORMS.values() if set(form) & set(value)]
    if len(begun) == 1:
        return f"add {' and '.join(name for name in begun[0] if name not in value)}"
    return "; ".join(f"{' and '.join(form)} go together" for form in HARDNESS_FORMS.values())


HardnessValue = Annotated[tuple[str, tuple[float, ...]], HardnessReader()]


@dataclass(frozen=True)
class Names(Reader):
    """A list of names; ``count`` of them, or any number."""

    count: int | None = None
    path: bool = False

    def read(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, (list, tuple)) or (self.count is not None and len(value) != self.count):
            raise fault(f"expected {self.describe()}", show(value), code="S104")
        return tuple(Name(self.path).read(item) for item in value)

    def describe(self) -> str:
        count = "" if self.count is None else f"{self.count} "
        return f"a list of {count}" + ("bodies' full names" if self.path else "names")

    def schema(self) -> dict[str, Any]:
        schema: dict[str, Any] = {"type": "array", "items": Name(self.path).schema()}
        if self.count is not None:
            schema |= {"minItems": self.count, "maxItems": self.count}
        return schema


@dataclass(frozen=True)
class BodyPairs(Reader):
    """Pairs of full body names."""

    WORDS = "a list of pairs of bodies' full names"
    SCHEMA: ClassVar = {"type": "array", "items": Names(2, path=True).schema()}

    def read(self, value: Any) -> tuple[tuple[str, ...], ...]:
        if not isinstance(value, (list, tuple)):
            raise fault("expected a list of pairs of bodies", show(value), "[[body, other], ...]", code="S104")
        return tuple(read_each(enumerate(value), self._pair))

    @staticmethod
    def _pair(item: Any) -> tuple[str, ...]:
        pair = Names(2, path=True).read(item)
        if pair[0] == pair[1]:
            raise fault("a pair is of two bodies", pair[0], "two different bodies", code="S602")
        return pair


class Material(Strict):
    """A surface, by its contact with itself."""

    friction: Coefficient = Field(0.0, description="μ: sliding friction, largest tangential over normal force")
    restitution: Ratio = Field(0.0, description="e: separation speed over approach speed")
    torsional_friction: Arm = Field(0.0, description="c: torque about the normal of at most c N")
    rolling_friction: Arm = Field(0.0, description="c: torque across the normal of at most c N")
    restitution_threshold: Speed = Field(0.0, description="Slower impacts do not bounce")


Rule = Annotated[str, Word(COMBINATIONS)]


class Combine(Strict):
    """Rules for the law of two different materials without an entry in `pairs`. A single word applies to all values
    but the threshold.
    """

    friction: Rule = Field("min", description="Rule for sliding friction")
    restitution: Rule = Field("min", description="Rule for restitution")
    torsional_friction: Rule = Field("min", description="Rule for torsional friction")
    rolling_friction: Rule = Field("min", description="Rule for rolling friction")
    restitution_threshold: Rule = Field("max", description="Rule for the threshold speed")


class Pair(Strict):
    """The contact law of two materials; overrides `combine`, and the values of the material for its pair with itself."""

    between: Annotated[tuple[str, str], Names(2)] = Field(..., description="The two materials")
    friction: Maybe[Coefficient] = Field(ABSENT, description="Sliding friction of the pair; default: by `combine`")
    restitution: Maybe[Ratio] = Field(ABSENT, description="Restitution of the pair; default: by `combine`")
    torsional_friction: Maybe[Arm] = Field(ABSENT, description="Torsional friction of the pair; default: by `combine`")
    rolling_friction: Maybe[Arm] = Field(ABSENT, description="Rolling friction of the pair; default: by `combine`")
    restitution_threshold: Maybe[Speed] = Field(
        ABSENT, description="Threshold speed of the pair; default: by `combine`"
    )
    hardness: Maybe[HardnessValue] = Field(ABSENT, description="Hardness of the pair; default: that of `contact`")
    margin: Maybe[Length0] = Field(
        ABSENT, description="Distance at which contact begins; default: the sum of the margins of both shapes"
    )
    collide: Annotated[bool, Flag()] = Field(True, description="false: shapes of the two do not collide")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        said = [name for name in data if name != "between"]
        if "between" in data and not said:
            allowed = ", ".join((*LAW_QUANTITIES, "hardness", "margin", "collide"))
            yield Fault((), "a pair needs at least one law", allowed=allowed, code="S602")
        if data.get("collide") is False and len(said) > 1:
            other = next(name for name in said if name != "collide")
            yield Fault(
                (other,),
                "a pair that does not collide cannot have another law",
                hint="remove one of the two",
                code="S602",
            )


class Group(Strict):
    """A collision group; bodies name it by `collision_group`."""

    ignores: Annotated[tuple[str, ...], Names()] = Field(
        ...,
        description="Groups whose bodies do not touch bodies of this group; the name of the group itself: "
        "bodies within it",
    )


class Contact(Strict):
    """Contact between bodies. Bodies that are joined, rigidly or by a joint, do not touch each other; see `touch`."""

    friction_cone: Annotated[str, Word(FRICTION_CONES)] = Field(
        "elliptic",
        description="The friction law. elliptic: |f| ≤ μ N; pyramid-inscribed: |fx| + |fy| ≤ μ N; "
        "pyramid-circumscribed: |fx| ≤ μ N and |fy| ≤ μ N",
    )
    hardness: HardnessValue = Field(("common", ()), description="Contact hardness; default for all pairs")
    materials: dict[NameOf, Material] = Field({}, description="Materials by name")
    combine: Maybe[Combine] = Field(
        ABSENT, description="The rule for pairs of different materials, or a rule for each quantity"
    )
    pairs: list[Pair] = Field([], description="Laws of pairs of materials")
    groups: dict[NameOf, Group] = Field({}, description="Collision groups by name; symmetric")
    exclude: Annotated[tuple[tuple[str, str], ...], BodyPairs()] = Field(
        (), description="Pairs of bodies, by their full names, that do not touch"
    )
    touch: Annotated[tuple[tuple[str, str], ...], BodyPairs()] = Field(
        (), description="Pairs of bodies, by their full names, that touch although a joint or a loop joins them"
    )
    self_collision: Annotated[bool, Flag()] = Field(
        True, description="Of a model file. false: the bodies of its model do not touch each other"
    )

    @classmethod
    def prepare(cls, data: dict[str, Any]) -> tuple[dict[str, Any], list[Fault]]:
        word = data.get("combine")
        if not isinstance(word, str):
            return data, []
        data = dict(data)
        try:
            Word(COMBINATIONS).read(word)
        except Faults as error:
            del data["combine"]
            return data, replace_loc(error.faults, ("combine",))
        data["combine"] = dict.fromkeys(COMBINED_QUANTITIES, word)
        return data, []

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        yield from too_long(data, "materials", MOST_MATERIALS)


# Options of engines: solver settings, by timestep and by pairs of materials, and accepted approximations.

WHOLE = 1e-9
"""Relative deviation from a whole number of steps, or from a bound of timesteps, that is round-off of the division."""


class PairSettings(Strict):
    """Solver settings of one engine for contact between two materials. They replace its `settings` there."""

    between: Annotated[tuple[str, str], Names(2)] = Field(..., description="The two materials")
    settings: dict[NameOf, Annotated[Any, SettingValue()]] = Field(
        ..., description="Solver settings that the engine has for each pair of materials"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if data.get("settings") == {}:
            yield Fault(("settings",), "no settings", "{}", "{NAME: value}", code="S113")

    @property
    def materials(self) -> tuple[str, str]:
        """The two materials, sorted."""
        first, second = sorted(self.between)
        return first, second


class SettingsAtTimestep(Strict):
    """Solver settings of runs whose timestep is above a bound: `settings`, `pairs` or both."""

    above: Annotated[float, Number("time", 0, above=True)] = Field(
        ..., description="The settings apply to every timestep greater than this one"
    )
    settings: dict[NameOf, Annotated[Any, SettingValue()]] = Field(
        {}, description="Solver settings, by the engine's names"
    )
    pairs: list[PairSettings] = Field([], description="Settings of pairs of materials")

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        if not data.get("settings") and not data.get("pairs"):
            place = ("settings",) if "settings" in data else ()
            yield Fault(place, "no settings", None, "settings: {NAME: value}, or pairs", code="S113")


class EngineOptions(Strict):
    """The options of an engine in a scenario. Nothing here may change the model."""

    settings: dict[NameOf, Annotated[Any, SettingValue()]] = Field(
        {}, description="Solver settings, by the engine's names"
    )
    pairs: list[PairSettings] = Field(
        [], description="Settings of pairs of materials, which replace `settings` in their contacts"
    )
    at_timestep: list[SettingsAtTimestep] = Field(
        [],
        description="Settings that depend on the timestep, by increasing `above`; later entries replace earlier ones",
    )
    accept: list[Annotated[str, Text()]] = Field([], description="Features that may be approximate in this engine")
    outside: list[Annotated[str, Text()]] = Field(
        [], description="Features computed outside this engine, which does not support them"
    )

    @classmethod
    def faults(cls, data: Mapping[str, Any]) -> Iterable[Fault]:
        entries = data.get("at_timestep")
        before: float | None = None
        for index, entry in enumerate(entries if isinstance(entries, (list, tuple)) else ()):
            given = entry.get("above") if isinstance(entry, Mapping) else getattr(entry, "above", None)
            try:
                above = Number("time", 0, above=True).read(given)
            except Faults:
                continue  # reported where it is read
            if before is not None and above <= before:
                yield Fault(
                    ("at_timestep", index, "above"), "bounds must rise", f"{above:g} s after {before:g} s", code="S205"
                )
            before = above

    def settings_at(self, timestep: float) -> dict[str, Any]:
        """The settings at a timestep (s): ``settings``, replaced by those of every entry of ``at_timestep`` that holds."""
        found = dict(self.settings)
        for entry in self.holding(timestep):
            found.update(entry.settings)
        return found

    def pairs_at(self, timestep: float) -> dict[tuple[str, str], dict[str, Any]]:
        """The settings of pairs of materials at a timestep (s), by the sorted names of the two: those of ``pairs``, replaced
        setting by setting by those of every entry of ``at_timestep`` that holds."""
        return merged_pairs([self.pairs, *(entry.pairs for entry in self.holding(timestep))])

    def holding(self, timestep: float) -> list[SettingsAtTimestep]:
        """The entries of ``at_timestep`` that hold at a timestep (s); one that equals a bound up to round-off does not."""
        return [entry for entry in self.at_timestep if timestep > entry.above * (1.0 + WHOLE)]


def merged_pairs(lists: Iterable[Iterable[PairSettings]]) -> dict[tuple[str, str], dict[str, Any]]:
    """Settings of pairs of materials by the sorted names of the two; later lists replace earlier ones, setting by setting."""
    merged: dict[tuple[str, str], dict[str, Any]] = {}
    for pairs in lists:
        for pair in pairs:
            merged.setdefault(pair.materials, {}).update(pair.settings)
    return merged
