"""How an engine combines two shapes' numbers into one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from simspec.language.vocabulary import COMBINED_QUANTITIES, ENGINE_RULES
from simspec.world.types import Hardness, Pair, PairContact, Surface, World

SAME = 1e-12
"""How far a combined number may be from the pair's, relative above 1: the tolerance of text, proof level L0."""


TABLE = "table"
NOT_COMBINED = (TABLE, "none")
"""Rules without numbers of shapes."""


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
        """Whether the engine stores a table of the laws of every two materials, and combines nothing."""
        return self.friction == TABLE

    def combines(self, quantity: str) -> bool:
        """Whether the engine has a quantity as numbers of shapes, which it combines."""
        return getattr(self, quantity) not in NOT_COMBINED


COMBINED: Mapping[str, Callable[[float, float], float]] = {
    "max": max,
    "min": min,
    "product": lambda a, b: a * b,
    "mean": lambda a, b: 0.5 * (a + b),
    "harmonic": lambda a, b: 2.0 * a * b / (a + b) if a + b else 0.0,
    **dict.fromkeys(NOT_COMBINED, lambda a, b: 0.0),
}
"""By rule, the number that two shapes' numbers give; "cross" needs their friction, too."""


def combine(rules: Rules, first: Surface, second: Surface) -> dict[str, float]:
    """The numbers that an engine computes from those of two shapes, by quantity."""
    return {name: combined(rules, name, first, second) for name in COMBINED_QUANTITIES}


def combined(rules: Rules, quantity: str, first: Surface, second: Surface) -> float:
    """One quantity of :func:`combine`."""
    rule: str = getattr(rules, quantity)
    a: float = getattr(first, quantity)
    b: float = getattr(second, quantity)
    if quantity == "restitution" and max(a, b) > rules.most_restitution:
        return 0.0
    if rule == "cross":
        frictions: list[Any] = [first.friction, second.friction]
        return float(a * frictions[1] + b * frictions[0])
    if rule not in COMBINED:
        raise ValueError(f"unknown combination rule {rule!r}; allowed: {', '.join(ENGINE_RULES)}")
    return COMBINED[rule](a, b)


def same(value: float, other: float) -> bool:
    return abs(value - other) <= SAME * max(1.0, abs(other))


# Numbers of materials which, combined by an engine's rule, give the wanted pairs.


def invert(world: World, rules: Rules, wanted: Mapping[Pair, PairContact]) -> dict[str, Surface]:
    """Numbers of every material which, combined by ``rules``, give the ``wanted`` pairs as far as there are such numbers."""
    names = [material.name for material in world.contact.materials]
    found: dict[str, dict[str, float]] = {name: {} for name in names}
    for quantity in COMBINED_QUANTITIES:
        local = {material.name: getattr(material, quantity) for material in world.contact.materials}
        values = {pair: getattr(law, quantity) for pair, law in wanted.items()}
        largest = rules.most_restitution if quantity == "restitution" else math.inf
        rule = getattr(rules, quantity)
        if rule == "cross":
            solved = _cross(names, values, {name: found[name]["friction"] for name in names})
        elif rule == "product":
            solved = _product(names, values, local, largest < math.inf)
        elif rule == "mean":
            solved = _mean(names, values, local, largest)
        elif rule == "harmonic":
            solved = _harmonic(names, values, local)
        elif rule in NOT_COMBINED:
            solved = dict.fromkeys(names, 0.0)
        else:
            solved = _extreme(names, values, local, min if rule == "max" else max)
        for name in names:
            found[name][quantity] = solved[name]
    hardness: dict[str, Hardness] = {}
    if rules.hardness == "same":
        hardness = dict.fromkeys(names, Hardness())
        hardness |= {name: law.hardness for pair, law in reversed([*wanted.items()]) for name in pair}
    return {name: Surface(**found[name], hardness=hardness.get(name)) for name in names}


def _extreme(
    names: Iterable[str],
    values: Mapping[Pair, float],
    defaults: Mapping[str, float],
    inverse: Callable[[Iterable[float]], float],
) -> dict[str, float]:
    """Of the max rule: the smallest value among a material's pairs; of the min rule the largest."""
    of_pairs = {name: [value for pair, value in values.items() if name in pair] for name in names}
    return {name: inverse(found) if found else defaults[name] for name, found in of_pairs.items()}


def _spread(
    values: Mapping[Pair, float],
    found: dict[str, float],
    second: Callable[[float, float], float],
    begin: Callable[[list[Pair]], Mapping[str, float]],
) -> dict[str, float]:
    """The numbers of all materials of ``values``, from those ``found`` along pairs. ``second``: the number of a material in a
    pair of this value with this number of the other; ``begin``: further numbers where none of the open pairs has one."""
    open_pairs = sorted(values)
    while open_pairs := [pair for pair in open_pairs if not found.keys() >= set(pair)]:
        half_known = next((pair for pair in open_pairs if (pair[0] in found) != (pair[1] in found)), None)
        if half_known is None:
            found.update(begin(open_pairs))
        else:
            given, open_name = half_known if half_known[0] in found else half_known[::-1]
            found[open_name] = second(values[half_known], found[given])
    return found


def _product(
    names: Iterable[str], values: Mapping[Pair, float], defaults: Mapping[str, float], bounded: bool
) -> dict[str, float]:
    """Of the product rule: a material with a pair above zero has a number above zero, all others zero.

    A material that meets itself has the root of that value; from there values spread along pairs. Where nothing is known (a
    ramp and a box, one of each), the first keeps the root of its defaults value, unless others are above one then and
    ``bounded`` is true.
    """
    positive = {pair: value for pair, value in values.items() if value > 0.0}
    touched = {name for pair in values for name in pair}
    starts: list[str] = []

    def begin(open_pairs: list[Pair]) -> dict[str, float]:
        starts.append(open_pairs[0][0])
        return {starts[-1]: math.sqrt(defaults[starts[-1]]) or 1.0}

    roots = {first: math.sqrt(value) for (first, second), value in positive.items() if first == second}
    found = _spread(positive, roots, lambda value, number: value / number, begin)
    for start in starts if bounded else ():
        _level(found, positive, start)
    return {name: 0.0 if name in touched else math.sqrt(defaults[name]) for name in names} | found


def _level(found: dict[str, float], positive: Mapping[Pair, float], start: str) -> None:
    """Where what hangs together with ``start`` has a number above one, the same products with none, if there are: numbers of
    one side multiplied, of the other divided."""
    side, queue = {start: 0}, [start]
    for name in queue:
        for pair in positive:
            if name not in pair:
                continue
            other = pair[1] if pair[0] == name else pair[0]
            if other not in side:
                side[other] = 1 - side[name]
                queue.append(other)
            elif side[other] == side[name]:  # a cycle of 3, 5, ... pairs determines all values
                return
    largest = [max((found[name] for name in side if side[name] == which), default=1.0) for which in (0, 1)]
    if max(largest) <= 1.0:
        return
    factor = math.sqrt(largest[1] / largest[0])
    for name, which in side.items():
        found[name] *= factor if which == 0 else 1.0 / factor


def _mean(
    names: Iterable[str], values: Mapping[Pair, float], defaults: Mapping[str, float], largest: float
) -> dict[str, float]:
    """Of the mean (a₁ + a₂) / 2 = c, with numbers up to ``largest``: beyond it there are none, which is checked."""
    names = list(names)
    touched = {name for pair in values for name in pair}
    found = _sums(names, {pair: 2.0 * value for pair, value in values.items()})
    return {name: min(found[name], largest) if name in touched else defaults[name] for name in names}


def _harmonic(names: Iterable[str], values: Mapping[Pair, float], defaults: Mapping[str, float]) -> dict[str, float]:
    """Of 2 μ₁ μ₂ / (μ₁ + μ₂) = c: with ρ = 1/μ it is ρ₁ + ρ₂ = 2/c. A material with a pair above zero has a number above zero,
    all others that meet something zero."""
    names = list(names)
    touched = {name for pair in values for name in pair}
    inverse = _sums(names, {pair: 2.0 / value for pair, value in values.items() if value > 0.0})
    # an inverse of zero: no such numbers, and checked
    return {
        name: 1.0 / inverse[name] if inverse[name] > 0.0 else 0.0 if name in touched else defaults[name]
        for name in names
    }


def _cross(names: Iterable[str], values: Mapping[Pair, float], friction: Mapping[str, float]) -> dict[str, float]:
    """Of s₁ μ₂ + s₂ μ₁ = c: with s = ρ μ it is ρ₁ + ρ₂ = c/(μ₁ μ₂)."""
    ratios = {
        pair: value / (friction[pair[0]] * friction[pair[1]])
        for pair, value in values.items()
        if friction[pair[0]] * friction[pair[1]] > 0.0
    }
    found = _sums(names, ratios)
    return {name: found[name] * friction[name] for name in found}


def _sums(names: Iterable[str], ratios: Mapping[Pair, float]) -> dict[str, float]:
    """Of ρ₁ + ρ₂ = ratio for every pair: known numbers spread along pairs; zero where nothing says more."""
    halves = {first: ratio / 2.0 for (first, second), ratio in ratios.items() if first == second}
    # below zero: no such numbers, and checked
    found = _spread(
        ratios,
        halves,
        lambda ratio, number: max(0.0, ratio - number),
        lambda open_pairs: _two_sides({pair: ratios[pair] for pair in open_pairs}),
    )
    return dict.fromkeys(names, 0.0) | found


def _two_sides(ratios: Mapping[Pair, float]) -> dict[str, float]:
    """Of ρ₁ + ρ₂ = ratio where no ρ is known: those of the names that hang together with the first pair's.

    Along pairs every ρ is ± that of the first name and a constant. A cycle of 3, 5, ... pairs determines that name's value;
    else any that leaves all of them above zero will do, and it is the middle of these: two materials have half each.
    """
    neighbours: dict[str, list[tuple[str, float]]] = {}
    for (first, second), ratio in ratios.items():
        neighbours.setdefault(first, []).append((second, ratio))
        neighbours.setdefault(second, []).append((first, ratio))
    start = next(iter(neighbours))
    constant, sign = {start: 0.0}, {start: 1.0}
    queue, value = [start], None
    for name in queue:
        for other, ratio in neighbours[name]:
            if other not in sign:
                constant[other], sign[other] = ratio - constant[name], -sign[name]
                queue.append(other)
            elif sign[other] == sign[name] and value is None:
                value = 0.5 * sign[name] * (ratio - constant[name] - constant[other])
    if value is None:
        lowest = max(-constant[name] for name in queue if sign[name] > 0.0)
        highest = min(constant[name] for name in queue if sign[name] < 0.0)
        value = 0.5 * (lowest + highest)
    return {name: max(0.0, constant[name] + sign[name] * value) for name in queue}
