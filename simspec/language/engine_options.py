"""Options of engines in a scenario: solver settings, by timestep and by pairs of materials, and accepted approximations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any

from pydantic import Field

from simspec.language.contact import Names
from simspec.language.quantities import Number
from simspec.language.shapes import NameOf
from simspec.language.strict import Fault, Faults, Strict
from simspec.language.words import SettingValue, Text

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
            yield Fault(("settings",), "no settings", "{}", "{NAME: value}")

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
            yield Fault(place, "no settings", None, "settings: {NAME: value}, or pairs")


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
                yield Fault(("at_timestep", index, "above"), "bounds must rise", f"{above:g} s after {before:g} s")
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
