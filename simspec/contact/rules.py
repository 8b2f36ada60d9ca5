"""How an engine combines two shapes' numbers into one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simspec.language.vocabulary import COMBINED_QUANTITIES, ENGINE_RULES
from simspec.world.types import Surface

SAME = 1e-12
"""How far a combined number may be from the pair's, relative above 1: the tolerance of text, proof level L0."""


TABLE = "table"
NOT_COMBINED = (TABLE, "none")
"""Rules by which shapes hold no numbers."""


@dataclass(frozen=True, slots=True)
class Rules:
    """An engine's rule for each quantity (one of ``ENGINE_RULES``)."""

    friction: str
    restitution: str
    torsional_friction: str = "none"
    rolling_friction: str = "none"
    hardness: str = "none"
    """same: both shapes hold the pair's; table: with the law of every two materials; none: the engine holds no hardness with
    its shapes."""
    most_restitution: float = math.inf
    """The largest number of a shape; the engine takes more for none."""

    @property
    def table(self) -> bool:
        """Whether the engine holds a table of the laws of every two materials, and combines no numbers of shapes."""
        return self.friction == TABLE

    def combines(self, quantity: str) -> bool:
        """Whether the engine has a quantity as numbers of shapes, which it combines."""
        return getattr(self, quantity) not in NOT_COMBINED


_SLIDING = "friction"


def combine(rules: Rules, first: Surface, second: Surface) -> dict[str, float]:
    """What an engine makes of two shapes' numbers, by quantity."""
    return {name: combined(rules, name, first, second) for name in COMBINED_QUANTITIES}


def combined(rules: Rules, quantity: str, first: Surface, second: Surface) -> float:
    """One quantity of :func:`combine`."""
    rule: str = getattr(rules, quantity)
    values: tuple[float, float] = (getattr(first, quantity), getattr(second, quantity))
    a, b = values
    if quantity == "restitution" and max(values) > rules.most_restitution:
        return 0.0
    if rule == "max":
        return max(a, b)
    if rule == "min":
        return min(a, b)
    if rule == "product":
        return a * b
    if rule == "mean":
        return 0.5 * (a + b)
    if rule == "harmonic":
        return 2.0 * a * b / (a + b) if a + b else 0.0
    if rule == "cross":
        frictions: tuple[float, float] = (getattr(first, _SLIDING), getattr(second, _SLIDING))
        return a * frictions[1] + b * frictions[0]
    if rule in NOT_COMBINED:
        return 0.0
    raise ValueError(f"unknown combination rule {rule!r}; allowed: {', '.join(ENGINE_RULES)}")


def same(one: float, other: float) -> bool:
    return abs(one - other) <= SAME * max(1.0, abs(other))
