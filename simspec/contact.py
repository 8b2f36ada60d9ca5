"""From the law of every two materials to the numbers that an engine's shapes hold.

Most engines have no table of pairs: they combine two shapes' numbers by a rule of their own (:class:`Rules`). The plan inverts
that rule (``inversion``). Where one number for each material cannot give all pairs, there are two ways, and an engine's module
says which it has:

- *layers*: a shape is there several times, once in each layer that its material takes part in, and two copies meet only
  in the layer that their pair of materials belongs to. Each layer has numbers of its own;
- *explicit pairs*: the engine takes the law of two shapes as such; only pairs that numbers cannot give are written.

One that holds a table by materials (rule ``table``) needs neither: its shapes store nothing, and its dialect writes the laws.
Each way is chosen by data (``Target.plan``), and its cost is what ``simspec compile --explain`` shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from simspec.language.vocabulary import COMBINED_QUANTITIES, ENGINE_RULES
from simspec.support.features import Feature
from simspec.support.negotiation import Need
from simspec.world.canonical import derived
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.reach import reach
from simspec.world.types import Body, Hardness, Pair, PairContact, Shape, Surface, World

# How an engine combines two shapes' numbers into one.

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


MOST_SPLIT_MATERIALS = 32
"""Materials among which layers are sought: their number of tries grows with the fourth power."""


@dataclass(frozen=True)
class ContactPlan:
    """How one world's pairs are had in one engine.

    numbers    for each (material, layer) what its shapes hold there
    layer_of   for each pair of materials that meet and collide, sorted, the layer in which they meet
    missed     pairs of which some number is not what the rules give in their layer, sorted: left to explicit pairs, or
               not to be had
    explicit   the pairs to be written as explicit ones, in the plan of a contact probe, which has what its scenario's files
               have; None: the format decides
    """

    numbers: Mapping[tuple[str, int], Surface]
    layer_of: Mapping[Pair, int]
    missed: tuple[Pair, ...] = ()
    explicit: tuple[Pair, ...] | None = None

    def layers(self, material: str) -> tuple[int, ...]:
        """The layers that the shapes of a material are in, at least one."""
        return tuple(sorted(layer for name, layer in self.numbers if name == material))

    @property
    def layered(self) -> bool:
        """Whether some shape is there more than once."""
        return len(self.numbers) > len({name for name, _ in self.numbers})

    def meet(self, first: tuple[str, int], second: tuple[str, int]) -> bool:
        """Whether copies of (material, layer) and (material, layer) touch."""
        pair = (min(first[0], second[0]), max(first[0], second[0]))
        return first[1] == second[1] == self.layer_of.get(pair, -1)


@derived
def contact_plan(world: World, rules: Rules, layers: bool) -> ContactPlan:
    """The plan of ``world`` under an engine's ``rules``; in several ``layers`` where one does not do and they are allowed."""
    wanted = meeting_laws(world)
    materials = [material.name for material in world.contact.materials]
    numbers = invert(world, rules, wanted)
    missed = missed_pairs(rules, wanted, numbers)
    if not missed or not layers or len({name for pair in wanted for name in pair}) > MOST_SPLIT_MATERIALS:
        return ContactPlan({(name, 0): numbers[name] for name in materials}, dict.fromkeys(wanted, 0), missed)
    return _in_layers(world, rules, wanted)


def _in_layers(world: World, rules: Rules, wanted: Mapping[Pair, PairContact]) -> ContactPlan:
    """Each pair goes into the first layer that takes it; a pair that no layer takes alone is missed."""
    layers: list[dict[Pair, PairContact]] = []
    missed = []
    for pair, law in wanted.items():
        for layer in [*layers, {}]:
            trial = {**layer, pair: law}
            if not missed_pairs(rules, trial, invert(world, rules, trial)):
                if not layer:
                    layers.append(layer)
                layer[pair] = law
                break
        else:
            missed.append(pair)
    if missed:
        layers = layers or [{}]
        layers[0].update({pair: wanted[pair] for pair in missed})
    numbers: dict[tuple[str, int], Surface] = {}
    for index, layer in enumerate(layers):
        found = invert(world, rules, layer)
        used = {name for pair in layer for name in pair}
        numbers.update({(name, index): found[name] for name in found if name in used})
    everywhere = invert(world, rules, {})
    for material in world.contact.materials:  # materials without contact are in the plan, too
        if not any(name == material.name for name, _ in numbers):
            numbers[material.name, 0] = everywhere[material.name]
    layer_of = {pair: index for index, layer in enumerate(layers) for pair in layer}
    return ContactPlan(dict(sorted(numbers.items())), layer_of, tuple(sorted(missed)))


def missed_pairs(rules: Rules, wanted: Mapping[Pair, PairContact], numbers: Mapping[str, Surface]) -> tuple[Pair, ...]:
    return tuple(
        sorted(pair for pair, law in wanted.items() if _differences(rules, law, *(numbers[name] for name in pair)))
    )


def _differences(rules: Rules, law: PairContact, first: Surface, second: Surface) -> dict[str, float]:
    """The quantities, with what an engine makes of two shapes' numbers, that differ from the law; NaN for ``hardness``."""
    found = {
        name: value
        for name, value in combine(rules, first, second).items()
        if rules.combines(name) and not same(value, getattr(law, name))
    }
    if rules.hardness == "same" and not first.hardness == second.hardness == law.hardness:
        found["hardness"] = math.nan
    return found


# A body's collision shapes, split by material and copied into the layers of a plan.


@dataclass(frozen=True, slots=True)
class CollisionPart:
    """The collision shapes of one body that share a material and a layer, and so one set of numbers and one filter."""

    body: str
    material: str
    layer: int
    shapes: tuple[Shape, ...]
    surface: Surface


def parts(body: Body, plan: ContactPlan) -> tuple[CollisionPart, ...]:
    """A body's collision shapes, split by material and copied into every layer; the body's own shapes come first.

    Most bodies have one part. An engine that holds numbers or filters per body puts the others on bodies of their own,
    rigidly joined.
    """
    solid = solid_shapes(body)
    found = []
    for material in dict.fromkeys(shape.material for shape in solid):
        shapes = tuple(shape for shape in solid if shape.material == material)
        for layer in plan.layers(material):
            found.append(CollisionPart(body.name, material, layer, shapes, plan.numbers[material, layer]))
    return tuple(found)


def surfaces(shape: Shape, plan: ContactPlan) -> tuple[Surface, ...]:
    """The numbers that an engine must store for a collision shape, in each of its layers."""
    return tuple(plan.numbers[shape.material, layer] for layer in plan.layers(shape.material))


# The limits of the numbers of a plan: features that a world needs, and pairs that an engine would combine otherwise.

HEAVY_ON_LIGHT = 10.0
"""Ratio of two masses from which a world needs MASS_RATIO at rest: at 10 no engine's stacks sink or move by 0.01 mm (measured).
A body with faces that slides with another on it needs it at every ratio: engines stop it up to 16 % short at 1 (4 ms)."""
_FEATURES = {
    "friction": Feature.FRICTION_PAIRS,
    "torsional_friction": Feature.FRICTION_PAIRS,
    "rolling_friction": Feature.FRICTION_PAIRS,
    "restitution": Feature.RESTITUTION_PAIRS,
    "hardness": Feature.HARDNESS_PAIRS,
}


def _misses(world: World, rules: Rules, plan: ContactPlan) -> Iterator[tuple[Pair, str, float]]:
    """Pairs and quantities of the laws that the numbers of a plan do not give, with the number instead."""
    wanted = meeting_laws(world)
    for pair in plan.missed:
        numbers = (plan.numbers[name, plan.layer_of[pair]] for name in pair)
        for quantity, number in _differences(rules, wanted[pair], *numbers).items():
            yield pair, quantity, number


def unreachable(world: World, rules: Rules, plan: ContactPlan) -> dict[str, dict[Pair, float]]:
    """The laws that the numbers of a plan do not give, so that an engine without explicit pairs does not have them: by quantity
    and pair the number instead (NaN for ``hardness``)."""
    found: dict[str, dict[Pair, float]] = {}
    for pair, quantity, number in _misses(world, rules, plan):
        found.setdefault(quantity, {})[pair] = number
    return found


def pair_needs(world: World, rules: Rules) -> list[Need]:
    """Needs of FRICTION_PAIRS, RESTITUTION_PAIRS and HARDNESS_PAIRS: where one number for each material cannot give the world's
    pairs."""
    found: dict[Feature, list[str]] = {}
    for (first, second), quantity, _ in _misses(world, rules, contact_plan(world, rules, False)):
        found.setdefault(_FEATURES[quantity], []).append(f"contact.pairs.{first}.{second}.{quantity}")
    return [Need(feature, tuple(paths)) for feature, paths in found.items()]


def coupled_needs(world: World) -> list[Need]:
    """The needs of contact of several bodies, where rigid contact can bring it about in this world (``world/reach.py``)."""
    found: dict[Feature, list[str]] = {}
    for (first, second), law in meeting_laws(world).items():
        if law.hardness.kind != "common":
            continue
        there, path = reach(world, first, second), f"contact.pairs.{first}.{second}"
        heavy = there.ratio >= HEAVY_ON_LIGHT or (there.ratio and there.corners and law.friction)
        for feature, needed, place in (
            (Feature.CARRIED_FRICTION, law.friction and there.carries, f"{path}.friction"),
            (Feature.SELF_LOCKING, law.friction and there.jams, f"{path}.friction"),
            (Feature.EVEN_PRESSURE, law.friction and there.squeezes, f"{path}.friction"),
            (Feature.MASS_RATIO, heavy, path),
        ):
            if needed:
                found.setdefault(feature, []).append(place)
    return [Need(feature, tuple(found[feature])) for feature in Feature if feature in found]


def impact_needs(world: World) -> list[Need]:
    """The need of IMPACT_FRICTION: where two bodies that may touch, one of which moves, have friction under a rigid contact.

    A compliant contact lasts many steps, and its friction is that of any slide; native contact is a declared difference.
    """
    paths = tuple(
        f"contact.pairs.{first}.{second}.{quantity}"
        for (first, second), law in meeting_laws(world).items()
        if law.hardness.kind == "common"
        for quantity in ("friction", "torsional_friction", "rolling_friction")
        if getattr(law, quantity)
    )
    return [Need(Feature.IMPACT_FRICTION, paths)] if paths else []
