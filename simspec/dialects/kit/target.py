"""What a dialect must know of the engine it writes for."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

from simspec.contact.plan import ContactPlan
from simspec.contact.rules import Rules
from simspec.world.contact_pairs import Pair
from simspec.world.types import Surface


@dataclass(frozen=True, slots=True)
class Target:
    """What a dialect must know of the engine it writes for; data, given by the engine's module."""

    engine: str
    rules: Rules
    """How the engine combines the numbers of two shapes."""
    plan: ContactPlan
    """The numbers that shapes get, and the layers of their copies."""
    settings: Mapping[str, bool | int | float | str]
    pair_settings: Mapping[Pair, Mapping[str, bool | int | float | str]] = field(default_factory=dict)
    """Settings of pairs of materials, which replace ``settings`` in their contacts."""

    def between(self, pair: Pair) -> Target:
        """The target with the settings that are in force between two materials (sorted names)."""
        own = self.pair_settings.get(pair)
        return dataclasses.replace(self, settings={**self.settings, **own}) if own else self


def known(numbers: Surface, quantity: str) -> float:
    """A number that the plan gives a shape. Raises ValueError where it gives none."""
    value: float | None = getattr(numbers, quantity)
    if value is None:
        raise ValueError(f"the contact plan lacks the {quantity} of {numbers}")
    return value
