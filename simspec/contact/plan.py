"""From the law of every two materials to the numbers that an engine's shapes hold.

Engines have no table of pairs: they combine two shapes' numbers by a rule of their own (``Rules``). The plan inverts that
rule. Where one number for each material cannot give all pairs, there are two ways, and an engine's module says which it has:

- *layers*: a shape is there several times, once in each layer that its material takes part in, and two copies meet only
  in the layer that their pair of materials belongs to. Each layer has numbers of its own;
- *explicit pairs*: the engine takes the law of two shapes as such; only pairs that numbers cannot give are written.

Each way is chosen by data (``Target.plan``), and its cost is what ``simspec compile --explain`` shows.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from simspec.contact.meeting import meeting_materials, solid_shapes
from simspec.support.features import Feature, Need
from simspec.world.kinematics import CollisionFilter
from simspec.world.types import Body, Hardness, PairContact, Shape, Surface, World

Pair = tuple[str, str]

SAME = 1e-12
"""How far a combined number may be from the pair's, relative above 1: the tolerance of text, proof level L0."""
MOST_SPLIT_MATERIALS = 32
"""Materials among which layers are sought: their number of tries grows with the fourth power."""
RULES = ("max", "min", "product", "harmonic", "cross", "none")
"""How two numbers of a quantity become one. harmonic: 2 μ₁ μ₂ / (μ₁ + μ₂); cross:
s₁ μ₂ + s₂ μ₁ with the sliding friction μ; none: the engine lacks it."""
QUANTITIES = ("friction", "torsional_friction", "rolling_friction", "restitution")


@dataclass(frozen=True, slots=True)
class Rules:
    """An engine's rule for each quantity (one of ``RULES``)."""

    friction: str
    restitution: str
    torsional_friction: str = "none"
    rolling_friction: str = "none"
    hardness: str = "none"
    """same: both shapes hold the pair's; none: the engine holds no hardness with its shapes."""


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


def combine(rules: Rules, first: Surface, second: Surface) -> dict[str, float]:
    """What an engine makes of two shapes' numbers, by quantity."""
    return {name: combined(rules, name, first, second) for name in QUANTITIES}


def combined(rules: Rules, quantity: str, first: Surface, second: Surface) -> float:
    """One quantity of :func:`combine`."""
    rule, a, b = getattr(rules, quantity), getattr(first, quantity), getattr(second, quantity)
    if rule == "max":
        return max(a, b)
    if rule == "min":
        return min(a, b)
    if rule == "product":
        return a * b
    if rule == "harmonic":
        return 2.0 * a * b / (a + b) if a + b else 0.0
    if rule == "cross":
        return a * second.friction + b * first.friction
    if rule == "none":
        return 0.0
    raise ValueError(f"unknown combination rule {rule!r}; allowed: {', '.join(RULES)}")


@functools.lru_cache(maxsize=32)
def contact_plan(world: World, rules: Rules, layers: bool) -> ContactPlan:
    """The plan of ``world`` under an engine's ``rules``; in several ``layers`` where one does not do and they are allowed."""
    wanted = meeting_laws(world)
    materials = [material.name for material in world.contact.materials]
    numbers = _invert(world, rules, wanted)
    missed = _missed(rules, wanted, numbers)
    if not missed or not layers or len({name for pair in wanted for name in pair}) > MOST_SPLIT_MATERIALS:
        return ContactPlan({(name, 0): numbers[name] for name in materials}, dict.fromkeys(wanted, 0), missed)
    return _in_layers(world, rules, wanted)


def meeting_laws(world: World) -> dict[Pair, PairContact]:
    """The laws of the pairs of materials that meet and collide, by their sorted names."""
    met = meeting_materials(world)
    return {(pair.first, pair.second): pair for pair in world.contact.pairs if (pair.first, pair.second) in met}


def _in_layers(world: World, rules: Rules, wanted: Mapping[Pair, PairContact]) -> ContactPlan:
    """Each pair goes into the first layer that takes it; what no layer takes alone cannot be had."""
    layers: list[dict[Pair, PairContact]] = []
    missed = []
    for pair, law in wanted.items():
        for layer in [*layers, {}]:
            trial = {**layer, pair: law}
            if not _missed(rules, trial, _invert(world, rules, trial)):
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
        found = _invert(world, rules, layer)
        used = {name for pair in layer for name in pair}
        numbers.update({(name, index): found[name] for name in found if name in used})
    everywhere = _invert(world, rules, {})
    for material in world.contact.materials:  # what never meets anything is there all the same
        if not any(name == material.name for name, _ in numbers):
            numbers[material.name, 0] = everywhere[material.name]
    layer_of = {pair: index for index, layer in enumerate(layers) for pair in layer}
    return ContactPlan(dict(sorted(numbers.items())), layer_of, tuple(sorted(missed)))


def _missed(rules: Rules, wanted: Mapping[Pair, PairContact], numbers: Mapping[str, Surface]) -> tuple[Pair, ...]:
    found = []
    for pair, law in wanted.items():
        given = combine(rules, numbers[pair[0]], numbers[pair[1]])
        if any(
            getattr(rules, name) != "none" and not _same(given[name], getattr(law, name)) for name in QUANTITIES
        ) or (rules.hardness == "same" and any(numbers[name].hardness != law.hardness for name in pair)):
            found.append(pair)
    return tuple(sorted(found))


def _same(one: float, other: float) -> bool:
    return abs(one - other) <= SAME * max(1.0, abs(other))


def _invert(world: World, rules: Rules, wanted: Mapping[Pair, PairContact]) -> dict[str, Surface]:
    """Numbers of every material which, combined by ``rules``, give the ``wanted`` pairs as far as there are such numbers."""
    names = [material.name for material in world.contact.materials]
    found: dict[str, dict[str, float]] = {name: {} for name in names}
    for quantity in QUANTITIES:
        own = {material.name: getattr(material, quantity) for material in world.contact.materials}
        values = {pair: getattr(law, quantity) for pair, law in wanted.items()}
        rule = getattr(rules, quantity)
        if rule == "cross":
            friction = {name: found[name]["friction"] for name in names}
            solved = _cross(names, values, friction)
        elif rule == "product":
            solved = _product(names, values, own)
        elif rule == "harmonic":
            solved = _harmonic(names, values, own)
        elif rule == "none":
            solved = dict.fromkeys(names, 0.0)
        else:
            solved = _extreme(names, values, own, min if rule == "max" else max)
        for name in names:
            found[name][quantity] = solved[name]
    hardness: dict[str, Hardness] = {}
    if rules.hardness == "same":
        for pair, law in wanted.items():
            for name in pair:
                hardness.setdefault(name, law.hardness)
        hardness = {name: hardness.get(name, Hardness()) for name in names}
    return {name: Surface(**found[name], hardness=hardness.get(name)) for name in names}


def _extreme(names: Iterable[str], values: Mapping[Pair, float], own: Mapping[str, float], inverse) -> dict[str, float]:
    """Of the max rule: the smallest value among a material's pairs; of the min rule the largest."""
    partners: dict[str, list[float]] = {name: [] for name in names}
    for (first, second), value in values.items():
        partners[first].append(value)
        partners[second].append(value)
    return {name: inverse(found) if found else own[name] for name, found in partners.items()}


def _product(names: Iterable[str], values: Mapping[Pair, float], own: Mapping[str, float]) -> dict[str, float]:
    """Of the product rule: a material with a pair above zero has a number above zero, all others zero.

    What meets itself has the root of that value; from there values spread along pairs. Where nothing is known (a ramp
    and a box, one of each), the first keeps the root of its own value.
    """
    positive = {pair: value for pair, value in values.items() if value > 0.0}
    needed = {name for pair in positive for name in pair}
    touched = {name for pair in values for name in pair}
    found = {name: 0.0 if name in touched else math.sqrt(own[name]) for name in names}
    known: set[str] = set()
    for (first, second), value in positive.items():
        if first == second:
            found[first] = math.sqrt(value)
            known.add(first)
    open_pairs = [pair for pair in sorted(positive) if pair[0] != pair[1]]
    while open_pairs:
        half_known = next((pair for pair in open_pairs if (pair[0] in known) != (pair[1] in known)), None)
        if half_known is None:
            start = next((name for pair in open_pairs for name in pair if name not in known), None)
            if start is None:
                break
            found[start] = math.sqrt(own[start]) if own[start] > 0.0 else 1.0
            known.add(start)
        else:
            given, asked = half_known if half_known[0] in known else half_known[::-1]
            found[asked] = positive[half_known] / found[given]
            known.add(asked)
        open_pairs = [pair for pair in open_pairs if not (pair[0] in known and pair[1] in known)]
    assert known == needed
    return found


def _harmonic(names: Iterable[str], values: Mapping[Pair, float], own: Mapping[str, float]) -> dict[str, float]:
    """Of 2 μ₁ μ₂ / (μ₁ + μ₂) = c: with ρ = 1/μ it is ρ₁ + ρ₂ = 2/c. A material with a pair above zero has a number above zero,
    all others that meet something zero."""
    names = list(names)
    touched = {name for pair in values for name in pair}
    inverse = _sums(names, {pair: 2.0 / value for pair, value in values.items() if value > 0.0})
    # an inverse of zero: no such numbers, and checked
    return {
        name: 1.0 / inverse[name] if inverse[name] > 0.0 else 0.0 if name in touched else own[name] for name in names
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
    """Of ρ₁ + ρ₂ = ratio for every pair: what is known of one spreads along pairs; zero where nothing says more."""
    found = dict.fromkeys(names, 0.0)
    known: set[str] = set()
    for (first, second), ratio in ratios.items():
        if first == second:
            found[first] = ratio / 2.0
            known.add(first)
    open_pairs = [pair for pair in sorted(ratios) if pair[0] != pair[1]]
    while open_pairs:
        half_known = next((pair for pair in open_pairs if (pair[0] in known) != (pair[1] in known)), None)
        if half_known is None:
            apart = _two_sides({pair: ratios[pair] for pair in open_pairs})
            if not apart:
                break
            found.update(apart)
            known.update(apart)
        else:
            given, asked = half_known if half_known[0] in known else half_known[::-1]
            found[asked] = max(0.0, ratios[half_known] - found[given])  # below zero: no such numbers, and checked
            known.add(asked)
        open_pairs = [pair for pair in open_pairs if not (pair[0] in known and pair[1] in known)]
    return found


def _two_sides(ratios: Mapping[Pair, float]) -> dict[str, float]:
    """Of ρ₁ + ρ₂ = ratio where no ρ is known: those of the names that hang together with the first pair's.

    Along pairs every ρ is ± that of the first name and a constant. A ring of an odd number of pairs says how large that one is;
    else any that leaves all of them above zero will do, and it is the middle of these: two materials have half each.
    """
    neighbours: dict[str, list[tuple[str, float]]] = {}
    for (first, second), ratio in ratios.items():
        neighbours.setdefault(first, []).append((second, ratio))
        neighbours.setdefault(second, []).append((first, ratio))
    if not neighbours:
        return {}
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


@dataclass(frozen=True, slots=True)
class Part:
    """The collision shapes of one body that share a material and a layer, and so one set of numbers and one filter."""

    body: str
    material: str
    layer: int
    shapes: tuple[Shape, ...]
    surface: Surface


def parts(body: Body, plan: ContactPlan) -> tuple[Part, ...]:
    """A body's collision shapes, split by material and copied into every layer; the body's own shapes come first.

    Most bodies have one part. An engine that holds numbers or filters per body puts the others on bodies of their own,
    rigidly joined.
    """
    solid = solid_shapes(body)
    found = []
    for material in dict.fromkeys(shape.material for shape in solid):
        shapes = tuple(shape for shape in solid if shape.material == material)
        for layer in plan.layers(material):
            found.append(Part(body.name, material, layer, shapes, plan.numbers[material, layer]))
    return tuple(found)


def shape_pairs(world: World, pairs: Iterable[Pair]) -> Iterator[tuple[str, str]]:
    """The sorted names of every two shapes of these pairs of materials that may touch."""
    shapes: dict[str, list[tuple[int, str, str]]] = {}
    for index, body in enumerate(world.bodies):
        for shape in solid_shapes(body):
            shapes.setdefault(shape.material, []).append((index, body.name, shape.name))
    allowed = CollisionFilter(world)
    for one, two in pairs:
        for index, body, name in shapes.get(one, ()):
            for other_index, other_body, other in shapes.get(two, ()):
                if (one != two or index < other_index) and allowed.may_touch(body, other_body):
                    yield (min(name, other), max(name, other))


def surfaces(shape: Shape, plan: ContactPlan) -> tuple[Surface, ...]:
    """What an engine must hold for a collision shape: its numbers in each of its layers."""
    return tuple(plan.numbers[shape.material, layer] for layer in plan.layers(shape.material))


_FEATURES = {
    "friction": Feature.FRICTION_PAIRS,
    "torsional_friction": Feature.FRICTION_PAIRS,
    "rolling_friction": Feature.FRICTION_PAIRS,
    "restitution": Feature.RESTITUTION_PAIRS,
}


def unreachable(world: World, rules: Rules, plan: ContactPlan) -> dict[str, dict[Pair, float]]:
    """What the numbers of a plan do not give, and an engine without explicit pairs so cannot have: for each quantity the
    pairs, with what they would get instead (NaN for ``hardness``)."""
    wanted = meeting_laws(world)
    found: dict[str, dict[Pair, float]] = {}
    for pair in plan.missed:
        first, second = (plan.numbers[name, plan.layer_of[pair]] for name in pair)
        for name, given in combine(rules, first, second).items():
            if getattr(rules, name) != "none" and not _same(given, getattr(wanted[pair], name)):
                found.setdefault(name, {})[pair] = given
        if rules.hardness == "same" and any(one.hardness != wanted[pair].hardness for one in (first, second)):
            found.setdefault("hardness", {})[pair] = math.nan
    return found


def pair_needs(world: World, rules: Rules) -> list[Need]:
    """Needs of FRICTION_PAIRS and RESTITUTION_PAIRS: where one number for each material cannot give the world's pairs."""
    wanted = meeting_laws(world)
    simple = contact_plan(world, rules, False)
    found: dict[Feature, dict[str, None]] = {}
    for pair in simple.missed:
        given = combine(rules, simple.numbers[pair[0], 0], simple.numbers[pair[1], 0])
        for name in QUANTITIES:
            if getattr(rules, name) != "none" and not _same(given[name], getattr(wanted[pair], name)):
                path = f"contact.pairs.{pair[0]}.{pair[1]}.{name}"
                found.setdefault(_FEATURES[name], {})[path] = None
        law = wanted[pair]
        if rules.hardness == "same" and any(simple.numbers[name, 0].hardness != law.hardness for name in pair):
            found.setdefault(Feature.HARDNESS_PAIRS, {})[f"contact.pairs.{pair[0]}.{pair[1]}.hardness"] = None
    return [Need(feature, tuple(paths)) for feature, paths in found.items()]


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
