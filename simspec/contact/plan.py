"""From the law of every two materials to the numbers that an engine's shapes hold.

Most engines have no table of pairs: they combine two shapes' numbers by a rule of their own (``rules.Rules``). The plan inverts
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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from simspec.contact.rules import Rules, combine, invert, same
from simspec.support.features import Feature
from simspec.support.negotiation import Need
from simspec.world.canonical import derived
from simspec.world.contact_pairs import meeting_laws, solid_shapes
from simspec.world.reach import reach
from simspec.world.types import Body, Pair, PairContact, Shape, Surface, World

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
